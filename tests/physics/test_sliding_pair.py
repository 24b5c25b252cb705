"""Large sliding between the faces of two bodies."""

from mpi4py import MPI

import cases.ironing
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.blocks import CELLS
from support.checks import solved_start
from support.mortars import hats, solids, stacked
from support.pairs import displacement, tagged
from support.sliding_bodies import (
    TIMES,
    Bodies,
    flat_disc,
    hairpin,
    of_upper,
    sliding_history,
    smooth,
)

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    Frictionless,
    ParametricContact,
    SelfContact,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD


def cubes(n, m, cell, *, offset=0.0):
    """Two cubes on each other, with n and m cells along an edge; tags as `stacked`."""
    return solids(n, m, (0.0, 1.0), (offset, 1.0 + offset), cell, turn=np.eye(3))


def blocks(dim, cell, n=5, m=7):
    if dim == 2:
        return stacked(n, m, (0.0, 1.0), (-0.2, 1.2), cell)
    return cubes(3, 4, cell, offset=0.1)


# -- patches ---------------------------------------------------------------------------------------

STRAIN = 0.1
STIFF = 500.0  # mu of a material with nu = 0


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("cell", ["tri", "quad"])
@pytest.mark.parametrize("slave", [2, 3])
@pytest.mark.parametrize("part", [0.37, 0.61])
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: uniform compression",
    aspects=("2D", "pairs", "large sliding"),
)
def test_a_block_that_has_slid_presses_uniformly(cell, slave, part):
    """A block presses uniformly after sliding by part of a facet, and on a partly covered slave."""
    low, high = (0.0, 2.0), (0.2, 1.2)
    n = 8
    shift = part * 2.0 / n
    both = stacked(n, 5, low, high, cell)
    bodies = Bodies(both, slave, Frictionless(), NeoHookean(0.0, STIFF))
    u, V = bodies.u, bodies.u.function_space
    stretch = 1 - STRAIN
    pressure = STIFF * (1 / stretch - stretch)
    x = V.tabulate_dof_coordinates()[:, :2]
    face = fem.locate_dofs_topological(V, 1, both.facet_tags.find(2))
    points = np.linspace(*low, n + 1)
    free = hats(points, low[0], high[0] + shift) + hats(points, high[1] + shift, low[1])
    share = (free / hats(points, *low))[np.searchsorted(points, x[face, 0] - 1e-9)]
    load = fem.Function(V)
    load.x.array.reshape(-1, 2)[face, 1] = -pressure * share
    at_vertices = {"quadrature_rule": "vertex", "quadrature_degree": 1}
    ds = ufl.Measure("ds", both.mesh, subdomain_data=both.facet_tags)(2, metadata=at_vertices)
    part_of_load = fem.Constant(both.mesh, 0.0)
    energy = NeoHookean(0.0, STIFF).energy(u) * ufl.dx - part_of_load * ufl.dot(load, u) * ds
    options = {"snes_rtol": 1e-11}
    problem = ContactProblem(
        energy, u, bodies.problem.contacts, bcs=bodies.problem.bcs, petsc_options=options
    )
    bodies.move(lambda X: np.tile([shift, 0.0], (len(X), 1)))
    problem.solve()
    part_of_load.value = 1.0
    bodies.move(lambda X: np.tile([shift, -2 * STRAIN], (len(X), 1)))
    result = problem.solve()
    off = u.x.array.reshape(-1, 2)[:, 1] + STRAIN * (x[:, 1] + 1)
    assert COMM.allreduce(np.abs(off).max(), max) < 1e-10
    table = result.tables["contact"]
    touching = ~np.isnan(table.un)
    # A node of which hardly anything is covered knows its pressure to fewer digits.
    force = table.area * (table.pressure - pressure)
    assert np.abs(force[touching]).max() < 1e-9 * pressure
    balance = result.pairs["contact"]
    assert balance.imbalance < 1e-14
    assert balance.moment < 1e-12


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize("cell", ["tet", "hex"])
@pytest.mark.parametrize("slave", [2, 3])
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: uniform compression",
    aspects=("3D", "pairs", "large sliding"),
)
def test_a_cube_that_has_turned_presses_uniformly(cell, slave):
    """After turning by a right angle on another cube, a cube presses uniformly."""
    both = cubes(3, 4, cell)
    bodies = Bodies(both, slave, Frictionless(), NeoHookean(0.0, STIFF))
    V = bodies.u.function_space
    turn = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    middle = np.array([0.5, 0.5, 0.0])

    def turned(X):
        return (X - middle) @ turn.T + middle - X

    upper = of_upper(both, V)
    X = V.tabulate_dof_coordinates()
    bodies.u.x.array.reshape(-1, 3)[upper] = turned(X[upper])
    bodies.u.x.scatter_forward()
    bodies.move(lambda X: turned(X) - np.array([0.0, 0.0, 2 * STRAIN]))
    result = bodies.problem.solve()
    stretch = 1 - STRAIN
    pressure = STIFF * (1 / stretch - stretch)
    table = result.tables["contact"]
    np.testing.assert_allclose(table.pressure, pressure, rtol=1e-8)
    assert result.pairs["contact"].imbalance < 1e-14
    x = X + bodies.u.x.array.reshape(-1, 3)
    squeezed = -STRAIN * (X[:, 2] + 1)
    assert COMM.allreduce(np.abs(x[:, 2] - X[:, 2] - squeezed).max(), max) < 1e-10
    assert pair_searches(bodies) >= 2


