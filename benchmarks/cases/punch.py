# SPDX-License-Identifier: LGPL-3.0-or-later
"""A ball, a roller or a flat punch from STL.

Reference: the exact shape. `demos/demo_punch.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _surfaces import ball, brick, cylinder, write_stl

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Cylinder,
    LevelSet,
    RigidBody,
    RigidSurface,
    Sphere,
    io,
    plot,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame

RADIUS = 1.0
HALF = 0.5625  # width of the flat punch, half of it
LENGTH = 4.0  # of the roller
MM = 1e-3


def arguments(argv=None):
    given = dict(n=8, young=1000.0, poisson=0.3, friction=0.3)
    parser = ScriptParser("A punch from an STL file", output="output/punch", **given)
    parser.add_argument("--tool", choices=["ball", "roller", "flat"], default="ball")
    parser.add_argument(
        "--facets", type=number(int, least=2), default=4, help="cuts of 63 degrees of the coarsest"
    )
    parser.add_argument("--force", type=number(above=0), default=60.0)
    parser.add_argument("--way", type=number(least=0), default=0.2, help="led sideways")
    parser.add_argument("--steps", type=number(int, least=1), default=4, help="of the way")
    return parser.parse(argv)


def box_distance(x):
    """The distance of a box of the height 1 that stands on the plane z = 0."""
    over = [abs(x[0]) - HALF, abs(x[1]) - HALF, abs(x[2] - 0.5) - 0.5]
    outside = sum(ufl.max_value(v, 0.0) ** 2 for v in over)
    inside = ufl.max_value(over[0], ufl.max_value(over[1], over[2]))
    far = ufl.gt(outside, 0.0)
    return ufl.conditional(far, ufl.sqrt(ufl.conditional(far, outside, 1.0)), inside)


def exact_tool(kind):
    centre = (0.0, 0.0, RADIUS)
    if kind == "ball":
        return Sphere(centre, RADIUS)
    return Cylinder(centre, (0.0, 1.0, 0.0), RADIUS) if kind == "roller" else LevelSet(box_distance)


def facets_of(kind, cuts):
    centre = (0.0, 0.0, RADIUS)
    if kind == "ball":
        return ball(cuts, RADIUS, centre)
    if kind == "roller":
        return cylinder(6 * cuts, RADIUS, LENGTH, centre)
    return brick((-HALF, -HALF, 0.0), (HALF, HALF, 1.0))


def tool_from_file(comm, folder, kind, cuts):
    """The tool, from a file in millimetres."""
    file = folder / f"{kind}_{cuts}.stl"
    if comm.rank == 0:
        points, cells = facets_of(kind, cuts)
        write_stl(file, points / MM, cells)
    comm.barrier()
    return RigidSurface.read(file, scale=MM, comm=comm)


def pressed(args, comm, shape):
    """The problem, the force and the way of the tool."""
    corners = [np.array([-1.0, -1.0, -0.8]), np.array([1.0, 1.0, 0.0])]
    cells = (args.n, args.n, max(args.n // 3, 1))
    domain = mesh.create_box(comm, corners, cells, mesh.CellType.hexahedron)
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    force = fem.Constant(domain, 0.0)
    way = fem.Constant(domain, 0.0)
    tool = RigidBody(
        shape,
        about=(0.0, 0.0, 0.0),
        load={"z": force},
        motion={"x": way},
        held=["y", "rx", "ry", "rz"],
        name="tool",
    )
    faces = [
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: x[2] == z) for z in (0.0, -0.8)
    ]
    contact = ContactSurface(u, faces[0], obstacle=tool, law=Coulomb(args.friction))
    held = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, faces[1]), V)
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    energy = NeoHookean(*lame(args.young, args.poisson)).energy(u) * dx
    return ContactProblem(energy, u, [contact], bcs=[held]), force, way


def history(args, comm, shape):
    """Pressed until t = 1, then led sideways: the problem and its steps."""
    problem, force, way = pressed(args, comm, shape)

    def load(t):
        force.value = -args.force * min(t, 1.0)
        way.value = args.way * max(t - 1.0, 0.0)

    times = [0.0, 0.5, *np.linspace(1.0, 2.0, args.steps + 1)]
    return problem, QuasiStatic(problem, load).run(times).steps


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    say = io.Report(comm)
    folder = io.output_folder(comm, args.output)
    cuts = [args.facets] if args.tool == "flat" else [args.facets * 2**k for k in range(3)]
    tools = {"exact": exact_tool(args.tool)}
    tools |= {str(n): tool_from_file(comm, folder, args.tool, n) for n in cuts}
    found = {}
    unbalanced = 0.0
    for name, shape in tools.items():
        problem, steps = history(args, comm, shape)
        for step in steps[1:]:
            up = step.result.rigid_bodies["tool"].contact[2]
            unbalanced = max(unbalanced, abs(up / args.force - 1))
        last = steps[-1].result
        of_tool = last.rigid_bodies["tool"]
        found[name] = np.array([of_tool.motion[2], of_tool.contact[0]])
        depth, drag = -found[name][0], abs(found[name][1])
        size = "" if name == "exact" else f", {len(shape.cells)} facets"
        say(f"{name}{size}: {depth:.6f} deep, dragged by {drag:.5f}")
    off = [np.abs(found[str(n)] / found["exact"] - 1).max() for n in cuts]
    say(f"off by {', '.join(f'{v:.2e}' for v in off)}")
    plot.picture_of_body(folder / "punch.png", problem)
    io.write_contact_table(comm, folder, list(last.tables.values()))
    summary = last.summary()
    summary["unbalanced"] = unbalanced
    summary["depth"], summary["drag"] = (abs(float(v)) for v in found[str(cuts[-1])])
    summary["depth_exact"], summary["drag_exact"] = (abs(float(v)) for v in found["exact"])
    summary["off"] = [float(v) for v in off]
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
