# SPDX-License-Identifier: LGPL-3.0-or-later
"""A bar pulled to and fro.

Reference: closed form. `demos/demo_bar.py` explains the problem.
"""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.continuation import Observers
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic


def arguments(argv=None):
    parser = ScriptParser("A bar on a floor", output="output/bar", n=200, young=1000.0)
    add = parser.add_argument
    add("--friction", action="store_true", help="what holds it; nothing else does")
    add("--pressure", type=number(above=0), default=1.0, help="on the floor")
    add("--mu", type=number(above=0), default=0.5, help="friction coefficient")
    add("--thin", type=number(above=1), default=100.0, help="slip over thickness")
    add("--steps", type=number(int, above=0), default=10, help="to the first turn")
    return parser.parse(argv)


def strip(args, comm):
    """The problem, its end force, and the mean motion of its end; n cells on the slip length 1."""
    length = 1.25
    thick = 1.0 / args.thin
    along = round(length * args.n)
    across = max(2, round(thick * args.n))
    x = np.linspace(-length, 0.0, along + 1)
    y = np.linspace(0.0, thick, across + 1)
    domain = create_grid(comm, (x, y), mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    pull = fem.Constant(domain, 0.0)

    def facets(axis, value):
        return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], value))

    def held(component, facets, value):
        W = V.sub(component)
        dofs = fem.locate_dofs_topological(W, 1, facets)
        return fem.dirichletbc(value, dofs, W)

    height = -args.pressure * thick / args.young
    mirror = held(1, facets(1, thick), height)
    far_end = held(0, facets(0, -length), 0.0)
    tags = mesh.meshtags(domain, 1, np.sort(facets(0, 0.0)), 1)
    ds = ufl.Measure("ds", subdomain_data=tags)
    moved = u[0] / thick * ds(1)
    material = LinearElastic.from_young(args.young, 0.0)
    energy = material.energy(u) * ufl.dx - pull * moved
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(u, facets(1, 0.0), obstacle=floor, law=Coulomb(args.mu))
    problem = ContactProblem(energy, u, [contact], bcs=[mirror, far_end])
    mean = fem.form(moved)

    def end():
        mine = fem.assemble_scalar(mean)
        return comm.allreduce(mine)

    return problem, pull, end


def closed_form(forces, EA, q):
    """End displacements along forces that go up and down: parabolas from turn to turn."""
    found = [0.0]
    turn_at = 0.0
    turn_force = 0.0
    sign = 1.0
    factor = 2.0
    for before, now in pairwise(forces):
        if (now - before) * sign < 0:
            turn_at = found[-1]
            turn_force = before
            sign = -sign
            factor = 4.0
        way = (now - turn_force) ** 2 / (factor * EA * q)
        found.append(turn_at + sign * way)
    return np.array(found)


def slip_length(table):
    """From the end to the middle between the last point that slips and the first that sticks."""
    x = table.x[:, 0]
    stuck = x[table.letters == "k"].max()
    slips = x[x > stuck].min()
    return -0.5 * (stuck + slips)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, pull, end = strip(args, comm)
    EA = args.young / args.thin
    q = args.mu * args.pressure
    n = args.steps
    problem.solve()

    def load(t):
        pull.value = q * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])

    curve = [[0.0, 0.0]]
    times = np.linspace(0.0, 5.0, 5 * n + 1)
    with io.EvolutionSeries(folder, problem, every=n) as series:

        def watch(step):
            curve.append([end(), float(pull.value)])

        history = QuasiStatic(problem, load).run(times, observer=Observers(series, watch))

    moved, forces = np.transpose(curve)
    closed = closed_form(forces, EA, q)
    turns = [history.at(t) for t in (1.0, 3.0, 5.0)]
    table = turns[0].result.tables["contact"]
    cycle = turns[2].energies.dissipated - turns[0].energies.dissipated
    found = {
        "slip_length": slip_length(table),
        "end_displacement": moved[n],
        "dissipation": cycle,
    }
    exact = {
        "slip_length": 1.0,
        "end_displacement": closed[n],
        "dissipation": 2 * q**2 / (3 * EA),
    }
    summary = turns[2].result.summary()
    summary["curve"] = curve
    summary["closed_form"] = np.column_stack([closed, forces])
    for name, value in found.items():
        say(f"{name}: {value:.6g}, closed form {exact[name]:.6g}")
        summary[name] = value
        summary[f"{name}_closed_form"] = exact[name]
    if comm.rank == 0:
        lines = {"plane strain": (moved, forces)}
        dotted = {"closed form": (closed, forces)}
        plot.draw_curves(folder / "curve.png", lines, dotted=dotted, labels=("end", "force"))
    io.write_contact_table(comm, folder, [table])
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
