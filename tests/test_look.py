"""How bodies and contact faces are drawn: what is shown of them, and from where."""

import shutil
from collections import Counter

from mpi4py import MPI

import matplotlib.image
import numpy as np
import pytest
from blocks import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    plot,
)
from dolfinx_contact.laws import status
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.plot import animation, faces, floors, pictures, render

COMM = MPI.COMM_WORLD
MATERIAL = LinearElastic.from_young(1000.0, 0.3)
needs_display = pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="VTK needs a display")


@pytest.fixture
def drawn(monkeypatch):
    """What is drawn, by kind, in place of the pictures."""
    seen = {}

    def draw(comm, kind, data, file, **more):
        seen[kind] = data
        return file

    monkeypatch.setattr(pictures, "draw", draw)
    return seen


def ring(count):
    """A circle about (0, 1): vertices, edges in no order, normals of the floor below."""
    angle = 2 * np.pi * np.arange(count) / count
    x = np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    order = np.random.default_rng(1).permutation(count)
    cells = np.stack([order, (order + 1) % count], axis=1)
    cells[::2] = cells[::2, ::-1]
    return x, cells, np.tile([0.0, -1.0], (count, 1))


def test_a_wheel_by_its_length():
    """From the middle of what touches, along t = (-n_y, n_x), cut where that is farthest."""
    count = 60
    x, cells, n = ring(count)
    touching = np.zeros(count, dtype=bool)
    touching[[58, 59, 0, 1, 2, 3]] = True
    at, ends, label = faces.along_curve(x, cells, n, touching)
    step = 2 * np.sin(np.pi / count)
    numbers = (np.arange(count) + count // 2) % count - count // 2
    np.testing.assert_allclose(at[touching], step * (numbers[touching] - 0.5), atol=1e-12)
    np.testing.assert_allclose(np.abs(np.diff(ends, axis=1)), step)
    assert "middle of contact" in label
    low, high = faces.near_contact(at, touching, step)
    assert low < at[touching].min() < at[touching].max() < high
    assert high - low < 0.3 * np.ptp(at)


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


@pytest.mark.parametrize("strength", [0.005, 1.0])
def test_bonds_are_seen(drawn, strength):
    """All that carries a traction, and the friction that the bound bounds; bonds break or hold."""
    problem = peeled(2, strength)
    plot.picture_of_contact("held.png", problem)
    table = problem.table(problem.surfaces[0])
    if COMM.rank == 0:
        data = drawn["contact_2d"]
        assert data["counts"][0] > 2 * data["counts"][1:].sum() > 0
        assert data["near"] is None
        shown = faces.near_contact(data["x"], data["status"] > 0, 0.25)
        assert shown[1] < 1.0  # what touches alone is a small part of it
        order = np.argsort(data["x"])
        bound = data["bound"]
        np.testing.assert_allclose(data["pressure"][order], table.pressure, atol=1e-9)
        np.testing.assert_allclose(np.abs(data["shear"][order]), np.abs(table.shear[:, 0]))
        friction = np.abs(table.friction[:, 0]) / table.area
        np.testing.assert_allclose(np.abs(data["friction"][order]), friction, atol=1e-8)
        np.testing.assert_allclose(bound[order], table.bound / table.area, atol=1e-8)
        assert (np.abs(data["shear"]) > bound + 0.01).any()
        assert (np.abs(data["friction"]) <= bound + 1e-6).all()
        assert (bound.max() > 0.1) == (strength < 1.0)


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.long)])
def test_bonds_are_drawn(folder, dim):
    if dim == 3 and COMM.size > 1:
        pytest.skip("the picture is the same")
    file = plot.picture_of_contact(folder / "held.png", peeled(dim))
    if COMM.rank == 0:
        pixels = matplotlib.image.imread(file)[..., :3]
        blue = (pixels[..., 2] > pixels[..., 0] + 0.3).mean()
        assert (blue > 0.01) == (dim == 3)