def pair_searches(bodies):
    return bodies.pair.points.faces.searches


# -- rotations, small slides -----------------------------------------------------------------------


def pressed_and_sheared(bodies, shear=0.03):
    """A history pressing the blocks on each other and shearing them without slip."""
    axis = bodies.dim - 1

    def load(t):
        def motion(X):
            moved = np.zeros_like(X)
            moved[:, axis] = -0.05 * min(t, 1.0)
            moved[:, 0] = shear * max(t - 1.0, 0.0)
            return moved

        bodies.move(motion)

    evolution = QuasiStatic(bodies.problem, load)
    evolution.run([0.0, 0.5, 1.0, 1.5, 2.0], rays=False)
    return evolution


@pytest.mark.parametrize(
    ("dim", "cell", "slave"),
    [
        *((2, "tri", 3), (2, "quad", 2)),
        pytest.param(3, "tet", 2, marks=pytest.mark.long),
        pytest.param(3, "hex", 3, marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize("angle", [0.3])
@pytest.mark.verifies(
    "sliding pairs",
    reference="theorem: a rotation changes nothing",
    aspects=("2D", "3D", "pairs", "large sliding"),
)
def test_a_stuck_pair_that_turns_keeps_sticking(dim, cell, slave, angle):
    """A stuck state turned in one step stays stuck, with its tractions turned."""
    bodies = Bodies(blocks(dim, cell), slave, Coulomb(2.0))
    bodies.problem.petsc_options["snes_rtol"] = 1e-11
    evolution = pressed_and_sheared(bodies)
    u = bodies.u
    before = u.x.array.reshape(-1, dim).copy()
    step = bodies.problem.with_memory(evolution.memory)
    table = step.table(bodies.pair)
    assert (table.letters == "k").sum() > 0.5 * len(table.letters)
    tractions = bodies.pair.multiplier.x.array.reshape(-1, dim).copy()
    problem = bodies.problem.with_memory(step.equations.memory_after(step.evaluate()))
    axis = [0.2, 0.9, 0.4] if dim == 3 else [0.0, 0.0, 1.0]
    Q = Rotation.from_rotvec(angle * np.array(axis) / np.linalg.norm(axis)).as_matrix()[:dim, :dim]
    X = u.function_space.tabulate_dof_coordinates()[:, :dim]
    turned = (X + before) @ Q.T - X
    for f in (bodies.below, bodies.above):
        f.x.array[:] = turned.reshape(-1)
    u.x.array[:] = turned.reshape(-1)
    bodies.pair.multiplier.x.array[:] = (tractions @ Q.T).reshape(-1)
    state = problem.evaluate()
    start = max(np.abs(rows).max(initial=0.0) for rows in state.rows)
    assert COMM.allreduce(start, max) < 1e-9 * 1000.0
    # From another start.
    u.x.array[:] = (turned + 1e-3 * smooth(X, 2, 1.0)).reshape(-1)
    problem.solve(expected=[state.statuses])
    size = COMM.allreduce(np.abs(tractions).max(initial=0.0), max)
    off = bodies.pair.multiplier.x.array.reshape(-1, dim) - tractions @ Q.T
    assert COMM.allreduce(np.abs(off).max(initial=0.0), max) < 1e-9 * size


@pytest.mark.parametrize(
    ("dim", "cell"), [(2, "quad"), (2, "tri"), pytest.param(3, "hex", marks=pytest.mark.long)]
)
@pytest.mark.verifies(
    "sliding pairs",
    reference="itself: the pair of small sliding",
    aspects=("2D", "3D", "pairs", "large sliding"),
)
def test_small_slide_is_the_limit_of_large_sliding(dim, cell):
    """Linear bodies whose nodes match: mixed contact of small sliding is the limit."""
    both = stacked(6, 6, (0.0, 1.0), (0.0, 1.0), cell) if dim == 2 else cubes(3, 3, cell)
    differences = []
    for size in (1e-4, 1e-5):
        found = []
        for given in ({"sliding": "large"}, {"sliding": "small", "method": "mixed"}):
            bodies = Bodies(both, 3, Coulomb(0.05), LinearElastic(*lame(1000.0, 0.3)), **given)

            def motion(X, size=size):
                moved = np.zeros_like(X)
                moved[:, -1] = -size
                moved[:, 0] = size * (X[:, 0] - 0.3)
                return moved

            bodies.move(motion)
            table = bodies.problem.solve().tables["contact"]
            assert set(table.letters) & {"+", "-", "s"}
            found.append(bodies.u.x.array.copy())
        differences.append(COMM.allreduce(np.abs(found[0] - found[1]).max(initial=0.0), max) / size)
    # The difference in u is of second order.
    assert differences[0] < 1e-3
    assert differences[1] < 0.11 * differences[0] + 1e-12


# -- histories, records, branches ------------------------------------------------------------------


@pytest.mark.parametrize("slave", [pytest.param(s, marks=pytest.mark.long) for s in (2, 3)])
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: friction at every point that slips; an account of energies",
    aspects=("2D", "pairs", "large sliding"),
)
def test_sliding_history_balances_forces_and_energies(slave):
    """To and fro over two facets: shear at its bound, a balance of forces, energies."""
    bodies = Bodies(stacked(10, 7, (-1.0, 2.0), (0.0, 1.0), "quad"), slave, Coulomb(0.3))
    history = sliding_history(bodies).run(TIMES)
    assert history.reason == "the last time is reached"
    forth = next(s for s in history.steps if abs(s.time - 2.0) < 1e-9).result
    back = history.steps[-1].result
    sense = 1 if slave == 2 else -1
    for result, sign in ((forth, sense), (back, -sense)):
        table = result.tables["contact"]
        closed = table.pressure > 0
        assert closed.any()
        slips = closed & (table.letters != "k")
        assert slips.sum() >= closed.sum() - 1
        force = result.resultants["contact"]
        assert np.sign(force[0]) == sign
        shear = np.linalg.norm(table.shear[slips], axis=1)
        # A node of which hardly anything is covered has the mean around it.
        whole = table.area[slips] > 0.06 * table.area.max()
        np.testing.assert_allclose(shear[whole], 0.3 * table.pressure[slips][whole], rtol=1e-8)
        pair = result.pairs["contact"]
        assert pair.imbalance < 1e-13
        assert pair.moment < 1e-3
    energies = history.energies
    assert energies.dissipated > 0
    assert abs(energies.residue) < 0.03 * energies.external


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("slave", [2, 3])
@pytest.mark.parametrize("friction", [0.0, 0.1, 0.2, 0.3])
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: F/G = (tan a + mu)/(1 - mu tan a)",
    aspects=("2D", "pairs", "large sliding"),
)
def test_wedge_is_pushed_up_an_incline(friction, slave):
    """A wedge with its weight, pushed up an incline by more than a facet."""
    slope = 0.1
    both = stacked(12, 5, (0.0, 3.0), (0.2, 1.2), "quad")
    x = both.mesh.geometry.x
    x[:, 1] += slope * x[:, 0]
    u = displacement(both.mesh)
    V = u.function_space
    law = Coulomb(friction) if friction else Frictionless()
    pair = ContactPair(u, both, slave=slave, master=5 - slave, law=law, sliding="large")
    below = fem.locate_dofs_topological(V, 1, both.facet_tags.find(1))
    W = V.sub(0)
    back = mesh.locate_entities_boundary(both.mesh, 1, lambda x: np.isclose(x[0], 0.2))
    behind = fem.locate_dofs_topological(W, 1, back)
    way = fem.Constant(both.mesh, 0.0)
    bcs = [fem.dirichletbc(np.zeros(2), below, V), fem.dirichletbc(way, behind, W)]
    weight = 2.0
    dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    material = NeoHookean(*lame(1e5, 0.3))
    energy = material.energy(u) * dx((1, 2)) + weight * u[1] * dx(2)

    def load(t):
        way.value = 0.4 * t

    problem = ContactProblem(energy, u, [pair], bcs=bcs)
    problem.solve()
    history = QuasiStatic(problem, load).run(np.linspace(0.0, 1.0, 5), rays=False)
    assert history.reason == "the last time is reached"
    reactions = problem.evaluate().reactions
    assert reactions is not None
    push = COMM.allreduce(reactions[behind[behind < len(reactions)]].sum())
    exact = (slope + friction) / (1 - friction * slope)
    # The bodies are not rigid: their strains are some 1e-5.
    assert push / weight == pytest.approx(exact, rel=1e-4)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "sliding pairs",
    reference="itself: solves at single loads",
    aspects=("2D", "pairs", "large sliding", "branches"),
)
def test_sliding_branch_meets_single_solutions():
    """A branch under a growing load meets the solutions at single loads."""
    bodies = Bodies(stacked(6, 5, (-0.5, 1.5), (0.0, 1.0), "quad"), 3, Coulomb(0.3))
    gamma = fem.Constant(bodies.both.mesh, 0.0)
    V = bodies.u.function_space
    motion = fem.Function(V)

    def way(X):
        moved = np.zeros_like(X)
        moved[:, 1] = -0.1
        moved[:, 0] = 0.5 * X[:, 1] - 0.1
        return moved

    motion.x.array[:] = way(V.tabulate_dof_coordinates()[:, :2]).reshape(-1)
    system = ParametricContact(bodies.problem, gamma, driven=[(bodies.above, gamma * motion)])
    x = solved_start(system, 0.0)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0), route="steps")
    assert branch.reason == "gamma reached the end of its range"
    for point in branch.points[:: max(len(branch.points) // 3, 1)]:
        x.array[:] = point.y.array_r[: len(x.array)]
        system.put(x, point.gamma, point.piece)
        before = bodies.u.x.array.copy()
        bodies.u.x.array[:] = 0.0
        bodies.pair.multiplier.x.array[:] = 0.0
        bodies.problem.solve()
        off = np.abs(bodies.u.x.array - before).max(initial=0.0)
        assert COMM.allreduce(off, max) < 1e-8


# -- ironing ---------------------------------------------------------------------------------------


@pytest.mark.verifies(
    "sliding pairs",
    reference="independent code: a prototype of its own, and five published curves of V and H",
    aspects=("2D", "pairs", "large sliding"),
)
def test_ironing_agrees_with_another_code(folder):
    """The forces of another code on the same mesh (to its quadrature), at the published level."""
    summary = cases.ironing.main(["--size=0.2", "--until=1.1", f"--output={folder}"])
    V = summary["V_at"]
    H = summary["H_at"]
    assert V["1"] == pytest.approx(330.0852, abs=2e-3)
    assert H["1"] == pytest.approx(69.9152, abs=2e-3)
    assert V["1.1"] == pytest.approx(401.7, abs=0.5)
    assert H["1.1"] == pytest.approx(125.8, abs=0.5)
    assert 267.9 < V["1"] < 332.0  # of published curves
    assert summary["failed_steps"] == 0
    assert summary["newton_mean"] < 6


# -- what is refused -------------------------------------------------------------------------------


def lowered(by):
    """Two blocks of which the upper one begins lower, in the other."""
    both = stacked(4, 4, (0.0, 1.0), (0.0, 1.0))
    dim = both.mesh.topology.dim
    upper = mesh.locate_entities(both.mesh, dim, lambda x: x[1] > -1e-9)
    nodes = np.unique(both.mesh.geometry.dofmap[upper])
    both.mesh.geometry.x[nodes, 1] -= by
    return both


@pytest.mark.ranks(2)
@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs"))
@pytest.mark.parametrize("slave", [2, 3])
@pytest.mark.parametrize("distance", [None, 0.01])
@pytest.mark.parametrize("by", [0.02, 0.3, 0.55])
def test_overlap_is_refused(slave, distance, by):
    """Bodies that begin in each other, but for a press fit no deeper than the search distance."""
    both = lowered(by)
    u = displacement(both.mesh)
    given = {"slave": slave, "master": 5 - slave, "law": Frictionless(), "sliding": "large"}
    given["search_distance"] = distance
    with pytest.raises(ValueError, match=r"overlap by|behind the slave"):
        discretise(ContactPair(u, both, **given))
    if by > (0.25 if distance is None else distance):
        with pytest.raises(ValueError, match="use a larger search_distance"):
            discretise(ContactPair(u, both, interference=True, **given))
        given["search_distance"] = 1.1 * by
    discretise(ContactPair(u, both, interference=True, **given))


@pytest.mark.parametrize("slave", [2, pytest.param(3, marks=pytest.mark.long)])
@pytest.mark.verifies("sliding pairs", reference="itself: shorter steps", aspects=("2D", "pairs"))
def test_a_step_beyond_the_search_distance_gives_a_warning(slave, caplog):
    """A step longer than the search distance gives a warning, which shorter steps do not."""
    both = lowered(-0.1)
    warnings = []
    for distance, steps in ((0.02, 1), (0.02, 20)):
        bodies = Bodies(both, slave, Frictionless(), search_distance=distance)

        def load(t, bodies=bodies):
            bodies.move(lambda X: np.tile([0.0, -0.15 * t], (len(X), 1)))

        history = QuasiStatic(bodies.problem, load).run(np.linspace(0.0, 1.0, steps + 1))
        warnings.append(history.steps[-1].result.warnings)
        closed = history.steps[-1].result.counts["open"] < len(
            history.steps[-1].result.tables["contact"].x
        )
        assert closed == (steps > 1)
    assert "passed through each other" in warnings[0]["approach of 'contact'"]
    assert not warnings[1]
    assert COMM.rank > 0 or "passed through each other" in caplog.text


@pytest.mark.parametrize("slave", [2, 3])
@pytest.mark.verifies("sliding pairs", reference="closed form: no force", aspects=("2D", "pairs"))
def test_a_long_step_apart_gives_no_warning(slave):
    """A step away from each other that is longer than the search distance gives no warning."""
    bodies = Bodies(lowered(0.0), slave, Frictionless(), search_distance=0.02)

    def load(t):
        bodies.move(lambda X: np.tile([0.0, 0.15 * t], (len(X), 1)))

    result = QuasiStatic(bodies.problem, load).run([0.0, 1.0]).steps[-1].result
    assert result.counts["open"] + result.counts["clamped"] == len(result.tables["contact"].x)
    assert result.indicators.surfaces["contact"].approach == 0.0
    assert not result.warnings


@pytest.mark.refuses("sliding pairs", aspects=("2D", "pairs"))
def test_what_needs_one_operator_is_refused():
    bodies = Bodies(blocks(2, "quad"), 3, Coulomb(0.3), LinearElastic(*lame(1000.0, 0.3)))
    bodies.move(lambda X: np.tile([0.0, -0.05], (len(X), 1)))
    bodies.problem.solve()
    with pytest.raises(ValueError, match="needs small sliding"):
        bodies.problem.reduced()
    with pytest.raises(ValueError, match=r"large sliding between bodies .* level='position'"):
        NSCD(bodies.problem, 1.0, dt=0.1, level="velocity", mass="lumped")
    with pytest.raises(ValueError, match="needs small sliding"):
        bodies.problem.solve(algorithm="lemke")


class Thrown:
    """A block that is thrown along a slab and comes to rest."""

    speed = 0.6
    gravity = 10.0
    friction = 0.3

    def __init__(self, slave=3, mass="redistributed", material=NeoHookean, **given):
        slab = create_grid(COMM, [np.linspace(0, 0.9, 19), np.linspace(-0.1, 0, 3)], CELLS["quad"])
        block = create_grid(
            COMM, [np.linspace(0.2, 0.5, 9), np.linspace(0, 0.15, 4)], CELLS["quad"]
        )
        planes = [{"t1": (1, -0.1), "t2": (1, 0.0)}, {"t3": (1, 0.0), "t4": (1, 0.15)}]
        tags = [tagged(body, **p) for body, p in zip((slab, block), planes, strict=True)]
        both = join([slab, block], facet_tags=tags)
        self.u = u = displacement(both.mesh)
        V = u.function_space
        law = Coulomb(self.friction)
        pair = ContactPair(u, both, slave=slave, master=5 - slave, law=law, sliding="large")
        held = fem.locate_dofs_topological(V, 1, both.facet_tags.find(1))
        energy = material(*lame(1e5, 0.2)).energy(u) * ufl.dx + self.gravity * u[1] * ufl.dx
        bcs = [fem.dirichletbc(np.zeros(2), held, V)]
        self.problem = ContactProblem(energy, u, [pair], bcs=bcs)
        self.velocity = fem.Function(V)
        upper = np.unique(V.dofmap.list[mesh.locate_entities(both.mesh, 2, above)])
        self.velocity.x.array[2 * upper] = self.speed
        given = {"dt": 0.01, "velocity": self.velocity, "mass": mass} | given
        self.motion = NSCD(self.problem, 1.0, **given)

    def distance(self):
        """Return the distance that the block has moved."""
        x = ufl.SpatialCoordinate(self.u.function_space.mesh)
        moved = fem.form(ufl.conditional(x[1] > 0, self.u[0], 0.0) * ufl.dx)
        return COMM.allreduce(fem.assemble_scalar(moved)) / (0.3 * 0.15)


def above(x):
    return x[1] >= -1e-9


@pytest.mark.long
@pytest.mark.parametrize(
    ("slave", "mass"),
    [
        pytest.param(3, "redistributed", marks=pytest.mark.long),
        pytest.param(3, "lumped", marks=pytest.mark.long),
        (2, "redistributed"),
    ],
)
@pytest.mark.verifies(
    "sliding pairs",
    "NSCD motion",
    reference="closed form: a rigid block with friction, v^2/(2 mu g)",
    aspects=("2D", "pairs", "large sliding"),
)
def test_a_block_that_is_thrown_comes_to_rest(slave, mass):
    """It slides by 1.2 facets and, being elastic, comes to rest near the rigid position."""
    thrown = Thrown(slave, mass)
    history = thrown.motion.run([0.0, 0.25])
    wanted = thrown.speed**2 / (2 * thrown.friction * thrown.gravity)
    assert thrown.distance() == pytest.approx(wanted, rel=2e-3)
    energies = history.energies
    assert energies.kinetic < 1e-3 * energies.at_start
    assert energies.dissipated == pytest.approx(energies.at_start, rel=2e-3)
    assert abs(energies.residue) < 1e-6 * energies.at_start


# -- self contact ----------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "self contact",
    reference="independent code: a prototype of its own",
    aspects=("2D", "large sliding"),
)
@pytest.mark.parametrize(
    ("friction", "force", "accuracy"),
    [
        (0.0, 193.671, 0.01),
        # With friction the force depends on the steps.
        pytest.param(0.3, 205.1, 0.4, marks=pytest.mark.long),
    ],
)
def test_self_contact_of_a_u_balances(friction, force, accuracy):
    """The arms of a U pressed together, with friction; each place is looked at from one side."""
    domain, tags = hairpin()
    u = displacement(domain)
    V = u.function_space
    material = NeoHookean(*lame(1000.0, 0.3))
    law = Coulomb(friction)
    face = SelfContact(u, tags, tag=1, law=law, direction=(0, -1), search_distance=0.45)
    below = fem.locate_dofs_geometrical(V, lambda x: x[1] < 1e-9)
    W = V.sub(1)
    facets = mesh.locate_entities_boundary(domain, 1, lambda x: (x[1] > 2.5 - 1e-9) & (x[0] > 4.5))
    above = fem.locate_dofs_topological(W, 1, facets)
    value = fem.Constant(domain, 0.0)
    bcs = [fem.dirichletbc(np.zeros(2), below, V), fem.dirichletbc(value, above, W)]
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [face], bcs=bcs)

    def load(t):
        value.value = -t

    times = np.linspace(0.0, 0.7, 8)
    history = QuasiStatic(problem, load).run(times)
    assert history.reason == "the last time is reached"
    reactions = problem.evaluate().reactions
    assert reactions is not None
    mine = above[above < len(reactions)]
    assert -COMM.allreduce(reactions[mine].sum()) == pytest.approx(force, abs=accuracy)
    assert history.steps[-1].result.pairs["contact"].imbalance < 1e-13


