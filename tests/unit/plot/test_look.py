"""Pictures of bodies and contact faces: content and camera."""

import shutil

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets
from support.recorded_run import moved_block, start

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    LevelSet,
    RigidBody,
    Sphere,
    plot,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.laws import status
from dolfinx_contact.materials import Axisymmetric, LinearElastic

COMM = MPI.COMM_WORLD
MATERIAL = LinearElastic.from_young(1000.0, 0.3)
needs_display = pytest.mark.skipif(shutil.which("Xvfb") is None, reason="VTK needs a display")


def peeled(dim, strength=1.0):
    """A bonded block whose top is turned: it is pressed at one end, held by bonds at the rest."""
    ends = [[0.0] * dim, [2.0, *[1.0] * (dim - 1)]]
    create = mesh.create_rectangle if dim == 2 else mesh.create_box
    domain = create(COMM, ends, (8, 4) if dim == 2 else (8, 3, 3))
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    bottom, top = (
        mesh.locate_entities_boundary(domain, dim - 1, lambda x, h=h: np.isclose(x[dim - 1], h))
        for h in (0.0, 1.0)
    )
    moved = fem.Function(V)
    still = [lambda x: 0 * x[0]] * (dim - 2)
    motion = [lambda x: 0.004 + 0 * x[0], *still, lambda x: 0.02 * (x[0] - 0.6)]
    moved.interpolate(lambda x: np.stack([f(x) for f in motion]))
    bc = fem.dirichletbc(moved, fem.locate_dofs_topological(V, dim - 1, top))
    floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(u, bottom, obstacle=floor, law=RCCM(200.0, 200.0, strength, 0.4))
    energy = LinearElastic.from_young(100.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[bc])
    problem.solve()
    return problem


def lines_of(figure):
    """Values of the curves of a picture of contact by name, in the order of positions."""
    found = {}
    for line in figure.axes[0].lines:
        x, y = map(np.asarray, line.get_data())
        _, first = np.unique(x[np.isfinite(x)], return_index=True)
        found[line.get_label()] = y[np.isfinite(x)][first]
    return found


@pytest.mark.parametrize("strength", [0.005, 1.0])
def test_tractions_of_bonds_and_friction_are_drawn(strength):
    """Pressure, shear, its part of friction and the bound of that; bonds break or hold."""
    problem = peeled(2, strength)
    figure = plot.picture_of_contact(None, problem)
    table = problem.table(problem.surfaces[0])
    if COMM.rank == 0:
        low, high = figure.axes[0].get_xlim()
        assert low <= 0.0 < 2.0 <= high  # points without bonds alone are a small part of it
        found = lines_of(figure)
        bound = found["friction bound ±"]
        shear = found["shear on the body"]
        friction = found["friction, a part of the shear"]
        np.testing.assert_allclose(found["pressure"], table.pressure, atol=1e-9)
        np.testing.assert_allclose(np.abs(shear), np.abs(table.shear[:, 0]))
        expected = np.abs(table.friction[:, 0]) / table.area
        np.testing.assert_allclose(np.abs(friction), expected, atol=1e-8)
        np.testing.assert_allclose(bound, table.bound / table.area, atol=1e-8)
        assert (np.abs(shear) > bound + 0.01).any()
        assert (np.abs(friction) <= bound + 1e-6).all()
        assert (bound.max() > 0.1) == (strength < 1.0)


@pytest.mark.ranks(2)
def test_floor_spans_the_body():
    """It spans the body at any position."""
    problem = block(n=4, top=(0.0, -0.01))
    problem.u.interpolate(lambda x: np.stack([np.full_like(x[0], 5.0), np.zeros_like(x[0])]))
    figure = plot.picture_of_body(None, problem)
    if COMM.rank == 0:
        floor = obstacle_of(figure)
        assert floor[:, 0].min() < 5.0 < 6.0 < floor[:, 0].max() < 6.5
        np.testing.assert_allclose(floor[:, 1], 0.0, atol=1e-12)


def obstacle_of(figure):
    """The points of the obstacle in a picture of a body in 2D."""
    return np.concatenate(figure.axes[0].collections[-1].get_segments())


