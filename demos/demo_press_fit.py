# SPDX-License-Identifier: LGPL-3.0-or-later
# # A ring pressed on a hub
#
# This demo illustrates how to:
#
# - press bodies together by an overlap (`ContactPair(..., interference=True)`);
# - give the overlap as a number (`gap`), or draw it (`--drawn`), which is for matching nodes alone:
#   where they differ, the chords of the circles are off by their sagitta;
# - turn one body in the other until friction gives way, and measure the torque.
#
# A hub of aluminium is a little too large for the steel ring around it; plane strain, mm and MPa.
# Both are held by four nodes, which may move radially. The pressure p of the joint of radius c is
# Lame's. To turn the hub takes the torque 2 pi c^2 F p per length, to push it out 2 pi c F p.

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

RADII = {"hub": (15.0, 25.0), "ring": (25.0, 40.0)}
CROSS = [(1, 0), (0, 1), (-1, 0), (0, -1)]
YOUNG, NU = {"hub": 70e3, "ring": 210e3}, {"hub": 0.33, "ring": 0.3}


def arguments(argv=None):
    parser = ScriptParser("A press fit", output="output/press_fit", n=12, friction=0.2)
    add, positive = parser.add_argument, number(above=0)
    add("--ratio", type=positive, default=1.0, help="times as many cells around in the ring")
    add("--overlap", type=positive, default=0.02, help="of the radii")
    add("--turn", type=number(least=0), default=0.01, help="of the hub, radians")
    add("--drawn", action="store_true", help="draw the overlap, and take the gap of the geometry")
    return parser.parse(argv)


def lame(overlap):
    (a, c), b = RADII["hub"], RADII["ring"][1]
    hub = (1 - NU["hub"] ** 2) * (c**2 + a**2) / (c**2 - a**2) - NU["hub"] * (1 + NU["hub"])
    ring = (1 - NU["ring"] ** 2) * (b**2 + c**2) / (b**2 - c**2) + NU["ring"] * (1 + NU["ring"])
    return overlap / (c * hub / YOUNG["hub"] + c * ring / YOUNG["ring"])


# ## The bodies, of quarters that are made of quadrilaterals


def draw(args):
    geo = gmsh.model.geo
    centre, (a, b) = geo.addPoint(0, 0, 0), (0.5 * args.overlap * args.drawn * s for s in (1, -1))
    shifts = {"hub": ((0, a), args.n), "ring": ((b, 0), round(args.ratio * args.n))}
    for name, (shift, n) in shifts.items():
        radii, layers = np.add(RADII[name], shift), round(n * np.diff(RADII[name])[0] / 39)
        corners = [[geo.addPoint(r * x, r * y, 0) for x, y in CROSS] for r in radii]
        arcs = [[geo.addCircleArc(q[k - 1], centre, q[k]) for k in range(4)] for q in corners]
        spokes = [geo.addLine(*ends) for ends in zip(*corners, strict=True)]
        for curves, cells in ((arcs[0] + arcs[1], n), (spokes, layers)):
            for curve in curves:
                geo.mesh.setTransfiniteCurve(curve, cells + 1)
        sectors = []
        for k in range(4):
            loop = geo.addCurveLoop([spokes[k - 1], arcs[1][k], -spokes[k], -arcs[0][k]])
            sectors.append(geo.addPlaneSurface([loop]))
            geo.mesh.setTransfiniteSurface(sectors[k])
            geo.mesh.setRecombine(2, sectors[k])
        geo.synchronize()
        gmsh.model.addPhysicalGroup(2, sectors, name=name)
        gmsh.model.addPhysicalGroup(1, arcs[name == "hub"], name=f"{name} face")
    gmsh.model.mesh.generate(2)


def problem(args, turn, comm):
    body = mesh_from_gmsh(comm, lambda: draw(args))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u, energy, bcs = fem.Function(V, name="displacement"), 0, []
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
    for name, r, turned in (("hub", RADII["hub"][0], turn), ("ring", RADII["ring"][1], 0.0)):
        material = LinearElastic.from_young(YOUNG[name], NU[name])
        energy += material.energy(u) * dx(body.tag(name))
        for x, y in CROSS:
            i, value = (1, turned * r * x) if y == 0 else (0, -turned * r * y)
            at = mesh.locate_entities_boundary(
                body.mesh, 0, lambda z, p=(r * x, r * y): np.isclose(z[:2].T, p).all(axis=1)
            )
            dofs = fem.locate_dofs_topological(V.sub(i), 0, at)
            bcs.append(fem.dirichletbc(value, dofs, V.sub(i)))
    sides, law = dict(slave="hub face", master="ring face"), Coulomb(args.friction)
    gap = None if args.drawn else -args.overlap
    pair = ContactPair(u, body, **sides, law=law, gap=gap, interference=True)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    found = {"pressure_closed_form": (p := lame(args.overlap))}
    found["torque_closed_form"] = 2 * np.pi * RADII["hub"][1] ** 2 * args.friction * p
    for turn in (0.0, args.turn):
        bodies = problem(args, turn, comm)
        result = bodies.solve()
        table = result.tables["contact"]
        found["pressure"] = np.average(table.pressure, weights=table.area)
        found["axial_force"] = args.friction * table.rn.sum()
        x, f = table.x, table.force
        found["torque"] = np.sum(x[:, 1] * f[:, 0] - x[:, 0] * f[:, 1])
        say.result(result)
    say(", ".join(f"{k} {v:.6g}" for k, v in found.items()))
    output.picture_of_body(folder / "body.png", bodies)
    output.picture_of_contact(folder / "contact.png", bodies)
    output.write_contact_table(comm, folder, [table])
    return output.write_summary(comm, folder, result.summary() | found)


if __name__ == "__main__":
    main()
