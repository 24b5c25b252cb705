"""A glued block on an uneven mesh, its top lifted askew, with two longest steps.

Whether a path claims to be complete must not depend on how long its steps may be: its folds and its
end are the same then. The end is checked by itself: a static solve from the bonds that are left.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength


def attack(case):
    found = []
    for maximum in (0.02, 0.06):
        body = block(case.comm, (3, 2), (1.0, 0.5), cell="quadrilateral")
        x = body.domain.geometry.x
        inner = x[:, 1] < 0.49
        middle = inner & (x[:, 0] > 0.01) & (x[:, 0] < 0.99)
        x[middle, 0] += 0.2 / 3 * np.sin(7 * x[middle, 0] + 3 * x[middle, 1])
        x[inner & (x[:, 1] > 0.01), 1] += 0.03
        steel = materials.LinearElastic.from_young(30.0, 0.3)
        floor = HalfSpace((0, 0), (0, 1))
        law = RCCM(100.0, 0.0, 0.01)
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
        energy = steel.energy(body.u) * ufl.dx
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        gamma = fem.Constant(body.domain, 0.0)
        X = ufl.SpatialCoordinate(body.domain)
        driven = [(body.moved, ufl.as_vector((0, gamma * (1 + 0.6 * X[0]))))]
        path = ArcLength(ParametricContact(problem, gamma, driven=driven))
        history = path.run(
            gamma_range=(0.0, 0.3), control=StepControl(maximum=maximum, initial=maximum)
        )
        case.unpromised(f"not complete: {history.reason}", not history.complete)
        ends = history.steps[-1].result.tables["contact"].un
        found.append((np.array([p.gamma for p in history.folds]), ends, history.steps[-1].gamma))
    case.equal("number of folds", len(found[1][0]), len(found[0][0]))
    case.equal("folds", found[1][0], found[0][0], 1e-4)
    case.equal("gaps at the end", found[1][1], found[0][1], 1e-4)
    case.equal("gamma", [f[2] for f in found], [0.3, 0.3])