BALL = RigidBody(
    Sphere((0.5, -0.3), 0.2),
    about=(0.5, -0.3),
    motion={"x": 0.1, "y": 0.05},
    held=["rz"],
)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("obstacle", "centre"),
    [
        (Sphere((0.5, -0.3), 0.2), (0.5, -0.3)),
        (LevelSet(lambda x: ufl.dot(x, x) - x[0] + 0.6 * x[1] + 0.3), (0.5, -0.3)),
        (BALL, (0.6, -0.25)),
    ],
)
def test_a_whole_obstacle_is_drawn_beside_a_body_of_its_size(obstacle, centre):
    problem = block(n=3, obstacle=obstacle, top=(0.0, 0.0), sliding="small")
    if obstacle is BALL:
        BALL.values[:] = 0.1, 0.05, 0.0
    figure = plot.picture_of_body(None, problem)
    if COMM.rank == 0:
        x = obstacle_of(figure) - centre
        np.testing.assert_allclose(np.linalg.norm(x, axis=1), 0.2, rtol=1e-4)
        angles = np.sort(np.arctan2(*x.T))
        assert np.diff(angles, append=angles[0] + 2 * np.pi).max() < 0.2


def test_half_of_an_obstacle_of_revolution_is_drawn():
    domain = box(COMM, 3, "quad")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    bottom = facets(domain, 1, 0.0)
    ball = Sphere((0.0, -0.3), 0.3)
    surface = ContactSurface(u, bottom, obstacle=ball, law=Frictionless(), axisymmetric=True)
    held = fem.locate_dofs_topological(u.function_space, 1, facets(domain, 1, 1.0))
    bcs = [fem.dirichletbc(np.zeros(2), held, u.function_space)]
    problem = ContactProblem(Axisymmetric(MATERIAL).energy(u) * ufl.dx, u, [surface], bcs=bcs)
    figure = plot.picture_of_body(None, problem)
    if COMM.rank == 0:
        x = obstacle_of(figure)
        np.testing.assert_allclose(x.min(axis=0), (0.0, -0.6), atol=1e-4)
        np.testing.assert_allclose(x.max(axis=0), (0.3, 0.0), atol=1e-4)


def test_an_obstacle_moved_by_constants_is_drawn_at_its_present_place():
    domain = box(COMM, 3, "tri")
    centre = fem.Constant(domain, (0.5, -0.3))
    problem = block(domain=domain, obstacle=Sphere(centre, 0.2), top=(0.0, 0.0))
    centre.value[:] = 0.2, -0.4
    figure = plot.picture_of_body(None, problem)
    if COMM.rank == 0:
        x = obstacle_of(figure)
        np.testing.assert_allclose((x.min(axis=0) + x.max(axis=0)) / 2, (0.2, -0.4), atol=1e-3)


@needs_display
def test_a_part_of_a_large_obstacle_is_drawn_around_the_body():
    """The part is the same where the body is indented."""
    problem = block(n=3, cell="hex", obstacle=Sphere((0.5, 0.5, -8.0), 8.0), top=(0.0, 0.0, 0.0))
    seen = []
    for depth in (0.0, 0.02):
        problem.u.interpolate(lambda x, depth=depth: np.stack([0 * x[0], 0 * x[0], -depth * x[2]]))
        plotter = plot.picture_of_body(None, problem)
        if COMM.rank == 0:
            seen.append(plotter.actors["obstacle 0"].mapper.dataset)
            plotter.close()
    for part in seen:
        np.testing.assert_allclose(np.linalg.norm(part.points - (0.5, 0.5, -8.0), axis=1), 8.0)
        np.testing.assert_allclose(part.bounds[:4], (-0.1, 1.1, -0.1, 1.1), atol=0.01)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("cell", ["quad", pytest.param("hex", marks=needs_display)])
def test_the_body_fills_the_picture_beside_a_larger_obstacle(cell):
    """The disc or ball of radius 1.5 below the block of size 1 is cut at the frame."""
    dim = 2 if cell == "quad" else 3
    ball = Sphere([0.5] * (dim - 1) + [-1.5], 1.5)
    problem = block(n=3, cell=cell, obstacle=ball, top=[0.0] * dim)
    drawing = plot.picture_of_body(None, problem, title="", **({} if dim == 2 else {"view": "-y"}))
    if COMM.rank > 0:
        return
    if dim == 2:
        axes = drawing.axes[0]
        size = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    else:
        wide, tall = drawing.window_size
        height = 2 * drawing.camera.parallel_scale
        size = height * wide / tall, height
        drawing.close()
    assert 1.0 < max(size) < 1.45


