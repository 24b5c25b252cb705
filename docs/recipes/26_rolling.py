# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I model rolling?
#
# Prescribe the motion of the hub, a displacement of the radius times the angle and a rotation, as
# Dirichlet data of a body with large deformations, and run a history. Points of the tyre come into
# contact at the front, stick to the road, and leave it at the back. On a plane, any rotation is
# exact. Here the wheel rolls by half a radian.

import numpy as np
from common import Wheel

from dolfinx_contact.evolution import QuasiStatic

wheel = Wheel(size=0.05)


def load(t):
    wheel.put(down=0.05 * min(10 * t, 1.0), forward=0.5 * t, angle=0.5 * t)


history = QuasiStatic(wheel.problem, load).run(np.linspace(0.0, 1.0, 21))
for step in history.steps[1::6]:
    table = step.result.tables["contact"]
    where = np.average((table.x + table.ut)[:, 0], weights=table.rn)
    print(f"forward {0.5 * step.time:.3f}, contact around {where:.3f}, {step.result.counts}")
assert history.complete
assert abs(where - 0.5 * step.time) < 0.05
