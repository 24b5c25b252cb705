# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I follow a history through a jump, such as a bond that snaps?
#
# By default a history takes exactly the given times. If the state may jump within a step, one
# warning names the step. `locate_jumps=True` then searches such steps by halving them, down to
# `shortest`. With `at_jump="jump"` the history continues from the solution beyond the jump;
# otherwise it ends before the jump with the reason. Inserted steps are marked. The energy that the
# jump releases is the residue of its step.

import numpy as np
from common import Block

from dolfinx_contact import RCCM
from dolfinx_contact.evolution import QuasiStatic

block = Block(n=2)
problem = block.problem(RCCM(1000.0, 1000.0, 0.1))


def load(t):
    block.moved.value[:] = 0.0, 0.03 * t


evolution = QuasiStatic(problem, load)
history = evolution.run(np.linspace(0.0, 1.0, 11), locate_jumps=True, at_jump="jump", shortest=1e-3)
for step in history.steps:
    opening = step.result.tables["contact"].un.max()
    marks = " jump" * step.jump + " inserted" * step.inserted
    print(
        f"time {step.time:.4f}  opening {opening:.5f}  residue {step.energies.residue:.2e}{marks}"
    )
assert any(step.jump for step in history.steps)
