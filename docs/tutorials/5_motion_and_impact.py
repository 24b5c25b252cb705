# SPDX-License-Identifier: LGPL-3.0-or-later
# # Motion and impact
#
# Bodies with mass: a bar flies against a wall and bounces. Its contact force and the time of its
# contact are known exactly from the theory of waves, so that schemes can be assessed.
# The schemes are in {doc}`the theory </theory/6_impact>`.
#
# A bar of length $L$ with the wave speed $c = \sqrt{E/\rho}$ that meets a rigid wall with the
# velocity $v$ sends a compression wave through itself, which comes back after the time $2L/c$. As
# long as that takes, the force is $\rho c v$ per area; then the bar leaves with the velocity $-v$.

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
# One layer of cells, whose sections move up and down only. It starts just above the floor. The
# problem is static, as before: it knows nothing of masses.

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
# `NSCD` gives it a mass, a velocity and steps in time: nonsmooth contact dynamics, in which
# contact forces are impulses over a step. By default the mass of the contact nodes is
# redistributed to their neighbours, so that the force does not alternate from step to step. At the
# fronts of the wave, which no mesh resolves, it still overshoots, to 380 here, on finer meshes too.

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
# Kinetic energy becomes elastic energy and comes back. Every energy has a formula of its own; what
# does not close is the residue. The loss is in the step of the first touch, and falls with the
# length of steps: it is 1.1, 0.5, 0.1, 0.04 % with steps of twice this length, this one, a half and
# a quarter of it.

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

# Friction, adhesion, other bodies and large deformations work in motions as they do in histories;
# the demos `demo_bouncing_bar.py`, `demo_thrown_body.py` and `demo_stick_slip.py` continue from
# here.
