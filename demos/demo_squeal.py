# SPDX-License-Identifier: LGPL-3.0-or-later
# # Squeal: vibrations driven by friction
#
# This demo illustrates how to:
#
# - compute the vibrations of a body that slides steadily, and decide which of them grow
#   (`SteadySliding`);
# - find the friction coefficient at which growth begins;
# - animate a mode of vibration.
#
# The pad of a brake, clamped at its top, is pressed on a floor that moves to the right. The
# friction coefficient does not depend on the velocity. Still, a vibration changes the pressure and
# with it the friction force. Vibrations $v\, e^{\lambda t}$ of the sliding face with $v_n = 0$
# solve
#
# $$(K + \lambda C + \lambda^2 M)_t\, v - F\, (K + \lambda C + \lambda^2 M)_n\, v = 0.$$
#
# Where two frequencies have merged, one of the modes takes energy from the floor in every period.
# Without damping the finest modes of the mesh merge first and the onset tends to zero under
# refinement; with damping $C = \eta K$ the pad has an onset of its own.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.analysis import SteadySliding
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
n = 4  # cells along an edge
friction, damping, density = 0.5, 0.02, 1.0
frames = 24  # of the animation

# ## The pad

domain = mesh.create_unit_square(comm, n, n, mesh.CellType.quadrilateral)
bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1.0))
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
clamped = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, top), V)
floor = HalfSpace((0, 0), (0, 1))
surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
problem = ContactProblem(energy, u, [surface], bcs=[clamped])

# ## Growth and onset
#
# The pad slips to the left relative to the floor. An independent code gives the growth 0.0980819683
# and the frequency 2.9400657677 at F = 0.5, and the onset at F = 0.37678558.

sliding = SteadySliding(problem, (-1.0, 0.0), density=density, damping=damping)
modes = sliding.modes(friction)
onset = sliding.onset()
say = io.Report(comm)
say(f"growth {modes.growth:.10f}, reference 0.0980819683")
say(f"frequency {modes.frequency:.10f}, reference 2.9400657677")
say(f"onset at F = {onset.friction:.8f}, reference 0.37678558")

# ## A regularised law hides squeal
#
# The force of the law $F p \tanh(v/\varepsilon)$ still increases with the velocity at the speed of
# sliding. It acts as a damper on the contact face, here with three values per area.

v, w = ufl.TrialFunction(V), ufl.TestFunction(V)
stiffness = ufl.derivative(ufl.derivative(energy, u, w), u, v)
ones = np.ones(len(bottom), dtype=np.int32)
ds = ufl.Measure("ds", domain, subdomain_data=mesh.meshtags(domain, 1, np.sort(bottom), ones))(1)
frictions = np.linspace(0.0, 2 * friction, 13)
curves = {"Coulomb": (frictions, [sliding.modes(F).growth for F in frictions])}
for slope in (0.01, 0.1, 1.0):
    eta, c = fem.Constant(domain, damping), fem.Constant(domain, slope)
    damper = eta * stiffness + c * v[0] * w[0] * ds
    rubbing = SteadySliding(problem, (-1.0, 0.0), density=density, damping=damper)
    curves[f"slope {slope:g}"] = (frictions, [rubbing.modes(F).growth for F in frictions])
    say(f"regularised, slope {slope:g}: growth {rubbing.modes(friction).growth:.6f}")

# ## The pictures
#
# The animation shows the mode without its growth, $\mathrm{Re}\,(v e^{i\omega t})$.

folder = io.output_folder(comm, "output/squeal")
if comm.rank == 0:
    labels = ("friction coefficient F", "largest growth")
    plot.draw_curves(folder / "growth.png", curves, labels=labels)


def period():
    mode = modes.real.x.array + 1j * modes.imaginary.x.array
    largest = comm.allreduce(np.abs(mode).max(initial=0.0), op=MPI.MAX)
    for part in np.arange(frames) / frames:
        u.x.array[:] = 0.1 / largest * (mode * np.exp(2j * np.pi * part)).real
        yield f"{part:.2f} of a period"


title = f"F = {friction:g}, frequency {modes.frequency:.4g}"
plot.film(folder / "mode.gif", problem, period(), title=title)
