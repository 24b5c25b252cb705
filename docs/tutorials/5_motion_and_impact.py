# SPDX-License-Identifier: LGPL-3.0-or-later
# # Motion and impact
#
# A bar with mass hits a wall and bounces. The theory of waves gives the contact force and the
# duration of the contact exactly, so that schemes can be assessed. {doc}`The theory
# </theory/6_impact>` describes the schemes.
#
# A bar of length $L$ with the wave speed $c = \sqrt{E/\rho}$ that meets a rigid wall with the
# velocity $v$ sends out a compression wave, which returns after the time $2L/c$. Until then the
# force is $\rho c v$ per area; afterwards the bar leaves with the velocity $-v$.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, plot
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

L, E, RHO, V0 = 10.0, 900.0, 1.0, 10.0
C = np.sqrt(E / RHO)

# ## The bar
#
# The bar is one layer of cells whose sections move vertically. It starts just above the floor. The
# problem is static, as before; mass is added below.

comm = MPI.COMM_WORLD
n = 40
domain = mesh.create_rectangle(comm, [[0, 0], [1, L]], (1, n), mesh.CellType.quadrilateral)
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
domain.topology.create_connectivity(1, 2)
edges = mesh.locate_entities(domain, 1, lambda x: x[0] < 2)  # all of them
sideways = fem.locate_dofs_topological(V.sub(0), 1, edges)
straight = fem.dirichletbc(0.0, sideways, V.sub(0))
below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
floor = HalfSpace((0.0, -0.2), (0.0, 1.0))
surface = ContactSurface(u, below, obstacle=floor, law=Frictionless())
material = LinearElastic.from_young(E, 0.0)
problem = ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[straight])

# ## The motion
#
# `NSCD` adds mass, velocity and steps in time (nonsmooth contact dynamics). Contact forces are
# impulses over a step. By default the mass of the contact nodes is redistributed to their
# neighbours, which avoids alternating forces. At the fronts of the wave, which no mesh resolves,
# the force still overshoots, here to 380, on finer meshes too.

velocity = fem.Function(V)
velocity.interpolate(lambda x: np.stack([0 * x[0], -V0 + 0 * x[0]]))
motion = NSCD(problem, RHO, dt=L / n / C, velocity=velocity)
start_energy = RHO * L * V0**2 / 2
history = motion.run([0.0, 1.0])
print(history.reason, len(history.steps), "steps")

# ## Force and duration

times = np.array([step.time for step in history.steps])
force = np.array([step.result.tables["contact"].rn.sum() for step in history.steps])
touching = times[force > 0.01 * force.max()]
duration = touching[-1] - touching[0]
impulse = np.sum(force * np.diff(np.append(0.0, times)))
print(f"contact lasts {duration:.4f}, exact {2 * L / C:.4f}")
print(f"mean force {impulse / (2 * L / C):.2f}, exact {RHO * C * V0:.2f}")
print(f"impulse {impulse:.3f}, exact {2 * RHO * L * V0:.3f}")
assert abs(duration / (2 * L / C) - 1) < 0.1
assert abs(impulse / (2 * RHO * L * V0) - 1) < 0.02

begins = 0.2 / V0
exact = np.where((times > begins) & (times < begins + 2 * L / C), RHO * C * V0, 0.0)
plot.draw_curves(
    "force.png",
    {"contact force": (times, force)},
    dotted={"exact": (times, exact)},
    labels=("time", "force"),
)

# ## Energy
#
# Kinetic energy is converted to elastic energy and back. Each energy is computed by its own
# formula; the residue measures the imbalance. Energy is lost in the step of the first contact. The
# loss falls with the step length: it is 1.1, 0.5, 0.1 and 0.04 % with twice this length, this
# length, a half and a quarter of it.

kinetic = np.array([step.energies.kinetic for step in history.steps])
stored = np.array([step.energies.stored for step in history.steps])
residue = max(abs(step.energies.residue) for step in history.steps)
print(f"energy at the end {(kinetic[-1] + stored[-1]) / start_energy:.6f} of that at the start")
print(f"largest residue {residue / start_energy:.1e}")
assert 0.99 < (kinetic[-1] + stored[-1]) / start_energy < 1.0
assert residue < 1e-6 * start_energy
plot.draw_curves(
    "energy.png",
    {"kinetic": (times, kinetic), "stored": (times, stored), "sum": (times, kinetic + stored)},
    labels=("time", "energy"),
)

# Friction, adhesion, other bodies and large deformations are used in motions as in histories. The
# demos `demo_bouncing_bar.py`, `demo_thrown_body.py` and `demo_stick_slip.py` continue from
# here.
