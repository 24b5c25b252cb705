# SPDX-License-Identifier: LGPL-3.0-or-later
# # Two elastic spheres
#
# This demo illustrates how to:
#
# - mesh two round bodies in gmsh, with the same nodes where they touch or, with `--ratio`, others;
# - say in which direction curved faces look at each other (`normal`);
# - solve for bodies of revolution (`axisymmetric`);
# - compare with Hertz, mesh by mesh: the benchmark SSNV104 of Code_Aster.
#
# The equators of spheres of radius 50 mm approach each other by 4 mm. That is not little (Hertz has
# the radius 10 mm and the peak 2798 MPa): he is compared with at the force that comes out.

from mpi4py import MPI

import gmsh
import numpy as np
from _case import ScriptParser, number
from _hertz import Hertz

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless, io, plot
from dolfinx_contact.materials import Axisymmetric, LinearElastic, circumference
from dolfinx_contact.meshing import mesh_from_gmsh

RADIUS = 50.0  # mm
APPROACH = 4.0
YOUNG = 20e3  # MPa
POISSON = 0.3
HERTZ = Hertz(3, RADIUS / 2, YOUNG / (2 * (1 - POISSON**2)))
MATERIAL = Axisymmetric(LinearElastic.from_young(YOUNG, POISSON))


def parser(name, ratio):
    words = ScriptParser("Two round bodies", output=f"output/{name}", friction=0.0)
    add = words.add_argument
    size = number(above=0, most=2)
    positive = number(above=0)
    sizes = [1.0, 0.5, 0.25]
    add("--levels", type=size, nargs="+", default=sizes, help="cell sizes there, mm")
    add("--ratio", type=positive, default=ratio, help="of the lower body's cells over that")
    return words


# ## The bodies
#
# Half of a section is a polygon: sides along the circle, which grow with the distance from the
# contact as the cells between do, the equator and the axis. The first sides may touch.


def quarter(size, sign):
    """The number of sides that may touch, and the corners."""
    end = 0.5 * np.pi * RADIUS
    s = [0.0]
    while s[-1] < end:
        growth = 0.1 * max(s[-1] - 12, 0)
        s.append(s[-1] + size + growth)
    angle = 0.5 * np.pi * np.array(s) / s[-1]
    x = RADIUS * np.sin(angle)
    y = sign * (RADIUS - np.sqrt(RADIUS**2 - x**2))
    may_touch = int((x < 0.5 * RADIUS).sum())
    corners = list(zip(x, y, strict=True))
    corners.append((0.0, sign * RADIUS))
    return may_touch, corners


def draw(bodies):
    geo = gmsh.model.geo
    group = gmsh.model.addPhysicalGroup
    for name, (face, corners) in bodies.items():
        distance = np.linalg.norm(corners, axis=1)
        sizes = corners[1][0] + 0.1 * distance
        points = []
        for (x, y), size in zip(corners, sizes, strict=True):
            points.append(geo.addPoint(x, y, 0, size))
        sides = []
        for start, end in zip(points, np.roll(points, -1), strict=True):
            sides.append(geo.addLine(start, end))
        for side in sides[:face]:
            geo.mesh.setTransfiniteCurve(side, 2)
        loop = geo.addCurveLoop(sides)
        body = geo.addPlaneSurface([loop])
        geo.synchronize()
        group(2, [body], name=name)
        group(1, sides[:face], name=f"{name} face")
        group(1, sides[-2:-1], name=f"{name} end")
        group(1, sides[-1:], name=f"{name} axis")
    gmsh.model.mesh.generate(2)


# ## The problem
#
# The energy has the hoop strain u_r / r, and the circumference as its weight; contact forces are
# those of the circumference, and areas of points those that they sweep. On the axis u_r is held.


def problem(size, args, comm):
    upper = quarter(size, 1)
    lower = quarter(args.ratio * size, -1)
    bodies = {"upper": upper, "lower": lower}
    body = mesh_from_gmsh(comm, lambda: draw(bodies))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    energy = MATERIAL.energy(u) * circumference(body.mesh) * ufl.dx
    along = V.sub(1)
    bcs = []
    for end, value in (("upper end", -APPROACH), ("lower end", 0.0)):
        dofs = body.dofs(along, end)
        bcs.append(fem.dirichletbc(value, dofs, along))
    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    faces = dict(slave="upper face", master="lower face", normal=(0, -1))
    pair = ContactPair(u, body, **faces, law=law, axisymmetric=True)
    return ContactProblem(energy, u, [pair], bcs=bcs)


def study(args, problem=problem, hertz=HERTZ):
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    levels = []
    for size in args.levels:
        bodies = problem(size, args, comm)
        result = bodies.solve()
        table = result.tables["contact"]
        found = hertz.compare(table)
        level = {
            "size": size,
            "dofs": result.dofs,
            "force": found["load"],
            "radius": found["touching_radius"],
            "hertz_radius": found["radius_closed_form"],
            "peak": found["peak_pressure"],
            "hertz_peak": found["peak_pressure_closed_form"],
        }
        levels.append(level)
        say(", ".join(f"{name} {value:.6g}" for name, value in level.items()))
    say.result(result)
    if comm.rank == 0:
        hertz.draw(folder / "pressure.png", table)
    plot.picture_of_body(folder / "body.png", bodies)
    io.write_rows(comm, folder / "convergence.csv", levels)
    io.write_contact_table(comm, folder, [table])
    summary = result.summary() | level
    summary["levels"] = levels
    return io.write_summary(comm, folder, summary)


def main(argv=None):
    args = parser("two_spheres", 1.0).parse(argv)
    return study(args)


if __name__ == "__main__":
    main()
