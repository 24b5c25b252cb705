"""Thermal strains that set in at a temperature, alpha max(gamma - 1, 0), and an affine twin.

A column of modulus E between a fixed top and a floor carries E alpha max(gamma - 1, 0); the
parameter is followed and all solutions are looked for, beyond 1 and before.
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
)
from dolfinx_contact.continuation import find_solutions, follow


def compared(case, strain, number):
    body = block(case.comm, (2, 2))
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.001 + 0 * x[0]]))
    gamma = fem.Constant(body.domain, 0.0)
    eps = ufl.sym(ufl.grad(body.u)) - 0.01 * strain(gamma) * ufl.Identity(2)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    across, _ = body.V.sub(0).collapse()
    everything = fem.locate_dofs_geometrical((body.V.sub(0), across), lambda x: x[0] > -1.0)
    held = fem.dirichletbc(fem.Function(across), everything, body.V.sub(0))
    problem = ContactProblem(
        500.0 * ufl.inner(eps, eps) * ufl.dx, body.u, [contact], bcs=[*body.bcs, held]
    )
    system = ParametricContact(problem, gamma)
    problem.solve()
    start = system.create_vector()
    problem.write(start)
    for at in (0.5, 1.8):
        found = find_solutions(system, [start], at, lengths=(0.5,), max_iterations=20)
        forces = [
            system.result_at(p).resultants["contact"][1] for p in found.points(system, found.found)
        ]
        case.equal(f"found at {at}", forces, [1.0 + 10.0 * number(at)])
    system.set_parameter(0.0)
    last = follow(system, start, 0.0, gamma_range=(0.0, 1.8)).points[-1]
    case.equal("where the branch ends", last.gamma, 1.8)
    end = system.result_at(last).resultants["contact"][1]
    case.equal("followed", end, 1.0 + 10.0 * number(1.8))


def attack(case):
    compared(case, lambda g: ufl.max_value(g - 1, 0.0), lambda g: max(g - 1, 0.0))


def honest(case):
    compared(case, lambda g: g, lambda g: g)
