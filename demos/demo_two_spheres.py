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

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.materials import Axisymmetric, LinearElastic, circumference
from dolfinx_contact.meshing import mesh_from_gmsh

RADIUS, APPROACH, YOUNG, POISSON = 50.0, 4.0, 20e3, 0.3  # mm, MPa
HERTZ = output.Hertz(3, RADIUS / 2, YOUNG / (2 * (1 - POISSON**2)))
MATERIAL = Axisymmetric(LinearElastic.from_young(YOUNG, POISSON))


def parser(name, ratio):
    words = ScriptParser("Two round bodies", output=f"output/{name}", friction=0.0)
    add, size = words.add_argument, number(above=0, most=2)
    add("--levels", type=size, nargs="+", default=[1.0, 0.5, 0.25], help="cell sizes there, mm")
    add("--ratio", type=number(above=0), default=ratio, help="of the lower body's cells over that")
    return words


# ## The bodies
#
# Half of a section is a polygon: sides along the circle, which grow with the distance from the
# contact as the cells between do, the equator and the axis. The first sides may touch.


def quarter(size, sign):
    s = [0.0]
    while s[-1] < 0.5 * np.pi * RADIUS:
        s.append(s[-1] + size + 0.1 * max(s[-1] - 12, 0))
    x = RADIUS * np.sin(0.5 * np.pi * np.array(s) / s[-1])
    y = sign * (RADIUS - np.sqrt(RADIUS**2 - x**2))
    return int((x < 0.5 * RADIUS).sum()), [*zip(x, y, strict=True), (0.0, sign * RADIUS)]


def draw(bodies):
    geo, group = gmsh.model.geo, gmsh.model.addPhysicalGroup
    for name, (face, corners) in bodies.items():
        sizes = corners[1][0] + 0.1 * np.linalg.norm(corners, axis=1)
        points = [geo.addPoint(x, y, 0, h) for (x, y), h in zip(corners, sizes, strict=True)]
        sides = [geo.addLine(a, b) for a, b in zip(points, np.roll(points, -1), strict=True)]
        for side in sides[:face]:
            geo.mesh.setTransfiniteCurve(side, 2)
        body = geo.addPlaneSurface([geo.addCurveLoop(sides)])
        geo.synchronize()
        group(2, [body], name=name)
        for part, some in {"face": sides[:face], "end": sides[-2:-1], "axis": sides[-1:]}.items():
            group(1, some, name=f"{name} {part}")
    gmsh.model.mesh.generate(2)


# ## The problem
#
# The energy has the hoop strain u_r / r, and the circumference as its weight; contact forces are
# those of the circumference, and areas of points those that they sweep. On the axis u_r is held.


def problem(size, args, comm):
    bodies = {"upper": quarter(size, 1), "lower": quarter(args.ratio * size, -1)}
    body = mesh_from_gmsh(comm, lambda: draw(bodies))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u, ends = fem.Function(V, name="displacement"), {"upper end": -APPROACH, "lower end": 0.0}
    energy = MATERIAL.energy(u) * circumference(body.mesh) * ufl.dx
    bcs = [fem.dirichletbc(v, body.dofs(V.sub(1), k), V.sub(1)) for k, v in ends.items()]
    given = dict(law=Coulomb(args.friction) if args.friction > 0 else Frictionless())
    given |= dict(slave="upper face", master="lower face", normal=(0, -1), axisymmetric=True)
    return ContactProblem(energy, u, [ContactPair(u, body, **given)], bcs=bcs)


def study(args, problem=problem, hertz=HERTZ):
    comm, levels = MPI.COMM_WORLD, []
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    for size in args.levels:
        result = (bodies := problem(size, args, comm)).solve()
        table = result.tables["contact"]
        found = hertz.compare(table)
        level = {"size": size, "dofs": result.dofs, "force": found["load"]}
        level |= {"radius": found["touching_radius"], "hertz_radius": found["radius_closed_form"]}
        level |= {"peak": found["peak_pressure"], "hertz_peak": found["peak_pressure_closed_form"]}
        levels.append(level)
        say(", ".join(f"{k} {v:.6g}" for k, v in level.items()))
    say.result(result)
    if comm.rank == 0:
        hertz.draw(folder / "pressure.png", table)
    output.picture_of_body(folder / "body.png", bodies)
    output.write_rows(comm, folder / "convergence.csv", levels)
    output.write_contact_table(comm, folder, [table])
    return output.write_summary(comm, folder, {**result.summary(), **level, "levels": levels})


def main(argv=None):
    return study(parser("two_spheres", 1.0).parse(argv))


if __name__ == "__main__":
    main()
