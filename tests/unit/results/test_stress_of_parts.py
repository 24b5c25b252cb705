"""The stress of bodies of several materials, by the tags of their cells."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets
from support.pairs import tagged

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, io, plot
from dolfinx_contact.io.fields import body_fields
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

COMM = MPI.COMM_WORLD
PARTS = {1: LinearElastic.from_young(1000.0, 0.0), 2: LinearElastic.from_young(3000.0, 0.0)}
PRESSURE = 0.01 / (1 / 1000 + 1 / 3000)


def pressed(dim, energy):
    """Two blocks on each other, pressed by a hundredth: the problem, and its cell tags."""
    bodies = []
    tags = []
    up = dim - 1
    for i in range(2):
        domain = box(COMM, 3, "tri" if dim == 2 else "tet")
        domain.geometry.x[:, up] += i
        bodies.append(domain)
        tags.append(tagged(domain, **{f"t{2 * i + 1}": (up, i), f"t{2 * i + 2}": (up, i + 1)}))
    both = join(bodies, facet_tags=tags)
    V = fem.functionspace(both.mesh, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    bcs = []
    for place, value in ((0.0, 0.0), (2.0, -0.01)):
        held = np.zeros(dim)
        held[up] = value
        dofs = fem.locate_dofs_topological(V, up, facets(both.mesh, up, place))
        bcs.append(fem.dirichletbc(held, dofs, V))
    pair = ContactPair(u, both, slave=3, master=2, law=Frictionless())
    return ContactProblem(energy(u, dx), u, [pair], bcs=bcs), both.cell_tags


def two(u, dx):
    return sum(part.energy(u) * dx(tag) for tag, part in PARTS.items())


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("dim", "format"),
    [
        pytest.param(3, "vtk", marks=pytest.mark.long),
        pytest.param(2, "vtk", marks=pytest.mark.long),
        (2, "vtx"),
    ],
)
@pytest.mark.verifies(
    "stresses",
    "files for ParaView",
    reference="closed form: uniaxial stress of two bodies",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_each_tag_has_its_stress(folder, dim, format):
    """ParaView and pictures receive the pressure in both bodies."""
    problem, tags = pressed(dim, two)
    problem.solve()
    stress = {tag: part.full_stress(problem.u) for tag, part in PARTS.items()}
    files = io.write_fields(folder, problem, stress=stress, format=format)
    assert any(f.name.startswith("body_stress") for f in files)
    full, mises = body_fields(problem.u, stress, tags)
    exact = np.zeros((3, 3))
    exact[dim - 1, dim - 1] = -PRESSURE
    values = full.x.array.reshape(-1, 3, 3)
    np.testing.assert_allclose(values, np.tile(exact, (len(values), 1, 1)), atol=1e-6)
    np.testing.assert_allclose(mises.x.array, PRESSURE, rtol=1e-6)
    plot.picture_of_body(folder / "body.png", problem, stress=stress)


def refused(folder, reason, problem, stress):
    for write in (
        lambda: io.write_fields(folder, problem, stress=stress),
        lambda: plot.picture_of_body(folder / "body.png", problem, stress=stress),
    ):
        with pytest.raises(ValueError, match=reason):
            write()


def test_stress_by_tags_refuses_incomplete_parts(folder):
    problem, _ = pressed(2, two)
    full = {tag: part.full_stress(problem.u) for tag, part in PARTS.items()}
    refused(folder, r"has the cell tags \[1\], the bulk \[1, 2\]", problem, {1: full[1]})
    refused(folder, r"has the cell tags \[1, 2, 7\]", problem, full | {7: full[1]})
    refused(folder, r"has the cell tags \[2, 'steel'\]", problem, {"steel": full[1], 2: full[2]})
    refused(folder, "3 x 3", problem, full | {2: PARTS[2].stress(problem.u)})
    plain, _ = pressed(2, lambda u, dx: PARTS[1].energy(u) * ufl.dx)
    refused(folder, "needs a bulk with cell tags", plain, {1: PARTS[1].full_stress(plain.u)})
    other = PARTS[1].full_stress(fem.Function(plain.V, name="w"))
    refused(folder, "depends on the Function 'w', not on the displacement", plain, other)


@pytest.mark.parametrize("cell", ["quad", "tri"])
def test_corners_have_the_stress_of_their_cells(cell):
    """Corners of cells between two moduli have the stress of their own cell."""
    domain = box(COMM, 2, cell)
    x = ufl.SpatialCoordinate(domain)
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: np.stack([0 * x[0], 0.01 * x[1] * (1 + x[0])]))
    young = ufl.conditional(ufl.lt(x[0], 0.5), 1000.0, 3000.0)
    full, _ = body_fields(u, LinearElastic.from_young(young, 0.0).full_stress(u))
    W = full.function_space
    n = domain.topology.index_map(2).size_local
    dofs = W.dofmap.list[:n]
    places = W.tabulate_dof_coordinates()[dofs]
    modulus = np.where(places.mean(axis=1)[:, 0] < 0.5, 1000.0, 3000.0)[:, None]
    strains = ufl.sym(ufl.grad(u))
    points = W.element.interpolation_points
    points = points() if callable(points) else points
    strain = fem.Expression(strains, points).eval(domain, np.arange(n, dtype=np.int32))
    strain = strain.reshape(*dofs.shape, 2, 2)
    found = full.x.array.reshape(-1, 3, 3)[dofs]
    expected = modulus[..., None, None] * strain
    np.testing.assert_allclose(found[..., :2, :2], expected, rtol=0, atol=1e-8 * 60.0)
