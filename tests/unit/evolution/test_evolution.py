"""Quasi-static evolutions: friction with a memory."""

import itertools
import json
import logging
import math
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import demo_two_blocks
import numpy as np
import pytest
from _triangle import element
from support.blocks import box, facets, same_tables

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    LevelSet,
    NormalCompliance,
    ParametricContact,
    RigidBody,
    Sphere,
    io,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import NoContinuation, QuasiStatic
from dolfinx_contact.evolution.step_branch import rays_of_step
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD
DATA = Path(__file__).parents[2] / "data"
BLOCKS = json.loads((DATA / "two_blocks.json").read_text())
PATHS = json.loads((DATA / "two_blocks_path.json").read_text())


def dragged(
    cell="quad", n=4, *, method=None, degree=1, obstacle=None, energy=None, r=None, law=None
):
    """A block on a floor, friction 0.3, and the Function by which its top moves."""
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    top = fem.Function(V)
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=obstacle(domain) if obstacle else HalfSpace(np.zeros(dim), np.eye(dim)[-1]),
        law=law(domain) if law else Coulomb(0.3),
        method=method,
    )
    density = (energy or LinearElastic.from_young(1000.0, 0.3)).energy(u)
    bcs = [fem.dirichletbc(top, held)]
    return ContactProblem(density * ufl.dx, u, [surface], bcs=bcs, r=r), top


