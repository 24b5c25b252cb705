# SPDX-License-Identifier: LGPL-3.0-or-later
# # A bar that falls on a floor and bounces
#
# This demo illustrates how to:
#
# - give a body mass and set it in motion (`NSCD`);
# - compare contact force and energy with an exact solution over two impacts.
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

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, io, plot
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

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

folder = io.output_folder(comm, "output/bouncing_bar")
if comm.rank == 0:
    curves = {"computed, mean over a step": (times[1:], force)}
    dotted = {"exact": (times[1:], exact)}
    plot.draw_curves(folder / "force.png", curves, dotted=dotted, labels=("time", "contact force"))
