"""Friction that falls with the distance slipped, on a spring softer or stiffer than its fall.

The shear follows N (mu_k + (mu_s - mu_k) exp(-s/d)) with k (U - s) equal to it; where k is below
N (mu_s - mu_k)/d the load turns back at slip's begin, U = N mu_s/k, and the point jumps to another
root. Where k is above, there is no jump, and the root is the only one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from bodies import free_point, moves, one_point

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace
from dolfinx_contact.evolution import NoContinuation, QuasiStatic
from dolfinx_contact.laws import FrictionLaw

MU_S = 0.6
MU_K = 0.2
D = 0.1


@dataclass(frozen=True)
class Weakening(FrictionLaw):
    """From MU_S to MU_K."""

    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a, p):
        fade = ufl.exp(-a.slid / self.distance)
        return (self.kinetic + (self.static - self.kinetic) * fade) * p


def weakened(case, k, times, at_jump):
    body, energy = one_point(case.comm, [[k, 0.0], [0.0, 1.0]])
    floor = HalfSpace((0, 0), (0, 1))
    law = Weakening(MU_S, MU_K, D)
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    moves(body, 0.0, -1.0)
    problem.solve()
    return QuasiStatic(problem, lambda t: moves(body, t, -1.0)).run(times, at_jump=at_jump)


def root(k, U):
    """The first slip at which the spring has no more than friction."""
    slips = np.linspace(0, U, 200001)
    left = k * (U - slips) - (MU_K + (MU_S - MU_K) * np.exp(-slips / D))
    return slips[np.argmax(left <= 0)]


def attack(case):
    k = 1.0
    begins = 0.6
    try:
        history = weakened(case, k, [0.0, 0.2, 0.4, 0.55, 0.8, 1.0], "jump")
    except NoContinuation as error:
        history = error.history
        case.unpromised("not solved", "was not solved" in str(error))
        case.true("no false proof", "no solution continues" not in str(error))
    case.equal("end", history.time, 1.0)
    case.equal("jumps", sum(s.jump for s in history.steps), 1)
    for step in history.steps:
        table = step.result.tables["contact"]
        slip = root(k, step.time) if step.time > begins else 0.0
        case.equal(f"slip at {step.time}", table.ut[free_point(table), 0], slip, 1e-3)
        if step.jump:
            case.equal("time of the jump", step.time, begins, 1e-3)
    try:
        weakened(case, k, [0.0, 0.3, 0.9], "raise")
    except NoContinuation as error:
        case.equal("ends", error.history.time, begins, 1e-4)
    else:
        case.true("raises", False)


def honest(case):
    k = 10.0
    history = weakened(case, k, [0.0, 0.04, 0.08, 0.2, 0.4], "raise")
    for step in history.steps:
        table = step.result.tables["contact"]
        slip = root(k, step.time)
        case.equal(f"slip at {step.time}", table.ut[free_point(table), 0], slip, 1e-4)
