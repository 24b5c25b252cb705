# SPDX-License-Identifier: LGPL-3.0-or-later
# # A closed crack that slips
#
# This demo illustrates how to:
#
# - draw a crack in gmsh and double the nodes on it (`meshing.crack`);
# - let its faces press on each other and slip with friction;
# - improve a result by extrapolation from two meshes.
#
# A block with a short crack of half length 1, inclined by 35 degrees, is compressed and sheared at
# its boundary as by a uniform stress (plane strain). With the pressure $p$ and the shear $t > F p$
# on the plane of the crack, its faces slip by
#
# $$\delta(r) = \frac{4 (1 - \nu^2)}{E}\,(t - F p)\, \sqrt{1 - r^2}$$
#
# (Tada, Paris and Irwin, 2000). The root at the tip causes an error of the order of the cell size.
# The same problem in 3D, with a disc, is `benchmarks/cases/crack.py`.

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack, mesh_from_gmsh

comm = MPI.COMM_WORLD
sizes = [0.1, 0.05]  # of the cells at the tips
half_edge = 20.0  # of the block
friction, young, poisson = 0.3, 1000.0, 0.3
dip = np.radians(35.0)
stress = np.array([[0.0, 0.3], [0.3, -1.0]])  # far from the crack

# ## The load on the crack

n = np.array([np.sin(dip), np.cos(dip)])
traction = stress @ n
p = -n @ traction
excess = np.linalg.norm(traction + p * n) - friction * p
largest_slip = 4 * (1 - poisson**2) / young * excess

# ## The mesh
#
# The crack is a line inside the block. gmsh meshes both with common nodes; cells grow with the
# distance from the tips.


def draw(size):
    occ = gmsh.model.occ
    field = gmsh.model.mesh.field
    x, y = np.cos(dip), np.sin(dip)
    left, right = occ.addPoint(-x, y, 0), occ.addPoint(x, -y, 0)
    block = occ.addRectangle(-half_edge, -half_edge, 0, 2 * half_edge, 2 * half_edge)
    _, parts = occ.fragment([(2, block)], [(1, occ.addLine(left, right))])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [parts[0][0][1]], name="block")
    gmsh.model.addPhysicalGroup(1, [parts[1][0][1]], name="fault")
    tips = [abs(tag) for _, tag in gmsh.model.getBoundary(parts[1])]
    distance, size_field = field.add("Distance"), field.add("MathEval")
    field.setNumbers(distance, "PointsList", tips)
    field.setString(size_field, "F", f"{size} * (1 + 3 * F{distance})")
    field.setAsBackgroundMesh(size_field)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(2)


# ## The problem
#
# `crack` doubles the nodes of the group `fault`, except at the tips, and names the second face
# `fault_opposite`. The boundary follows the uniform strain of the stress far away.


def solved(size):
    body = crack(mesh_from_gmsh(comm, lambda: draw(size)), ["fault"])
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    strain = (1 + poisson) / young * (stress - poisson * np.trace(stress) * np.eye(2))
    far = fem.Function(V)
    far.interpolate(lambda x: strain @ x[:2])
    sides = fem.locate_dofs_geometrical(V, lambda x: np.isclose(abs(x).max(axis=0), half_edge))
    law = Coulomb(friction)
    fault = ContactPair(u, body, slave="fault", master="fault_opposite", law=law)
    energy = LinearElastic.from_young(young, poisson).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [fault], bcs=[fem.dirichletbc(far, sides)])
    return problem, problem.solve().tables["contact"]


# ## Comparison
#
# The error of the mean slip is proportional to the cell size. A line through the errors of two
# meshes gives the error for cells of size zero.

say = io.Report(comm)
errors = []
for size in sizes:
    problem, table = solved(size)
    r = np.linalg.norm(table.x, axis=1)
    slip = np.linalg.norm(table.ut, axis=1)
    exact = largest_slip * np.sqrt(np.maximum(1 - r**2, 0))
    errors.append(float(table.area @ slip / (table.area @ exact) - 1))
    say(f"cells of {size:g}: largest slip {slip.max():.6f}, closed form {largest_slip:.6f}")
    say(f"  error of the mean slip {errors[-1]:.2%}")
coarse, fine = sizes
extrapolated = (coarse * errors[1] - fine * errors[0]) / (coarse - fine)
say(f"error after extrapolation {extrapolated:.2%}")

folder = io.output_folder(comm, "output/crack")
if comm.rank == 0:
    order = np.argsort(table.x[:, 0])
    along = np.sign(table.x[:, 0]) * r
    curves = {"cells of 0.05": (along[order], slip[order])}
    dotted = {"closed form": (along[order], exact[order])}
    plot.draw_curves(folder / "slip.png", curves, dotted=dotted, labels=("r", "slip"))
