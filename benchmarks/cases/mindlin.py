# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two cylinders sheared and unloaded.

Reference: Cattaneo and Mindlin. `demos/demo_mindlin.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join, name_groups

RADIUS = 4.0  # of the pair
SIZE = 12.0  # of the blocks
DEPTH = 0.215  # of the press
FINE = 0.68  # the cells on it are counted; about half of the contact
FACE = 0.9  # half length of the contact surface


def arguments(argv=None):
    given = dict(n=20, friction=0.2, young=200.0, poisson=0.3)
    parser = ScriptParser("Cattaneo and Mindlin", output="output/mindlin", **given)
    part = number(above=0, below=1)
    count = number(int, above=0)
    parser.add_argument("--shear", type=part, default=0.46808, help="Q*/(mu P)")
    parser.add_argument("--back", type=number(), default=-0.1, help="Q/(mu P) at the end")
    parser.add_argument("--steps", type=count, default=8, help="each way")
    return parser.parse(argv)


def pair(args, comm):
    """The problem, the shear on its top, and its descent; n cells on half the contact."""
    h = FINE / args.n
    away = h * np.cumsum(1.25 ** np.arange(60))
    away = away[away < 0.8 * SIZE]
    y = np.concatenate(([0.0], away, [SIZE]))
    fine = np.arange(0.0, FACE, h)
    half = np.append(fine, FACE + y[1:])
    mirrored = -half[:0:-1]
    x = np.append(mirrored, half)
    square = mesh.CellType.quadrilateral

    def at(y, reach=np.inf):
        return lambda x: np.isclose(x[1], y) & (np.abs(x[0]) < reach)

    def on_middle(x):
        return np.hypot(x[0], x[1] + SIZE) < 1e-9

    above = create_grid(comm, (x, y), square)
    above = name_groups(above, {"upper_face": at(0.0, FACE), "top": at(SIZE)})
    below = create_grid(comm, (x, -y[::-1]), square)
    below = name_groups(below, {"lower_face": at(0.0, FACE), "bottom": at(-SIZE)})
    both = join([above, below])
    domain = both.mesh

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    W = V.sub(1)
    u = fem.Function(V)
    pull = fem.Constant(domain, 0.0)
    down = fem.Constant(domain, 0.0)
    zero = fem.Constant(domain, 0.0)
    elastic = LinearElastic.from_young(args.young, args.poisson)
    load = pull * u[0] * both.ds("top")
    energy = elastic.energy(u) * ufl.dx - load

    # The top goes down, the bottom is held, and one node of it does not move sideways.
    middle = mesh.locate_entities_boundary(domain, 0, on_middle)
    at_middle = fem.locate_dofs_topological(V.sub(0), 0, middle)
    pressed = fem.dirichletbc(down, both.dofs(W, "top"), W)
    held = fem.dirichletbc(zero, both.dofs(W, "bottom"), W)
    kept = fem.dirichletbc(zero, at_middle, V.sub(0))

    law = Coulomb(args.friction)
    position = ufl.SpatialCoordinate(domain)
    gap = position[0] ** 2 / 2 / RADIUS
    contact = ContactPair(u, both, slave="upper_face", master="lower_face", law=law, gap=gap)
    problem = ContactProblem(energy, u, [contact], bcs=[pressed, held, kept])
    width = 2 * half[-1]
    return problem, pull, down, width


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, pull, down, width = pair(args, comm)
    force = 0.0  # P, known when the bodies are pressed

    def load(t):  # down, to and fro
        part = np.interp(t, [1, 2, 3], [0, args.shear, args.back])
        down.value = -DEPTH * min(t, 1.0)
        pull.value = args.friction * force / width * part

    evolution = QuasiStatic(problem, load)
    descent = evolution.run([0.0, 0.5, 1.0])
    pressed = descent.steps[-1].result
    force = pressed.tables["contact"].rn.sum()
    times = np.linspace(1.0, 3.0, 2 * args.steps + 1)
    history = evolution.run(times)

    a = np.sqrt(8 * force * RADIUS * (1 - args.poisson**2) / (np.pi * args.young))
    mu_p0 = args.friction * 2 * force / (np.pi * a)
    c_loaded = a * np.sqrt(1 - args.shear)
    c_back = a * np.sqrt(1 - (args.shear - args.back) / 2)
    c = [c_loaded, c_back]
    summary = {"force": force, "contact_radius": a, "mu_p0": mu_p0}

    def hertz(x, c):
        square = np.maximum(1 - (x / c) ** 2, 0.0)
        return c / a * np.sqrt(square)

    for k, name in enumerate(("loading", "unloading")):
        table = history.at(2.0 + k).result.tables["contact"]
        x = table.x[:, 0]
        q = -table.along(table.shear) / mu_p0
        exact = hertz(x, a) - hertz(x, c_loaded)
        if name == "unloading":
            taken = hertz(x, a) - hertz(x, c_back)
            exact = exact - 2 * taken

        # The worst error is looked for two cells away from the ends of contact and stick.
        ends = [a, *c[: k + 1]]
        radius = np.abs(x)
        distances = np.abs(radius[:, None] - ends)
        two_cells = 2 * FINE / args.n
        error = np.abs(q - exact)
        inside = error[radius < a]
        away = error[distances.min(axis=1) > two_cells]
        stuck = x[table.letters == "k"]
        summary[name] = {
            "l2_error": np.sqrt(np.mean(inside**2)),
            "worst_error": away.max(),
            "stick_radius": np.abs(stuck).max(),
            "stick_radius_closed_form": c[k],
        }
        say(name + ": " + ", ".join(f"{k} {v:.4g}" for k, v in summary[name].items()))
        if comm.rank == 0:
            computed = {"computed": (x, q)}
            closed_form = {"half-planes": (x, exact)}
            picture = folder / f"{name}.png"
            plot.draw_curves(
                picture, computed, dotted=closed_form, labels=("x", "shear traction"), title=name
            )
    io.write_contact_table(comm, folder, [table])
    last = history.steps[-1].result.summary()
    summary |= summary["loading"]
    return io.write_summary(comm, folder, last | summary)


if __name__ == "__main__":
    main()