def disc_on_a_block(cell, slave, n=4, law=None):
    """A disc of the radius 1 on a block, and the tags of their faces, 2 and 3."""
    disc = flat_disc(cell, n)
    wide = [np.linspace(-1.6, 1.6, n + 2)] * 2
    block = create_grid(COMM, [*wide, [-0.5, 0.0]], CELLS[cell])
    tags = [tagged(disc, t2=(2, 0.0), t4=(2, 0.5)), tagged(block, t3=(2, 0.0), t5=(2, -0.5))]
    both = join([disc, block], facet_tags=tags)
    u = displacement(both.mesh)
    given = dict(law=law or Coulomb(0.2), sliding="large", search_distance=0.3)
    return both, u, ContactPair(u, both, slave=slave, master=5 - slave, **given)


def torque_of_a_punch(n, angle, pressure):
    """Return frictional torque over normal force of a disc of radius 1 spinning in one step.

    Args:
        n: number of cells across the disc.
        angle: rotation angle.
        pressure: function of the distance from the axis, averaged at the nodes.
    """
    friction = 0.2
    both, u, pair = disc_on_a_block("hex", 2, n)
    pair = discretise(pair)
    owned = pair.owned_nodes
    X = u.function_space.tabulate_dof_coordinates()[:owned]
    disc = np.unique(u.function_space.dofmap.list[both.cell_tags.find(1)])
    disc = disc[disc < owned]
    moved = np.zeros((owned, 3))
    moved[disc] = Rotation.from_rotvec([0.0, 0.0, angle]).apply(X[disc]) - X[disc]
    operator = pair.points.at(moved, np.zeros((owned, 3)))
    facing = operator.facing
    m = operator.number
    at = np.einsum("pqa,pad->pqd", facing.basis, operator.x[facing.facet])
    p = pressure(np.hypot(at[..., 0], at[..., 1]))
    forces = pair.points.faces.sums(facing.facet, np.einsum("paq,pq->pa", facing.weighted, p))[:m]
    jump = facing.nodal.jump[:m]
    size = np.linalg.norm(jump, axis=1)
    way = np.divide(jump, size[:, None], out=np.zeros_like(jump), where=size[:, None] > 1e-9)
    shear = -friction * (forces / operator.areas)[:, None] * way
    on_bodies = operator.transpose(shear).reshape(-1, 3)[disc]
    x = (X + moved)[disc]
    torque = np.sum(x[:, 0] * on_bodies[:, 1] - x[:, 1] * on_bodies[:, 0])
    torque, force = COMM.allreduce(np.array([torque, forces.sum()]))
    return -torque / (friction * force)


