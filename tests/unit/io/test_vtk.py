"""VTK files read by PyVista, and the script showing results in ParaView."""

import ast
import os
import shutil

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block
from support.pairs import pressed_blocks as pressed
from support.recorded_run import moved_block, record
from support.vtk_files import read_grid, von_mises

from dolfinx_contact.io import write_fields
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import BranchRecord, write_series

COMM = MPI.COMM_WORLD
MATERIAL = LinearElastic.from_young(1000.0, 0.3)
CURVE = np.array([[0.03, -0.02, 0.05], [0.01, 0.04, -0.02], [-0.03, 0.02, 0.02]])


def bent(x):
    """A displacement of degree 2, by components; ``x`` has a row a component."""
    dim = 2 if len(x) == 2 else 3
    return CURVE[:dim, :dim] @ x[:dim] ** 2 + 0.1 * x[0] * x[1]


@pytest.mark.parametrize(
    ("cell", "degree", "kind"),
    [
        ("tri", 1, 69),
        ("tri", 2, 69),
        ("quad", 2, 70),
        ("tet", 2, 71),
        ("hex", 1, 72),
        ("hex", 2, 72),
    ],
)
@pytest.mark.verifies(
    "files for ParaView",
    reference="independent code: PyVista",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_vtk_files_have_geometry_and_displacement(folder, cell, degree, kind):
    """Each cell, its Lagrange kind, and values at the nodes and between them."""
    problem = block(n=2, cell=cell, degree=degree)
    u = problem.u
    dim = len(u)
    u.interpolate(lambda x: bent(x[:dim]))
    file, *_ = write_fields(folder, problem, format="vtk")
    nodes = u.function_space.dofmap.index_map.size_global
    cells = u.function_space.mesh.topology.index_map(dim)
    if COMM.rank > 0:
        return
    grid = read_grid(file)
    assert grid.n_cells == cells.size_global
    assert COMM.size > 1 or grid.n_points == nodes
    assert set(grid.celltypes) == {kind}
    assert grid.array_names == ["displacement"]
    expected = np.pad(bent(grid.points[:, :dim].T).T, ((0, 0), (0, 3 - dim)))
    np.testing.assert_allclose(grid["displacement"], expected, rtol=1e-14, atol=1e-16)
    if degree == 2:  # the order of the nodes of a cell is right only if this holds
        import pyvista

        inside = np.random.default_rng(1).uniform(0.05, 0.95, (200, 3))
        inside[:, dim:] = 0.0
        found = pyvista.PolyData(inside).sample(grid)
        assert found["vtkValidPointMask"].all()
        expected = bent(inside[:, :dim].T).T
        np.testing.assert_allclose(found["displacement"][:, :dim], expected, atol=1e-6)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("cell", "degree"), [("quad", 1), ("tet", 2)])
