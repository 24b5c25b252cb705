"""Rigid surfaces of facets: distances, orientation, files, and contact with them."""

from mpi4py import MPI

import cases.punch
import numpy as np
import pytest
from cases._surfaces import ball, brick, cylinder, disc, outward, write_stl
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from support import blocks
from support.blocks import same_tables
from support.curved_obstacles import (
    OnBody,
    Stopped,
    block,
    errors_of_differences,
    pressed_and_led,
    remembering,
    shaken_and_direction,
)

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Cylinder,
    Frictionless,
    LevelSet,
    RigidBody,
    RigidSurface,
    Sphere,
)
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.records import EvolutionRecord
from dolfinx_contact.rigid_surfaces.closest import closest_on

COMM = MPI.COMM_WORLD
SURFACES = {
    "ball": ball(4),
    "cylinder": cylinder(40),
    "box": brick((-1, -1, -1), (1, 1, 1)),
    "disc": disc(30),
    "square": brick((-1, -1), (1, 1)),
}
REFUSED = pytest.mark.refuses("surfaces of facets", aspects=("2D", "3D"))


def places(dim, number=400):
    return 1.2 * np.random.default_rng(1).normal(size=(number, dim))


# -- distances -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.verifies(
    "surfaces of facets",
    reference="enumeration: the distances of all facets",
    aspects=("2D", "3D"),
)
def test_distances_are_those_of_all_facets_one_by_one(name):
    """The search agrees with all facets one by one, and derivatives agree with differences."""
    surface = RigidSurface(*SURFACES[name])
    dim = surface.points.shape[1]
    x = np.concatenate([places(dim), 20 * places(dim)[:20], 1e-3 * places(dim)[:20]])
    found = surface.distances(x)
    best = np.full(len(x), np.inf)
    for facet in surface.points[surface.cells]:
        corners = np.broadcast_to(facet, (len(x), *facet.shape))
        feet = np.einsum("nk,nki->ni", closest_on(x, corners), corners)
        best = np.minimum(best, np.linalg.norm(x - feet, axis=1))
    np.testing.assert_allclose(np.abs(found.distance), best, atol=1e-14)
    if name in ("box", "square"):
        over = np.abs(x) - 1.0
        outside = np.linalg.norm(np.maximum(over, 0.0), axis=1)
        exact = outside + np.minimum(over.max(axis=1), 0.0)
        np.testing.assert_allclose(found.distance, exact, atol=1e-14)
    # Away from where the closest facet changes.
    h = 1e-5
    slope, turn = np.empty_like(found.slope), np.empty_like(found.turn)
    for i in range(dim):
        after, before = (surface.distances(x + s * h * np.eye(dim)[i]) for s in (1, -1))
        slope[:, i] = (after.distance - before.distance) / (2 * h)
        turn[:, :, i] = (after.normal - before.normal) / (2 * h)
    for off in (slope - found.slope, turn - found.turn):
        each = np.sort(np.abs(off).reshape(len(x), -1).max(axis=1))
        assert each[int(0.95 * len(x))] < 1e-8


@pytest.mark.parametrize("shape", [disc(2000), ball(8)], ids=["disc", "ball"])
def test_distances_do_not_depend_on_the_number_of_points(shape):
    """All facets are candidates near the centre; many points are searched in groups."""
    surface = RigidSurface(*shape)
    x = 1e-3 * places(surface.points.shape[1])
    parts = [vars(surface.distances(some)) for some in np.split(x, 8)]
    for name, values in vars(surface.distances(x)).items():
        np.testing.assert_array_equal(np.concatenate([p[name] for p in parts]), values)


@pytest.mark.verifies(
    "surfaces of facets", reference="closed form: the distance from a box", aspects=("3D",)
)
@pytest.mark.parametrize("width", [1e-5, 1e-7, 1e-9])
def test_closest_points_of_slivers_are_exact(width):
    """Points above and below a fan of facets that thin are as far from it as from its plane."""
    rng = np.random.default_rng(4)
    corners = np.zeros((200, 3, 3))
    corners[:, 1, 0] = 1.0
    corners[:, 2, 0] = rng.uniform(0.2, 0.8, 200)
    corners[:, 2, 1] = width
    turn = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    parts = rng.dirichlet([1.0, 1.0, 1.0], 200)
    places = np.einsum("nk,nki->ni", parts, corners)
    for height in (0.0, 1e-9, 1e-3, 1.0):
        x = (places + np.array([0.0, 0.0, height])) @ turn.T
        found = closest_on(x, corners @ turn.T)
        assert (found >= 0).all()
        feet = np.einsum("nk,nki->ni", found, corners)
        np.testing.assert_allclose(feet, places, atol=1e-16 / width + 1e-14)


