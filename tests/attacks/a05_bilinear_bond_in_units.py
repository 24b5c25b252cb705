"""A bilinear bond in series with a soft spring, in units of 1e9 and 1e-9.

The traction rises to s at the opening a and falls to nothing at a + b. With a spring of stiffness
k < s/b the load turns at a + s/k, and turns on at a + b, both where statuses change.
"""

from bodies import free_point, one_point

import ufl
from dolfinx import fem

from dolfinx_contact import (
    BilinearCohesive,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength


def folded(case, force, length):
    s = 2.0 * force
    a = 0.01 * length
    b = 0.02 * length
    k = 40.0 * force / length
    body, energy = one_point(case.comm, [[k / 2, 0.0], [0.0, k / 2]])
    floor = HalfSpace((0, 0), (0, 1))
    law = BilinearCohesive(s, a, b)
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    system = ParametricContact(problem, gamma, driven=[(body.moved, ufl.as_vector((0, gamma)))])
    control = StepControl(initial=0.05, maximum=0.1)
    history = ArcLength(system).run(gamma_range=(0.0, 0.1 * length), control=control)
    case.unpromised(f"not complete: {history.reason}", not history.complete)
    folds = history.folds
    case.equal("folds", [p.gamma for p in folds], [a + s / k, a + b], 1e-6)
    case.true("nonsmooth", all(p.event == "nonsmooth fold" for p in folds))
    table = history.steps[-1].result.tables["contact"]
    case.equal("opening at the end", table.un[free_point(table)], 0.1 * length)


def attack(case):
    folded(case, 1e9, 1.0)
    folded(case, 1e-9, 1e3)


def honest(case):
    folded(case, 1.0, 1.0)
