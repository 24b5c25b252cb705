"""Quadratic contact next to clamped edges: the multiplier of a fixed vertex acts on its facets."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


def clamped(dim, cells, sides=(0.0,), friction=0.3, length=2.0):
    """A P2 block on a floor, loaded by a Constant gamma and clamped at sides x = constant."""
    if dim == 2:
        domain = mesh.create_rectangle(COMM, [(0, 0), (length, 1)], cells)
    else:
        domain = mesh.create_box(COMM, [(0, 0, 0), (length, 1, 1)], cells)
    V = fem.functionspace(domain, ("Lagrange", 2, (dim,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 1.0)
    pull = np.zeros(dim)
    pull[[0, -1]] = -20.0, -50.0
    face = facets(domain, dim - 1, 0.0)
    surface = ContactSurface(
        u, face, obstacle=HalfSpace(np.zeros(dim), np.eye(dim)[-1]), law=Coulomb(friction)
    )
    fixed = np.unique(np.concatenate([facets(domain, 0, x) for x in sides]))
    dofs = fem.locate_dofs_topological(V, dim - 1, fixed)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    energy -= gamma * ufl.inner(fem.Constant(domain, pull), u) * ufl.dx
    bcs = [fem.dirichletbc(np.zeros(dim), dofs, V)]
    return ContactProblem(energy, u, [surface], bcs=bcs), gamma, surface


@pytest.mark.ranks(2, 3)
@pytest.mark.verifies(
    "mixed contact",
    "certificates",
    reference="itself: Newton's method",
    aspects=("2D", "3D", "proofs"),
)
@pytest.mark.parametrize(("dim", "cells"), [(2, (4, 2)), (3, (2, 1, 1))])
def test_proved_solution_next_to_a_clamped_edge_is_that_of_newton(dim, cells):
    problem, gamma, surface = clamped(dim, cells)
    result = problem.solve()
    force = result.resultants["contact"]
    assert result.kkt_violation < 1e-12
    assert np.all(problem.reduced().friction == 0.3)
    system = ParametricContact(problem, gamma)
    solutions = find_solutions(system, [system.create_vector()], 1.0)
    assert solutions.complete
    (solution,) = solutions.found
    problem.read(solution.x)
    np.testing.assert_allclose(problem.table(surface).force.sum(axis=0), force, rtol=1e-9)


@pytest.mark.parametrize(("dim", "cells"), [(2, (1, 2)), (3, (1, 4, 2))])
def test_a_face_one_facet_wide_between_clamped_edges_is_refused(dim, cells):
    with pytest.raises(ValueError, match=r"nodes that can move, but .* refine the face"):
        clamped(dim, cells, sides=(0.0, 1.0), length=1.0)
