# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I model friction that weakens with the sliding speed?
#
# This is the steady state of rate and state friction. Write a `FrictionLaw` whose `bound`, the
# largest shear at the pressure p, depends on the speed v: F(v) = k + (s - k) / (1 + v / v0), with
# the static coefficient s = 0.3 and the kinetic coefficient k = 0.27. The speed is the slip in the
# step over the length of the step.
#
# The law becomes steeper as steps shrink: in a step of length h the coefficient changes by
# (s - k) / (v0 h) per unit of slip. Below a length of about (s - k) p / (v0 K), with the stiffness
# K of the body per area, a step has several solutions. Below twice this length, an error of one
# step is multiplied in the next by a factor below -1, and the shear oscillates from step to step.
# The history takes exactly the given times.
# In a motion (`NSCD`), such a law requires `mass="lumped"`, since contact nodes without mass have
# several solutions.

from dataclasses import dataclass
from typing import Any

import numpy as np
from common import Block

import ufl

from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import FrictionLaw


@dataclass(frozen=True)
class VelocityWeakening(FrictionLaw):
    static: Any  # numbers, Constants, Functions or UFL expressions
    kinetic: Any
    speed: Any

    def bound(self, a, p):
        moving = ufl.gt(a.step, 0.0)
        v = ufl.conditional(moving, (a.slid - a.slid_before) / a.step, 0.0)
        return (self.kinetic + (self.static - self.kinetic) / (1 + v / self.speed)) * p


def load(t):
    block.moved.value[:] = 0.1 * t, -0.01 * min(10 * t, 1.0)


block = Block()
evolution = QuasiStatic(block.problem(VelocityWeakening(0.3, 0.27, 0.02)), load)
history = evolution.run(np.linspace(0.0, 1.0, 11))
table = history.steps[-1].result.tables["contact"]
coefficient = abs(table.along(table.rt)).sum() / table.rn.sum()
print("coefficient", coefficient.round(4))
assert abs(coefficient - (0.27 + 0.03 / (1 + 0.1 / 0.02))) < 1e-4
