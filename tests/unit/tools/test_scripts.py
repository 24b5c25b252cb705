"""Parts of scripts: option parser, journals in memory, plain pictures."""

import argparse
import csv
import signal
import subprocess
import sys
from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
from cases._case import ScriptParser, number
from cases._hertz import Hertz
from support.blocks import block
from support.histories import dragged

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    HalfSpace,
    ParametricContact,
    io,
    records,
)
from dolfinx_contact.continuation import Branch, follow, follower_for, points_at
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.records import BranchRecord, leftmost, rightmost, total

COMM = MPI.COMM_WORLD
FUNCTIONALS = {"ut": leftmost("ut"), "un": rightmost("un"), "rn": total("rn"), "rt": total("rt")}


def pushed(cell="quad", n=3):
    """A block that is pressed and pushed the more the larger gamma is."""
    dim = 2 if cell in ("tri", "quad") else 3
    up = np.eye(dim)[-1]
    problem, moved = dragged(cell, n, obstacle=lambda _: HalfSpace(-0.002 * up, up))
    gamma = fem.Constant(problem.V.mesh, 0.0)
    way = ufl.as_vector([0.008 * gamma, *[0.0] * (dim - 2), -0.01 * gamma])
    return ParametricContact(problem, gamma, driven=[(moved, way)])


@pytest.fixture(scope="module")
def followed():
    system = pushed()
    x = system.create_vector()
    return system, x, follow(system, x, 0.0, gamma_range=(0.0, 1.0), route="steps")


# -- the command line ----------------------------------------------------------------------------


def parser():
    made = ScriptParser("A script", output="output/x", dim=2, cell=None, n=4, lame=(1.0, 2.0))
    made.add_argument("--part", type=number(least=0, below=1), default=0.5, help="of it")
    return made


def test_options_have_their_defaults():
    args = parser().parse(["--n", "7", "--lame", "3", "4", "-contact_snes_max_it", "9"])
    assert (args.n, args.lame, args.part, args.cell, args.output) == (
        7,
        [3, 4],
        0.5,
        "quad",
        "output/x",
    )
    assert parser().parse(["--dim", "3"]).cell == "hex"
    with pytest.raises(KeyError, match="wheels"):
        ScriptParser("A script", output="x", wheels=4)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--n 0", "--n: must be positive, got 0"),
        ("--n 2.5", "--n: must be a whole number"),
        ("--part nan", "--part: must be finite"),
        ("--part 1", "--part: must be below 1"),
        ("--part -0.1", "--part: must be at least 0"),
        ("--part x", "--part: must be a number"),
        ("--lame -1 1", "a stable material"),
        ("--dim 3 --cell tri", "--cell tri does not fit --dim 3"),
        ("--wheels 4", "unknown options"),
    ],
)
def test_bad_options_end_the_script(words, message, capsys):
    with pytest.raises(SystemExit):
        parser().parse(words.split())
    said = capsys.readouterr().err
    assert message in said if COMM.rank == 0 else said == ""


def test_numbers_of_options_keep_their_bounds():
    assert number(int, most=3)("3") == 3
    for kind, word in ((number(most=3), "3.1"), (number(above=2), "2"), (number(), "inf")):
        with pytest.raises(argparse.ArgumentTypeError):
            kind(word)


# -- journals in memory --------------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_journal_in_memory_is_that_of_a_record(followed, folder):
    system, x, branch = followed
    journal = records.journal_of(system, [branch], FUNCTIONALS)
    with BranchRecord(folder / "record", system, FUNCTIONALS) as record:
        follow(system, x, 0.0, gamma_range=(0.0, 1.0), route="steps", record=record)
        mine = journal.columns()
        other = record.journal.columns()
        for name in other:
            if name == "norm":  # in other units
                assert np.corrcoef(mine[name], other[name])[0, 1] == pytest.approx(1.0)
            elif other[name].dtype == object:
                assert mine[name].tolist() == other[name].tolist()
            else:
                np.testing.assert_allclose(mine[name], other[name], atol=1e-9)
        assert journal.summary()["folds"] == record.journal.summary()["folds"] == []
    assert journal.summary()["events"] == sum(bool(s.changes) for s in branch.special) > 1
    rows = journal.rows()
    assert [row["gamma"] for row in rows] == branch.summary()["gammas"]
    assert rows[-1] == journal.summary()["end"]
    with pytest.raises(ValueError, match="must be Branch objects"):
        records.journal_of(system, [3])
    with pytest.raises(ValueError, match="must be a function of the problem"):
        records.journal_of(system, [branch], {"wheels": 4})


