"""A path by arc length under a top that goes aside and comes back with 1 - |gamma - 1|.

Friction remembers: at gamma = 1.6 the state is not that of gamma = 0.4. The right one comes from a
history whose ``load`` gives the top by numbers, and which knows of no gamma. In the twin
the top goes aside with gamma and does not come back.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength, QuasiStatic


def problem_of(case):
    body = block(case.comm, (3, 2), size=(1.0, 0.5), cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    return body, problem


def put(body, aside):
    body.moved.interpolate(lambda x: np.stack([aside + 0 * x[0], -0.01 + 0 * x[0]]))


def compared(case, symbolic, number):
    body, problem = problem_of(case)
    put(body, 0.0)
    problem.solve()
    history = QuasiStatic(problem, lambda t: put(body, 0.02 * number(t))).run(
        [0.0, 0.4, 0.8, 1.0, 1.2, 1.4, 1.6]
    )
    expected = history.steps[-1].result.resultants["contact"]
    body, problem = problem_of(case)
    gamma = fem.Constant(body.domain, 0.0)
    way = ufl.as_vector((0.02 * symbolic(gamma), -0.01 + 0 * gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    system.set_parameter(0.0)
    problem.solve()
    control = StepControl(initial=0.05, maximum=0.2, minimum=1e-4)
    path = ArcLength(system).run(gamma_range=(0.0, 1.6), control=control, max_steps=200)
    case.unpromised(path.reason, not path.complete and "kinks or jumps in gamma" in path.reason)
    case.equal("force", path.steps[-1].result.resultants["contact"], expected, 1e-5)


def attack(case):
    compared(case, lambda g: 1 - abs(g - 1), lambda t: 1 - abs(t - 1))


def honest(case):
    compared(case, lambda g: g, lambda t: t)
