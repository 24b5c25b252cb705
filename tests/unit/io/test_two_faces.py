"""Both faces of a pair: files for ParaView, and the balance of forces between them."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets
from support.pairs import MATERIAL, blocks
from support.pairs import pressed_blocks as pressed
from support.vtk_files import read_grid

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.io import write_fields
from dolfinx_contact.io.master import MasterFace

COMM = MPI.COMM_WORLD

MODULUS = 1000.0 * 0.7 / (1.3 * 0.4)  # of uniaxial strain
#: Cell, cells along the lower and the upper body, degree, method.
CASES = [
    ("tri", 3, 3, 1, "nodal"),
    ("quad", 2, 2, 2, "integral"),
    ("quad", 5, 3, 1, "nodal"),  # a mortar
    ("tet", 2, 2, 1, "mixed"),
    ("tet", 2, 2, 2, "integral"),
    ("hex", 2, 3, 1, "nodal"),
    ("tet", 2, 3, 1, "nodal"),
]


def gathered(f):
    """Owned values of a Function with the places of their nodes, from all ranks."""
    V = f.function_space
    bs = f.function_space.dofmap.index_map_bs
    n = V.dofmap.index_map.size_local
    parts = COMM.allgather((V.tabulate_dof_coordinates()[:n], f.x.array.reshape(-1, bs)[:n]))
    return tuple(np.concatenate(p) for p in zip(*parts, strict=True))


def total(problem, face, name):
    """Return the sum of a field per area over the vertices of a face."""
    n = face.vertices.dofmap.index_map.size_local
    f = face.fields(problem)[name]
    values = f.x.array.reshape(-1, f.function_space.dofmap.index_map_bs)
    return COMM.allreduce((values * face.areas[:, None])[:n].sum(axis=0))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.verifies(
    "files for ParaView",
    "matching meshes",
    "mortar",
    reference="closed form: uniaxial strain",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_uniform_pressure_is_equal_on_both_faces(case):
    """The same on both faces, whichever nodes they have, and minus that as a traction."""
    problem = pressed(*case)
    pair = problem.surfaces[0]
    problem.solve()
    face = MasterFace(problem, pair)
    fields = face.fields(problem)
    wanted = 0.01 * MODULUS
    slave = gathered(problem.contact_fields(pair)["pressure"])[1]
    np.testing.assert_allclose(slave, wanted, rtol=1e-10)
    np.testing.assert_allclose(gathered(fields["pressure"])[1], wanted, rtol=1e-10)
    x, traction = gathered(fields["traction"])
    down = np.zeros(pair.dim)
    down[-1] = -wanted
    np.testing.assert_allclose(traction, np.tile(down, (len(x), 1)), atol=1e-10 * wanted)
    moved = gathered(fields["displacement"])[1]
    np.testing.assert_allclose(moved[:, -1], -0.01, rtol=1e-10)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.verifies(
    "balance of forces",
    reference="theorem: both faces push each other alike",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_forces_and_moments_between_two_faces_balance(case):
    """With pressure and shear: between the faces, and of their moments."""
    problem = pressed(*case, friction=0.25)
    pair = problem.surfaces[0]
    result = problem.solve()
    found = result.pairs["contact"]
    assert abs(found.slave[0]) > 0.1 * abs(found.slave[-1])
    assert found.imbalance < 1e-12
    assert found.moment < 1e-12
    size = np.linalg.norm(found.slave)
    np.testing.assert_allclose(found.slave, result.resultants["contact"], atol=1e-12 * size)
    np.testing.assert_allclose(found.master, -found.slave, atol=1e-12 * size)
    # What holds the lower block is the only other force on it.
    V = problem.V
    below = fem.locate_dofs_topological(V, pair.dim - 1, facets(V.mesh, pair.dim - 1, 0.0))
    n = V.dofmap.index_map.size_local
    reactions = problem.evaluate().reactions.reshape(-1, pair.dim)[below[below < n]]
    held_by = COMM.allreduce(reactions.sum(axis=0))
    np.testing.assert_allclose(found.master + held_by, 0.0, atol=1e-9 * size)
    assert result.summary()["pairs"]["contact"]["master"] == found.master.tolist()
    face = MasterFace(problem, pair)
    np.testing.assert_allclose(total(problem, face, "traction"), found.master, atol=1e-12 * size)


# -- files -----------------------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize("case", [CASES[2], CASES[4], CASES[5]])
@pytest.mark.parametrize("format", ["vtx", "vtk"])
def test_both_faces_have_files_of_their_own(format, case, folder):
    """Slave and master have files of their own, with the numbers of the Functions."""
    problem = pressed(*case, friction=0.25)
    problem.solve()
    files = write_fields(folder, problem, format=format)
    suffix = {"vtx": ".bp", "vtk": ".pvd"}[format]
    names = ["body", "contact", "contact_opposite"]
    assert [f.name for f in files] == [name + suffix for name in names]
    assert all(f.exists() for f in files)
    fields = MasterFace(problem, problem.surfaces[0]).fields(problem)
    known = {name: gathered(f) for name, f in fields.items()}
    if format == "vtx" or COMM.rank > 0:
        return
    grid = read_grid(files[2])
    assert set(grid.array_names) == {"displacement", "traction", "pressure", "support"}
    cell, below, _, _, _ = case
    count = {"quad": below, "tet": 2 * below**2, "hex": below**2}[cell]
    assert grid.n_cells == count
    for name, (x, values) in known.items():
        at = np.linalg.norm(x[None] - grid.points[:, None], axis=2).argmin(axis=1)
        read = grid[name].reshape(len(grid.points), -1)[:, : values.shape[1]]
        np.testing.assert_allclose(read, values[at], rtol=1e-14, atol=1e-14)


@pytest.mark.ranks(2)
def test_surfaces_with_one_file_name_are_refused(folder):
    both, u, pair = blocks("quad", 2, 2, 1, "nodal", law=Frictionless())
    floor = ContactSurface(
        u, both, tag=1, obstacle=HalfSpace((0, 0), (0, 1)), law=Frictionless(), name="opposite"
    )
    energy = MATERIAL.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [pair, floor])
    with pytest.raises(ValueError, match="make the same file"):
        write_fields(folder, problem)
    assert not list(folder.iterdir())
