"""Small parts of contact points and pairs whose answers are known beforehand."""

import logging
from dataclasses import dataclass
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import KINDS, block, box
from test_pair import displacement, refused, stacked

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, NonlocalCoulomb
from dolfinx_contact.laws import OPEN, PLUS, Border, Law, StatusPiece
from dolfinx_contact.materials import Axisymmetric, LinearElastic
from dolfinx_contact.obstacles import Start, has_ufl
from dolfinx_contact.points.arcs import _SERIES, _SMALL
from dolfinx_contact.points.descriptions import displacement_degree
from dolfinx_contact.points.displaced import DisplacedPoints
from dolfinx_contact.points.sliding.candidates import Candidates
from dolfinx_contact.points.sliding.faces import SlidingFaces
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_normals, rounded
from dolfinx_contact.reduced.gathered import _tangents
from dolfinx_contact.results.tables import violation

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize(("dim", "cell"), KINDS)
def test_areas_of_facets(dim, cell):
    """Of an affine image: the area vector of a face turns with the cofactors of the map."""
    domain = box(COMM, 2, cell)
    A = np.eye(dim) + 0.3 * np.random.default_rng(3).normal(size=(dim, dim))
    assert np.linalg.det(A) > 0
    x = domain.geometry.x
    x[:, :dim] = x[:, :dim] @ A.T + 1.0
    cofactors = np.linalg.det(A) * np.linalg.inv(A).T
    domain.topology.create_connectivity(dim - 1, dim)
    owned = domain.topology.index_map(dim - 1).size_local
    every = mesh.exterior_facet_indices(domain.topology)
    every = every[every < owned]
    areas = facet_normals(domain, every, unit=False)
    units = facet_normals(domain, every)
    middles = mesh.compute_midpoints(domain, dim - 1, every)[:, :dim]
    before = np.linalg.solve(A, (middles - 1.0).T).T
    outward = np.where(np.abs(before - 0.5) > 0.499, np.sign(before - 0.5), 0.0)
    share = 0.5 if cell == "tet" else 1.0
    expected = share * 0.5 ** (dim - 1) * outward @ cofactors.T
    np.testing.assert_allclose(areas, expected, atol=1e-13)
    lengths = np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(units, expected / lengths, atol=1e-13)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("cell", ["tet", "hex"])
def test_the_size_of_facets_in_space(cell, caplog):
    """A radius below that of their edges at right angles is said, on one rank; one above is not."""
    for radius, times in ((0.505, 0), (0.495, 1)):
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            law = NonlocalCoulomb(0.3, radius)
            problem = block(domain=box(COMM, 4, cell, size=2.0), law=law)
            assert problem.surfaces[0].law_at_points.neighbours.matrix.size[0] == 25
        said = [r.message for r in caplog.records if "below the mesh size, 0.5:" in r.message]
        assert len(said) == (times if COMM.rank == 0 else 0)


def test_components_in_ufl():
    """Of tuples, lists and arrays with one axis, one is enough; it is a scalar."""
    x = ufl.SpatialCoordinate(box(COMM, 1, "tri"))
    for listed in ((x[0], 1.0), [0.0, x[1]], np.array([x[0], 0.0], dtype=object)):
        assert has_ufl(listed)
    table = np.array([[x[0], 0.0], [0.0, x[1]]], dtype=object)
    none = (0.0, 1.0), [1.0], np.zeros(2), np.zeros((2, 2)), np.array(1.0), 1.0
    for other in (*none, table, x, (x, x), x[0]):
        assert not has_ufl(other)


@pytest.mark.parametrize("sliding", ["small", None])
def test_what_is_for_large_sliding_alone(sliding):
    both = stacked(2, "quad", 2)
    u = displacement(both.mesh)
    for what, given in (
        ("search_distance", {"search_distance": 0.1}),
        ("symmetry", {"symmetry": {0: 0.0}}),
    ):
        refused(f"only sliding='large' supports {what}", u, both, sliding=sliding, **given)


