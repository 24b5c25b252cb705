"""Quasi-static evolutions: friction with a memory."""

import json
import logging
from pathlib import Path

from mpi4py import MPI

import cases.two_blocks
import numpy as np
import pytest
from support.blocks import box, facets, same_tables
from support.histories import cycle, dragged, klarbring, put, rollers
from support.pairs import displacement

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    ParametricContact,
    RigidBody,
    io,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import NoContinuation, QuasiStatic
from dolfinx_contact.evolution.rate_problem import rays_of_step
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame

COMM = MPI.COMM_WORLD

DATA = Path(__file__).parents[2] / "data"
BLOCKS = json.loads((DATA / "two_blocks.json").read_text())
PATHS = json.loads((DATA / "two_blocks_path.json").read_text())


@pytest.mark.parametrize("case", ["two_n8", pytest.param("rigid_n8", marks=pytest.mark.long)])
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
def test_two_blocks_follow_the_path_of_another_code(case):
    """Every step agrees with another code, condensing both bodies onto their jumps."""
    given = BLOCKS[case]
    path = PATHS[case]
    words = ["--n", given["n"], "--friction", given["F"], "--upper", given["E1"], given["nu1"]]
    lower = ["--lower", given["E2"], given["nu2"]]
    words += ["--rigid-floor"] if given["rigid_floor"] else lower
    both, top = cases.two_blocks.problem(cases.two_blocks.arguments([str(w) for w in words]), COMM)
    history = cases.two_blocks.along_the_path(both, top)
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
def test_other_algorithms_agree_in_a_step(algorithm):
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
def test_branch_within_a_step_starts_at_the_border():
    """Starting at the previous state, with slipping points at a border, it ends as the step."""
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


def test_tried_steps_leave_nothing():
    """Searching steps for jumps leaves the run unchanged, bit by bit."""
    runs = []
    for searches in (True, False):
        problem, top = dragged()
        problem.surfaces[0].law.friction.value = 0.02  # little holds, and then nothing
        evolution = QuasiStatic(problem, cycle(top))
        history = evolution.run([0.0, 1.0, 1.001, 1.5, 3.0], locate_jumps=searches)
        memory = evolution.memory[0].jump
        runs.append((history, [*(f.x.array for f in problem.fields), top.x.array, memory]))
    (one, first), (other, second) = runs
    assert [s.time for s in one.steps] == [s.time for s in other.steps]
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)
    assert [s.energies for s in one.steps] == [s.energies for s in other.steps]


@pytest.mark.ranks(2, 3)
@pytest.mark.chatty
@pytest.mark.verifies(
    "energies of histories", "quasi-static", reference="itself: shorter steps", aspects=("2D",)
)
def test_the_energy_residue_of_a_history_falls_with_the_steps():
    residues = []
    for n in (4, 8, 16):
        problem, top = dragged()
        history = QuasiStatic(problem, cycle(top)).run(np.linspace(0.0, 3.0, 3 * n + 1))
        e = history.energies
        assert e.dissipated > 0.01 * e.stored > 0
        residues.append(abs(e.residue) / e.dissipated)
        assert e.stored == pytest.approx(history.steps[-1].result.energies["bulk"])
    assert residues[2] < 0.6 * residues[1] < 0.6 * 0.6 * residues[0] < 0.05


@pytest.mark.ranks(2)
def test_history_warns_of_a_start_without_equilibrium(caplog):
    problem, top = dragged(n=2)
    problem.u.x.array[:] = 0.1
    with caplog.at_level(logging.WARNING):
        QuasiStatic(problem, cycle(top)).run([0.5, 1.0])
    if COMM.rank == 0:
        assert "the start of the evolution is not a solution" in caplog.text


@pytest.mark.verifies(
    "rigid bodies",
    "quasi-static",
    reference="itself: the block that moves over a floor at rest",
    aspects=("2D",),
)
def test_moving_the_floor_is_moving_the_block_over_it():
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


@pytest.mark.ranks(2)
@pytest.mark.parametrize("at_jump", ["raise", pytest.param("stop", marks=pytest.mark.long), "jump"])
@pytest.mark.verifies(
    "jumps",
    "quasi-static",
    reference="closed form: Klarbring's node, without equilibrium beyond g = 3",
    aspects=("2D",),
)
def test_klarbrings_node_jumps_open_at_its_end(folder, at_jump):
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
        assert len(rows) == 2 + len(e.value.history.steps)
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


@pytest.mark.verifies(
    "quasi-static", "hyperelastic bodies", "units", reference="itself: other units", aspects=("2D",)
)
def test_a_neo_hookean_history_balances_energy():
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


def test_given_times_are_hit_exactly():
    """Given times are hit exactly; longer intervals are divided equally."""
    problem, top = dragged(n=2)
    evolution = QuasiStatic(problem, cycle(top))
    history = evolution.run([0.0, 0.1, 0.1 + 0.2])
    assert [s.time for s in history.steps] == [0.1, 0.1 + 0.2]
    assert str(history) == "2 steps from time 0 to 0.3: the last time is reached"
    # 0.3 is the end of the last run up to round-off
    history = evolution.run([0.3, 1.3, 1.5], longest=0.4)
    np.testing.assert_allclose(
        [s.time for s in history.steps], [0.3 + 1 / 3, 0.3 + 2 / 3, 1.3, 1.5]
    )
    assert not any(s.inserted for s in history.steps)


