# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I let friction depend on the sliding speed or the distance slipped?
#
# Write a `FrictionLaw` and its `bound`, the largest shear at the pressure p, in UFL. At a point
# `a.slid` is the distance slipped and `a.step` the length of the time step; the quotient below is
# the sliding velocity. The static law has no time: define its value by comparing `a.step` with
# 0. A history remembers the distance. Friction that weakens with the speed has
# {doc}`a recipe of its own <41_velocity_weakening>`.

from common import Block

import ufl

from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import FrictionLaw


class OfSlipAndSpeed(FrictionLaw):
    """Friction that weakens with the distance slipped and strengthens with the speed."""

    def bound(self, a, p):
        speed = ufl.conditional(ufl.gt(a.step, 0.0), (a.slid - a.slid_before) / a.step, 0.0)
        return (0.2 + 0.1 * ufl.exp(-a.slid / 0.002) + 0.05 * speed) * p


def load(t):
    block.moved.value[0] = 0.01 * t


block = Block()
history = QuasiStatic(block.problem(OfSlipAndSpeed()), load).run([0.0, 0.5, 1.0])
table = history.steps[-1].result.tables["contact"]
print("slipped", table.slid.round(5))
print("coefficient", (table.bound / table.rn).round(4))
assert table.slid.max() > 0
assert (abs(table.along(table.rt)) <= table.bound + 1e-9).all()
