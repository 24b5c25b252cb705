"""Assumption: a record is resumed with the data that it was written with.

A second script resuming a killed run has other materials, loads, meshes, tags or numbers, often
with the same mean values. It is refused. With the same data it ends as the run that was never
killed.
"""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, floor, two_blocks
from support.checks import assert_close

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import LinearProblem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    RigidBody,
    materials,
)
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.records import EvolutionRecord

COMM = MPI.COMM_WORLD

REFUSED = "another problem|differs"
TIMES = (0.0, 1.0, 2.0, 3.0)
#: Displacements of a top that is pressed, dragged to the right, and back.
WAY = np.array([[0.0, 0.0], [0.0, -0.02], [0.012, -0.02], [-0.004, -0.015]])


class Killed(Exception):
    """The end of a run."""


class Killer:
    """Observer ending a run after some steps."""

    def __init__(self, after):
        self.left = after

    def __call__(self, _):
        self.left -= 1
        if not self.left:
            raise Killed


def dragged(body, energy, factor=1.0):
    """History of a body that is pressed by its top and dragged to and fro."""
    problem = body.problem(Coulomb(0.3), energy)

    def load(t):
        x, y = (factor * np.interp(t, TIMES, WAY[:, k]) for k in range(2))
        body.move_top(x, y)

    return QuasiStatic(problem, load)


def cellwise(body, value):
    f = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    f.interpolate(value)
    return f


def linear(domain, left, right):
    """A field from ``left`` at x = 0 to ``right`` at x = 1."""
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    f.interpolate(lambda x: left + (right - left) * x[0])
    return f


def diagonals(side):
    body = block((3, 2), cell="tri", diagonal=side)
    return dragged(body, body.elastic(1000.0, 0.2))


def another_load(factor):
    body = block((4, 2))
    return dragged(body, body.elastic(1000.0, 0.2), factor=factor)


def components_of_a_force(*order):
    """f = t (g(x), g(1 - x), ...): exchanged components have the same norms."""
    body = block((2, 1, 1), (1.0, 0.5, 0.5))
    force = fem.Function(body.V)
    energy = body.elastic(1000.0, 0.2) - ufl.dot(force, body.u) * ufl.dx
    problem = body.problem(Coulomb(0.3), energy)
    parts = (60.0, 30.0, 60.0)

    def load(t):
        force.interpolate(lambda x: -t * np.stack([parts[k] * (0.2 + x[0]) for k in order]))

    return QuasiStatic(problem, load)


def gap_of_a_pair(left, right):
    both = two_blocks((3, 1), (3, 1))
    gap = linear(both.domain, left, right)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(0.3), gap=gap)
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    problem = ContactProblem(steel.energy(both.u) * ufl.dx, both.u, [pair], bcs=both.bcs)

    def load(t):
        x, y = (np.interp(t, TIMES, WAY[:, k]) for k in range(2))
        both.top.interpolate(lambda p: np.stack([x + 0 * p[0], 2 * y + 0 * p[0]]))

    return QuasiStatic(problem, load)


def held_in_nanometres(left, right):
    """The displacements of the top are of one component, and of 1e-11 metres."""
    size = 1e-9
    body = block((4, 2), (size, size))
    down = body.V.sub(1)
    part = down.collapse()[0]
    profile = fem.Function(part)
    profile.interpolate(lambda x: -0.02 * (left * size + (right - left) * x[0]))
    sides = fem.Constant(body.domain, 0.0)
    bcs = [
        fem.dirichletbc(profile, fem.locate_dofs_topological((down, part), 1, body.top), down),
        fem.dirichletbc(sides, body.dofs_of(0, body.top), body.V.sub(0)),
    ]
    problem = body.problem(Coulomb(0.3), body.elastic(1e9, 0.2), bcs=bcs)
    problem.solve()
    return QuasiStatic(problem, lambda t: setattr(sides, "value", 0.006 * size * t))


