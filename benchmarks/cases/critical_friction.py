# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangle, parallelogram, prism.

Reference: own code. `demos/demo_critical_friction.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _triangle import linear_triangle

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.analysis import (
    critical_friction,
    critical_friction_by_direction,
    renard_criterion,
)
from dolfinx_contact.materials import LinearElastic


def arguments(argv=None):
    body = dict(n=32, lame=(100.0, 82.0), young=1.0, poisson=0.3)
    parser = ScriptParser("Critical friction", output="output/critical_friction", **body)
    parser.add_argument("--shape", choices=("hild", "parallelogram", "prism"), default="hild")
    parser.add_argument("--width", type=number(above=0), default=1.0, help="of it")
    parser.add_argument("--height", type=number(above=0), default=4.0, help="of it")
    parser.add_argument("--offset", type=number(), default=1.0, help="of its top, to the right")
    return parser.parse(argv)


def parallelogram(args, n, height):
    corners = [[0.0, 0.0], [args.width, height]]
    upwards = max(round(n * height / args.width), 1)
    quads = mesh.CellType.quadrilateral
    domain = mesh.create_rectangle(MPI.COMM_WORLD, corners, [n, upwards], quads)
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
    top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))
    x = domain.geometry.x
    x[:, 0] += args.offset * x[:, 1] / height
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    dofs = fem.locate_dofs_topological(V, 1, top)
    clamped = fem.dirichletbc(np.zeros(2), dofs, V)
    plane = HalfSpace((0, 0), (0, 1))
    floor = ContactSurface(u, bottom, obstacle=plane, law=Coulomb(1.0))
    material = LinearElastic.from_young(args.young, args.poisson)
    energy = material.energy(u) * ufl.dx
    return ContactProblem(energy, u, [floor], bcs=[clamped])


def body(args, n):
    if args.shape == "hild":
        return linear_triangle(n, 1.0, lame=args.lame).problem
    return parallelogram(args, n, args.height)


def level(args, n):
    problem = body(args, n)
    width = 1.0 if args.shape == "hild" else args.width
    h = width / n
    right = [1.0, 0.0]

    def one_way(x):
        return np.tile(right, (len(x), 1))

    def alternating(x):
        nodes = np.round(x[:, 0] / h)
        return np.outer((-1.0) ** nodes, right)

    return {
        "h": h,
        "critical": critical_friction(problem).friction,
        "one_way": renard_criterion(problem, one_way).friction,
        "alternating": renard_criterion(problem, alternating).friction,
    }


def curves_of(levels, name):
    """Mesh widths and the values of a criterion; NaN where it found none."""
    h = [row["h"] for row in levels]
    values = [abs(row[name] or np.nan) for row in levels]
    return h, values


def prism(args):
    n = min(args.n, 4)
    corners = [[0.0, 0.0, 0.0], [args.width, args.width, args.height]]
    upwards = max(round(n * args.height / args.width), 1)
    cells = mesh.CellType.hexahedron
    domain = mesh.create_box(MPI.COMM_WORLD, corners, [n, n, upwards], cells)
    bottom = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], args.height))
    x = domain.geometry.x
    x[:, 0] += args.offset * x[:, 2] / args.height
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    clamped = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, top), V)
    plane = HalfSpace((0, 0, 0), (0, 0, 1))
    floor = ContactSurface(u, bottom, obstacle=plane, law=Coulomb(1.0))
    energy = LinearElastic.from_young(args.young, args.poisson).energy(u) * ufl.dx
    return ContactProblem(energy, u, [floor], bcs=[clamped])


def over_directions(args, folder, say):
    problem = prism(args)
    found = critical_friction_by_direction(problem, number=24)
    say(str(found))
    if MPI.COMM_WORLD.rank == 0:
        curve = {"critical friction": (found.angles, found.friction)}
        plot.draw_polar(folder / "directions.png", curve, label="direction of slip")
    summary = {
        "converged": True,
        "newton_iterations": 0,
        "dofs": problem.create_vector().getSize(),
        "critical_friction": found.smallest,
        "direction": found.direction,
        "angles": found.angles,
        "friction": found.friction,
    }
    return io.write_summary(MPI.COMM_WORLD, folder, summary)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    if args.shape == "prism":
        return over_directions(args, folder, say)
    problem = body(args, args.n)
    found = critical_friction(problem)
    further = found.one_signed + found.others
    say(f"critical friction: {found.friction}; others: {further[1:5]}")
    meshes = [n for n in (1, 2, 4, 8, 16, 32) if n <= args.n]
    levels = [level(args, n) for n in meshes]
    for row in levels:
        words = [f"{name} {value or np.nan:.7g}" for name, value in row.items()]
        say(", ".join(words))

    heights = []
    if args.shape == "parallelogram":
        heights = [args.width * k for k in (1, 2, 4, 8)]
    falls = []
    for height in heights:
        leaning = parallelogram(args, min(args.n, 8), height)
        friction = critical_friction(leaning).friction
        falls.append(friction)
        relative = friction * height / args.width
        say(f"height {height:g}: F = {friction:.6g}, over W/H {relative:.4g}")

    if comm.rank == 0:
        names = ("critical", "one_way", "alternating")
        curves = {name.replace("_", " "): curves_of(levels, name) for name in names}
        h = np.array([row["h"] for row in levels])
        root = levels[-1]["alternating"] * np.sqrt(h / h[-1])
        slope = {"order 1/2": (h, root)}
        look = dict(labels=("size of cells h", "critical friction F"), loglog=True)
        plot.draw_curves(folder / "refinement.png", curves, dotted=slope, **look)
        if found.friction is not None:
            slip = {f"F = {found.friction:.6g}": (found.positions[:, 0], found.slips)}
            plot.draw_curves(folder / "slip.png", slip, labels=("x", "slip of the mode"))
    summary = {
        "converged": True,
        "newton_iterations": 0,
        "dofs": problem.create_vector().getSize(),
        "critical_friction": found.friction,
        "one_signed": found.one_signed,
        "others": [[F.real, F.imag] for F in found.others],
        "mixed": found.mixed,
        "levels": levels,
        "heights": heights,
        "falls": falls,
    }
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
