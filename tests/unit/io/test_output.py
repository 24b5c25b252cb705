"""Written fields for ParaView, tables and pictures, read back and compared."""

import csv
import re
import shutil
import textwrap

from mpi4py import MPI

import matplotlib.image
import numpy as np
import pytest
from support.blocks import block, box, facets
from support.vtk_files import number_of_colours, von_mises

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    Sphere,
    materials,
)
from dolfinx_contact.io import STATUS_CODES, output_folder, write_contact_table, write_fields
from dolfinx_contact.io.fields import body_fields
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.plot import picture_of_body, picture_of_contact

COMM = MPI.COMM_WORLD
MATERIAL = LinearElastic.from_young(1000.0, 0.3)


def sphere(dim):
    """A ball touching the middle of the bottom of the unit block."""
    centre = np.full(dim, 0.5)
    centre[-1] = -2.0
    return Sphere(centre, 2.0)


def dragged(cell="hex", n=4, **options):
    """A block pressed on a ball and dragged: open, stick and slip at once."""
    dim = 2 if cell in ("tri", "quad") else 3
    options = {"top": (0.03, *[0.0] * (dim - 2), -0.05), "obstacle": sphere(dim), **options}
    return block(n=n, cell=cell, **options)


# -- stresses ------------------------------------------------------------------------------------


def linear_displacement(domain, gradient, degree=1):
    dim = domain.geometry.dim
    u = fem.Function(fem.functionspace(domain, ("Lagrange", degree, (dim,))))
    u.interpolate(lambda x: np.asarray(gradient) @ x[:dim])
    u.x.scatter_forward()
    return u


def von_mises_of(domain, gradient, material, degree=1):
    u = linear_displacement(domain, gradient, degree)
    return body_fields(u, material.full_stress(u))[1].x.array


