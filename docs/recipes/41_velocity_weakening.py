# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I model friction that weakens with the sliding speed?
#
# Write a `FrictionLaw` whose `bound`, the largest shear at the pressure p, depends on the speed v:
# F(v) = k + (s - k) / (1 + v / v0), with the static coefficient s and the kinetic coefficient k.
# The speed is the slip in the step over the length of the step.
#
# The law becomes steeper as steps shrink: in a step of length h the coefficient changes by
# (s - k) / (v0 h) per unit of slip. Below a length of about (s - k) p / (v0 K), with the stiffness
# K of the body per area, a step has several solutions. The history takes exactly the given times.

import numpy as np
from common import Block

import ufl

from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import FrictionLaw

S, K, V0 = 0.3, 0.27, 0.02


class VelocityWeakening(FrictionLaw):
    def bound(self, a, p):
        slip = a.slid - a.slid_before
        v = ufl.conditional(ufl.gt(a.step, 0.0), slip / a.step, 0.0)
        return (K + (S - K) / (1 + v / V0)) * p


def load(t):
    block.moved.value[:] = 0.1 * t, -0.01


block = Block()
problem = block.problem(VelocityWeakening())
load(0.0)
problem.solve()
evolution = QuasiStatic(problem, load)
history = evolution.run(np.linspace(0.0, 1.0, 11))
table = history.steps[-1].result.tables["contact"]
closed = table.rn > 0.0
coefficient = np.abs(table.along(table.rt))[closed] / table.rn[closed]
print("coefficient", coefficient.round(4))
assert np.allclose(coefficient, K + (S - K) / (1 + 0.1 / V0), atol=1e-4)
