# SPDX-License-Identifier: LGPL-3.0-or-later
# # Hysteresis: a long bar pulled to and fro over a floor
#
# This demo illustrates how to:
#
# - load a body in a cycle (`QuasiStatic`), so that friction depends on the history;
# - read the energies of a history, and compare the dissipation of a cycle with a closed form;
# - write the steps for ParaView (`EvolutionSeries`).
#
# A strip lies between two floors that press on it; one half is meshed. Its end is pulled by a force
# $P$ per width. With the stiffness $EA$ and the friction $q = \mu p$ per length, it slips over the
# length $P/q$, and its end moves by $P^2/(2 EA\, q)$. When the force falls by $D$, the end slips
# back by $D^2/(4 EA\, q)$. A cycle between $P$ and $-P$ dissipates
#
# $$\frac{2 P^3}{3 EA\, q}.$$
#
# This loop is the hysteresis of the bar. The shear across the thickness, which a bar neglects,
# changes the numbers by about the thickness over the slip length.

from itertools import pairwise

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.continuation import Observers
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
n = 80  # cells on the slip length
steps = 4  # up to the first turn
thickness = 1 / 40  # over the slip length, which is 1
length, young, friction, pressure = 1.25, 1000.0, 0.5, 1.0
q = friction * pressure
EA = young * thickness

# ## The strip
#
# The upper face is the plane of symmetry, held at the height at which the pressure is as given.

x = np.linspace(-length, 0.0, round(length * n) + 1)
y = np.linspace(0.0, thickness, max(2, round(thickness * n)) + 1)
domain = create_grid(comm, (x, y), mesh.CellType.quadrilateral)
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")


def facets(axis, place):
    return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], place))


def held(component, on, value):
    W = V.sub(component)
    return fem.dirichletbc(value, fem.locate_dofs_topological(W, 1, on), W)


squeezed = held(1, facets(1, thickness), -pressure * thickness / young)
far_end = held(0, facets(0, -length), 0.0)
pull = fem.Constant(domain, 0.0)
ds = ufl.Measure("ds", subdomain_data=mesh.meshtags(domain, 1, np.sort(facets(0, 0.0)), 1))(1)
mean_displacement = u[0] / thickness * ds
energy = LinearElastic.from_young(young, 0.0).energy(u) * ufl.dx - pull * mean_displacement
floor = HalfSpace((0, 0), (0, 1))
contact = ContactSurface(u, facets(1, 0.0), obstacle=floor, law=Coulomb(friction))
problem = ContactProblem(energy, u, [contact], bcs=[squeezed, far_end])
problem.solve()

# ## One and a quarter cycles
#
# The force rises to $q$, falls to $-q$ and rises again. The observer records the end.


def load(t):
    pull.value = q * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


end_form = fem.form(mean_displacement)
curve = [(0.0, 0.0)]
folder = io.output_folder(comm, "output/bar")
with io.EvolutionSeries(folder, problem, every=steps) as series:

    def record(step):
        curve.append((comm.allreduce(fem.assemble_scalar(end_form)), float(pull.value)))

    both = Observers(series, record)
    history = QuasiStatic(problem, load).run(np.linspace(0.0, 5.0, 5 * steps + 1), observer=both)

# ## Comparison
#
# The closed form is a parabola from each turn of the force.

displacement, force = np.transpose(curve)
exact = [0.0]
turn, start, factor = 0.0, 0.0, 2.0
sign = 1.0
for before, now in pairwise(force):
    if (now - before) * sign < 0:
        turn, start, factor, sign = before, exact[-1], 4.0, -sign
    exact.append(start + sign * (now - turn) ** 2 / (factor * EA * q))

table = history.at(1.0).result.tables["contact"]
stuck = table.x[table.letters == "k", 0].max()
slipping = table.x[table.x[:, 0] > stuck, 0].min()
slip_length = -0.5 * (stuck + slipping)
dissipation = history.at(5.0).energies.dissipated - history.at(1.0).energies.dissipated
closed_form = 2 * q**2 / (3 * EA)
say = io.Report(comm)
say(f"slip length {slip_length:.4f}, closed form 1")
say(f"displacement of the end {displacement[steps]:.6f}, closed form {exact[steps]:.6f}")
say(f"dissipation of a cycle {dissipation:.6f}, closed form {closed_form:.6f}")

if comm.rank == 0:
    curves = {"strip in plane strain": (displacement, force)}
    dotted = {"bar": (np.array(exact), force)}
    labels = ("displacement of the end", "force")
    plot.draw_curves(folder / "loop.png", curves, dotted=dotted, labels=labels)
