"""Progress of solves on rank 0, and log records: once, readable, and none that were not wanted."""

import logging
import re
import subprocess
import sys

from mpi4py import MPI

import pytest
from support import recorded_evolution
from support.blocks import block
from support.textbook import pitchfork, start

from dolfinx_contact import ConvergenceError
from dolfinx_contact.continuation import explore, follow

COMM = MPI.COMM_WORLD
LINE = r"contact solve: full steps  iteration \d+  residual \S+  Krylov \d+  \d+ s"


def lines(capsys):
    return [x for x in capsys.readouterr().err.splitlines() if x.startswith("contact solve")]


def on_root(found):
    """Return the value of rank 0; other ranks must have none."""
    assert COMM.rank == 0 or not found
    return COMM.bcast(found)


def test_quick_solves_say_nothing(capsys):
    block().solve()
    out = capsys.readouterr()
    assert out.out == out.err == ""


def test_progress_appears_when_wanted(capsys):
    block().solve(progress=True)
    found = on_root(lines(capsys))
    assert re.fullmatch(LINE, found[0])
    assert re.fullmatch(r"contact solve: solved by full steps, \d+ iterations, \S+ s", found[-1])


def test_progress_of_a_failed_solve_reports_no_success(capsys):
    """The last line does not report success."""
    problem = block(options={"snes_max_it": 0})
    with pytest.raises(ConvergenceError):
        problem.solve(progress=True)
    found = on_root(lines(capsys))
    assert found
    assert not any("solved" in x for x in found)


@pytest.mark.ranks(2)
def test_progress_of_branches_names_the_end(capsys):
    """From the beginning, or never; the end is said as well."""
    system = pitchfork()
    x = start(system, [0.0])

    def said_with(progress):
        follow(system, x, -1.0, gamma_range=(-1.0, -0.5), progress=progress)
        return on_root(capsys.readouterr().err.splitlines())

    assert not said_with(None)
    first, *_, last = said_with(True)
    assert first.startswith("branch 0  point 0  gamma -1.0")
    assert last == "branch 0: gamma reached the end of its range"
    explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0), progress=True)
    found = on_root(capsys.readouterr().err.splitlines())
    assert sum("smooth bifurcation at gamma" in x for x in found) == 1
    assert not said_with(False)


def test_progress_of_a_history_names_the_end(capsys):
    """The messages of a stopping run: its position and the reason for its end."""
    evolution = recorded_evolution.pair(COMM, n=2)
    evolution.run([0.0, 1.0, 2.0], stop=lambda _: "enough", progress=True)
    found = [x for x in capsys.readouterr().err.splitlines() if x.startswith("evolution")]
    if COMM.rank == 0:
        line = r"evolution: time 1 of 2  step 1, of 1  .*\d+ \w+  \d+ s, about \d+ s left"
        assert re.fullmatch(line, found[0])
        assert found[-1] == "evolution: 1 steps, enough"
    assert not (COMM.rank and found)


# -- log -----------------------------------------------------------------------------------------


def said(caplog):
    """Messages of the package on rank 0; other ranks have none."""
    mine = [r.getMessage() for r in caplog.records if r.name.startswith("dolfinx_contact")]
    return on_root(mine)


def test_log_of_a_solve_lists_its_residuals(caplog):
    with caplog.at_level(logging.INFO):
        block().solve()
    found = said(caplog)
    number = r"\d\.\de[+-]\d\d"
    pattern = (
        rf"full steps, iteration 1: residual {number} \(force {number}, constraint {number}, "
        rf"cone {number}\), \d+ changes of status, \d+ Krylov iterations"
    )
    assert sum(re.fullmatch(pattern, x) is not None for x in found) == 1
    assert not any("Measures(" in x for x in found)


@pytest.mark.ranks(2)
def test_failed_strategies_are_logged_but_give_no_warning(caplog):
    problem = block(options={"snes_max_it": 0})
    with caplog.at_level(logging.INFO), pytest.raises(ConvergenceError, match="full steps: "):
        problem.solve()
    assert sum(x.startswith("full steps failed: ") for x in said(caplog)) == 1
    assert not any(x.levelname == "WARNING" for x in caplog.records)


@pytest.mark.ranks(2)
def test_branches_are_logged(caplog):
    system = pitchfork()
    with caplog.at_level(logging.DEBUG):
        follow(system, start(system, [0.0]), -1.0, gamma_range=(-1.0, -0.5))
        explore(system, [(start(system, [0.0]), -1.0)], gamma_range=(-1.0, 1.0))
    found = said(caplog)
    assert "branch ended: gamma reached the end of its range" in found
    assert "4 branches, 1 bifurcations: every ray has been followed" in found


def test_import_says_nothing():
    code = "import dolfinx_contact, dolfinx_contact.records, dolfinx_contact.meshing"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout == done.stderr == ""
