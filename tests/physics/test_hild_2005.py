"""Exact non-uniqueness in the continuum (Hild, ZAMM 85, 2005): a stick and a grazing state.

Polynomial solutions on the triangle A = (0, 0), B = (1, 0), C = (xc, yc) with nu = (1 - xc)/2 and
yc = xc sqrt((1 - xc)/(1 + xc)), contact on AB, Dirichlet data on BC and a constant traction on AC:
at F_c = sqrt((1 + xc)/(1 - xc)) a continuum from one to the other, beyond exactly these two. Linear
elements have them on every mesh.
"""

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.analysis import critical_friction
from dolfinx_contact.materials import LinearElastic, lame

COMM = MPI.COMM_WORLD
D = 1e-3  # amplitude


def triangle(xc, n, *, uneven=0.0, comm=COMM):
    """The triangle, meshed evenly or not, and its corner C."""
    square = mesh.create_unit_square(comm, n, n, diagonal=mesh.DiagonalType.left)
    half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
    domain = mesh.create_submesh(square, 2, half)[0]
    x = domain.geometry.x
    a = x[:, 0].copy()
    b = x[:, 1].copy()
    bubble = a * b * (1 - a - b)
    side = a * (1 - a - b)
    a += uneven * (3 * bubble * np.sin(9 * a + 4 * b) + 0.5 * side)
    b += uneven * 3 * bubble * np.cos(5 * a - 7 * b)
    yc = xc * np.sqrt((1 - xc) / (1 + xc))
    x[:, 0] = a + xc * b
    x[:, 1] = yc * b
    return domain, yc


def body(xc, n, friction, **kind):
    """The contact problem, its stick and grazing states at positions, and the traction of stick."""
    domain, yc = triangle(xc, n, **kind)
    nu = (1 - xc) / 2
    lmbda, mu = lame(1.0, nu)

    def stick(x):
        return np.array([-(1 - xc) * D * x[1], -lmbda * yc * D * x[1] / (lmbda + 2 * mu)])

    def grazing(x):
        return stick(x) - [[D], [0.0]] * (yc * (1 - x[0]) - (1 - xc) * x[1])

    def pressed(x):
        """The traction of the stick state on AB."""
        return np.outer([mu * (1 - xc) * D, lmbda * yc * D], np.ones(x.shape[1]))

    def on(first, second):
        """Facets of a side: where a linear function with these corner values vanishes."""
        xa, ya = first
        xb, yb = second
        return mesh.locate_entities_boundary(
            domain, 1, lambda x: np.abs((xb - xa) * (x[1] - ya) - (yb - ya) * (x[0] - xa)) < 1e-9
        )

    A = (0.0, 0.0)
    B = (1.0, 0.0)
    C = (xc, yc)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    held = fem.Function(V)
    held.interpolate(stick)
    bc = fem.dirichletbc(held, fem.locate_dofs_topological(V, 1, on(B, C)))
    side = np.sort(on(A, C))
    tags = mesh.meshtags(domain, 1, side, np.ones(len(side), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    sigma = D * np.array(
        [
            [-(lmbda**2) * yc / (lmbda + 2 * mu), -mu * (1 - xc)],
            [-mu * (1 - xc), -lmbda * yc],
        ]
    )
    traction = ufl.dot(ufl.as_matrix(sigma.tolist()), ufl.FacetNormal(domain))
    energy = LinearElastic(lmbda, mu).energy(u) * ufl.dx - ufl.dot(traction, u) * ds
    floor = HalfSpace((0, 0), (0, 1))
    s = ContactSurface(u, on(A, B), obstacle=floor, law=Coulomb(friction))
    return ContactProblem(energy, u, [s], bcs=[bc]), stick, grazing, pressed


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize("xc", [0.5, 0.8, 0.3])
@pytest.mark.parametrize(("n", "uneven"), [(1, 0.0), (3, 0.4), (8, 0.0), (12, 0.4)])
@pytest.mark.verifies(
    "critical friction", reference="paper: Hild (2005), sqrt((1 + xc)/(1 - xc))", aspects=("2D",)
)
def test_hild_2005_has_its_critical_friction(xc, n, uneven):
    """F_c to 1e-10 on any mesh; its slip is the linear one, 1 - x, against +x."""
    problem, *_ = body(xc, n, 1.0, uneven=uneven)
    found = critical_friction(problem)
    assert found.friction == pytest.approx(np.sqrt((1 + xc) / (1 - xc)), rel=1e-10)
    np.testing.assert_allclose(found.slips, 1 - found.positions[:, 0], atol=1e-8)


def distance(problem, state):
    f = fem.Function(problem.V)
    f.interpolate(state)
    n = problem.equations.owned_sizes[0]
    mine = np.abs(problem.u.x.array - f.x.array)[:n].max(initial=0.0)
    return COMM.allreduce(mine, op=MPI.MAX) / D


@pytest.mark.parametrize("xc", [0.5, 0.8])
@pytest.mark.verifies(
    "all solutions",
    "Coulomb",
    reference="paper: Hild (2005), a stick and a grazing state in closed form",
    aspects=("2D",),
)
def test_hild_2005_has_two_solutions_beyond_the_critical_friction(xc):
    """Below F_c only the grazing state; beyond it that and stick, each found from its own start."""
    critical = np.sqrt((1 + xc) / (1 - xc))
    for part, ends in ((0.9, "gg"), (1.1, "gs")):
        problem, stick, grazing, pressed = body(xc, 4, part * critical)
        for start, end in zip((grazing, stick), ends, strict=True):
            problem.u.interpolate(start)
            if start is stick:
                problem.surfaces[0].multiplier.interpolate(pressed)
            problem.solve()
            assert distance(problem, {"g": grazing, "s": stick}[end]) < 1e-7