def put(top, motion):
    top.x.array[:] = np.tile(motion, len(top.x.array) // len(motion))


def cycle(top):
    """A load: down in the first unit of time, then to the right and back in two each."""

    def load(t):
        motion = np.zeros(top.function_space.mesh.geometry.dim)
        motion[0] = 0.012 * np.interp(t, [1, 3, 5], [0, 1, -1])
        motion[-1] = -0.01 * min(t, 1.0)
        put(top, motion)

    return load


@pytest.mark.parametrize("case", ["two_n8", pytest.param("rigid_n8", marks=pytest.mark.long)])
@pytest.mark.chatty
@pytest.mark.verifies(
    "quasi-static",
    "Coulomb",
    "energies of histories",
    reference="independent code: both bodies condensed onto their jumps",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_the_path_of_two_blocks(case):
    """Step by step as another code has it, which condenses both bodies onto their jumps."""
    given = BLOCKS[case]
    path = PATHS[case]
    words = ["--n", given["n"], "--friction", given["F"], "--upper", given["E1"], given["nu1"]]
    lower = ["--lower", given["E2"], given["nu2"]]
    words += ["--rigid-floor"] if given["rigid_floor"] else lower
    both, top = demo_two_blocks.problem(demo_two_blocks.arguments([str(w) for w in words]), COMM)
    history = demo_two_blocks.along_the_path(both, top)
    assert history.complete
    assert [s.status for s in history.steps] == [s["status"] for s in path]
    force = max(max(s["rn"]) for s in path)
    for step, wanted in zip(history.steps, path, strict=True):
        table = step.result.tables["contact"]
        found = {"rn": table.rn, "un": table.un}
        found |= {"rt": table.along(table.rt), "ut": table.along(table.ut)}
        for key, scale in {"rn": force, "rt": force, "ut": 0.01, "un": 0.01}.items():
            np.testing.assert_allclose(found[key], wanted[key], rtol=0, atol=1e-9 * scale)
        off = step.energies.dissipated - wanted["dissipation"]
        assert abs(off) < 1e-9 * path[-1]["dissipation"]


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "given"),
    [
        ("tri", {}),
        ("quad", {"method": "mixed"}),
        ("tri", {"degree": 2}),
        ("hex", {"n": 2}),
        ("tet", {"n": 2, "method": "mixed"}),
        ("tet", {"n": 2, "method": "integral"}),
    ],
)
@pytest.mark.verifies(
    "quasi-static",
    "Coulomb",
    reference="itself: the step from where nothing has slid",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_what_has_slid_as_a_whole(cell, given):
    """A body that was moved along the floor is where the law of the step begins."""
    away = np.array([0.3, *([-0.2] if cell in ("tet", "hex") else []), 0.0])
    way = np.array([0.006, *([0.001] if cell in ("tet", "hex") else []), -0.01])
    tables = []
    displacements = []
    for start in (np.zeros_like(away), away):
        problem, top = dragged(cell, **given)
        (surface,) = problem.surfaces
        problem = problem.with_memory([Memory(np.tile(start, (surface.points.number, 1)))])
        put(top, start + way)
        put(problem.u, start)
        result = problem.solve()
        assert result.counts["slip"] > 0
        tables.append(result.tables["contact"])
        put(top, start)
        displacements.append(problem.u.x.array - top.x.array)
    force = np.abs(tables[0].force).max()
    np.testing.assert_allclose(tables[0].force, tables[1].force, rtol=0, atol=1e-9 * force)
    np.testing.assert_allclose(*displacements, rtol=0, atol=1e-10)
    assert tables[0].status == tables[1].status
    np.testing.assert_allclose(tables[1].ut - tables[0].ut, np.tile(away, (len(tables[0].ut), 1)))
    np.testing.assert_allclose(tables[1].increment, tables[0].ut, rtol=0, atol=1e-10)


@pytest.mark.parametrize("algorithm", ["tresca", "gauss-seidel", "lemke", "interior-point"])
@pytest.mark.verifies(
    "quasi-static",
    "Tresca's fixed point",
    "Gauss-Seidel",
    "Lemke",
    "interior point",
    reference="itself: Newton's method",
    aspects=("2D",),
)
def test_other_algorithms(algorithm):
    """A step by them, from the state that Newton's method left."""
    problem, top = dragged()
    QuasiStatic(problem, cycle(top)).run([0.0, 1.0, 3.0])
    cycle(top)(4.0)
    with problem.restored(always=True):
        wanted = problem.solve().tables["contact"]
    found = problem.solve(algorithm=algorithm).tables["contact"]
    assert wanted.count("-") > 0
    same_tables(wanted, found, 1e-6)


@pytest.mark.verifies(
    "quasi-static",
    "branches",
    reference="itself: the step by Newton's method",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_a_branch_within_a_step():
    """Followed from the state before, where all that slips is at a border, it ends as the step."""
    problem, top = dragged()
    history = QuasiStatic(problem, cycle(top)).run([0.0, 1.0, 2.2, 2.4])
    assert history.steps[-1].result.counts["slip"] > 0
    x = problem.create_vector()
    gamma = fem.Constant(problem.V.mesh, 0.0)
    problem.write(x)
    x0, y0 = COMM.bcast(top.x.array[:2].tolist())
    way = ufl.as_vector([x0 + 0.005 * gamma, y0 + 0.0 * gamma])
    system = ParametricContact(problem, gamma, driven=[(top, way)])
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0), max_steps=100)
    assert branch.points[-1].gamma == 1.0
    found = system.result_at(branch.points[-1]).tables["contact"]
    system.set_parameter(1.0)
    same_tables(found, problem.solve().tables["contact"], 1e-8)
    assert found.status != history.steps[-1].status


@pytest.mark.parametrize("method", ["nodal", "mixed"])
def test_rate_of_a_step_while_the_floor_turns(method):
    """The derivative of H by a parameter that turns normals, by differences."""
    angles = []

    def floor(domain):
        angle = fem.Constant(domain, 0.0)
        angles.append(angle)
        return LevelSet(lambda x: x[1] * ufl.cos(angle) + x[0] * ufl.sin(angle))

    problem, top = dragged(method=method, obstacle=floor)
    moved = np.random.default_rng(1).normal(size=(problem.surfaces[0].points.number, 2))
    problem = problem.with_memory([Memory(0.01 * moved)])
    system = ParametricContact(problem, angles[0])
    put(top, (0.01, -0.01))
    problem.solve()
    x, c, low, high = (system.create_vector() for _ in range(4))
    problem.write(x)
    piece = system.piece_at(x, 0.0)
    step = 1e-6
    system.parameter_derivative(x, 0.0, c, piece)
    system.residual(x, -step, low, piece)
    system.residual(x, step, high, piece)
    high.axpy(-1.0, low)
    high.scale(0.5 / step)
    high.axpy(-1.0, c)
    assert 0 < high.norm() < 1e-7 * c.norm()


