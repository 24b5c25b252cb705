# SPDX-License-Identifier: LGPL-3.0-or-later
# # Cattaneo and Mindlin: a contact that is sheared and relieved
#
# This demo illustrates how to:
#
# - press two bodies together, shear them by a force, and take part of it back (`QuasiStatic`);
# - compare shear and stick zone with closed forms that know the history.
#
# Two cylinders of radius 8 and equal material are pressed together by P per length; only the sum of
# their curvatures matters, and here it is the gap between two flat faces. Under a tangential force
# Q < mu P the ends of the contact slip: with Hertz's a and p0, and c = a sqrt(1 - Q/(mu P)),
#
#     q(x) = mu p0 [sqrt(1 - x^2/a^2) - (c/a) sqrt(1 - x^2/c^2)]
#
# (the second root where it sticks, |x| < c). When Q* falls to Q the ends slip back at once, and the
# same with 2 mu p0 and c' = a sqrt(1 - (Q* - Q)/(2 mu P)) is taken away (K. L. Johnson, Contact
# Mechanics, 1985, chapter 7). These are half-planes, at the P that is measured.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

RADIUS, SIZE, DEPTH = 4.0, 12.0, 0.215  # of the pair; of the blocks; of the press


def arguments(argv=None):
    given = dict(n=20, friction=0.2, young=200.0, poisson=0.3)
    parser = ScriptParser("Cattaneo and Mindlin", output="output/mindlin", **given)
    parser.add_argument("--shear", type=number(above=0, below=1), default=0.46808, help="Q*/(mu P)")
    parser.add_argument("--back", type=number(), default=-0.1, help="Q/(mu P) at the end")
    parser.add_argument("--steps", type=number(int, above=0), default=8, help="each way")
    return parser.parse(argv)


def pair(args, comm):
    """The problem, the shear on its top, and its descent; n cells on half the contact."""
    h = 0.68 / args.n
    away = h * np.cumsum(1.25 ** np.arange(60))
    y = np.append(0.0, np.append(away[away < 0.8 * SIZE], SIZE))
    half = np.append(np.arange(0.0, 0.9, h), 0.9 + y[1:])
    x, square = np.append(-half[:0:-1], half), mesh.CellType.quadrilateral
    both = join([create_grid(comm, axes, square) for axes in ((x, y), (x, -y[::-1]))])
    domain, parts = both.mesh, both.cell_tags

    def facets(y, reach=np.inf):
        def on(x):
            return np.isclose(x[1], y) & (np.abs(x[0]) < reach)

        return np.sort(mesh.locate_entities_boundary(domain, 1, on))

    face, to_cells = facets(0.0, 0.9), domain.topology.connectivity(1, 2)
    upper = np.isin(to_cells.array[to_cells.offsets[face]], parts.find(1))
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    W, u = V.sub(1), fem.Function(V)
    pull, down, zero = (fem.Constant(domain, 0.0) for _ in range(3))
    shear = pull * u[0] * ufl.ds(subdomain_data=mesh.meshtags(domain, 1, facets(SIZE), 1))(1)
    energy = LinearElastic.from_young(args.young, args.poisson).energy(u) * ufl.dx - shear
    levels = (down, facets(SIZE)), (zero, facets(-SIZE))
    bcs = [fem.dirichletbc(v, fem.locate_dofs_topological(W, 1, on), W) for v, on in levels]
    foot = mesh.locate_entities_boundary(domain, 0, lambda x: np.hypot(x[0], x[1] + SIZE) < 1e-9)
    bcs.append(fem.dirichletbc(zero, fem.locate_dofs_topological(V.sub(0), 0, foot), V.sub(0)))
    given = dict(law=Coulomb(args.friction), gap=ufl.SpatialCoordinate(domain)[0] ** 2 / 2 / RADIUS)
    contact = ContactPair(u, face[upper], master_facets=face[~upper], **given)
    return ContactProblem(energy, u, [contact], bcs=bcs), pull, down, 2 * half[-1]


def main(argv=None):
    args, comm, force = arguments(argv), MPI.COMM_WORLD, [0.0]
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, pull, down, width = pair(args, comm)

    def load(t):  # down, to and fro
        part = np.interp(t, [1, 2, 3], [0, args.shear, args.back])
        down.value, pull.value = -DEPTH * min(t, 1.0), args.friction * force[-1] / width * part

    evolution = QuasiStatic(problem, load)
    pressed = evolution.run([0.0, 0.5, 1.0]).steps[-1].result
    force.append(pressed.tables["contact"].rn.sum())
    history = evolution.run(np.linspace(1.0, 3.0, 2 * args.steps + 1))
    a = np.sqrt(8 * force[-1] * RADIUS * (1 - args.poisson**2) / (np.pi * args.young))
    most = args.friction * 2 * force[-1] / (np.pi * a)
    c = [a * np.sqrt(1 - args.shear), a * np.sqrt(1 - (args.shear - args.back) / 2)]
    summary = {"force": force[-1], "contact_radius": a, "mu_p0": most}

    def hertz(x, c):
        return c / a * np.sqrt(np.maximum(1 - (x / c) ** 2, 0.0))

    for k, name in enumerate(("loading", "unloading")):
        table = history.at(2.0 + k).result.tables["contact"]
        x, q = table.x[:, 0], -table.along(table.shear) / most
        exact = hertz(x, a) - hertz(x, c[0]) - 2 * k * (hertz(x, a) - hertz(x, c[1]))
        ends = np.abs(np.abs(x)[:, None] - [a, *c[: k + 1]]).min(axis=1)
        off, stuck = np.abs(q - exact), np.abs(x[table.letters == "k"]).max()
        errors = np.sqrt(np.mean(off[np.abs(x) < a] ** 2)), off[ends > 2 * 0.68 / args.n].max()
        names = "l2_error", "worst_error", "stick_radius", "stick_radius_closed_form"
        summary[name] = dict(zip(names, (*errors, stuck, c[k]), strict=True))
        say(f"{name}: {summary[name]}")
        if comm.rank == 0:
            lines = {"computed": (x, q)}, {"half-planes": (x, exact)}
            output.draw_curves(folder / f"{name}.png", lines[0], dotted=lines[1])
    output.write_contact_table(comm, folder, [table])
    last = history.steps[-1].result.summary()
    return output.write_summary(comm, folder, last | summary | summary["loading"])


if __name__ == "__main__":
    main()