@pytest.mark.verifies(
    "surfaces of facets",
    reference="closed form: normals of spheres and circles",
    aspects=("2D", "3D"),
)
def test_normals_at_points_of_spheres_are_exact():
    """Averages at points on a circle and a sphere are the exact normals, however the points lie."""
    rng = np.random.default_rng(2)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 40))
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    cells = np.stack([np.arange(40), (np.arange(40) + 1) % 40], axis=1)
    points, triangles = ball(5)
    points = points + rng.normal(size=points.shape) * 0.02
    points /= np.linalg.norm(points, axis=1)[:, None]
    for x, facets in ((circle, cells), (points, triangles)):
        surface = RigidSurface(x, facets, crease=90.0)
        np.testing.assert_allclose(surface.distances(x).normal, x, atol=1e-12)
        beside = 1.0001 * surface.distances(0.9 * x).feet
        assert np.isfinite(surface.distances(beside).normal).all()


@pytest.mark.verifies(
    "surfaces of facets", reference="closed form: distances from a segment", aspects=("2D",)
)
def test_rims_are_equally_far_from_points_on_both_sides():
    plate = RigidSurface([[0.0, 0.0], [1.0, 0.0]], [[1, 0]])
    assert not plate.closed
    x = np.array([[0.5, 0.2], [0.5, -0.2], [1.3, 0.4], [1.3, -0.4], [-0.3, -0.4]])
    found = plate.distances(x)
    np.testing.assert_allclose(found.distance, [0.2, -0.2, 0.5, 0.5, 0.5], atol=1e-15)
    assert found.past.tolist() == [False, False, False, True, True]
    die = RigidSurface(*disc(30), reverse=True)
    assert die.distances(np.zeros((1, 2))).distance[0] > 0.9


# -- derivatives in the equations ------------------------------------------------------------------


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    ("kind", "given"),
    [
        ("disc", {}),
        ("disc", {"method": "integral"}),
        ("disc", {"method": "integral", "remove_overlap": 1.0}),
        ("ball", {}),
        ("ball", {"crease": 0.0}),
        ("arc", {}),
        ("cap", {}),
    ],
)
@pytest.mark.verifies(
    "surfaces of facets",
    "Coulomb",
    "rigid bodies",
    reference="differences: central differences",
    aspects=("2D", "3D", "large sliding"),
)
def test_the_jacobian_on_rigid_surfaces_agrees_with_differences(kind, given):
    """Gap, normal and slip with memory, on a body that has turned, and past the rims of such."""
    dim = 2 if kind in ("disc", "arc") else 3
    crease = given.get("crease", 30.0)
    given = {name: value for name, value in given.items() if name != "crease"}
    made = disc(24, 3.0, (0.4, -3.0), 0.1) if dim == 2 else ball(3, 3.0, (0.4, 0.6, -3.0))
    if kind in ("arc", "cap"):
        middles = made[0][made[1]].mean(axis=1)
        used, cells = np.unique(made[1][middles[:, 0] < 0.4], return_inverse=True)
        made = made[0][used], cells.reshape(-1, dim)
    # The cones of an edge are narrow: rounding makes them wide.
    shape = RigidSurface(*made, crease=crease, rounding=0.0 if crease else 0.3)
    motion = {"rz": 0.3} if dim == 2 else {"rx": 0.2, "ry": -0.3, "rz": 0.4}
    held = ["x", "y", "z"][:dim]
    body = RigidBody(shape, about=[0.4, *[0.5] * (dim - 2), -1.0], motion=motion, held=held)
    cell = "quad" if dim == 2 else "hex"
    given |= dict(law=Coulomb(0.3), sliding="large", interference="remove_overlap" not in given)
    problem = block(body, cell=cell, n=2, **given)
    problem = remembering(problem)
    rigid = problem.equations.rigid
    motions = rigid.here(problem.equations.constraints.motions())
    x, v = shaken_and_direction(problem, motions, 0.0)
    errors = errors_of_differences(problem, x, v, (1e-5, 1e-6))
    assert errors[0] < 1e-5
    assert errors[1] < 0.02 * errors[0] + 1e-8


