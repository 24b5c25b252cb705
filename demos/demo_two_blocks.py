# SPDX-License-Identifier: LGPL-3.0-or-later
# # Two elastic blocks: pressed, sheared to and fro, and lifted
#
# This demo illustrates how to:
#
# - name the sides of two bodies of different materials (`meshing.name_groups`), put the bodies into
#   one mesh (`join`) and let them touch (`ContactPair`), with matching or other nodes;
# - run a history (`QuasiStatic`) in which friction opposes the slip of each step;
# - compare the static law with the law of the history.
#
# A unit square lies on a block of half its height, which is clamped below; plane strain. The top of
# the square is pressed down, moved to the right and to the left, and lifted. In a static solve,
# friction opposes the total slip $u_t$. In a history it opposes the increment of the slip:
#
# $$r_t = -F r_n \frac{\Delta u_t}{|\Delta u_t|}\quad\text{where}\quad \Delta u_t \ne 0.$$
#
# After a reversal of the load the two differ.

from mpi4py import MPI

import numpy as np

from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join, name_groups

comm = MPI.COMM_WORLD
n = 8  # cells along an edge of the square
ratio = 1  # times as many cells along the interface below; other than 1: mortar
friction = 0.25
upper = LinearElastic.from_young(1000.0, 0.3)
lower = LinearElastic.from_young(300.0, 0.2)

# ## The bodies
#
# The faces of both bodies coincide; their names, which `join` keeps, distinguish them. The jump of
# the pair is slave minus master, and the tables list forces on the slave.

quadrilateral = mesh.CellType.quadrilateral
side = np.linspace(0.0, 1.0, n + 1)
finer = np.linspace(0.0, 1.0, ratio * n + 1)
below = np.linspace(-0.5, 0.0, n // 2 + 1)


def line(y):
    return lambda x: np.isclose(x[1], y)


square = create_grid(comm, (side, side), quadrilateral)
square = name_groups(square, {"sole": line(0.0), "top": line(1.0)}, cells="square")
block = create_grid(comm, (finer, below), quadrilateral)
block = name_groups(block, {"seat": line(0.0), "base": line(-0.5)}, cells="block")
both = join([square, block])
V = fem.functionspace(both.mesh, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
energy = upper.energy(u) * both.dx("square") + lower.energy(u) * both.dx("block")
top = fem.Constant(both.mesh, np.zeros(2))
held = {"top": top, "base": np.zeros(2)}
bcs = [fem.dirichletbc(value, both.dofs(V, name), V) for name, value in held.items()]
pair = ContactPair(u, both, slave="sole", master="seat", law=Coulomb(friction))
problem = ContactProblem(energy, u, [pair], bcs=bcs)

# ## The history
#
# A unit of time is a step: down until 5, right until 13, left until 29, up until 37. The history
# starts from the undeformed state.

corners = [0, 5, 13, 29, 37]
across = [0.0, 0.0, 0.011, -0.011, -0.004]
down = [0.0, -0.01, -0.01, -0.01, 0.001]


say = io.Report(comm)


def load(t):
    top.value[:] = np.interp(t, corners, across), np.interp(t, corners, down)


history = QuasiStatic(problem, load).run(np.arange(38))
for step in history.steps:
    dissipated = step.energies.dissipated
    say(f"t = {step.time:2g}  {step.status}  dissipated {dissipated:.6g}")

# ## The static law at the end of the second shear
#
# It does not know that the block was sheared to the right before.

top.value[:] = -0.011, -0.01
static = problem.solve().tables["contact"]
say(f"second shear, history:    {history.steps[28].status}")
say(f"second shear, static law: {static.status}")

# ## Comparison
#
# An independent code, which condenses both bodies onto the interface, gives the dissipation and the
# forces on the upper block after the first shear.

sheared = history.steps[12].result.tables["contact"]
dissipation = history.steps[-1].energies.dissipated
normal = float(sheared.rn.sum())
shear = float(sheared.along(sheared.rt).sum())
reference = {"normal": 4.081481324, "shear": -0.873205655, "dissipation": 0.001850495159}
say(f"normal force {normal:.9f}, reference {reference['normal']:.9f}")
say(f"shear force {shear:.9f}, reference {reference['shear']:.9f}")
say(f"dissipation {dissipation:.12f}, reference {reference['dissipation']:.12f}")

folder = io.output_folder(comm, "output/two_blocks")
state = history.steps[12].state
plot.picture_of_body(folder / "body.png", problem, state=state, scale=10.0)
plot.picture_of_contact(folder / "contact.png", problem, state=state)
