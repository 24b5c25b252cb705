# SPDX-License-Identifier: LGPL-3.0-or-later
"""A fibre in a matrix.

Reference: a bar. `demos/demo_pull_out.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactPair, ContactProblem, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import Axisymmetric, LinearElastic
from dolfinx_contact.meshing import join

A = 0.25  # radius of the fibre
B = 1.0  # and of the matrix
FREE = 0.5  # length of the fibre outside
FIBRE = 5e3
MATRIX = 30e3
BOND = 625.0
WORK = 0.01
U0 = np.sqrt(WORK / BOND)
EA = np.pi * A**2 * FIBRE


def arguments(argv=None):
    parser = ScriptParser("A fibre that is pulled out", output="output/pull_out", n=8, friction=0.3)
    add = parser.add_argument
    add("--length", type=number(above=0), default=10.0, help="of the fibre in the matrix, mm")
    add("--misfit", type=number(least=0), default=6e-5, help="of the radii, mm")
    add("--end", type=number(above=0), default=0.12, help="where the fibre is drawn to, mm")
    add("--steps", type=number(int, above=0), default=60, help="on the way")
    return parser.parse(argv)


def lame(misfit):
    of_fibre = 1 / FIBRE
    of_matrix = (B**2 + A**2) / (B**2 - A**2) / MATRIX
    return misfit / A / (of_fibre + of_matrix)


def facets(domain, axis, at, top=np.inf):
    found = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], at))
    heights = mesh.compute_midpoints(domain, 1, found)[:, 1]
    return np.sort(found[heights < top])


def problem(args, comm):
    """The problem, and the Constant by which the end of the fibre is drawn."""

    def cut(length):
        cells = max(1, round(length * args.n))
        return np.linspace(0, length, cells + 1)

    L = args.length
    up = cut(L)
    outside = cut(FREE)
    square = mesh.CellType.quadrilateral
    fibre_radii = np.linspace(0, A, 3)
    fibre_heights = np.append(up, L + outside[1:])
    fibre = create_grid(comm, (fibre_radii, fibre_heights), square)
    matrix_radii = A + (B - A) * np.array([0, 0.1, 0.3, 0.6, 1])
    matrix = create_grid(comm, (matrix_radii, up), square)

    fibre_face = mesh.meshtags(fibre, 1, facets(fibre, 0, A, L), 1)
    matrix_face = mesh.meshtags(matrix, 1, facets(matrix, 0, A, L), 2)
    both = join([fibre, matrix], facet_tags=[fibre_face, matrix_face])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    drawn = fem.Constant(domain, 0.0)

    dx = ufl.Measure("dx", subdomain_data=both.cell_tags)
    polymer = Axisymmetric(LinearElastic.from_young(FIBRE, 0.0))
    stiff = Axisymmetric(LinearElastic.from_young(MATRIX, 0.0))
    energy = polymer.energy(u) * dx(1)
    energy += stiff.energy(u) * dx(2)

    law = RCCM(BOND, BOND, WORK, args.friction)
    clamp = dict(gap=-args.misfit, interference=True)
    pair = ContactPair(u, both, slave=1, master=2, law=law, axisymmetric=True, **clamp)

    W = V.sub(1)
    end = fem.locate_dofs_topological(W, 1, facets(domain, 1, L + FREE))
    rim = fem.locate_dofs_topological(W, 1, facets(domain, 0, B))
    bcs = [fem.dirichletbc(drawn, end, W), fem.dirichletbc(0.0, rim, W)]
    return ContactProblem(energy, u, [pair], bcs=bcs), drawn


def closed_form(u, shear):
    v = np.maximum(u, U0)  # where the bond damages
    rubbed = shear * (v - U0 + U0 * (U0 / v - 1))
    bonded = BOND * u**2 / 2
    damaged = WORK - WORK * (U0 / v) ** 2 / 2 + rubbed
    phi = np.where(u < U0, bonded, damaged)
    return np.sqrt(4 * np.pi * A * EA * phi)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    bodies, drawn = problem(args, comm)
    clamped = bodies.solve().tables["contact"]

    def load(t):
        drawn.value = t * args.end

    times = np.linspace(0.0, 1.0, args.steps + 1)
    with io.EvolutionSeries(folder, bodies, every=5) as series:
        steps = (
            QuasiStatic(bodies, load)
            .run(times, locate_jumps=True, at_jump="jump", observer=series)
            .steps
        )

    tables = [s.result.tables["contact"] for s in steps]
    end = args.end * np.array([s.time for s in steps])
    force = np.array([-s.result.resultants["contact"][1] for s in steps])
    foot = np.array([t.ut[0, 1] for t in tables])
    mouth = np.array([t.ut[-1, 1] for t in tables])
    pressure = lame(args.misfit)
    shear = args.friction * pressure
    closed = closed_form(mouth, shear)
    area = clamped.area.sum()
    found = {
        "pressure": clamped.rn.sum() / area,
        "peak": force.max(),
        "plateau": force[-1],
        "plateau_closed_form": area * shear,
        "pressure_closed_form": pressure,
    }
    words = [f"{name} {value:.6g}" for name, value in found.items()]
    say(", ".join(words))

    if comm.rank == 0:
        still = foot < 0.1 * U0  # as the closed form requires
        curves = {"elastic body": (end, force)}
        dotted = {"bar": (end[still], closed[still])}
        names = ("end of the fibre, mm", "force, N")
        plot.draw_curves(folder / "curve.png", curves, dotted=dotted, labels=names)
    plot.picture_of_body(folder / "body.png", bodies)
    io.write_contact_table(comm, folder, tables[-1:])

    found["jumps"] = [s.time * args.end for s in steps if s.jump]
    found["curve"] = {
        "end": end,
        "mouth": mouth,
        "foot": foot,
        "force": force,
        "closed_form": closed,
        "external": [s.energies.external for s in steps],
        "residue": [s.energies.residue for s in steps],
    }
    return io.write_summary(comm, folder, steps[-1].result.summary() | found)


if __name__ == "__main__":
    main()
