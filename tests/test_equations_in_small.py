"""Parts of H whose answers are known beforehand: rigid bodies, measures, scales, sliding terms."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from blocks import block, box, facets
from scipy.spatial.transform import Rotation

import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, RigidBody, Sphere
from dolfinx_contact.equations import parametric
from dolfinx_contact.equations import touching as starts
from dolfinx_contact.equations.arguments import check
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import Constancy, Datum
from dolfinx_contact.equations.evaluation import ContactState
from dolfinx_contact.equations.jacobian import _Numbering
from dolfinx_contact.equations.measures import Measures, Scales, _row_measures
from dolfinx_contact.equations.parametric import ParametricEquations
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.equations.scaling import automatic_augmentation, softness
from dolfinx_contact.equations.sliding import SlidingTerms, _of_law, _on_master, _Pieces
from dolfinx_contact.equations.touching import (
    _within,
    bring_together,
    touches_nothing,
    touching,
)
from dolfinx_contact.equations.validation import check_turn
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.materials import Axisymmetric, LinearElastic

COMM = MPI.COMM_WORLD

# -- rigid bodies ---------------------------------------------------------------------------------


def bodies_in(dim):
    """A body that turns freely, with a load, and one whose motion is prescribed, on surfaces."""
    domain = box(COMM, 1, "tri" if dim == 2 else "tet")
    speed = fem.Constant(domain, 0.25)
    turns = ["rz"] if dim == 2 else ["rx", "ry", "rz"]
    along = ["x", "y", "z"][:dim]
    about = np.arange(1.0, dim + 1)
    first = RigidBody(
        Sphere(about, 0.5),
        about=about,
        load={along[0]: 0.3, along[1]: -0.4, turns[0]: 6.0},
        free=along[2:] + turns[1:],
        name="ball",
    )
    second = RigidBody(
        HalfSpace(np.zeros(dim), np.eye(dim)[0]),
        about=np.zeros(dim),
        motion={along[0]: 2.0, along[1]: speed, turns[-1]: 0.125},
        held=along[2:] + turns[:-1],
        name="wall",
    )
    rng = np.random.default_rng(4)

    def surface(body, places, turning=False):
        x = np.array(places, dtype=float).reshape(-1, dim)
        known = SimpleNamespace(
            rigid_body=body, positions=x, node_positions=x, owned_nodes=len(x), dim=dim
        )
        known.turns = turning
        known.displaced = True if turning else None
        known.axisymmetric = False
        return known

    surfaces = [
        surface(second, rng.normal(size=(2, dim))),
        surface(None, rng.normal(size=(3, dim))),
        surface(first, about + 0.1 * rng.normal(size=(4, dim)), turning=True),
        surface(first, [about + 3.0 * np.eye(dim)[0]], turning=True),
    ]
    V = SimpleNamespace(mesh=SimpleNamespace(comm=COMM))
    return RigidBodies(V, surfaces, 7.0), first, second, surfaces, speed


@pytest.mark.parametrize("dim", [2, 3])
def test_unknowns_of_rigid_bodies(dim):
    """Rotations times the largest arm of a point; rows do the work of forces and moments."""
    rigid, ball, wall, surfaces, speed = bodies_in(dim)
    k = 3 if dim == 2 else 6
    assert rigid.bodies == [wall, ball]
    assert (rigid.size, rigid.owned) == (2 * k, 2 * k if COMM.rank == 0 else 0)
    arm = max(np.linalg.norm(surfaces[0].positions, axis=1))
    units = np.concatenate([np.ones(dim), np.full(k - dim, arm), np.ones(dim), np.full(k - dim, 3)])
    assert rigid.slices == [slice(0, k), slice(k, 2 * k)]
    assert [rigid.slice_of(b) for b in (wall, ball, None)] == [*rigid.slices, slice(0, 0)]
    np.testing.assert_array_equal(rigid.fixed, [True] * k + [False] * k)
    # Values, unknowns and rows.
    wall.values, ball.values = np.arange(1.0, k + 1), -np.arange(1.0, k + 1)
    q = rigid.given
    np.testing.assert_allclose(q, units * np.concatenate([wall.values, ball.values]), rtol=1e-14)
    rigid.show(2 * q)
    np.testing.assert_allclose(wall.values, 2 * np.arange(1.0, k + 1))
    np.testing.assert_allclose(ball.values, -2 * np.arange(1.0, k + 1))
    np.testing.assert_allclose(rigid.of_body(q, ball), -np.arange(1.0, k + 1))
    assert rigid.of_body(q, None).size == 0
    rows = np.random.default_rng(1).normal(size=2 * k)
    work = sum(rigid.forces_of_body(rows, b) @ rigid.of_body(q, b) for b in rigid.bodies)
    assert work == pytest.approx(rows @ q, rel=1e-13)
    mine = q[: rigid.owned]
    np.testing.assert_array_equal(rigid.here(q), mine)
    np.testing.assert_array_equal(rigid.everywhere(mine), q)
    # Loads where it is free, motions where it is not.
    load = np.zeros(k)
    load[[0, 1, dim]] = 0.3, -0.4, 6.0 / 3.0
    np.testing.assert_allclose(rigid.loads(), [*np.zeros(k), *load], rtol=1e-14)
    motion = np.zeros(k)
    motion[[0, 1, k - 1]] = 2.0, 0.25, 0.125 * arm
    np.testing.assert_allclose(rigid.prescribed(0.5), [*motion, *np.zeros(k)], rtol=1e-14)
    rigid.start = np.full(2 * k, 0.5)
    part = 0.5 + 0.25 * (motion - 0.5)
    np.testing.assert_allclose(rigid.prescribed(0.25), [*part, *np.zeros(k)], rtol=1e-14)
    speed.value = 1.25
    assert rigid.prescribed(1.0)[1] == 1.25
    one = [ufl.as_ufl(float(i)) for i in range(1, 2 * k + 1)]
    loads, motions = rigid.rates(one)
    numbers = np.arange(1.0, 2 * k + 1)
    np.testing.assert_allclose(loads, np.where(rigid.fixed, 0.0, numbers / units), rtol=1e-14)
    np.testing.assert_allclose(motions, np.where(rigid.fixed, numbers * units, 0.0), rtol=1e-14)
    # Unit translations along loads.
    along = np.zeros(2 * k)
    along[[k, k + 1]] = 0.6, -0.8
    np.testing.assert_allclose(rigid.directions(), along, rtol=1e-14)


def test_the_length_of_bodies_whose_points_are_at_their_reference():
    """Is that of the deformable bodies; and no two bodies have one name."""
    shape = HalfSpace((0.0, 0.0), (0.0, 1.0))
    one, other = (RigidBody(shape, about=(1.0, 2.0), free=("x", "y", "rz")) for _ in range(2))
    V = SimpleNamespace(mesh=SimpleNamespace(comm=COMM))

    def at(body, *places):
        return SimpleNamespace(rigid_body=body, positions=np.array(places).reshape(-1, 2))

    for places in ((), ((1.0, 2.0),)):
        rigid = RigidBodies(V, [at(one, *places)], 7.0)
        np.testing.assert_allclose(rigid.loads(), 0.0)
        one.values = np.ones(3)
        np.testing.assert_allclose(rigid.given, [1.0, 1.0, 7.0])
        assert rigid.directions().tolist() == [0.0, 0.0, 0.0]
    none = RigidBodies(V, [at(None, (1.0, 2.0))], 7.0)
    assert (none.size, none.given.size, none.everywhere(np.zeros(0)).size) == (0, 0, 0)
    with pytest.raises(ValueError, match="rigid bodies need different names"):
        RigidBodies(V, [at(one), at(other)], 7.0)


def moments(arm, forces):
    """Their sum, in the plane one number."""
    dim = arm.shape[1]
    in_space = (np.pad(v, ((0, 0), (0, 3 - dim))) for v in (arm, forces))
    return np.cross(*in_space).sum(axis=0)[-1 if dim == 2 else 0 :]


@pytest.mark.parametrize("dim", [2, 3])
def test_forces_on_bodies_that_have_turned(dim):
    """What is conjugate to their unknowns does the work of forces on the points that move."""
    rigid, ball, _, surfaces, _ = bodies_in(dim)
    rng = np.random.default_rng(2)
    s = surfaces[2]
    q = 0.3 * rng.normal(size=rigid.size)
    u = 0.2 * rng.normal(size=s.positions.shape)
    forces = rng.normal(size=u.shape)
    rows = rigid.reactions(s, forces.reshape(-1), u.reshape(-1), q)
    part = rigid.slice_of(ball)
    assert not rows[: part.start].any()
    moved = s.positions + u
    there = ball.about + rigid.of_body(q, ball)[:dim]
    turned = moments(moved - there, forces)
    np.testing.assert_allclose(
        rigid.forces_of_body(rows, ball), [*forces.sum(axis=0), *turned], rtol=1e-12
    )
    # The work on points of the body by differences.
    pushes = rigid.conjugate(q, rows)
    h = 1e-6
    for change in np.eye(rigid.size)[part]:

        def places(sign, change=change):
            values = rigid.of_body(q + sign * h * change, ball)
            vector = np.pad(values[dim:], (3 - len(values[dim:]), 0))
            Q = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
            before = rigid.of_body(q, ball)
            vector = np.pad(before[dim:], (3 - len(before[dim:]), 0))
            arm = (moved - there) @ Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
            return ball.about + values[:dim] + arm @ Q.T

        work = np.sum(forces * (places(1) - places(-1))) / (2 * h)
        assert pushes @ change == pytest.approx(work, abs=1e-7)
    # One that does not turn in the problem has its moments about where it was.
    s.displaced, s.turns = None, False
    surfaces[3].turns = False
    rows = rigid.reactions(s, forces.reshape(-1), u.reshape(-1), q)
    turned = moments(s.positions - ball.about, forces)
    np.testing.assert_allclose(
        rigid.forces_of_body(rows, ball), [*forces.sum(axis=0), *turned], rtol=1e-12
    )
    np.testing.assert_array_equal(rigid.conjugate(q, rows), rows)
    assert not rigid.reactions(surfaces[1], np.ones(3 * dim), np.zeros(3 * dim), q).any()
    if dim == 2:
        s.axisymmetric = True
        rows = rigid.reactions(s, forces.reshape(-1), u.reshape(-1), q)
        np.testing.assert_allclose(rows[part], [0.0, forces[:, 1].sum(), 0.0], rtol=1e-13)


def test_which_points_are_nearest_to_a_body():
    """The smallest gap of all surfaces on it; of one that is held it does not matter."""
    rigid, _, _, _, _ = bodies_in(2)
    gaps = [np.array(g) for g in ([0.5, 0.25], [0.1, 0.2, 0.3], [1.0, 0.75, 2.0, 3.0], [0.5])]
    assert rigid.nearest(gaps) == [-np.inf, -np.inf, 0.5, 0.5]
    gaps[3] = np.zeros(0)
    assert rigid.nearest(gaps)[2:] == [0.75, 0.75]
    motions = np.zeros((2, 6))
    motions[0, 1] = 1e-5
    motions[1, [3, 5]] = -2e-6, 0.9e-6
    assert rigid.names(motions) == "translation y of wall, translation x of ball"
    motions[1, 5] = -1.1e-6
    assert rigid.names(motions).endswith("translation x of ball, rotation about z of ball")


# -- measures -------------------------------------------------------------------------------------


def contact_at(n, gaps, traction, codes, r, areas, E=None):
    """A surface of points with normals n, and a state there."""
    points = SimpleNamespace(
        data=SimpleNamespace(r=np.array(r)),
        areas=np.array(areas),
        E=E,
        r=np.array(r),
        vertex_areas=np.array(areas),
        vertex_gaps=np.array(gaps),
    )
    surface = SimpleNamespace(points=points, dim=2, comm=COMM)
    data = SimpleNamespace(n=np.array(n))
    statuses = np.array(codes, dtype=np.int8)
    return surface, SimpleNamespace(traction=np.array(traction), data=data, statuses=statuses)


def test_measures_of_contact_rows():
    """A length where a point is held, a force where it is free, by its r and its area."""
    n = np.tile([0.6, 0.8], (4, 1))
    t = np.tile([-0.8, 0.6], (4, 1))
    along, across = np.array([3.0, -5.0, 7.0, -2.0]), np.array([-4.0, 6.0, 1.0, 11.0])
    rows = along[:, None] * n + across[:, None] * t
    r, areas = [2.0, 4.0, 0.5, 1.0], [0.5, 0.25, 4.0, 2.0]
    traction = [[1.0, 2.0], [-30.0, 4.0], [0.0, 0.0], [2.0, -3.0]]
    found = contact_at(n, np.zeros(4), traction, [OPEN, STICK, PLUS, MINUS], r, areas)
    length, force, contact = _row_measures(*found, rows.reshape(-1))
    # Of the stuck point both parts, of those that slip the gap; slips count as lengths as well.
    assert length == pytest.approx(max(5.0, 6.0, 7.0 / 2.0, 1.0 / 2.0, 2.0 / 2.0, 11.0 / 2.0))
    assert force == pytest.approx(max(3.0, 4.0, 1.0, 11.0))
    assert contact == pytest.approx(30.0 * 0.25)
    for codes, expected in (
        ((OPEN,) * 4, (0.0, 11.0)),
        ((STICK,) * 4, (6.0, 0.0)),
        ((PLUS,) * 4, (6.0, 11.0)),
    ):
        found = contact_at(n, np.zeros(4), traction, codes, r, areas)
        assert _row_measures(*found, rows.reshape(-1))[:2] == pytest.approx(expected)
    found = contact_at(n, np.zeros(4), traction, [OPEN] * 4, r, areas, E="between nodes")
    length, force, contact = _row_measures(*found, rows.reshape(-1))
    largest = np.abs(rows).max()
    assert (length, force, contact) == pytest.approx((largest / 2.0, largest, 30.0 * 4.0))


@pytest.mark.parametrize("settled", [False, True])
def test_measures_of_a_state(settled):
    """Each the largest of its kind over its scale, and scales do not shrink."""
    s, found = contact_at([[0.0, 1.0]], [0.25], [[0.0, 8.0]], [STICK], [2.0], [0.5])
    fixed = np.array([True, False, False])
    eq = SimpleNamespace(
        comm=COMM,
        owned_sizes=[3, 2, 2],
        fixed=fixed,
        rigid=SimpleNamespace(here=lambda v: v, fixed=np.array([False, True])),
        bulk=SimpleNamespace(reach=0.0),
        stiffness_scale=10.0,
        body_size=5.0,
        surfaces=[s],
        scaling=SimpleNamespace(at_vertices=[np.array([4.0])]),
        round_off_force=lambda length: 1e-4 * length,
    )

    def state(body, contact, rigid, u=(0.0, 0.5, 0.0), q=(0.0, 0.0), reactions=(7.0, 99.0, 0.0)):
        rows = [np.array(body), np.array(contact), np.array(rigid)]
        return SimpleNamespace(
            u=np.array(u), q=np.array(q), surfaces=[found], rows=rows, reactions=np.array(reactions)
        )

    scales = Scales(eq, settled=settled)
    measured = scales.measure(state([5.0, 2.0, -3.0], [0.3, -0.4], [6.0, 0.2]))
    # Forces at work: the first residual 6, the reaction 7, the contact force 4. Lengths: 0.5 of u,
    # 0.5 of the Dirichlet row over the stiffness, 2 of the traction over that of the node.
    assert (scales.force, scales.length) == pytest.approx((7.0, 2.0))
    assert (measured.force, measured.constraint) == pytest.approx((6.0 / 7.0, 0.5 / 2.0))
    assert measured.cone == 0.0
    assert measured.worst == pytest.approx(6.0 / 7.0)
    # Later a residual is no force at work.
    measured = scales.measure(state([0.0, -20.0, 0.0], [0.0, 0.0], [0.0, -30.0]))
    assert (scales.force, scales.length) == pytest.approx((7.0, 3.0))
    assert (measured.force, measured.constraint) == pytest.approx((20.0 / 7.0, 3.0 / 3.0))
    for u, q, reach, gap, length in (
        ((0.0, -4.0, 0.0), (0.0, 0.0), 0.0, 0.0, 4.0),
        ((0.0, 0.0, 0.0), (-5.0, 0.0), 0.0, 0.0, 5.0),
        ((0.0, 0.0, 0.0), (0.0, 0.0), 6.0, 0.0, 6.0),
        ((0.0, 0.0, 0.0), (0.0, 0.0), 0.0, -7.0, 7.0),
    ):
        eq.bulk.reach, s.points.vertex_gaps = reach, np.array([gap])
        scales.measure(state([0.0] * 3, [0.0] * 2, [0.0] * 2, u=u, q=q))
        assert scales.length == pytest.approx(length)
    # What is no number anywhere is no solution.
    for field in range(3):
        for i in range(len(rows := [np.zeros(3), np.zeros(2), np.zeros(2)][field])):
            rows[i] = np.nan
            parts = [np.zeros(3), np.zeros(2), np.zeros(2)]
            parts[field] = rows
            assert np.isnan(scales.measure(state(*parts)).worst)
            rows[i] = 0.0
    assert np.isfinite([scales.force, scales.length]).all()
    # Where nothing happens nothing is small by itself.
    found.traction = np.zeros((1, 2))
    eq.bulk.reach, s.points.vertex_gaps = 0.0, np.zeros(1)
    scales = Scales(eq, settled=settled)
    still = state([0.0, 1e-13, 0.0], [0.0, 0.0], [0.0, 0.0], u=(0, 0, 0), reactions=(0, 0, 0))
    measured = scales.measure(still)
    none = (10.0 * 5e-12, 5e-12) if settled else (1e-13, 5e-14)
    assert (scales.force, scales.length) == pytest.approx(none)
    assert measured.force == pytest.approx(1e-13 / none[0])
    scales.length = 4.0
    scales.measure(still)
    assert scales.force == pytest.approx(none[0])
    # Where all forces are round-off it is that of the stiffness.
    scales = Scales(eq)
    moving = state([0.0, 1e-9, 0.0], [0.0, 0.0], [0.0, 0.0], u=(0, 1.0, 0), reactions=(0, 0, 0))
    assert scales.measure(moving).force == pytest.approx(1e-9 / 1e-4)


def test_the_worst_of_measures():
    assert Measures(1.0, 2.0, 3.0).worst == 3.0
    assert Measures(4.0, 2.0, 3.0).worst == 4.0
    assert Measures(1.0, 5.0, 3.0).worst == 5.0
    assert np.isnan(Measures(1.0, np.nan, 3.0).worst)


# -- sliding faces --------------------------------------------------------------------------------


def test_pieces_of_one_pair_of_facets_are_added_up():
    """Where both facets stay the same from one piece to the next."""
    facet, master = np.array([0, 0, 0, 1, 1, 4]), np.array([2, 2, 3, 3, 3, 3])
    rng = np.random.default_rng(0)
    shapes = (4, 2), (2, 2, 6, 2), (2, 2, 6, 2), (2, 2)
    values = [rng.normal(size=(6, *shape)) for shape in shapes]
    nodes, mirrors = rng.integers(9, size=(6, 2)), np.where(rng.uniform(size=(6, 2)) < 0.5, 1, -1)
    pieces = _Pieces(facet, nodes, mirrors, *values)
    found = pieces.of_pairs(master)
    groups = [[0, 1], [2], [3, 4], [5]]
    np.testing.assert_array_equal(found.facet, [0, 0, 1, 4])
    np.testing.assert_array_equal(found.nodes, nodes[[0, 2, 3, 5]])
    np.testing.assert_array_equal(found.mirrors, mirrors[[0, 2, 3, 5]])
    sums = found.coupling, found.on_master, found.of_law, found.means
    for part, whole in zip(sums, values, strict=True):
        np.testing.assert_allclose(part, [whole[g].sum(axis=0) for g in groups], rtol=1e-13)
    none = _Pieces(facet[:0], nodes[:0], mirrors[:0], *(v[:0] for v in values))
    assert none.of_pairs(master[:0]) is none


def test_derivatives_at_pieces_of_faces():
    """Sums over points, places along the facet and corners, written out."""
    rng = np.random.default_rng(1)
    p, q, e, c, dim, a, b = 3, 4, 1, 6, 2, 2, 5
    places, gaps = rng.normal(size=(p, q, e, c, dim)), rng.normal(size=(p, q, c, dim))
    by_gap, by_slip = rng.normal(size=(p, a, dim)), rng.normal(size=(p, a, dim, dim))
    weighted, along = rng.normal(size=(p, q, a)), rng.normal(size=(p, q, 1, dim, e))
    slopes, t = rng.normal(size=(p, q, b, e)), rng.normal(size=(p, q, dim))
    facing = SimpleNamespace(weighted=weighted, along=along, rays=SimpleNamespace(slopes=slopes))
    shape = np.broadcast_to(along, (p, q, a, dim, e))
    expected = np.einsum("pai,pqa,pqcj->paicj", by_gap, weighted, gaps)
    expected += np.einsum("paik,pqa,pqake,pqecj->paicj", by_slip, weighted, shape, places)
    found = _of_law(facing, by_gap, by_slip, places, gaps)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)
    expected = np.einsum("pqbe,pqi,pqecj->pbicj", slopes, t, places)
    np.testing.assert_allclose(_on_master(facing, t, places), expected, rtol=1e-11, atol=1e-12)


# -- parts of a problem ---------------------------------------------------------------------------


def test_how_far_data_move_a_body_to_its_floor():
    """By what they prescribe beyond where the body is; half of it is expected to close."""
    eq = block(n=2, top=(0.004, -0.01)).equations
    (s,) = eq.surfaces
    still = np.zeros_like(eq.bulk.displacement.x.array)
    assert eq.constraints.approach(s, still.reshape(-1, 2)) == pytest.approx(0.01)
    assert eq.reach(s, still) == pytest.approx(0.005)
    partly = np.tile([0.3, -0.004], (len(still) // 2, 1))
    assert eq.constraints.approach(s, partly) == pytest.approx(0.006)
    above = np.tile([0.3, -0.02], (len(still) // 2, 1))
    assert eq.constraints.approach(s, above) == 0.0


@pytest.mark.parametrize(("off", "times"), [(0.0, 0), (1e-13, 0), (1e-3, 1)])
def test_conditions_that_contradict_each_other_are_said_once(off, times, caplog):
    """The first place of all, and what holds; not of round-off."""
    domain = box(COMM, 2, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    along = fem.locate_dofs_topological(V.sub(1), 1, facets(domain, 1, 1.0))
    bcs = [
        fem.dirichletbc(np.array([0.0, -0.5]), top, V),
        fem.dirichletbc(-0.5 + off, along, V.sub(1)),
    ]
    floor = HalfSpace((0.0, -1.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    for _ in range(2):
        problem.equations.constraints.check_values(problem.surfaces, 1.0)
    said = [r.message for r in caplog.records if "contradict" in r.message]
    assert len(said) == (times if COMM.rank == 0 else 0)
    for message in said:
        assert message == (
            "two Dirichlet conditions contradict each other: component y at (0, 1) is -0.5 and "
            "-0.499; the later one in the list holds"
        )


def test_a_surface_whose_nodes_are_all_clamped_is_refused():
    with pytest.raises(ValueError, match="clamp every contact node"):
        block(n=2, where=lambda domain: facets(domain, 1, 1.0))


def test_conditions_of_another_mesh_are_refused():
    domain, other = (box(COMM, 2, "tri") for _ in range(2))
    spaces = [fem.functionspace(d, ("Lagrange", 1, (2,))) for d in (domain, other)]
    u = fem.Function(spaces[0])
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    held = fem.locate_dofs_topological(spaces[1], 1, facets(other, 1, 1.0))
    bc = fem.dirichletbc(np.zeros(2), held, spaces[1])
    with pytest.raises(ValueError, match="mesh"):
        check(energy, u, [surface], [bc])


def test_forces_that_are_round_off():
    """A part of stiffness times motion; of bodies that are not linear of moduli as well."""
    known = SimpleNamespace(stiffness_scale=10.0, body_size=4.0, bulk=SimpleNamespace(linear=True))
    of = ContactEquations.round_off_force
    assert of(known, 0.5) == pytest.approx(10 * 0.5e-4)
    known.bulk.linear = False
    assert of(known, 0.5) == pytest.approx(10 * 0.5e-4)
    assert of(known, 0.1) == pytest.approx(10 * 4e-5)


def test_resultants_and_what_is_anywhere():
    known = SimpleNamespace(comm=COMM, dim=2, axisymmetric=False)
    f = np.array([[1.0, 2.0], [3.0, -5.0]])
    np.testing.assert_allclose(
        ContactEquations.resultant(known, f), COMM.size * np.array([4.0, -3.0])
    )
    known.axisymmetric = True
    np.testing.assert_allclose(
        ContactEquations.resultant(known, f), COMM.size * np.array([0.0, -3.0])
    )
    last = COMM.rank == COMM.size - 1
    assert ContactEquations._any(known, np.zeros(3), np.array([0.0, float(last)])) is True
    assert ContactEquations._any(known, np.zeros(3), np.zeros(0)) is False


@pytest.mark.parametrize("statuses", [None, [[PLUS, STICK, STICK]]])
def test_points_with_nothing_opposite_are_open(statuses):
    """Whatever their law would have, and multipliers that are removed carry nothing."""
    absent = np.array([False, True, False])
    asked = []

    def law(jump, traction, data, codes):
        asked.append((jump, traction, data, codes))
        return SimpleNamespace(required=np.array([PLUS, PLUS, STICK]))

    law.codes = (OPEN, STICK, PLUS)
    kinematics = SimpleNamespace(jump="jump", data="data", operator=SimpleNamespace(absent=absent))
    s = SimpleNamespace(
        points=SimpleNamespace(traction=lambda m: m.reshape(3, 2)), law_at_points=law
    )
    removed = np.zeros((4, 2), dtype=bool)
    removed[1] = True
    known = SimpleNamespace(
        blocks=lambda x: [np.zeros(2), np.arange(6.0), np.zeros(1)],
        surfaces=[s],
        constraints=SimpleNamespace(removed=[removed]),
        owned_sizes=[2, 6, 1],
        units=[1.0, 10.0, 1.0],
        kinematics=lambda *_: kinematics,
    )
    codes = None if statuses is None else [np.array(c, dtype=np.int8) for c in statuses]
    (found,) = ContactEquations._contact(known, None, None, None, codes)
    traction = 10.0 * np.arange(6.0).reshape(3, 2)
    traction[1] = 0.0
    np.testing.assert_array_equal(found.traction, traction)
    wanted = [PLUS, OPEN, STICK]
    assert found.statuses.tolist() == wanted
    kinematics.operator.absent = None
    (found,) = ContactEquations._contact(known, None, None, None, codes)
    assert found.statuses.tolist() == ([PLUS, PLUS, STICK] if statuses is None else statuses[0])
    assert [a[3] is None for a in asked] == [statuses is None] * 2


def test_what_answers_where_something_is_opposite():
    """Elsewhere nothing, or what is said; of few that are covered it counts by their share."""
    absent = np.array([True, False, False])
    operator = SimpleNamespace(
        absent=absent, share=np.array([0.5, 0.25, 1.0]), mean_around=lambda t: t + 4.0
    )
    rng = np.random.default_rng(3)
    t, tau = rng.normal(size=(2, 3, 2))
    by = rng.normal(size=(3, 2, 2))
    answers = SimpleNamespace(
        traction=lambda codes: tau,
        by_jump=lambda codes: by,
        by_traction=lambda codes: 2 * by,
        spreading=None,
    )
    state = ContactState(SimpleNamespace(operator=operator), t, "codes", answers)
    present = ~absent
    np.testing.assert_array_equal(state.answer, np.where(present[:, None], tau, 0.0))
    np.testing.assert_array_equal(state.by_jump, np.where(present[:, None, None], by, 0.0))
    np.testing.assert_array_equal(state.by_traction, np.where(present[:, None, None], 2 * by, 0.0))
    off = operator.share[:, None] * (t - state.answer) - 4.0 * (1 - operator.share)[:, None]
    np.testing.assert_allclose(state.off, np.where(present[:, None], off, t), rtol=1e-12)
    step = rng.normal(size=(3, 2))
    along = np.einsum("nij,nj->ni", state.by_jump, step)
    np.testing.assert_allclose(state.along(step), along)
    operator.rate, operator.normal_rate = lambda v: step, lambda v: None
    np.testing.assert_allclose(state.change(None), operator.share[:, None] * along)
    operator.absent = operator.share = None
    free = ContactState(SimpleNamespace(operator=operator), t, "codes", answers)
    np.testing.assert_allclose(free.off, t - tau)
    np.testing.assert_allclose(free.change(None), np.einsum("nij,nj->ni", by, step))


@pytest.mark.parametrize("soft", [0.02, 0.18, 0.5, 0.9])
def test_the_augmentation_of_a_soft_body(soft):
    """It falls with the root of what counts as soft: below a half of the mean."""
    problem = block(n=2)
    K = problem.equations.bulk.stiffness(problem.u.x.array.copy())
    extents = np.full(len(problem.u.x.array) // 2, 4.0)
    scale, r, at_vertices = automatic_augmentation(K, soft, problem.V, problem.surfaces, extents)
    _, full, same = automatic_augmentation(K, 1.0, problem.V, problem.surfaces, extents)
    np.testing.assert_allclose(r[0], full[0] * np.sqrt(min(2 * soft, 1.0)), rtol=1e-12)
    np.testing.assert_allclose(at_vertices[0], same[0])
    s = problem.surfaces[0]
    np.testing.assert_allclose(full[0], same[0] * s.points.vertex_areas / 4.0, rtol=1e-12)
    diagonal = K.getDiagonal()
    assert scale == pytest.approx(diagonal.sum() / diagonal.size)
    mean = fem.Function(problem.V)
    n = diagonal.local_size
    mean.x.array[:n] = diagonal.array_r
    mean.x.scatter_forward()
    nodal = mean.x.array.reshape(-1, 2).mean(axis=1)[s.points.vertex_trace_dofs]
    np.testing.assert_allclose(same[0], nodal / s.points.vertex_areas, rtol=1e-12)


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_the_softness_of_an_isotropic_body_of_revolution(poisson):
    """Of 2 mu, twice, and 3 lambda + 2 mu."""
    domain = box(COMM, 2, "quad")
    domain.geometry.x[:, 0] += 1.0
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    material = Axisymmetric(LinearElastic.from_young(1.0, poisson))
    r = 2 * np.pi * ufl.SpatialCoordinate(domain)[0]
    v = ufl.TestFunction(V)
    form = ufl.derivative(ufl.derivative(r * material.energy(u) * ufl.dx, u, v), u)
    K = petsc_matrix(form)
    mu, lame = 1 / (2 * (1 + poisson)), poisson / ((1 + poisson) * (1 - 2 * poisson))
    assert softness(K, V, axisymmetric=True) == pytest.approx(2 * mu / (2 * mu + lame), rel=1e-10)
    K.scale(-1.0)
    assert softness(K, V, axisymmetric=True) == 1.0
    K.zeroEntries()
    assert softness(K, V, axisymmetric=True) == 1.0


def petsc_matrix(form):
    K = assemble_matrix(fem.form(form))
    K.assemble()
    return K


def test_a_body_that_hardly_yields_has_a_least_softness():
    problem = block(n=1, poisson=0.5 - 1e-7)
    assert softness(problem.equations.bulk.for_products, problem.V) == 1e-4


@pytest.mark.parametrize("now", [1.5, 11.0, 0.08])
def test_scales_follow_a_body_that_becomes_stiffer(now):
    """Or softer."""
    domain = box(COMM, 1, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    stiff = fem.Constant(domain, 1.0)
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    energy = stiff * LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    bcs = [fem.dirichletbc(np.zeros(2), top, V)]
    eq = ContactProblem(energy, u, [surface], bcs=bcs).equations
    before = eq.stiffness_scale
    r = eq.surfaces[0].points.r.copy()
    at = eq.scaling.at_vertices[0].copy()
    stiff.value = now
    eq.bulk.stiffness(u.x.array.copy())
    eq.scaling.follow(u.x.array.copy())
    assert eq.stiffness_scale == pytest.approx(now * before)
    np.testing.assert_allclose(eq.surfaces[0].points.r, now * r)
    np.testing.assert_allclose(eq.scaling.at_vertices[0], now * at)
    with eq.scaling.automatic():
        np.testing.assert_allclose(eq.surfaces[0].points.r, now * r)


def test_which_problems_have_many_pieces(monkeypatch):
    """In space those of more points than so many."""
    monkeypatch.setattr(parametric, "_MANY_POINTS", 3)
    for dim, number, many in ((3, 4, True), (3, 3, False), (2, 4, False)):
        known = SimpleNamespace(equations=SimpleNamespace(dim=dim), _num_points=number)
        assert ParametricEquations.has_many_pieces.fget(known) is many


@pytest.mark.parametrize(
    ("whole", "searches", "changed"), [(None, 3, False), (None, 2, True), ("all", 2, False)]
)
def test_when_places_of_sliding_faces_change(whole, searches, changed):
    """With a search, unless all that may ever be opposite is known."""
    known = SimpleNamespace(_faces=SimpleNamespace(whole=whole, searches=3), _searches=searches)
    assert SlidingTerms.changed.fget(known) is changed


def test_numbers_of_unknowns():
    """Of the body, the multipliers and rigid bodies, on all ranks."""
    eq = block(n=2).equations
    assert eq.global_sizes == [18, 6, 0]
    assert COMM.allreduce(sum(eq.owned_sizes)) == 24


def test_motions_that_contact_holds():
    """Of a square without supports all, some or none, by the statuses of its floor."""
    domain = box(COMM, 2, "tri")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    eq = ContactProblem(energy, u, [surface]).equations
    n = eq.surfaces[0].points.number
    words = {c: eq.loose_motions([np.full(n, c, dtype=np.int8)]) for c in (OPEN, STICK, PLUS)}
    assert words[STICK] == ""
    assert words[PLUS] == "translation x"
    assert "translation y" in words[OPEN]
    assert len(words[OPEN]) > len(words[PLUS])
    first = np.arange(n) == (0 if COMM.rank == 0 else -1)
    one = [np.where(first, STICK, OPEN).astype(np.int8)]
    assert "rotation" in eq.loose_motions(one)
    held = block(n=1).equations
    assert held.loose_motions([np.full(held.surfaces[0].points.number, OPEN, dtype=np.int8)]) == ""


# -- where a solve begins -------------------------------------------------------------------------


def test_what_is_closed_and_nothing_beside_what_is_to_come(monkeypatch):
    """By gap and traction of closed points, against the reach and the size of the body."""
    eq = SimpleNamespace(comm=COMM, body_size=2.0, surfaces=["one", "other"])
    reach = 0.0
    monkeypatch.setattr(starts, "_reaches", lambda eq, load, state: [0.0, load * reach])

    def nothing(*points, load=0.5):
        """Whether these are, (status, gap, traction, r) each, of the last rank's second surface."""
        here = points if COMM.rank == COMM.size - 1 else ()
        surfaces = []
        for at in ((), here):
            codes, gap, t, r = np.array(at, dtype=float).reshape(-1, 4).T
            found = SimpleNamespace(
                statuses=codes.astype(np.int8),
                kinematics=SimpleNamespace(gap=gap),
                traction=np.column_stack([np.zeros(len(t)), -t]),
                data=SimpleNamespace(r=r),
            )
            surfaces.append(found)
        return touches_nothing(eq, load, SimpleNamespace(surfaces=surfaces))

    assert nothing()
    assert nothing((OPEN, 1.0, 1.0, 1.0))
    assert nothing((PLUS, 1.9e-9, 0.0, 1.0), (STICK, -1.9e-9, 1.9e-13, 10.0))
    assert not nothing((PLUS, -2.1e-9, 0.0, 1.0))
    assert not nothing((PLUS, 2.1e-9, 0.0, 1.0))
    assert not nothing((STICK, 0.0, 2.1e-13, 10.0))
    reach = 1.0  # of which a half is applied
    assert nothing((PLUS, -4.9e-4, 0.0, 1.0), (STICK, 0.0, 4.9e-3, 10.0))
    assert not nothing((PLUS, -5.1e-4, 0.0, 1.0), (PLUS, 0.0, 0.0, 1.0))
    assert not nothing((STICK, 0.0, 5.1e-3, 10.0))
    assert nothing((PLUS, -9e-4, 0.0, 1.0), load=1.0)