def centre_of_a_tilt(about):
    """The centre of a tilting rigid floor is a number without a place in any form."""
    body = block((4, 2))
    tilt = fem.Constant(body.domain, 0.0)
    obstacle = RigidBody(floor(), about=(about, 0.0), motion={"rz": tilt}, held=["x", "y"])
    problem = body.problem(Coulomb(0.3), body.elastic(1000.0, 0.2), obstacle=obstacle)

    def load(t):
        tilt.value = 0.005 * t
        body.move_top(0.0, -0.01 * t)

    return QuasiStatic(problem, load)


def pushed(cells=(4, 2), height=0.0):
    """A block sliding along a floor under its weight and a side force, for motions."""
    body = block(cells)
    force = fem.Constant(body.domain, (30.0, -100.0))
    energy = body.elastic(1000.0, 0.2) - ufl.dot(force, body.u) * ufl.dx
    return body, body.problem(Coulomb(0.3), energy, obstacle=floor(height))


def field_of_dashpots(left, right):
    body, problem = pushed()
    velocity = fem.Function(body.V)
    dashpot = linear(body.domain, left, right)
    damping = dashpot * ufl.dot(velocity, ufl.TestFunction(body.V)) * ufl.dx
    return NSCD(problem, 1.0, dt=0.5, velocity=velocity, damping=damping)


def field_of_density(heavy):
    body, problem = pushed()
    density = cellwise(body, lambda x: 1.0 + 4.0 * (np.abs(x[0] - heavy) < 0.5))
    return NSCD(problem, density, dt=0.5)


def rayleighs_factor(factor):
    _, problem = pushed((2, 2))
    return NSCD(problem, 1.0, dt=0.5, damping=(factor, 0.0))


def restitution(coefficient):
    _, problem = pushed(height=-0.005)
    return NSCD(problem, 1.0, dt=0.5, level="velocity", mass="lumped", restitution=coefficient)


#: How an evolution is made, its data in the first and in the second script.
RUNS = {
    "diagonals that lean to the other side": (
        diagonals,
        (mesh.DiagonalType.left,),
        (mesh.DiagonalType.right,),
    ),
    "another load": (another_load, (1.0,), (1.5,)),
    "components of a force exchanged": (components_of_a_force, (0, 1, 2), (1, 0, 2)),
    "a gap that is mirrored": (gap_of_a_pair, (0.0, 0.01), (0.01, 0.0)),
    "displacements in nanometres mirrored": (held_in_nanometres, (0.5, 1.0), (1.0, 0.5)),
    "another centre of a tilt": (centre_of_a_tilt, (0.0,), (1.0,)),
    "dashpots that are mirrored": (field_of_dashpots, (0.0, 80.0), (80.0, 0.0)),
    "a density that changes sides": (field_of_density, (0.0,), (1.0,)),
    "another factor of Rayleigh's damping": (rayleighs_factor, (5.0,), (50.0,)),
    "another restitution": (restitution, (0.9,), (0.1,)),
}


def killed(where, evolution, after=2, times=TIMES):
    with EvolutionRecord(where, evolution) as record, contextlib.suppress(Killed):
        evolution.run(times, record=record, observer=Killer(after))


def resumed(where, evolution):
    with EvolutionRecord(where, evolution, resume=True) as record:
        return record.go_on()


def assert_same_end(found, expected):
    """Compare the last steps of two histories."""
    one, other = (h.steps[-1] for h in (found, expected))
    tables = [end.result.tables["contact"] for end in (one, other)]
    assert_close(*(np.column_stack([t.rn, t.rt]) for t in tables))
    motion = hasattr(one.energies, "kinetic")
    for name in ("external", "dissipated", *(("kinetic", "damping") if motion else ())):
        assert_close(getattr(one.energies, name), getattr(other.energies, name))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.sample if name == "another load" else ())
        for name in RUNS
    ],
)
def test_a_run_is_not_resumed_with_other_data(name, folder):
    make, first, second = RUNS[name]
    killed(folder / "record", make(*first))
    with pytest.raises(ValueError, match=REFUSED):
        resumed(folder / "record", make(*second))


@pytest.mark.parametrize("name", RUNS)
def test_a_killed_run_resumed_with_its_data_is_the_whole_run(name, folder):
    make, first, _ = RUNS[name]
    killed(folder / "record", make(*first))
    assert_same_end(resumed(folder / "record", make(*first)), make(*first).run(TIMES))