@needs_display
@pytest.mark.parametrize(
    ("unit", "numbers"),
    [(1.0, [0.2, 0.4, 0.6, 0.8]), (1e-7, [0.25, 0.5, 0.75]), (1e8, [0.25, 0.5, 0.75])],
)
def test_the_colour_bar_in_3d_has_round_numbers(unit, numbers):
    """Numbers with exponents are wide, so that there are fewer."""
    problem = block(n=2, cell="hex", top=(0.0, 0.0, -0.01))
    x = ufl.SpatialCoordinate(problem.V.mesh)
    plotter = plot.picture_of_body(None, problem, field=unit * (0.123 + x[0] * 0.789), scale=0.0)
    if COMM.rank == 0:
        (bar,) = plotter.scalar_bars.values()
        labels = bar.GetCustomLabels()
        labels = [labels.GetValue(k) for k in range(labels.GetNumberOfTuples())]
        assert bar.GetUseCustomLabels()
        np.testing.assert_allclose(labels, unit * np.array(numbers))
        plotter.close()


@needs_display
def test_a_section_has_the_edges_of_the_cells():
    """The edges of cubes that are cut are straight lines along the axes."""
    problem = block(n=3, cell="hex")
    plotter = plot.picture_of_body(None, problem, clip=((0.0, 0.5, 0.0), "-y"), scale=0.0)
    if COMM.rank == 0:
        edges = plotter.actors["edges"].mapper.dataset
        ends = edges.points[edges.lines.reshape(-1, 3)[:, 1:]]
        across = ends[np.abs(ends[:, :, 1] - 0.5).max(axis=1) < 0.01]
        plotter.close()
        assert len(across) >= 24
        along = np.sort(np.abs(np.diff(across, axis=1)[:, 0]), axis=1)
        np.testing.assert_allclose(along[:, :2], 0.0, atol=1e-6)


@needs_display
def test_a_section_passes_through_the_middle_of_the_body():
    """This holds also if an obstacle is visible below it."""
    problem = block(n=2, cell="hex", obstacle=Sphere((0.5, 0.5, -0.4), 0.4))
    plotter = plot.picture_of_body(None, problem, clip="z")
    if COMM.rank == 0:
        mapper = plotter.actors["body"].mapper
        mapper.Update()  # before the first rendering
        body = mapper.dataset
        np.testing.assert_allclose(body.bounds[4:], (0.0, 0.5), atol=1e-9)
        assert plotter.actors["obstacle 0"].mapper.dataset.bounds[4] < -0.79
        plotter.close()


@needs_display
def test_edges_of_small_cells_are_left_out():
    """The outline remains; edges=True and a detail have the edges of all cells."""
    problem = block(n=48, cell="tet")
    corner = [(0.0, 0.0, 0.0), (0.2, 0.2, 0.2)]
    counts = []
    for look in ({}, {"edges": True}, {"region": corner}):
        plotter = plot.picture_of_body(None, problem, **look)
        if COMM.rank == 0:
            counts.append(plotter.actors["edges"].mapper.dataset.n_cells)
            plotter.close()
    if COMM.rank == 0:
        outline, every, detail = counts
        assert outline == 12 * 48
        assert detail == every > 6 * 48**2


@pytest.mark.ranks(2)
def test_a_region_fills_the_picture():
    figure = plot.picture_of_body(None, block(n=3), region=[(0.5, 0.4), (0.1, -0.2)])
    if COMM.rank == 0:
        axes = figure.axes[0]
        np.testing.assert_allclose((axes.get_xlim(), axes.get_ylim()), ((0.1, 0.5), (-0.2, 0.4)))


@needs_display
def test_labels_have_units():
    units = {"length": "mm", "stress": "MPa"}
    problem = block(n=3)
    stress = MATERIAL.full_stress(problem.u)
    body = plot.picture_of_body(None, problem, stress=stress, units=units)
    contact = plot.picture_of_contact(None, problem, units=units)
    cube = block(n=2, cell="hex")
    surface = plot.picture_of_contact(None, cube, units=units)
    plotter = plot.picture_of_body(None, cube, field="displacement", units=units)
    if COMM.rank == 0:
        assert [axes.get_ylabel() for axes in body.axes] == ["y [mm]", "von Mises stress [MPa]"]
        assert contact.axes[0].get_xlabel() == "x [mm]"
        assert contact.axes[0].get_ylabel() == "traction [MPa]"
        assert surface.axes[0].get_title(loc="left") == "Normal pressure [MPa]"
        assert plotter.actors["scale"].input.endswith(" mm")
        assert "displacement [mm]" in str(plotter.scalar_bars)
        plotter.close()