@pytest.mark.chatty
def test_rejected_steps_leave_nothing():
    """As the run that takes the accepted times at once, bit by bit."""
    runs = []
    known = set()
    times = [0.0, 1.0, 3.0, 5.0]

    def accept(step):
        new = step.time not in known
        known.add(step.time)
        return not (new and step.time - step.start > 0.2)

    for asked in (accept, None):
        problem, top = dragged()
        evolution = QuasiStatic(problem, cycle(top))
        history = evolution.run(times, accept=asked)
        times = [0.0, *(s.time for s in history.steps)]
        memory = evolution.memory[0].jump
        runs.append((history, [*(f.x.array for f in problem.fields), top.x.array, memory]))
    (rejecting, first), (other, second) = runs
    assert {1.0, 3.0, 5.0} <= set(times)
    assert sum(s.rejected for s in rejecting.steps) > 3 > sum(s.rejected for s in other.steps) == 0
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)
    assert [s.energies for s in rejecting.steps] == [s.energies for s in other.steps]


@pytest.mark.ranks(2, 3)
@pytest.mark.chatty
@pytest.mark.verifies(
    "energies of histories", "quasi-static", reference="itself: shorter steps", aspects=("2D",)
)
def test_energy():
    """What is neither stored nor dissipated falls with the steps."""
    residues = []
    for n in (4, 8, 16):
        problem, top = dragged()
        history = QuasiStatic(problem, cycle(top)).run(np.linspace(0.0, 3.0, 3 * n + 1))
        e = history.energies
        assert e.dissipated > 0.01 * e.stored > 0
        residues.append(abs(e.residue) / e.dissipated)
        assert e.stored == pytest.approx(history.steps[-1].result.energies["bulk"])
    assert residues[2] < 0.6 * residues[1] < 0.6 * 0.6 * residues[0] < 0.05


@pytest.mark.chatty
@pytest.mark.parametrize("sliding", [pytest.param("small", marks=pytest.mark.long), "large"])
@pytest.mark.verifies(
    "energies of histories",
    "moving obstacles",
    "spheres",
    reference="closed form: without friction all work is stored",
    aspects=(
        "2D",
        "large sliding",
    ),
)
def test_work_of_a_disc_that_moves(sliding):
    """Along and into the face of a strip: all of its work is stored but what steps leave."""
    residues = []
    for n in (5, 40):
        domain = mesh.create_rectangle(MPI.COMM_SELF, [(0, -0.5), (2, 0)], [12, 3])
        u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
        centre = fem.Constant(domain, (0.7, 0.75))
        disc = Sphere(centre, 0.8)
        top = facets(domain, 1, 0.0)
        surface = ContactSurface(u, top, obstacle=disc, law=Frictionless(), sliding=sliding)
        dofs = fem.locate_dofs_topological(u.function_space, 1, facets(domain, 1, -0.5))
        bcs = [fem.dirichletbc(np.zeros(2), dofs, u.function_space)]
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
        problem = ContactProblem(energy, u, [surface], bcs=bcs)

        def load(t, centre=centre):
            centre.value[:] = 0.7 + 0.5 * t, 0.75 - 0.05 * np.sin(3 * t)

        problem.solve()
        history = QuasiStatic(problem, load).run(np.linspace(0.0, 1.0, n + 1))
        residues.append(abs(history.energies.residue) / history.energies.stored)
    assert residues[1] < 0.005 < 0.1 < residues[0]


@pytest.mark.ranks(2)
def test_a_start_that_is_no_solution(caplog):
    problem, top = dragged(n=2)
    problem.u.x.array[:] = 0.1
    with caplog.at_level(logging.WARNING):
        QuasiStatic(problem, cycle(top)).run([0.5, 1.0])
    if COMM.rank == 0:
        assert "the start of the evolution is not a solution" in caplog.text