# -- contact ---------------------------------------------------------------------------------------


def force_of(shape, dim, law=None, **given):
    """Return the force of a block pressed on a shape and pulled over it."""
    on_body = OnBody(dim, shape, law or Coulomb(0.3), n=4, **given)

    def motion(t, X):
        return pressed_and_led(t, X, press=0.1, shear=0.3)

    steps = on_body.run(motion, [0.0, 0.5, 1.0, 1.5, 2.0]).steps
    return steps[-1].result


#: Exact, of facets with k times as many along a line, and by how much these are off with k = 1.
CURVED = {
    "disc": (
        Sphere((0.4, -1.0), 1.0),
        lambda k: disc(20 * k, 1.0, (0.4, -1.0), 0.3),
        (np.pi / 10) ** 2 / 8,
    ),
    "ball": (
        Sphere((0.4, 0.45, -1.0), 1.0),
        lambda k: ball(4 * k, 1.0, (0.4, 0.45, -1.0)),
        (1.1 * np.arctan(2.0) / 4) ** 2 / 6,
    ),
    "roller": (
        Cylinder((0.4, 0.5, -1.0), (0.0, 1.0, 0.0), 1.0),
        lambda k: cylinder(40 * k, 1.0, 4.0, (0.4, 0.5, -1.0)),
        (np.pi / 20) ** 2 / 8,
    ),
}