@pytest.mark.parametrize("method", ["nodal", "mixed"])
def test_circumferences_of_a_ring(method):
    """Areas, gaps and slips are means with the weight 2 pi r and the hats of the mixed method."""
    n = 4
    domain = box(COMM, n, "tri")
    domain.geometry.x[:, 0] += 1.0
    domain.geometry.x[:, 1] += 0.1 * domain.geometry.x[:, 0] * (1.0 - domain.geometry.x[:, 1])
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    u.interpolate(lambda x: np.vstack([0.02 * x[0], 0.0 * x[0]]))
    foot = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.1 * x[0]))
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    kind = dict(obstacle=floor, law=Coulomb(0.3), method=method, axisymmetric=True)
    surface = ContactSurface(u, foot, **kind)
    energy = Axisymmetric(LinearElastic.from_young(1.0, 0.3)).energy(u)
    problem = ContactProblem(energy * ufl.dx, u, [surface])

    points = problem.surfaces[0].points
    r = points.positions[:, 0]
    t, w = np.polynomial.legendre.leggauss(3)
    areas, sections, means = np.zeros((3, len(r)))
    for side in (-1.0, 1.0):
        s = 0.5 * (1.0 + t)  # from the node to the next
        inside = np.abs(r + side / n - 1.5) < 0.5 + 1e-9
        places = r[:, None] + side * s / n
        hats = 0.5 * w * (1.0 - s) * np.sqrt(1.01) / n
        sections += inside * hats.sum()
        areas += inside * (2.0 * np.pi * places * hats).sum(axis=1)
        means += inside * (2.0 * np.pi * places**2 * hats).sum(axis=1)
    if method == "nodal":
        places = r
    else:
        places = means / areas
        np.testing.assert_allclose(points.areas, areas, rtol=1e-12)
        around = areas / sections
        np.testing.assert_allclose(points.circumferences[: len(r)], around, rtol=1e-12)
    total = COMM.allreduce(float(points.areas.sum()))
    np.testing.assert_allclose(total, 3.0 * np.pi * np.sqrt(1.01), rtol=1e-12)
    (at,) = problem.evaluate().surfaces
    un = -np.sum((at.jump - points.data.gap[:, None] * points.data.n) * points.data.n, axis=1)
    np.testing.assert_allclose(un, 0.1 * places, rtol=1e-12)
    np.testing.assert_allclose(at.jump[:, 0], 0.02 * places, rtol=1e-12)


@pytest.mark.parametrize(
    ("state", "off"),
    [
        ((0.0, 0.0, 0.2, 1.0), 0.0),
        ((0.7, 0.0, -0.3, 1.0), 0.0),
        ((0.7, 0.4, 0.0, 0.0), 0.0),
        ((0.0, -0.1, 0.0, 0.0), 0.1),  # in the floor
        ((0.0, 0.0, 0.0, -0.1), 0.1),  # drawn
        ((0.0, 0.1, 0.0, 0.1), 0.1),  # pressed across a gap
        ((0.0, 0.0, 0.4, 1.0), 0.1),  # outside of the cone
        ((0.1, 0.0, 0.0, 1.0), 0.1),  # slips without friction
        ((0.5, 0.0, 0.3, 1.0), 0.5),  # with the drag
        ((0.0, 0.2, 0.1, 0.0), 0.1),  # sheared where it is open
    ],
)
@pytest.mark.parametrize("scale", [1.0, 1e4])
def test_every_way_to_violate_friction(state, off, scale):
    """One point of a floor, (ut, un, rt, rn), with F = 0.3: by how much r misses its projection."""
    found = violated(block(n=2), *state, force=scale)
    assert found == pytest.approx(off, abs=1e-12)