@pytest.mark.chatty
def test_several_runs_are_as_one():
    """Each knows how fast the state changed before, and takes data that were changed between."""
    problem, g = klarbring()

    def load(t):
        g.value = t

    evolution = QuasiStatic(problem, load)
    times = [0.0, 0.5, 1.0, 1.5, 2.5, 3.5]
    for ends in itertools.pairwise(times[:-1]):
        evolution.run(ends)
    with pytest.raises(NoContinuation, match="no solution continues"):
        evolution.run(times[-2:], locate_jumps=True)
    friction = []

    def law(domain):
        friction.append(fem.Constant(domain, 0.3))
        return Coulomb(friction[0])

    problem, top = dragged(law=law)
    evolution = QuasiStatic(problem, cycle(top))
    evolution.run([0.0, 1.0, 2.0])
    friction[0].value = 0.1
    last = evolution.run([2.0, 2.5]).steps[-1].result
    assert friction[0].value == 0.1
    (table,) = last.tables.values()
    slips = np.isin(table.letters, ["+", "-"])
    assert slips.any()
    np.testing.assert_allclose(np.abs(table.along(table.rt))[slips], 0.1 * table.rn[slips])


@pytest.mark.parametrize("way", ["adds", "counts"])
def test_a_load_that_depends_on_earlier_calls_is_refused(way):
    """Steps that are tried again would have other data."""
    problem, top = dragged()
    put(top, (0.0, -0.01))
    problem.solve()
    calls = []

    def load(t):
        calls.append(t)
        if way == "adds":
            top.x.array[0::2] += 0.001
        else:
            put(top, (0.001 * len(calls), -0.01))

    evolution = QuasiStatic(problem, load)
    with pytest.raises(
        ValueError, match=r"the load at the time 0 depends on earlier calls: the value of the Diri"
    ):
        evolution.run([0.0, 0.1, 0.2])


@pytest.mark.ranks(2)
def test_a_proof_is_of_the_step_that_was_taken():
    """A state knows the memory of its step; under the data of another one it is not a solution."""
    problem, top = dragged()
    load = cycle(top)
    states = [problem.snapshot()]
    for time in (1.0, 2.0):
        load(time)
        step = problem.step_from(states[-1])
        step.solve()
        states.append(step.snapshot())
    assert problem.uniqueness(state=states[2]).verdict == "proved"
    assert step.uniqueness().verdict == "proved"
    for ask in (problem.uniqueness, lambda: problem.uniqueness(state=states[1])):
        with pytest.raises(
            ValueError, match="not a solution of the problem as it is now: residual"
        ):
            ask()


@pytest.mark.verifies(
    "rigid bodies",
    "quasi-static",
    reference="itself: the block that moves over a floor at rest",
    aspects=("2D",),
)
def test_a_floor_that_moves():
    """The floor under a held block, as the block over a floor at rest: work and forces too."""
    histories = []
    for moving in (False, True):
        motion = []

        def floor(domain, motion=motion):
            motion += [fem.Constant(domain, 0.0), fem.Constant(domain, 0.0)]
            given = {"x": motion[0], "y": motion[1]}
            return RigidBody(HalfSpace((0, 0), (0, 1)), about=(0, 0), motion=given, held=["rz"])

        problem, top = dragged(obstacle=floor)
        load = cycle(top)

        def moved(t, top=top, load=load, motion=motion, moving=moving):
            load(t)
            if moving:
                for c, v in zip(motion, COMM.bcast(top.x.array[:2].tolist()), strict=True):
                    c.value = -v
                put(top, (0.0, 0.0))

        histories.append(QuasiStatic(problem, moved).run([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]))
    for a, b in zip(histories[0].steps, histories[1].steps, strict=True):
        (one,) = a.result.tables.values()
        (other,) = b.result.tables.values()
        same_tables(one, other)
        assert a.status == b.status
        for name in ("external", "stored", "dissipated"):
            found = getattr(b.energies, name)
            assert found == pytest.approx(getattr(a.energies, name), rel=1e-8, abs=1e-12)
    assert histories[0].energies.dissipated > 0