@pytest.mark.parametrize("cell", ["quad", "hex"])
def test_the_legend_has_the_statuses_in_the_picture(cell):
    """The vertices far from a ball are left out."""
    dim = 2 if cell == "quad" else 3
    centre = [0.5] * (dim - 1) + [-0.3]
    problem = block(n=12, cell=cell, obstacle=Sphere(centre, 0.3), top=[0.0] * (dim - 1) + [-0.01])
    problem.solve()
    figure = plot.picture_of_contact(None, problem)
    x = problem.table("contact").x
    if COMM.rank == 0:
        axes = figure.axes[0]
        ends = [axes.get_xlim(), axes.get_ylim()][: dim - 1]
        visible = [(low <= x[:, k]) & (x[:, k] <= high) for k, (low, high) in enumerate(ends)]
        texts = [text.get_text() for text in figure.legends[0].get_texts()]
        counts = [int(text.rpartition("(")[2].strip(")")) for text in texts]
        assert sum(counts) == np.all(visible, axis=0).sum() < len(x)


@needs_display
def test_z_is_up():
    """Also of a body that is pressed from above, and of a section."""
    problem = block(n=2, cell="hex")
    for look, expected in (
        ({}, lambda eye: eye[2] > 0 > eye[1]),
        ({"view": "z"}, lambda eye: np.allclose(eye, [0, 0, 1])),
        ({"clip": "-y"}, lambda eye: eye[1] < -0.5),
    ):
        plotter = plot.picture_of_body(None, problem, **look)
        if COMM.rank == 0:
            camera = plotter.camera
            assert expected(-np.array(camera.direction))
            assert camera.up[1 if "view" in look else 2] > 0.5
            plotter.close()


@pytest.mark.ranks(2, 3)
@needs_display
def test_a_plotter_can_be_changed(folder):
    """Actors have names; the picture is written again."""
    arrows = {"press": ((0.5, 0.5, 1.2), (0.0, 0.0, -0.01))}
    problem = block(n=2, cell="hex", top=(0.0, 0.0, -0.01))
    plotter = plot.picture_of_body(folder / "first.png", problem, arrows=arrows)
    if COMM.rank == 0:
        assert {"body", "rim 0", "obstacle 0", "scale bar", "arrow press"} <= set(plotter.actors)
        plotter.remove_actor("obstacle 0")
        plotter.screenshot(folder / "second.png")
        plotter.close()
        first, second = (folder / name for name in ("first.png", "second.png"))
        assert first.read_bytes() != second.read_bytes()


@pytest.mark.ranks(2)
@pytest.mark.parametrize("cell", ["quad", pytest.param("hex", marks=needs_display)])
def test_a_continuous_field_is_exact_at_vertices(cell):
    problem = block(n=3, cell=cell)
    x = ufl.SpatialCoordinate(problem.V.mesh)
    drawing = plot.picture_of_body(None, problem, field=ufl.sin(5 * x[0]), scale=0.0)
    if COMM.rank > 0:
        return
    if cell == "quad":
        shades = drawing.axes[0].collections[0]  # on a finer mesh
        points = np.stack([shades._triangulation.x, shades._triangulation.y], axis=1)
        vertices = np.isclose(3 * points, np.round(3 * points)).all(axis=1)
        at, values = points[vertices, 0], shades.get_array()[vertices]
    else:
        mapper = drawing.renderers[0].actors["body"].mapper
        mapper.Update()  # before the first rendering
        body = mapper.dataset
        at, values = body.points[:, 0], np.array(body.point_data["field"])
        drawing.close()
    np.testing.assert_allclose(values, np.sin(5 * at), atol=1e-6)


def test_arrows_have_a_reference_length():
    arrows = {"load": ([[0.0, 1.0], [1.0, 1.0]], [[0.0, -3.0], [0.0, -1.0]])}
    figure = plot.picture_of_body(None, block(n=2), arrows=arrows)
    if COMM.rank == 0:
        (text,) = figure.axes[0].get_legend().get_texts()
        assert text.get_text() == "load (3)"


def test_a_state_without_time_has_the_scale_alone_as_title(folder):
    from PIL import Image

    problem = block(n=2, top=(0.0, -0.01))
    problem.solve()
    look = dict(field=ufl.SpatialCoordinate(problem.V.mesh)[0])
    state = problem.snapshot()

    def magnified():
        problem.u.x.array[:] *= 2.0
        yield "displacement x 2"

    plot.film(folder / "state.gif", problem, [state], scale=2.0, **look)
    plot.film(folder / "text.gif", problem, magnified(), **look)
    if COMM.rank == 0:
        pictures = [Image.open(folder / name).convert("RGB") for name in ("state.gif", "text.gif")]
        np.testing.assert_array_equal(*map(np.asarray, pictures))


