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

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, RigidBody, Sphere
from dolfinx_contact.equations.measures import Measures, Scales, _row_measures
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.equations.sliding import _of_law, _on_master, _Pieces
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.materials import LinearElastic

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
    s, found = contact_at(
        [[0.0, 1.0]], [0.25], [[0.0, 8.0]], [STICK], [2.0], [0.5]
    )
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
    facing = SimpleNamespace(
        weighted=weighted, along=along, rays=SimpleNamespace(slopes=slopes)
    )
    shape = np.broadcast_to(along, (p, q, a, dim, e))
    expected = np.einsum("pai,pqa,pqcj->paicj", by_gap, weighted, gaps)
    expected += np.einsum("paik,pqa,pqake,pqecj->paicj", by_slip, weighted, shape, places)
    found = _of_law(facing, by_gap, by_slip, places, gaps)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-12)
    expected = np.einsum("pqbe,pqi,pqecj->pbicj", slopes, t, places)
    np.testing.assert_allclose(_on_master(facing, t, places), expected, rtol=1e-11, atol=1e-12)
