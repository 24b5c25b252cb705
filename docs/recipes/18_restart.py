# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I restart after a kill, on another number of ranks?
#
# Give the run a record: each accepted step is written to disk before the next one is computed.
# After the simulation was killed, a script that creates the same problem, on more or fewer cores,
# opens the record with `resume=True` and continues the run with the same steps. Branches have
# `BranchRecord`, paths `PathRecord`. Here an exception represents the kill.

import contextlib

import numpy as np
from common import Block

from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.records import EvolutionRecord, read_journal


def killed(step):
    if step.number == 3:
        raise KeyboardInterrupt


def load(t):
    block.moved.value[0] = 0.004 + 0.004 * t


block = Block()
problem = block.problem()
problem.solve()
evolution = QuasiStatic(problem, load)
with contextlib.suppress(KeyboardInterrupt), EvolutionRecord("output/run", evolution) as record:
    evolution.run(np.linspace(0.0, 1.0, 6), record=record, observer=killed)
with EvolutionRecord("output/run", evolution, resume=True) as record:
    record.go_on()
print([row["time"] for row in read_journal("output/run").rows()])
assert len(read_journal("output/run").rows()) == 5
