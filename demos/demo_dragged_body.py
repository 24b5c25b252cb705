# SPDX-License-Identifier: LGPL-3.0-or-later
# # A rubber rocker dragged over a floor, and over an elastic base
#
# This demo illustrates how to:
#
# - mesh one or two bodies in gmsh and use its physical groups;
# - solve a 3D problem with a rigid floor (`ContactSurface`) and with a second body (`ContactPair`);
# - follow the load in steps (`QuasiStatic`);
# - write fields for ParaView, and draw the deformed body and the contact face.
#
# The rocker is a block that lies on a round face of radius 1. Its flat top is pressed down and
# moved sideways like a rigid plate. The face sticks to the floor where the pressure is high. Around
# this zone the shear reaches the bound $F p$ and the face slips; farther away it is open. Cattaneo
# (1938) and Mindlin (1949) solved the like for two similar bodies, whose normal load causes no
# slip. Here the floor is rigid, so that the face slips a little already when it is pressed.
#
# At each contact point, the gap $u_n$ and the pressure $p$ satisfy the conditions of Signorini, and
# the slip $u_t$ and the shear $t$ on the body the law of Coulomb:
#
# $$u_n \ge 0,\quad p \ge 0,\quad u_n\,p = 0,\qquad
# |t| \le F p,\quad t = -F p\,\frac{u_t}{|u_t|}\ \text{ if }\ u_t \ne 0.$$
#
# They hold exactly at every point, without a penalty. `solve` uses the static law, in which $u_t$
# is the total slip since the undeformed state. In a history, $u_t$ is the slip in each step.
#
# The demo runs on any number of MPI ranks: `mpirun -n 2 python3 demo_dragged_body.py`.

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

comm = MPI.COMM_WORLD
size_on_floor = 0.07  # of the cells at the contact
size_on_base = 0.15
friction = 0.4
poisson = 0.4
young = 10.0  # of the rocker
young_of_base = 8.0
radius, half_length, height, width = 1.0, 0.8, 0.8, 1.0  # of the rocker
base_half_length, base_depth = 1.3, 0.6

# ## The meshes
#
# The section of the rocker, an arc and three lines, is extruded across. The base is a box below it,
# in the same mesh but without common nodes. Cells grow with the distance from the contact.
#
# The physical groups name the parts: the volumes `rocker` and `base`, and the surfaces `contact`
# (the round face), `top`, `face` (the upper side of the base) and `bottom`. They are used below
# instead of coordinates. A mesh from a file needs the same names (`meshing.read_mesh`).


def draw_rocker(size):
    occ = gmsh.model.occ
    rise = radius - np.sqrt(radius**2 - half_length**2)
    corners = [(-half_length, rise), (half_length, rise), (half_length, height)]
    left, right, top_right, top_left = [
        occ.addPoint(x, 0, z) for x, z in [*corners, (-half_length, height)]
    ]
    lowest = occ.addPoint(0, 0, 0)
    arc = occ.addCircleArc(left, lowest, right, center=False)
    occ.remove([(0, lowest)])
    lines = [occ.addLine(right, top_right), occ.addLine(top_right, top_left)]
    lines.append(occ.addLine(top_left, left))
    section = occ.addPlaneSurface([occ.addCurveLoop([arc, *lines])])
    layers = round(width / (1.4 * size))
    # Extruding returns the opposite section, the volume, and one face for each curve.
    _, volume, contact, _, top, _ = occ.extrude([(2, section)], 0, width, 0, numElements=[layers])
    occ.synchronize()
    for name, (dim, tag) in {"rocker": volume, "contact": contact, "top": top}.items():
        gmsh.model.addPhysicalGroup(dim, [tag], name=name)


def draw_base():
    occ = gmsh.model.occ
    box = occ.addBox(-base_half_length, 0, -base_depth, 2 * base_half_length, width, base_depth)
    occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [box], name="base")
    for _, face in gmsh.model.getBoundary([(3, box)], oriented=False):
        z = round(occ.getCenterOfMass(2, face)[2], 6)
        if z in (0.0, -base_depth):
            gmsh.model.addPhysicalGroup(2, [face], name="face" if z == 0.0 else "bottom")