def test_straight_and_bent_faces():
    x = np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 1.0]])
    cells = np.array([[2, 1], [0, 1]])
    assert faces.is_straight(x, cells)
    bent = x + np.array([[0.0, 0.0], [0.0, 0.5], [0.0, 0.0]])
    assert not faces.is_straight(bent, cells)
    n = np.tile([0.0, -1.0], (3, 1))
    at, ends, label = faces.along_curve(bent, cells, n, np.ones(3, dtype=bool))
    lengths = np.hypot([1.0, 1.0], [1.0, 0.0])
    np.testing.assert_allclose(at, [0.0, lengths[0], lengths.sum()])
    np.testing.assert_allclose(ends, at[cells])
    assert label == "length along the surface"
    assert faces.near_contact(at, np.ones(3, dtype=bool), 0.1) is None


def test_a_floor_under_the_body(drawn):
    """It reaches from one end of the contact face to the other wherever the body is."""
    problem = block(n=4, top=(0.0, -0.01))
    problem.u.interpolate(lambda x: np.stack([np.full_like(x[0], 5.0), np.zeros_like(x[0])]))
    plot.picture_of_body("body.png", problem)
    if COMM.rank == 0:
        (floor,) = drawn["body_2d"]["obstacle_x"]
        assert floor[:, 0].min() < 5.0 < 6.0 < floor[:, 0].max() < 6.5
        np.testing.assert_allclose(floor[:, 1], 0.0, atol=1e-12)


def test_floors_of_a_film_are_one():
    """All frames have the same floor under all states."""
    frames = [
        {
            "x": np.array([[at, 0.0, 0.0], [at + 1, 1.0, 0.0]]),
            "obstacle_x": [np.array([[at, 0.0, 0.0], [at + 1.0, 0.0, 0.0]])],
            "obstacle_cells": [np.array([[0, 1]])],
            "obstacle_normals": [np.tile([0.0, -1.0, 0.0], (2, 1))],
            "obstacle_flat": [True],
        }
        for at in (0.0, 3.0)
    ]
    floors.lay_floors(frames, 2)
    first, last = (np.sort(frame["obstacle_x"][0][:, 0]) for frame in frames)
    np.testing.assert_allclose(first, last)
    assert first[0] < 0.0
    assert first[1] > 4.0


def test_z_is_up():
    """Also of a body that is pressed from above, whose contact is seen through the plate."""
    look = pictures.checked_look({}, 3, stress=False)
    eye, up = render._eye(look, np.array([2.0, 1.0, 1.0]))
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0])
    assert eye[2] > 0 > eye[1]
    turned, up = render._eye(
        pictures.checked_look({"up": "x", "view": "above"}, 3, stress=False), np.ones(3)
    )
    np.testing.assert_allclose((turned, up), [[0, 0, 1], [1, 0, 0]])
    cut, _ = render._eye(pictures.checked_look({"clip": "-y"}, 3, stress=False), np.ones(3))
    assert cut[1] < -0.5


def test_bodies_apart(drawn):
    """An obstacle is moved off the body by a part of their size."""
    problem = block(n=3, cell="hex", top=(0.0, 0.0, -0.01))
    plot.picture_of_body("body.png", problem, apart=0.5)
    if COMM.rank == 0:
        (floor,) = drawn["body_3d"]["obstacle_x"]
        np.testing.assert_allclose(floor[:, 2], -0.5 * np.sqrt(3.0), atol=1e-12)


def test_fields_and_sections(drawn):
    """Colours by name or UFL, with the values inside of a body that is cut open."""
    problem = block(n=3, cell="tet", top=(0.0, 0.0, -0.01))
    problem.u.interpolate(lambda x: 0.1 * x)
    x = ufl.SpatialCoordinate(problem.V.mesh)
    plot.picture_of_body("a.png", problem, fields={"height": x[2]}, clip="x")
    plot.picture_of_body("b.png", problem, fields="displacement")
    if COMM.rank > 0:
        return
    inside = drawn["body_3d"]
    assert list(inside["colours"]) == ["displacement"]
    size = np.linalg.norm(inside["x"], axis=1) / 11
    np.testing.assert_allclose(inside["colours"]["displacement"], size, atol=1e-12)