def violated(problem, ut, un, rt, rn, *, force):
    """What violates the law at the middle of the foot of a block of two cells, forces over one."""
    eq = problem.equations
    points = problem.surfaces[0].points
    X = problem.V.tabulate_dof_coordinates()[: eq.owned_sizes[0] // 2]
    here = np.isclose(X[:, 0], 0.5) & np.isclose(X[:, 1], 0.0)
    there = np.isclose(points.positions[:, 0], 0.5)
    u = np.where(here[:, None], [ut, un], 0.0)
    traction = np.where(there[:, None], [rt * force, rn * force], 0.0) / points.areas[:, None]
    x = eq.create_vector()
    eq.put([u.reshape(-1), traction.reshape(-1)], np.zeros(0), x)
    return violation(eq, eq.contact(x), force, 1.0)


@dataclass(frozen=True)
class Hollow(Law):
    """A floor without friction that has no answer where it is drawn by less than 1."""

    def pieces(self, a):
        return {
            OPEN: StatusPiece(0.0 * a.n, [Border(-a.p - 1.0, PLUS)]),
            PLUS: StatusPiece(-a.p * a.n, [Border(a.p, OPEN)]),
        }


@pytest.mark.parametrize(("drawn", "off"), [(0.0, 0.0), (0.25, 0.125), (-1.0, 0.0)])
def test_what_no_status_holds_violates_the_law(drawn, off):
    """By its distance to the nearest, on an area of 1/2; its traction is what that answers."""
    found = violated(block(n=2, law=Hollow()), 0.0, 0.0, 0.0, -0.5 * drawn, force=1.0)
    assert found == pytest.approx(off, abs=1e-12)


def test_the_series_of_short_arcs():
    """Of (asin(s)/s - sqrt(1 - q))/q with q = s^2, where that loses few digits."""
    q = _SMALL * np.array([0.5, 0.9, 1.0])
    s = np.sqrt(q)
    exact = (np.arcsin(s) / s - np.sqrt(1.0 - q)) / q
    series = np.polynomial.polynomial.polyval(q, _SERIES)
    np.testing.assert_allclose(series, exact, rtol=1e-12)


@pytest.mark.parametrize(
    ("cell", "width"), [("tri", 0.5), ("quad", 0.5), ("tet", np.sqrt(0.125)), ("hex", 0.5)]
)
def test_widths_of_facets(cell, width):
    """Lengths in the plane, roots of areas in space; that of a vertex is the root of its area."""
    points = block(n=2, cell=cell).surfaces[0].points
    np.testing.assert_allclose(points.facet_widths.x.array, width, rtol=1e-12)
    number = 3 if cell in ("tri", "quad") else 9
    exponent = 1.0 if cell in ("tri", "quad") else 0.5
    assert points.mean_width == pytest.approx((1 / number) ** exponent)
    assert points.mean_vertex_area == pytest.approx(1 / number)


@pytest.mark.parametrize("dim", [2, 3])
def test_tangents_of_points(dim):
    """Unit vectors at right angles to the normal and to one another, whatever its direction."""
    n = np.random.default_rng(1).normal(size=(12, dim))
    n = np.vstack([n, np.eye(dim), -np.eye(dim)])
    n /= np.linalg.norm(n, axis=1)[:, None]
    frames = np.stack([*_tangents(n), n], axis=2)
    np.testing.assert_allclose(
        frames.transpose(0, 2, 1) @ frames, np.eye(dim)[None] + 0 * frames, atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(frames), -1.0 if dim == 2 else 1.0)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e7])
def test_coordinates_are_rounded_in_any_unit(unit):
    """To nine digits of the largest, 3.2 units; of nothing, or of zeros, nothing is made."""
    x = np.array([[3.2, -1.0], [0.1234567891234, 2.0 / 3.0]])
    np.testing.assert_allclose(rounded(unit * x), unit * np.round(x, 8), rtol=1e-12)
    np.testing.assert_array_equal(rounded(np.zeros((2, 2))), 0.0)
    assert rounded(np.zeros((0, 2))).shape == (0, 2)


def test_elements_of_displacements():
    """Continuous Lagrange elements alone, whose degree is known."""
    domain = box(COMM, 1, "tri")
    for degree in (1, 2):
        V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
        assert displacement_degree(fem.Function(V)) == degree
    for other in (("DG", 1, (2,)), ("DG", 2, (2,)), ("CR", 1, (2,)), ("Lagrange", 1)):
        with pytest.raises(ValueError, match="must be a continuous vector Lagrange"):
            displacement_degree(fem.Function(fem.functionspace(domain, other)))


