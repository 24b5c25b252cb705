# SPDX-License-Identifier: LGPL-3.0-or-later
# # A history with memory
#
# Friction opposes the slip *rate*, so that the state under a load depends on the path to it. A
# static solve instead opposes the total slip since the undeformed body. Here a block is pressed,
# dragged, and dragged back step by step, and friction opposes the slip since the previous step.
# Load and displacement then run along a loop, whose area is the frictional dissipation. Formulas
# are in {doc}`the theory </theory/5_evolution>`.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic

# ## The block
#
# A rectangle, twice as long as high, held on its top.

comm = MPI.COMM_WORLD
domain = mesh.create_rectangle(comm, [[0, 0], [2, 1]], (24, 12), mesh.CellType.quadrilateral)
top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1))
bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
moved = fem.Constant(domain, (0.0, -0.01))
bcs = [fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, top), V)]
rubber = LinearElastic.from_young(1000.0, 0.3)
floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
contact = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(0.3))
problem = ContactProblem(rubber.energy(u) * ufl.dx, u, [contact], bcs=bcs)

# ## The load in time
#
# `load(t)` sets the Constants of the problem. The top is moved to and fro, one and a quarter times.
# The history begins at a solution: the block that is only pressed.


def load(t):
    moved.value[0] = 0.015 * np.sin(2 * np.pi * t)


load(0.0)
pressed = problem.solve()
print(f"pressed: {pressed.tables['contact'].status}")
evolution = QuasiStatic(problem, load)
times = np.linspace(0.0, 1.25, 61)
history = evolution.run(times)
print(history.reason)

# ## Stick and slip
#
# Each row of letters is the bottom from left to right: `k` sticks, `+` and `-` slip. After each
# reversal of the load all points stick at first; then slip spreads from the ends.

for step in history.steps[::6]:
    force = step.result.resultants["contact"]
    print(f"t = {step.time:.3f} {step.status} shear {force[0]:+.3f}")

# ## The loop
#
# The force that drags the top against its displacement. The first quarter starts from the pressed
# block and is not repeated.

way = np.array([0.015 * np.sin(2 * np.pi * s.time) for s in history.steps])
drag = np.array([-s.result.resultants["contact"][0] for s in history.steps])
plot.draw_curves(
    "loop.png",
    {"drag": (np.append(0.0, way), np.append(0.0, drag))},
    labels=("displacement of the top", "force"),
)

# ## Energy
#
# After a full cycle the block returns to its state one cycle before, so that the work of the load
# equals the frictional dissipation. The area of the loop, by the trapezoidal rule, is that work.

cycle = np.array([s.time for s in history.steps]) >= 0.25 - 1e-9
x, f = way[cycle], drag[cycle]
area = np.sum((f[1:] + f[:-1]) / 2 * np.diff(x))
ends = [step.energies.dissipated for step in history.steps if step.time >= 0.25 - 1e-9]
dissipated = ends[-1] - ends[0]
print(f"area of the loop {area:.6f}, dissipated {dissipated:.6f}")
assert history.complete
assert dissipated > 0
assert abs(area / dissipated - 1) < 0.05

# ## With and without memory
#
# Every step of the history has a `state`. `problem.step_from(state)` is the problem of one step
# that begins there; solving it repeats the next step. The problem itself has the static law: at the
# same load, on the way back, it does not know the earlier slip to the right. Neither solve changes
# the history.

k = next(k for k, step in enumerate(history.steps) if step.time > 0.5 - 1e-9)
before, after = history.steps[k - 1], history.steps[k]
load(after.time)
problem.restore(before.state)
remembered = problem.step_from(before.state).solve().resultants["contact"][0]
without = problem.solve().resultants["contact"][0]
print(f"shear at t = {after.time:g}: {remembered:+.4f} with memory, {without:+.4f} without")
assert abs(remembered / after.result.resultants["contact"][0] - 1) < 1e-8
assert abs(remembered - without) > 0.1
plot.picture_of_contact("contact.png", problem, title="The bottom at t = 0.5 without memory")
