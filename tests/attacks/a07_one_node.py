"""A triangle with one node on the floor that slips, by a closed form.

S_tt - F S_nt is the stiffness against slip to the left, where rt = F rn; beyond the critical F it
is negative, and the node leaves with lambda^2 = (F S_nt - S_tt) / m, m = rho A / 6 the mass of the
node. Below it is stable. The state is sliding without having slipped back: F is reached by load.
"""

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.analysis import stability_at_rest


def attack(case):
    S_tt = 173.0  # (lambda + 3 mu) / 2
    S_nt = 91.0  # (lambda + mu) / 2
    rho = 4.0
    # A triangle is a mesh of its own on every rank.
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    domain = mesh.create_mesh(MPI.COMM_SELF, cells=np.array([[0, 1, 2]]), x=corners, e=element)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    for F in (1.0, 1.8, 2.0, 3.0):
        u = fem.Function(V)
        load = fem.Constant(domain, (0.0, 0.0))
        energy = materials.LinearElastic(100.0, 82.0).energy(u) * ufl.dx
        energy -= ufl.dot(load, u) * ufl.dx
        held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(F))
        problem = ContactProblem(energy, u, [contact], bcs=[held])
        # Slip by -0.01 with pressure 1: S a = r + p, p = load * area / 3.
        slip = -0.01
        p = np.array([S_tt * slip - F * 3.0, S_nt * slip - 3.0])
        load.value[:] = 6 * p
        at = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0] + x[1], 0))
        u.x.array[2 * at[0]] = slip
        table = problem.solve().tables["contact"]
        letter = table.status.replace("d", "")
        answer = stability_at_rest(problem, density=rho)
        found = table.ut[0, 0]
        if letter == "-":
            case.equal("slip", found, slip)
            leaves = F * S_nt - S_tt
            if leaves > 0:
                case.true(f"{F}: unstable, not {answer.label}", answer.label == "unstable")
                case.equal("growth", answer.growth, np.sqrt(leaves / (rho * 0.5 / 6)))
            else:
                case.true(f"{F}: stable, not {answer.label}", answer.label == "stable")
        else:
            # Beyond the critical friction there are others: stuck, whose stiffness is definite.
            case.true(f"{letter} is stable, not {answer.label}", answer.label == "stable")
