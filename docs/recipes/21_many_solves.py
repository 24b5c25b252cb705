# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I solve many times in a loop without growing memory?
#
# Make the problem once and change Constants and Functions in the loop: then no memory leaks. Keep
# numbers of a result, not the result. Only where each solve needs a mesh of its own, on several
# ranks, call `problem.destroy()`.

import resource

import numpy as np
from common import Block

block = Block(n=16)
problem = block.problem()
shear = []
used = []
for way in np.linspace(0.0, 0.01, 60):
    block.moved.value[0] = way
    shear.append(problem.solve().resultants["contact"][0])
    used.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
print(f"{len(shear)} solves, memory {used[19]:.0f} MB after 20 and {used[-1]:.0f} MB after all")
assert used[-1] - used[19] < 20.0
