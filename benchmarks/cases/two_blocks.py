# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two blocks along a path, or one static state.

Reference: own condensed code. `demos/demo_two_blocks.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join, name_groups


def arguments(argv=None):
    parser = ScriptParser("Two blocks", output="output/two_blocks", n=8, friction=0.25)
    pair = dict(type=number(), nargs=2)
    parser.add_argument(
        "--upper", default=[1000.0, 0.3], help="E and nu of the upper block", **pair
    )
    parser.add_argument("--lower", default=[300.0, 0.2], help="E and nu of the lower block", **pair)
    parser.add_argument("--rigid-floor", action="store_true", help="instead of the lower block")
    parser.add_argument("--static", action="store_true", help="the static law, one state")
    parser.add_argument("--top", default=[0.011, -0.01], help="its motion, if static", **pair)
    parser.add_argument("--ratio", type=number(int, above=0), default=1, help="so much finer below")
    return parser.parse(argv)


def blocks(args, comm):
    """Mesh with the groups upper, sole and top, and without a rigid floor lower, seat and base."""

    def at(y):
        return lambda x: np.isclose(x[1], y)

    cell = mesh.CellType.quadrilateral
    side = np.linspace(0.0, 1.0, args.n + 1)
    upper = create_grid(comm, (side, side), cell)
    upper = name_groups(upper, {"sole": at(0.0), "top": at(1.0)}, cells="upper")
    if args.rigid_floor:
        return upper
    across = np.linspace(0.0, 1.0, args.ratio * args.n + 1)
    up = np.linspace(-0.5, 0.0, max(args.n // 2, 1) + 1)
    lower = create_grid(comm, (across, up), cell)
    return join([upper, name_groups(lower, {"seat": at(0.0), "base": at(-0.5)}, cells="lower")])


def problem(args, comm):
    """The problem, and the motion of the top, a Constant."""
    body = blocks(args, comm)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    energy = LinearElastic.from_young(*args.upper).energy(u) * body.dx("upper")
    top = fem.Constant(body.mesh, np.array(args.top))
    law = Coulomb(args.friction)
    bcs = [fem.dirichletbc(top, body.dofs(V, "top"), V)]
    if args.rigid_floor:
        floor = HalfSpace((0, 0), (0, 1))
        contact = ContactSurface(u, body, tag="sole", obstacle=floor, law=law)
    else:
        energy += LinearElastic.from_young(*args.lower).energy(u) * body.dx("lower")
        bcs.append(fem.dirichletbc(np.zeros(2), body.dofs(V, "base"), V))
        contact = ContactPair(u, body, slave="sole", master="seat", law=law)
    return ContactProblem(energy, u, [contact], bcs=bcs), top


# `QuasiStatic` calls the load at a time and finds the equilibrium there, with friction against
# the slip since the time before. A unit of time is a step: down, to the right, to the left, up.
def along_the_path(both, top, observer=None):
    corners = [0, 5, 13, 29, 37]
    across = (0.0, 0.0, 0.011, -0.011, -0.004)
    up = (0.0, -0.01, -0.01, -0.01, 0.001)

    def load(t):
        top.value = [np.interp(t, corners, values) for values in (across, up)]

    return QuasiStatic(both, load).run(np.arange(38), observer=observer)


def summary_of(table, dissipation):
    ut = table.along(table.ut)
    rt = table.along(table.rt)
    return {
        "status": table.status,
        "ut": ut,
        "un": table.un,
        "rt": rt,
        "rn": table.rn,
        "sum_rt": rt.sum(),
        "sum_rn": table.rn.sum(),
        "dissipation": dissipation,
    }


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    both, top = problem(args, comm)
    if args.static:
        result = both.solve()
        state = both.snapshot()
        steps = [summary_of(result.tables["contact"], 0.0)]
    else:
        with io.EvolutionSeries(folder, both) as series:
            found = along_the_path(both, top, series).steps
        result = found[12].result  # at the end of the first shear
        state = found[-1].state
        steps = []
        for step in found:
            table = step.result.tables["contact"]
            steps.append(summary_of(table, step.energies.dissipated))
    for row in steps:
        say(f"{row['status']}  dissipated {row['dissipation']:.6g}")
    plot.picture_of_contact(folder / "contact.png", both, state=state)
    plot.picture_of_body(folder / "body.png", both, state=state, scale=10.0)
    io.write_fields(folder, both, state=state)
    io.write_contact_table(comm, folder, result.tables.values())
    summary = result.summary()
    summary["steps"] = steps
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