def test_points_that_touch_at_first():
    """Those within a limit stick, or slip where nothing can stick."""
    for codes, touches in (((OPEN, STICK, PLUS), STICK), ((OPEN, PLUS), PLUS)):
        s = SimpleNamespace(law_at_points=SimpleNamespace(codes=codes))
        eq = SimpleNamespace(surfaces=[s, s])
        gaps = [np.array([0.0, 0.5, 0.6]), np.array([-1.0, 0.2])]
        found = _within(eq, gaps, [0.5, 0.1])
        assert [f.tolist() for f in found] == [[touches, touches, OPEN], [touches, OPEN]]
        assert found[0].dtype == np.int8


def test_bodies_are_brought_to_what_they_press():
    """Along their loads, until they touch; and points nearest to a loose body hold it."""
    s = SimpleNamespace(law_at_points=SimpleNamespace(codes=(OPEN, STICK)), method="nodal")
    x = PETSc.Vec().createWithArray(np.array([1.0, 2.0, 0.5, 0.25]), comm=MPI.COMM_SELF)
    kinematics = SimpleNamespace(gap_rate=lambda step: -step)
    state = SimpleNamespace(
        q=np.array([0.5, 0.25]), u=np.zeros(2), surfaces=[SimpleNamespace(kinematics=kinematics)]
    )
    asked = []
    rigid = SimpleNamespace(
        size=2,
        owned=2,
        fixed=np.array([True, False]),
        directions=lambda: np.array([0.0, 1.0]),
        free_distances=lambda gaps, closing: asked.append((gaps, closing)) or np.array([3.0, 3.0]),
        here=lambda v: v,
        nearest=lambda gaps: [0.25],
    )
    eq = SimpleNamespace(
        comm=MPI.COMM_SELF,
        rigid=rigid,
        surfaces=[s],
        contact=lambda x: state,
        gaps=lambda s, state: np.array([0.25, 0.2501, 0.5, 2.0]),
        owned_sizes=[2, 2, 2],
        relative_rate=lambda s, u, q, du, dq: dq,
        body_size=2.0,
        reach=lambda s, u: 0.01,
        prescribed_motions=lambda: np.array([0.9, 7.0]),
        as_possible=lambda codes: codes,
    )
    bring_together(eq, x)
    np.testing.assert_allclose(x.array_r, [1.0, 2.0, 0.5, 3.25])
    ((gaps, closing),) = asked
    np.testing.assert_allclose(gaps[0], [0.25, 0.2501, 0.5, 2.0])
    np.testing.assert_allclose(closing[0], [0.0, 1.0])
    # A part of what data move it, and half of the prescribed motion of the rigid body.
    for load, loose, codes in (
        (1.0, 0, [0, 0, 0, 0]),
        (2.0, 0, [1, 1, 0, 0]),
        (1.0, 1, [1, 0, 0, 0]),
        (1.0, 2, [1, 1, 0, 0]),
        (1.0, 3, [1, 1, 1, 0]),
        (1.0, 4, [1, 1, 1, 1]),
        (1.0, 9, [1, 1, 1, 1]),
    ):
        eq.loose_motions = lambda found, loose=loose: int(found[0].sum()) < loose
        found = touching(eq, load, state)
        assert found[0].tolist() == codes
    eq.rigid = SimpleNamespace(size=0)
    eq.contact = None
    bring_together(eq, x)
    np.testing.assert_allclose(x.array_r, [1.0, 2.0, 0.5, 3.25])


