"""Progress of solves on rank 0, and log records: once, readable, and none that were not wanted."""

import io
import logging
import re
import subprocess
import sys

from mpi4py import MPI

import pytest
from support import recorded_evolution
from support.blocks import block
from test_diagram import smooth, start

from dolfinx_contact import ConvergenceError, _progress
from dolfinx_contact._progress import Line
from dolfinx_contact.continuation import explore, follow
from dolfinx_contact.equations.measures import Measures
from dolfinx_contact.solvers import choice, ladder
from dolfinx_contact.solvers.history import SolveProgress, Step

COMM = MPI.COMM_WORLD
STEP = Step(3, Measures(1e-3, 2e-5, 4e-2), 5, 1.0, 17)
LINE = r"contact solve: full steps  iteration \d+  residual \S+  Krylov \d+  \d+ s"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def lines(capsys):
    return [x for x in capsys.readouterr().err.splitlines() if x.startswith("contact solve")]


def on_root(found):
    """What rank 0 has; nothing may be found elsewhere."""
    assert COMM.rank == 0 or not found
    return COMM.bcast(found)


def test_quick_solves_say_nothing(capsys):
    block().solve()
    out = capsys.readouterr()
    assert out.out == out.err == ""


def test_progress_when_wanted(capsys):
    block().solve(progress=True)
    found = on_root(lines(capsys))
    assert re.fullmatch(LINE, found[0])
    assert re.fullmatch(r"contact solve: solved by full steps, \d+ iterations, \S+ s", found[-1])


@pytest.mark.ranks(2)
def test_progress_of_a_long_solve(capsys, caplog, monkeypatch):
    """By itself once a solve takes some seconds; never where it is not wanted, or all is logged."""
    monkeypatch.setattr(_progress, "_PATIENCE", 0.0)
    block().solve()
    assert len(on_root(lines(capsys))) > 1
    block().solve(progress=False)
    assert not on_root(lines(capsys))
    caplog.set_level(logging.INFO, "dolfinx_contact")
    block().solve()
    assert not on_root(lines(capsys))


def test_progress_of_a_solve_that_fails(capsys):
    """The last line is no success."""
    problem = block(options={"snes_max_it": 0})
    with pytest.raises(ConvergenceError):
        problem.solve(progress=True)
    found = on_root(lines(capsys))
    assert found
    assert not any("solved" in x for x in found)


def test_line_of_a_terminal():
    """Kept up to date in place, and taken back before others write."""
    stream = Terminal()
    progress = SolveProgress(COMM, True, stream=stream)
    progress.strategy = "pivoting"
    progress.step(STEP)
    progress.step(STEP)
    progress.clear()
    progress.end(3)
    text = on_root(stream.getvalue())
    head = "contact solve: pivoting  iteration 3  residual 4.0e-02  Krylov 17  0 s"
    assert text.startswith(head + "\r\x1b[K" + head + "\r\x1b[K")
    assert text.count("\n") == 1
    assert text.endswith("\n")


@pytest.mark.ranks(2)
def test_line_elsewhere():
    """A line at once, others only from time to time; what must not be lost always."""
    stream = io.StringIO()
    line = Line(COMM, stream=stream, seconds=1000.0)
    for i in range(5):
        line.update(f"step {i}")
    line.write("fold")
    assert on_root(stream.getvalue()) == COMM.bcast("step 0\nfold\n" if COMM.rank == 0 else "")


def test_a_monitor_finds_a_line_of_its_own(capsys, monkeypatch):
    """What a monitor prints on a terminal does not mix with the line."""
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    block().solve(progress=True, monitor=lambda _: stream.write("mine\n"))
    for part in stream.getvalue().split("mine\n")[1:]:
        assert COMM.rank > 0 or part.startswith("contact solve")
    for part in stream.getvalue().split("mine\n")[1:-1]:
        assert COMM.rank > 0 or part.endswith("\r\x1b[K")


@pytest.mark.ranks(2)
def test_progress_of_branches(capsys, monkeypatch):
    """From the beginning, never, or once a branch takes some seconds; the end is said as well."""
    system = smooth(
        1,
        lambda x, g: x * (g - x**2),
        lambda x, g: [[g - 3 * x[0] ** 2]],
        lambda x, g: [x[0]],
    )
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
    monkeypatch.setattr(_progress, "_PATIENCE", 0.0)
    assert said_with(None)
    assert not said_with(False)


def test_progress_of_a_history(capsys):
    """Where it is, and how it ended, of a run that is stopped."""
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


def test_log_of_a_solve(caplog):
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
def test_log_of_failures(caplog):
    problem = block(options={"snes_max_it": 0})
    with caplog.at_level(logging.WARNING), pytest.raises(ConvergenceError):
        problem.solve()
    assert sum(x.startswith("full steps failed: ") for x in said(caplog)) == 1


def test_log_of_a_stagnating_solver(caplog, monkeypatch):
    """A new preconditioner, then the direct solver: each said once."""
    monkeypatch.setattr(choice, "_LARGEST_DIRECT", {3: 10})
    with caplog.at_level(logging.WARNING):
        block(cell="tet", n=4, options={"ksp_rtol": 1e-12, "ksp_max_it": 2}).solve()
    assert sum("the direct solver takes over" in x for x in said(caplog)) == 1


@pytest.mark.ranks(2)
def test_log_of_branches(caplog):
    system = smooth(
        1,
        lambda x, g: x * (g - x**2),
        lambda x, g: [[g - 3 * x[0] ** 2]],
        lambda x, g: [x[0]],
    )
    with caplog.at_level(logging.DEBUG):
        follow(system, start(system, [0.0]), -1.0, gamma_range=(-1.0, -0.5))
        explore(system, [(start(system, [0.0]), -1.0)], gamma_range=(-1.0, 1.0))
    found = said(caplog)
    assert "branch ended: gamma reached the end of its range" in found
    assert "4 branches, 1 bifurcations: every ray has been followed" in found


def test_a_solve_that_takes_longer_than_predicted(caplog, monkeypatch):
    problem = block()
    monkeypatch.setattr(ladder, "_SHORT", 1e9)
    with caplog.at_level(logging.INFO):
        problem.solve()
    assert 0 < problem.linear_solver.predicted < 60
    assert not any("were predicted" in x for x in said(caplog))
    monkeypatch.setattr(ladder, "_SHORT", 0.0)
    problem.linear_solver.predicted = 1e-6
    with caplog.at_level(logging.INFO):
        problem.solve()
    assert sum("s; 1e-06 s were predicted" in x for x in said(caplog)) == 1


@pytest.mark.skipif(COMM.size > 1, reason="starts a process of its own")
def test_import_says_nothing():
    code = "import dolfinx_contact, dolfinx_contact.records, dolfinx_contact.meshing"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout == done.stderr == ""