@pytest.mark.sample
def test_the_start_of_a_motion_is_in_its_record(folder):
    """The second script sets neither velocity nor displacement."""

    def make(thrown):
        body = block((4, 2))
        force = fem.Constant(body.domain, (0.0, 0.0))
        energy = body.elastic(1000.0, 0.2) - ufl.dot(force, body.u) * ufl.dx
        problem = body.problem(Coulomb(0.3), energy, bcs=[])
        velocity = fem.Function(body.V)
        if thrown:
            velocity.interpolate(lambda x: np.stack([0.3 + 0 * x[0], -1.0 + 0 * x[0]]))
            body.u.interpolate(lambda x: np.stack([0 * x[0], 0.01 + 0 * x[0]]))
        return NSCD(problem, 1.0, dt=0.02, velocity=velocity, mass="consistent")

    times = (0.0, 0.02, 0.04, 0.06)
    killed(folder / "record", make(True), times=times)
    assert_same_end(resumed(folder / "record", make(False)), make(True).run(times))


def test_the_memory_before_a_record_is_in_it(folder):
    """The record begins with the second run of a history; the second script makes no first."""
    first, second = (0.0, 1.0, 2.0), (2.0, 2.5, 3.0)
    evolution = another_load(1.0)
    evolution.run(first)
    killed(folder / "record", evolution, 1, second)
    whole = another_load(1.0)
    whole.run(first)
    assert_same_end(resumed(folder / "record", another_load(1.0)), whole.run(second))


# --- another number of ranks ---


def solved_stiffness(mirrored):
    """P2, forces as a vector field; the modulus solves a Poisson problem, up to round-off."""
    body = block(degree=2)
    force, profile = fem.Function(body.V), fem.Function(body.V)
    at = (lambda x: 1.0 - x[0]) if mirrored else (lambda x: x[0])
    profile.interpolate(lambda x: np.stack([20.0 * at(x) ** 2, -60.0 * at(x)]))
    W = fem.functionspace(body.domain, ("Lagrange", 1))
    a, b = ufl.TrialFunction(W), ufl.TestFunction(W)
    form = (a * b + 0.1 * ufl.dot(ufl.grad(a), ufl.grad(b))) * ufl.dx
    source = 1000.0 * (1 + ufl.SpatialCoordinate(body.domain)[0])
    exact = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
    young = LinearProblem(form, source * b * ufl.dx, petsc_options=exact).solve()
    energy = body.elastic(young, 0.2) - ufl.dot(force, body.u) * ufl.dx
    problem = body.problem(Coulomb(0.3), energy)

    def load(t):
        force.x.array[:] = t * profile.x.array

    return QuasiStatic(problem, load)


def write_on_two_ranks(where):
    """Write a record on two ranks: these, or two of their own where there is one."""
    if COMM.size > 1:
        killed(where, solved_stiffness(False))
        return
    ours = ("OMPI_COMM", "PMIX_", "PRTE_", "OMPI_MCA_orte", "OMPI_MCA_ess")
    there = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    tests = str(Path(__file__).parents[1])
    code = (
        f"import sys; sys.path.insert(0, {tests!r})\n"
        "from adversarial.test_records import killed, solved_stiffness\n"
        f"killed({str(where)!r}, solved_stiffness(False))"
    )
    ranks = ["mpirun", "--oversubscribe", "-n", "2", sys.executable, "-c", code]
    done = subprocess.run(ranks, env=there, capture_output=True, text=True, timeout=300)
    assert not done.returncode, done.stderr[-2000:]


@pytest.mark.parametrize("mirrored", [True, False])
def test_a_record_of_two_ranks_is_resumed_with_its_data_alone(mirrored, folder):
    write_on_two_ranks(folder / "record")
    if mirrored:
        with pytest.raises(ValueError, match=REFUSED):
            resumed(folder / "record", solved_stiffness(True))
    else:
        found = resumed(folder / "record", solved_stiffness(False))
        assert_same_end(found, solved_stiffness(False).run(TIMES))