# -- data -----------------------------------------------------------------------------------------


def test_a_part_of_what_is_prescribed():
    """From a start on while it is ramped; all of it before and after."""
    eq = block(n=1, top=(0.5, -0.25)).equations
    given = eq.prescribed
    fixed = eq.constraints.fixed
    whole = np.where(fixed, [0.5, -0.25], 0.0)
    np.testing.assert_allclose(given.values(), whole)
    start = np.full(fixed.shape, 2.0)
    with given.ramped(start):
        start[:] = 99.0
        for part in (0.0, 0.25, 1.0):
            given.part = part
            np.testing.assert_allclose(given.values(), np.where(fixed, 2 + part * (whole - 2), 0.0))
        given.part = 0.5
    assert given.part == 1.0
    np.testing.assert_allclose(given.values(), whole)
    given.unknowns = lambda values: 3 * values + 1
    np.testing.assert_allclose(given.values(), np.where(fixed, 3 * whole + 1, 0.0))
    for bc in given.conditions:
        values = np.full(fixed.size, np.nan)
        bc.set(values)
        there = np.isfinite(values)
        np.testing.assert_allclose(values[there], (3 * whole + 1).reshape(-1)[there])


def law_of(fields, signs, internal=(), radius=0.0):
    """A surface with a law of such fields."""
    n = len(next(iter(fields.values())))
    return SimpleNamespace(
        name="floor",
        comm=COMM,
        memory=None,
        points=SimpleNamespace(data=SimpleNamespace(fields=fields, n=np.zeros((n, 2)))),
        law=SimpleNamespace(
            name="Rubs", signs=signs, internal=internal, needs_time=(), lacks=lambda history: ""
        ),
        law_at_points=LawOf(radius),
        point_data=None,
    )


