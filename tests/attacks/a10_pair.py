"""Two bodies on each other: slips are of the upper from the lower, which gives way too.

numpy takes both stiffnesses: with the slip v = u_1 - u_2 of matching nodes, forces r on the upper
and -r on the lower, the compliances add: S = (S_1^-1 + S_2^-1)^-1. With a lower body a million
times as stiff it is that of the upper on a rigid floor.
"""

from mpi4py import MPI

import numpy as np
from a10_all_listed import compare, sorted_by_slips
from bodies import condensed, dense, nodes_of, two_blocks

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials
from dolfinx_contact.analysis import critical_friction


def lean(domain):
    x = domain.geometry.x
    x[:, 0] += 1.2 * np.where(x[:, 1] > 0, x[:, 1], 0)


def attack(case):
    for stiffness in (2.0, 1e6):
        both = two_blocks(case.comm, (3, 3), (3, 2))
        lean(both.domain)
        dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
        upper = materials.LinearElastic(1.0, 1.0)
        lower = materials.LinearElastic(stiffness, stiffness)
        energy = upper.energy(both.u) * dx(1) + lower.energy(both.u) * dx(2)
        pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(0.3))
        problem = ContactProblem(energy, both.u, [pair], bcs=both.bcs)
        found = critical_friction(problem)
        S_1 = one(upper, (3, 3), 0.0, 1.0, 1.0)
        S_2 = one(lower, (3, 2), -0.5, 0.0, -0.5)
        S = np.linalg.inv(np.linalg.inv(S_1) + np.linalg.inv(S_2))
        m = len(S) // 2
        compare(case, found, sorted_by_slips(S[:m, :m], S[m:, :m]))


def one(material, cells, bottom, top, held):
    """Stiffness of one body at its nodes on y = 0, held at y = ``held``."""
    domain = mesh.create_rectangle(
        MPI.COMM_SELF, [[0, bottom], [1, top]], cells, mesh.CellType.quadrilateral
    )
    lean(domain)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    trial = ufl.TrialFunction(V)
    test = ufl.TestFunction(V)
    energy = material.energy(u) * ufl.dx
    K = dense(ufl.derivative(ufl.derivative(energy, u, test), u, trial))
    face = nodes_of(V, lambda y: np.isclose(y[:, 1], 0))
    hold = nodes_of(V, lambda y: np.isclose(y[:, 1], held))
    kept = np.concatenate([2 * face, 2 * face + 1])
    return condensed(K, kept, np.concatenate([2 * hold, 2 * hold + 1]))
