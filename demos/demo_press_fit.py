# SPDX-License-Identifier: LGPL-3.0-or-later
# # A ring pressed on a hub
#
# This demo illustrates how to:
#
# - press two bodies together by an overlap (`gap`, `interference=True`);
# - turn one body inside the other until friction gives way, and measure the torque.
#
# A hub of aluminium is larger than the bore of the steel ring around it by the overlap $\delta$ of
# the radii; plane strain, mm and MPa. Both are held at four nodes, which may move radially. With
# the radii $a < c < b$, the pressure of the joint is Lamé's,
#
# $$\frac{\delta}{p} = \frac{c}{E_1}\left[(1 - \nu_1^2)\frac{c^2 + a^2}{c^2 - a^2}
#   - \nu_1 (1 + \nu_1)\right]
# + \frac{c}{E_2}\left[(1 - \nu_2^2)\frac{b^2 + c^2}{b^2 - c^2} + \nu_2 (1 + \nu_2)\right],$$
#
# and the hub turns under the torque $2\pi c^2 F p$ per length.

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

comm = MPI.COMM_WORLD
n = {"hub": 12, "ring": 12}  # cells on a quarter of the circumference
radii = {"hub": (15.0, 25.0), "ring": (25.0, 40.0)}
young = {"hub": 70e3, "ring": 210e3}
poisson = {"hub": 0.33, "ring": 0.3}
overlap, friction, turn = 0.02, 0.2, 0.01
cross = [(1, 0), (0, 1), (-1, 0), (0, -1)]

# ## The meshes
#
# Each body consists of four sectors of quadrilaterals. The overlap is not drawn: it is given as a
# negative gap, which is exact for any pair of meshes.


def draw_body(name, centre):
    geo = gmsh.model.geo
    corners = [[geo.addPoint(r * x, r * y, 0) for x, y in cross] for r in radii[name]]
    inner, outer = [
        [geo.addCircleArc(points[k - 1], centre, points[k]) for k in range(4)] for points in corners
    ]
    spokes = [geo.addLine(*ends) for ends in zip(*corners, strict=True)]
    layers = round(n[name] * np.diff(radii[name])[0] / 39)
    for lines, cells in ((inner + outer, n[name]), (spokes, layers)):
        for curve in lines:
            geo.mesh.setTransfiniteCurve(curve, cells + 1)
    sectors = []
    for k in range(4):
        loop = geo.addCurveLoop([spokes[k - 1], outer[k], -spokes[k], -inner[k]])
        sectors.append(geo.addPlaneSurface([loop]))
        geo.mesh.setTransfiniteSurface(sectors[-1])
        geo.mesh.setRecombine(2, sectors[-1])
    geo.synchronize()
    gmsh.model.addPhysicalGroup(2, sectors, name=name)
    gmsh.model.addPhysicalGroup(1, outer if name == "hub" else inner, name=f"{name} face")


def draw():
    centre = gmsh.model.geo.addPoint(0, 0, 0)
    for name in radii:
        draw_body(name, centre)
    gmsh.model.mesh.generate(2)


# ## The problem
#
# The four nodes of the hub are displaced as by a rotation, those of the ring are held; all of them
# are free in the radial direction.

body = mesh_from_gmsh(comm, draw)
V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
u = fem.Function(V, name="displacement")
dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
energy = 0
bcs = []
for name, r in (("hub", radii["hub"][0]), ("ring", radii["ring"][1])):
    energy += LinearElastic.from_young(young[name], poisson[name]).energy(u) * dx(body.tag(name))
    for x, y in cross:
        W = V.sub(1 if y == 0 else 0)
        node = mesh.locate_entities_boundary(
            body.mesh, 0, lambda z, x=r * x, y=r * y: np.isclose(z[0], x) & np.isclose(z[1], y)
        )
        value = fem.Constant(body.mesh, 0.0)
        if name == "hub":
            value.value = turn * r * (x if y == 0 else -y)
        bcs.append(fem.dirichletbc(value, fem.locate_dofs_topological(W, 0, node), W))
pair = ContactPair(
    u,
    body,
    slave="hub face",
    master="ring face",
    law=Coulomb(friction),
    gap=-overlap,
    interference=True,
)
problem = ContactProblem(energy, u, [pair], bcs=bcs)
result = problem.solve()

# ## Comparison

c = radii["hub"][1]
compliance = 0.0
for name, r, sign in (("hub", radii["hub"][0], -1), ("ring", radii["ring"][1], 1)):
    nu = poisson[name]
    shape = (r**2 + c**2) / abs(r**2 - c**2)
    compliance += c / young[name] * ((1 - nu**2) * shape + sign * nu * (1 + nu))
lame_pressure = overlap / compliance
table = result.tables["contact"]
pressure = float(np.average(table.pressure, weights=table.area))
x, y = table.x[:, :2].T
torque = float(abs(np.sum(x * table.force[:, 1] - y * table.force[:, 0])))
exact_torque = 2 * np.pi * c**2 * friction * lame_pressure
say = io.Report(comm)
say.result(result)
say(f"pressure {pressure:.4f}, Lamé {lame_pressure:.4f} MPa")
say(f"torque {torque:.1f}, closed form {exact_torque:.1f} N mm/mm")

folder = io.output_folder(comm, "output/press_fit")
plot.picture_of_body(folder / "body.png", problem)
plot.picture_of_contact(folder / "contact.png", problem)