class LawOf:
    """Answers with a radius of friction; it knows no time."""

    compiled = SimpleNamespace(needs_time=lambda step: False)

    def __init__(self, radius):
        self._radius = radius

    def __call__(self, jump, traction, data):
        return SimpleNamespace(unit_bound=np.full(len(jump), self._radius))


def test_bodies_that_turn_by_half_a_turn_in_a_step():
    """As they are prescribed, or as they are; from the last state on, or from none."""

    def turned(fixed, numbers, values, before=None, displaced=True, friction=True):
        body = SimpleNamespace(
            name="wheel",
            fixed=np.array(fixed),
            values=np.array(values),
            numbers=lambda: np.array(numbers),
        )
        s = SimpleNamespace(
            name="rim",
            comm=COMM,
            dim=2,
            rigid_body=body,
            displaced=SimpleNamespace(friction=friction) if displaced else None,
        )
        check_turn(s, None if before is None else np.array(before))

    held, free = [True, True, True], [True, True, False]
    still, far = [9.0, 9.0, 0.0], [9.0, 9.0, 3.2]
    turned(held, [9.0, 9.0, 3.1], far)
    turned(held, [9.0, 9.0, -3.1], far)
    turned(free, far, still)
    turned(held, far, still, before=[0.0, 0.0, 1.0])
    turned(held, far, still, displaced=False)
    turned(held, far, still, friction=False)
    check_turn(SimpleNamespace(rigid_body=None), None)
    for how in (
        (held, far, still),
        (held, [0.0, 0.0, -3.2], still),
        (free, still, far),
        (held, still, still, [0.0, 0.0, 3.2]),
    ):
        with pytest.raises(ValueError, match=r"rim: the rigid body 'wheel' turns by 3.2 rad"):
            turned(*how)


