# SPDX-License-Identifier: LGPL-3.0-or-later
# # A bar that bounces on a floor, and two bars that collide
#
# This demo illustrates how to:
#
# - give a body mass and set it in motion (`NSCD`);
# - compare contact force and energy with an exact solution over two impacts;
# - let two bodies with different velocities collide (`ContactPair`).
#
# An elastic bar falls from the height 5 under its weight. When it hits the floor, a wave runs up,
# is reflected at the free end and lifts the bar off. The bar then vibrates in flight. The second
# impact removes the vibration: at $t = 16/3$ the bar is at rest where it started. The floor pushes
# with
#
# $$300 + 300\,(t - 1)\quad (1 < t < 5/3),\qquad 500 - 300\,(t - 11/3)\quad (11/3 < t < 13/3),$$
#
# and the energy, 500, is conserved (Doyen, Ern and Piperno, *SIAM J. Sci. Comput.*, 2011).

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

comm = MPI.COMM_WORLD
elements = 50
young, density, length, gravity, height = 900.0, 1.0, 10.0, 10.0, 5.0
wave_speed = np.sqrt(young / density)
period = 16 / 3
energy_at_start = 500.0

# ## The bar
#
# A row of squares that move vertically only is a one-dimensional bar; Poisson's ratio is zero. The
# energy contains the weight, which is positive upwards.

corners = [[0.0, 0.0], [1.0, length]]
domain = mesh.create_rectangle(comm, corners, [1, elements], mesh.CellType.quadrilateral)
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
horizontal, _ = V.sub(0).collapse()
everywhere = fem.locate_dofs_geometrical((V.sub(0), horizontal), lambda x: x[0] < 2)
straight = fem.dirichletbc(fem.Function(horizontal), everywhere, V.sub(0))
weight = fem.Constant(domain, density * gravity)
energy = (LinearElastic.from_young(young, 0.0).energy(u) + weight * u[1]) * ufl.dx

lower_end = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
floor = HalfSpace((0.0, -height), (0.0, 1.0))
surface = ContactSurface(u, lower_end, obstacle=floor, law=Frictionless())
problem = ContactProblem(energy, u, [surface], bcs=[straight])

# ## The motion
#
# By default the contact law holds for positions at the end of each step, and the mass of the
# contact nodes is redistributed to their neighbours, which avoids force oscillations. In one step
# the wave crosses one element.

dt = length / elements / wave_speed
history = NSCD(problem, density, dt=dt).run([0.0, period])

# ## Comparison
#
# The force of a step is a mean value over the step. It is compared with the mean of the exact
# force, the difference of impulses.


def exact_impulse(t):
    first = np.clip(t, 1, 5 / 3) - 1
    second = np.clip(t, 11 / 3, 13 / 3) - 11 / 3
    return 300 * first + 150 * first**2 + 500 * second - 150 * second**2


times = np.array([0.0, *(step.time for step in history.steps)])
force = np.array([step.result.tables["contact"].rn.sum() for step in history.steps])
exact = np.diff(exact_impulse(times)) / np.diff(times)
middle = 8 / 3  # between the impacts
impulses = [float((force * np.diff(times))[part].sum()) for part in
            (times[1:] <= middle, times[1:] > middle)]  # fmt: skip
energies = [1.0]
for step in history.steps:
    change = step.energies.kinetic + step.energies.stored - step.energies.external
    energies.append(1 + change / energy_at_start)

say = io.Report(comm)
say(f"impulses of both impacts {impulses[0]:.2f}, {impulses[1]:.2f}, exact {800 / 3:.2f}")
say(f"energy at the end over that at the start {energies[-1]:.5f}, exact 1")

# ## Two bars that collide
#
# A bar with the velocity $V$ hits an equal bar at rest. Waves run from the contact to the free ends
# and back; in the meantime the contact pressure is $\rho c V/2$. After $2 L/c$ the bars separate:
# the first is at rest, the second has the velocity $V$, and no vibration is left. This holds
# without Poisson's effect.

speed, gap = 20.0, 2.0


def bar(left):
    ends = [[left, -0.5], [left + length, 0.5]]
    return mesh.create_rectangle(comm, ends, [elements, 2], mesh.CellType.quadrilateral)


bars = join([bar(-length), bar(gap)]).mesh


def face(place):
    return mesh.locate_entities_boundary(bars, 1, lambda x: np.isclose(x[0], place))


W = fem.functionspace(bars, ("Lagrange", 1, (2,)))
v = fem.Function(W, name="displacement")
initial_velocity = fem.Function(W)
initial_velocity.interpolate(lambda x: np.array([speed * (x[0] < gap / 2), 0 * x[0]]))
pair = ContactPair(v, face(0.0), master_facets=face(gap), law=Frictionless())
elastic = LinearElastic.from_young(young, 0.0)
collision = ContactProblem(elastic.energy(v) * ufl.dx, v, [pair])
motion = NSCD(collision, density, dt=dt, velocity=initial_velocity)
before = gap / speed  # time until the impact
collided = motion.run([0.0, before, before + 2.5 * length / wave_speed])

# The impulse of the contact force changes the momenta of both bars.

ends = np.array([0.0, *(step.time for step in collided.steps)])
push = -np.array([step.result.resultants["contact"][0] for step in collided.steps])
second_speed = float(push @ np.diff(ends) / (density * length))
inner = (ends[1:] > before + 0.1) & (ends[1:] < before + 0.5)
contact_pressure = float(push[inner].mean())
exact_pressure = density * wave_speed * speed / 2
say(f"velocity of the second bar {second_speed:.3f}, exact {speed:g}")
say(f"contact pressure {contact_pressure:.2f}, exact {exact_pressure:.2f}")

# ## The picture
#
# The contact force of the bouncing bar, as a mean value over each step. The first impact follows
# the exact force closely, except for a peak in its first steps. The second one begins with a jump
# to its largest force, which the scheme answers with oscillations. Their mean value is correct: the
# impulses of both impacts have errors of less than half a per cent. In between, the bar flies and
# vibrates.

folder = io.output_folder(comm, "output/bouncing_bar")
if comm.rank == 0:
    curves = {"computed, mean over a step": (times[1:], force)}
    dotted = {"exact": (times[1:], exact)}
    plot.draw_curves(folder / "force.png", curves, dotted=dotted, labels=("time", "contact force"))
