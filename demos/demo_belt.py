# SPDX-License-Identifier: LGPL-3.0-or-later
# # A belt pulled over a drum
#
# This demo illustrates how to:
#
# - let a body slide with friction along a curved obstacle over many facets;
# - run a history in which the slip accumulates, and read reactions of supports.
#
# A thin belt hangs over half of a fixed drum. One end carries a weight $T_1$; the other end is
# pulled down until the whole belt slips. For a belt without thickness, with the friction
# coefficient $\mu$ and the angle $\alpha$ of contact, the forces obey
# $T_2/T_1 = e^{\mu\alpha}$ (Euler, 1769; Eytelwein, 1808).
#
# Friction acts at the radius $R$ and the tension at $R + h/2$, the middle of the thickness $h$. The
# balance of moments, $dT\,(R + h/2) = \mu T R\, d\alpha$, gives
#
# $$\frac{T_2}{T_1} = \exp\left(\frac{\mu\, \alpha\, R}{R + h/2}\right).$$

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, Sphere, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame

comm = MPI.COMM_WORLD
n = 64  # cells around the drum
steps, pull = 32, 0.25  # of the pulled end
friction, radius, thickness, weight = 0.3, 1.0, 0.005, 1.0
stiffness = 50.0  # E h over the weight
straight = (0.4, 0.2)  # lengths of the straight ends: of the weight, of the hand

# ## The belt
#
# A strip with one quadrilateral across its thickness is bent to where it hangs. The coordinate
# $s$ runs along its inner face.

size = np.pi * radius / n
cells = [round(length / size) for length in straight]
lower = np.array([-cells[0] * size, 0.0])
upper = lower + np.array([(sum(cells) + n) * size, thickness])
shape = [sum(cells) + n, 1]
domain = mesh.create_rectangle(comm, [lower, upper], shape, mesh.CellType.quadrilateral)


def facets(axis, place):
    return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], place))


inner, weighted, pulled = facets(1, 0.0), facets(0, lower[0]), facets(0, upper[0])
s, across = domain.geometry.x[:, :2].T.copy()
on_drum = np.clip(s, 0.0, np.pi * radius)
angle = np.pi - on_drum / radius
domain.geometry.x[:, 0] = (radius + across) * np.cos(angle)
domain.geometry.x[:, 1] = (radius + across) * np.sin(angle) - np.abs(s - on_drum)

# ## The problem
#
# The body is not linear, so that large sliding is the default: gap and normal are those at the
# displaced points, and slips are arcs along the drum.

V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
drum = Sphere((0.0, 0.0), radius)
contact = ContactSurface(u, inner, obstacle=drum, law=Coulomb(friction), name="drum")
material = NeoHookean(*lame(stiffness * weight / thickness, 0.0))
tension = fem.Constant(domain, 0.0)
tags = mesh.meshtags(domain, 1, np.sort(weighted), np.full(len(weighted), 1, dtype=np.int32))
ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
energy = material.energy(u) * ufl.dx + tension / thickness * u[1] * ds
way = fem.Constant(domain, np.zeros(2))
held = fem.dirichletbc(way, fem.locate_dofs_topological(V, 1, pulled), V)
problem = ContactProblem(energy, u, [contact], bcs=[held])

# ## The history
#
# The weight is applied until $t = 1$; then the other end is pulled.


def load(t):
    tension.value = weight * min(t, 1.0)
    way.value[1] = -pull * max(t - 1.0, 0.0)


def ratio(step):
    return -float(step.result.support[1]) / weight


say = io.Report(comm)
times = [0.0, 0.5, 1.0, *(1.0 + np.arange(1, steps + 1) / steps)]
history = QuasiStatic(problem, load).run(times)
ratios = [ratio(step) for step in history.steps]
thick = float(np.exp(friction * np.pi / (1 + thickness / (2 * radius))))
thin = float(np.exp(friction * np.pi))
say(f"T2/T1 = {ratios[-1]:.6f}; closed form with the thickness {thick:.6f}, without {thin:.6f}")
table = history.steps[-1].result.tables["drum"]
slid = float(np.linalg.norm(table.ut[table.rn > 0], axis=1).max())
say(f"slid by {slid:.3f}, {slid / size:.1f} facets")

folder = io.output_folder(comm, "output/belt")
plot.picture_of_body(folder / "belt.png", problem)
if comm.rank == 0:
    travelled = [pull * max(step.time - 1.0, 0.0) for step in history.steps]
    labels = ("displacement of the pulled end", "$T_2/T_1$")
    plot.draw_curves(folder / "ratio.png", {"belt": (travelled, ratios)}, labels=labels)