@pytest.mark.each_value
@pytest.mark.parametrize("angle", [1.0, 60.0])
@pytest.mark.parametrize("pressure", ["uniform", "Boussinesq"])
@pytest.mark.verifies(
    "sliding pairs",
    "Coulomb",
    reference="closed form: the torque of a flat punch",
    aspects=("3D", "pairs", "large sliding"),
)
def test_flat_punch_has_its_closed_form_torque(pressure, angle):
    """2/3 mu P a of a uniform pressure, of the second order in the mesh size; pi/4 mu P a of that
    of a rigid punch without friction, of the first, since it has no bound at its rim.
    """
    known = {
        "uniform": (np.ones_like, 2.0 / 3.0, 1.9, 0.02),
        "Boussinesq": (lambda r: np.maximum(1.0 - r**2, 1e-9) ** -0.5, np.pi / 4.0, 1.0, 0.06),
    }
    of_radius, wanted, order, most = known[pressure]
    off = [torque_of_a_punch(n, np.radians(angle), of_radius) / wanted - 1.0 for n in (4, 8)]
    assert abs(off[1]) < most
    assert np.log2(off[0] / off[1]) > order


RUBBER = NeoHookean(*lame(1000.0, 0.3))
ARM, RADIUS, THICK = 1.5, 0.3, 0.1  # of a plate that is folded


