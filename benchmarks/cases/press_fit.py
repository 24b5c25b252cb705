# SPDX-License-Identifier: LGPL-3.0-or-later
"""A ring on a hub, drawn or given overlap.

Reference: Lamé. `demos/demo_press_fit.py` explains the problem.
"""

from mpi4py import MPI

import gmsh
import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

RADII = {"hub": (15.0, 25.0), "ring": (25.0, 40.0)}
CROSS = [(1, 0), (0, 1), (-1, 0), (0, -1)]
YOUNG = {"hub": 70e3, "ring": 210e3}
NU = {"hub": 0.33, "ring": 0.3}


def arguments(argv=None):
    parser = ScriptParser("A press fit", output="output/press_fit", n=12, friction=0.2)
    add = parser.add_argument
    positive = number(above=0)
    add("--ratio", type=positive, default=1.0, help="times as many cells around in the ring")
    add("--overlap", type=positive, default=0.02, help="of the radii")
    add("--turn", type=number(least=0), default=0.01, help="of the hub, radians")
    add("--drawn", action="store_true", help="draw the overlap, and take the gap of the geometry")
    args = parser.parse(argv)
    if args.drawn and args.ratio != 1.0:
        parser.error("--drawn is for matching nodes: its ratio is 1")
    return args


def lame(overlap):
    """The pressure of the joint."""
    a, c = RADII["hub"]
    b = RADII["ring"][1]
    nu_hub = NU["hub"]
    nu_ring = NU["ring"]
    hub = (1 - nu_hub**2) * (c**2 + a**2) / (c**2 - a**2) - nu_hub * (1 + nu_hub)
    ring = (1 - nu_ring**2) * (b**2 + c**2) / (b**2 - c**2) + nu_ring * (1 + nu_ring)
    hub_gives = c * hub / YOUNG["hub"]
    ring_gives = c * ring / YOUNG["ring"]
    return overlap / (hub_gives + ring_gives)


def draw_body(name, radii, n, centre):
    """The hub or the ring between two radii, with n cells on a quarter."""
    geo = gmsh.model.geo
    thickness = np.diff(RADII[name])[0]
    layers = round(n * thickness / 39)
    corners = []
    arcs = []
    for r in radii:
        points = [geo.addPoint(r * x, r * y, 0) for x, y in CROSS]
        corners.append(points)
    for points in corners:
        quarters = [geo.addCircleArc(points[k - 1], centre, points[k]) for k in range(4)]
        arcs.append(quarters)
    inner, outer = arcs
    spokes = []
    for ends in zip(*corners, strict=True):
        spokes.append(geo.addLine(*ends))
    for arc in inner + outer:
        geo.mesh.setTransfiniteCurve(arc, n + 1)
    for spoke in spokes:
        geo.mesh.setTransfiniteCurve(spoke, layers + 1)

    sectors = []
    for k in range(4):
        loop = geo.addCurveLoop([spokes[k - 1], outer[k], -spokes[k], -inner[k]])
        sector = geo.addPlaneSurface([loop])
        sectors.append(sector)
        geo.mesh.setTransfiniteSurface(sector)
        geo.mesh.setRecombine(2, sector)
    geo.synchronize()
    face = outer if name == "hub" else inner
    gmsh.model.addPhysicalGroup(2, sectors, name=name)
    gmsh.model.addPhysicalGroup(1, face, name=f"{name} face")


def draw(args):
    centre = gmsh.model.geo.addPoint(0, 0, 0)
    half = 0.5 * args.overlap * args.drawn
    hub = np.add(RADII["hub"], (0, half))
    ring = np.add(RADII["ring"], (-half, 0))
    draw_body("hub", hub, args.n, centre)
    draw_body("ring", ring, round(args.ratio * args.n), centre)
    gmsh.model.mesh.generate(2)


def problem(args, turn, comm):
    body = mesh_from_gmsh(comm, lambda: draw(args))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)

    def held(i, point, value):
        """The displacement along axis i of the node at a point."""

        def here(x):
            return np.isclose(x[:2].T, point).all(axis=1)

        W = V.sub(i)
        node = mesh.locate_entities_boundary(body.mesh, 0, here)
        dofs = fem.locate_dofs_topological(W, 0, node)
        return fem.dirichletbc(value, dofs, W)

    energy = 0
    bcs = []
    inside = RADII["hub"][0]
    outside = RADII["ring"][1]
    for name, r, turned in (("hub", inside, turn), ("ring", outside, 0.0)):
        material = LinearElastic.from_young(YOUNG[name], NU[name])
        energy += material.energy(u) * dx(body.tag(name))
        for x, y in CROSS:
            point = (r * x, r * y)
            if y == 0:
                bcs.append(held(1, point, turned * r * x))
            else:
                bcs.append(held(0, point, -turned * r * y))

    sides = dict(slave="hub face", master="ring face")
    law = Coulomb(args.friction)
    gap = None if args.drawn else -args.overlap
    pair = ContactPair(u, body, **sides, law=law, gap=gap, interference=True)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    c = RADII["hub"][1]
    p = lame(args.overlap)
    found = {"pressure_closed_form": p}
    found["torque_closed_form"] = 2 * np.pi * c**2 * args.friction * p
    for turn in (0.0, args.turn):
        bodies = problem(args, turn, comm)
        result = bodies.solve()
        table = result.tables["contact"]
        x = table.x[:, 0]
        y = table.x[:, 1]
        moments = y * table.force[:, 0] - x * table.force[:, 1]
        found["pressure"] = np.average(table.pressure, weights=table.area)
        found["axial_force"] = args.friction * table.rn.sum()
        found["torque"] = np.sum(moments)
        say.result(result)
    words = [f"{name} {value:.6g}" for name, value in found.items()]
    say(", ".join(words))
    plot.picture_of_body(folder / "body.png", bodies)
    plot.picture_of_contact(folder / "contact.png", bodies)
    io.write_contact_table(comm, folder, [table])
    summary = result.summary() | found
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
