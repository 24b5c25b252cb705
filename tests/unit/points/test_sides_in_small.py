"""Facets, nodes and obstacles of small meshes, and what is given there, in numbers."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import block, box, facets
from test_pair import displacement, tagged

import basix.ufl
import ufl
from dolfinx import fem, mesh
from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering

from dolfinx_contact import (
    ContactPair,
    Coulomb,
    HalfSpace,
    LevelSet,
    Sphere,
)
from dolfinx_contact._geometry import area_vectors, unit
from dolfinx_contact.laws import PointData
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.laws.symbols import SLID
from dolfinx_contact.meshing import join
from dolfinx_contact.obstacles import (
    Measured,
    _components,
    _radius,
    fields_within,
    is_uniform,
    known_displaced,
    require_uniform,
)
from dolfinx_contact.points.arcs import slip_along
from dolfinx_contact.points.contact_points import ContactPoints
from dolfinx_contact.points.crossings import crossings
from dolfinx_contact.points.descriptions import Overlap
from dolfinx_contact.points.displaced import DisplacedPoints
from dolfinx_contact.points.evaluation import Given, ScatteredEvaluator, at_nodes, fields_of
from dolfinx_contact.points.facing import measured, projected, projected_faces, refuse_aslant
from dolfinx_contact.points.held_ends import receiving_vertices, shared
from dolfinx_contact.points.kinematics import Kinematics, rotation
from dolfinx_contact.points.memory import Memory, slid_after
from dolfinx_contact.points.operators import Operator, multiplied, rows_of
from dolfinx_contact.points.opposite import Opposite, _gaps, _means, _to_surface
from dolfinx_contact.points.revolution import axis_condition, check_section, mirrored, on_axis
from dolfinx_contact.points.rigid_body import number
from dolfinx_contact.points.surface import DiscreteSurface, _least
from dolfinx_contact.points.trace import (
    across_planes,
    at_global_places,
    checked_planes,
    exterior_facets,
    nodes_on,
    outward_normals,
)
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
serial = pytest.mark.skipif(COMM.size > 1, reason="numbers of one rank")


def lagrange(domain, shape=None):
    return fem.functionspace(domain, ("Lagrange", 1, shape or (domain.geometry.dim,)))


def places(V):
    return V.tabulate_dof_coordinates()[:, : V.mesh.geometry.dim]


# -- facets and nodes -----------------------------------------------------------------------------


@serial
def test_facets_of_a_mesh_of_which_nothing_is_known_yet():
    """The first call makes what says which facets are exterior."""
    top = facets(box(COMM, 2, "tri"), 1, 1.0)
    fresh = box(COMM, 2, "tri")
    assert len(top) == 2
    np.testing.assert_array_equal(exterior_facets(fresh, top[::-1].copy(), None, "s"), top)


def test_numbers_of_facets_that_are_none():
    """Those below zero, from the number of all on, and no integers; of nothing it is said."""
    domain = box(COMM, 2, "tri")
    domain.topology.create_entities(1)
    index_map = domain.topology.index_map(1)
    size = index_map.size_local + index_map.num_ghosts
    for bad in (-1, size):
        with pytest.raises(ValueError, match="s: facet indices outside the mesh"):
            exterior_facets(domain, np.array([bad]), None, "s")
    with pytest.raises(ValueError, match="an array of integer indices"):
        exterior_facets(domain, np.array([0.0]), None, "s")
    with pytest.raises(ValueError, match="s: no facet was given"):
        exterior_facets(domain, np.array([]), None, "s")


@pytest.mark.parametrize("dim", [2, 3])
def test_planes_that_are_none(dim):
    """By their axis, a whole number, and a finite place; found in the order of their axes."""
    none = ({dim: 0.0}, {-1: 0.0}, {True: 0.0}, {0.0: 0.0}, {"x": 0.0}, [0], 0.0)
    places_of_none = ({0: np.nan}, {0: np.inf}, {0: "0"}, {0: True}, {0: 0.0, 1: None})
    for bad in (*none, *places_of_none):
        with pytest.raises(ValueError, match=r"axis of symmetry|by their axis|a plane of symmetry"):
            checked_planes(bad, dim, "s")
    found = checked_planes({dim - 1: 2, np.int64(0): np.float64(0.5)}, dim, "s")
    assert list(found.items()) == [(0, 0.5), (dim - 1, 2.0)]
    assert checked_planes(None, dim, "s") == checked_planes({}, dim, "s") == {}


@pytest.mark.ranks(2)
@pytest.mark.parametrize("unit", [1e-6, 1.0])
def test_nodes_on_planes_of_symmetry(unit):
    """Of both faces those up to a billionth of the largest coordinate off; where faces end."""
    domain = box(COMM, 2, "tri")
    domain.geometry.x[:, 0] = unit * (1.0 + 2.0 * domain.geometry.x[:, 0])
    domain.geometry.x[:, 1] *= unit
    V = lagrange(domain)
    x, y = places(V).T / unit
    below, above = np.abs(y) < 1e-9, np.abs(y - 1.0) < 1e-9

    def found(place, slave=below, master=above):
        return across_planes(V, slave, master, {0: unit * place}, "s")

    for off in (0.0, 2.9e-9, -2.9e-9):
        across = found(1.0 + off)
        np.testing.assert_array_equal(across[:, 0], (below | above) & (np.abs(x - 1.0) < 1e-6))
        assert not across[:, 1].any()
    for place, words in (
        (1.0 + 3.1e-9, "0 of its nodes lie on it, 1 below and 2 above"),
        (2.0, "1 of its nodes lie on it, 1 below and 1 above"),
        (3.5, "0 of its nodes lie on it, 3 below and 0 above"),
    ):
        with pytest.raises(ValueError, match=f"s: the plane of symmetry x = .* face: {words}"):
            found(place)
    left, right = below & (x < 2.1), above & (x > 1.9)
    words = "below are 1 nodes of the slave and 0 of the master, above 0 and 1"
    with pytest.raises(ValueError, match=words):
        found(2.0, left, right)
    with pytest.raises(ValueError, match="above 1 and 0"):
        found(2.0, below & (x > 1.9), above & (x < 2.1))
    with pytest.raises(ValueError, match=r"below are 1 .* and 1 of the master, above 0 and 1"):
        found(2.0, left)
    with pytest.raises(ValueError, match=r"below are 0 .* and 1 of the master, above 1 and 1"):
        found(2.0, below & (x > 1.9))
    both = left | (above & (x < 2.1))
    across = found(2.0, left, above & (x < 2.1))
    np.testing.assert_array_equal(across[:, 0], both & (np.abs(x - 2.0) < 1e-6))


@pytest.mark.ranks(2)
@pytest.mark.parametrize("shape", [(), (2,), (2, 3)])
def test_values_at_places_of_any_rank(shape):
    """Whether all are of this rank or not, places of any shape and none."""
    rng = np.random.default_rng(3)
    every = [rng.normal(size=(3 + rank, *shape)) for rank in range(COMM.size)]
    whole = np.concatenate(every)
    mine = every[COMM.rank]
    first = sum(map(len, every[: COMM.rank]))
    for wanted in (
        rng.integers(0, len(whole), (2, 4)),
        first + np.arange(len(mine))[::-1],
        np.zeros(0, dtype=np.int64),
    ):
        found = at_global_places(COMM, mine, np.asarray(wanted, dtype=np.int64))
        np.testing.assert_array_equal(found, whole[wanted])


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "size"), [("tri", 0.5), ("quad", 0.5), ("tet", np.sqrt(0.125)), ("hex", 0.5)]
)
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_normals_of_a_face_at_its_nodes(cell, size, unit):
    """On a face straight up, at an edge by both faces, elsewhere none; its least facet."""
    domain = box(COMM, 2, cell, size=unit)
    V = lagrange(domain)
    dim = domain.geometry.dim
    x = places(V) / unit
    up, side = np.eye(dim)[-1], np.eye(dim)[0]
    top, right = np.isclose(x[:, -1], 1.0), np.isclose(x[:, 0], 1.0)
    both = np.concatenate([facets(domain, dim - 1, unit), facets(domain, 0, unit)])
    local = exterior_facets(domain, both, None, "s")
    normals, least = outward_normals(V, local)
    expected = top[:, None] * up + right[:, None] * side
    sharp = top & right
    plane = (top ^ right)[:, None] * expected
    np.testing.assert_allclose(normals[~sharp], plane[~sharp], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals[sharp], axis=1), 1.0, rtol=1e-12)
    assert (np.minimum(normals[sharp] @ up, normals[sharp] @ side) > 0.4).all()
    assert COMM.allreduce(least, op=min) == pytest.approx(unit * size, rel=1e-12)
    np.testing.assert_array_equal(nodes_on(V, local), top | right)
    assert outward_normals(V, local[:0])[1] == np.inf


def test_normals_of_simplices():
    """To the right of a segment, by the right hand of a triangle, of any size; of a point none."""
    for size in (1e-9, 1.0, 1e9):
        segment = size * np.array([[[1.0, 2.0], [4.0, 6.0]]])
        np.testing.assert_allclose(unit(area_vectors(segment)), [[0.8, -0.6]], rtol=1e-13)
        triangle = size * np.array([[[1.0, 0, 0], [1.0, 2.0, 0], [1.0, 0, 3.0]]])
        np.testing.assert_allclose(unit(area_vectors(triangle)), [[1.0, 0.0, 0.0]], atol=1e-13)
    np.testing.assert_array_equal(unit(area_vectors(np.ones((1, 2, 2)))), 0.0)


# -- bodies of revolution -------------------------------------------------------------------------


@pytest.mark.parametrize("unit", [1e-6, 1.0])
def test_the_axis_of_revolution(unit):
    """What is up to a billionth of the largest radius off; normals there are along it."""
    domain = box(COMM, 2, "tri", size=unit)
    domain.geometry.x[:, 1] *= 3.0
    V = lagrange(domain)
    x = places(V) / unit
    on = np.isclose(x[:, 0], 0.0)
    for off, near in ((0.0, on), (0.9e-9, on), (1.2e-9, np.zeros_like(on))):
        domain.geometry.x[:, 0] += off * unit
        np.testing.assert_array_equal(on_axis(V), near)
        domain.geometry.x[:, 0] -= off * unit
    for normal, there in (
        ((0.6, 0.8), (0.0, 1.0)),
        ((0.6, -0.8), (0.0, -1.0)),
        ((-1.0, 0.0), (-1.0, 0.0)),
    ):
        given = np.tile(normal, (len(x), 1))
        found = mirrored(V, given)
        np.testing.assert_array_equal(found[on], np.tile(there, (int(on.sum()), 1)))
        np.testing.assert_array_equal(found[~on], given[~on])
    (bc,) = axis_condition(V)
    dofs, _ = bc.dof_indices()
    np.testing.assert_array_equal(np.sort(dofs), 2 * np.flatnonzero(on))
    domain.geometry.x[:, 0] += unit
    assert axis_condition(lagrange(domain)) == []


@pytest.mark.ranks(2)
def test_sections_of_bodies_of_revolution():
    """In the plane, at radii that are none below zero, with no facet on the axis."""
    domain = box(COMM, 2, "tri")
    none = np.zeros(0, dtype=np.int32)
    left, low = (exterior_facets(domain, facets(domain, axis, 0.0), None, "s") for axis in range(2))
    check_section(domain, low, "s")
    with pytest.raises(ValueError, match="s: 2 facets lie on the axis"):
        check_section(domain, np.union1d(left, low), "s")
    x = domain.geometry.x
    x[:, 0] -= 0.9e-9
    check_section(domain, none, "s")
    x[:, 0] -= 0.3e-9
    with pytest.raises(ValueError, match=r"in x >= 0, the mesh reaches to x = -1\.2e-09"):
        check_section(domain, none, "s")
    x[:, 0] += 1.2e-9 + 1.0
    check_section(domain, left, "s")
    with pytest.raises(ValueError, match="s: an axisymmetric body is meshed in 2D"):
        check_section(box(COMM, 1, "tet"), none, "s")


# -- what faces what ------------------------------------------------------------------------------


def test_facets_that_are_seen_in_a_direction():
    """Their means and areas; of those that look that way the means in a plane across it."""
    domain = box(COMM, 1, "quad", size=2.0)
    every = exterior_facets(
        domain,
        np.concatenate([facets(domain, a, v) for a in (0, 1) for v in (0.0, 2.0)]),
        None,
        "s",
    )

    def rows(direction=None):
        found = COMM.allgather(measured(domain, every, direction))
        return sorted(np.concatenate(found).round(12).tolist())

    assert rows() == [[0.0, 1.0, 2.0], [1.0, 0.0, 2.0], [1.0, 2.0, 2.0], [2.0, 1.0, 2.0]]
    assert rows(np.array([0.0, 1.0])) == [[1.0, 0.0, 2.0]]
    both = rows(np.array([0.6, 0.8]))
    expected = [[1.0, 2.0] - 2.2 * np.array([0.6, 0.8]), [2.0, 1.0] - 2.0 * np.array([0.6, 0.8])]
    assert both == sorted([*row.round(12).tolist(), 2.0] for row in expected)
    assert measured(domain, every[:0]).shape == (0, 3)


def test_projections_across_a_direction():
    n = np.array([0.6, 0.0, 0.8])
    x = np.array([[1.0, 2.0, 3.0], [-1.0, 0.0, 0.5]])
    np.testing.assert_allclose(
        projected(n, x), [[1.0 - 1.8, 2.0, 3.0 - 2.4], [-1.0 + 0.12, 0.0, 0.5 + 0.16]]
    )
    corners = np.array([[[0.0, 0, 0], [1.0, 0, 0], [0.0, 3.0, 0]]])
    faces = SimpleNamespace(
        x=corners, normals=np.array([[0.0, 0.0, 1.0]]), nodes=np.arange(3)[None]
    )
    seen = projected_faces(n, faces)
    np.testing.assert_allclose((seen.x - seen.x.mean(axis=1, keepdims=True)) @ n, 0.0, atol=1e-14)
    np.testing.assert_allclose(seen.x.mean(axis=1), corners.mean(axis=1), atol=1e-14)
    along = np.cross(n, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(seen.x @ along, corners @ along, atol=1e-14)
    np.testing.assert_allclose(seen.x @ [0.0, 1.0, 0.0], corners[..., 1], atol=1e-14)
    np.testing.assert_array_equal(seen.normals, [n])


def test_normals_that_are_aslant():
    """By up to 60 degrees; how many facets are farther off is said."""
    domain = box(COMM, 3, "tri")
    top = exterior_facets(domain, facets(domain, 1, 1.0), None, "s")
    mine = top[top < domain.topology.index_map(1).size_local]
    for angle in (0.0, 59.9, -59.9):
        a = np.deg2rad(angle)
        refuse_aslant(domain, mine, np.array([np.sin(a), np.cos(a)]), "s")
    for angle in (60.1, -60.1, 180.0):
        a = np.deg2rad(angle)
        with pytest.raises(ValueError, match="60 degrees off that of 3 facets"):
            refuse_aslant(domain, mine, np.array([np.sin(a), np.cos(a)]), "s")


# -- nodes that give their functions away ---------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("given", "idle", "shares"),
    [
        ([2], [], {2: {1: 0.5, 3: 0.5}}),
        ([0], [], {0: {1: 1.0}}),
        ([4, 5], [], {4: {3: 1.0}, 5: {6: 1.0}}),
        ([3, 4, 5], [], {3: {2: 1.0}, 5: {6: 1.0}, 4: {2: 0.5, 6: 0.5}}),
        ([3, 4, 5], [6], {3: {2: 1.0}, 4: {2: 1.0}, 5: {2: 1.0}}),
        ([1, 5], [0, 2], {5: {4: 0.5, 6: 0.5}}),  # the first finds nobody
        ([2], [3], {2: {1: 1.0}}),
        ([], [3], {}),
    ],
)
def test_who_takes_the_functions_of_vertices(given, idle, shares):
    """Those around, in equal parts; through others that are given; none that are idle."""
    domain = mesh.create_interval(COMM, 6, (0.0, 6.0))
    W = fem.functionspace(domain, ("Lagrange", 1))
    x = np.rint(W.tabulate_dof_coordinates()[:, 0]).astype(int)
    index_map = W.dofmap.index_map
    n = index_map.size_local
    at = np.concatenate(COMM.allgather(x[:n]))
    expected = np.eye(7)
    for p, parts in shares.items():
        expected[p] = 0.0
        for q, share in parts.items():
            expected[p, q] = share

    marks = [np.isin(x, of) for of in (given, idle)]
    nodes, weights, gave = receiving_vertices(W, *marks)
    np.testing.assert_array_equal(gave, np.isin(x, list(shares)))
    found = np.zeros((len(x), 7))
    for i in range(len(x)):
        np.add.at(found[i], at[nodes[i]], weights[i])
    np.testing.assert_allclose(found, expected[x], atol=1e-14)

    areas = np.arange(1.0, 8.0)
    means, total, gave = shared(W, *marks, areas[x[:n]])
    np.testing.assert_array_equal(gave, np.isin(x, list(shares)))
    kept = ~np.isin(np.arange(7), list(shares))
    whole = np.where(kept, areas @ expected, areas)
    np.testing.assert_allclose(total, whole[x[:n]], rtol=1e-14)
    values = np.sin(np.arange(7.0))
    wanted = np.where(kept, (areas * values) @ expected / whole, values)
    np.testing.assert_allclose(multiplied(means, values[x[:n], None])[:, 0], wanted[x[:n]])
    means.destroy()


@serial
def test_rows_of_matrices():
    """Nodes and weights of rows of any length, over their divisors; of no row nothing."""
    A = PETSc.Mat().createAIJ((3, 4), nnz=3, comm=COMM)
    for i, j, v in ((0, 1, 2.0), (1, 0, 3.0), (1, 2, 4.0), (1, 3, 5.0), (2, 3, -1.0), (2, 1, 6.0)):
        A.setValue(i, j, v)
    A.assemble()
    nodes, weights = rows_of(A, np.array([2.0, 10.0, 4.0]))
    np.testing.assert_array_equal(nodes, [[1, 1, 1], [0, 2, 3], [1, 3, 3]])
    np.testing.assert_allclose(weights, [[1.0, 0, 0], [0.3, 0.4, 0.5], [1.5, -0.25, 0]])


# -- what is opposite -----------------------------------------------------------------------------


def test_values_that_are_opposite():
    """Weighted means, of weights or their sizes, zero off the surface; of vectors and scalars."""
    rows = np.array([1, -1, 0])
    nodes = np.array([[0, 1], [2, 2]])
    weights = np.array([[1.5, -0.5], [1.0, 0.0]])
    none = np.zeros(3, dtype=bool)
    of = Opposite(rows, nodes, weights, none, None, (none, none), np.zeros(0, np.int32))
    mine = np.array([2.0, 4.0, 8.0]) if COMM.rank == 0 else np.zeros(0)
    np.testing.assert_allclose(of.values(COMM, mine, 3), [8.0, 0.0, 1.0])
    np.testing.assert_allclose(of.values(COMM, mine, 3, sizes=True), [8.0, 0.0, 5.0])
    two = np.stack([mine, -mine], axis=1)
    np.testing.assert_allclose(of.values(COMM, two, 3), [[8.0, -8.0], [0.0, 0.0], [1.0, -1.0]])
    assert of.matching
    assert of.points is None


@serial
def test_jumps_that_go_around():
    """Of three pairs in a ring, each by its vertex; not of another, nor where nodes are held."""
    domain = box(COMM, 2, "tri")
    V = lagrange(domain)
    n = len(places(V))
    vertices = fem.functionspace(domain, ("Lagrange", 1))
    points = SimpleNamespace(vertices=vertices, vertex_trace_dofs=np.arange(n))
    sides = np.ones(n, dtype=bool), np.ones(n, dtype=bool)

    def pair(*jumps, common=None):
        nodes = np.arange(n)
        for one, other in jumps:
            nodes[one] = other
        weights, itself = np.ones((n, 1)), nodes == np.arange(n)
        rest = None, sides, np.zeros(0, np.int32), common
        opposite = Opposite(np.arange(n), nodes[:, None], weights, itself, *rest)
        return SimpleNamespace(points=points, opposite_nodes=opposite)

    alone = SimpleNamespace(points=points, opposite_nodes=None)
    other = pair((5, 6), (2, 6), common="no like facets")
    ring = [alone, pair((3, 4), (0, 1)), other, pair((4, 8), (7, 2)), pair((8, 3))]
    free = np.zeros((n, 2), dtype=bool)
    marks, nodes = crossings(V, ring, free)
    expected = [[], [3], [], [4], [8]]
    assert [np.flatnonzero(m).tolist() for m in marks] == expected
    assert np.flatnonzero(nodes).tolist() == [3, 4, 8]
    held = free.copy()
    held[[3, 4, 8]] = True
    held[4, 1] = False
    assert not crossings(V, ring, held)[1].any()
    for some in ([alone, alone], ring[:4], [alone, other]):
        marks, nodes = crossings(V, some, free)
        assert not np.concatenate([*marks, nodes]).any()
        assert [len(m) for m in marks] == [n] * len(some)


@serial
def test_rows_as_weighted_means():
    """Weights that sum to one; a node without any is opposite to itself."""
    domain = box(COMM, 1, "tri")
    V = lagrange(domain)
    A = PETSc.Mat().createAIJ((4, 4), nnz=3, comm=COMM)
    for i, j, v in ((0, 1, 1.0), (0, 3, 3.0), (2, 0, 2.0), (2, 1, 2.0), (2, 2, 4.0), (3, 0, 9.0)):
        A.setValue(i, j, v)
    A.assemble()
    on = np.array([True, True, True, False])
    where, nodes, weights, none = _means(V, A, on)
    np.testing.assert_array_equal(where, [0, 1, 2, -1])
    np.testing.assert_array_equal(nodes[0, :2], [1, 3])
    np.testing.assert_array_equal(nodes[2], [0, 1, 2])
    assert nodes[1, 0] == 1
    np.testing.assert_allclose(weights, [[0.25, 0.75, 0.0], [1.0, 0, 0], [0.25, 0.25, 0.5]])
    np.testing.assert_array_equal(none, [False, True, False, False])


@pytest.mark.parametrize("unit", [1e-6, 1.0])
@pytest.mark.parametrize("matching", [True, False])
def test_gaps_along_normals(matching, unit):
    """Less than a billionth of a facet is none; large, ten meshes, where nothing is opposite."""
    domain = box(COMM, 2, "tri", size=3.0 * unit)
    V = lagrange(domain)
    x = places(V)
    n = np.tile([0.6, 0.8], (len(x), 1))
    size = 0.5 * unit
    none = np.isclose(x[:, 0], 0.0)
    for way, gap in (
        ((5.0, 0.0), 3.0),
        ((0.0, -1.0), -0.8),
        ((0.8, -0.6), 0.0),
        ((0.6 * 4e-10, 0.8 * 4e-10), 0.0),
        ((0.6 * 6e-10, 0.8 * 6e-10), 6e-10),
        ((-0.6 * 6e-10, -0.8 * 6e-10), -6e-10),
    ):
        there = x + unit * np.array(way)
        opposite = SimpleNamespace(
            values=lambda comm, values, number, there=there: there, matching=matching, none=none
        )
        found = _gaps(V, opposite, n, size)
        far = 10.0 * np.sqrt(18.0) * unit
        expected = np.where(none & ~np.bool_(matching), far, gap * unit)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-14 * unit)
        assert gap or (found[~none] == 0.0).all()


def test_gaps_to_a_given_surface():
    """At nodes of the slave alone; round-off is none; its normals are those of the slave."""
    domain = box(COMM, 2, "tri", size=2.0)
    W = fem.functionspace(domain, ("Lagrange", 1))
    x = places(W)
    top = exterior_facets(domain, facets(domain, 1, 2.0), None, "s")
    on = nodes_on(W, top)
    up = np.tile([0.0, 1.0], (len(x), 1))

    def plane(height, angle):
        a = np.deg2rad(angle)
        return HalfSpace((0.0, height), (-np.sin(a), -np.cos(a)))

    for height, gap in ((2.5, 0.5), (1.75, -0.25), (2.0 + 9e-10, 0.0), (2.0 + 1.1e-9, 1.1e-9)):
        gaps, normals = _to_surface(W, plane(height, 0.0), top, up, 1.0, "s")
        np.testing.assert_allclose(gaps, np.where(on, gap, 0.0), rtol=1e-5, atol=0)
        np.testing.assert_allclose(normals, on[:, None] * up, atol=1e-14)
    a = np.deg2rad(59.9)
    _, normals = _to_surface(W, plane(2.0, 59.9), top, up, 1.0, "s")
    np.testing.assert_allclose(normals, on[:, None] * np.array([np.sin(a), np.cos(a)]), atol=1e-14)
    for angle in (60.1, 180.0):
        with pytest.raises(ValueError, match="s: at 3 nodes of the slave the normal"):
            _to_surface(W, plane(2.0, angle), top, up, 1.0, "s")


@pytest.mark.parametrize("unit", [1e-6, 1.0])
def test_how_far_faces_that_match_may_be_off(unit):
    """A millionth of a facet across and in each other; in each other of others a twentieth."""
    for cells, across, deep, matching, words in (
        ((2, 2), 0.9e-6, 0.0, True, None),
        ((2, 2), 1.1e-6, 0.0, False, None),
        ((2, 2), 0.0, 0.9e-6, True, None),
        ((2, 2), 0.0, 1.1e-6, True, "overlap"),
        ((2, 3), 0.0, 0.049, False, None),
        ((2, 3), 0.0, 0.051, False, "overlap"),
    ):
        bodies = [box(COMM, n, "quad") for n in cells]
        bodies[1].geometry.x[:, 0] += across / cells[1]
        bodies[1].geometry.x[:, 1] += 1.0 - deep / cells[1]
        planes = ({"t1": (1, 0.0), "t2": (1, 1.0)}, {"t3": (1, 1.0 - deep / cells[1])})
        tags = [tagged(body, **plane) for body, plane in zip(bodies, planes, strict=True)]
        both = join(bodies, facet_tags=tags)
        both.mesh.geometry.x[:] *= unit
        u = displacement(both.mesh)
        given = dict(slave=3, master=2, law=Coulomb(0.3))
        if words:
            with pytest.raises(ValueError, match=words):
                discretise(ContactPair(u, both, **given))
            continue
        pair = discretise(ContactPair(u, both, **given))
        assert pair.obstacle.opposite.matching is matching
        np.testing.assert_array_equal(pair.points.gaps, 0.0)


# -- arguments ------------------------------------------------------------------------------------


# -- obstacles ------------------------------------------------------------------------------------


def test_what_is_the_same_everywhere():
    domain = box(COMM, 1, "tri")
    c, x = fem.Constant(domain, 2.0), ufl.SpatialCoordinate(domain)
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    for same in (1.0, (0.0, 1.0), c, (c, 0.0), c * c + 1, np.zeros(2)):
        assert is_uniform(same)
    for other in (x[0], f, (0.0, f), (c, x[1]), c * f, [x[0], c]):
        assert not is_uniform(other)


def test_components_of_functions_that_obstacles_have():
    """Those that are used, of several parts together; all where that is not known."""
    domain = box(COMM, 1, "tri")
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,))))
    g = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    assert _components(f[2] + 2.0 * f[0], f) == (0, 2)
    assert _components(f[1], f) == (1,)
    assert _components(f, f) is None
    assert _components(ufl.sqrt(g), g) is None
    assert _components(ufl.dot(f, f) + f[0], f) is None
    of = lambda *values: fields_within(SimpleNamespace(fields=lambda d: values), domain, "s")  # noqa: E731
    assert of(f[2], 1.0, (f[0], 0.0)) == [(f, (0, 2))]
    assert of(f[2], f) == [(f, None)]
    assert of(f, f[2]) == [(f, None)]
    assert of(g * f[1], 3.0) == [(f, (1,)), (g, None)]
    assert of(fem.Constant(domain, 1.0)) == []
    with pytest.raises(ValueError, match="s contains the position on the mesh"):
        of(ufl.SpatialCoordinate(domain)[0])


@pytest.mark.ranks(2)
@pytest.mark.parametrize("unit", [1e-20, 1.0, 1e20])
def test_functions_that_have_one_value(unit):
    """Up to a millionth of a millionth of the largest, of the components that are used."""
    domain = box(COMM, 2, "tri")
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    x = places(f.function_space)
    values = f.x.array.reshape(-1, 2)
    values[:] = unit * np.array([-4.0, 1.0])
    require_uniform(COMM, [(f, None)], "s")
    values[:, 0] += unit * 3.9e-12 * x[:, 0]
    require_uniform(COMM, [(f, None), (f, (1,))], "s")
    values[:, 0] += unit * 0.4e-12 * x[:, 0]
    require_uniform(COMM, [(f, (1,))], "s")
    for components in (None, (0,), (0, 1)):
        with pytest.raises(ValueError, match=r"s contains the Function f.*, which varies"):
            require_uniform(COMM, [(f, (1,)), (f, components)], "s")
    values[:] = 0.0
    require_uniform(COMM, [(f, None)], "s")


@pytest.mark.parametrize("cell", ["tri", "quad"])
def test_functions_of_mixed_spaces_that_have_one_value(cell):
    """Values and not degrees of freedom, of the component that is used, within cells too."""
    domain = box(COMM, 2, cell)
    kind = domain.basix_cell()
    mixed = basix.ufl.mixed_element(
        [
            basix.ufl.element("Lagrange", kind, 2),
            basix.ufl.element("Lagrange", kind, 1, shape=(2,)),
        ]
    )
    f = fem.Function(fem.functionspace(domain, mixed))
    # Zero at all corners of cells, and not between them.
    f.sub(0).interpolate(lambda x: np.sin(2.0 * np.pi * x[0]) ** 2)
    f.sub(1).interpolate(lambda x: np.stack([3.0 + 0 * x[0], x[0]]))
    require_uniform(COMM, [(f, (1,))], "s")
    for component in (0, 2):
        with pytest.raises(ValueError, match="varies"):
            require_uniform(COMM, [(f, (component,))], "s")
    f.sub(1).interpolate(lambda x: np.stack([3.0 + 0 * x[0], 5.0 + 0 * x[0]]))
    require_uniform(COMM, [(f, (1, 2))], "s")
    with pytest.raises(ValueError, match="varies"):
        require_uniform(COMM, [(f, None)], "s")


def test_radii():
    domain = box(COMM, 1, "tri")
    assert float(_radius(domain, 2).value) == 2.0
    c = fem.Constant(domain, 3.0)
    assert _radius(domain, c) is c
    for bad in (0.0, -1.0, np.nan, np.inf, True, "1"):
        with pytest.raises(ValueError, match="the radius must be positive"):
            _radius(domain, bad)
    with pytest.raises(ValueError, match=r"must be a number, got shape \(2,\)"):
        _radius(domain, fem.Constant(domain, (1.0, 1.0)))
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    f.x.array[:] = np.arange(1.0, 1.0 + len(f.x.array))
    assert COMM.allreduce(_least(f), op=min) == 1.0
    assert _least(2.0 * c - 7.0) == -1.0
    assert _least(c) == 3.0
    for none in (None, 2.0, f + c):
        assert _least(none) == np.inf


def test_vectors_that_obstacles_cannot_have():
    """As many finite numbers as there are axes, and a direction of some length."""
    domain = box(COMM, 1, "tri")
    c = fem.Constant(domain, 1.0)
    two, three = (fem.Constant(domain, np.ones(n)) for n in (2, 3))
    for bad in ((1.0,), (1.0, 2.0, 3.0), (1.0, np.nan), "xy", (1.0, "y"), 1.0, [[1.0], [1.0, 2.0]]):
        with pytest.raises(ValueError, match=r"point .* must have 2 finite components, got"):
            HalfSpace(bad, (0.0, 1.0)).on(domain)
    for bad in ((c, "x"), (c, None), (c, (1.0, 2.0))):
        with pytest.raises(ValueError, match=r"point .* must have 2 numbers, got"):
            HalfSpace(bad, (0.0, 1.0)).on(domain)
    for bad in (three, (c, c, c), c):
        with pytest.raises(ValueError, match=r"point .* must have 2 components, got shape"):
            HalfSpace(bad, (0.0, 1.0)).on(domain)
    for bad in ((0.0, 0.0), fem.Constant(domain, (0.0, 0.0))):
        with pytest.raises(ValueError, match="normal of the half-space is the zero vector"):
            HalfSpace(two, bad).on(domain)
    HalfSpace((c, 2.0), two).on(domain)


def test_obstacles_that_are_known_at_any_point():
    """By a method at that belongs to it; where a class has a method on alone it is not."""

    class Own(HalfSpace):
        def on(self, domain):
            return super().on(domain)

    class Both(Own):
        def at(self, domain, x):
            return super().at(domain, x)

    plane = (0.0, 0.0), (0.0, 1.0)
    assert known_displaced(HalfSpace(*plane))
    assert not known_displaced(Own(*plane))
    assert known_displaced(Both(*plane))
    # One class may have both.
    assert known_displaced(LevelSet(lambda x: x[0]))
    assert HalfSpace(*plane).flat
    assert not Both(*plane).flat
    assert not HalfSpace((0.0, ufl.SpatialCoordinate(box(COMM, 1, "tri"))[0]), plane[1]).flat


def test_what_is_measured_at_points():
    """Components in order, asked anew where points or what is given have changed."""
    domain = box(COMM, 1, "tri")
    asked = []

    def measure(x, more):
        asked.append(more.copy())
        n = len(x)
        turn = np.arange(4.0 * n).reshape(n, 2, 2)
        return x[:, 0] + more, 2.0 * x, -x, turn

    c = fem.Constant(domain, 1.0)
    found = Measured(domain, ufl.SpatialCoordinate(domain), measure, [c])
    assert found.at.ufl_shape == (3,)
    taken = np.array([[1.0, 2.0, 10.0], [3.0, 4.0, 20.0]])
    expected = [
        [1.0, 2.0, 11.0, 2.0, 4.0, -1.0, -2.0, 0.0, 1.0, 2.0, 3.0],
        [3.0, 4.0, 23.0, 6.0, 8.0, -3.0, -4.0, 4.0, 5.0, 6.0, 7.0],
    ]
    for _ in range(2):
        np.testing.assert_array_equal(found.values(taken), expected)
    assert len(asked) == 1
    taken[1, 2] = 30.0
    assert found.values(taken)[1, 2] == 33.0
    assert len(asked) == 2
    assert found.values(taken[:0]).shape == (0, 11)


# -- values at points -----------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, 3, 256, 257, 600])
def test_expressions_at_scattered_points(number):
    """Scalars, vectors and matrices of places, Functions and Constants, however many points."""
    domain = mesh.create_unit_square(MPI.COMM_SELF, 3, 3)
    rng = np.random.default_rng(1)
    cells = rng.integers(0, 18, number).astype(np.int32)
    corners = domain.geometry.x[domain.geometry.dofmap[cells]][:, :, :2]
    x = np.einsum("nk,nkd->nd", rng.dirichlet(np.ones(3), number).reshape(-1, 3), corners)
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    f.interpolate(lambda x: np.stack([x[0] - x[1], 3.0 * x[1]]))
    c, d = fem.Constant(domain, 2.0), fem.Constant(domain, (5.0, 7.0))
    X = ufl.SpatialCoordinate(domain)
    given = {
        "a": c * X[0] + f[1],
        "b": f + d,
        ":m": ufl.as_matrix([[X[0], c], [f[0], d[1]], [X[1], 1.0]]),
        "one": 1.0,
    }
    evaluate = ScatteredEvaluator(domain, cells, x, np.ones(number), given)
    for value in (2.0, -1.0):
        c.value = value
        found = evaluate()
        a, b = x.T
        none = np.zeros(number)
        np.testing.assert_allclose(found["a"], value * a + 3.0 * b, atol=1e-12)
        np.testing.assert_allclose(found["b"], np.stack([a - b + 5.0, 3 * b + 7.0], 1), atol=1e-12)
        rows = [[a, none + value], [a - b, none + 7.0], [b, none + 1.0]]
        np.testing.assert_allclose(found[":m"], np.array(rows).transpose(2, 0, 1), atol=1e-12)
        np.testing.assert_array_equal(found["one"], np.ones(number))
    assert list(fields_of(found)) == ["m"]


def test_what_scattered_points_cannot_have():
    domain = box(COMM, 1, "tri")
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    q = basix.ufl.quadrature_element("triangle", degree=2)
    at = np.zeros(0, dtype=np.int32), np.zeros((0, 2)), np.zeros(0)
    for e, words in (
        (ufl.grad(f)[0], "the gap .* may not depend on derivatives"),
        (ufl.CellVolume(domain) + 0.0 * f, "the gap .* Functions and Constants, not on"),
        (fem.Function(fem.functionspace(domain, q)), "the gap .* at quadrature points"),
    ):
        with pytest.raises(ValueError, match=words):
            ScatteredEvaluator(domain, *at, {":gap": e})


def test_obstacles_at_nodes():
    """Gaps and normals of a disc and of a plane at all local nodes of a mesh."""
    domain = box(COMM, 2, "tri", size=2.0)
    W = fem.functionspace(domain, ("Lagrange", 1))
    x = places(W)
    gap, normal = at_nodes(W, HalfSpace((0.0, -1.0), (0.0, 2.0)))
    np.testing.assert_allclose(gap, x[:, 1] + 1.0, atol=1e-14)
    np.testing.assert_allclose(normal, np.tile([0.0, -1.0], (len(x), 1)), atol=1e-14)
    gap, normal = at_nodes(W, Sphere((3.0, 4.0), 0.5))
    way = np.array([3.0, 4.0]) - x
    length = np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(gap, length - 0.5, rtol=1e-13)
    np.testing.assert_allclose(normal, way / length[:, None], rtol=1e-13)


def test_functions_and_constants_that_are_given():
    """By the names of what they are in, those of the law with a colon."""
    domain = box(COMM, 1, "tri")
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    c, d = fem.Constant(domain, 1.0), fem.Constant(domain, (0.0, 1.0))
    given = Given(f + c, d, {"friction": c * f, "bound": 2.0})
    assert list(given.at_points) == ["gap", "normal", ":friction", ":bound"]
    assert given.all == (given.gap, d, given.fields["friction"], 2.0)
    assert given.functions == [f, f]
    assert set(map(id, given.constants)) == {id(c), id(d)}
    assert len(given.constants) == 3


# -- gaps, slips and normals ----------------------------------------------------------------------


def value(e):
    return apply_algebra_lowering(e)(())


@pytest.mark.parametrize("turn", [0.0, 1e-5, 0.05, 0.109, 0.11, 1.0, 2.5, -0.7])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_slips_along_circles_and_screws(turn, sense):
    """As long as the arc, along the tangent of now; what is along the axis stays."""
    a, R, rise = 0.4, 3.0, 0.7

    def at(angle):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        return R * out + [0.0, 0.0, rise * (angle - a)], sense * out

    (x, o), (y, n) = at(a), at(a + turn)
    tangent = np.array([-n[1], n[0], 0.0]) * sense
    slip = slip_along(*(ufl.as_vector(v.tolist()) for v in (y - x, o, n)))
    found = np.array([value(slip[i]) for i in range(3)])
    np.testing.assert_allclose(found, R * turn * tangent + [0, 0, rise * turn], atol=1e-11)
    plane = slip_along(*(ufl.as_vector(v[:2].tolist()) for v in (y - x, o, n)))
    found = np.array([value(plane[i]) for i in range(2)])
    np.testing.assert_allclose(found, R * turn * tangent[:2], atol=1e-11)


@pytest.mark.parametrize("dim", [2, 3])
def test_gaps_and_slips_of_a_state(dim):
    """By their definition, and their rates by differences, where normals follow and where not."""
    rng = np.random.default_rng(dim)
    n_points = 4
    unit = lambda v: v / np.linalg.norm(v, axis=1)[:, None]  # noqa: E731
    place = rng.normal(size=(n_points, dim))
    start, g = rng.normal(size=(n_points, dim)), rng.normal(size=n_points)
    J = rng.normal(size=(n_points, dim, dim))
    N = 0.3 * rng.normal(size=(n_points, dim, dim))
    reference = rng.normal(size=(n_points, dim))
    v = rng.normal(size=(n_points, dim))
    operator = SimpleNamespace(rate=lambda v: v)
    frame = np.linalg.qr(rng.normal(size=(dim, dim)))[0]

    def state(step, *, follows):
        d = place + step * v
        m = start + np.einsum("nij,nj->ni", N, d) * follows
        n = unit(m)
        size = np.linalg.norm(m, axis=1)[:, None, None]
        turn = (np.eye(dim) - n[:, :, None] * n[:, None]) @ N / size
        jump = np.einsum("nij,nj->ni", J, d) if follows else d
        data = PointData(n, g, g, {}, *((turn, J) if follows else (None, None)))
        more = (d, frame) if follows else (None, None)
        return Kinematics(operator, jump, reference, data, *more)

    for follows in (False, True):
        at = state(0.0, follows=follows)
        j, n = at.jump, at.data.n
        along = np.sum(j * n, axis=1)
        np.testing.assert_allclose(at.gap, g - along, rtol=1e-13)
        np.testing.assert_allclose(at.increment, j - along[:, None] * n, atol=1e-13)
        np.testing.assert_allclose(at.slip, at.increment + reference, atol=1e-13)
        whole = j + reference
        np.testing.assert_allclose(at.whole, whole @ frame if follows else whole, atol=1e-13)
        path = (place, n @ frame) if follows else (whole, n)
        for a, b in zip(at.path, path, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-13)
        h = 1e-6
        plus, minus = state(h, follows=follows), state(-h, follows=follows)
        for what, rate in (
            ("gap", at.gap_rate),
            ("jump", at.jump_rate),
        ):
            difference = (getattr(plus, what) - getattr(minus, what)) / (2 * h)
            np.testing.assert_allclose(rate(v), difference, atol=1e-8)


def test_turns_from_normals_to_their_opposites():
    """Vectors across a normal stay what they are where it is turned round."""
    for dim in (2, 3):
        o = np.eye(dim)[0]
        across = np.eye(dim)[1]
        R = rotation(o[None], -o[None])[0]
        np.testing.assert_allclose(R @ across, across, atol=1e-15)
        # Near by, what turns is turned.
        n = np.cos(1e-3) * -o + np.sin(1e-3) * across
        found = rotation(o[None], n[None])[0] @ across
        np.testing.assert_allclose(np.linalg.norm(found), 1.0, rtol=1e-9)
        np.testing.assert_allclose(found @ n, 0.0, atol=1e-9)
        np.testing.assert_allclose(found @ o, -np.sin(1e-3), rtol=1e-6)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("removed", [False, True])
def test_what_the_law_is_given_at_displaced_points(turned, removed):
    """Turned with the frame; gaps that are round-off are none where overlaps are removed."""
    n = np.array([[0.6, 0.8], [0.0, 1.0], [1.0, 0.0], [0.0, -1.0]])
    o = np.tile([0.0, 1.0], (4, 1))
    gap = np.array([1e-15, -1e-14, 1.1e-14, -0.5])
    along = np.stack([n[:, 1], -n[:, 0]], axis=1)
    seen = 0.25 * along - gap[:, None] * n
    rng = np.random.default_rng(1)
    turn, moved = rng.normal(size=(2, 4, 2, 2))
    found = {"normal": n, "seen": seen, "turn": turn, "moved": moved, "normal_before": o}
    ghost = {name: np.concatenate([v, v[:1]]) for name, v in found.items()}
    fields = {"friction": np.full(4, 0.3)}
    placed = []
    points = SimpleNamespace(
        _place=lambda place, before: placed.append((place, before)),
        _evaluate=lambda: ghost,
        _points=SimpleNamespace(
            number=4,
            removed_overlap=object() if removed else None,
            data=SimpleNamespace(r=np.arange(4.0), fields=fields),
        ),
        friction=True,
        _no_gap=1e-14,
    )
    Q = np.array([[0.0, -1.0], [1.0, 0.0]]) if turned else None
    memory = Memory(np.tile([2.0, 5.0], (4, 1)), place=np.ones((4, 2)))
    here = rng.normal(size=(4, 2))
    data, jump, reference = DisplacedPoints.at(points, here, memory, Q)
    assert placed[0][0] is here
    np.testing.assert_array_equal(placed[0][1], 1.0)
    none_yet = np.where(np.abs(gap) <= 1e-14, 0.0, gap) if removed else gap
    expected = 0.25 * along - none_yet[:, None] * n
    slipped = np.stack([2.0 * n[:, 1], -2.0 * n[:, 0]], axis=1)
    slipped[3] = [2.0, 0.0]  # to the opposite normal
    F = np.eye(2) if Q is None else Q
    np.testing.assert_allclose(jump, expected @ F.T, rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(reference, slipped @ F.T, atol=1e-14)
    np.testing.assert_allclose(data.n, n @ F.T, atol=1e-15)
    np.testing.assert_allclose(data.turn, F @ turn @ F.T, atol=1e-15)
    np.testing.assert_allclose(data.moved, F @ moved @ F.T, atol=1e-15)
    np.testing.assert_array_equal(data.gap, 0.0)
    np.testing.assert_array_equal(data.r, np.arange(4.0))
    assert data.fields is fields
    for friction, known in ((False, memory), (True, None)):
        points.friction = friction
        np.testing.assert_array_equal(DisplacedPoints.at(points, here, known, Q)[2], 0.0)
    assert placed[-1][1] is None


@pytest.mark.parametrize("averaged", [False, True])
def test_rates_of_gaps_and_normals(averaged):
    """By differences; averages of g n have a part across the normal, and it has a rate too."""
    rng = np.random.default_rng(2)
    M = rng.uniform(size=(3, 3)) if averaged else None
    g, dg = rng.normal(size=(2, 3))
    n, dn = rng.normal(size=(2, 3, 2))
    n /= np.linalg.norm(n, axis=1)[:, None]
    dn -= np.sum(dn * n, axis=1)[:, None] * n
    average = lambda _, offset: None if M is None else M @ offset  # noqa: E731

    def at(step):
        normal = n + step * dn
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        gap = g + step * dg
        points = SimpleNamespace(
            number=3,
            removed_overlap=None,
            removed_at_vertices=None,
            _average=None,
            _averaged=average,
            r=None,
            _evaluate=lambda: {"x": n, "gap": gap, "normal": normal, ":k": 5.0 * gap},
            _given_at_vertices=lambda values: values,
            from_vertices=lambda r: np.ones(3),
        )
        ContactPoints.update(points)
        return points

    points = at(0.0)
    values = {"gap": dg, "normal": dn, ":k": 5.0 * dg}
    data, aside = ContactPoints.rates(points, (lambda: values, None))
    h = 1e-6
    plus, minus = at(h), at(-h)
    for what in ("gap", "n"):
        difference = (getattr(plus.data, what) - getattr(minus.data, what)) / (2 * h)
        np.testing.assert_allclose(getattr(data, what), difference, atol=1e-8)
    np.testing.assert_allclose(aside, (plus.aside - minus.aside) / (2 * h), atol=1e-8)
    assert averaged or not aside.any()
    np.testing.assert_allclose(data.fields["k"], 5.0 * dg)
    np.testing.assert_array_equal(data.r, 0.0)


def test_distances_that_points_have_slipped():
    """They are added up where a point touches, and never along the normal."""
    n = np.tile([0.0, 1.0], (4, 1))
    data = SimpleNamespace(n=n, fields={SLID: np.array([1.0, 2.0, 3.0, 4.0])})
    jump = np.array([[0.5, 9.0], [-0.5, 9.0], [0.5, 0.0], [0.0, 1.0]])
    found = slid_after(data, jump, np.array([PLUS, MINUS, OPEN, STICK], dtype=np.int8))
    np.testing.assert_allclose(found, [1.5, 2.5, 3.0, 4.0])


def test_memories_that_fit():
    jump = np.zeros((3, 2))
    assert Memory(jump).fits(3, 2)
    for number_of, dim in ((2, 2), (3, 3)):
        assert not Memory(jump).fits(number_of, dim)
    assert Memory(jump, {"a": np.zeros(3)}).fits(3, 2)
    assert not Memory(jump, {"a": np.zeros(3), "b": np.zeros(2)}).fits(3, 2)
    assert Memory(jump, place=jump).fits(3, 2)
    assert not Memory(jump, place=jump[:2]).fits(3, 2)
    assert (Memory(jump).slides, Memory(jump).follows) == (False, False)
    assert (Memory(jump, displacement=jump).slides, Memory(jump, place=jump).follows) == (
        True,
        True,
    )
    later = Memory(jump, {"a": np.ones(3)}, step=1.0).later(2.0)
    assert later.step == 2.0
    assert later.fields["a"].tolist() == [1.0] * 3
    with pytest.raises(ValueError, match="read-only"):
        later.jump[0] = 1.0


def test_numbers_of_loads():
    """Of Constants of any shape as they are now, of numbers and of nothing."""
    domain = box(COMM, 1, "tri")
    c, v = fem.Constant(domain, 2.0), fem.Constant(domain, (3.0, 5.0))
    m = fem.Constant(domain, ((1.0, 2.0), (7.0, 4.0)))
    for e, expected in (
        (ufl.as_ufl(2.5), 2.5),
        (ufl.as_ufl(0.0), 0.0),
        (c * v[1], 10.0),
        (v[0] - m[1, 0], -4.0),
        (c, 2.0),
    ):
        assert number(e) == expected
    c.value = 3.0
    assert number(c * v[1]) == 15.0


# -- surfaces -------------------------------------------------------------------------------------


@pytest.mark.parametrize("cell", ["tri", "tet"])
def test_sides_of_facets(cell):
    """Signs by which normals of simplices point out of the body, at places without round-off."""
    s = block(n=2, cell=cell).surfaces[0]
    corners, x, signs = s.facet_sides
    out = signs[:, None] * unit(area_vectors(x[corners]))
    np.testing.assert_allclose(out, np.tile(-np.eye(s.dim)[-1], (len(out), 1)), atol=1e-12)
    whole = s.points.vertices.tabulate_dof_coordinates()[:, : s.dim]
    np.testing.assert_allclose(x, whole, atol=1e-8)


def test_what_kinds_of_points_and_of_operators_define():
    of_points = {"_given_at_vertices", "_give", "_measure", "_place", "_stencils"}
    of_points |= {"at_vertices", "cells", "evaluator", "from_vertices"}
    assert ContactPoints.__abstractmethods__ == of_points
    of_operators = {"apply", "rate", "transpose", "transpose_rate", "destroy"}
    assert Operator.__abstractmethods__ == of_operators


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_gaps_of_displaced_points_that_are_round_off(size):
    """By the largest coordinate of all points."""
    domain = box(COMM, 2, "tri", size=size)
    disc = Sphere((0.0, -3.0 * size), size)
    s = block(domain=domain, obstacle=disc, sliding="large").surfaces[0]
    assert s.displaced._no_gap == pytest.approx(size * 1e-14, rel=1e-12)


@pytest.mark.parametrize("method", ["nodal", "integral"])
def test_overlaps_that_are_taken_from_gaps(method):
    """For good, at points and at vertices by themselves; what is no overlap stays."""
    domain = box(COMM, 2, "tri")
    height = fem.Constant(domain, (0.0, -0.1))
    floor = HalfSpace(height, (0.0, 1.0))
    points = block(domain=domain, obstacle=floor, method=method).surfaces[0].points
    n, m = points.number, len(points.vertex_gaps)
    for taken, more in ((0.5, 0.25), (0.75, 1.25)):
        points.remove_overlap(np.full(n, -taken), np.full(m, -more))
    points.remove_overlap(np.full(n, 9.0), np.full(m, 9.0))
    for top, gap in ((-0.1, 0.1), (0.2, -0.2)):
        height.value[1] = top
        points.update()
        np.testing.assert_allclose(points.gaps, gap + 1.25, rtol=1e-13)
        np.testing.assert_allclose(points.data.gap, gap + 1.25, rtol=1e-13)
        np.testing.assert_allclose(points.vertex_gaps, gap + 1.5, rtol=1e-13)
    assert points.choices == [1.25]


@pytest.mark.ranks(2)
def test_parts_of_a_face():
    """By which each of its points is of, however many there are."""
    for method in ("nodal", "integral"):
        two = lambda domain: np.concatenate(  # noqa: E731
            [facets(domain, 1, 0.0), facets(domain, 1, 1.0)]
        )
        s = block(n=3, method=method, where=two, obstacle=Sphere((9.0, 9.0), 1.0)).surfaces[0]
        mine, number_of = s.parts
        assert number_of == 2
        low = s.positions[:, 1] < 0.5
        for side in (low, ~low):
            every = {int(i) for part in COMM.allgather(mine[side].tolist()) for i in part}
            assert len(every) == 1
        assert block(n=2, method=method).surfaces[0].parts[1] == 1


@pytest.mark.parametrize(
    ("gap", "cosine", "refused"),
    [
        (-1.1e-9, 0.0, True),
        (-1.1e-9, 1.1e-9, False),
        (-0.5, -1.0, True),
        (-0.9e-9, -1.0, False),
        (0.5, -1.0, False),
        (-0.5, 0.9e-9, True),
    ],
)
def test_overlaps_from_behind(gap, cosine, refused):
    """Deeper than a billionth of a facet, here of one, where normals do not face each other."""
    out = np.array([[0.0, 1.0], [0.0, 1.0], [7.0, 7.0]])
    normals = np.array([[0.0, 1.0], [np.sqrt(1.0 - cosine**2), cosine]])
    points = SimpleNamespace(evaluator=lambda given: lambda: {"out": out}, number=2, mean_width=1.0)
    s = SimpleNamespace(
        comm=COMM,
        name="foot",
        domain=box(COMM, 1, "tri"),
        points=points,
        positions=np.array([[1.0, 2.0], [3.0, 4.0]]),
    )
    gaps = np.array([-1.0, gap])
    if not refused:
        DiscreteSurface._require_this_side(s, gaps, normals, ", here")
        return
    with pytest.raises(ValueError, match=r"foot, here: a contact point at \(3, 4\) begins so deep"):
        DiscreteSurface._require_this_side(s, gaps, normals, ", here")


@pytest.mark.parametrize(
    ("interference", "remove", "worst", "words"),
    [
        (False, None, -0.1 + 1e-3, None),
        (False, None, -0.1 - 1e-3, "overlap by 0.101; interference=True"),
        (True, None, -9.0, None),
        (0.5, None, -0.5, None),
        (0.5, None, -0.51, "overlap by 0.51; interference allows 0.5"),
        (1e-3, None, -2e-3, "overlap by 0.002; interference allows 0.001"),
        (False, 0.5, -0.5, None),
        (False, 0.5, -0.51, "overlap by 0.51; remove_overlap allows 0.5"),
    ],
)
def test_overlaps_with_an_obstacle(interference, remove, worst, words):
    """Up to 5 % of a facet, here of 2, or what is given; what is removed is taken from gaps."""
    taken = []
    s = SimpleNamespace(
        _overlap=Overlap.of("foot", interference, remove),
        comm=COMM,
        name="foot",
        points=SimpleNamespace(mean_width=2.0, remove_overlap=lambda *gaps: taken.append(gaps)),
        _require_this_side=lambda *given: taken.append(given),
    )
    gaps, there = np.array([1.0, worst]), np.array([worst])
    normals = np.ones((2, 2))
    if words:
        with pytest.raises(ValueError, match=words):
            DiscreteSurface._settle_overlap(s, gaps, there, normals)
        assert not taken
        return
    DiscreteSurface._settle_overlap(s, gaps, there, normals)
    DiscreteSurface._settle_overlap(s, gaps[:0], there, normals)
    if remove is None:
        assert not taken
    else:
        assert taken[0][0] is gaps
        assert taken[0][1] is normals
        assert taken[1][0] is gaps
        assert taken[1][1] is there


def test_tractions_of_an_integral_method_whose_vertex_is_given_away():
    """At Gauss points as if the vertex had the mean of those around it."""
    s = block(n=4, method="integral", law=Coulomb(0.3)).surfaces[0]
    points = s.points
    W = points.vertices
    x = W.tabulate_dof_coordinates()[:, 0]
    owned = W.dofmap.index_map.size_local
    values = np.column_stack([np.sin(5.0 * x), x**2])[:owned]
    at = lambda: points.traction(values.reshape(-1))  # noqa: E731
    knots = np.linspace(0.0, 1.0, 5)
    table = np.column_stack([np.sin(5.0 * knots), knots**2])
    X = points.positions[:, 0]

    def expected(table):
        return np.column_stack([np.interp(X, knots, column) for column in table.T])

    np.testing.assert_allclose(at(), expected(table), atol=1e-13)
    given = np.abs(x - 0.5) < 1e-9
    np.testing.assert_array_equal(points.give(given, np.zeros_like(given)), given)
    table[2] = (table[1] + table[3]) / 2
    np.testing.assert_allclose(at(), expected(table), atol=1e-13)
    # Asked again it is the same, and given back it is as it was.
    before = points.connections
    assert before == 2
    np.testing.assert_array_equal(points.give(given.copy(), np.zeros_like(given)), given)
    assert points.connections == before
    none = np.zeros_like(given)
    np.testing.assert_array_equal(points.give(none, none), none)
    table[2] = [np.sin(2.5), 0.25]
    np.testing.assert_allclose(at(), expected(table), atol=1e-13)