@pytest.mark.parametrize("cell", ["tri", "quad", "tet", "hex"])
def test_continuous_fields_are_exact(drawn, cell):
    """At vertices, on and in the body; those that jump are between what they are beside."""
    problem = block(n=3, cell=cell)
    dim = problem.u.function_space.mesh.geometry.dim
    problem.u.interpolate(lambda x: 0.01 * x[:dim] ** 2)
    x = ufl.SpatialCoordinate(problem.V.mesh)
    jumps = fem.Function(fem.functionspace(problem.V.mesh, ("DG", 0)))
    jumps.x.array[:] = 1.0 + (np.arange(len(jumps.x.array)) % 2)
    fields = {"ux": problem.u[0], "wave": ufl.sin(5 * x[0]), "jumps": jumps}
    look = {"clip": "x"} if dim == 3 else {}
    plot.picture_of_body("a.png", problem, fields=fields, scale=0.0, **look)
    if COMM.rank > 0:
        return
    data = drawn[f"body_{dim}d"]
    for part in (data, data["inside"]) if dim == 3 else (data,):
        at = part["x"][:, 0]
        np.testing.assert_allclose(part["colours"]["wave"], np.sin(5 * at), atol=1e-12)
        nodal = 0.01 * at**2
        np.testing.assert_allclose(part["colours"]["ux"], nodal, atol=1e-14)
        assert (part["colours"]["jumps"] >= 1.0 - 1e-12).all()
        assert (part["colours"]["jumps"] <= 2.0 + 1e-12).all()


@pytest.mark.parametrize(
    "cell",
    [
        pytest.param("tri", marks=pytest.mark.long),
        pytest.param("tet", marks=[needs_display, pytest.mark.long]),
    ],
)
def test_where_a_field_is_no_number(folder, cell):
    """It is grey there, in the range of the rest."""
    if COMM.size > 1 and cell == "tet":
        pytest.skip("the picture is the same")
    problem = block(n=4, cell=cell)
    x = ufl.SpatialCoordinate(problem.V.mesh)
    field = {"root": ufl.sqrt(x[0] - 0.5)}
    file = plot.picture_of_body(folder / "a.png", problem, fields=field, view=None)
    assert file is not None
    if COMM.rank == 0:
        pixels = matplotlib.image.imread(file)[..., :3]
        assert (np.ptp(pixels, axis=2) < 0.02).mean() < 0.95
        grey = np.abs(pixels - 0x9A / 255).max(axis=2) < (0.02 if cell == "tri" else 0.12)
        assert grey.mean() > 0.05
        values = np.array([np.nan, 1.0, 3.0, np.nan])
        data = {"colours": {"root": values}, "look": {"units": ("", "")}}
        assert render._limits(data, "root") == (1.0, 3.0)
        assert render._label("root", data) == "root (grey: no number)"


@pytest.mark.parametrize(
    "cell", ["tri", pytest.param("tet", marks=[needs_display, pytest.mark.long])]
)
def test_a_box_beside_the_body(folder, caplog, cell):
    problem = block(n=2, cell=cell)
    dim = 2 if cell == "tri" else 3
    with caplog.at_level("WARNING"):
        file = plot.picture_of_body(folder / "a.png", problem, zoom=[[5.0] * dim, [6.0] * dim])
    assert file is None
    if COMM.rank == 0:
        assert "the box of zoom has nothing of the body to be seen" in caplog.text
    assert plot.picture_of_body(folder / "b.png", problem, zoom=[[0.4] * dim, [0.6] * dim])


