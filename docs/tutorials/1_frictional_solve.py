# SPDX-License-Identifier: LGPL-3.0-or-later
# # A frictional solve from a gmsh file
#
# A rubber foot with a round face is pressed onto a floor and dragged along it. The tutorial draws
# it with gmsh, reads the mesh file, solves the Signorini-Coulomb problem, evaluates forces and the
# sticking and slipping points, draws pictures, and follows the motion of the foot in steps. Lengths
# are in mm and forces in N, so that stresses are in MPa. It needs the extras `gmsh` and `pictures`.
#
# The problem is to find $u$ in equilibrium with its loads such that at every point of the contact
# surface, with the gap $g$, the pressure $p$, the tangential displacement $u_t$ and the shear $q$
# on the body,
#
# $$g \ge 0, \quad p \ge 0, \quad g \, p = 0,$$
#
# $$|q| \le F p, \quad q = -F p \, \frac{u_t}{|u_t|} \ \text{ where } u_t \ne 0.$$
#
# The first line is Signorini's condition: no penetration, no tension, no pressure across a gap. The
# second line is the static law of Coulomb: friction opposes the total slip. Under a face whose
# contact zone grows with the load, a history is more accurate (last section).

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import read_mesh

# ## The mesh file
#
# The body is the lower part of a ball of radius 1, cut off at the height 0.6. Physical groups name
# the parts of the mesh: one for the volume, without which gmsh writes no cells, one for the top,
# and one for the round face that may touch the floor. Cells are small near the expected contact.


def draw(file):
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    ball = occ.addSphere(0, 0, 1, 1)
    box = occ.addBox(-1, -1, 0, 2, 2, 0.6)
    occ.intersect([(3, ball)], [(3, box)])
    occ.synchronize()
    (body,) = gmsh.model.getEntities(3)
    faces = [tag for _, tag in gmsh.model.getBoundary([body], oriented=False)]
    top = [face for face in faces if occ.getCenterOfMass(2, face)[2] > 0.59]
    gmsh.model.addPhysicalGroup(3, [body[1]], name="body")
    gmsh.model.addPhysicalGroup(2, top, name="top")
    gmsh.model.addPhysicalGroup(2, [f for f in faces if f not in top], name="contact")
    foot = gmsh.model.mesh.field.add("Ball")
    for name, value in (("Radius", 0.3), ("Thickness", 0.3), ("VIn", 0.045), ("VOut", 0.2)):
        gmsh.model.mesh.field.setNumber(foot, name, value)
    gmsh.model.mesh.field.setAsBackgroundMesh(foot)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(3)
    gmsh.write(file)
    gmsh.finalize()


comm = MPI.COMM_WORLD
if comm.rank == 0:
    draw("body.msh")
comm.barrier()
body = read_mesh(comm, "body.msh", groups=("top", "contact"))
print(f"{body.mesh.topology.index_map(3).size_global} cells, groups {sorted(body.names)}")

# ## The problem
#
# It consists of DOLFINx objects (a displacement, an energy in UFL, Dirichlet conditions) and of a
# contact surface with an obstacle and a law. The top is pressed down by 0.04 mm and moved sideways
# by 0.01 mm.

V = fem.functionspace(body.mesh, ("Lagrange", 1, (3,)))
u = fem.Function(V, name="displacement")
top = fem.Constant(body.mesh, (0.01, 0.0, -0.04))
bcs = [fem.dirichletbc(top, body.dofs(V, "top"), V)]
rubber = LinearElastic.from_young(6.0, 0.4)
floor = HalfSpace(point=(0, 0, 0), normal=(0, 0, 1))
contact = ContactSurface(u, body, tag="contact", obstacle=floor, law=Coulomb(0.4))
problem = ContactProblem(rubber.energy(u) * ufl.dx, u, [contact], bcs=bcs)

# ## The solution
#
# `solve` writes the solution to `u` and returns a result. No parameter has to be tuned: there is
# neither a penalty nor a regularisation. The printed result names the strategy that found the
# solution, the forces, and two measures of quality: the violation of the contact law and the
# imbalance of all forces on the body. Contact points with prescribed displacements, here at the
# edge of the top, are counted as "clamped".

result = problem.solve()
print(result)
force = result.resultants["contact"]
assert result.kkt_violation < 1e-8
assert np.allclose(force + result.support, 0.0, atol=1e-6 * np.linalg.norm(force))

# The shear force is at most $F$ times the normal force at every point, and therefore for the whole
# body:

table = result.tables["contact"]
shear = np.linalg.norm(table.rt, axis=1)
print(f"shear over pressure: {np.linalg.norm(force[:2]) / force[2]:.3f} of 0.4")
assert np.all(shear <= 0.4 * table.rn + 1e-6 * force[2])

# ## Pictures
#
# The pictures show the deformed body, cut in the middle and coloured by the von Mises stress, and
# the contact face with pressure and status. `io.write_fields` writes the same data for ParaView.

stress = rubber.full_stress(u)
plot.picture_of_body("body.png", problem, stress=stress, clip="-y")
plot.picture_of_contact("contact.png", problem)

# ## The path of the foot
#
# The log has the warning `growth`. `solve` uses the static law, in which friction opposes the total
# tangential displacement. Nearly all points of the round face came into contact under the load, and
# the static law counts their motion before contact as slip. In a history, friction opposes the slip
# in each step instead.
#
# The function `load` sets the data at a time. Here the foot is pressed until $t = 1$ and dragged by
# 0.04 mm until $t = 2$. More and more points slip. Finally all of them slip, and the shear force is
# $F$ times the normal force.


def load(t):
    top.value = (0.04 * max(t - 1.0, 0.0), 0.0, -0.04 * min(t, 1.0))


load(0.0)
problem.solve()
history = QuasiStatic(problem, load).run([0.0, 0.25, 0.5, 0.75, 1.0, 1.125, 1.25, 1.5, 2.0])
ratios = {}
for step in history.steps:
    f = step.result.resultants["contact"]
    ratios[step.time] = np.hypot(*f[:2]) / f[2]
    print(f"t = {step.time}: shear over pressure {ratios[step.time]:.3f}, {step.result.counts}")
assert ratios[1.0] < 0.01
assert np.isclose(ratios[2.0], 0.4, rtol=1e-3)

# The friction coefficient is a Constant, too: `contact.law.friction.value` may change between two
# solves. [The third tutorial](3_history_with_memory.py) continues with histories.