# -- a hairpin -------------------------------------------------------------------------------------


def extruded(flat, width, layers):
    """Hexahedra of quadrilaterals that are all on one rank, along y; x and y become x and z."""
    cells = flat.geometry.dofmap.astype(np.int64)
    x = flat.geometry.x
    n = len(x)
    y = np.linspace(0.0, width, layers + 1)
    points = np.concatenate([np.stack([x[:, 0], np.full(n, a), x[:, 1]], axis=1) for a in y])
    many = [np.concatenate([cells + k * n, cells + (k + 1) * n], axis=1) for k in range(layers)]
    cells = np.concatenate(many)
    if COMM.rank:
        cells, points = cells[:0], points[:0]
    element = basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))
    return mesh.create_mesh(COMM, cells=cells, x=points, e=element)


def pressed_hairpin(domain, inner):
    """Force closing the arms, per width, and the result."""
    dim = domain.geometry.dim
    u = displacement(domain)
    V = u.function_space
    law = Frictionless()
    along = -np.eye(dim)[-1]
    face = SelfContact(u, inner, law=law, direction=along, search_distance=0.45)
    last = dim - 1
    below = fem.locate_dofs_geometrical(V, lambda x: x[last] < 1e-9)
    W = V.sub(last)
    facets = mesh.locate_entities_boundary(
        domain, last, lambda x: (x[last] > 2.5 - 1e-9) & (x[0] > 4.5)
    )
    above = fem.locate_dofs_topological(W, last, facets)
    value = fem.Constant(domain, 0.0)
    bcs = [fem.dirichletbc(np.zeros(dim), below, V), fem.dirichletbc(value, above, W)]
    if dim == 3:  # plane strain
        sides = mesh.exterior_facet_indices(domain.topology)
        middles = mesh.compute_midpoints(domain, 2, sides)
        width = COMM.allreduce(domain.geometry.x[:, 1].max(), max)
        sides = sides[(middles[:, 1] < 1e-9) | (middles[:, 1] > width - 1e-9)]
        dofs = fem.locate_dofs_topological(V.sub(1), 2, sides)
        bcs.append(fem.dirichletbc(0.0, dofs, V.sub(1)))
    energy = RUBBER.energy(u) * ufl.dx(metadata={"quadrature_degree": 3})
    problem = ContactProblem(energy, u, [face], bcs=bcs)

    def load(t):
        value.value = -t

    history = QuasiStatic(problem, load).run(np.linspace(0.0, 0.6, 3))
    assert history.reason == "the last time is reached"
    reactions = problem.evaluate().reactions
    mine = above[above < len(reactions)]
    return -COMM.allreduce(reactions[mine].sum()), history.steps[-1].result