@pytest.mark.verifies(
    "files for ParaView",
    "stresses",
    reference="independent code: PyVista",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_vtk_fields_equal_the_functions(folder, cell, degree):
    """The same numbers as the Functions have, on any number of ranks."""
    problem = block(n=3, cell=cell, degree=degree)
    problem.solve()
    stress = MATERIAL.full_stress(problem.u)
    files = write_fields(folder, problem, stress=stress, format="vtk")
    assert [f.name for f in files] == ["body.pvd", "body_stress.pvd", "contact.pvd"]
    fields = problem.contact_fields(problem.surfaces[0])
    x = problem.surfaces[0].points.vertices.tabulate_dof_coordinates()
    dim = problem.V.mesh.geometry.dim
    places = np.concatenate(COMM.allgather(x))
    values = {k: np.concatenate(COMM.allgather(f.x.array)) for k, f in fields.items()}
    if COMM.rank > 0:
        return
    body, stresses, contact = map(read_grid, files)
    moved = (0.004, -0.01, 0.0) if dim == 2 else (0.004, 0.0, -0.01)
    assert set(stresses.array_names) == {"stress", "von_mises", "displacement"}
    mises = von_mises(stresses["stress"])
    np.testing.assert_allclose(stresses["von_mises"], mises, rtol=1e-6, atol=1e-9)
    for grid in (body, stresses):
        found = grid["displacement"][np.isclose(grid.points[:, dim - 1], 1.0)]
        np.testing.assert_allclose(found, np.tile(moved, (len(found), 1)), atol=1e-15)
    assert set(contact.array_names) == set(fields)
    rows = np.linalg.norm(places[None] - contact.points[:, None], axis=2).argmin(axis=1)
    for name, v in values.items():
        expected = v.reshape(len(places), -1)[rows]
        found = contact[name].reshape(len(rows), -1)
        # DOLFINx writes 16 digits.
        found = found[:, : expected.shape[1]]
        np.testing.assert_allclose(found, expected, rtol=2e-15, atol=1e-300)


def test_vtk_series_has_the_gamma_of_each_point(folder):
    """A .pvd names the points of the journal, and their gamma is in the files."""
    system, functionals = moved_block(COMM)
    record(system, functionals, folder / "record", max_steps=8)
    with BranchRecord(folder / "record", system, functionals, resume=True) as r:
        files = write_series(folder / "series", r, format="vtk")
        points = [p for p in r.journal.branches[0].points if p.checkpoint is not None]
    assert [f.name for f in files] == ["branch_0000_body.pvd", "branch_0000_contact.pvd"]
    if COMM.rank > 0:
        return
    import pyvista

    for file in files:
        reader = pyvista.get_reader(file)
        assert reader.time_values == [float(p.index) for p in points]
    for time, point in enumerate(points):
        gamma = read_grid(files[1], time)["gamma"]
        np.testing.assert_allclose(gamma, point.gamma, rtol=2e-15)


# -- ParaView --------------------------------------------------------------------------------------


def test_the_script_needs_paraview_alone(folder):
    """It parses, imports nothing of the package, and does not import itself."""
    files = write_fields(folder, block(cell="tri"))
    tree = ast.parse((folder / "paraview.py").read_text())
    names = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert names == {"os", "sys", "typing", "paraview"}
    text = (folder / "paraview.py").read_text()
    assert f"FOLDER = {str(folder.resolve())!r}" in text
    assert all(f"'{file.stem}': '{file.name}'" in text for file in files)


@pytest.mark.long
@pytest.mark.ranks(2)
@pytest.mark.skipif(
    "DOLFINX_CONTACT_RESULTS" not in os.environ and shutil.which("pvbatch") is None,
    reason="`make test-paraview` runs it where ParaView is",
)
def test_results_for_paraview(tmp_path):
    """Results of every kind, for `tests/in_paraview.py` to open."""
    folder = os.environ.get("DOLFINX_CONTACT_RESULTS") or COMM.bcast(str(tmp_path))
    for cell, degree, format in [
        ("tri", 1, "vtx"),
        ("quad", 2, "vtx"),
        ("tet", 2, "vtx"),
        ("hex", 1, "vtx"),
        ("quad", 2, "vtk"),
        ("tet", 2, "vtk"),
    ]:
        problem = block(n=4, cell=cell, degree=degree)
        problem.solve()
        stress = None if cell == "hex" else MATERIAL.full_stress(problem.u)
        write_fields(f"{folder}/{cell}_{degree}_{format}", problem, stress=stress, format=format)
    for name, case, format in [
        ("pair_2d", ("quad", 5, 3, 1, "nodal"), "vtx"),
        ("pair_3d", ("tet", 2, 2, 2, "integral"), "vtk"),
        ("mortar_3d", ("hex", 3, 4, 1, "nodal"), "vtx"),
    ]:
        problem = pressed(*case, friction=0.25)
        problem.solve()
        stress = MATERIAL.full_stress(problem.u)
        write_fields(f"{folder}/{name}", problem, stress=stress, format=format)
    system, functionals = moved_block(COMM)
    record(system, functionals, f"{folder}/record", max_steps=60)
    with BranchRecord(f"{folder}/record", system, functionals, resume=True) as r:
        write_series(f"{folder}/series_vtx", r, format="vtx")
        write_series(f"{folder}/series_vtk", r, format="vtk")
        write_fields(f"{folder}/series_vtx", system.problem)  # a state beside a branch


def test_files_of_the_user_beside_the_files_of_a_state_stay(folder):
    """Also if their names look like parts of a series; parts of an earlier state go."""
    problem = block(n=2)
    problem.solve()
    write_fields(folder, problem, format="vtk")
    old = {p.name for p in folder.iterdir()}
    own = ("body000123.vtu", "contact_p7_000042.vtu")
    if COMM.rank == 0:
        for name in own:
            (folder / name).write_text("mine")
        pieces = (folder / "body.pvd").read_text().replace("body000000", "body000009")
        (folder / "body.pvd").write_text(pieces)
        (folder / "body000000.pvtu").rename(folder / "body000009.pvtu")
    COMM.barrier()
    write_fields(folder, problem, format="vtk")
    assert {p.name for p in folder.iterdir()} == old | set(own)


def test_files_of_the_user_in_a_folder_of_fields_are_not_replaced(folder):
    problem = block(n=2)
    problem.solve()
    if COMM.rank == 0:
        (folder / "body.bp").mkdir()
        (folder / "body.bp" / "data.csv").write_text("mine")
    COMM.barrier()
    with pytest.raises(OSError, match=r"body\.bp"):
        write_fields(folder, problem)
    assert (folder / "body.bp" / "data.csv").read_text() == "mine"


def test_files_of_the_other_format_are_replaced(folder):
    """Together with the parts that they name."""
    problem = block(n=2, cell="tri")
    for format, suffix in (("vtx", ".bp"), ("vtk", ".pvd"), ("vtx", ".bp")):
        files = write_fields(folder, problem, format=format)
        assert {file.suffix for file in files} == {suffix}
        COMM.barrier()
        suffixes = {p.suffix for p in folder.iterdir()} - {".py"}
        assert suffixes == ({".bp"} if format == "vtx" else {".pvd", ".pvtu", ".vtu"})
        COMM.barrier()
