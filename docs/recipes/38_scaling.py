# SPDX-License-Identifier: LGPL-3.0-or-later
# # How much memory and time does a mesh need, and how does it scale?
#
# The package estimates before a solve how many dofs a laptop can solve: a log at the level INFO
# shows unknowns, solver, expected time and RAM. For strong scaling, run one mesh with
# `mpirun -n 1, 2, 4 ...`; for weak scaling, let the mesh grow with the ranks. Time the second
# solve, since the first one compiles. Direct solvers need memory like n^(4/3) in 3D; multigrid is
# linear: a frictional solve costs one and a half to two and a half of the fastest elastic ones
# ([numbers](../guide/cost.md)).

import time

from common import Block

for n in (6, 9, 12):
    block = Block(n=n, cell="hexahedron")
    problem = block.problem(petsc_options={"linear_solver": "amg"})
    problem.solve()
    block.moved.value[0] *= 1.1
    start = time.perf_counter()
    result = problem.solve()
    seconds = time.perf_counter() - start
    print(f"{problem.comm.size} ranks, {result.dofs} unknowns: {seconds:.2f} s, {result.reason}")
assert result.iterations < 20
