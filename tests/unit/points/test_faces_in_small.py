"""Common parts of faces, rays between them, and where points are on them, without a mesh."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation

from dolfinx_contact import HalfSpace, RigidBody
from dolfinx_contact._geometry import area_vector_rates, area_vectors
from dolfinx_contact.points.clipping import Faces, basis, cover, nodal_points
from dolfinx_contact.points.crossings import _in_loops
from dolfinx_contact.points.descriptions import Overlap
from dolfinx_contact.points.search import nearest, within
from dolfinx_contact.points.sliding.facing import Facing, Nodal
from dolfinx_contact.points.sliding.rays import cast, slopes

COMM = MPI.COMM_WORLD
TENSOR = [0, 1, 3, 2]  # from around a facet to tensor order and back


# -- common parts ---------------------------------------------------------------------------------


def half_planes(polygon):
    """Rows (a, b) with a.x + b <= 0 inside a convex polygon (k, 2)."""
    hull = ConvexHull(polygon)
    return hull.equations


def intersection(p, q):
    """Area and first moments of what two convex polygons have in common."""
    rows = np.vstack([half_planes(p), half_planes(q)])
    # The largest circle inside, by linear programming on a fine set of candidates.
    from scipy.optimize import linprog

    norms = np.linalg.norm(rows[:, :2], axis=1)
    best = linprog(
        [0, 0, -1],
        A_ub=np.column_stack([rows[:, :2], norms]),
        b_ub=-rows[:, 2],
        bounds=[(None, None), (None, None), (0, None)],
    )
    if best.status != 0 or best.x[2] < 1e-7:
        return 0.0, np.zeros(2)
    corners = HalfspaceIntersection(rows, best.x[:2]).intersections
    hull = ConvexHull(corners)
    loop = corners[hull.vertices]
    x, y = loop, np.roll(loop, -1, axis=0)
    double = x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]
    return double.sum() / 2, (double[:, None] * (x + y)).sum(axis=0) / 6


def convex(k, rng, size=1.0):
    """A triangle, or a parallelogram in tensor order, of either sense."""
    if k == 3:
        while True:
            x = rng.normal(size=(3, 2)) * size
            if abs(np.linalg.det(x[1:] - x[0])) > 0.3 * size**2:
                return x
    a, b = rng.normal(size=(2, 2)) * size
    while abs(np.linalg.det([a, b])) < 0.3 * size**2:
        a, b = rng.normal(size=(2, 2)) * size
    start = rng.normal(size=2) * 0.5 * size - (a + b) / 2
    return np.array([start, start + a, start + b, start + a + b])


@pytest.mark.parametrize("kinds", [(3, 3), (3, 4), (4, 3), (4, 4)])
def test_common_parts_of_facets_in_space(kinds):
    """Areas and centres as of half planes; points lie at the same place of both facets."""
    rng = np.random.default_rng(sum(kinds) + kinds[0])
    n = 12
    flat = [[convex(k, rng) for _ in range(n)] for k in kinds]
    turn = Rotation.random(random_state=3).as_matrix()
    gap = 0.1
    # In the frame (x, y, height), turned and moved.
    faces = []
    for facets, height, sense in zip(flat, (0.0, gap), (1.0, -1.0), strict=True):
        x = np.array([np.pad(f, ((0, 0), (0, 1)), constant_values=height) for f in facets])
        normals = np.tile([0.0, 0.0, sense], (n, 1)) @ turn.T
        faces.append(
            Faces(x @ turn.T + [5.0, 6.0, 7.0], normals, np.arange(x[..., 0].size).reshape(n, -1))
        )
    slave, master = faces
    pairs = np.array([(i, i) for i in range(n)] + [(i, (i + 1) % n) for i in range(n)])
    areas = [abs(intersection_area_of(f)) for f in flat[0]]
    for i, j in pairs:
        found = cover(slave, master, np.array([(i, j)]), 0.0, least=0.0)
        area, moment = intersection(flat[0][i], flat[1][j])
        rule = found.rule(2)
        assert rule.weights.sum() == pytest.approx(area, abs=1e-9)
        mine = basis(rule.mine, kinds[0], 1) @ slave.x[i]
        theirs = basis(rule.theirs, kinds[1], 1) @ master.x[j]
        if area == 0:
            continue
        where = (np.tensordot(rule.weights, mine, 2) / area - [5, 6, 7]) @ turn
        np.testing.assert_allclose(where, [*(moment / area), 0.0], atol=1e-8)
        np.testing.assert_allclose(
            theirs - mine, gap * np.broadcast_to(turn[:, 2], mine.shape), atol=1e-9
        )
        assert (found.facet == i).all()
        assert (found.other == j).all()
        share = area / areas[i]
        for least, kept in ((0.99 * share, True), (1.01 * share, False)):
            assert (
                len(cover(slave, master, np.array([(i, j)]), 0.0, least=least).facet) > 0
            ) is kept


def intersection_area_of(f):
    return intersection(f, f)[0]


def segment(a, b, y, up):
    return np.array([[a, y], [b, y]]), np.array([0.0, 1.0 if up else -1.0])


def segments(*rows):
    x, normals = zip(*(segment(*row) for row in rows), strict=True)
    return Faces(np.array(x), np.array(normals), np.arange(2 * len(x)).reshape(-1, 2))


def test_common_parts_of_segments():
    """Their lengths and places, whichever way they run."""
    slave = segments((0.0, 1.0, 0.0, True), (3.0, 1.0, 0.0, True))
    master = segments((0.75, 2.0, 0.1, False), (0.25, -1.0, 0.2, False), (2.5, 2.0, 0.0, False))
    pairs = np.array([(i, j) for i in range(2) for j in range(3)])
    found = cover(slave, master, pairs, 0.05)
    rule = found.rule(3)
    parts = {
        (0, 0): (0.75, 1.0, 0.1),
        (0, 1): (0.0, 0.25, 0.2),
        (1, 0): (1.0, 2.0, 0.1),
        (1, 2): (2.0, 2.5, 0.0),
    }
    assert set(zip(found.facet.tolist(), found.other.tolist(), strict=True)) == set(parts)
    for i, j, w, mine, theirs in zip(
        found.facet, found.other, rule.weights, rule.mine, rule.theirs, strict=True
    ):
        a, b, gap = parts[i, j]
        assert w.sum() == pytest.approx(b - a)
        x = basis(mine, 2, 1) @ slave.x[i]
        y = basis(theirs, 2, 1) @ master.x[j]
        assert w @ x[:, 0] ** 3 == pytest.approx((b**4 - a**4) / 4)
        np.testing.assert_allclose(y - x, np.tile([0.0, gap], (len(x), 1)), atol=1e-12)
    # Nodes of the slave that something is opposite to, and of what.
    nodes, theirs, weights = found.places()
    seen = {}
    for node, other, weight in zip(nodes, theirs, weights, strict=True):
        seen.setdefault(int(node), []).append((other.tolist(), weight.round(9).tolist()))
    assert set(seen) == {0, 1, 3}
    assert seen[0] == [([2, 3], [0.8, 0.2])]
    assert seen[1] == [([0, 1], [0.8, 0.2])]
    assert seen[3] == [([0, 1], [0.8, 0.2])]


def test_what_does_not_face():
    """Too deep, too far, too steep, too little, or behind what is nearer."""
    slave = segments((0.0, 1.0, 0.0, True))
    one = np.array([(0, 0)])

    def covered(master, pairs=one, deepest=0.0, **how):
        found = cover(slave, master, pairs, deepest, **how)
        return sorted(set(found.other.tolist()))

    above = segments((0.0, 1.0, 0.3, False))
    below = segments((0.0, 1.0, -0.3, False))
    assert covered(above) == [0]
    assert covered(above, farthest=0.31) == [0]
    assert covered(above, farthest=0.29) == []
    assert covered(below, deepest=0.31) == [0]
    assert covered(below, deepest=0.29) == []
    assert covered(below, deepest=np.array([0.31])) == [0]
    assert covered(segments((0.0, 1.0, 0.3, True))) == []
    for angle, seen in ((59.0, [0]), (61.0, [])):
        a = np.deg2rad(angle)
        steep = Faces(
            np.array([[[0.0, 0.0], [2 * np.cos(a), 2 * np.sin(a)]]]),
            np.array([[np.sin(a), -np.cos(a)]]),
            np.array([[0, 1]]),
        )
        assert covered(steep, steep=0.5) == seen
    for width, seen in ((0.06, [0]), (0.04, [])):
        assert covered(segments((0.3, 0.3 + width, 0.1, False))) == seen
    both = np.array([(0, 0), (0, 1), (0, 2)])
    stacked = segments((0.0, 1.0, 0.5, False), (0.0, 1.0, 0.2, False), (0.0, 1.0, 0.3, False))
    assert covered(stacked, both) == [1]
    parted = segments((0.0, 0.5, 0.5, False), (0.5, 1.0, 0.2, False), (0.0, 1.0, 0.6, False))
    assert covered(parted, both) == [0, 1]
    deep = segments((0.0, 1.0, -0.1, False), (0.0, 1.0, 0.2, False), (0.0, 1.0, -0.3, False))
    assert covered(deep, both, deepest=1.0) == [0]


def test_nodes_of_facets():
    """Every function of a basis is one at its node and zero at the others."""
    for corners, degree, number in (
        (2, 1, 2),
        (2, 2, 3),
        (3, 1, 3),
        (3, 2, 6),
        (4, 1, 4),
        (4, 2, 9),
    ):
        x = nodal_points(corners, degree)
        assert len(x) == number
        np.testing.assert_allclose(basis(x, corners, degree), np.eye(number), atol=1e-12)
    assert basis(np.zeros((0, 4, 2)), 4, 1).shape == (0, 4, 4)


# -- rays -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("corners", [2, 3, 4])
def test_rays_from_points_to_facets(corners):
    """They meet at their gap; place and gap change as differences have it."""
    rng = np.random.default_rng(corners)
    dim = 2 if corners == 2 else 3
    p, q = 3, 2
    reference = nodal_points(corners, 1)
    plane = np.column_stack([reference, np.zeros(corners)]) + 0.1 * rng.normal(
        size=(p, corners, dim)
    )
    x = np.concatenate([0.3 * np.ones((p, q, dim - 1)), -0.5 * np.ones((p, q, 1))], axis=2)
    x += 0.05 * rng.normal(size=x.shape)
    m = np.zeros((p, q, dim))
    m[..., -1] = 2.0
    m += 0.2 * rng.normal(size=m.shape)
    start = np.full((p, q, dim - 1), 0.4)

    def places(x, m, y):
        rays = cast(x, m, y, start)
        return rays, np.einsum("pqb,pbd->pqd", rays.weights, y)

    rays, met = places(x, m, plane)
    n = m / np.linalg.norm(m, axis=-1, keepdims=True)
    np.testing.assert_allclose(rays.normal, n, rtol=1e-13)
    np.testing.assert_allclose(rays.length, np.linalg.norm(m, axis=-1), rtol=1e-13)
    np.testing.assert_allclose(x + rays.gap[..., None] * n, met, atol=1e-12)
    np.testing.assert_allclose(rays.weights.sum(axis=2), 1.0, rtol=1e-12)
    # Slopes of the weights, by differences; the facet of the slave has the points' basis N.
    eta = rng.uniform(size=(p, q, dim - 1))
    h = 1e-6
    for i in range(dim - 1):
        step = h * np.eye(dim - 1)[i]
        difference = (basis(eta + step, corners, 1) - basis(eta - step, corners, 1)) / (2 * h)
        np.testing.assert_allclose(slopes(eta, corners)[..., i], difference, atol=1e-8)
    assert start[0, 0, 0] == 0.4
    N = rng.uniform(size=(p, q, corners))
    facing = SimpleNamespace(rays=rays, basis=N)
    dx, dm, dy = (rng.normal(size=(p, corners, dim)) for _ in range(3))
    at = np.einsum("pqa,pad->pqd", N, dx), np.einsum("pqa,pad->pqd", N, dm)

    def coordinates(sign):
        moved = cast(x + sign * h * at[0], m + sign * h * at[1], plane + sign * h * dy, start)
        weights = moved.weights
        # Places are linear in the weights of corners 1 and 2 (and 3).
        eta = weights @ reference
        return eta, moved.gap

    (eta_1, gap_1), (eta_0, gap_0) = coordinates(1), coordinates(-1)
    by_differences = (eta_1 - eta_0) / (2 * h), (gap_1 - gap_0) / (2 * h)
    found = Facing.moved(facing, dx, dm, dy)
    for a, b in zip(found, by_differences, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)
    by_places, by_gaps = Facing.slopes(facing)
    every = np.concatenate([dx, dm, dy], axis=1)
    np.testing.assert_allclose(np.einsum("pqecj,pcj->pqe", by_places, every), found[0], atol=1e-11)
    np.testing.assert_allclose(np.einsum("pqcj,pcj->pq", by_gaps, every), found[1], atol=1e-11)
    known = SimpleNamespace(spins=(dx, dy))
    known.spin_slopes = lambda: Facing.spin_slopes(known)
    ux, uy = rng.normal(size=(2, p, corners, dim))
    expected = np.einsum("pcj,pcj->p", known.spin_slopes(), np.concatenate([ux, dm, uy], axis=1))
    np.testing.assert_allclose(Facing.spun(known, ux, uy), expected, rtol=1e-11)
    weighted = rng.uniform(size=(p, q, corners))
    mass = Facing.mass.fget(SimpleNamespace(weighted=weighted, basis=N))
    whole = np.einsum("pqa,pqb->pab", weighted, N)
    for a in range(corners):
        whole[:, a, a] = 0.0
    np.testing.assert_allclose(mass, whole, rtol=1e-12)


@pytest.mark.parametrize(("k", "dim"), [(2, 2), (3, 3), (4, 3)])
def test_area_vectors_and_their_rates(k, dim):
    """As long as the facet is large; a plane one is a parallelogram."""
    rng = np.random.default_rng(k)
    x = rng.normal(size=(4, k, dim))
    vectors = area_vectors(x)
    if k == 2:
        along = x[:, 1] - x[:, 0]
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), np.linalg.norm(along, axis=1))
        np.testing.assert_allclose(np.sum(vectors * along, axis=1), 0.0, atol=1e-13)
        assert (np.linalg.det(np.stack([vectors, along], axis=1)) > 0).all()
    else:
        a, b = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
        if k == 4:
            x[:, 3] = x[:, 1] + b
            vectors = area_vectors(x)
        share = 0.5 if k == 3 else 1.0
        np.testing.assert_allclose(vectors, share * np.cross(a, b), atol=1e-12)
    change = rng.normal(size=x.shape)
    h = 1e-6
    difference = (area_vectors(x + h * change) - area_vectors(x - h * change)) / (2 * h)
    found = np.einsum("nikj,nkj->ni", area_vector_rates(x), change)
    np.testing.assert_allclose(found, difference, atol=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_jumps_of_nodes_of_faces(dim):
    """The slip of before, turned to the normal of now and about it, and the gap along it."""
    rng = np.random.default_rng(dim)
    n = 5
    unit = lambda v: v / np.linalg.norm(v, axis=1)[:, None]  # noqa: E731
    before = unit(rng.normal(size=(n, dim)))
    length = rng.uniform(1.0, 2.0, n)
    slip = rng.normal(size=(n, dim))
    slip -= np.sum(slip * before, axis=1)[:, None] * before
    m = length[:, None] * unit(before + 0.4 * rng.normal(size=(n, dim)))
    gap, spin = rng.normal(size=(2, n))
    none = np.zeros(n)

    def nodal(m, spin=spin, slip=slip, gap=gap):
        size = np.linalg.norm(m, axis=1)
        normal = m / size[:, None]
        return Nodal(none, none, none, gap, slip, normal, size, before, spin, none)

    found = nodal(m)
    normal = found.normal
    for i in range(n):
        o, w = (np.pad(v[i], (0, 3 - dim)) for v in (before, normal))
        axis = np.cross(o, w)
        angle = np.arctan2(np.linalg.norm(axis), o @ w)
        turned = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
        if dim == 3:
            turned = Rotation.from_rotvec(w * spin[i]).as_matrix() @ turned
        now = (turned @ np.pad(slip[i], (0, 3 - dim)))[:dim]
        np.testing.assert_allclose(found.slip_now[i], now, atol=1e-12)
        np.testing.assert_allclose(found.jump[i], now - gap[i] * normal[i], atol=1e-12)
    h = 1e-6
    change = rng.normal(size=(n, dim))
    difference = (nodal(m + h * change).normal - nodal(m - h * change).normal) / (2 * h)
    dn = np.einsum("nij,nj->ni", found.by_normal, change)
    np.testing.assert_allclose(dn, difference, atol=1e-8)
    difference = (nodal(m, spin + h).slip_now - nodal(m, spin - h).slip_now) / (2 * h)
    np.testing.assert_allclose(found.by_spin, difference if dim == 3 else 0.0, atol=1e-8)
    # By the normal: what turns with it, and the rest.
    difference = (nodal(m + h * change).slip_now - nodal(m - h * change).slip_now) / (2 * h)
    along = np.sum(normal * found.slip_now, axis=1)[:, None]
    crossed = dn * along - normal * np.sum(dn * found.slip_now, axis=1)[:, None]
    rest = np.einsum("nij,nj->ni", found.by_turning, dn)
    np.testing.assert_allclose(crossed + rest, difference, atol=1e-7)
    if dim == 2:
        np.testing.assert_allclose(rest, 0.0, atol=1e-12)


# -- how pairs have moved -------------------------------------------------------------------------


# -- others ---------------------------------------------------------------------------------------


def test_edges_that_are_of_loops():
    """A loop and what is between two; not a tail, nor a tree, on any rank."""

    def edges(*pairs):
        return np.array([(0, i, a, b) for i, (a, b) in enumerate(pairs)], dtype=np.int64).reshape(
            -1, 4
        )

    ring = edges((1, 2), (2, 3), (3, 1))
    tail = edges((3, 7), (7, 8))
    bridge = edges((3, 4), (10, 11))
    other = edges((4, 5), (5, 6), (6, 4))
    assert _in_loops([ring], 0).tolist() == [True] * 3
    assert _in_loops([tail, ring], 0).tolist() == [False, False]
    assert _in_loops([tail, ring], 1).tolist() == [True] * 3
    assert _in_loops([ring, bridge, other], 1).tolist() == [True, False]
    assert _in_loops([ring, bridge, other], 2).tolist() == [True] * 3
    assert _in_loops([edges((1, 2), (1, 2))], 0).tolist() == [True, True]
    assert _in_loops([edges(), ring], 0).tolist() == []
    assert _in_loops([edges()], 0).tolist() == []


def test_overlaps_that_are_allowed():
    """None, any, or up to a length; as a press fit, or removed."""
    assert Overlap.of("s", False, None) == Overlap(0.0, False)
    assert Overlap.of("s", True, None) == Overlap(np.inf, False)
    assert Overlap.of("s", 0.5, None) == Overlap(0.5, False)
    assert Overlap.of("s", False, 0.5) == Overlap(0.5, True)
    presses = [
        Overlap.of("s", *given).presses for given in ((False, None), (0.5, None), (False, 0.5))
    ]
    assert presses == [False, True, False]
    for interference, removed, words in (
        (0.0, None, "interference must be True, False"),
        (-1.0, None, "interference must be True, False"),
        (np.inf, None, "interference must be True, False"),
        ("x", None, "interference must be True, False"),
        (False, 0.0, "remove_overlap must be the largest"),
        (False, True, "remove_overlap must be the largest"),
        (True, 0.5, "a press fit, or is removed"),
        (0.5, 0.5, "a press fit, or is removed"),
    ):
        with pytest.raises(ValueError, match=words):
            Overlap.of("s", interference, removed)
    some = Overlap(0.5)
    for worst, beyond in (
        (-0.5, False),
        (-0.5 - 4e-10, False),
        (-0.5 - 6e-10, True),
        (1.0, False),
        (np.nan, True),
    ):
        assert some.exceeded_by(worst) is beyond
    some.require(COMM, -0.5, 0.0, "s", "else")
    Overlap().require(COMM, -1e-3, 1e-3, "s", "else")
    with pytest.raises(ValueError, match=r"overlap by 0.6; interference allows 0.5"):
        some.require(COMM, -0.6, 0.0, "s", "else")
    with pytest.raises(ValueError, match=r"overlap by 0.6; remove_overlap allows 0.5"):
        Overlap(0.5, True).require(COMM, -0.6, 0.0, "s", "else")
    with pytest.raises(
        ValueError, match=r"overlap by 0.002; interference=True for a press fit, else"
    ):
        Overlap().require(COMM, -2e-3, 1e-3, "s", "else")


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dim", [2, 3])
def test_places_that_other_ranks_know(dim):
    """The nearest of all, and how many lie around."""
    rng = np.random.default_rng(5)
    every = rng.uniform(size=(COMM.size, 20, dim)) + 0.8 * np.arange(COMM.size)[:, None, None]
    known = np.column_stack([every[COMM.rank], np.full(20, float(COMM.rank)), np.arange(20.0)])
    wanted = rng.uniform(-0.5, 0.5 + COMM.size, size=(15, dim))
    whole = every.reshape(-1, dim)
    distance = np.linalg.norm(wanted[:, None] - whole, axis=2)
    found = nearest(COMM, known, wanted, dim)
    rank, number = np.divmod(distance.argmin(axis=1), 20)
    np.testing.assert_array_equal(
        found, np.column_stack([whole[distance.argmin(axis=1)], rank, number])
    )
    counts = within(COMM, known[:, :dim], wanted, 0.4)
    np.testing.assert_array_equal(counts, (distance <= 0.4).sum(axis=1))
    nothing = nearest(COMM, known[:0], wanted, dim)
    assert np.isinf(nothing).all()
    assert (within(COMM, known[:0, :dim], wanted, 0.4) == 0).all()
    assert nearest(COMM, known, wanted[:0], dim).shape == (0, dim + 2)


# -- rigid bodies ---------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("size", [1.0, 1e-5, 0.0])
def test_motions_of_rigid_bodies(dim, size):
    """Rotations of any angle, what moves with the body, and at what rate, by differences."""
    rng = np.random.default_rng(dim)
    along, turns = ["x", "y", "z"][:dim], ["rz"] if dim == 2 else ["rx", "ry", "rz"]
    about = rng.normal(size=dim)
    shape = HalfSpace(np.zeros(dim), np.eye(dim)[0])
    body = RigidBody(shape, about=about, free=[*along, *turns])
    k = len(body.components)
    assert body.components == (*along, *turns) or list(body.components) == [*along, *turns]
    values = np.concatenate([rng.normal(size=dim), size * rng.normal(size=k - dim)])
    x = rng.normal(size=(4, dim))

    def matrix(values):
        return Rotation.from_rotvec(np.pad(values[dim:], (3 - (k - dim), 0))).as_matrix()[
            :dim, :dim
        ]

    Q = matrix(values)
    np.testing.assert_allclose(body.frame(values), Q, atol=1e-14)
    now = about + values[:dim] + (x - about) @ Q.T
    np.testing.assert_allclose(body.carried(x, values), now - x, atol=1e-13)
    np.testing.assert_allclose(body.seen(now, values), x, atol=1e-13)
    change = rng.normal(size=k)
    h = 1e-6

    def carried(step):
        return x + body.carried(x, values + step * change)

    difference = (carried(h) - carried(-h)) / (2 * h)
    np.testing.assert_allclose(body.rate(now, values, change), difference, atol=1e-8)
    spin = body.spin(values) @ change[dim:]
    dQ = (matrix(values + h * change) - matrix(values - h * change)) / (2 * h)
    v = rng.normal(size=(4, dim))
    np.testing.assert_allclose(body.crossed(spin, v), v @ (dQ @ Q.T).T, atol=1e-8)
    # Small motions, and the forces that do work on them.
    field = body.field(x, change)
    none = np.zeros(k)
    difference = (body.carried(x, none + h * change) - body.carried(x, none - h * change)) / (2 * h)
    np.testing.assert_allclose(field, difference, atol=1e-8)
    forces = rng.normal(size=x.shape)
    assert body.resultant(x, forces) @ change == pytest.approx(np.sum(forces * field))
    moved = rng.normal(size=dim)
    np.testing.assert_allclose(body.resultant(x + moved, forces, moved), body.resultant(x, forces))


def test_which_components_a_free_motion_moves():
    """All but those of a point on the axis of what turns alone."""
    shape = HalfSpace((0.0, 0.0), (1.0, 0.0))
    x = np.array([[1.0, 2.0], [1.0, 5.0], [4.0, 2.0], [4.0, 5.0]])
    for given, expected in (
        ({"free": ["x"], "held": ["y", "rz"]}, [[1, 0]] * 4),
        ({"held": ["x", "y", "rz"]}, [[0, 0]] * 4),
        ({"load": {"rz": 2.0}, "held": ["x", "y"]}, [[0, 0], [1, 0], [0, 1], [1, 1]]),
        ({"load": {"rz": 2.0, "y": 1.0}, "held": ["x"]}, [[0, 1], [1, 1], [0, 1], [1, 1]]),
    ):
        body = RigidBody(shape, about=(1.0, 2.0), **given)
        np.testing.assert_array_equal(body.moves(x), np.array(expected, dtype=bool))
        turns = "rz" not in given.get("held", ())
        assert (body.turns, body.turns_freely) == (turns, turns)
        assert body.flat is not turns
    driven = RigidBody(shape, about=(1.0, 2.0), motion={"rz": 0.5}, held=["x", "y"])
    assert (driven.turns, driven.turns_freely, driven.flat) == (True, False, False)
    driven.values = np.array([1.0, 2.0, 3.0])
    assert driven.displacement.tolist() == [1.0, 2.0]
    assert driven.rotation.tolist() == [3.0]
    assert driven.numbers().tolist() == [0.0, 0.0, 0.5]
    words = "rigid body about [1.0, 2.0], {'x': 0.0, 'y': 0.0, 'rz': 0.5}, held [True, True, True]"
    assert driven.described() == words


def test_rigid_bodies_that_are_refused():
    shape = HalfSpace((0.0, 0.0), (1.0, 0.0))
    every = {"free": ["x", "y", "rz"]}
    body = RigidBody(shape, about=(0.0, 0.0), **every)
    for how, words in (
        ({"about": (0.0,), **every}, "the reference point must be 2 finite numbers"),
        ({"about": (0.0, np.nan), **every}, "the reference point must be 2 finite numbers"),
        ({"about": "xy", **every}, "the reference point must be 2 finite numbers"),
        ({"about": (0.0, 0.0), "free": ["x", "y"]}, "not given: rz"),
        ({"about": (0.0, 0.0), "free": ["x", "y", "z", "rz"]}, "unknown component 'z'"),
        ({"about": (0.0, 0.0), "held": ["x"], **every}, "the component x is given twice"),
        ({"about": (0.0, 0.0), "free": ["x", "x", "y", "rz"]}, "named twice"),
        ({"about": (0.0, 0.0), "free": "x"}, "free and held must be a list"),
        ({"about": (0.0, 0.0), "free": [1, "y", "rz"]}, "a component must be a word"),
        ({"about": (0.0, 0.0), "load": 3.0, **every}, "go by component"),
        (
            {"about": (0.0, 0.0), "load": {"x": True}, "free": ["y", "rz"]},
            "number or a UFL scalar",
        ),
        (
            {"about": (0.0, 0.0), "load": {"x": np.inf}, "free": ["y", "rz"]},
            "must be a finite number",
        ),
        (
            {"about": (0.0, 0.0), "load": {"x": "1"}, "free": ["y", "rz"]},
            "number or a UFL scalar",
        ),
        ({"about": (0.0, 0.0), "name": "", **every}, "the name of a rigid body must be a word"),
    ):
        with pytest.raises(ValueError, match=words):
            RigidBody(shape, **how)
    for other in (body, 3.0):
        with pytest.raises(ValueError, match="its shape must be"):
            RigidBody(other, about=(0.0, 0.0), **every)
