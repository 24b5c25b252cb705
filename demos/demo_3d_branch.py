# SPDX-License-Identifier: LGPL-3.0-or-later
# # A rounded foot from first contact to full sliding
#
# This demo illustrates how to:
#
# - follow a 3D body as its load grows, while many contact points close, stick and slip;
# - drive Dirichlet data by the parameter of a continuation (`driven=`);
# - pass changes of status in batches, and locate one of them exactly (`Follower`, `locate=`).
#
# The foot is a cube of hexahedra with a rounded sole, just above a rigid floor. Its top is moved by
# $\gamma^2 s$ sideways and by $\gamma d$ downwards. It touches first at its lowest point and
# sticks. Then it slips from the rim of the contact area inwards, until the last sticking point
# slips. The static law applies: a point sticks as long as it has not moved sideways since the
# undeformed state. Its motion before contact counts as slip, which the warning `growth` reports.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
    records,
)
from dolfinx_contact.continuation import Follower, StepControl
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
n = 8  # cells along an edge
friction, gap = 0.4, 0.005
lowered, shifted = 0.06, 0.12  # displacements of the top at gamma = 1
lowest_point = (0.46, 0.53)
roundness = 0.08

# ## The body

domain = mesh.create_unit_cube(comm, n, n, n, mesh.CellType.hexahedron)
sole = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1.0))
x = domain.geometry.x
x[:, 2] += roundness * (1 - x[:, 2]) * ((x[:, :2] - lowest_point) ** 2).sum(axis=1)
V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
u = fem.Function(V, name="displacement")
floor = HalfSpace((0.0, 0.0, -gap), (0.0, 0.0, 1.0))
surface = ContactSurface(u, sole, obstacle=floor, law=Coulomb(friction))
energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx

# ## The parameter
#
# The Dirichlet data are a Function. The continuation evaluates the expression `motion` in it, and
# differentiates it.

gamma = fem.Constant(domain, 0.0)
moved = fem.Function(V)
aside = shifted * gamma**2
motion = ufl.as_vector([0.94 * aside, 0.34 * aside, -lowered * gamma])
held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 2, top))
problem = ContactProblem(energy, u, [surface], bcs=[held])
system = ParametricContact(problem, gamma, driven=[(moved, motion)])

# ## The branch
#
# With `kinks="batched"` one step may pass several changes of status, which is the default for many
# contact points. The predicate `first_contact` selects the change that is located exactly.

heights = system.positions[:, 2]
lowest = comm.allreduce(heights.min(initial=np.inf), op=MPI.MIN)


def first_contact(change):
    return heights[change.point] == lowest and change.before == 0


control = StepControl(kinks="batched")
with Follower(system, control, gamma_scale=1.0, locate=first_contact) as follower:
    start = follower.start(system.create_vector(), 0.0)
    branch = follower.run(start, gamma_range=(0.0, 1.0))

# ## Results
#
# Until it touches, the body moves rigidly: the first contact is at $\gamma = $ gap/lowering plus
# the small initial height of the lowest node.

say = io.Report(comm)
forces = {"sum_rn": records.total("rn"), "sum_rt": records.total("rt")}
journal = records.journal_of(system, [branch], forces)
along = journal.columns()
events = [special for special in branch.special if special.changes]
contact_at = min(special.gamma for special in events)
exact = (gap + lowest) / lowered
say(f"first contact at gamma = {contact_at:.10f}, closed form {exact:.10f}")
say(f"{sum(len(special.changes) for special in events)} changes of status")
slips = along["gamma"][np.flatnonzero(along["stick"])[-1]]
say(f"the last point sticks up to gamma = {slips:.4f}")
F = abs(along["sum_rt"][-1]) / along["sum_rn"][-1]
say(f"shear over normal force at the end {F:.4f}; the friction coefficient is {friction:g}")

folder = io.output_folder(comm, "output/3d_branch")
if comm.rank == 0:
    labels = {"sum_rn": "normal force", "sum_rt": "tangential force"}
    plot.draw_diagram(folder / "branch.png", journal, labels)
partial_slip = branch.points[(along["stick"] * along["slip"]).argmax()]
system.result_at(partial_slip)
title = f"gamma = {partial_slip.gamma:.3f}"
plot.picture_of_contact(folder / "contact.png", problem, title=title)
