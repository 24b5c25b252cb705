"""Faces that slide over each other, integrals over what faces have in common, in numbers."""

from dataclasses import replace
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.blocks import block, box, facets
from test_faces_in_small import segments
from test_pair import displacement, stacked, tagged

from dolfinx_contact import ContactPair, ContactSurface, Coulomb, HalfSpace, NonlocalCoulomb
from dolfinx_contact.laws import PointData
from dolfinx_contact.laws.status import OPEN, PLUS
from dolfinx_contact.meshing import join
from dolfinx_contact.points.clipping import Faces, basis, cover
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.descriptions import Overlap
from dolfinx_contact.points.facing import candidates as facing_candidates
from dolfinx_contact.points.mortar import coupling
from dolfinx_contact.points.sliding import faces as sliding_faces
from dolfinx_contact.points.sliding.candidates import Candidates, _found, from_rows, marks_of
from dolfinx_contact.points.sliding.faces import SlidingFaces, _mirrors
from dolfinx_contact.points.sliding.points import (
    SlidingPoints,
    _require_apart,
    _require_ends,
    _require_no_edge,
)
from dolfinx_contact.points.sliding.spins import spins
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
serial = pytest.mark.skipif(COMM.size > 1, reason="numbers of one rank")


# -- common parts ---------------------------------------------------------------------------------

SQUARE = np.array([[0.0, 0, 0], [2.0, 0, 0], [0.0, 1.0, 0], [2.0, 1.0, 0]])
TRIANGLE = SQUARE[:3]


def flat(x, sense, height=0.0):
    """Facets in space at a height, that look up or down."""
    x = np.reshape(x, (-1, *np.shape(x)[-2:])) + np.array([0.0, 0.0, height])
    normals = np.tile([0.0, 0.0, sense], (len(x), 1))
    return Faces(x, normals, np.arange(x[..., 0].size).reshape(len(x), -1))


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize(("mine", "theirs"), [(3, 3), (3, 4), (4, 3), (4, 4)])
def test_rules_are_exact_for_products(mine, theirs, degree):
    """Of whole facets monomials of the degree, of quadrilaterals in each direction."""
    shapes = {3: TRIANGLE, 4: SQUARE}
    slave, master = flat(shapes[mine], 1.0), flat(shapes[theirs], -1.0, 0.5)
    found = cover(slave, master, np.array([[0, 0]]), 0.0, least=0.0)
    rule = found.rule(degree)
    x = np.einsum("pqk,pkd->pqd", basis(rule.mine, mine, 1), slave.x[found.facet])
    t, w = np.polynomial.legendre.leggauss(8)
    t, w = (1.0 + t) / 2, w / 2
    s, t = np.meshgrid(t, t)
    weights = np.outer(w, w)
    if 3 in (mine, theirs):  # what both have is the triangle
        weights, t = weights * (1.0 - s), t * (1.0 - s)
    X, Y = 2.0 * s, t
    for i in range(degree + 1):
        for j in range(degree + 1):
            if i + j <= degree or 4 in (mine, theirs):
                exact = 2.0 * np.sum(weights * X**i * Y**j)
                value = np.sum(rule.weights * x[..., 0] ** i * x[..., 1] ** j)
                assert value == pytest.approx(exact, rel=1e-12)
    theirs_at = np.einsum("pqk,pkd->pqd", basis(rule.theirs, theirs, 1), master.x[found.other])
    np.testing.assert_allclose(theirs_at - x, np.broadcast_to([0, 0, 0.5], x.shape), atol=1e-12)


def test_nodes_opposite_to_corners_in_space():
    """Those corners that pieces have, and where they are in the other facet."""
    slave = flat(SQUARE, 1.0)
    shifted = SQUARE + np.array([1.0, 0.0, 0.0])
    found = cover(slave, flat(shifted, -1.0, 0.25), np.array([[0, 0]]), 0.0)
    nodes, theirs, weights = found.places()
    assert set(nodes.tolist()) == {1, 3}
    np.testing.assert_array_equal(theirs, np.tile(np.arange(4), (len(nodes), 1)))
    at = np.einsum("nk,kd->nd", weights, shifted)
    np.testing.assert_allclose(at, SQUARE[nodes], atol=1e-12)


def test_layers_that_fit():
    """Up to a thousandth of a facet too much, which is overlap; then the nearest alone."""
    slave = segments((0.0, 1.0, 0.0, True))
    pairs = np.array([[0, 0], [0, 1]])
    for more, seen in ((0.9e-3, {0, 1}), (1.1e-3, {1})):
        master = segments((0.0, 0.5, 0.3, False), (0.5 - more, 1.0, 0.2, False))
        found = cover(slave, master, pairs, 0.0)
        assert set(found.other.tolist()) == seen
    one = found[np.array([0])]
    assert one.facet.tolist() == [0]
    np.testing.assert_allclose(one.pieces, found.pieces[:1])


