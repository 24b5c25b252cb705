# SPDX-License-Identifier: LGPL-3.0-or-later
# # The branch of a meshed body through every fold, on disk
#
# This demo illustrates how to:
#
# - follow the branch of solutions of a body meshed by gmsh as its load changes;
# - keep the branch on disk (`BranchRecord`), so that a killed run can be resumed;
# - list all solutions of the branch at one load (`points_at`).
#
# The body is a V of two arms, one vertical and one inclined, both clamped at their far ends. Its
# tip rests on a rigid floor. The body force changes from $(0, -6)$ at $\gamma = 0$ to $(-14, -6)$
# at $\gamma = 1$.

import shutil

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

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
from dolfinx_contact.continuation import Branch, follow, points_at
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import draw_polygon, mesh_from_gmsh
from dolfinx_contact.records import leftmost, total

comm = MPI.COMM_WORLD
size = 0.06  # of the cells
friction = 1.5
corners = [(0, 0), (0.35, 0), (1.1, 1), (0.85, 1), (0.25, 0.25), (0.25, 1), (0, 1)]
sides = {"contact": [0], "dirichlet": [2, 5]}  # edges of the polygon in each group

# ## The problem
#
# `draw_polygon` draws a polygon and names groups of its edges. Any mesh with these groups can be
# read instead (`meshing.read_mesh`).

body = mesh_from_gmsh(
    comm, lambda: draw_polygon(corners, size, sides), dim=2, groups=("dirichlet", "contact")
)
V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
gamma = fem.Constant(body.mesh, 0.0)
first = fem.Constant(body.mesh, (0.0, -6.0))
last = fem.Constant(body.mesh, (-14.0, -6.0))
force = (1 - gamma) * first + gamma * last
energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx - ufl.dot(force, u) * ufl.dx
clamped = fem.dirichletbc(np.zeros(2), body.dofs(V, "dirichlet"), V)
floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
surface = ContactSurface(u, body, tag="contact", obstacle=floor, law=Coulomb(friction))
problem = ContactProblem(energy, u, [surface], bcs=[clamped])
system = ParametricContact(problem, gamma)

# ## The branch, with a record
#
# Each accepted point is written before the next one is computed. With `resume=True` and
# `record.go_on()` a run that was killed continues where it stopped.

problem.solve()
x = system.create_vector()
problem.write(x)
outputs = {
    "ut_left": leftmost("ut"),
    "un_left": leftmost("un"),
    "sum_rt": total("rt"),
    "sum_rn": total("rn"),
}
folder = io.output_folder(comm, "output/followed_mesh")
if comm.rank == 0:
    shutil.rmtree(folder / "record", ignore_errors=True)
comm.barrier()
with records.BranchRecord(folder / "record", system, outputs, every=1) as record:
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0), record=record)
    journal = record.journal
say = io.Report(comm)
for s in branch.special:
    say(f"{s.kind:11s} gamma {s.gamma:.12f}")
say(f"{len(branch.points)} points: {branch.reason}")

# ## All solutions of the branch at one load
#
# Between two folds the branch passes the same load three times.

folds = [special.gamma for special in branch.folds]
say(f"folds at gamma = {[round(fold, 8) for fold in folds]}")
middle = sum(folds) / len(folds) if folds else 1.0
points = points_at(system, branch, middle, gamma_range=(0.0, 1.0))
rows = records.journal_of(system, [Branch(points)], outputs).rows()
for row in rows:
    values = ", ".join(f"{name} = {row[name]:.6f}" for name in outputs)
    say(f"gamma = {middle:.6f}: {row['status']}, {values}")

# Each of them is a solution: the violation of the contact law is at the level of round-off.

violations = [system.result_at(point).kkt_violation for point in points]
say(f"largest violation of the contact law {max(violations):.1e}")

if comm.rank == 0:
    labels = {"ut_left": "$u_t$ of the leftmost contact point"}
    plot.draw_diagram(folder / "branch.png", journal, labels)
