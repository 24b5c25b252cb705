"""Straps across an interface that are slack up to an opening c: an energy with a kink.

E (d - o) = k (o - c) of a column that is lifted by d: k/2 max(o - c, 0)^2 is given as an Interface.
In the twin c is zero, and the interface a spring.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from bodies import block

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, materials
from dolfinx_contact.laws import Interface, Internal


@dataclass(frozen=True)
class Straps(Interface):
    stiffness: Any
    slack: Any
    damage: Any = 0.0
    internal = (Internal("damage", "grows", end=1.0),)

    def energy(self, state):
        pulled = ufl.max_value(state.opening - self.slack, 0.0)
        return (1 - state["damage"]) * self.stiffness / 2 * pulled**2

    def dissipation(self, rates, state):
        return 1e6 * rates["damage"]


def openings(case, slack):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    body.moved.interpolate(lambda x: np.stack([0 * x[0], 0.01 + 0 * x[0]]))
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Straps(3000.0, slack))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    return problem.solve().tables["contact"].un


def attack(case):
    found = openings(case, 0.002)
    case.equal("opening", found, np.full(3, (10.0 + 6.0) / 4000.0), 1e-7)
    found = openings(case, 0.02)
    case.equal("opening of slack straps", found, np.full(3, 0.01), 1e-7)


def honest(case):
    case.equal("opening", openings(case, 0.0), np.full(3, 10.0 / 4000.0), 1e-7)
