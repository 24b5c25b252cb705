"""Hild's triangle with 64 contact nodes against independent codes, and its way to zero load."""

from mpi4py import MPI

import numpy as np
import pytest

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.continuation import follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.parametric import ParametricContact

COMM = MPI.COMM_WORLD


def linear_triangle(n, friction):
    """The triangle A, B, C cut into n * n congruent triangles, traction -gamma (26, 7.5) on AC."""
    place = {}
    for j in range(n + 1):
        for i in range(n + 1 - j):
            place[i, j] = len(place)
    points = np.array([(i / n, j / n) for i, j in place])
    cells = [
        cell
        for j in range(n)
        for i in range(n - j)
        for cell in (
            [(i, j), (i + 1, j), (i, j + 1)],
            [(i + 1, j), (i + 1, j + 1), (i, j + 1)],
        )[: 2 if i + j < n - 1 else 1]
    ]
    numbers = np.array([[place[k] for k in cell] for cell in cells], dtype=np.int64)
    if COMM.rank > 0:
        points, numbers = points[:0], numbers[:0]
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    domain = mesh.create_mesh(COMM, cells=numbers, x=points, e=ufl.Mesh(element))

    def edge(where):
        return mesh.locate_entities_boundary(domain, 1, where)

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, gamma = fem.Function(V), fem.Constant(domain, -1.0)
    slope = edge(lambda x: np.isclose(x[0] + x[1], 1.0))
    side = np.sort(edge(lambda x: np.isclose(x[0], 0.0)))
    tags = mesh.meshtags(domain, 1, side, np.ones(len(side), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx
    energy += gamma * ufl.dot(ufl.as_vector([26.0, 7.5]), u) * ds
    clamped = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    surface = ContactSurface(
        u,
        edge(lambda x: np.isclose(x[1], 0.0)),
        obstacle=HalfSpace((0, 0), (0, 1)),
        law=Coulomb(friction),
    )
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=[clamped]), gamma)


def test_seed_example_at_its_start():
    """n = 64, F = 1.7, gamma = -1: one solution, known from two codes (GetFEM and numpy)."""
    system = linear_triangle(64, 1.7)
    table = system.problem.solve().tables["contact"]
    assert table.status == 13 * "o" + 18 * "+" + 33 * "k" + "d"
    np.testing.assert_allclose(table.ut[0, 0], 0.0357436, atol=1e-7)
    np.testing.assert_allclose(table.un[0], 0.0198213, atol=1e-7)
    # The clamped node belongs to the support.
    np.testing.assert_allclose(table.rn[:-1].sum(), 3.319526, atol=1e-6)
    np.testing.assert_allclose(table.rt[:-1, 0].sum(), -3.956634, atol=1e-6)


def start_of(system):
    """The solution at gamma = -1 as a vector."""
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    return x


@pytest.mark.parametrize("route", ["pivoting", "steps"])
def test_all_rays_of_the_degenerate_point(route):
    """n = 64, F = 1.7: one ray comes to (0, 0), where all nodes are at a kink, three leave it."""
    system = linear_triangle(64, 1.7)
    branch = follow(system, start_of(system), -1.0, gamma_range=(-1.0, 1.0), route=route)
    (point,) = branch.special
    assert point.kind == "bifurcation"
    assert point.gamma == pytest.approx(0.0, abs=1e-10)
    found = {system.letters(branch.points[-1].piece)}
    found |= {system.letters(ray.piece) for ray in point.others}
    assert found == {64 * "o" + "d", "k" + 63 * "o" + "d", "-" + 63 * "o" + "d"}