@pytest.mark.verifies(
    "rays out of a kink",
    "quasi-static",
    reference="closed form: Klarbring's node, two rates",
    aspects=("2D",),
)
def test_rate_problem_has_several_solutions():
    """Klarbring's node is drawn to the border of slip, at g = 3, and relieved.

    There stick has rates rn' = 0, rt' = g' inside |rt| <= 3 rn for g' < 0. And a slip to the left
    has rn' = ut' and rt' = 2 ut' + g' = 3 rn', so that ut' = g' < 0: a second solution, which lets
    go at g = 2. For g' > 0 neither holds, nor does any other: Klarbring's non-existence.
    """
    problem, g = klarbring()
    g.value = 0.0
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: setattr(g, "value", min(t, 6 - t)))
    history = evolution.run([0.0, 1.0, 2.0, 3.0, 3.5, 3.9], rays=True)
    assert history.complete
    assert [s.directions for s in history.steps] == [None, 1, 1, 2, 1]
    assert [r["directions"] for r in history.rows()[1:]] == [s.directions for s in history.steps]
    assert all(s.result.counts["stick"] == 1 for s in history.steps)
    # The problem stands where the evolution that was asked for does.
    assert g.value == pytest.approx(2.1)
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
def test_rate_problem_without_solution_is_proved():
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


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "energies of histories",
    reference="closed form: prescribed displacements, work over the curve of the force",
    aspects=("2D",),
)
def test_the_table_of_steps_has_the_curve_of_force_over_displacement():
    problem, top = dragged()
    history = QuasiStatic(problem, cycle(top)).run(np.linspace(0.0, 5.0, 21))
    rows = history.rows()
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    time = columns["time"]
    x, y = columns["support_0_ux"], columns["support_0_uy"]
    np.testing.assert_allclose(x, 0.012 * np.interp(time, [1, 3, 5], [0, 1, -1]), atol=1e-15)
    np.testing.assert_allclose(y, -0.01 * np.minimum(time, 1.0), atol=1e-15)
    size = np.abs(columns["contact_y"]).max()
    work = np.zeros(len(time) - 1)
    for axis, way in (("x", x), ("y", y)):
        force = columns[f"support_0_{axis}"]
        np.testing.assert_allclose(force, -columns[f"contact_{axis}"], atol=1e-9 * size)
        work += (force[1:] + force[:-1]) / 2 * np.diff(way)
    external = columns["external"]
    assert external[-1] > columns["dissipated"][-1] > 0
    np.testing.assert_allclose(np.cumsum(work), external[1:], rtol=1e-9)
    np.testing.assert_allclose(history.steps[-1].result.support_displacements, [(x[-1], y[-1])])


@pytest.mark.ranks(2)
def test_the_table_of_steps_has_components_of_supports_and_rigid_bodies():
    """Normal displacements of two sides are held, and a rigid plane comes down on the top."""
    domain = box(COMM, 2, "quad")
    u = displacement(domain)
    way = fem.Constant(domain, 0.0)
    plate = RigidBody(
        HalfSpace((0, 1), (0, -1)),
        about=(0.5, 1),
        motion={"y": way},
        held=["x", "rz"],
        name="plate",
    )
    top = ContactSurface(u, facets(domain, 1, 1.0), obstacle=plate, law=Frictionless())
    energy = LinearElastic.from_young(1000.0, 0.0).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [top], bcs=rollers(u, (0, 0.0), (1, 0.0)))
    evolution = QuasiStatic(problem, lambda time: setattr(way, "value", -0.01 * time))
    start, half, end = evolution.run([0.0, 1.0, 2.0]).rows()
    supports = ["support_0_x", "support_1_y", "support_0_ux", "support_1_uy"]
    assert [name for name in end if name.startswith("support_")] == supports
    assert list(start) == list(half) == list(end)
    for row, part in ((start, 0), (half, 1), (end, 2)):
        assert row["plate_uy"] == pytest.approx(-0.01 * part)
        assert row["support_1_y"] == pytest.approx(10.0 * part)
        assert row["plate_ux"] == row["plate_rz"] == row["support_1_uy"] == 0.0


@pytest.mark.ranks(2)
def test_a_load_that_changes_nothing_gives_a_warning(caplog):
    """One warning per run, unless the load changes between equal ends or the start is unsolved."""

    def warned(load, *, solved=True):
        problem, top = dragged(n=2)
        put(top, (0.0, -0.01))
        if solved:
            problem.solve()
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            QuasiStatic(problem, lambda t: load(t, top)).run([0.0, 0.25, 0.5, 1.0])
        texts = [r.getMessage() for r in caplog.records]
        return COMM.allreduce(sum("load= must be a function" in text for text in texts))

    assert warned(lambda t, top: None) == 1
    assert warned(lambda t, top: put(top, (0.01 * np.sin(2 * np.pi * t), -0.01))) == 0
    assert warned(lambda t, top: None, solved=False) == 0