def test_the_inside_is_gathered(drawn):
    problem = block(n=3, cell="tet", top=(0.0, 0.0, -0.01))
    one = fem.Constant(problem.V.mesh, 2.0)
    plot.picture_of_body("a.png", problem, fields={"two": 1.0 * one, "four": 2.0 * one}, clip="x")
    if COMM.rank == 0:
        inside = drawn["body_3d"]["inside"]
        assert (len(inside["x"]), inside["cells"].shape) == (64, (162, 4))
        np.testing.assert_allclose(inside["colours"]["two"], 2.0)
        np.testing.assert_allclose(drawn["body_3d"]["colours"]["four"], 4.0)


@pytest.mark.parametrize("law", [Coulomb(0.3), Frictionless()])
@pytest.mark.parametrize("way", [-0.01, 0.01])
def test_senses_of_slip_are_those_of_the_table(drawn, law, way):
    """Also where there is no friction, and the status has no sense of its own."""
    problem = block(law=law, top=(way, -0.002))
    table = problem.solve().tables["contact"]
    plot.picture_of_contact("a.png", problem)
    if COMM.rank > 0:
        return
    shown = zip(drawn["contact_2d"]["statuses"], drawn["contact_2d"]["counts"], strict=True)
    counts = {name: count for (name, _), count in shown if count}
    expected = Counter(status.NAMES[letter] for letter in table.letters)
    assert counts == expected
    assert status.NAMES["-" if way < 0 else "+"] in counts


def in_the_middle(problem):
    """A field that vanishes on the surface of the unit cube."""
    sines = [ufl.sin(np.pi * x) for x in ufl.SpatialCoordinate(problem.V.mesh)]
    return {"middle": sines[0] * sines[1] * sines[2]}


def test_a_film_shows_the_displacement_and_its_scale(monkeypatch):
    """And the colours of a film of sections are those of all that is inside."""
    films = []
    monkeypatch.setattr(animation, "draw", lambda comm, kind, data, *_, **__: films.append(data))
    problem = block(n=3, cell="tet", top=(0.0, 0.0, -0.01))
    plot.film("a.gif", problem, iter(["one"]), scale=5.0)
    plot.film("b.gif", problem, iter(["one"]), fields=in_the_middle(problem), clip="x")
    if COMM.rank > 0:
        return
    shown, cut = (film["frames"][0] for film in films)
    assert list(shown["colours"]) == ["displacement"]
    assert shown["title"] == "one, displacement x 5"
    assert cut["colours"]["middle"].max() < 1e-12
    assert cut["limits"]["middle"][1] > 0.5


@pytest.mark.long
@needs_display
def test_the_bar_of_a_section_is_of_what_is_seen(folder):
    """Not of the surface, where this field vanishes: it would be of one colour."""
    if COMM.size > 1:
        pytest.skip("the picture is the same")
    problem = block(n=6, cell="tet")
    file = plot.picture_of_body(folder / "a.png", problem, fields=in_the_middle(problem), clip="x")
    pixels = matplotlib.image.imread(file)[..., :3]
    body = pixels[int(0.2 * len(pixels)) : int(0.7 * len(pixels))]
    # Yellow, as green and red, and not blue: the middle of the range.
    yellow = (body[..., 0] > 0.8) & (body[..., 1] > 0.8) & (body[..., 2] < 0.75)
    assert yellow.mean() > 0.02


