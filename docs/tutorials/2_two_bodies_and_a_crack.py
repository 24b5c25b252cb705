# SPDX-License-Identifier: LGPL-3.0-or-later
# # Two bodies and a crack
#
# The floor of the first tutorial was rigid. Now it is an elastic body with its own mesh, which
# contains a crack with friction between its sides. Both contacts are *pairs* of faces, which are
# used like other contact surfaces.

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, plot
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack, mesh_from_gmsh

# ## One mesh with two bodies
#
# `mesh_from_gmsh` calls a drawing function on rank 0 and distributes the mesh, without a file. The
# base is a rectangle with an inner line that will become the crack; the block stands on it. The
# bodies have separate points where they meet, so that their meshes need not match.


def draw():
    occ = gmsh.model.occ
    base = occ.addRectangle(-2, -2, 0, 4, 2)
    block = occ.addRectangle(-0.5, 0, 0, 1, 1)
    ends = [occ.addPoint(-0.9, -1.1, 0), occ.addPoint(0.5, -0.5, 0)]
    fault = occ.addLine(*ends)
    _, parts = occ.fragment([(2, base)], [(1, fault)])
    occ.synchronize()
    model = gmsh.model
    model.addPhysicalGroup(2, [tag for _, tag in parts[0]], name="base")
    model.addPhysicalGroup(2, [block], name="block")
    model.addPhysicalGroup(1, [tag for _, tag in parts[1]], name="fault")
    curves = {}  # all curves of a name go to one group
    for (dim, tag), name in [(parts[0][0], "base"), ((2, block), "block")]:
        for _, curve in model.getBoundary([(dim, tag)], oriented=False):
            _x, y, _ = occ.getCenterOfMass(1, curve)
            places = {("base", 0): "seat", ("base", -2): "ground"}
            places |= {("block", 0): "sole", ("block", 1): "top"}
            if (name, round(y, 6)) in places:
                curves.setdefault(places[name, round(y, 6)], []).append(curve)
    for group, tags in curves.items():
        model.addPhysicalGroup(1, tags, name=group)
    model.mesh.setSize(model.getEntities(0), 0.12)
    model.mesh.setSize(model.getBoundary([(2, block)], recursive=True), 0.07)
    model.mesh.generate(2)


body = mesh_from_gmsh(MPI.COMM_WORLD, draw)

# ## The crack
#
# `crack` divides the mesh along the line and names the second side `fault_opposite`,
# after the first one. At the two ends, inside the body, both sides keep their common nodes.

body = crack(body, ["fault"])
print(sorted(body.names))

# ## The problem
#
# The cell tags give each body its own material. Pressures and statuses belong to the nodes of the
# slave face of a pair, which should be the finer one.


def made(friction):
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
    soft = LinearElastic.from_young(1000.0, 0.3)
    hard = LinearElastic.from_young(3000.0, 0.3)
    energy = soft.energy(u) * dx(body.tag("base")) + hard.energy(u) * dx(body.tag("block"))
    joint = ContactPair(u, body, slave="sole", master="seat", law=Coulomb(0.4), name="joint")
    fault = ContactPair(
        u, body, slave="fault", master="fault_opposite", law=Coulomb(friction), name="fault"
    )
    bcs = [
        fem.dirichletbc(np.zeros(2), body.dofs(V, "ground"), V),
        fem.dirichletbc(np.array([0.01, -0.04]), body.dofs(V, "top"), V),
    ]
    stress = {body.tag("base"): soft.full_stress(u), body.tag("block"): hard.full_stress(u)}
    return ContactProblem(energy, u, [joint, fault], bcs=bcs), stress


problem, stress = made(friction=0.2)
result = problem.solve()
for name, table in result.tables.items():
    print(f"{name}: {table.status}, force {result.resultants[name].round(3)}")

# ## Checks
#
# The forces on both faces of a pair are opposite up to round-off, although the meshes do not match.
# The reactions of the two Dirichlet conditions, `result.supports`, are opposite as well. The shear
# in the base makes the sides of the crack slip. The slip decreases with friction and vanishes for a
# large coefficient.

balance = result.pairs["joint"]
print(f"on the block {balance.slave.round(3)}, on the base {balance.master.round(3)}")
print(f"off by {balance.imbalance:.1e} of all forces, moments by {balance.moment:.1e}")
assert balance.imbalance < 1e-10
ground, top = result.supports
print(f"reaction of the ground {ground.round(3)}, of the top {top.round(3)}")
assert np.allclose(ground + top, 0.0, atol=1e-8)
assert result.imbalance < 1e-9

slips = []
for friction in (0.0, 0.2, 2.0):
    cracked, _ = made(friction)
    found = cracked.solve().tables["fault"]
    slips.append(np.abs(found.along(found.ut)).max())
    print(f"F = {friction}: largest slip of the crack {slips[-1]:.2e}, {found.status}")
assert slips[0] > slips[1] > 1e-4
assert slips[2] < 1e-12

# ## Pictures

plot.picture_of_body("bodies.png", problem, stress=stress, scale=5.0)
plot.picture_of_contact("joint.png", problem, surface=problem.surfaces[0])
