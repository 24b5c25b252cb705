# SPDX-License-Identifier: LGPL-3.0-or-later
# # A cube thrown at a wall returns with spin
#
# This demo illustrates how to:
#
# - compute the motion of a hyperelastic body with large rotations and impact (`NSCD`);
# - measure momentum and angular momentum with an observer;
# - verify their balance with the contact forces.
#
# A tilted cube flies obliquely at a rough wall and hits it with an edge. Friction and the eccentric
# normal force give it a spin. The balances of momentum and of angular momentum about the origin,
#
# $$\Delta \int \rho\, v\, dx = \sum \int r\, dt,\qquad
# \Delta \int \rho\, (x + u) \times v\, dx = \sum \int (x + u) \times r\, dt,$$
#
# compare the motion of the body with the forces at the contact points. The contact law is imposed
# on velocities, for which all nodes have mass.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import NeoHookean, lame

comm = MPI.COMM_WORLD
n = 3  # cells along an edge
dt, end = 0.002, 0.2
friction, density, gap = 0.3, 1.0, 0.05
initial_velocity = [2.0, 0.5, -3.0]
tilt = np.radians(-20.0)

# ## The cube

domain = mesh.create_unit_cube(comm, n, n, n, mesh.CellType.hexahedron)
face = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
c, s = np.cos(tilt), np.sin(tilt)
x = domain.geometry.x
x[:] = x @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
x[:, 2] += gap - comm.allreduce(x[:, 2].min(initial=np.inf), op=MPI.MIN)
V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
u = fem.Function(V, name="displacement")
velocity = fem.Function(V, name="velocity")
velocity.interpolate(lambda x: np.outer(initial_velocity, np.ones(x.shape[1])))
wall = HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
surface = ContactSurface(u, face, obstacle=wall, law=Coulomb(friction))
energy = NeoHookean(*lame(1000.0, 0.3)).energy(u) * ufl.dx
problem = ContactProblem(energy, u, [surface])

# ## The motion
#
# The observer is called after every step. It integrates the momenta over the body and adds up the
# impulses of the contact forces.

place = ufl.SpatialCoordinate(domain) + u
moment = ufl.cross(place, velocity)
forms = [fem.form(density * vector[i] * ufl.dx) for vector in (velocity, moment) for i in range(3)]


def momenta():
    values = np.array([fem.assemble_scalar(form) for form in forms])
    return comm.allreduce(values)


impulses = np.zeros(6)
measured = [momenta()]


def record(step):
    table = step.result.tables["contact"]
    displaced = np.column_stack([(table.x + table.ut)[:, :2], table.un])
    duration = step.time - step.start
    impulses[:3] += duration * table.force.sum(axis=0)
    impulses[3:] += duration * np.cross(displaced, table.force).sum(axis=0)
    measured.append(momenta())


motion = NSCD(problem, density, dt=dt, velocity=velocity, level="velocity", mass="consistent")
history = motion.run([0.0, end], observer=record)

# ## Balances

change = measured[-1] - measured[0]
momentum_error = float(np.abs((change - impulses)[:3]).max() / np.abs(change[:3]).max())
moment_error = float(np.abs((change - impulses)[3:]).max() / np.abs(change[3:]).max())
energies = history.energies
energy_error = abs(energies.residue) / energies.at_start
say = io.Report(comm)
say(f"momentum at the end {np.round(measured[-1][:3], 4)}")
say(
    f"error of the balance of momentum {momentum_error:.1e}, of angular momentum {moment_error:.1e}"
)
say(f"error of the energy balance {energy_error:.1e}")
say(f"dissipated by friction and impact: {energies.dissipated:.4f}, {energies.contact:.4f}")

folder = io.output_folder(comm, "output/thrown_body")
plot.picture_of_body(folder / "body.png", problem)
if comm.rank == 0:
    times = np.array([0.0, *(step.time for step in history.steps)])
    momentum = np.array(measured)
    curves = {name: (times, momentum[:, k]) for k, name in enumerate(("x", "y", "z"))}
    plot.draw_curves(folder / "momentum.png", curves, labels=("time", "momentum"))
