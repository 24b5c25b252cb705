"""Nonlocal friction, against dense numpy, closed forms and the local law."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from support.blocks import block, box, randomise, remainders, same_tables
from support.checks import solved_start
from support.histories import sheared_block
from support.pairs import displacement, held, stacked

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    HalfSpace,
    NonlocalCoulomb,
    NormalCompliance,
    ParametricContact,
    Regularised,
    Sphere,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records.manifest import manifest_of

COMM = MPI.COMM_WORLD


def omega(x):
    """The kernel, up to a factor."""
    return np.exp(-1 / np.maximum(1 - x**2, 1e-3)) * (x < 1)


def averages(x, areas, radius):
    """The matrix N, dense."""
    N = omega(cdist(x, x) / radius) * areas
    return N / N.sum(axis=1, keepdims=True)


@pytest.mark.each_value
@pytest.mark.parametrize(("dim", "cell"), [(2, "quad"), (3, "hex")])
@pytest.mark.verifies(
    "nonlocal friction",
    reference="independent code: a dense compliance and projections in numpy",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_nonlocal_friction_agrees_with_dense_numpy(dim, cell):
    """Compliance of the block, and a projection repeated until nothing changes."""
    n, F, radius = (8, 0.2, 0.3) if dim == 2 else (4, 0.4, 0.6)
    top = np.array([0.005, *[0.0025] * (dim - 2), -0.02])
    floor = HalfSpace(np.zeros(dim), floor_normal(dim))
    law = NonlocalCoulomb(F, radius)
    options = {"snes_rtol": 1e-13}
    result = block(n=n, cell=cell, law=law, top=top, obstacle=floor, options=options).solve()
    t = result.tables["contact"]
    counts = [result.counts[k] for k in ("open", "stick", "slip")]
    assert all(counts)

    domain = box(MPI.COMM_SELF, n, cell)
    V = displacement(domain).function_space
    v = ufl.TrialFunction(V)
    w = ufl.TestFunction(V)
    eps = lambda u: ufl.sym(ufl.grad(u))  # noqa: E731
    lame = 1000.0 * 0.3 / (1.3 * 0.4)
    mu = 1000.0 / 2.6
    energy = lame * ufl.div(v) * ufl.div(w) + 2 * mu * ufl.inner(eps(v), eps(w))
    K = fem.assemble_matrix(fem.form(energy * ufl.dx)).to_dense()
    X = V.tabulate_dof_coordinates()[:, :dim]
    above, below = (np.flatnonzero(np.isclose(X[:, -1], z)) for z in (1.0, 0.0))
    below = below[np.lexsort(np.round(X[below], 9).T[::-1])]
    free = np.setdiff1d(np.arange(len(X)), above)
    dofs, fixed = ((dim * nodes[:, None] + np.arange(dim)).ravel() for nodes in (free, above))
    C = np.linalg.inv(K[np.ix_(dofs, dofs)])
    u0 = -C @ K[np.ix_(dofs, fixed)] @ np.tile(top, len(above))
    mine = (dim * np.searchsorted(free, below)[:, None] + np.arange(dim)).ravel()
    A = C[np.ix_(mine, mine)]
    u0 = u0[mine]
    x = X[below]
    out = floor_normal(dim)
    ends = [np.where(np.isclose(c, 0) | np.isclose(c, 1), 0.5, 1.0) / n for c in x.T[:-1]]
    areas = np.prod(ends, axis=0)
    N = averages(x, areas, radius)
    gap = x @ out
    r = np.zeros((len(x), dim))
    rho = 1.0 / np.linalg.eigvalsh(A)[-1]
    for _ in range(20_000):
        u = (A @ r.ravel() + u0).reshape(r.shape)
        rn = np.maximum(r @ out - rho * (gap + u @ out), 0.0)
        rt = r - rho * u
        rt -= np.outer(rt @ out, out)
        size = np.linalg.norm(rt, axis=1)
        bound = F * areas * (N @ (rn / areas))
        rt *= np.minimum(1.0, bound / np.where(size > 0, size, 1.0))[:, None]
        new = np.outer(rn, out) + rt
        change = np.abs(new - r).max()
        r = new
        if change < 1e-15 * np.abs(r).max():
            break
    np.testing.assert_allclose(t.x, x, atol=1e-12)
    np.testing.assert_allclose(t.force, r, rtol=0, atol=1e-10 * np.abs(r).max())
    np.testing.assert_allclose(t.bound, bound, rtol=0, atol=1e-10 * np.abs(r).max())
    # Friction acts on points that are open, next to those that are not.
    assert np.linalg.norm(t.force[t.letters == "o"], axis=1).max() > 1e-3 * np.abs(r).max()


def floor_normal(dim):
    normal = np.array([0.02, *[0.0] * (dim - 2), 1.0])
    return normal / np.linalg.norm(normal)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("dim", "cell"), [(2, "tri"), (3, "hex"), (3, "tet")])
@pytest.mark.verifies(
    "nonlocal friction",
    reference="closed form: a constant pressure stays constant",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_nonlocal_average_keeps_a_constant_pressure(dim, cell):
    """The pressure and the bound remain constant."""
    pressed = 0.05
    s = 0.03
    F = 0.2
    p = 1000.0 * pressed

    def solved(law):
        return sheared_block(law, dim, cell, s, pressed, F * p).solve().tables["contact"]

    local = solved(Coulomb(F))
    nonlocal_ = solved(NonlocalCoulomb(F, 0.7))
    assert local.count("s" if dim == 3 else "+") == len(local.status)
    same_tables(local, nonlocal_, 1e-12)
    np.testing.assert_allclose(nonlocal_.bound, F * p * local.area, rtol=1e-12)


LAWS = [
    NonlocalCoulomb(0.5, 0.6),
    NormalCompliance(3000.0, 2.5, NonlocalCoulomb(0.5, 0.6)),
    NormalCompliance(3000.0, 1.0, NonlocalCoulomb(0.5, 0.6)),
    Regularised(NonlocalCoulomb(0.5, 0.6), 0.005, "sqrt"),
]


def spread_share(problem, x):
    """Largest entry of the Jacobian between two points, over the largest of the contact rows."""
    state = problem.equations.evaluate_contact(x)
    (found,) = state.surfaces
    step = np.zeros_like(found.jump)
    step[:, -1] = 1.0
    across = found.along(step) - np.einsum("nij,nj->ni", found.by_jump, step)
    return COMM.allreduce(np.abs(across).max(initial=0.0), op=MPI.MAX)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
@pytest.mark.parametrize(
    ("cell", "degree", "method"),
    [("quad", 1, "nodal"), ("tet", 1, "nodal"), ("tri", 2, "integral"), ("quad", 1, "mixed")],
)
@pytest.mark.verifies(
    "nonlocal friction",
    reference="differences: Taylor remainders of second order",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_the_jacobian_of_nonlocal_friction_passes_taylors_test(cell, degree, method, law):
    """The remainder falls as h^2 within smooth pieces."""
    problem = block(n=4 if cell == "quad" else 2, cell=cell, degree=degree, method=method, law=law)
    x = randomise(problem, 1, 0.02, 10.0)
    assert spread_share(problem, x) > 1.0
    sizes = remainders(problem, x, 2)
    if sizes[0] > 1e-12:  # else the piece is affine
        np.testing.assert_allclose(np.log2(sizes[:-1] / sizes[1:]), 2.0, atol=0.35)


def between_bodies(law, solver="direct", cell="tet"):
    both = stacked(3, cell, 3)
    u = displacement(both.mesh)
    pair = ContactPair(u, both, slave=3, master=2, law=law)
    top = held(u, both.facet_tags, 4, (0.05, 0.01, -0.04))
    ends = [held(u, both.facet_tags, 1, np.zeros(3)), top]
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    options = {"snes_rtol": 1e-12, "linear_solver": solver}
    return ContactProblem(energy, u, [pair], bcs=ends, petsc_options=options)


@pytest.mark.verifies(
    "nonlocal friction",
    reference="independent code: averages of the pressures in numpy",
    aspects=(
        "3D",
        "pairs",
        "multigrid",
    ),
)
def test_nonlocal_friction_between_bodies_averages_the_slaves_pressure():
    """Both solvers average the pressures of the slave points."""
    law = NonlocalCoulomb(0.25, 0.5)
    tables = []
    for solver in ("direct", "amg"):
        result = between_bodies(law, solver).solve()
        assert result.kkt_violation < 1e-9
        t = result.tables["contact"]
        assert 0 < t.count("k") < len(t.status)
        bound = 0.25 * t.area * (averages(t.x, t.area, 0.5) @ t.pressure)
        np.testing.assert_allclose(t.bound, bound, rtol=1e-9)
        slips = t.letters == "s"
        np.testing.assert_allclose(np.linalg.norm(t.rt, axis=1)[slips], bound[slips], rtol=1e-9)
        tables.append(t)
    same_tables(*tables, 1e-8)


@pytest.mark.verifies(
    "nonlocal friction", reference="itself: the local law, as the radius falls", aspects=("2D",)
)
def test_nonlocal_friction_converges_to_the_local_law():
    """On a patch inside the surface: forces at order 4/3 or so (the pressure ends like a root),
    resultants and slips at order 2."""
    n = 64

    def solved(law):
        domain = mesh.create_unit_square(COMM, n, 6, mesh.CellType.quadrilateral)
        round_ = Sphere((0.5, -2.0), 2.0)
        problem = block(domain=domain, cell="quad", law=law, top=(0.06, -0.03), obstacle=round_)
        return problem.solve().tables["contact"]

    local = solved(Coulomb(0.3))
    errors = []
    assert 0 < local.count("o") < n
    for radius in (0.2, 0.1, 0.05):
        t = solved(NonlocalCoulomb(0.3, radius))
        off = t.force - local.force
        errors.append((
            np.abs(off).sum() / np.abs(local.force).sum(),
            np.abs(off.sum(axis=0)).max() / np.abs(local.force.sum(axis=0)).max(),
            np.abs(t.ut - local.ut).max() / np.abs(local.ut).max(),
        ))  # fmt: skip
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders[:, 0], 1.3, atol=0.15)
    np.testing.assert_allclose(orders[:, 1:], 1.9, atol=0.25)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "nonlocal friction",
    "friction as parameter",
    reference="itself: a solve at the end of the branch",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_a_branch_in_nonlocal_friction_ends_in_the_solution():
    """Followed in the coefficient by steps, to the solution at its end."""
    domain = box(COMM, 4, "quad")
    gamma = fem.Constant(domain, 0.6)
    options = dict(n=4, cell="quad", top=(0.03, -0.03))
    problem = block(**options, domain=domain, law=NonlocalCoulomb(gamma, 0.3))
    system = ParametricContact(problem, gamma)
    x = solved_start(system, 0.6)
    other = block(**options, domain=domain, law=NonlocalCoulomb(gamma, 0.31))
    assert manifest_of(other)["forms"] != manifest_of(system.problem)["forms"]
    branch = follow(system, x, 0.6, gamma_range=(0.3, 0.6), direction="decreasing")
    assert branch.reason == "gamma reached the end of its range"
    assert any(s.changes for s in branch.special)
    found = system.result_at(branch.points[-1]).tables["contact"]
    same_tables(found, block(**options, law=NonlocalCoulomb(0.3, 0.3)).solve().tables["contact"])