@pytest.mark.parametrize(
    ("look", "words"),
    [
        ({"view": "front"}, "a body in 2D has no view"),
        ({"clip": "x"}, "a body in 2D has no clip"),
        ({"zoom": 0.0}, "the factor of zoom must be a positive number"),
        ({"zoom": "all"}, "zoom must be a factor, 'contact' or the least"),
        ({"zoom": [[0, 0], [0, 1]]}, "least and largest coordinates of a box in 2D"),
        ({"cmap": "no colours"}, "cmap must be a name"),
        ({"fields": "heat"}, "no field is named 'heat'"),
        ({"fields": "von Mises stress"}, "needs a stress="),
        ({"fields": {"u": 1.0}}, "fields must be UFL scalars by names"),
        ({"apart": -1.0}, "apart must be a nonnegative number"),
        ({"units": "mm"}, "units must be those of length and stress"),
        ({"colour": "red"}, "a look must be one of .*; got 'colour'"),
    ],
)
def test_looks_that_are_refused(look, words):
    problem = block(n=2)
    with pytest.raises(ValueError, match=words) as info:
        plot.picture_of_body("body.png", problem, **look)
    assert len(set(COMM.allgather(str(info.value)))) == 1


def test_directions_that_are_refused():
    for look, words in (
        ({"view": "sideways"}, "the view must be one of x, -x"),
        ({"up": (0, 0, 0)}, "up must be 3 finite numbers, not all 0"),
        ({"clip": ((0, 0), "x")}, "the point of clip must be 3 finite numbers"),
    ):
        with pytest.raises(ValueError, match=words):
            pictures.checked_look(look, 3, stress=False)


def size_of(file):
    """Rows and columns of a picture."""
    return COMM.bcast(matplotlib.image.imread(file).shape[:2] if COMM.rank == 0 else None)


@pytest.mark.long
def test_plane_bodies_are_drawn(folder):
    """Panels one below the other; PDF has lines, no picture."""
    problem = block(n=4, top=(0.02, -0.05))
    problem.solve()
    stress = MATERIAL.full_stress(problem.u)
    look = dict(stress=stress, cmap="viridis", units=("mm", "MPa"), zoom="contact")
    one = plot.picture_of_body(folder / "one.png", problem, **look)
    both = ["displacement", "von Mises stress"]
    two = plot.picture_of_body(folder / "two.png", problem, fields=both, **look)
    assert max(np.array(size_of(two)) / size_of(one)) > 1.6
    pdf = plot.picture_of_body(folder / "body.pdf", problem)
    assert pdf.read_bytes().startswith(b"%PDF")
    assert plot.picture_of_contact(folder / "contact.pdf", problem, units=("mm", "MPa")) is not None


@needs_display
@pytest.mark.parametrize(
    "look",
    [
        pytest.param({"clip": "-y", "zoom": 2.0}, marks=pytest.mark.long),
        {"view": "below", "apart": 0.2},
    ],
)
def test_bodies_are_drawn(folder, look):
    above = HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    problem = block(n=3, cell="hex", obstacle=above, top=(0.02, 0.0, -0.05))
    problem.solve()
    stress = MATERIAL.full_stress(problem.u)
    # As a PDF of a body in 3D is drawn by the recipe of figures.
    for name in ("body.png", "body.pdf") if "clip" in look else ("body.png",):
        file = plot.picture_of_body(folder / name, problem, stress=stress, **look)
        assert file == folder / name
        assert file.stat().st_size > 10_000


@pytest.mark.skipif(COMM.size > 1, reason="arrays of one rank")
def test_a_straight_floor_reaches_below_what_slipped_off():
    """Below all that is drawn of the body, on the same line; one that is curved stays."""
    direction = np.array([2.0, 1.0])
    floor = np.array([1.0, 1.0]) + np.outer([0.0, 0.25, 1.0], direction)
    aside = np.array([[0.4, 0.7], [1.5, 2.0]])
    drawn = floors.floor_below(floor, aside)
    np.testing.assert_allclose(drawn, [[0.4, 0.7], [3.0, 2.0]])
    np.testing.assert_allclose(floors.floor_below(floor, floor[1:]), floor[[0, -1]])
    bent = floor.copy()
    bent[1, 1] += 1e-3
    np.testing.assert_array_equal(floors.floor_below(bent, aside), bent)
    np.testing.assert_array_equal(floors.floor_below(floor[:0], aside), floor[:0])