@pytest.mark.ranks(2)
def test_facets_that_may_be_opposite():
    """All that lie opposite at up to 60 degrees, of any rank, are among those that are found."""
    rng = np.random.default_rng(4)
    n = 40
    a = rng.uniform(0.0, 10.0, (2, n, 1))
    size = rng.uniform(0.05, 1.5, (2, n, 1))
    x = np.stack([np.concatenate([a, a + size], axis=2), np.zeros((2, n, 2))], axis=3)
    x[1, ..., 1] = rng.uniform(0.1, 3.0, (n, 1))
    mine = np.arange(COMM.rank, n, COMM.size)
    nodes = np.arange(2 * n).reshape(n, 2)
    normals = np.array([[0.0, 1.0], [0.0, -1.0]])
    slave, master = (
        Faces(x[i][mine], np.tile(normals[i], (len(mine), 1)), nodes[mine]) for i in range(2)
    )
    faces, pairs = facing_candidates(COMM, slave, master)
    found = {(mine[i], faces.nodes[k, 0] // 2) for i, k in pairs}
    assert len(found) == len(pairs)
    np.testing.assert_allclose(faces.x, x[1][faces.nodes[:, 0] // 2])
    np.testing.assert_array_equal(faces.normals, np.tile(normals[1], (len(faces.x), 1)))
    middles = x.mean(axis=2)
    radius = size[..., 0] / 2
    distance = np.linalg.norm(middles[0][:, None] - middles[1], axis=2)
    closest = distance.min(axis=1)
    # What is no farther than twice as far as the nearest middle, and half of both sizes.
    wanted = distance <= 2.0 * closest[:, None] + radius[0][:, None] + radius[1]
    assert {(i, k) for i, k in np.argwhere(wanted) if i in mine} <= found
    most = distance <= 2.0 * (closest[:, None] + radius[1].max()) + radius[0][:, None] + 1e-12
    assert found == {(i, k) for i, k in np.argwhere(most) if i in mine}


# -- bodies of revolution -------------------------------------------------------------------------


def around(a, b, f):
    """The integral of 2 pi r f(r) from a to b."""
    t, w = np.polynomial.legendre.leggauss(6)
    r = (a + b) / 2 + (b - a) / 2 * t
    return 2.0 * np.pi * (b - a) / 2 * np.sum(w * r * f(r))


def hats_of(a, b, low, high):
    """Integrals of the two hats on the segment from a to b over a part of it."""
    left = around(low, high, lambda r: (b - r) / (b - a))
    return left, around(low, high, lambda r: (r - a) / (b - a))


def test_mortar_weights_of_revolution():
    """Areas are swept; int psi N of other facets; of like ones diagonal, the areas themselves."""
    slave = segments((1.0, 2.0, 0.0, True), (2.0, 4.0, 0.0, True))
    pairs = np.array([[i, k] for i in range(2) for k in range(2)])
    like = segments((1.0, 2.0, 0.1, False), (2.0, 4.0, 0.1, False))
    other = segments((0.5, 3.0, 0.1, False), (3.0, 5.0, 0.1, False))
    ends = [(1.0, 2.0), (2.0, 4.0)]
    areas = [hats_of(a, b, a, b) for a, b in ends]
    for master in (like, other):
        found = coupling(cover(slave, master, pairs, 0.0), 1, axisymmetric=True)
        np.testing.assert_allclose(found.areas, areas, rtol=1e-13)
        D = np.zeros((4, 4))
        np.add.at(D, (found.slave, found.master), found.values)
        hats = np.zeros(4)
        for k, (c, d) in enumerate(master.x[..., 0]):
            low, high = max(c, 1.0), min(d, 4.0)
            hats[2 * k : 2 * k + 2] = hats_of(c, d, low, high)
        np.testing.assert_allclose(D.sum(axis=0), hats, rtol=1e-12)
        np.testing.assert_allclose(D.sum(axis=1), np.ravel(areas), rtol=1e-12)
        if master is like:
            np.testing.assert_allclose(D, np.diag(np.ravel(areas)), atol=1e-12)
    plane = coupling(cover(slave, like, pairs, 0.0), 1, axisymmetric=False)
    np.testing.assert_allclose(plane.areas, [[0.5, 0.5], [1.0, 1.0]], rtol=1e-13)


@pytest.mark.ranks(2)
def test_gauss_points_of_a_ring():
    """Their areas are swept, as those of vertices are, whose circumferences are means."""
    n = 4
    domain = box(COMM, n, "tri")
    domain.geometry.x[:, 0] += 1.0
    u = displacement(domain)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    given = dict(obstacle=floor, law=Coulomb(0.3), method="integral", axisymmetric=True)
    points = discretise(ContactSurface(u, facets(domain, 1, 0.0), **given)).points
    r = points.vertices.tabulate_dof_coordinates()[:, 0]
    swept = np.zeros(len(r))
    for side in (-1.0, 1.0):
        for i, at in enumerate(r):
            low, high = sorted((at, float(np.clip(at + side / n, 1.0, 2.0))))
            swept[i] += around(low, high, lambda s, at=at: 1.0 - np.abs(s - at) * n)
    np.testing.assert_allclose(points.vertex_areas, swept, rtol=1e-12)
    sections = np.where((r < 1.1) | (r > 1.9), 0.5 / n, 1.0 / n)
    np.testing.assert_allclose(points.circumferences, swept / sections, rtol=1e-12)
    assert COMM.allreduce(float(points.areas.sum())) == pytest.approx(3.0 * np.pi, rel=1e-12)
    R = points.positions[:, 0]
    assert COMM.allreduce(float(points.areas @ R)) == pytest.approx(14.0 / 3.0 * np.pi, rel=1e-12)
    np.testing.assert_allclose(points.at_vertices(np.ones(points.number)), 1.0, rtol=1e-12)


@pytest.mark.ranks(2)
def test_points_of_what_rings_have_in_common():
    """Of faces that do not match the areas are swept, and radii are those of the points."""
    bodies = []
    for n, z in ((2, 0.0), (3, 1.0)):
        body = box(COMM, n, "tri")
        body.geometry.x[:, 0] += 1.0
        body.geometry.x[:, 1] += z
        bodies.append(body)
    both = stacked_of(bodies)
    u = displacement(both.mesh)
    given = dict(slave=3, master=2, law=Coulomb(0.3), method="integral", axisymmetric=True)
    pair = discretise(ContactPair(u, both, **given))
    points = pair.points
    assert type(points).__name__ == "CommonFacetPoints"
    R = points.positions[:, 0]
    for power, whole in ((0, 3.0 * np.pi), (1, 14.0 / 3.0 * np.pi), (2, 15.0 / 2.0 * np.pi)):
        total = COMM.allreduce(float(points.areas @ R**power))
        assert total == pytest.approx(whole, rel=1e-12)
    u.interpolate(lambda x: np.stack([0.1 * x[0], 0.2 * x[0]]))
    np.testing.assert_allclose(points.operator.apply(owned(pair, u)), 0.0, atol=1e-13)


def stacked_of(bodies):
    """Bodies one over the other, with tags 2 and 3 on their faces at y = 1."""
    tags = [tagged(body, **{f"t{2 + i}": (1, 1.0)}) for i, body in enumerate(bodies)]
    return join(bodies, facet_tags=tags)


def owned(pair, u):
    return u.x.array.reshape(-1, pair.dim)[: pair.owned_nodes]


# -- candidates and images ------------------------------------------------------------------------


def test_marks_of_images():
    """A number for the axes of their planes, and the sense; from it both are known again."""
    senses = np.array([1.0, -1.0])
    for mirror, expected in (
        ((1, 1), 1),
        ((-1, 1), 2),
        ((1, -1), 3),
        ((-1, -1), 4),
        ((1, 1, -1), 5),
        ((-1, 1, -1), 6),
        ((-1, -1, -1), 8),
    ):
        marks = marks_of(senses, np.array(mirror))
        np.testing.assert_array_equal(marks, expected * senses)
        rows = np.column_stack([marks, [[4, 7], [7, 2]]]).astype(np.int64)
        pairs = np.array([[0, 0], [0, 1]])
        found = _found(rows, pairs, len(mirror))
        np.testing.assert_array_equal(found.senses, senses)
        np.testing.assert_array_equal(found.mirrors, np.tile(mirror, (2, 1)))
        np.testing.assert_array_equal(found.known, [2, 4, 7])
        np.testing.assert_array_equal(found.places, [[1, 2], [2, 0]])
        assert found.pairs is pairs


def test_all_facets_for_all():
    """Every one once, for each of the slave, in the order of both."""
    rows = np.array([[1, 5, 6], [-1, 3, 4], [1, 5, 6]])
    found = from_rows(rows, 3, 2)
    np.testing.assert_array_equal(found.nodes, [[3, 4], [5, 6]])
    np.testing.assert_array_equal(found.senses, [-1.0, 1.0])
    np.testing.assert_array_equal(found.pairs, [[i, k] for i in range(3) for k in range(2)])
    np.testing.assert_array_equal(found.mirrors, 1.0)


def test_mirrors_of_planes():
    assert _mirrors({}, 2).tolist() == [[1.0, 1.0]]
    assert _mirrors({1: 0.0}, 2).tolist() == [[1.0, 1.0], [1.0, -1.0]]
    both = _mirrors({0: 0.5, 2: 0.0}, 3).tolist()
    assert both[0] == [1.0, 1.0, 1.0]
    assert sorted(both[1:]) == [[-1.0, 1.0, -1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, -1.0]]


def test_images_behind_planes():
    """Of what is nearer to a plane than rays reach; at twice the distance, of the other sense."""
    x = np.array([[[0.7, 0.0], [1.7, 0.0]], [[2.0, 1.0], [0.71, 1.0]], [[5.0, 0.0], [6.0, 0.0]]])
    faces = SimpleNamespace(
        _mirrors=_mirrors({0: 0.5}, 2),
        _planes=np.array([0.5, 0.0]),
        _master_nodes=np.array([[3, 4], [5, 6], [7, 8]]),
        _master_sense=np.array([-1.0, 1.0, -1.0]),
    )
    faces._behind_planes = lambda mirrors: SlidingFaces._behind_planes(faces, mirrors)
    np.testing.assert_array_equal(
        faces._behind_planes(np.array([[-1, 1], [1, -1]])), [[1, 0], [0, 0]]
    )
    for reach, images in ((0.205, 1), (0.215, 2), (0.1, 0), (9.0, 3)):
        found, marks = SlidingFaces._masters(faces, x, reach)
        np.testing.assert_array_equal(found.x[:3], x)
        np.testing.assert_allclose(found.x[3:], x[:images] * [-1.0, 1.0] + [1.0, 0.0])
        np.testing.assert_array_equal(marks, [-1, 1, -1, *[2, -2, 2][:images]])
        np.testing.assert_array_equal(found.nodes, faces._master_nodes[[0, 1, 2, *range(images)]])
        np.testing.assert_allclose(found.normals, np.tile([0.0, 1.0], (3 + images, 1)))


def test_facets_that_share_a_node():
    """The same node at the same place; images have those that lie on their planes."""
    nodes = np.array([[0, 1], [5, 6]])
    theirs = np.array([[1, 2], [1, 2], [3, 4], [6, 5]])
    reference = np.array([[[0.0, 0.0], [1.0, 0.0]], [[4.0, 0.0], [5.0, 0.0]]])
    before = np.array(
        [
            [[1.0, 0.9e-6], [2.0, 0.0]],
            [[1.0, 1.1e-6], [2.0, 0.0]],
            [[1.0, 0.0], [0.0, 0.0]],
            [[5.0, 0.0], [4.0, 1.0]],
        ]
    )
    found = SimpleNamespace(pairs=np.array([[0, 0], [0, 1], [0, 2], [1, 3], [0, 3]]), nodes=theirs)
    faces = SimpleNamespace(
        slave_nodes=lambda: nodes, _before=lambda found: before, _reference=reference, _skin=1.0
    )
    shares = SlidingFaces._shares_node(faces, found)
    np.testing.assert_array_equal(shares, [True, False, False, True, False])


@serial
@pytest.mark.parametrize(("most", "some"), [(6, True), (5, False)])
def test_all_pairs_of_facets(most, some, monkeypatch):
    """Where they are few; nodes are those of the facets with the senses of these."""
    monkeypatch.setattr(sliding_faces, "_FEW_PAIRS", most)
    faces = SimpleNamespace(
        corners=np.zeros((3, 2)),
        _master_nodes=np.array([[7, 8], [2, 3]]),
        _master_sense=np.array([1.0, -1.0]),
        comm=COMM,
        dim=2,
    )
    found = SlidingFaces.whole.func(faces)
    assert (found is not None) is some
    if some:
        np.testing.assert_array_equal(found.nodes, [[2, 3], [7, 8]])
        np.testing.assert_array_equal(found.senses, [-1.0, 1.0])
        assert len(found.pairs) == 6


@pytest.mark.parametrize("direction", [None, np.array([0.0, 1.0])])
def test_pieces_that_face_each_other(direction):
    """Of two faces at 84 degrees, of one at 60; weights are those of the mesh, swept or not."""
    least = 84.2 if direction is None else 60.0
    reference = np.array([[[1.0, 0.0], [3.0, 0.0]]])
    mine = np.array([[[0.0, 0.0], [1.0, 0.0]]])
    for off, seen in ((-0.5, True), (0.5, False)):
        a = np.deg2rad(least + off)
        theirs = np.array(
            [[[-9.0 * np.cos(a), -9.0 * np.sin(a)], [9.0 * np.cos(a), 9.0 * np.sin(a)]]]
        )
        theirs[..., 0] += 0.5
        sides = (
            Faces(mine, np.array([[0.0, 1.0]]), np.zeros((1, 0), dtype=int)),
            Faces(theirs, np.array([[np.sin(a), -np.cos(a)]]), np.array([[0, 1]])),
        )
        faces = SimpleNamespace(
            _faces=lambda *_, sides=sides: sides,
            _found=SimpleNamespace(pairs=np.array([[0, 0]])),
            _deepest=np.array([1.0]),
            _depth=1.0,
            _direction=direction,
            dim=2,
            corners=np.array([[0, 1]]),
            _reference=reference,
            _axisymmetric=False,
        )
        faces._measure = lambda x, at, faces=faces: SlidingFaces._measure(faces, x, at)
        for swept, whole in ((False, 2.0), (True, 8.0 * np.pi)):
            faces._axisymmetric = swept
            facet, master, shape, weights, _ = SlidingFaces._pieces(faces, mine, theirs)
            assert (len(facet), len(master)) == (seen, seen)
            assert weights.sum() == pytest.approx(whole * seen)
            x = np.einsum("pqa,pad->pqd", shape, reference[facet])
            moment = np.sum(weights * x[..., 0])
            wanted = 52.0 * np.pi / 3.0 if swept else 4.0
            assert moment == pytest.approx(wanted * seen)


def test_areas_of_facets_by_those_of_reference_facets():
    """At any place; of parallelograms the same everywhere."""
    at = np.array([[[0.25, 0.5], [1.0, 0.0]]])
    faces = SimpleNamespace(dim=3)
    np.testing.assert_allclose(SlidingFaces._measure(faces, SQUARE[None], at), [[2.0, 2.0]])
    np.testing.assert_allclose(SlidingFaces._measure(faces, TRIANGLE[None], at), [[2.0, 2.0]])
    kite = np.array([[[0.0, 0, 0], [2.0, 0, 0], [0.0, 1.0, 0], [2.0, 3.0, 0]]])
    np.testing.assert_allclose(SlidingFaces._measure(faces, kite, at), [[3.0, 6.0]])
    faces.dim = 2
    line = np.array([[[0.0, 1.0], [3.0, 5.0]]])
    np.testing.assert_allclose(SlidingFaces._measure(faces, line, at[..., :1]), [[5.0, 5.0]])


@pytest.mark.parametrize("smaller", [2, 3])
def test_how_far_rays_reach(smaller):
    """A quarter of the smaller face, of two by one here, where no distance is given."""
    both = stacked(2, "quad", 2, gap=0.1)
    x = both.mesh.geometry.x
    upper = x[:, 1] > 1.05
    x[upper == (smaller == 2), 0] *= 2.0
    u = displacement(both.mesh)
    given = dict(slave=3, master=2, law=Coulomb(0.3), sliding="large")
    assert discretise(ContactPair(u, both, **given)).points.depth == pytest.approx(0.25)
    assert discretise(ContactPair(u, both, search_distance=0.7, **given)).points.depth == 0.7


class Searched(Exception):
    pass


@pytest.mark.parametrize(
    ("slave", "master", "turn", "again"),
    [
        (0.3, 0.2, 0.25, False),
        (0.3, 0.2, 0.27, True),
        (0.31, 0.2, 0.25, True),
        (0.3, 0.21, 0.25, True),
        (1.01, 0.0, 0.0, True),
        (0.0, 0.99, 0.0, False),
    ],
)
def test_when_candidates_are_searched_for_anew(slave, master, turn, again):
    """When nodes of both, and rays of length 2, have moved farther than a facet, here of 1."""
    place = np.zeros((2, 2, 2))
    normals = np.tile([0.0, 1.0], (2, 1))
    moved, turned, others = place.copy(), normals.copy(), place.copy()
    moved[1, 0] = [0.6 * slave, -0.8 * slave]
    others[0, 1] = [0.0, master]
    turned[1, 0] = turn

    def masters(*_):
        raise Searched

    faces = SimpleNamespace(
        _slave_at=lambda x: Faces(moved, turned, None),
        _master=np.arange(4).reshape(2, 2),
        searches=1,
        _then=(place, normals, place),
        _depth=2.0,
        _skin=1.0,
        comm=COMM,
        _masters=masters,
    )
    x = others.reshape(4, 2)
    far = slave + master + 2.0 * turn
    assert again is (far > 1.0 + 1e-12)
    if again:
        with pytest.raises(Searched):
            SlidingFaces._search(faces, x)
    else:
        SlidingFaces._search(faces, x)
    faces.searches = 0
    with pytest.raises(Searched):
        SlidingFaces._search(faces, x)
    x[0, 0] = np.nan
    with pytest.raises(ValueError, match="positions of a contact pair are not finite"):
        SlidingFaces._search(faces, x)


def test_how_deep_a_face_may_be_in_itself():
    """Half of the thickness behind, and of how deep it starts; not farther than rays reach."""
    pairs = np.array([[0, 1], [0, 2], [1, 3], [1, 2], [2, 0], [3, 0], [3, 2]])
    shared = np.array([False, False, False, False, True, False, False])
    first = {(0, 1): 0.2}
    second = {(0, 2): 0.6, (1, 3): 0.5, (1, 2): 0.3, (3, 2): 3.0}
    asked = []

    def behind(given):
        table = second if asked else first
        asked.append({tuple(p) for p in given.tolist()})
        rows = [p for p in given.tolist() if tuple(p) in table]
        ways = np.array([table[tuple(p)] for p in rows])
        return np.array(rows, dtype=int).reshape(-1, 2), ways

    directions = []
    faces = SimpleNamespace(
        _direction="up",
        _X=None,
        searches=1,
        _found=SimpleNamespace(pairs=pairs, nodes=np.zeros((4, 2))),
        _shares_node=lambda found: shared,
        _within_the_body=lambda: np.array([True, False, False, True]),
        corners=np.zeros((4, 2)),
        _behind=behind,
        _depth=1.25,
    )
    faces._search = lambda x: directions.append(faces._direction)
    found = SlidingFaces._deepest_of_itself(faces)
    np.testing.assert_allclose(found, [0.4, 0.15, 1.25, 1.25])
    np.testing.assert_array_equal(faces.lost, [False, False, False, True])
    assert (directions, faces._direction, faces.searches) == ([None], "up", 0)
    assert asked[0] == {(0, 1), (0, 2), (3, 0), (3, 2)}
    assert asked[1] == {(0, 2), (1, 3), (1, 2), (3, 0), (3, 2)}
    # Half of what is below the reach counts whole.
    asked.clear()
    second[(3, 2)] = 2.0
    np.testing.assert_allclose(SlidingFaces._deepest_of_itself(faces)[3], 1.0)


def test_edges_of_a_slave():
    """Angles of facets that fall back behind the normal of a node; not of hollows."""

    def sharpest(*points):
        x = np.array(points, dtype=float)
        first = np.arange(len(x) - 1)
        corners = np.stack([first, first + 1], axis=1)
        sides = x[corners]
        along = sides[:, 1] - sides[:, 0]
        vectors = np.stack([-along[:, 1], along[:, 0]], axis=1)  # upwards

        def at_nodes(of_facets):
            found = np.zeros_like(x)
            np.add.at(found, corners, of_facets[:, None])
            return found

        faces = SimpleNamespace(
            _reference=sides,
            _area_vectors=lambda x: vectors,
            at_nodes=at_nodes,
            corners=corners,
            dim=2,
            comm=COMM,
        )
        return SlidingFaces.sharpest_edge(faces)

    a = np.deg2rad(20.0)
    angle, place = sharpest(
        (-np.cos(a), -np.sin(a)), (0, 0), (np.cos(a), -np.sin(a)), (2.0, -np.sin(a))
    )
    assert angle == pytest.approx(20.0)
    np.testing.assert_array_equal(place, [0.0, 0.0])
    angle, place = sharpest((-1.0, 1.0), (0, 0), (1.0, 1.0))
    assert angle == 0.0
    # A long facet turns the normal to itself, so that the short one is farther off.
    angle, place = sharpest((0.0, 0.0), (4.0, 0.0), (4.0, -3.0))
    assert angle == pytest.approx(np.degrees(np.arctan2(4.0, 3.0)))
    np.testing.assert_array_equal(place, [4.0, 0.0])
    assert sharpest((0.0, 0.0))[0] == 0.0


@pytest.mark.parametrize(("area", "held"), [(1.0, True), (0.99e7, True), (1.01e7, False)])
def test_means_at_the_nodes_of_a_slave(area, held):
    """Of gaps and slips by weights; which share of its area has to be covered, and how little is
    nothing; where there is nothing the gap is as far as rays reach."""
    corners = np.array([[0, 1], [1, 2]])

    def sums(facet, values):
        found = np.zeros((4, *values.shape[2:]))
        np.add.at(found, corners[facet], values)
        return found

    faces = SimpleNamespace(
        sums=sums,
        _no_gap=1e-15,
        removed=np.array([0.0, 0.0, 0.25, 9.0]),
        _depth=7.0,
        kept=np.array([[1.0, 1.0], [0.0, 1.0], [1.0, 1.0], [1.0, 1.0]]),
        free_to_spin=np.array([1.0, 0.0, 1.0, 1.0]),
    )
    weighted = np.array([[[0.25, 0.75]], [[0.01, 0.01]]])
    around = np.array([[0.2, 0.4], [0.005, 0.0025]])
    gap = np.array([[0.3], [0.9e-15]])
    slip = np.array([[[[1.0, 2.0], [3.0, 4.0]]], [[[5.0, 6.0], [7.0, 8.0]]]])
    spin = np.array([[0.5, 0.1], [0.7, -0.2]])
    m = np.array([[0.0, 2.0], [3.0, 4.0], [0.0, -5.0], [1.0, 0.0]])
    before = np.ones((4, 2))
    areas = np.array([1.0, 1.0, area, 1.0])
    nodal = SlidingFaces._nodal(
        faces, np.arange(2), weighted, around, gap, slip, spin, m=m, before=before, areas=areas
    )
    last = 0.01 if held else 0.0
    np.testing.assert_allclose(nodal.weight, [0.25, 0.76, last, 0.0])
    share = {1.0: 0.2, 0.99e7: 0.01 / (0.05 * 0.99e7)}.get(area, 1.0)
    np.testing.assert_allclose(nodal.share, [1.0, 1.0, share, 1.0])
    np.testing.assert_allclose(nodal.around, [0.2, 0.405, 0.0025 if held else 0.0, 0.0])
    np.testing.assert_allclose(nodal.gap, [0.3, 0.225 / 0.76, 0.25 if held else 7.0, 7.0])
    second = [0.0, (0.75 * 4.0 + 0.01 * 6.0) / 0.76]
    third = [7.0, 8.0] if held else [0.0, 0.0]
    np.testing.assert_allclose(nodal.slip, [[1.0, 2.0], second, third, [0.0, 0.0]])
    np.testing.assert_allclose(nodal.spin, [0.5, 0.0, 0.7 * held, 0.0])
    np.testing.assert_allclose(nodal.apart, [0.1, 0.0, -0.2 * held, 0.0])
    np.testing.assert_allclose(nodal.length, [2.0, 5.0, 5.0, 1.0])
    np.testing.assert_allclose(nodal.normal, [[0, 1.0], [0.6, 0.8], [0, -1.0], [1.0, 0]])
    assert nodal.before is before


@pytest.mark.parametrize("k", [3, 4])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_angles_by_which_facets_spin(k, sense):
    """About their outward normal, however they are stretched; rates by differences."""
    rng = np.random.default_rng(k)
    before = np.array([TRIANGLE if k == 3 else SQUARE] * 5)
    before = before + 0.1 * rng.normal(size=before.shape) * (k == 3)
    tilt = Rotation.random(random_state=1).as_matrix()
    before = before @ tilt.T
    out = sense * np.cross(before[:, 1] - before[:, 0], before[:, 2] - before[:, 0])
    out /= np.linalg.norm(out, axis=1)[:, None]
    angles = np.array([0.0, 0.3, -1.2, 2.5, 3.1])
    turns = Rotation.from_rotvec(angles[:, None] * out).as_matrix()
    now = 1.7 * np.einsum("nij,nkj->nki", turns, before) + rng.normal(size=(5, 1, 3))
    senses = np.full(5, sense)
    np.testing.assert_allclose(spins(before, now, senses)[0], angles, atol=1e-12)
    now = now + 0.05 * rng.normal(size=now.shape)
    change = rng.normal(size=now.shape)
    h = 1e-6
    plus, minus = (spins(before, now + s * h * change, senses)[0] for s in (1, -1))
    rates = spins(before, now, senses)[1]
    difference = np.angle(np.exp(1j * (plus - minus))) / (2 * h)
    np.testing.assert_allclose(np.sum(rates * change, axis=(1, 2)), difference, atol=1e-6)
    flat_angles, flat_rates = spins(before[:, :2, :2], now[:, :2, :2], senses)
    assert not flat_angles.any()
    assert flat_rates.shape == (5, 2, 2)


# -- the operator of faces that slide -------------------------------------------------------------


def sliding(dim, cell, n=2, gap=0.1, **given):
    """A pair of boxes, the upper one the slave, and whether nodes are of that."""
    both = stacked(dim, cell, n, gap=gap)
    u = displacement(both.mesh)
    given = dict(slave=3, master=2, law=Coulomb(0.3), search_distance=0.4) | given
    pair = discretise(ContactPair(u, both, sliding="large", **given))
    return pair, pair.node_positions[: pair.owned_nodes, -1] > 1.05


@pytest.mark.ranks(2)
def test_facets_that_slips_have_passed():
    """Slips over the size of the facets of the master, here of a half; weights are of the mesh."""
    for dim, cell in ((3, "tet"), (2, "tri"), (3, "hex")):
        of_facets_that_are_passed(dim, cell)


def of_facets_that_are_passed(dim, cell):
    pair, upper = sliding(dim, cell)
    u = np.zeros((pair.owned_nodes, dim))
    u[upper, 0] = 0.1
    operator = pair.points.at(u, None)
    np.testing.assert_allclose(operator.facets_passed, 0.2, rtol=1e-10)
    nodal = operator.facing.nodal
    np.testing.assert_allclose(nodal.gap, 0.1, rtol=1e-10)
    slip = np.zeros((len(nodal.slip), dim))
    slip[:, 0] = 0.1
    np.testing.assert_allclose(nodal.slip, slip, atol=1e-12)
    assert COMM.allreduce(float(operator.areas.sum())) == pytest.approx(0.9, rel=1e-10)
    assert not operator.absent.any()
    # Both twice as long, which changes no weight, and the gap of 0.1 twice as large.
    operator = pair.points.at(pair.node_positions[: pair.owned_nodes].copy(), None)
    assert COMM.allreduce(float(operator.areas.sum())) == pytest.approx(1.0, rel=1e-10)
    np.testing.assert_allclose(operator.facing.nodal.gap, 0.2, rtol=1e-10)


@serial
def test_means_of_the_tractions_around():
    """Of the next nodes, by what their functions share with that of the node."""
    pair, upper = sliding(2, "tri", 3)
    operator = pair.points.at(np.zeros((pair.owned_nodes, 2)), None)
    order = np.argsort(pair.positions[:, 0])
    t = np.zeros((4, 2))
    t[order] = [[1.0, 2.0], [4.0, -3.0], [0.0, 8.0], [6.0, 1.0]]
    expected = [[4.0, -3.0], [0.5, 5.0], [5.0, -1.0], [0.0, 8.0]]
    np.testing.assert_allclose(operator.mean_around(t)[order], expected, atol=1e-12)
    np.testing.assert_allclose(operator.at_quadrature(np.ones((4, 2))), 1.0, rtol=1e-12)
    np.testing.assert_allclose(operator.share, 1.0)
    # Where nothing is opposite a node has no traction that others could take.
    u = np.zeros((pair.owned_nodes, 2))
    u[upper, 0] = 0.7
    operator = pair.points.at(u, None)
    np.testing.assert_array_equal(operator.absent[order], [False, False, True, True])
    found = operator.mean_around(t)[order]
    np.testing.assert_allclose(found, [[4.0, -3.0], [1.0, 2.0], [0, 0], [0, 0]], atol=1e-12)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dim", [2, 3])
def test_entries_of_the_operator(dim):
    """They add up to what it does to displacements, and forces do the work of tractions."""
    pair, upper = sliding(dim, "tri" if dim == 2 else "tet")
    rng = np.random.default_rng(COMM.rank)
    x = pair.node_positions[: pair.owned_nodes]
    u = 0.05 * np.sin(3.0 * x)
    operator = pair.points.at(u, None)
    v = np.cos(2.0 * x[:, ::-1]) + upper[:, None]
    jump = operator.apply(v)
    t = rng.normal(size=jump.shape)
    work = COMM.allreduce(float(np.sum(operator.areas[:, None] * t * jump)))
    forces = operator.transpose(t).reshape(-1, dim)
    assert COMM.allreduce(float(np.sum(forces * v))) == pytest.approx(work, rel=1e-10)
    if COMM.size == 1:
        vertices, nodes, values = operator.entries()
        found = np.zeros((len(pair.points.vertex_trace_dofs), dim))
        parts = np.einsum("pac,pcd->pad", values, v[nodes])
        np.add.at(found, vertices, parts)
        np.testing.assert_allclose(found[: operator.number], jump, atol=1e-12)


# -- what is refused ------------------------------------------------------------------------------


def test_slaves_that_lie_in_a_plane_of_symmetry():
    """Whose normals have a tenth or less along it."""
    _require_ends(COMM, np.array([0.11, 1.0]), "s")
    with pytest.raises(ValueError, match=f"looks? across it at {2 * COMM.size} nodes"):
        _require_ends(COMM, np.array([0.09, 0.0, 0.11]), "s")


def test_slaves_that_have_an_edge():
    """From 35 degrees on."""
    points = object.__new__(SlidingPoints)
    points.comm = COMM
    for angle, fits in ((34.9, True), (35.0, True), (35.1, False)):
        points.faces = SimpleNamespace(sharpest_edge=lambda a=angle: (a, np.array([0.5, 2.0])))
        if fits:
            _require_no_edge(points, "s")
        else:
            with pytest.raises(ValueError, match=r"an edge at \(0.5, 2\), .* is 35 degrees"):
                _require_no_edge(points, "s")


@pytest.mark.parametrize(
    ("most", "gap", "behind", "words"),
    [
        (0.0, -1.9e-3, 0.5, None),
        (0.0, -2.1e-3, 0.0, "overlap by 0.0021; interference=True .*, or remove_overlap"),
        (0.0, 0.0, 0.51, "0.51 behind the slave, farther .* 0.5: .*; interference=True"),
        (0.1, -0.1, 0.5, None),
        (0.1, -0.1, 0.51, "0.51 behind the slave, .*; take a larger search_distance"),
        (0.1, -0.11, 0.0, "overlap by 0.11; interference allows 0.1"),
    ],
)
def test_faces_that_start_in_each_other(most, gap, behind, words):
    """By more than a thousandth of a facet, here of 2, or is allowed; farther than rays reach."""
    nodal = SimpleNamespace(gap=np.array([0.3, gap, -99.0]))
    points = SimpleNamespace(
        known=SimpleNamespace(facing=SimpleNamespace(nodal=nodal)),
        number=2,
        comm=COMM,
        mean_width=2.0,
        depth=0.5,
        whole_size=10.0,
        faces=SimpleNamespace(
            lost=np.array([False, False]), farthest_behind=lambda far: behind * (far == 10.0)
        ),
    )
    if words is None:
        _require_apart(points, "s", Overlap(most), itself=False)
    else:
        with pytest.raises(ValueError, match=words):
            _require_apart(points, "s", Overlap(most), itself=False)
    nodal.gap[1] = 0.0
    _require_apart(points, "s", Overlap(most), itself=True)
    points.faces.lost[1] = True
    with pytest.raises(ValueError, match=f"s: {COMM.size} facets start in the body, .* 0.5"):
        _require_apart(points, "s", Overlap(most), itself=True)


def test_nodes_that_leave_their_plane():
    """Owned nodes that are not held across it; or are moved by more than a billionth."""
    across = np.array([[True, False], [False, False], [True, True], [True, False]])
    points = SimpleNamespace(
        _owned_nodes=3,
        comm=COMM,
        dim=2,
        _opposite=SimpleNamespace(across=across, planes={0: 0.5, 1: 2.0}),
    )
    fixed = across.copy()
    SlidingPoints.require_held(points, fixed, "s")
    fixed[3] = False
    SlidingPoints.require_held(points, fixed, "s")
    fixed[2, 1] = fixed[0, 0] = False
    with pytest.raises(ValueError, match=f"let {2 * COMM.size} nodes leave the plane"):
        SlidingPoints.require_held(points, fixed, "s")
    moved = np.zeros((6, 2))
    moved[1] = 7.0
    moved[0, 1] = 7.0
    moved[2] = [0.9e-8, -0.9e-8]
    SlidingPoints.require_in_place(points, moved, 10.0, "s")
    moved[2] = [1.1e-8, -1.2e-8]
    with pytest.raises(ValueError, match=r"by 1.2e-08 off the plane of symmetry y = 2,"):
        SlidingPoints.require_in_place(points, moved, 10.0, "s")
    moved[2] = [-0.25, 0.25]
    with pytest.raises(ValueError, match=r"by 0.25 off the plane of symmetry x = 0.5,"):
        SlidingPoints.require_in_place(points, moved, 10.0, "s")


def test_what_else_says_what_points_meet():
    """Numbers for records, without the digits that depend on how many ranks there are."""
    taken = SimpleNamespace(x=SimpleNamespace(array=np.array([0.0, 0.1234567891])))
    none = SimpleNamespace(removed_overlap=None, comm=COMM)
    assert ContactPoints.choices.fget(none) == []
    some = SimpleNamespace(removed_overlap=taken, comm=COMM)
    assert ContactPoints.choices.fget(some) == [0.123457]
    points = SimpleNamespace(
        faces=SimpleNamespace(removed=np.array([0.0, 0.1234567891])),
        _opposite=SimpleNamespace(planes={1: 2.0, 0: 0.5}),
        depth=0.7,
        comm=COMM,
    )
    assert SlidingPoints.choices.fget(points) == [0.7, 0.0, 0.5, 1.0, 2.0, 0.123457]


# -- how pairs have moved, and laws among points --------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kernel", ["biweight", "mollifier"])
def test_rates_of_friction_that_spreads(kernel):
    """By differences of what the law answers, of which one point that is open takes no part."""
    s = block(n=4, law=NonlocalCoulomb(0.3, 0.6, kernel)).surfaces[0]
    law, data = s.law_at_points, s.points.data
    number = len(data.n)
    x = s.positions[:, 0]
    jump = np.column_stack([0.2 + 0.1 * x, 0.01 * np.sin(x)])
    traction = np.column_stack([-0.3 + 0.1 * x, 1.0 + x**2])
    dn = np.column_stack([np.cos(x), np.zeros(number)])
    dg, df = 0.2 * x, np.cos(3.0 * x)
    codes = np.where(np.abs(x - 0.25) < 1e-9, OPEN, PLUS).astype(np.int8)
    moved = np.stack([np.sin(x), 0.3 * np.cos(x)], axis=1)
    rates = PointData(dn, dg, np.zeros(number), {"friction": df})
    h = 1e-6
    for motion in (moved, None):

        def answer(step, motion=motion):
            fields = {**data.fields, "friction": data.fields["friction"] + step * df}
            given = replace(data, n=data.n + step * dn, gap=data.gap + step * dg, fields=fields)
            now = jump if motion is None else jump + step * motion
            return law(now, traction, given, codes).traction(codes)

        difference = (answer(h) - answer(-h)) / (2 * h)
        found = law.rate(jump, traction, data, rates, codes, motion)
        size = COMM.allreduce(float(np.abs(difference).max(initial=0.0)), op=max)
        np.testing.assert_allclose(found, difference, atol=1e-7 * size)


@serial
def test_what_distinguishes_points():
    """Of a Gauss point the input nodes of its facet in their order, of a vertex its own."""
    for method in ("nodal", "integral"):
        points = block(n=3, method=method).surfaces[0].points
        domain = points._V.mesh
        x = domain.geometry.x[:, 0]
        numbers = np.asarray(domain.geometry.input_global_indices)
        foot = np.flatnonzero(np.abs(domain.geometry.x[:, 1]) < 1e-9)
        ends = {round(float(x[i]), 6): int(numbers[i]) for i in foot}
        at = points.vertices.tabulate_dof_coordinates()[:, 0]
        own = np.array([ends[round(float(a), 6)] for a in at])
        np.testing.assert_array_equal(points.vertex_ids, np.column_stack([own, 0 * own]))
        if method == "nodal":
            np.testing.assert_array_equal(points.ids, points.vertex_ids)
            continue
        low = np.floor(3.0 * points.positions[:, 0]) / 3.0
        pairs = [sorted((ends[round(a, 6)], ends[round(a + 1.0 / 3.0, 6)])) for a in low.tolist()]
        np.testing.assert_array_equal(points.ids, pairs)


def test_a_search_of_nothing():
    """A search without anything of the master finds nothing, on whichever rank."""
    empty = Faces(np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros((0, 2), dtype=np.int64))
    found = from_rows(np.zeros((0, 3), dtype=np.int64), 2, 2)
    assert isinstance(found, Candidates)
    assert (len(found.nodes), len(found.pairs), len(found.known)) == (0, 0, 0)
    faces, pairs = facing_candidates(COMM, segments((0.0, 1.0, 0.0, True)), empty)
    assert (len(faces.x), pairs.shape) == (0, (0, 2))