@pytest.mark.ranks(2)
def test_the_title_names_the_factor_of_the_displacement():
    problem = block(n=2, top=(0.0, -0.15), obstacle=HalfSpace((0.0, -0.1), (0.0, 1.0)))
    problem.solve()
    figure = plot.picture_of_body(None, problem, scale=10.0)
    if COMM.rank == 0:
        assert figure.get_suptitle() == "Deformed body, displacement x 10"


@pytest.mark.ranks(2)
def test_tractions_of_a_curved_surface_are_drawn_over_its_length():
    """The surface has three sides of a square, which are followed from one end to the other.

    Round-off in the coordinates is not shown.
    """

    def sides(domain):
        away = lambda x: np.isclose(x[1], 0) | np.isclose(x[0], 0) | np.isclose(x[0], 1)  # noqa: E731
        return mesh.locate_entities_boundary(domain, 1, away)

    domain = box(COMM, 4, "tri")
    domain.geometry.x[:, 0] += 1e-19
    figure = plot.picture_of_contact(None, block(domain=domain, where=sides))
    if COMM.rank == 0:
        axes = figure.axes[0]
        x = axes.lines[0].get_xdata()
        positions = np.unique(np.round(x[np.isfinite(x)], 9))
        np.testing.assert_allclose(positions, np.linspace(0.0, 3.0, 13), atol=1e-9)
        assert axes.get_xlabel() == "length along the surface, from (0, 1)"


@pytest.mark.ranks(2)
def test_a_curved_surface_is_drawn_over_a_coordinate():
    problem = block(cell="tri", n=4)
    x = problem.V.mesh.geometry.x
    x[:, 1] += 0.1 * x[:, 0] ** 2 * (1 - x[:, 1])
    curved = ContactProblem(problem.energy, problem.u, problem.contacts, bcs=problem.bcs)
    curved.solve()
    figure = plot.picture_of_contact(None, curved, over="x")
    table = curved.table("contact")
    if COMM.rank == 0:
        assert figure.axes[0].get_xlabel() == "x"
        x, pressure = figure.axes[0].lines[0].get_data()
        for at, p in zip(table.x[:, 0], table.pressure, strict=True):
            np.testing.assert_allclose(pressure[np.isclose(x, at)], p, atol=1e-8)
    with pytest.raises(ValueError, match="over must be one of x, y; got 'z'"):
        plot.picture_of_contact(None, curved, over="z")


@pytest.mark.ranks(2)
def test_states_have_their_gamma_and_statuses_as_titles():
    system, _ = moved_block(COMM)
    branch = follow(system, start(system), 0.0, gamma_range=(0.0, 0.3))
    figure = plot.picture_of_states(None, system, branch.points[:1] + branch.points[-1:])
    words = [status.summary(system.result_at(p).tables["contact"].status) for p in branch.points]
    if COMM.rank == 0:
        titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
        assert titles == [rf"$\gamma$ = {g}: {words[k]}" for g, k in ((0, 0), (0.3, -1))]


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", [Coulomb(0.3), Frictionless()])
@pytest.mark.parametrize("way", [-0.01, 0.01])
def test_senses_of_slip_are_those_of_the_table(law, way):
    """This includes frictionless points, whose status has no sense."""
    problem = block(law=law, top=(way, -0.002))
    table = problem.solve().tables["contact"]
    figure = plot.picture_of_contact(None, problem)
    if COMM.rank > 0:
        return
    legend = figure.legends[0]
    names = [status.NAMES[letter] for letter in table.letters]
    expected = {f"{name} ({names.count(name)})" for name in names}
    assert {text.get_text() for text in legend.get_texts()} == expected
    assert status.NAMES["-" if way < 0 else "+"] in names


