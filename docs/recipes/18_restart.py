# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I restart after a kill, on another number of ranks?
#
# Give the run a record: each accepted step is written to disk before the next one is computed.
# After the simulation was killed, run the same script again, on more or fewer cores. With
# `resume="if_exists"`, the record of an earlier run is continued with the same steps. `go_on`
# returns the new steps only; `read_journal` has all of them. Branches have `BranchRecord`, paths
# `PathRecord`. Here an exception represents the kill, and the second pass the second run.
#
# A run that has ended is not continued. To extend it, call `record.go_on()`, which returns to the
# last state, and then `sliding.run([1.0, 1.2], record=record)`. With `surface_displacement=True`
# a record stores the deformed body, which `explorer` shows.

from contextlib import suppress

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
sliding = QuasiStatic(block.problem(), load)
sliding.problem.solve()
for _ in range(2):
    with suppress(KeyboardInterrupt), EvolutionRecord("run", sliding, resume="if_exists") as record:
        if record.journal.is_empty:
            sliding.run(np.linspace(0.0, 1.0, 6), record=record, observer=killed)
        else:
            print(len(record.go_on().steps), "new steps")
assert [row["step"] for row in read_journal("run").rows()] == [0, 1, 2, 3, 4, 5]