def test_functions_that_are_to_stay():
    """By a part of their largest value, on whichever rank it changes."""
    domain = box(COMM, 2, "tri")
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    f.x.array[:] = 4.0
    stays = Constancy(COMM, [Datum("the heat", f), Datum("other", fem.Constant(domain, 0.0))])
    last = COMM.rank == COMM.size - 1
    f.x.array[0] += 3.9e-9 * last
    assert stays.changed() == ""
    f.x.array[0] += 1e-8 * last
    assert stays.changed() == "the heat"
    stays.restore()
    np.testing.assert_array_equal(f.x.array, 4.0)


# -- on other ranks -------------------------------------------------------------------------------


class Other:
    """The communicator of another rank, which all others agree with."""

    rank = 1
    size = 2

    def allreduce(self, value, op=None):
        return value

    def allgather(self, value):
        return [value, value]


def test_unknowns_of_rigid_bodies_are_on_the_first_rank():
    shape = HalfSpace((0.0, 0.0), (0.0, 1.0))
    body = RigidBody(shape, about=(1.0, 2.0), free=("x", "y", "rz"))
    surface = SimpleNamespace(rigid_body=body, positions=np.zeros((1, 2)))
    rigid = RigidBodies(SimpleNamespace(mesh=SimpleNamespace(comm=Other())), [surface], 1.0)
    assert (rigid.size, rigid.owned, rigid.here(np.arange(3.0)).size) == (3, 0, 0)


