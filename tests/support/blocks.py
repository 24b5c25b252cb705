"""Small contact problems that many tests share."""

from dataclasses import replace

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.materials import LinearElastic

CELLS = {
    "tri": mesh.CellType.triangle,
    "quad": mesh.CellType.quadrilateral,
    "tet": mesh.CellType.tetrahedron,
    "hex": mesh.CellType.hexahedron,
}
#: (dim, cell) of every kind of mesh.
KINDS = [(2, "tri"), (2, "quad"), (3, "tet"), (3, "hex")]


def box(comm, n, cell, *, ghost_mode=mesh.GhostMode.shared_facet, size=1.0):
    """Unit square or cube of n cells along an edge, scaled by ``size``."""
    if cell in ("tri", "quad"):
        domain = mesh.create_unit_square(comm, n, n, CELLS[cell], ghost_mode=ghost_mode)
    else:
        domain = mesh.create_unit_cube(comm, n, n, n, CELLS[cell], ghost_mode=ghost_mode)
    domain.geometry.x[:] *= size
    return domain


def facets(domain, axis, value):
    """Boundary facets on a coordinate plane."""
    return mesh.locate_entities_boundary(
        domain, domain.topology.dim - 1, lambda x: np.isclose(x[axis], value, atol=1e-9)
    )


def interpolate(f, value):
    """Interpolate a UFL expression into a Function (points are a method only in DOLFINx 0.9)."""
    points = f.function_space.element.interpolation_points
    f.interpolate(fem.Expression(value, points() if callable(points) else points))


def block(
    comm=MPI.COMM_WORLD,
    n=4,
    cell="tri",
    *,
    law=Coulomb(0.3),  # noqa: B008
    top=None,
    obstacle=None,
    degree=1,
    method=None,
    multiplier_degree=1,
    young=1000.0,
    poisson=0.3,
    material=None,
    r=None,
    where=None,
    options=None,
    domain=None,
    sliding=None,
):
    """The block of `cases.block`: held on its top, in contact on its bottom (or on ``where``)."""
    domain = box(comm, n, cell) if domain is None else domain
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    moved = np.array(top if top is not None else (0.004, *[0.0] * (dim - 2), -0.01))
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    material = material or LinearElastic.from_young(young, poisson)
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0) if where is None else where(domain),
        obstacle=obstacle or HalfSpace(np.zeros(dim), np.eye(dim)[-1]),
        law=law,
        method=method,
        multiplier_degree=multiplier_degree,
        sliding=sliding,
    )
    return ContactProblem(
        material.energy(u) * ufl.dx,
        u,
        [surface],
        bcs=[fem.dirichletbc(moved, held, V)],
        r=r,
        petsc_options=options,
    )


def half_block(comm=MPI.COMM_WORLD, n=4, method=None):
    """A square pressed on a floor, one side a symmetry plane: a contact node moves up alone."""
    domain = mesh.create_unit_square(comm, n, n)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    side = fem.locate_dofs_topological(V.sub(0), 1, facets(domain, 0, 0.0))
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    bcs = [
        fem.dirichletbc(np.array([0.0, -0.01]), top, V),
        fem.dirichletbc(0.0, side, V.sub(0)),
    ]
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    law = Coulomb(0.1)
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=law, method=method)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=bcs)


def same_tables(a, b, tolerance=1e-9):
    """Whether two contact tables agree, forces and lengths relative to their largest."""
    np.testing.assert_allclose(a.x, b.x, atol=1e-9)
    force = np.abs(a.force).max()
    length = max(np.abs(a.ut).max(), np.abs(a.un).max())
    np.testing.assert_allclose(a.force, b.force, rtol=0, atol=tolerance * force)
    np.testing.assert_allclose(a.un, b.un, rtol=0, atol=tolerance * length)
    np.testing.assert_allclose(a.ut, b.ut, rtol=0, atol=tolerance * length)
    assert a.status == b.status


def restore_statuses(problem, *codes):
    """Restore the state in the Functions with other statuses, one array or number a surface."""
    state = problem.snapshot()
    held = [np.full(len(s), c, dtype=np.int8) for s, c in zip(state.statuses, codes, strict=True)]
    problem.restore(replace(state, statuses=tuple(held)))


def randomise(problem, seed, displacement, traction):
    """Unknowns that do not depend on the number of ranks; a mix of all statuses."""
    x = problem.create_vector()
    u = problem.u
    multiplier = problem.surfaces[0].multiplier

    def wave(amplitude, phase):
        return lambda y: (
            amplitude
            * np.array(
                [
                    np.sin((17 + 3 * i + seed) * y[0] + (5 + i) * y[1] + 3 * y[2] + phase + i)
                    for i in range(problem.V.mesh.geometry.dim)
                ]
            )
        )

    u.interpolate(wave(displacement, 0.3))
    multiplier.interpolate(wave(traction, 1.1))
    problem.write(x)
    problem.read(x)
    return x


def remainders(problem, x, seed):
    """|H(x + h d) - H(x) - h J d| over |H(x)| for shrinking h, the status held."""
    d = randomise(problem, seed, 1.0, 500.0)
    # Dirichlet columns are lifted, so H is differentiable along what leaves Dirichlet data alone.
    fixed = problem.equations.constraints.fixed.reshape(-1)[: problem.u.x.petsc_vec.getLocalSize()]
    values = problem.equations.constraints.values().reshape(-1)[: len(fixed)]
    d.array[: len(fixed)][fixed] = 0.0
    d.scale(1e-3)
    x.array[: len(fixed)][fixed] = values[fixed]
    b0, b1, y, Jd = (problem.create_vector() for _ in range(4))
    state = problem.residual(x, b0)
    jacobian = Jacobian(problem.equations)
    jacobian.update(state)
    jacobian.matrix.mult(d, Jd)
    sizes = []
    for h in (1.0, 0.5, 0.25):
        y.waxpy(h, d, x)
        problem.residual(y, b1, state.statuses)
        b1.axpy(-1.0, b0)
        b1.axpy(-h, Jd)
        sizes.append(b1.norm() / b0.norm())
    return np.array(sizes)