@pytest.mark.parametrize("route", ["pivoting", "steps"])
def test_points_of_a_branch_are_interpolated_at_a_gamma(route):
    system = pushed(n=2)
    x = system.create_vector()
    way = dict(gamma_range=(0.0, 1.0), route=route)
    branch = follow(system, x, 0.0, **way)
    (point,) = points_at(system, branch, 0.73, **way)
    with follower_for(system, x, 0.0, gamma_scale=1.0, route=route) as follower:
        again = follower.run(follower.start(x, 0.0), gamma_range=(0.0, 1.0))
        (known,) = follower.at(again, 0.73)
    assert point.gamma == known.gamma == 0.73
    assert (point.y - known.y).norm() < 1e-10 * known.y.norm()
    assert system.letters(point.piece) == system.letters(known.piece)
    with pytest.raises(ValueError, match="gamma = 2"):
        points_at(system, branch, 2.0, **way)
    with pytest.raises(ValueError, match="a Branch with points"):
        points_at(system, Branch(), 0.5, **way)


# -- pictures and tables -------------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_report_speaks_on_one_rank(capsys):
    say = io.Report(COMM)
    problem = block(n=2)
    say("begins")
    result = problem.solve(monitor=say.newton)
    say.result(result)
    said = capsys.readouterr().out
    if COMM.rank > 0:
        assert said == ""
        return
    assert said.startswith("begins\n  Newton  0: force ")
    assert f"{result.reason}: {result.iterations} Newton iterations, {result.dofs} unknowns" in said
    assert f"{result.counts['stick']} stick" in said


@pytest.mark.ranks(2)
def test_rows_are_written_as_csv(folder):
    rows = [{"a": 1, "b": 0.1}, {"a": 2, "b": 0.2, "c": 3}]
    io.write_rows(COMM, folder / "rows.csv", rows)
    with open(folder / "rows.csv", newline="") as file:
        assert list(csv.reader(file)) == [["a", "b"], ["1", "0.1"], ["2", "0.2"]]
    with pytest.raises(ValueError, match="there are no rows"):
        io.write_rows(COMM, folder / "none.csv", [])


# -- Hertz, grids and polygons -------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_hertz_pressure_carries_the_load(dim):
    """The pressure carries the load, and its radius gives the load back."""
    hertz = Hertz(dim, 50.0, 2e5)
    load = 300.0
    a = hertz.radius(load)
    assert hertz.load(a) == pytest.approx(load)
    x = a * np.sin(np.linspace(0, np.pi / 2, 20001))
    weight = 2.0 if dim == 2 else 2 * np.pi * x
    assert np.trapezoid(weight * hertz.pressure(load, x), x) == pytest.approx(load, rel=1e-6)
    assert hertz.pressure(load, [0.0, 1.1 * a]).tolist() == [hertz.peak(load), 0.0]
    # The displacement of the axis below the surface is the integral of its strain.
    near, far = (hertz.approach(load, depth, 0.3) for depth in (20 * a, 40 * a))
    assert 0 < near < far
    with pytest.raises(ValueError, match="must be positive"):
        Hertz(dim, 0.0, 1.0)
    with pytest.raises(ValueError, match="2 or 3"):
        Hertz(4, 1.0, 1.0)


def test_a_graded_grid_has_cells_that_grow_by_one_factor():
    x = graded(10.0, 0.1, 5, 7)
    assert x[0] == 0
    assert x[-1] == pytest.approx(10.0, rel=1e-12)
    h = np.diff(x)
    np.testing.assert_allclose(h[:5], 0.1)
    np.testing.assert_allclose(h[6:] / h[5:-1], h[5] / h[4])
    assert graded(1.0, 0.1, 5, 5) == pytest.approx(np.linspace(0, 1, 11))
    h = np.diff(graded(1.0, 0.2, 4, 3))
    assert h[4:].sum() == pytest.approx(0.2)
    np.testing.assert_allclose(h[5:] / h[4:-1], h[4] / 0.2)
    for wrong in ((10.0, 0.1, 100, 1), (10.0, 0.1, 5, 0), (10.0, 0.0, 5, 5)):
        with pytest.raises(ValueError, match="do not fill"):
            graded(*wrong)
    domain = create_grid(COMM, [x, [1.0, 2.0, 4.0]], mesh.CellType.quadrilateral)
    area = fem.assemble_scalar(fem.form(fem.Constant(domain, 1.0) * ufl.dx))
    assert COMM.allreduce(area) == pytest.approx(30.0)
    with pytest.raises(ValueError, match="must increase"):
        create_grid(COMM, [x, [1.0, 1.0]], mesh.CellType.quadrilateral)


def test_round_off_of_gamma_is_printed_as_0(followed):
    points = followed[2].points
    assert "gamma from 0 to 0, " in str(Branch([*points, replace(points[-1], gamma=1.2e-17)]))


def test_a_closed_pipe_ends_the_command_quietly():
    command = [sys.executable, "-u", "-m", "dolfinx_contact", "info"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        run.stdout.close()
        assert run.stderr.read() == b""
    assert run.returncode == -signal.SIGPIPE