def test_places_of_columns_of_several_ranks():
    """Those of this rank are known by their number, those of others are asked for once each."""
    asked = []

    def places(field, dofs):
        asked.append((field, dofs.tolist()))
        return 100 + dofs

    columns = np.array([3, 9, 1, 6, 9, 7, 2, 4])
    found = _Numbering.column_places(SimpleNamespace(dof_places=places), columns, (3, 7))
    np.testing.assert_array_equal(found, 100 + columns)
    assert asked == [(0, [3, 4, 5, 6, 1, 2, 7, 9])]


def test_how_far_a_prescribed_motion_reaches(monkeypatch):
    """Half of the largest approach; nothing where all points go away, or none is there."""
    rigid = SimpleNamespace(size=3, fixed=np.array([True, False, True]))
    eq = SimpleNamespace(rigid=rigid, comm=COMM, prescribed_motions=lambda: np.array([2.0, 9, -1]))
    state = SimpleNamespace(q=np.array([0.5, 1.0, 1.0]))
    asked = []
    for closing, reach in (([-0.2, 0.6, 0.4], 0.3), ([-0.2, -3.0], 0.0), ([], 0.0)):
        monkeypatch.setattr(
            starts, "_closing", lambda *args, c=closing: asked.append(args[-1]) or np.array(c)
        )
        assert starts._rigid_reach(eq, None, state, 0) == pytest.approx(reach)
    np.testing.assert_allclose(asked, [[1.5, 0.0, -2.0]] * 3)
    rigid.size = 0
    assert starts._rigid_reach(eq, None, state, 0) == 0.0
    assert len(asked) == 3
