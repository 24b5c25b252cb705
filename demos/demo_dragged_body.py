# SPDX-License-Identifier: LGPL-3.0-or-later
# # A rubber rocker pressed on the floor and dragged
#
# This demo illustrates how to:
#
# - mesh a body with a curved contact face in gmsh, finer where it touches, or read one from a file
#   with named physical groups;
# - press it on a plane, drag it, and solve for contact with Coulomb friction, on any number of MPI
#   ranks, watching Newton's method work;
# - write displacement, stresses and contact fields for ParaView, the table of contact points,
#   pictures and a summary.
#
# The body is a block that lies on a round face, a part of a cylinder. Its flat top is moved down
# and sideways as a rigid plate. Where the block is pressed hard its face sticks to the floor;
# around that, the shear reaches the friction bound and the face slips; farther out it does not
# touch. This is the static form of the problem of Cattaneo (1938) and Mindlin (1949), for a finite
# body.

import argparse

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh, read_mesh
from dolfinx_contact.output import (
    output_folder,
    picture_of_body,
    picture_of_contact,
    write_contact_table,
    write_fields,
    write_summary,
)

RADIUS, HALF_LENGTH, HEIGHT, WIDTH = 1.0, 0.8, 0.8, 1.0


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="A rubber rocker pressed on the floor, dragged.")
    parser.add_argument("--mesh", help="a 3D .msh file with physical groups 'contact' and 'top'")
    parser.add_argument("--size", type=float, help="of cells where it touches; the radius is 1")
    parser.add_argument("--degree", type=int, choices=(1, 2), default=1, help="of the displacement")
    parser.add_argument("--friction", type=float, default=0.4)
    parser.add_argument(
        "--press", type=float, default=0.12, help="downward displacement of the top"
    )
    parser.add_argument("--shift", type=float, default=0.08, help="sideways displacement of it")
    parser.add_argument("--young", type=float, default=10.0)
    parser.add_argument("--poisson", type=float, default=0.4)
    parser.add_argument("--output", default="output/dragged_body")
    args = parse_arguments(parser, argv)
    if args.size is None:
        args.size = 0.05 if args.degree == 1 else 0.1
    if not 0.01 <= args.size <= 0.5:
        parser.error("--size must lie between 0.01 and 0.5")
    return args


# ## Progress
#
# Only rank 0 speaks, and flushes, so that a reader sees where the time goes.


def say(comm, text):
    if comm.rank == 0:
        print(text, flush=True)


def report(comm):
    def monitor(step):
        m = step.measures
        say(
            comm,
            f"  Newton {step.iteration:2d}: force {m.force:.1e}, constraint {m.constraint:.1e}, "
            f"cone {m.cone:.1e}, {step.flips} points changed status",
        )

    return monitor


# ## The mesh
#
# Rank 0 draws the section of the block, an arc and three straight lines, meshes it with cells that
# are small at the lowest point and larger at the top, and extrudes it. The physical groups
# `rocker`, `contact` (the round face) and `top` travel with the mesh.


def draw_rocker(size):
    occ = gmsh.model.occ
    rise = RADIUS - np.sqrt(RADIUS**2 - HALF_LENGTH**2)
    corners = [(-HALF_LENGTH, rise), (HALF_LENGTH, rise), (HALF_LENGTH, HEIGHT)]
    corners = [occ.addPoint(x, 0, z) for x, z in [*corners, (-HALF_LENGTH, HEIGHT)]]
    lowest = occ.addPoint(0, 0, 0)
    arc = occ.addCircleArc(corners[0], lowest, corners[1], center=False)
    occ.remove([(0, lowest)])
    lines = [occ.addLine(corners[i], corners[(i + 1) % 4]) for i in (1, 2, 3)]
    section = occ.addPlaneSurface([occ.addCurveLoop([arc, *lines])])
    layers = round(WIDTH / (1.4 * size))
    # The faces come in the order of the curves, after the opposite section and the volume.
    _, block, contact, _, top, _ = occ.extrude([(2, section)], 0, WIDTH, 0, numElements=[layers])
    occ.synchronize()
    for name, (dim, tag) in {"rocker": block, "contact": contact, "top": top}.items():
        gmsh.model.addPhysicalGroup(dim, [tag], name=name)

    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", f"{size} * (1 + 2 * Sqrt(x^2 + z^2))")
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    for option in ("MeshSizeFromPoints", "MeshSizeFromCurvature", "MeshSizeExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)
    gmsh.model.mesh.generate(3)


def rocker_mesh(args, comm):
    if args.mesh:
        return read_mesh(comm, args.mesh, dim=3, groups=("contact", "top"))
    return mesh_from_gmsh(comm, lambda: draw_rocker(args.size))


# ## The problem
#
# The floor is the plane through the lowest point of the contact face. The top moves as a rigid
# plate; everything else follows from elasticity, unilateral contact and friction.


def contact_problem(args, body):
    domain, comm = body.mesh, body.mesh.comm
    V = fem.functionspace(domain, ("Lagrange", args.degree, (3,)))
    u = fem.Function(V, name="displacement")
    held = fem.dirichletbc(np.array([args.shift, 0.0, -args.press]), body.dofs(V, "top"), V)

    lowest = comm.allreduce(domain.geometry.x[:, 2].min(initial=np.inf), op=MPI.MIN)
    surface = ContactSurface(
        u,
        body,
        tag="contact",
        obstacle=HalfSpace([0.0, 0.0, lowest], [0.0, 0.0, 1.0]),
        law=Coulomb(args.friction),
    )
    material = LinearElastic.from_young(args.young, args.poisson)
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[held])
    return problem, material.full_stress(u)


# ## Solve and write
#
# The folder is made before anything expensive happens. `solve` calls the monitor at every iterate.


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)

    say(comm, f"reading {args.mesh}" if args.mesh else f"meshing, cell size {args.size:g}")
    body = rocker_mesh(args, comm)
    problem, stress = contact_problem(args, body)
    cells = body.mesh.topology.index_map(3).size_global
    say(comm, f"solving: {cells} cells of degree {args.degree}, {comm.size} rank(s)")
    result = problem.solve(monitor=report(comm))

    say(comm, "writing")
    files = write_fields(folder, problem, stress=stress)
    files.append(folder / "paraview.py")  # paraview --script=... shows them
    write_contact_table(comm, folder, result.tables.values())
    files.append(folder / "contact.csv")
    files.append(
        picture_of_body(
            folder / "body.png", problem, stress=stress, title="A rocker pressed down and dragged"
        )
    )
    title = f"Contact face, friction coefficient {args.friction:g}"
    files.append(picture_of_contact(folder / "contact.png", problem, title=title))
    summary = write_summary(comm, folder, result.summary())
    files.append(folder / "summary.json")

    fx, _, fz = result.resultants["contact"]
    say(comm, f"\n{result.reason}: {result.iterations} Newton iterations, {result.dofs} unknowns")
    say(comm, "contact points: " + ", ".join(f"{n} {k}" for k, n in result.counts.items() if n))
    say(
        comm, f"floor on the rocker: {fz:.4g} up, {-fx:.4g} against the drag (ratio {-fx / fz:.3f})"
    )
    say(comm, f"worst violation of the contact law: {result.kkt_violation:.1e} (relative)")
    say(comm, f"{summary['wall_seconds']:.1f} s. Files:")
    for file in files:
        if file is not None:
            say(comm, f"  {file}")
    return summary


if __name__ == "__main__":
    main()
