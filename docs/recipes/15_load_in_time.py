# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I apply a load that varies in time?
#
# `QuasiStatic` takes a function of the time that sets Constants and Functions, and goes from step
# to step: friction acts against the slip since the step before. Times of yours are hit exactly.
# Here the block is pressed, then moved to and fro.

import numpy as np
from common import Block

from dolfinx_contact.evolution import QuasiStatic

block = Block()


def load(t):
    block.moved.value[:] = 0.004 * np.sin(2 * np.pi * t), -0.01


problem = block.problem()
load(0.0)
problem.solve()
history = QuasiStatic(problem, load).run(np.linspace(0.0, 1.0, 13))
for step in history.steps:
    print(f"t = {step.time:.3f} {step.status} shear {step.result.resultants['contact'][0]:+.4f}")
print(history.energies)
assert history.complete
assert history.energies.dissipated > 0
