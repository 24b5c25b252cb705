# SPDX-License-Identifier: LGPL-3.0-or-later
# # A steel cylinder on an aluminium block
#
# This demo illustrates how to:
#
# - mesh two bodies in gmsh, each as it likes, and let them touch (`ContactPair`, a mortar);
# - press by a force: nothing but contact holds the cylinder;
# - compare with Hertz, mesh by mesh: the benchmark CB-1 of NAFEMS (Code_Aster's SSNP154).
#
# The cylinder has the radius 50 mm, the block is 200 mm high, 400 mm wide; plane strain. 35 kN per
# mm are spread over the flat top of the lower half of the cylinder. By symmetry half is meshed. The
# cells grow with the distance from the contact. Hertz's half-spaces have the contact radius 6.21 mm
# and the peak 3585.37 MPa; with friction that holds approximately.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

RADIUS, HEIGHT, LOAD = 50.0, 200.0, 35e3  # mm, N/mm
STEEL, ALUMINIUM = (LinearElastic.from_young(young, 0.3) for young in (210e3, 70e3))
HERTZ = output.Hertz(2, RADIUS, 1 / ((1 - 0.3**2) * (1 / 210e3 + 1 / 70e3)), parts=2)


def arguments(argv=None):
    parser = ScriptParser("Two cylinders", output="output/two_cylinders", friction=0.0)
    add = parser.add_argument
    add("--case", choices=("cb1",), default="cb1", help="of the benchmarks")
    size, levels = number(above=0, most=2), [1.0, 0.5, 0.25]
    add("--levels", type=size, nargs="+", default=levels, help="cell sizes in the contact, mm")
    add("--ratio", type=number(above=0), default=0.8, help="size of the block's cells over that")
    return parser.parse(argv)


# ## The bodies
#
# The quarter of a disc, and the block below it, with names for their sides.


def draw(size, ratio):
    import gmsh

    occ, field = gmsh.model.occ, gmsh.model.mesh.field
    disc, square = occ.addDisk(0, RADIUS, 0, RADIUS, RADIUS), occ.addRectangle(0, 0, 0, 50, 50)
    cylinder = occ.intersect([(2, disc)], [(2, square)])[0][0][1]
    block = occ.addRectangle(0, -HEIGHT, 0, HEIGHT, HEIGHT)
    occ.synchronize()
    groups, fields = {}, []
    for _, line in gmsh.model.getEntities(1):
        x, y, _ = occ.getCenterOfMass(1, line)
        of_cylinder = gmsh.model.getAdjacencies(1, line)[0][0] == cylinder
        sides = {RADIUS: "top"} if of_cylinder else {-HEIGHT: "bottom", 0.0: "face"}
        name = sides.get(round(y, 6), "round" if of_cylinder else "side")
        groups.setdefault("symmetry" if abs(x) < 1e-6 else name, []).append(line)
    for name, lines in groups.items():
        gmsh.model.addPhysicalGroup(1, lines, name=name)
    for name, body, h in (("cylinder", cylinder, size), ("block", block, ratio * size)):
        gmsh.model.addPhysicalGroup(2, [body], name=name)
        away = "(sqrt(x*x + y*y) - 9 + abs(sqrt(x*x + y*y) - 9)) / 2"
        law, on = field.add("MathEval"), field.add("Restrict")
        field.setString(law, "F", f"{h} + 0.15 * {away}")
        field.setNumber(on, "InField", law)
        field.setNumbers(on, "SurfacesList", [body])
        fields.append(on)
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", fields)
    field.setAsBackgroundMesh(least)
    for option in ("SizeFromPoints", "SizeFromCurvature", "SizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.Mesh{option}", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", HEIGHT / 10)
    gmsh.model.mesh.generate(2)


def problem(size, args, comm):
    body = mesh_from_gmsh(comm, lambda: draw(size, args.ratio))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    dx = ufl.Measure("dx", body.mesh, subdomain_data=body.cell_tags)
    energy = STEEL.energy(u) * dx(body.tag("cylinder")) + ALUMINIUM.energy(u) * dx(
        body.tag("block")
    )
    energy += fem.Constant(body.mesh, LOAD / (2 * RADIUS)) * u[1] * body.ds("top")
    held = fem.dirichletbc(0.0, body.dofs(V.sub(0), "symmetry"), V.sub(0))
    below = fem.dirichletbc(np.zeros(2), body.dofs(V, "bottom"), V)
    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    pair = ContactPair(u, body, slave="round", master="face", law=law)
    return ContactProblem(energy, u, [pair], bcs=[held, below])


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    levels = []
    for size in args.levels:
        bodies = problem(size, args, comm)
        result = bodies.solve()
        table = result.tables["contact"]
        found = HERTZ.compare(table)
        level = {"size": size, "dofs": result.dofs, "newton_iterations": result.iterations}
        level |= {"radius": found["touching_radius"], "peak": found["largest_pressure"]}
        level |= {"force": found["load"], "hertz_radius": found["radius_closed_form"]}
        levels.append(level | {"hertz_peak": found["peak_pressure_closed_form"]})
        say(", ".join(f"{k} {v:.6g}" for k, v in levels[-1].items()))
    say.result(result)
    if comm.rank == 0:
        HERTZ.draw(folder / "pressure.png", table)
    output.picture_of_body(folder / "body.png", bodies)
    output.write_contact_table(comm, folder, [table])
    return output.write_summary(comm, folder, result.summary() | levels[-1] | {"levels": levels})


if __name__ == "__main__":
    main()