@pytest.mark.ranks(2)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.verifies(
    "stresses",
    reference="closed form: uniaxial stress",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_uniaxial_stress_has_its_von_mises_stress(degree):
    """Stretch e with free sides has von Mises stress E e, in 3D and in plane stress."""
    E = 7.0
    nu = 0.25
    e = 0.01
    solid = LinearElastic.from_young(E, nu)
    found = von_mises_of(box(COMM, 2, "tet"), np.diag([e, -nu * e, -nu * e]), solid, degree)
    np.testing.assert_allclose(found, E * e, rtol=1e-10)
    sheet = LinearElastic.from_young(E, nu, plane_stress=True)
    found = von_mises_of(box(COMM, 2, "tri"), np.diag([e, -nu * e]), sheet, degree)
    np.testing.assert_allclose(found, E * e, rtol=1e-10)


@pytest.mark.verifies("stresses", reference="closed form: plane strain", aspects=("2D",))
def test_plane_strain_has_its_von_mises_stress():
    """Stress s along x and nothing across: the plane carries nu s, so (1 - nu + nu^2)^(1/2) s."""
    E = 7.0
    nu = 0.25
    s = 0.1
    gradient = np.diag([s * (1 - nu**2) / E, -s * nu * (1 + nu) / E])
    found = von_mises_of(box(COMM, 2, "quad"), gradient, LinearElastic.from_young(E, nu))
    np.testing.assert_allclose(found, s * np.sqrt(1 - nu + nu**2), rtol=1e-10)


def recipe():
    """The lines of the docstring of `materials`, but for the problem."""
    text = materials.__doc__.partition("the out-of-plane stress follows::\n")[2].partition(
        "\nFor an axisymmetric body"
    )[0]
    code = textwrap.dedent(text)
    return re.sub(r"problem = .*\n", "energy = W(F) * ufl.dx\n", code)


@pytest.mark.verifies(
    "stresses",
    "hyperelastic bodies",
    reference="closed form: the stress of an energy",
    aspects=("2D",),
)
def test_own_energy_has_its_stress():
    """The recipe in 2D gives the stress of the closed form, and the corresponding energy."""
    gradient = np.array([[0.1, 0.05, 0.0], [-0.02, -0.08, 0.0], [0.0, 0.0, 0.0]])
    plane = linear_displacement(box(COMM, 1, "tri"), gradient[:2, :2])
    names = {"ufl": ufl, "u": plane, "mu": 1.0, "kappa": 2.0}
    exec(recipe(), names)
    F = np.eye(3) + gradient
    J = np.linalg.det(F)
    B = F @ F.T
    deviator = J ** (-5 / 3) * (B - np.trace(B) / 3 * np.eye(3))
    expected = (deviator + 2.0 * (J - 1) * np.eye(3)).reshape(-1)
    found = body_fields(plane, names["stress"])[0].x.array.reshape(-1, 9)
    np.testing.assert_allclose(found, np.tile(expected, (len(found), 1)), atol=1e-12)
    # The energy is that of the stress: its first variation is the work of P = J stress F^-T.
    v = fem.Function(plane.function_space)
    v.interpolate(lambda x: (x[0], 0.3 * x[1]))
    first = fem.assemble_scalar(fem.form(ufl.derivative(names["energy"], plane, v)))
    P = J * expected.reshape(3, 3) @ np.linalg.inv(F).T
    np.testing.assert_allclose(COMM.allreduce(first), P[0, 0] + 0.3 * P[1, 1], rtol=1e-10)


# -- fields on the contact surface ---------------------------------------------------------------


def at_points(table, x):
    """Rows of a table at the positions ``x``."""
    distance = np.linalg.norm(table.x[None, :, :] - x[:, None, : table.dim], axis=2)
    assert len(x) == 0 or distance.min(axis=1).max() < 1e-9
    return distance.argmin(axis=1)


def codes(table):
    return np.array([STATUS_CODES[letter] for letter in table.letters])


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "method"),
    [("tri", "nodal"), ("tri", "mixed"), ("quad", "nodal"), ("tet", "nodal"), ("hex", "nodal")],
)
@pytest.mark.verifies(
    "files for ParaView",
    reference="itself: the contact table",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_nodal_fields_are_the_table(cell, method):
    problem = dragged(cell, n=8 if cell in ("tri", "quad") else 4, method=method)
    result = problem.solve()
    assert all(result.counts[k] > 0 for k in ("open", "slip"))
    (s,) = problem.surfaces
    table = result.tables["contact"]
    fields = problem.contact_fields(s)
    rows = at_points(table, s.points.vertices.tabulate_dof_coordinates())
    dim = table.dim
    force = np.abs(table.force).max() / table.area.min()
    np.testing.assert_array_equal(fields["status"].x.array, codes(table)[rows])
    np.testing.assert_allclose(fields["gap"].x.array, table.un[rows], atol=1e-14)
    np.testing.assert_allclose(fields["pressure"].x.array, table.pressure[rows], atol=1e-12 * force)
    np.testing.assert_allclose(fields["slip"].x.array.reshape(-1, dim), table.ut[rows], atol=1e-14)
    np.testing.assert_allclose(
        fields["traction"].x.array.reshape(-1, dim),
        (table.shear - table.pressure[:, None] * table.n)[rows],
        atol=1e-12 * force,
    )


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("cell", ["tri", "quad", "tet", "hex"])
def test_pressure_function_has_the_contact_force(cell):
    """Its integral is the sum of normal forces, and its mean over a part agrees with the table."""
    problem = dragged(cell, n=8 if cell in ("tri", "quad") else 4)
    result = problem.solve()
    (s,) = problem.surfaces
    table = result.tables["contact"]
    fields = problem.contact_fields(s)
    p = fields["pressure"]
    assert (p.name, p.ufl_shape, fields["shear"].ufl_shape) == ("pressure", (), (table.dim,))
    domain = p.function_space.mesh
    assert domain is s.submesh.mesh
    x = ufl.SpatialCoordinate(domain)
    inside = ufl.conditional(ufl.lt(x[0], 0.5), 1.0, 0.0)

    def integral(form):
        return COMM.allreduce(fem.assemble_scalar(fem.form(form)))

    np.testing.assert_allclose(integral(p * ufl.dx), table.rn.sum(), rtol=1e-12)
    shear = [integral(fields["shear"][i] * ufl.dx) for i in range(table.dim)]
    np.testing.assert_allclose(shear, table.rt.sum(axis=0), atol=1e-12 * table.rn.sum())
    mean = integral(p * inside * ufl.dx) / integral(inside * ufl.dx)
    # Cells end at x = 1/2: points there have half of their pressure on each side.
    share = np.where(np.isclose(table.x[:, 0], 0.5), 0.5, table.x[:, 0] < 0.5)
    if cell != "tet":  # of tetrahedra facets are not the same on both sides
        force = float(np.sum(share * table.rn))
        np.testing.assert_allclose(mean, force / 0.5, rtol=1e-9)
    assert mean > 0
    with pytest.raises(ValueError, match="a surface of this problem is needed"):
        problem.contact_fields(dragged(cell, n=2).surfaces[0])


def read_back(file):
    """Values of a .bp file by name, at its points, the blocks of all ranks joined."""
    adios2 = pytest.importorskip("adios2")
    found = {}
    with adios2.FileReader(str(file)) as reader:
        for name, what in reader.available_variables().items():
            if what["Type"] != "double" or name == "step":
                continue
            variable = reader.inquire_variable(name)
            blocks = []
            for i, block_info in enumerate(reader.all_blocks_info(name)[0]):
                if not block_info["Count"].startswith("0"):  # a rank without contact facets
                    variable.set_block_selection(i)
                    blocks.append(reader.read(variable))
            found[name] = np.concatenate(blocks)
    return found


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("cell", "degree"), [("tri", 1), ("tet", 2)])
@pytest.mark.verifies(
    "files for ParaView",
    reference="independent code: the reader of ADIOS2",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_files_read_back_are_equal(folder, cell, degree):
    problem = dragged(cell, n=6 if cell == "tri" else 3, degree=degree)
    result = problem.solve()
    files = write_fields(folder, problem, stress=MATERIAL.full_stress(problem.u))
    assert [f.name for f in files] == ["body.bp", "body_stress.bp", "contact.bp"]
    COMM.barrier()
    if COMM.rank > 0:
        return
    body, stress, contact = (read_back(f) for f in files)
    dim = problem.V.mesh.geometry.dim
    top = np.isclose(body["geometry"][:, dim - 1], 1.0)
    moved = (0.03, -0.05, 0.0) if dim == 2 else (0.03, 0.0, -0.05)
    name = next(k for k in body if k != "geometry")
    np.testing.assert_allclose(body[name][top], np.tile(moved, (top.sum(), 1)))
    mises = von_mises(stress["stress"])
    np.testing.assert_allclose(stress["von_mises"][:, 0], mises, rtol=1e-6, atol=1e-9)
    assert set(contact) == {
        *("geometry", "displacement", "traction", "pressure", "shear", "gap", "slip"),
        *("status", "support"),
    }
    assert np.abs(contact["geometry"][:, dim - 1]).max() < 1e-12
    if degree == 1:
        table = result.tables["contact"]
        rows = at_points(table, contact["geometry"])
        np.testing.assert_array_equal(contact["status"][:, 0], codes(table)[rows])
        np.testing.assert_allclose(contact["gap"][:, 0], table.un[rows], atol=1e-14)
        np.testing.assert_allclose(contact["slip"][:, :dim], table.ut[rows], atol=1e-14)


def two_surfaces(names=("floor", "wall"), degree=1):
    """A square pressed down on the floor and sideways on a wall."""
    domain = box(COMM, 6, "quad")
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    sides = [(1, 0.0, HalfSpace((0, 0), (0, 1))), (0, 1.0, HalfSpace((1.02, 0), (-1, 0)))]
    surfaces = [
        ContactSurface(u, facets(domain, axis, at), obstacle=o, law=Coulomb(0.2), name=name)
        for name, (axis, at, o) in zip(names, sides, strict=True)
    ]
    bc = fem.dirichletbc(np.array([0.02, -0.05]), held, V)
    return ContactProblem(MATERIAL.energy(u) * ufl.dx, u, surfaces, bcs=[bc])


@pytest.mark.ranks(2)
def test_surfaces_with_one_file_name_are_refused(folder):
    with pytest.raises(ValueError, match="make the same file"):
        write_fields(folder, two_surfaces(names=("left wall", "left_wall")))
    assert not list(folder.iterdir())


@pytest.mark.ranks(2)
def test_unwritable_folder_raises_on_every_rank(folder):
    """A file where the folder should be: the same error on every rank, before anything else."""
    blocked = folder / "file"
    if COMM.rank == 0:
        blocked.write_text("")
    COMM.barrier()
    for attempt in (
        lambda: write_fields(blocked, block(cell="tri")),
        lambda: output_folder(COMM, blocked / "below"),
    ):
        with pytest.raises(OSError, match="cannot write to the output folder") as info:
            attempt()
        assert len(set(COMM.allgather(str(info.value)))) == 1


# -- table ---------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize("cell", ["tri", "hex"])
def test_contact_table_satisfies_the_law_row_by_row(folder, cell):
    """Columns, signs and the friction law, row by row."""
    problem = dragged(cell, n=8 if cell == "tri" else 4)
    result = problem.solve()
    write_contact_table(COMM, folder, result.tables.values())
    with open(folder / "contact.csv") as stream:
        rows = list(csv.DictReader(stream))
    header = "surface,x,y,z,un,ut,ut_x,ut_y,ut_z,rn,rt,rt_x,rt_y,rt_z,pressure,shear,status,"
    assert list(rows[0]) == (header + "support_x,support_y,support_z").split(",")
    assert len(rows) == len(result.tables["contact"].x)
    frame = result.tables["contact"].to_pandas()
    assert list(frame.columns) == list(rows[0])
    for name in frame.columns:
        written = [r[name] if name in ("surface", "status") else float(r[name]) for r in rows]
        assert frame[name].tolist() == written
    places = [[float(r[k]) for k in "xyz"] for r in rows]
    assert np.round(places, 9).tolist() == sorted(np.round(places, 9).tolist())
    letters = set()
    for row in rows:
        status = row.pop("status")
        assert row.pop("surface") == "contact"
        v = {k: float(x) for k, x in row.items()}
        vectors = {k: [v[f"{k}_{axis}"] for axis in "xyz"] for k in ("ut", "rt")}
        letters.add(status)
        if status == "o":
            assert v["un"] > -1e-12
            assert abs(v["rn"]) + abs(v["rt"]) < 1e-9
        else:
            assert abs(v["un"]) < 1e-12
            assert v["rn"] > 0
            assert v["pressure"] > 0
            assert abs(v["shear"] / v["pressure"] - v["rt"] / v["rn"]) < 1e-9
        assert np.linalg.norm(vectors["rt"]) <= 0.3 * v["rn"] * (1 + 1e-9) + 1e-12
        assert abs(abs(v["ut"]) - np.linalg.norm(vectors["ut"])) < 1e-12
        if status == "k":
            assert abs(v["ut"]) < 1e-12
        if status in "+-s":
            assert abs(np.linalg.norm(vectors["rt"]) - 0.3 * v["rn"]) < 1e-9 * v["rn"]
            assert np.dot(vectors["ut"], vectors["rt"]) < 0
        if status in "+-":
            assert (v["ut"] > 0) == (status == "+")
            assert (v["rt"] < 0) == (status == "+")
    assert "o" in letters
    assert letters & set("+-s")


# -- pictures ------------------------------------------------------------------------------------


def drawn(file):
    """Number of different colours of a picture, on rank 0's word."""
    count = None
    if COMM.rank == 0:
        pixels = matplotlib.image.imread(file)[..., :3]
        assert pixels.shape[0] > 300
        assert pixels.shape[1] > 300
        count = number_of_colours((pixels * 255).astype(int))
    return COMM.bcast(count)


@pytest.mark.parametrize(
    ("cell", "degree"),
    [
        pytest.param("tri", 1, marks=pytest.mark.long),
        pytest.param("quad", 2, marks=pytest.mark.long),
        ("hex", 1),
        pytest.param("tet", 2, marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "pictures",
    reference="itself: pictures are no blanks",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_pictures_are_written(folder, cell, degree):
    three_d = cell in ("tet", "hex")
    if three_d and shutil.which("xvfb-run") is None:
        pytest.skip("VTK may need a display")
    problem = dragged(cell, n=3 if three_d else 8, degree=degree)
    problem.solve()
    stress = MATERIAL.full_stress(problem.u)
    picture_of_body(folder / "body.png", problem, stress=stress, scale=2.0)
    picture_of_contact(folder / "contact.png", problem, title="A block on a ball")
    for name in ("body.png", "contact.png"):
        assert drawn(folder / name) > 100
    assert {f.name for f in folder.iterdir()} == {"body.png", "contact.png"}


@pytest.mark.ranks(2)
def test_picture_in_a_missing_folder_is_refused(folder):
    with pytest.raises(FileNotFoundError) as info:
        picture_of_contact(folder / "missing" / "contact.png", two_surfaces())
    assert info.value.filename == str(folder / "missing" / "contact.png")