def test_which_overlaps_are_removed_at_a_start():
    """Those up to the most, where the obstacle holds the face or the face looks to it by 60
    degrees; what multiplies the height of others is their gap. What is taken is taken of all."""
    turned = np.deg2rad([0.0, 59.0, 61.0, 91.0, 180.0])
    out = np.stack([np.sin(turned), -np.cos(turned)], axis=1)
    n = len(turned)
    normal = np.broadcast_to([0.0, -1.0], (n, 2))
    gap, taken = np.arange(1.0, n + 1.0), 10.0 * np.arange(n)
    for height, faces in ((-0.1, [True, True, False, False, False]), (-0.11, [False] * n)):
        for held in (False, True):
            start = Start(gap, np.full(n, height), normal, np.full(n, held))
            points = SimpleNamespace(shape=SimpleNamespace(starts=lambda x, w, s=start: s))
            of_face = {"out": out, "width": None, "taken": taken}
            found, towards = DisplacedPoints._started(points, np.zeros((n, 2)), of_face, 0.1)
            removed = np.array([height == -0.1] * n if held else faces)
            np.testing.assert_array_equal(found, np.where(removed, height, gap) + taken)
            np.testing.assert_array_equal(towards, normal)


def test_what_of_one_face_may_touch_itself():
    """What lies behind, if it is far or looks back by more than 60 degrees, and has no node in
    common. What lies as far is behind by its first coordinate, and no image is."""
    mine = np.zeros((1, 2, 2))
    along = np.array([0.0, 1.0])
    rows = [  # cosine of the normals, place, mirror, whether a node is shared, whether it is kept
        (-0.6, (0.0, -1.0), 1, False, True),
        (-0.4, (0.0, -1.0), 1, False, False),
        (0.4, (0.0, -1.0), 1, False, False),
        (1.0, (0.0, -1.0), 1, False, False),
        (1.0, (0.0, -3.9), 1, False, False),
        (1.0, (0.0, -4.1), 1, False, True),  # far
        (-1.0, (0.0, -5.0), 1, True, False),
        (-1.0, (0.0, 1.0), 1, False, False),  # ahead
        (-1.0, (-1.0, 0.0), 1, False, True),  # as far
        (-1.0, (1.0, 0.0), 1, False, False),
        (-1.0, (-1.0, 0.0), -1, False, False),
        (-1.0, (-1.0, -1e-9), -1, False, False),
        (-1.0, (-1.0, -1e-3), -1, False, True),
    ]
    cosines, places, mirrors, shared, kept = (np.array(v) for v in zip(*rows, strict=True))
    theirs = np.repeat(places[:, None], 2, axis=1)
    normals = np.stack([np.sqrt(1.0 - cosines**2), cosines], axis=1)
    pairs = np.stack([np.zeros(len(rows), dtype=int), np.arange(len(rows))], axis=1)
    none = np.zeros((len(rows), 0), dtype=int)
    two = np.stack([mirrors, np.ones_like(mirrors)], axis=1)
    found = Candidates(none, np.ones(len(rows)), two, pairs, none, none)
    faces = SimpleNamespace(
        _reference=mine,
        _skin=1.0,
        _before=lambda found: theirs,
        _faces=lambda found, mine, theirs: (
            SimpleNamespace(normals=along[None]),
            SimpleNamespace(normals=normals),
        ),
        _shares_node=lambda found: shared,
    )
    left = SlidingFaces._of_itself(faces, found, along)
    np.testing.assert_array_equal(left.pairs[:, 1], np.flatnonzero(kept))
    assert left.mirrors is two


def test_lengths_of_normals_of_obstacles():
    """They are 1 but for a part in a million, up and down."""
    for length, fits in ((1.0, True), (1.0 + 5e-7, True), (1.00001, False), (0.5, False)):
        normals = np.array([[0.0, 1.0], [0.0, -length]])
        s = SimpleNamespace(
            comm=COMM,
            _uniform=[],
            name="foot",
            obstacle=SimpleNamespace(radius_given=None),
            between_bodies=False,
            points=SimpleNamespace(vertex_normals=normals),
        )
        if fits:
            DiscreteSurface.check_gaps(s)
        else:
            with pytest.raises(ValueError, match=f"length 1, and one has {length:.6g}"):
                DiscreteSurface.check_gaps(s)