def test_a_frictionless_point_at_rest_has_the_status_of_the_table():
    problem = block(law=Frictionless())
    problem.u.interpolate(lambda x: np.stack([0.0 * x[0], 0.0 * x[0] - 0.01]))
    figure = plot.picture_of_contact(None, problem)
    if COMM.rank == 0:
        (text,) = figure.legends[0].get_texts()
        assert text.get_text() == "slip, $u_t > 0$ (5)"
    assert set(problem.table("contact").letters) == {"+"}


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("side", "tangent"), [(0.0, 1.0), (1.0, -1.0)])
def test_the_shear_has_the_sign_of_the_table(side, tangent):
    """The body is dragged to +x, so that friction acts to -x; t points to +x above a floor."""
    domain = box(COMM, 4, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    moved = np.array([0.03, -0.01 * tangent])
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0 - side))
    plane = HalfSpace((0.0, side), (0.0, tangent))
    surface = ContactSurface(u, facets(domain, 1, side), obstacle=plane, law=Coulomb(0.3))
    bcs = [fem.dirichletbc(moved, held, V)]
    problem = ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface], bcs=bcs)
    table = problem.solve().tables["contact"]
    figure = plot.picture_of_contact(None, problem)
    np.testing.assert_allclose(table.along(table.ut), tangent * table.ut[:, 0])
    assert set(table.letters) == {"+" if side == 0.0 else "-"}
    if COMM.rank == 0:
        shear = lines_of(figure)["shear on the body"]
        np.testing.assert_allclose(shear, table.along(table.shear), atol=1e-9)
        assert (tangent * shear < 0).all()
        names = [status.NAMES[letter] for letter in table.letters]
        assert figure.legends[0].get_texts()[0].get_text() == f"{names[0]} ({len(names)})"


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("look", "words"),
    [
        ({"view": "-y"}, "view and clip are for bodies in 3D"),
        ({"clip": "x"}, "view and clip are for bodies in 3D"),
        ({"field": "heat"}, "field must be 'displacement' or a UFL scalar, got 'heat'"),
        ({"field": 1.0}, "field must be 'displacement' or a UFL scalar, got 1.0"),
        ({"arrows": {"load": ((0, 0, 0), (0, 0, 1))}}, "finite points and vectors in 2D"),
        (
            {"colour": "red"},
            "picture_of_body has no option 'colour'; its options are state, .* units",
        ),
        ({"edges": "no"}, "edges must be True or False"),
        ({"units": {"force": "N"}}, "the quantity of a unit must be one of length, stress"),
        ({"region": [(0, 0), (1, 0)]}, "region must be two opposite corners of a box"),
    ],
)
def test_pictures_refuse_unknown_fields_and_options(look, words):
    problem = block(n=2)
    with pytest.raises((ValueError, TypeError), match=words) as info:
        plot.picture_of_body(None, problem, **{"field": "displacement", **look})
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
def test_pictures_refuse_a_field_that_is_wrong_on_one_rank():
    problem = block(n=2)
    field = problem.u if COMM.rank == COMM.size - 1 else problem.u[0]
    with pytest.raises(ValueError, match="field must be 'displacement' or a UFL scalar") as info:
        plot.picture_of_body(None, problem, field=field)
    assert len(set(COMM.allgather(str(info.value)))) == 1


def test_pictures_refuse_unknown_directions():
    problem = block(n=2, cell="hex")
    for look, words in (
        ({"view": "sideways"}, "view must be one of x, -x"),
        ({"view": (0, 0, 0)}, "view must be 3 finite numbers, not all 0"),
        ({"clip": ((0, 0), "x")}, "the point of clip must be 3 finite numbers"),
    ):
        with pytest.raises(ValueError, match=words):
            plot.picture_of_body(None, problem, **look)


@pytest.mark.long
def test_plane_pictures_have_a_colour_bar_and_vector_formats(folder):
    """The colours of a stress, and PDF that has lines instead of an image."""
    problem = block(n=4, top=(0.02, -0.05))
    problem.solve()
    stress = MATERIAL.full_stress(problem.u)
    figure = plot.picture_of_body(folder / "stress.png", problem, stress=stress)
    if COMM.rank == 0:
        labels = [axes.get_ylabel() or axes.get_xlabel() for axes in figure.axes]
        assert labels == ["y", "von Mises stress"]
    plot.picture_of_body(folder / "body.pdf", problem)
    plot.picture_of_contact(folder / "contact.svg", problem)
    assert (folder / "body.pdf").read_bytes().startswith(b"%PDF")
    assert (folder / "contact.svg").read_bytes().startswith(b"<?xml")


def test_reference_curves_are_black_lines_of_their_own():
    x = np.linspace(0.0, 1.0, 50)
    measured = {"measured": (x[::10], x[::10])}
    axes = plot.draw_curves(None, {"ours": (x, x)}, marks=measured, dotted={"exact": (x, x**2)})
    found = {line.get_label(): line for line in axes.lines}
    assert set(found) == {"ours", "measured", "exact"}
    assert found["exact"].get_color() == "black"
    np.testing.assert_array_equal(found["exact"].get_ydata(), x**2)