def draw(size, with_base):
    draw_rocker(size)
    if with_base:
        draw_base()
    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", f"{size} * (1 + 2 * Sqrt(x^2 + z^2))")
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    for option in ("MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.model.mesh.generate(3)


# ## On a rigid floor
#
# `mesh_from_gmsh` calls the drawing function on rank 0 and distributes the mesh. `body.dofs` gives
# the degrees of freedom on a group. The `monitor` reports the residuals of Newton's method: `force`
# is the equilibrium of the body, `constraint` the gap and stick conditions, `cone` the friction
# bound. The number of points that change their status falls to zero before the last iterations,
# which converge quadratically.

say = io.Report(comm)
folder = io.output_folder(comm, "output/dragged_body")
body = mesh_from_gmsh(comm, lambda: draw(size_on_floor, False))
V = fem.functionspace(body.mesh, ("Lagrange", 1, (3,)))
u = fem.Function(V, name="displacement")
motion = np.array([0.08, 0.0, -0.12])
moved = fem.Constant(body.mesh, motion)
held = fem.dirichletbc(moved, body.dofs(V, "top"), V)
floor = HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
surface = ContactSurface(u, body, tag="contact", obstacle=floor, law=Coulomb(friction))
material = LinearElastic.from_young(young, poisson)
problem = ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[held])
result = problem.solve(monitor=say.newton)
say.result(result)

# The floor carries the whole load: its force is opposite to the reaction of the held top. The
# shear force is below the bound $F$ times the normal force, since a part of the face sticks.

force = result.resultants["contact"]
imbalance = np.linalg.norm(force + result.support) / np.linalg.norm(force)
say(f"force of the floor {force}, imbalance {imbalance:.1e}")

# The fields open in ParaView with the script `paraview.py` that is written next to them.
#
# `body.png` shows the deformed rocker, whose von Mises stress is largest at the contact zone.
# `contact.png` shows the pressure on the face, and its status with arrows of the shear. Look for
# three things: the stick zone lies where the pressure is high; the arrows point to the left,
# against the motion; and near both edges of the face they turn inwards, because the body bulges
# sideways under pressure and friction opposes this slip too.

stress = material.full_stress(u)
io.write_fields(folder, problem, stress=stress)
io.write_contact_table(comm, folder, result.tables.values())
above = np.array([0.0, 0.5 * width, 1.25 * height])
arrows = {"press and drag": (above, motion)}
plot.picture_of_body(folder / "body.png", problem, stress=stress, arrows=arrows)
title = f"Contact face, friction coefficient {friction:g}"
plot.picture_of_contact(folder / "contact.png", problem, title=title)

# ## The path of the load
#
# Most points come into contact under the load. In the static law, their motion before contact
# counts as slip, which the warning `growth` reports. The static law also ignores whether the rocker
# is pressed before it is dragged. A history in ten steps presses it first and drags it afterwards.
# Here the two results nearly agree: 68 to 70 points slip, and the shear forces differ by 1.4 %. If
# the top is pressed and dragged at the same time, 62 points stick instead of about 30, and the
# shear force is 5 % smaller.


def load(t):
    moved.value = motion * (max(t - 1.0, 0.0), 0.0, min(t, 1.0))


load(0.0)
problem.solve()
history = QuasiStatic(problem, load).run(np.linspace(0.0, 2.0, 11))
last = history.steps[-1].result
dragged = last.resultants["contact"]
say(f"pressed, then dragged: force {dragged}, {last.counts['stick']} points stick")

# ## On an elastic base
#
# The base yields to pressure and shear. A mortar method couples the faces, whose meshes do not
# match. One material with a Young's modulus that is constant in each body serves both. The contact
# normal points downwards, from the rocker (slave) to the base (master). The faces turn by some
# degrees, which a warning reports: the pair assumes small sliding.

pair_of_bodies = mesh_from_gmsh(comm, lambda: draw(size_on_base, True))
W = fem.functionspace(pair_of_bodies.mesh, ("Lagrange", 1, (3,)))
v = fem.Function(W, name="displacement")
modulus = fem.Function(fem.functionspace(pair_of_bodies.mesh, ("DG", 0)))
modulus.x.array[:] = young
modulus.x.array[pair_of_bodies.cell_tags.find(pair_of_bodies.tag("base"))] = young_of_base
bcs = [
    fem.dirichletbc(motion, pair_of_bodies.dofs(W, "top"), W),
    fem.dirichletbc(np.zeros(3), pair_of_bodies.dofs(W, "bottom"), W),
]
contact = ContactPair(
    v, pair_of_bodies, slave="contact", master="face", normal=(0, 0, -1), law=Coulomb(friction)
)
mu = modulus / (2 * (1 + poisson))
two_materials = LinearElastic(2 * mu * poisson / (1 - 2 * poisson), mu)
on_base = ContactProblem(two_materials.energy(v) * ufl.dx, v, [contact], bcs=bcs)
result_on_base = on_base.solve()
say.result(result_on_base)
on_rocker = result_on_base.resultants["contact"]
say(f"force of the base {on_rocker}; the stiffer the base, the closer it is to that of the floor")
say(f"imbalance of the forces on both faces {result_on_base.pairs['contact'].imbalance:.1e}")
plot.picture_of_body(folder / "base.png", on_base, stress=two_materials.full_stress(v))