@pytest.mark.verifies(
    "self contact",
    "hyperelastic bodies",
    reference="itself: plane strain in the plane",
    aspects=("3D", "large sliding"),
)
def test_hairpin_in_plane_strain_agrees_with_the_plane():
    """A U drawn out along y and held there: force and contact are those in the plane."""
    flat, _ = hairpin(0.25)
    found = []
    for domain in (flat, extruded(hairpin(0.25, comm=MPI.COMM_SELF)[0], 0.25, 1)):
        last = domain.geometry.dim - 1

        def inner(x, last=last):
            z = x[last]
            return (x[0] > 1 - 1e-9) & (z > 1 - 1e-9) & (z < 1.5 + 1e-9)

        domain.topology.create_connectivity(last, last + 1)
        facets = mesh.locate_entities_boundary(domain, last, inner)
        middles = mesh.compute_midpoints(domain, last, facets)
        facets = facets[~np.isclose(middles[:, 0], 6.0)]
        if last == 2:
            middles = mesh.compute_midpoints(domain, last, facets)
            facets = facets[(middles[:, 1] > 1e-9) & (middles[:, 1] < 0.25 - 1e-9)]
        found.append(pressed_hairpin(domain, facets))
    (plane, in_plane), (space, in_space) = found
    closed = [np.sum(r.tables["contact"].letters != "o") for r in (in_plane, in_space)]
    assert closed[0] >= 3
    assert closed[1] == 2 * closed[0]
    assert space / 0.25 == pytest.approx(plane, rel=1e-6)
    assert in_space.pairs["contact"].imbalance < 1e-13