@pytest.mark.chatty
@pytest.mark.parametrize("cell", ["quad", pytest.param("hex", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "quasi-static",
    "Coulomb",
    reference="itself: factorised",
    aspects=(
        "2D",
        "3D",
        "multigrid",
    ),
)
def test_multigrid(cell):
    """The same steps as by factorising."""
    options = PETSc.Options()
    histories = []
    for solver in ("direct", "amg"):
        options["contact_linear_solver"] = solver
        options["contact_snes_rtol"] = 1e-11
        problem, top = dragged(cell, 8 if cell == "quad" else 4)
        assert problem.linear_solver.name == solver
        histories.append(QuasiStatic(problem, cycle(top)).run([0.0, 1.0, 3.0, 4.0, 5.0]))
    for a, b in zip(histories[0].steps, histories[1].steps, strict=True):
        same_tables(*(s.result.tables["contact"] for s in (a, b)), 1e-8)
        assert a.status == b.status
    assert histories[0].steps[-1].result.counts["slip"] > 0


def klarbring():
    """The node with kt = kn = 2, k = 1 and friction 3, under (-g, -1); its Constant g."""
    system = element((1.0, 1.0), 3.0, 1.0, (-2.0, 0.0), (0.0, -2.0))
    return system.problem, system.constant


@pytest.mark.ranks(2)
@pytest.mark.parametrize("at_jump", ["raise", pytest.param("stop", marks=pytest.mark.long), "jump"])
@pytest.mark.verifies(
    "jumps",
    "quasi-static",
    reference="closed form: Klarbring's node, without equilibrium beyond g = 3",
    aspects=("2D",),
)
def test_where_nothing_continues(folder, at_jump):
    """Klarbring: stick until g = 3, where the next solution is open, at (-5/3, 1/3)."""
    problem, g = klarbring()

    def load(t):
        g.value = t

    evolution = QuasiStatic(problem, load)
    folder = folder / str(COMM.rank)  # the node of each rank
    times = [0.0, 0.5, 1.0, 1.5, 2.5, 3.5, 4.0]
    if at_jump == "raise":
        told = pytest.raises(NoContinuation, match=r"no solution continues .* from 3 to .* k to o")
        with told as e, io.EvolutionSeries(folder, problem, format="vtk") as series:
            evolution.run(times, locate_jumps=True, observer=series)
        rows = (folder / "steps.csv").read_text().splitlines()
        assert len(rows) == 1 + len(e.value.history.steps)
        assert len(list(folder.glob("evolution_contact0*.pvtu"))) == len(rows) - 1
        history = e.value.history
    else:
        history = evolution.run(times, locate_jumps=True, at_jump=at_jump)
    held = [s for s in history.steps if not s.jump and s.time <= 3]
    assert held[-1].time == pytest.approx(3.0, abs=1e-5)
    assert all(s.result.counts["stick"] == 1 for s in held)
    if at_jump != "jump":
        assert not history.complete
        assert "no solution continues" in history.reason
        assert g.value == held[-1].time == history.time
        (table,) = history.steps[-1].result.tables.values()
        (at,) = np.flatnonzero(table.letters != "d")
        np.testing.assert_allclose(table.force[at], (history.time, 1.0), rtol=1e-9)
        return
    (jump,) = (s for s in history.steps if s.jump)
    assert history.complete
    assert history.time == 4.0
    (table,) = jump.result.tables.values()
    (at,) = np.flatnonzero(table.letters == "o")
    found = (table.along(table.ut)[at], table.un[at])
    np.testing.assert_allclose(found, (-5 / 3, 1 / 3), atol=1e-4)
    # The energy that is left over would be that of a motion.
    assert jump.energies.residue > 0.1


@pytest.mark.chatty
def test_a_jump_after_other_data():
    """Data that were changed between two runs leave a solution: the next step is looked at."""
    problem, g = klarbring()

    def load(t):
        g.value = t

    load(0.0)
    problem.solve()
    evolution = QuasiStatic(problem, load)
    evolution.run([0.0, 0.5])
    g.value = 0.6  # which the load overwrites
    history = evolution.run([0.5, 4.0], shortest=1e-3, locate_jumps=True, at_jump="jump")
    assert [s.jump for s in history.steps].count(True) == 1


@pytest.mark.chatty
@pytest.mark.parametrize(
    "times", [pytest.param((0.0, 4.0), marks=pytest.mark.long), (0.0, 0.5, 4.0)]
)
def test_a_jump_in_a_long_step(times):
    """It is seen in the first step, and where the state then changes little faster than the load.

    Solvers take the second half of a step to states that do not follow from those of the first.
    """
    problem, g = klarbring()

    def load(t):
        g.value = t

    load(0.0)
    problem.solve()
    history = QuasiStatic(problem, load).run(
        times, shortest=1e-3, locate_jumps=True, at_jump="jump"
    )
    (jump,) = (s for s in history.steps if s.jump)
    assert jump.start <= 3.0 <= jump.time < jump.start + 2e-3
    assert all(s.result.counts["stick"] == 1 for s in history.steps if s.time < 3)


def test_sudden_but_no_jump():
    """What comes fast but with the load is no jump, and takes no other steps."""
    problem, top = dragged()
    problem.surfaces[0].law.friction.value = 0.02  # little holds, and then nothing
    sticky = QuasiStatic(problem, cycle(top)).run(
        [0.0, 1.0, 1.001, 1.5, 3.0], locate_jumps=True, sudden=1.0
    )
    assert [s.time for s in sticky.steps] == [1.0, 1.001, 1.5, 3.0]


def pulled():
    """A block that forces press on a floor and pull along it; the force that pulls."""
    domain = box(COMM, 2, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    pull = fem.Constant(domain, 0.0)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    above = np.sort(facets(domain, 1, 1.0))
    top = mesh.meshtags(domain, 1, above, np.full(len(above), 1, dtype=np.int32))
    load = ufl.dot(ufl.as_vector([pull, -10.0]), u) * ufl.ds(subdomain_data=top)(1)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx - load
    return ContactProblem(energy, u, [surface]), pull


@pytest.mark.chatty
def test_where_no_step_is_solved():
    """A block that forces pull: at the bound of friction it goes away, which is said in time."""
    problem, pull = pulled()

    def loaded(t):
        pull.value = 10 * t

    with pytest.raises(NoContinuation, match=r"no solution was found beyond the time 0.2[57]"):
        QuasiStatic(problem, loaded).run([0.0, 0.275, 0.325], shortest=0.05)
    (table,) = problem.solve().tables.values()
    assert abs(table.rt.sum()) == pytest.approx(pull.value)


@pytest.mark.chatty
@pytest.mark.parametrize("at_jump", ["jump", "raise"])
def test_a_step_that_is_not_solved_proves_no_jump(at_jump):
    """The load changes faster, and at one time in between nothing holds: it goes on around that."""
    problem, pull = pulled()

    def loaded(t):
        pull.value = 100.0 if t == 0.375 else 0.5 * t + 4 * max(t - 0.25, 0.0)

    loaded(0.0)
    problem.solve()
    history = QuasiStatic(problem, loaded).run([0.0, 0.25, 0.5], locate_jumps=True, at_jump=at_jump)
    assert history.complete
    assert not any(s.jump for s in history.steps)
    (table,) = history.steps[-1].result.tables.values()
    assert abs(table.rt.sum()) == pytest.approx(1.25)


@pytest.mark.verifies(
    "quasi-static", "hyperelastic bodies", "units", reference="itself: other units", aspects=("2D",)
)
def test_large_deformation():
    """A neo-Hookean block: the same loop in either units, energies in balance."""
    rows = []
    for unit in (1.0, 1e-9):  # of stress
        rubber = NeoHookean(*(unit * c for c in lame(1000.0, 0.3)))
        problem, top = dragged(n=3, energy=rubber)
        history = QuasiStatic(problem, cycle(top)).run(np.linspace(0.0, 5.0, 21))
        e = history.energies
        assert abs(e.residue) < 0.05 * e.dissipated
        rows.append(([s.status for s in history.steps], e.dissipated / unit))
    assert rows[0][0] == rows[1][0]
    assert rows[1][1] == pytest.approx(rows[0][1], rel=1e-6)


@pytest.mark.ranks(2)
def test_bad_input():
    problem, top = dragged(n=2)
    evolution = QuasiStatic(problem, cycle(top))
    for times in ([0.0], [0.0, math.nan], [0.0, 1.0, 1.0], [0.0, 1.0, 0.5], ["a", "b"], None):
        with pytest.raises(ValueError, match=r"times|convert"):
            evolution.run(times)
    ranks = COMM.rank if COMM.size > 1 else math.nan
    for given in (
        {"sudden": 1.0 + ranks},
        {"accept": 3},
        {"observer": "x"},
        {"accept": lambda _: None},
        {"shortest": 0.0},
        {"shortest": math.nan},
        {"longest": 0.0},
        {"longest": math.nan},
        {"longest": "a"},
        {"shortest": "a"},
        {"at_jump": "ignore"},
        {"at_jump": "jump"},
        {"sudden": 0.5},
        {"rays": "all"},
        {"rays": False, "follow_rays": True},
        {"sudden": math.nan},
    ):
        with pytest.raises(ValueError, match="|".join(given)):
            evolution.run([0.0, 1.0], **given)
    for every in (0, 1.5, True, "2", *([1 + COMM.rank] if COMM.size > 1 else [])):
        with pytest.raises(ValueError, match="every"):
            io.EvolutionSeries("unwritten", problem, every=every)
    with pytest.raises(ValueError, match="a ContactProblem is needed"):
        QuasiStatic(None, cycle(top))
    with pytest.raises(ValueError, match="a function of the time"):
        QuasiStatic(problem, 1.0)
    domain = box(COMM, 2, "quad")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    springs = NormalCompliance(1.0, friction=Coulomb(0.3), tangential=1.0)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=springs)
    energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    with pytest.raises(ValueError, match="lacks a memory of how its tangential springs"):
        QuasiStatic(ContactProblem(energy, u, [surface]), cycle(top))
    history = evolution.run([0.0, 1.0])
    with pytest.raises(ValueError, match=r"the evolution is at the time 1\.0"):
        evolution.run([0.0, 2.0])
    assert evolution.run([1.0, 1.5]).complete
    assert history.at(1.0).number == 1
    other, _ = dragged(n=3)
    with pytest.raises(ValueError, match="another law, sliding or mesh"):
        other.with_memory(evolution.memory)
    with pytest.raises(ValueError, match="another law, sliding or mesh"):
        other.with_memory([])
    with pytest.raises(ValueError, match="expected statuses"):
        other.solve(expected=[problem.statuses])


def test_lengths_of_steps():
    """Given times are hit exactly; longer intervals are divided equally; rejected steps halved."""
    problem, top = dragged(n=2)
    evolution = QuasiStatic(problem, cycle(top))
    history = evolution.run([0.0, 0.1, 0.1 + 0.2])
    assert [s.time for s in history.steps] == [0.1, 0.1 + 0.2]
    # 0.3 is the end of the last run up to round-off
    history = evolution.run([0.3, 1.3, 1.5], longest=0.4)
    np.testing.assert_allclose(
        [s.time for s in history.steps], [0.3 + 1 / 3, 0.3 + 2 / 3, 1.3, 1.5]
    )
    assert not any(s.inserted for s in history.steps)
    history = evolution.run([1.5, 2.5], accept=lambda s: s.start > 1.5 or s.time < 1.7)
    np.testing.assert_allclose([s.time for s in history.steps], [1.625, 1.84375, 2.171875, 2.5])
    assert [s.inserted for s in history.steps] == [True, True, True, False]
    assert [s.rejected for s in history.steps] == [3, 0, 0, 0]


@pytest.mark.ranks(2, 3)
def test_a_load_that_fails_on_one_rank():
    """Its error is raised on all, and the evolution is where it was."""
    problem, top = dragged(n=2)
    load = cycle(top)

    def failing(t):
        load(t)
        if t > 1 and COMM.rank == COMM.size - 1:
            raise RuntimeError("no load")

    evolution = QuasiStatic(problem, failing)
    evolution.run([0.0, 1.0])
    before = [f.x.array.copy() for f in (*problem.fields, top)]
    memory = evolution.memory
    with pytest.raises(RuntimeError, match="no load"):
        evolution.run([1.0, 2.0])
    for values, f in zip(before, (*problem.fields, top), strict=True):
        np.testing.assert_array_equal(values, f.x.array)
    assert evolution.memory == memory


@pytest.mark.parametrize("follow_rays", [False, True])
@pytest.mark.verifies(
    "rays out of a kink",
    "quasi-static",
    reference="closed form: Klarbring's node, two rates",
    aspects=("2D",),
)
def test_several_solutions_of_the_rate_problem(follow_rays):
    """Klarbring's node is drawn to the border of slip, at g = 3, and relieved.

    There stick has rates rn' = 0, rt' = g' inside |rt| <= 3 rn for g' < 0. And a slip to the left
    has rn' = ut' and rt' = 2 ut' + g' = 3 rn', so that ut' = g' < 0: a second solution, which lets
    go at g = 2. For g' > 0 neither holds, nor does any other: Klarbring's non-existence.
    """
    problem, g = klarbring()
    g.value = 0.0
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: setattr(g, "value", min(t, 6 - t)))
    given = dict(rays=True, follow_rays=follow_rays)
    history = evolution.run([0.0, 1.0, 2.0, 3.0, 3.5, 3.9], **given)
    assert history.complete
    assert [s.directions for s in history.steps] == [None, 1, 1, 2, 1]
    assert [r["directions"] for r in history.rows()] == [s.directions for s in history.steps]
    assert all(s.result.counts["stick"] == 1 for s in history.steps)
    # What slips may also stick, later: all evolutions that part.
    assert [o.start for o in history.others] == [3.0, 3.5] * follow_rays
    for other, letters in zip(history.others, ("--", "k"), strict=False):
        assert (other.complete, other.time) == (True, 3.9)
        for step, letter in zip(other.steps, letters, strict=True):
            (table,) = step.result.tables.values()
            (at,) = np.flatnonzero(table.letters == letter)
            slip = 3.0 - (step.time if letter == "-" else 3.5)
            load = 6.0 - step.time
            np.testing.assert_allclose(table.along(table.ut)[at], slip, rtol=1e-8)
            np.testing.assert_allclose(table.rn[at], 1 + slip, rtol=1e-8)
            np.testing.assert_allclose(table.along(table.rt)[at], load + 2 * slip, rtol=1e-8)
    # The problem stands where the evolution that was asked for does.
    assert g.value == pytest.approx(2.1)
    assert all(s.result.counts["stick"] == 1 for s in history.steps)
    assert (problem.statuses[0] == 1).sum() == 1


@pytest.mark.verifies(
    "rays out of a kink",
    "jumps",
    reference="closed form: Klarbring's node, no rate",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_no_solution_of_the_rate_problem():
    """At g = 3 and rising no direction leads out, which is proved by all of them."""
    problem, g = klarbring()
    evolution = QuasiStatic(problem, lambda t: setattr(g, "value", t))
    last = evolution.run([0.0, 1.5, 3.0]).steps[-1]
    assert last.result.counts["stick"] == 1
    g.value = 3.1
    rays = rays_of_step(problem)
    assert (rays.rays, rays.complete) == ((), True)
    g.value = 2.9
    assert len(rays_of_step(problem).rays) == 2
