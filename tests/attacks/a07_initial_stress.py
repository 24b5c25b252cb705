"""A linear body with initial stress, s grad(u):grad(u) / 2 with s < 0: a quadratic energy.

Its stiffness is indefinite beyond a stress, while the load and all contact points stay as they
are. Held at top and bottom (all stick) it is an eigenproblem, solved in numpy; a Function as the
density, one half a hundred times as heavy, enters the growth.
"""

from mpi4py import MPI

import numpy as np
from a07_column import compared
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.analysis import stability_at_rest


def stressed(comm, stress):
    body = block(comm, (3, 3), (1.0, 1.0), "quadrilateral")
    G = ufl.grad(body.u)
    energy = materials.LinearElastic(1.0, 1.0).energy(body.u) * ufl.dx
    energy += 0.5 * fem.Constant(body.domain, stress) * ufl.inner(G, G) * ufl.dx
    heavy = fem.Function(fem.functionspace(body.domain, ("Discontinuous Lagrange", 0)))
    heavy.interpolate(lambda x: np.where(x[0] < 1 / 3, 100.0, 1.0))
    return body, energy, heavy


def put(case, stress):
    body, energy, heavy = stressed(case.comm, stress)
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.1 + 0 * x[0]]))
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(50.0))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    letters = set(problem.solve().tables["contact"].status)
    case.true(f"all stick: {letters}", letters == {"k"})
    answer = stability_at_rest(problem, density=heavy)
    own, energy, heavy = stressed(MPI.COMM_SELF, stress)
    return compared(case, answer, energy, own, heavy)


def attack(case):
    least = [put(case, stress) for stress in (-0.8, -1.15, 0.5)]
    case.true(f"some leave: {least}", min(least) < 0 < max(least))
