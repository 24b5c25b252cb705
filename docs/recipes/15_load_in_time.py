# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I apply a load that varies in time?
#
# A time-dependent load is a function of the time that sets Constants and Functions. `QuasiStatic`
# calls it at the given times; in each step friction opposes the slip since the previous step.
# `io.EvolutionSeries` writes fields and the table `steps.csv` of the start and the steps during
# the run. Here the loading is cyclic: the block is pressed and then moved to and fro. `rows` has
# the loop of force over displacement: `support_0_x` is the reaction of the first Dirichlet
# condition, and `support_0_ux` its displacement.

import numpy as np
from common import Block

from dolfinx_contact import io
from dolfinx_contact.evolution import QuasiStatic

block = Block()


def load(t):
    block.moved.value[:] = 0.004 * np.sin(2 * np.pi * t), -0.01


problem = block.problem()
load(0.0)
problem.solve()
with io.EvolutionSeries("output/to_and_fro", problem) as series:
    history = QuasiStatic(problem, load).run(np.linspace(0.0, 1.0, 13), observer=series)
for row in history.rows():
    print(row["support_0_ux"], row["support_0_x"], row["dissipated"])
assert history.energies.dissipated > 0
