# SPDX-License-Identifier: LGPL-3.0-or-later
"""All solutions of prisms and blocks.

Reference: a prototype, certificates. `demos/demo_proofs_3d.py` explains the problem.
"""

import time

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
)
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.proofs import check


def arguments(argv=None):
    given = dict(lame=(1.0, 1.0), friction=2.0)
    parser = ScriptParser("All solutions in 3D", output="output/proofs_3d", **given)
    add = parser.add_argument
    cells = number(int, above=0)
    add("--shape", choices=("extruded", "block"), default="extruded", help="of the body")
    add("--cells", type=cells, nargs="+", default=[2, 1], help="along x and y, of blocks z too")
    add("--depth", type=number(above=0), default=0.5, help="of a triangle, the height of a block")
    add("--load", type=number(), nargs=3, metavar=("X", "Y", "Z"), default=[-1.0, 0.1, -0.5],
        help="force per volume")  # fmt: skip
    add("--seconds", type=number(least=0), default=120.0, help="for the proof")
    args = parser.parse(argv)
    if len(args.cells) != {"extruded": 2, "block": 3}[args.shape]:
        parser.error("--cells takes two numbers for an extruded triangle, three for a block")
    return args


def extruded(n, layers, depth):
    """Nodes (k, 3) and tetrahedra of the triangle of n cells an edge."""
    place = {}
    for layer in range(layers + 1):
        for j in range(n + 1):
            for i in range(n + 1 - j):
                place[i, j, layer] = len(place)
    nodes = np.array([(i / n, depth * layer / layers, j / n) for i, j, layer in place])
    triangles = [[(i, j), (i + 1, j), (i, j + 1)] for j in range(n) for i in range(n - j)]
    triangles += [
        [(i + 1, j), (i + 1, j + 1), (i, j + 1)] for j in range(n) for i in range(n - 1 - j)
    ]
    cells = []
    for layer in range(layers):
        for corners in triangles:
            a, b, c = sorted(place[i, j, layer] for i, j in corners)
            up = {place[i, j, layer]: place[i, j, layer + 1] for i, j in corners}
            cells += [[a, b, c, up[c]], [a, b, up[b], up[c]], [a, up[a], up[b], up[c]]]
    return nodes, np.array(cells)


def block(nx, ny, nz, height):
    """Nodes (k, 3) and tetrahedra of a block of 1 x 1 x height."""
    i, j, k = (v.ravel() for v in np.mgrid[: nx + 1, : ny + 1, : nz + 1])
    nodes = np.stack([i / nx, j / ny, height * k / nz], axis=1)
    steps = np.array([(ny + 1) * (nz + 1), nz + 1, 1])
    first = (np.stack([i, j, k], axis=1) @ steps)[(i < nx) & (j < ny) & (k < nz)]
    cells = []
    for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)):
        ways = np.concatenate([[0], np.cumsum(steps[list(order)])])
        cells.append(first[:, None] + ways)
    return nodes, np.concatenate(cells)


def made(args, comm):
    """The mesh, from rank 0, and which points are clamped."""
    if args.shape == "extruded":
        nodes, cells = extruded(*args.cells, args.depth)
        held = lambda x: np.isclose(x[0] + x[2], 1.0)  # noqa: E731
    else:
        nodes, cells = block(*args.cells, args.depth)
        held = lambda x: np.isclose(x[2], args.depth)  # noqa: E731
    cells = cells.astype(np.int64)
    if comm.rank > 0:
        nodes, cells = nodes[:0], cells[:0]
    element = basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,))
    return mesh.create_mesh(comm, cells=cells, x=nodes, e=ufl.Mesh(element)), held


def body(args, comm):
    """The body on the floor; its load is multiplied by gamma."""
    domain, held = made(args, comm)
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 1.0)
    force = fem.Constant(domain, np.array(args.load))
    stored = LinearElastic(*args.lame).energy(u)
    energy = stored * ufl.dx - gamma * ufl.dot(force, u) * ufl.dx
    facets = mesh.locate_entities_boundary(domain, 2, held)
    bc = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, facets), V)
    sole = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
    floor = HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    surface = ContactSurface(u, sole, obstacle=floor, law=Coulomb(args.friction))
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=[bc]), gamma)


def described(system, point):
    """Statuses and sums of forces of a solution, which is left in the problem. Collective."""
    (force,) = system.result_at(point).resultants.values()
    x, y, z = map(float, force)
    return {"status": system.letters(point.piece), "sum_rn": z, "sum_rt": [x, y]}


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    system = body(args, comm)
    x = system.create_vector()
    begun = time.perf_counter()
    found = find_solutions(system, [x], 1.0, proof_seconds=args.seconds)
    seconds = time.perf_counter() - begun
    say(found)

    solutions = []
    for number_, point in enumerate(found.points(system)):
        solution = described(system, point)
        solutions.append(solution)
        title = f"{solution['status']}: {solution['sum_rn']:.6g}"
        plot.picture_of_contact(folder / f"solution_{number_}.png", system.problem, title=title)
    solutions.sort(key=lambda solution: solution["sum_rn"])
    for solution in solutions:
        x_, y_ = solution["sum_rt"]
        say(f"{solution['status']}: rn {solution['sum_rn']:.10g}, rt ({x_:.10g}, {y_:.10g})")

    summary = {"solutions": solutions, "complete": found.complete, "method": found.method}
    summary |= {"proof_seconds": seconds, "check_seconds": None, "open": None}
    if found.proof is not None:
        certificate = found.proof.certificate
        begun = time.perf_counter()
        checked = check(certificate)
        summary["check_seconds"] = time.perf_counter() - begun
        summary["open"] = len(checked.open_regions)
        summary["verdict"] = checked.verdict
        if comm.rank == 0:
            certificate.save(folder / "proof.npz")
        say(f"{certificate}: {checked}; python3 -m dolfinx_contact check {folder / 'proof.npz'}")
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
