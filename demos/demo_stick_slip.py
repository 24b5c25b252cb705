# SPDX-License-Identifier: LGPL-3.0-or-later
# # A block that slides to rest, and a block on a belt
#
# This demo illustrates how to:
#
# - start a motion from a static solution with an initial velocity (`NSCD`);
# - move the floor under a body with mass (`RigidBody` with a prescribed motion);
# - find the begin and the end of sticking in a history.
#
# First, an elastic block is pushed off with the velocity $v_0$ on a floor. A point mass stops after
# the time $v_0/(\mu g)$ and the distance $v_0^2/(2\mu g)$. The centre of mass of an elastic block
# does the same as long as all of its face slips.
#
# Second, the block is held by springs of the frequency $\omega$ and stands on a belt that runs with
# the velocity $V$. It slips until it is as fast as the belt, at $\omega t = \arcsin(V/(\omega m))$
# with $m = \mu g/\omega^2$. It sticks until the springs pull with $\mu g$, and then oscillates
# about $m$ with the amplitude $V/\omega$. Since the friction coefficient is the same at rest and in
# motion, the block sticks only once.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    RigidBody,
    io,
    plot,
)
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
n = 2  # cells over the height
width, height, density, gravity = 2.0, 1.0, 1.0, 10.0
friction, young, poisson = 0.3, 1e6, 0.3
omega = 2 * np.pi
belt_velocity, v0 = 0.1, 1.0
periods = 3.0  # of the oscillation on the belt
mass = density * width * height
say = io.Report(comm)

# ## A stiff block under its weight


def block(law, stiffness=0.0, moving=False, held=False):
    """The problem, and the displacement of the floor (a Constant)."""
    corners = [[0.0, 0.0], [width, height]]
    domain = mesh.create_rectangle(comm, corners, [2 * n, n], mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    travelled = fem.Constant(domain, 0.0)
    if moving:
        floor = RigidBody(floor, about=(0, 0), motion={"x": travelled}, held=("y", "rz"))
    surface = ContactSurface(u, bottom, obstacle=floor, law=law)
    per_mass = stiffness * u[0] ** 2 / 2 + fem.Constant(domain, gravity) * u[1]
    stored = LinearElastic.from_young(young, poisson).energy(u)
    energy = (stored + density * per_mass) * ufl.dx
    bcs = []
    if held:  # one corner, horizontally
        W = V.sub(0)
        horizontal, _ = W.collapse()
        corner = fem.locate_dofs_geometrical(
            (W, horizontal), lambda x: np.isclose(x[0], 0) & np.isclose(x[1], height)
        )
        bcs.append(fem.dirichletbc(fem.Function(horizontal), corner, W))
    return ContactProblem(energy, u, [surface], bcs=bcs), travelled


# ## Sliding to rest
#
# The block starts in its shape at rest without friction. The contact force changes its momentum.

at_rest, _ = block(Frictionless(), held=True)
at_rest.solve()
sliding, _ = block(Coulomb(friction))
sliding.u.x.array[:] = at_rest.u.x.array
velocity = fem.Function(sliding.V)
velocity.interpolate(lambda x: np.array([v0 + 0 * x[0], 0 * x[0]]))
stop = v0 / (friction * gravity)
motion = NSCD(sliding, density, dt=stop / 200, velocity=velocity)
history = motion.run([0.0, 1.2 * stop])
times = np.array([0.0, *(step.time for step in history.steps)])
force = np.array([step.result.resultants["contact"][0] for step in history.steps])
speed = v0 + np.append(0.0, np.cumsum(force * np.diff(times))) / mass
distance = float(((speed[1:] + speed[:-1]) / 2 * np.diff(times)).sum())
say(f"sliding distance {distance:.5f}, point mass {v0 * stop / 2:.5f}")

# ## On a belt
#
# Damping proportional to the stiffness calms the vibration of the stiff block on its corners. An
# observer records the mean displacement.

on_belt, travelled = block(Coulomb(friction), omega**2, moving=True)
on_belt.solve()
mean = fem.form(on_belt.u[0] / (width * height) * ufl.dx)
places = [0.0]


def load(t):
    travelled.value = belt_velocity * t


def record(_):
    places.append(comm.allreduce(fem.assemble_scalar(mean)))


damped = NSCD(on_belt, density, dt=0.005, load=load, damping=(0.0, 1e-4))
belt_history = damped.run([0.0, periods * 2 * np.pi / omega], observer=record)
belt_times = np.array([0.0, *(step.time for step in belt_history.steps)])
u = np.array(places)

# ## Comparison with the oscillator of one degree of freedom

m = friction * gravity / omega**2
caught = np.arcsin(belt_velocity / (m * omega)) / omega
released = caught + m * np.cos(omega * caught) / belt_velocity
stuck = np.array(["k" in step.status for step in belt_history.steps])
runs = np.flatnonzero(np.diff([False, *stuck, False])).reshape(-1, 2)
first, last = runs[np.argmax(np.diff(runs)[:, 0])]
later = belt_times > released + 0.05
amplitude = float(np.ptp(u[later]) / 2)
say(f"sticks at {belt_times[first]:.4f}, closed form {caught:.4f}")
say(f"slips again at {belt_times[last]:.4f}, closed form {released:.4f}")
say(f"amplitude {amplitude:.5f}, closed form {belt_velocity / omega:.5f}")

folder = io.output_folder(comm, "output/stick_slip")
if comm.rank == 0:
    t = belt_times
    slips = m * (1 - np.cos(omega * t))
    rides = m * (1 - np.cos(omega * caught)) + belt_velocity * (t - caught)
    swings = m + belt_velocity / omega * np.sin(omega * (t - released))
    exact = np.select([t < caught, t < released], [slips, rides], swings)
    curves, dotted = {"block": (t, u)}, {"one degree of freedom": (t, exact)}
    plot.draw_curves(folder / "belt.png", curves, dotted=dotted, labels=("time", "displacement"))