@pytest.mark.parametrize(
    ("kind", "method"),
    [
        *(("disc", "nodal"), ("disc", "integral")),
        pytest.param("ball", "nodal", marks=pytest.mark.long),
        pytest.param("roller", "nodal", marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "surfaces of facets",
    "spheres",
    "cylinders",
    "Coulomb",
    "quasi-static",
    reference="itself: exact spheres and cylinders",
    aspects=("2D", "3D", "large sliding"),
)
def test_facets_converge_to_exact_shapes(kind, method):
    """A block pulled over a sphere and a cylinder: facets are off by the square of their size."""
    dim = 2 if kind == "disc" else 3
    exact, made, sagitta = CURVED[kind]
    expected = force_of(exact, dim, method=method).resultants["contact"]
    off = []
    for k in (1, 4):
        found = force_of(RigidSurface(*made(k)), dim, method=method)
        assert method == "integral" or found.kkt_violation < 1e-9
        off.append(np.abs(found.resultants["contact"] - expected).max() / np.abs(expected).max())
        # By no more than the facets are off, over the depth of 0.1: the square of their size.
        assert off[-1] < 2 * sagitta / k**2 / 0.1
    assert off[1] < off[0] / 4


@pytest.mark.ranks(2, 3)
@pytest.mark.verifies(
    "surfaces of facets",
    "rigid bodies",
    "Coulomb",
    reference="itself: on one rank, and the distance of a rectangle as a level set",
    aspects=("2D", "large sliding"),
)
def test_flat_punch_agrees_with_its_distance_function():
    """A punch with sharp corners agrees with its distance function on any number of ranks."""

    def box(x):
        over = [abs(x[0] - 0.51) - 0.21, abs(x[1] + 0.5) - 0.5]
        outside = sum(ufl.max_value(v, 0.0) ** 2 for v in over)
        far = ufl.gt(outside, 0.0)
        inside = ufl.max_value(*over)
        return ufl.conditional(far, ufl.sqrt(ufl.conditional(far, outside, 1.0)), inside)

    punch = RigidSurface(*brick((0.3, -1.0), (0.72, 0.0)))
    expected = force_of(LevelSet(box), 2).tables["contact"]
    same_tables(force_of(punch, 2).tables["contact"], expected, 1e-9)
    alone = force_of(punch, 2, comm=MPI.COMM_SELF).tables["contact"]
    same_tables(force_of(punch, 2).tables["contact"], alone, 1e-8)


@pytest.mark.verifies(
    "surfaces of facets",
    "Signorini",
    reference="closed form: a face without friction carries along its normal",
    aspects=("3D", "large sliding"),
)
def test_tractions_follow_averaged_normals():
    shape = RigidSurface(*ball(6, 1.0, (0.4, 0.45, -1.0)))
    result = force_of(shape, 3, Frictionless())
    table = result.tables["contact"]
    assert (table.rn > 0).any()
    assert np.abs(table.rt).max() < 1e-9 * table.rn.max()


@pytest.mark.verifies(
    "records of histories",
    "surfaces of facets",
    reference="itself: a history without a stop",
    aspects=("2D", "records"),
)
def test_a_record_continues_with_its_own_rigid_surface(folder):
    """A record goes on with the surface that it was made with, and no other."""

    def made(start=0.0):
        shape = RigidSurface(*disc(20, 1.0, (0.4, -1.0), start))
        on_disc = OnBody(2, shape, Coulomb(0.3), n=2)

        def load(t):
            on_disc.move(lambda X: pressed_and_led(t, X, shear=0.2))

        return QuasiStatic(on_disc.problem, load)

    times = [0.0, 1.0, 1.5, 2.0]
    expected = made().run(times, rays=False).steps[-1].result.tables["contact"]

    def watch(step):
        if step.number == 2:
            raise Stopped

    begun = made()
    with EvolutionRecord(folder, begun) as record, pytest.raises(Stopped):
        begun.run(times, rays=False, record=record, observer=watch)
    with pytest.raises(ValueError, match=r"another problem|differ"):
        EvolutionRecord(folder, made(0.01), resume=True)
    with EvolutionRecord(folder, made(), resume=True) as record:
        found = record.go_on().steps[-1].result
    same_tables(found.tables["contact"], expected, 1e-9)


# -- what is passed --------------------------------------------------------------------------------


@pytest.mark.verifies(
    "surfaces of facets", reference="closed form: depths of corners in facets", aspects=("2D",)
)
def test_a_corner_between_points_is_warned_of(caplog):
    wedge = RigidSurface([[0.35, -0.02], [0.05, -0.6], [0.65, -0.6]], [[0, 1], [1, 2], [2, 0]])
    on_wedge = OnBody(2, wedge, Frictionless(), n=2)
    on_wedge.move(lambda X: np.tile([0.0, -0.15], (len(X), 1)))
    result = on_wedge.problem.solve()
    # The facet of the nodes at 0 and 0.5 has come down by 0.15.
    depth = result.indicators.surfaces["contact"].between_points
    assert depth == pytest.approx(0.13 / 0.5, rel=1e-9)
    assert ("by 0.26 of the facet size" in caplog.text) == (COMM.rank == 0)


@pytest.mark.ranks(2)
def test_facets_that_are_coarse_for_the_contact_give_a_warning():
    """Chords of a disc are h^2/(8 R) away from it; the faces of a punch are flat."""
    pressed = dict(n=16, cell="quad", law=Frictionless(), top=(0.0, -0.05))
    found = {}
    for number in (40, 240):
        chords = RigidSurface(*disc(number, 3.0, (0.4, -3.0), 0.02))
        h = 6.0 * np.sin(np.pi / number)
        np.testing.assert_allclose(chords.heights, [[h**2 / 24] * number, [h] * number], rtol=0.02)
        result = blocks.block(obstacle=chords, **pressed).solve()
        found[number] = result.indicators.surfaces["contact"].facets
        assert ("facets of 'contact'" in result.warnings) == (number == 40)
    assert 0.0 < found[240] < 0.03 * found[40]
    punch = RigidSurface(*brick((0.3, -1.0), (0.72, 0.0)))
    result = blocks.block(obstacle=punch, **pressed).solve()
    assert result.indicators.surfaces["contact"].facets == 0.0


# -- bad input -------------------------------------------------------------------------------------


@REFUSED
@pytest.mark.parametrize("unit", [1e-6, 1e3])
def test_a_rigid_surface_in_other_units_gives_a_warning(unit):
    plate = RigidSurface(unit * np.array([[-1.0, -0.1], [2.0, -0.1]]), [[1, 0]])
    result = blocks.block(obstacle=plate).solve()
    (text,) = (v for name, v in result.warnings.items() if name == "units of 'contact'")
    assert f"is {3 * unit:.3g}, and that of the body 1.41: are both in the same unit" in text
    assert "side of 'contact'" not in result.warnings


def test_rigid_surfaces_refuse_inconsistent_and_flat_facets():
    points, cells = ball(1)
    flipped = cells.copy()
    flipped[3] = flipped[3, ::-1]
    fan = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    torn = points[cells].reshape(-1, 3)
    alone = np.arange(len(torn)).reshape(-1, 3)
    for x, facets, given, message in (
        (points, flipped, {}, "3 of 30 edges between two are oriented inconsistently"),
        (points, cells[:, ::-1], {}, "a closed surface has inward normals"),
        (points[:5], fan, {}, "not a manifold: 1 edges have more than two facets"),
        (points, np.vstack([cells, [0, 0, 1]]), {}, "1 facets have no area"),
        (np.eye(3) * [[1], [1], [0]] + [0, 0, 1], [[0, 1, 2], [0, 2, 1]], {}, "are repeated"),
        ([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], {}, "1 facets have no area"),
        (np.full((3, 3), np.nan), [[0, 1, 2]], {}, "points must be a finite array"),
        (points, cells.astype(float), {}, "cells must be triangles, indices of points"),
        (points, np.zeros((0, 3), int), {}, "cells must be triangles"),
        (points, cells + 1, {}, "indices of points that do not exist"),
        (points, cells, {"crease": -1.0}, "crease must be from 0 to 180 degrees"),
        (points, cells, {"rounding": np.nan}, "rounding must be a nonnegative number"),
        (torn, alone, {}, "the surface is torn: 60 rim points coincide with others"),
        (torn + 1e-3 * np.sin(np.arange(180.0)).reshape(-1, 3), alone, {}, "torn: 60"),
        ([[0.0, 0], [1, 0], [0, 1]], [[0, 1], [2, 1]], {}, "at 1 of 1 points between two are"),
    ):
        with pytest.raises(ValueError, match=message):
            RigidSurface(x, facets, **given)


def test_the_repair_named_by_errors_gives_the_distances_of_the_right_surface(folder):
    pyvista = pytest.importorskip("pyvista")
    points, cells = ball(1)
    flipped = cells.copy()
    flipped[3] = flipped[3, ::-1]
    right = RigidSurface(points, cells)
    x = places(3, 50)
    for wrong in (flipped, cells[:, ::-1], np.vstack([cells, [0, 0, 1]])):
        write_stl(folder / "wrong.stl", points, wrong)
        with pytest.raises(ValueError, match="clean") as error:
            RigidSurface.read(folder / "wrong.stl")
        assert "clean().compute_normals(auto_orient_normals=True)" in str(error.value)
        repaired = pyvista.read(folder / "wrong.stl").clean()
        repaired = repaired.compute_normals(auto_orient_normals=True)
        tool = RigidSurface(repaired.points, repaired.regular_faces)
        np.testing.assert_allclose(
            tool.distances(x).distance, right.distances(x).distance, atol=1e-6
        )


def test_two_boxes_have_the_distances_of_their_union():
    """A CAD program has not united them; points are outside."""
    box, sides = brick((0, 0, 0), (1, 1, 1))
    facets = np.concatenate([sides, sides + len(box)])
    union = RigidSurface(np.concatenate([box, box + np.array([0.5, 0.0, 0.0])]), facets)
    outside = np.array([[0.75, 0.5, 1.2], [1.0, 0.5, -0.3], [2.0, 0.5, 0.5], [1.75, 1.5, 1.5]])
    expected = [0.2, 0.3, 0.5, np.sqrt(0.0625 + 0.5)]
    np.testing.assert_allclose(union.distances(outside).distance, expected, rtol=1e-14)
    assert RigidSurface(np.concatenate([box, box + np.array([5.0, 0.0, 0.0])]), facets).closed


def test_points_of_rigid_surfaces_are_read_only():
    points, cells = ball(1)
    right = RigidSurface(points, cells)
    with pytest.raises(AttributeError, match="a RigidBody moves it"):
        right.points = points
    with pytest.raises(ValueError, match="read-only"):
        right.points[0] = 0.0


@REFUSED
def test_a_strip_with_one_side_is_refused():
    n = 12
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    way = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    arm = 0.3 * (np.cos(turn / 2)[:, None] * way + np.sin(turn / 2)[:, None] * [0, 0, 1.0])
    k = np.arange(n)
    m, over = (k + 1) % n, np.arange(n) == n - 1
    low, high = np.where(over, m + n, m), np.where(over, m, m + n)
    strip = np.concatenate([np.stack([k, low, high], 1), np.stack([k, high, k + n], 1)])
    with pytest.raises(ValueError, match="oriented inconsistently"):
        RigidSurface(np.concatenate([way - arm, way + arm]), strip)


@pytest.mark.ranks(2)
@REFUSED
def test_rigid_surface_refuses_another_dimension():
    with pytest.raises(ValueError, match="is a surface of segments, for a 2D mesh"):
        OnBody(3, RigidSurface(*disc(20)), Coulomb(0.3))


PLATE = brick((-1.0, -0.07), (2.0, -0.02))


def thrown_at_a_thin_tool(law, speed, tool=None):
    """Return a motion of a block towards a tool that is thinner than the way of a step.

    Args:
        law: contact law.
        speed: downward speed, or velocity.
        tool: tool below the block; default: a plate.
    """
    domain = blocks.box(COMM, 3, "quad")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    tool = tool or RigidSurface(*PLATE)
    face = ContactSurface(u, blocks.facets(domain, 1, 0.0), obstacle=tool, law=law, sliding="large")
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    problem = ContactProblem(NeoHookean(*lame(1000.0, 0.3)).energy(u) * dx, u, [face])
    velocity = fem.Function(u.function_space)
    velocity.x.array.reshape(-1, 2)[:] = speed if np.ndim(speed) else (0.0, -speed)
    return NSCD(problem, density=1.0, dt=0.02, velocity=velocity, mass="lumped")


@pytest.mark.ranks(2)
@pytest.mark.refuses("surfaces of facets", aspects=("2D",))
def test_a_step_through_a_thin_tool_is_refused_or_warned_of():
    """With friction it is refused; without, the step gives a warning, and no shorter one does."""
    with pytest.raises(ValueError, match=r"turned by half a turn .* at a contact point that is at"):
        thrown_at_a_thin_tool(Coulomb(0.3), 4.0).run([0.0, 0.1])
    for speed, through in ((10.0, True), (0.5, False)):
        steps = thrown_at_a_thin_tool(Frictionless(), speed).run([0.0, 0.06]).steps
        assert [step.result.indicators.surfaces["contact"].passing > 90.0 for step in steps].count(
            True
        ) == through


@pytest.mark.refuses("surfaces of facets", aspects=("3D",))
def test_truncated_stl_files_are_refused(folder):
    """Anywhere but in the name of the solid at the end, and in both formats."""
    points, cells = ball(1)
    rng = np.random.default_rng(7)
    for binary in (False, True):
        write_stl(folder / "whole.stl", points, cells, binary=binary)
        content = (folder / "whole.stl").read_bytes()
        end = len(content) if binary else content.rindex(b"endsolid") + len(b"endsolid") - 1
        for size in rng.integers(1, end, 100):
            (folder / "part.stl").write_bytes(content[:size])
            with pytest.raises(ValueError, match=r"truncated|is not a complete"):
                RigidSurface.read(folder / "part.stl")


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "surfaces of facets", reference="closed form: what was written", aspects=("2D", "3D")
)
def test_rigid_surfaces_read_and_write_files(folder):
    """STL in text and binary, gmsh groups in 2D and 3D; errors are equal on all ranks."""
    points, cells = ball(2)
    if COMM.rank == 0:
        for name, binary in (("words.stl", False), ("binary.stl", True)):
            write_stl(folder / name, 1e3 * points, cells, binary=binary)
        (folder / "empty.stl").write_text("solid nothing\nendsolid nothing\n")
        (folder / "broken.stl").write_bytes((folder / "binary.stl").read_bytes()[:-7])
        _write_gmsh(folder / "tool.msh")
    COMM.barrier()
    x = places(3, 40)
    expected = RigidSurface(points, cells).distances(x).distance
    for name, accuracy in (("words.stl", 1e-13), ("binary.stl", 1e-6)):
        tool = RigidSurface.read(folder / name, scale=1e-3)
        assert (len(tool.points), len(tool.cells), tool.closed) == (42, 80, True)
        np.testing.assert_allclose(tool.distances(x).distance, expected, atol=accuracy)
    box = RigidSurface.read(folder / "tool.msh", group="skin")
    assert box.closed
    assert np.isclose(box.distances([[0.5, 0.5, 2.0]]).distance[0], 1.0)
    line = RigidSurface.read(folder / "tool.msh", group="edge")
    assert line.points.shape[1] == 2
    assert not line.closed
    for name, given, error, message in (
        ("none.stl", {}, FileNotFoundError, "none.stl"),
        ("empty.stl", {}, ValueError, "has no facets"),
        ("broken.stl", {}, ValueError, "is not a complete STL file"),
        ("tool.step", {}, ValueError, "from a file .stl or .msh"),
        ("words.stl", {"group": "skin"}, ValueError, "an STL file has no groups"),
        ("words.stl", {"scale": 0.0}, ValueError, "scale must be a positive number"),
        ("tool.msh", {"group": "rim"}, ValueError, "no group 'rim' of curves or surfaces"),
        ("tool.msh", {"group": "void"}, ValueError, "no facets in the group 'void'|no group"),
    ):
        with pytest.raises(error, match=message):
            RigidSurface.read(folder / name, **given)
    if COMM.size > 1:
        with pytest.raises(ValueError, match="scale differs between ranks"):
            RigidSurface.read(folder / "words.stl", scale=1.0 + COMM.rank)


def _write_gmsh(path):
    """A box with its skin, and an edge of it, in groups."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [1], name="body")
    skin = [tag for _, tag in gmsh.model.getEntities(2)]
    gmsh.model.addPhysicalGroup(2, skin, name="skin")
    flat = [
        tag
        for _, tag in gmsh.model.getEntities(1)
        if np.ptp(np.array(gmsh.model.getBoundingBox(1, tag))[[2, 5]]) < 1e-3
    ]
    gmsh.model.addPhysicalGroup(1, flat[:1], name="edge")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(path))
    gmsh.finalize()


# -- the demo --------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("tool", ["ball", "roller", "flat"])
@pytest.mark.verifies(
    "surfaces of facets",
    "rigid bodies",
    "Coulomb",
    "quasi-static",
    reference="itself: exact shapes; closed form: equilibrium with the force",
    aspects=("3D", "large sliding"),
)
def test_the_rigid_indenter_demo_converges(tool, folder, no_pictures):
    found = cases.punch.main([f"--tool={tool}", "--n=6", "--steps=2", f"--output={folder}"])
    assert found["unbalanced"] < 1e-9
    assert found["kkt_violation"] < 1e-9
    assert found["drag_exact"] > 0.2 * 60.0
    if tool == "flat":
        assert found["off"][0] < 1e-9
    else:
        assert found["off"][2] < found["off"][0] / 6
        assert found["off"][2] < 0.02


def _punch(dim, angles, radius=0.1):
    """A box of the width 1 with a top at 0, whose edges are cut to facets with these angles."""
    edge = [(0.4 + radius * np.sin(a), radius * (np.cos(a) - 1.0)) for a in np.radians(angles)]
    section = [*edge, (edge[-1][0], -1.0)]
    if dim == 2:
        points = np.array([(-x, y) for x, y in section[::-1]] + section)
        n = np.arange(len(points))
        return points, np.stack([(n + 1) % len(points), n], axis=1)
    signs = [(a, b) for a in (-1, 1) for b in (-1, 1)]
    points = np.array([(a * x, b * x, z) for a, b in signs for x, z in section])
    return points, outward(points, ConvexHull(points).simplices)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("angles", [range(0, 91, 15), range(0, 91, 30), (0, 50)])
@pytest.mark.verifies(
    "surfaces of facets", reference="closed form: a plane has one normal", aspects=("2D", "3D")
)
def test_narrow_facets_do_not_tilt_flat_parts(dim, angles):
    """Narrow facets of edges that are rounded or cut do not tilt a flat part beside them."""
    punch = RigidSurface(*_punch(dim, angles))
    x = np.zeros((50, dim))
    x[:, :-1] = np.random.default_rng(3).uniform(-0.4, 0.4, (50, dim - 1))
    up = np.eye(dim)[-1]
    np.testing.assert_allclose(punch.distances(x).normal, np.tile(up, (50, 1)), atol=1e-3)


def test_the_size_of_facets_is_that_of_their_mean_area():
    """Right triangles with sides of 1/4 in space, and segments of 1/4 in the plane."""
    x = np.linspace(0.0, 1.0, 5)
    corners = np.array([(a, b, 0.0) for a in x for b in x])
    k = np.array([5 * i + j for i in range(4) for j in range(4)])
    cells = np.concatenate([np.stack([k, k + 5, k + 6], 1), np.stack([k, k + 6, k + 1], 1)])
    assert RigidSurface(corners, cells).facet_size == pytest.approx(0.25 / np.sqrt(2))
    points = np.stack([x, 0 * x], axis=1)
    cells = np.stack([np.arange(1, 5), np.arange(4)], axis=1)
    assert RigidSurface(points, cells).facet_size == pytest.approx(0.25)
