# SPDX-License-Identifier: LGPL-3.0-or-later
# # A long bar pulled over a floor that holds it by friction
#
# This demo illustrates how to:
#
# - load a body back and forth in time (`QuasiStatic`), by a force;
# - look at what friction dissipates in a cycle, and compare with closed forms.
#
# A strip lies between two floors that press on it; of one half the upper face is the mirror plane,
# held where the pressure is p. It is pulled at its end by a force P per width, and slips as far as
# friction, q = mu p per length, must hold it: with the stiffness EA by P/q, its end by
# P^2/(2 EA q). When the force falls by D the end slips back over D/(2 q), by D^2/(4 EA q). A cycle
# between P and -P dissipates 2 P^3/(3 EA q). Shear across the thickness, which a bar does not know,
# moves the end of the slip by about that.

from itertools import pairwise

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic


def arguments(argv=None):
    parser = ScriptParser("A bar on a floor", output="output/bar", n=200, young=1000.0)
    parser.add_argument("--friction", action="store_true", help="what holds it; nothing else does")
    parser.add_argument("--pressure", type=number(above=0), default=1.0, help="on the floor")
    parser.add_argument("--mu", type=number(above=0), default=0.5, help="friction coefficient")
    parser.add_argument("--thin", type=number(above=1), default=100.0, help="slip over thickness")
    parser.add_argument("--steps", type=number(int, above=0), default=10, help="to the first turn")
    return parser.parse(argv)


def strip(args, comm):
    """The problem, its end force, and the mean motion of its end; n cells on the slip length 1."""
    thick, length = 1.0 / args.thin, 1.25
    cells = round(length * args.n), max(2, round(thick * args.n))
    axes = np.linspace(-length, 0.0, cells[0] + 1), np.linspace(0.0, thick, cells[1] + 1)
    domain = create_grid(comm, axes, mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, pull = fem.Function(V), fem.Constant(domain, 0.0)

    def facets(axis, value):
        return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], value))

    def held(component, facets, value):
        W = V.sub(component)
        return fem.dirichletbc(value, fem.locate_dofs_topological(W, 1, facets), W)

    height = -args.pressure * thick / args.young
    bcs = [held(1, facets(1, thick), height), held(0, facets(0, -length), 0.0)]
    tags = mesh.meshtags(domain, 1, np.sort(facets(0, 0.0)), 1)
    moved = u[0] / thick * ufl.ds(subdomain_data=tags)(1)
    energy = LinearElastic.from_young(args.young, 0.0).energy(u) * ufl.dx - pull * moved
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(u, facets(1, 0.0), obstacle=floor, law=Coulomb(args.mu))
    problem = ContactProblem(energy, u, [contact], bcs=bcs)
    mean = fem.form(moved)
    return problem, pull, lambda: comm.allreduce(fem.assemble_scalar(mean))


def closed_form(forces, EA, q):
    """End displacements along forces that go up and down: parabolas from turn to turn."""
    found, turn, sign, factor = [0.0], (0.0, 0.0), 1.0, 2.0
    for before, now in pairwise(forces):
        if (now - before) * sign < 0:
            turn, sign, factor = (found[-1], before), -sign, 4.0
        found.append(turn[0] + sign * (now - turn[1]) ** 2 / (factor * EA * q))
    return np.array(found)


def slip_length(table):
    """From the end to the middle between the last point that slips and the first that sticks."""
    stuck = table.x[table.letters == "k", 0].max()
    return -0.5 * (stuck + table.x[table.x[:, 0] > stuck, 0].min())


def main(argv=None):
    args, comm, curve = arguments(argv), MPI.COMM_WORLD, [[0.0, 0.0]]
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, pull, end = strip(args, comm)
    EA, q, n = args.young / args.thin, args.mu * args.pressure, args.steps
    problem.solve()

    def load(t):
        pull.value = q * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])

    with output.EvolutionSeries(folder, problem, every=n) as series:
        history = QuasiStatic(problem, load).run(
            np.linspace(0.0, 5.0, 5 * n + 1),
            observer=lambda step: (series(step), curve.append([end(), float(pull.value)])),
        )
    moved, forces = np.transpose(curve)
    closed, turns = closed_form(forces, EA, q), [history.at(t) for t in (1.0, 3.0, 5.0)]
    table, spent = turns[0].result.tables["contact"], [s.energies.dissipated for s in turns]
    summary = {"curve": curve, "closed_form": np.column_stack([closed, forces])}
    for name, value, exact in (
        ("slip_length", slip_length(table), 1.0),
        ("end_displacement", moved[n], closed[n]),
        ("dissipation", spent[2] - spent[0], 2 * q**2 / (3 * EA)),
    ):
        say(f"{name}: {value:.6g}, closed form {exact:.6g}")
        summary |= {name: value, f"{name}_closed_form": exact}
    if comm.rank == 0:
        lines = {"plane strain": (moved, forces)}, {"closed form": (closed, forces)}
        output.draw_curves(folder / "curve.png", lines[0], dotted=lines[1], labels=("end", "force"))
    output.write_contact_table(comm, folder, [table])
    return output.write_summary(comm, folder, turns[2].result.summary() | summary)


if __name__ == "__main__":
    main()
