"""A strip on its side face that softens beyond a way c: two states of one body, one kink apart.

A column hangs over a floor that it does not reach, pulled down by q at its lower face, on which
-k/2 max(-u_y - c, 0)^2 softens with k > E. At rest b = q / E < c; and beyond c,
b = (k c - q) / (k - E) is the other equilibrium. Neither may be called the only one. In the twin
k = 0, and the state is proved.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import find_solutions


def solved(case, k):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    gamma = fem.Constant(body.domain, 1.0)
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[1], 1e-6), 1.0, 0.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    energy = steel.energy(body.u) * ufl.dx + gamma * body.u[1] * lower * ufl.ds
    if k:
        energy -= k / 2 * ufl.max_value(-body.u[1] - 0.002, 0.0) ** 2 * lower * ufl.ds
    floor = HalfSpace(point=(0, -0.05), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    result = problem.solve()
    system = ParametricContact(problem, gamma)
    start = system.create_vector()
    problem.write(start)
    return result, find_solutions(system, [start], 1.0, lengths=(0.5,), max_iterations=20)


def attack(case):
    result, found = solved(case, 2000.0)
    case.equal("way", 0.05 - result.tables["contact"].un, np.full(3, 0.001), 1e-6)
    case.true("not called the only one", result.unique != "proved")
    case.true("not called complete", not found.complete or len(found.found) >= 2)


def honest(case):
    result, found = solved(case, 0.0)
    case.equal("way", 0.05 - result.tables["contact"].un, np.full(3, 0.001), 1e-6)
    case.true("the only one", result.unique == "proved")
    case.true("complete", found.complete and len(found.found) == 1)
