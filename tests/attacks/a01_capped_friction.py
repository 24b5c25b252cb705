"""Orowan's friction, min(F p, g): a bound with a kink in the pressure, in a law of one's own.

Of points that slip the shear is the bound, point by point, and no point is beyond it; the twin has
a cap that no pressure reaches, and the answer of Coulomb's law.
"""

from dataclasses import dataclass
from typing import Any

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
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.laws import FrictionLaw


@dataclass(frozen=True)
class Orowan(FrictionLaw):
    friction: Any
    cap: Any

    def bound(self, a, p):
        return ufl.min_value(self.friction * p, self.cap)


def system_of(case, law):
    body = block(case.comm, (4, 2), size=(1.0, 0.5))
    gamma = fem.Constant(body.domain, 1.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.3)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    way = ufl.as_vector((0.02 * gamma, -0.005 * (1 + gamma)))
    return ParametricContact(problem, gamma, driven=[(body.moved, way)])


def checked(case, table, friction, cap):
    shear = np.abs(table.rt[:, 0]) / table.area
    bound = np.minimum(friction * table.rn / table.area, cap)
    case.true("within the bound", np.all(shear <= bound * (1 + 1e-6) + 1e-9))
    slips = np.isin(table.letters, ["+", "-"])
    case.true("points slip", slips.sum() > 2)
    case.equal("shear of what slips", shear[slips], bound[slips], 1e-6)


def attack(case):
    system = system_of(case, Orowan(0.5, 6.0))
    system.set_parameter(1.0)
    checked(case, system.problem.solve().tables["contact"], 0.5, 6.0)
    start = system.create_vector()
    system.problem.write(start)
    found = find_solutions(system, [start], 1.5, lengths=(0.5,), max_iterations=20)
    for point in found.points(system, found.found):
        checked(case, system.result_at(point).tables["contact"], 0.5, 6.0)


def honest(case):
    capped = system_of(case, Orowan(0.5, 1e6))
    plain = system_of(case, Coulomb(0.5))
    for system in (capped, plain):
        system.set_parameter(1.0)
    one, other = (s.problem.solve().tables["contact"] for s in (capped, plain))
    case.equal("forces", one.force, other.force, 1e-6)
