"""Bodies of quadrilaterals and hexahedra that are nearly incompressible, by a mean dilatation."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import CELLS, box, facets

import dolfinx.fem.petsc
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, Cylinder, HalfSpace, Sphere
from dolfinx_contact.materials import (
    Axisymmetric,
    CiarletGeymonat,
    LinearElastic,
    NeoHookean,
    StVenantKirchhoff,
    lame,
)

COMM = MPI.COMM_WORLD
YOUNG = 2.0
PRESSURE = 0.3
INNER, OUTER = 1.0, 2.0


def quarter(n, cell="quad"):
    """A quarter of a thick cylinder, in 3D one layer of it, n cells through the wall."""
    low, high = [0.0, 0.0], [1.0, 1.0]
    if cell in ("tri", "quad"):
        domain = mesh.create_rectangle(COMM, [low, high], [n, 2 * n], CELLS[cell])
    else:
        corners = [[*low, 0.0], [*high, 0.5]]
        domain = mesh.create_box(COMM, corners, [n, 2 * n, 1], CELLS[cell])
    x = domain.geometry.x
    r = INNER + (OUTER - INNER) * x[:, 0]
    angle = 0.5 * np.pi * x[:, 1]
    x[:, 0] = r * np.cos(angle)
    x[:, 1] = r * np.sin(angle)
    return domain


def energy_of(material, u, kind):
    if kind == "mean":
        return material.mean_dilatation_energy(u)
    return material.energy(u) * ufl.dx


def symmetry(V, tol=1e-9):
    """Return symmetry conditions on x = 0 and y = 0, and in 3D on both ends of the layer."""
    domain = V.mesh
    tdim = domain.topology.dim
    planes = [(0, 0.0), (1, 0.0), (2, 0.0), (2, 0.5)][: 2 if tdim == 2 else 4]
    bcs = []
    for axis, value in planes:
        where = facets(domain, axis, value)
        dofs = fem.locate_dofs_topological(V.sub(axis), tdim - 1, where)
        bcs.append(fem.dirichletbc(0.0, dofs, V.sub(axis)))
    return bcs


def at_radius(domain, radius):
    """Facets of the inner or outer face, all of whose vertices have that radius."""
    return mesh.locate_entities_boundary(
        domain, domain.topology.dim - 1, lambda x: np.isclose(np.hypot(x[0], x[1]), radius)
    )


def under_pressure(domain, poisson, kind, degree=1):
    """Return the displacement of the quarter under inner pressure, and its closed form."""
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    inside = at_radius(domain, INNER)
    tags = mesh.meshtags(domain, dim - 1, inside, np.full(len(inside), 1, dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)
    material = LinearElastic.from_young(YOUNG, poisson)
    test, trial = ufl.TestFunction(V), ufl.TrialFunction(V)
    residual = ufl.derivative(energy_of(material, u, kind), u, test)
    load = -PRESSURE * ufl.dot(ufl.FacetNormal(domain), test) * ds(1)
    solve(ufl.derivative(residual, u, trial), load, symmetry(V), u)
    return u, material


def solve(stiffness, load, bcs, u):
    """A linear problem with supports that do not move, by MUMPS."""
    A = dolfinx.fem.petsc.assemble_matrix(fem.form(stiffness), bcs=bcs)
    A.assemble()
    b = dolfinx.fem.petsc.assemble_vector(fem.form(load))
    b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    for bc in bcs:
        dofs, owned = bc.dof_indices()
        b.array[dofs[:owned]] = 0.0
    ksp = PETSc.KSP().create(COMM)
    ksp.setOperators(A)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    x = b.duplicate()
    ksp.solve(b, x)
    u.x.array[: x.getLocalSize()] = x.array_r
    u.x.scatter_forward()


def closed_form(poisson, r, pressure=PRESSURE):
    """Radial displacement of a thick cylinder in plane strain under pressure inside (Lame)."""
    share = INNER**2 / (OUTER**2 - INNER**2)
    return (1 + poisson) / YOUNG * pressure * share * ((1 - 2 * poisson) * r + OUTER**2 / r)


def error(u, poisson):
    """Error of u in L2, relative."""
    domain = u.function_space.mesh
    x = ufl.SpatialCoordinate(domain)
    r = ufl.sqrt(x[0] ** 2 + x[1] ** 2)
    exact = [closed_form(poisson, r) * x[i] / r for i in range(2)] + [0.0] * (len(u) - 2)
    dx = ufl.dx(metadata={"quadrature_degree": 6})
    parts = [
        COMM.allreduce(fem.assemble_scalar(fem.form(ufl.inner(e, e) * dx)))
        for e in (u - ufl.as_vector(exact), ufl.as_vector(exact))
    ]
    return np.sqrt(parts[0] / parts[1])


def middle_pressures(u, material):
    """Mean stress at the middles of the cells of this rank."""
    domain = u.function_space.mesh
    dim = domain.topology.dim
    middle = np.full((1, dim), 0.5)
    stress = ufl.tr(material.full_stress(u)) / 3
    expression = fem.Expression(stress, middle, comm=COMM)
    cells = np.arange(domain.topology.index_map(dim).size_local, dtype=np.int32)
    return expression.eval(domain, cells).ravel()


@pytest.mark.parametrize("cell", ["quad", "hex"])
@pytest.mark.parametrize("kind", ["linear", "neo", "ciarlet"])
@pytest.mark.verifies(
    "hyperelastic bodies",
    "nearly incompressible bodies",
    reference="closed form: a uniform strain of distorted cells",
    aspects=("2D", "3D"),
)
def test_a_uniform_strain_of_distorted_cells_is_exact(cell, kind):
    """Distorted cells held at their boundary by a uniform strain have that strain everywhere."""
    domain = box(COMM, 3, cell)
    dim = domain.geometry.dim
    x = domain.geometry.x
    inner = np.all((x[:, :dim] > 0.1) & (x[:, :dim] < 0.9), axis=1)
    x[inner, :dim] += 0.06 * np.sin(7.0 * x[inner, :dim] + 3.0 * x[inner, dim - 1 : dim])
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    lmbda, mu = lame(YOUNG, 0.4999)
    material = {
        "linear": LinearElastic(lmbda, mu),
        "neo": NeoHookean(lmbda, mu),
        "ciarlet": CiarletGeymonat(lmbda, mu, mu / 4),
    }[kind]
    strain = 0.01 * np.array([[1.0, 2.0, 0.5], [-1.0, -0.8, 0.3], [0.2, 0.6, -0.3]])[:dim, :dim]
    u.interpolate(lambda x: strain @ x[:dim])
    residual = fem.form(ufl.derivative(material.mean_dilatation_energy(u), u, ufl.TestFunction(V)))
    rows = fem.assemble_vector(residual)
    rows.scatter_reverse(0)  # of the insert mode "add"
    domain.topology.create_connectivity(dim - 1, dim)
    at_edge = fem.locate_dofs_topological(V, dim - 1, mesh.exterior_facet_indices(domain.topology))
    owned = V.dofmap.index_map.size_local
    inside = np.setdiff1d(np.arange(owned), at_edge)
    size = COMM.allreduce(np.abs(rows.array).max(), op=MPI.MAX)
    assert np.abs(rows.array.reshape(-1, dim)[inside]).max(initial=0.0) < 1e-11 * size
    # The energy is that of all quadrature points, as the strain is the same at all of them.
    energies = [
        COMM.allreduce(fem.assemble_scalar(fem.form(energy_of(material, u, way))))
        for way in ("mean", "whole")
    ]
    assert energies[0] == pytest.approx(energies[1], rel=1e-11)


@pytest.mark.parametrize("cell", ["quad", pytest.param("hex", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "nearly incompressible bodies",
    reference="closed form: Lame's thick cylinder",
    aspects=("2D", "3D"),
)
def test_mean_dilatation_does_not_lock(cell):
    """Under pressure inside the error does not depend on nu, has order 2, and pressures are even.

    The mean stress of the cylinder is the same everywhere.
    """
    n = 4
    errors = {}
    for poisson in (0.3, 0.499, 0.499999):
        domain = quarter(n, cell)
        u, material = under_pressure(domain, poisson, "mean")
        errors[poisson] = error(u, poisson)
        mean = (1 + poisson) / 3 * 2 * PRESSURE * INNER**2 / (OUTER**2 - INNER**2)
        off = middle_pressures(u, material) - mean
        assert np.abs(off).max(initial=0.0) < 0.05 * PRESSURE
    assert max(errors.values()) < 0.02
    assert max(errors.values()) < 1.3 * errors[0.3]
    # What it is there for: by the full rule the same mesh is far too stiff.
    locked, _ = under_pressure(quarter(n, cell), 0.4999, "whole")
    assert error(locked, 0.4999) > 0.5
    finer, _ = under_pressure(quarter(2 * n, cell), 0.499, "mean")
    assert np.log2(errors[0.499] / error(finer, 0.499)) == pytest.approx(2.0, abs=0.15)


@pytest.mark.verifies(
    "nearly incompressible bodies",
    "bodies of revolution",
    reference="closed form: Lame's thick cylinder",
    aspects=("2D",),
)
def test_mean_dilatation_works_in_revolution():
    """A section of the same cylinder, held at its ends, whose cells are rectangles."""
    poisson = 0.4999
    errors = {}
    for kind in ("mean", "whole"):
        domain = mesh.create_rectangle(
            COMM, [[INNER, 0.0], [OUTER, 0.5]], [8, 4], mesh.CellType.quadrilateral
        )
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        u = fem.Function(V)
        material = Axisymmetric(LinearElastic.from_young(YOUNG, poisson))
        if kind == "mean":
            energy = material.mean_dilatation_energy(u)
        else:
            energy = material.energy(u) * ufl.dx
        ends = [fem.locate_dofs_topological(V.sub(1), 1, facets(domain, 1, z)) for z in (0.0, 0.5)]
        bcs = [fem.dirichletbc(0.0, dofs, V.sub(1)) for dofs in ends]
        bore = HalfSpace((0.1, 0.0), (1.0, 0.0))  # far away: only the problem needs it
        surface = ContactSurface(
            u, facets(domain, 0, INNER), obstacle=bore, law=Coulomb(0.0), axisymmetric=True
        )
        inside = facets(domain, 0, INNER)
        tags = mesh.meshtags(domain, 1, inside, np.full(len(inside), 1, dtype=np.int32))
        ds = ufl.Measure("ds", domain, subdomain_data=tags)
        energy -= PRESSURE * u[0] * ds(1)
        ContactProblem(energy, u, [surface], bcs=bcs).solve()
        x = ufl.SpatialCoordinate(domain)
        off = (u[0] - closed_form(poisson, x[0])) ** 2 * ufl.dx(metadata={"quadrature_degree": 6})
        size = closed_form(poisson, x[0]) ** 2 * ufl.dx(metadata={"quadrature_degree": 6})
        parts = [COMM.allreduce(fem.assemble_scalar(fem.form(f))) for f in (off, size)]
        errors[kind] = np.sqrt(parts[0] / parts[1])
    assert errors["mean"] < 0.005
    assert errors["whole"] > 0.02


@pytest.mark.parametrize(
    ("cell", "solver"),
    [
        *(("quad", "direct"), ("quad", "amg")),
        pytest.param("hex", "amg", marks=pytest.mark.long),
        pytest.param("hex", "direct", marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "nearly incompressible bodies",
    "press fits",
    reference="closed form: Lame's thick cylinder",
    aspects=("2D", "3D", "multigrid"),
)
def test_shaft_with_interference_has_the_closed_form_pressure(cell, solver):
    """The pressure on a shaft with interference agrees with the closed form."""
    poisson = 0.4999
    overlap = 1e-3
    pressure = overlap / closed_form(poisson, INNER, 1.0)
    domain = quarter(6, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    material = LinearElastic.from_young(YOUNG, poisson)
    surface = ContactSurface(
        u, at_radius(domain, INNER), obstacle=shaft(dim, INNER + overlap), law=Coulomb(0.0)
    )
    problem = ContactProblem(
        material.mean_dilatation_energy(u),
        u,
        [surface],
        bcs=symmetry(V),
        petsc_options={"linear_solver": solver},
    )
    result = problem.solve()
    (table,) = result.tables.values()
    assert table.pressure == pytest.approx(pressure, rel=0.02)


def shaft(dim, radius):
    """A cylinder along z, in 2D a disc."""
    if dim == 2:
        return Sphere((0.0, 0.0), radius)
    return Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius)


def test_mean_dilatation_refuses_simplices_and_other_degrees():
    """Simplices, a displacement of degree 2 and plane stress are refused by name."""
    material = LinearElastic.from_young(YOUNG, 0.4999)
    V = fem.functionspace(box(COMM, 2, "tri"), ("Lagrange", 1, (2,)))
    with pytest.raises(
        ValueError, match=r"degree 1.* on triangles. On other cells use u of degree 2"
    ):
        material.mean_dilatation_energy(fem.Function(V))
    domain = box(COMM, 2, "quad")
    V = fem.functionspace(domain, ("Lagrange", 2, (2,)))
    with pytest.raises(ValueError, match=r"displacement of degree 1, .*; got .*, 2, "):
        material.mean_dilatation_energy(fem.Function(V))
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    thin = LinearElastic.from_young(YOUNG, 0.4999, plane_stress=True)
    with pytest.raises(ValueError, match="plane stress does not lock"):
        thin.mean_dilatation_energy(fem.Function(V))
    u = fem.Function(V)
    with pytest.raises(ValueError, match=r"energy of a StVenantKirchhoff is unknown"):
        StVenantKirchhoff(1.0, 1.0).mean_dilatation_energy(u)
    with pytest.raises(ValueError, match=r"energy of a StVenantKirchhoff is unknown"):
        Axisymmetric(StVenantKirchhoff(1.0, 1.0)).mean_dilatation_stress(u)
    for measure in (ufl.ds, ufl.dx(1) + ufl.dx(2), 2.0):
        with pytest.raises(ValueError, match="dx must be a cell measure"):
            material.mean_dilatation_energy(u, measure)
    three = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (3,))))
    with pytest.raises(ValueError, match="with a component for every axis"):
        material.mean_dilatation_energy(three)
    jumping = fem.Function(fem.functionspace(domain, ("DG", 1, (2,))))
    with pytest.raises(ValueError, match="requires a continuous Lagrange displacement"):
        material.mean_dilatation_energy(jumping)
