"""A load that is cubic in the second parameter, and zero where that is 0, 1/2 and 1.

Hild's triangle (lambda = mu = 1, F = 3, one node that moves) under the nodal load (-p, -1) has
one solution for p < 2 and three for 2 < p < 3. With p = 1.5 gamma + 20 m (m - 1/2) (1 - m) there
are three for m = 0.8 and gamma = 1 (p = 2.46), and one for m = 0.2 (0.54). The twin has the load
p = 1.5 gamma + m.
"""

from mpi4py import MPI

import numpy as np

import ufl
from basix.ufl import element
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.analysis import contact_family, count_solutions


def numbers(load, at):
    """Solutions and proofs of small cells about points (m, gamma = 1)."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    domain = mesh.create_mesh(
        MPI.COMM_SELF,
        cells=np.array([[0, 1, 2]]),
        x=corners,
        e=element("Lagrange", "triangle", 1, shape=(2,)),
    )
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    gamma = fem.Constant(domain, 1.0)
    m = fem.Constant(domain, 0.0)
    # A body force f puts f / 6 on the node.
    force = 6 * ufl.as_vector((-load(gamma, m), -1.0 + 0 * m))
    steel = materials.LinearElastic(1.0, 1.0)
    energy = steel.energy(u) * ufl.dx - ufl.dot(force, u) * ufl.dx
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(u, below, obstacle=floor, law=Coulomb(3.0))
    system = ParametricContact(ContactProblem(energy, u, [contact], bcs=[held]), gamma)
    family = contact_family(system, m, mu_range=(0.0, 1.0))
    counts = []
    for value in at:
        chart = count_solutions(
            family,
            mu_range=(value - 1e-3, value + 1e-3),
            gamma_range=(1.0 - 1e-3, 1.0 + 1e-3),
            cells=(1, 1),
            depth=0,
        )
        counts.append([len(c.solutions) for c in chart.cells])
    return counts


def attack(case):
    found = numbers(lambda g, m: 1.5 * g + 20 * m * (m - 0.5) * (1 - m), (0.2, 0.8))
    case.equal("solutions at 0.2 and 0.8", found, [[1], [3]])


def honest(case):
    found = numbers(lambda g, m: 1.5 * g + m, (0.2, 0.8))
    case.equal("solutions at 0.2 and 0.8", found, [[1], [3]])
