# SPDX-License-Identifier: LGPL-3.0-or-later
# # A glass indenter on a polymer: adhesion that grows where they touch
#
# This demo illustrates how to:
#
# - let bonds form and recover at points that touch (`RCCM(..., recovers=True)`);
# - draw the force of an indenter over its depth, down, at rest and up, and balance the energies.
#
# A rigid cylinder of the radius R is pressed into a soft block (plane strain, half of it is
# computed), rests for a time, and is drawn off. Nothing is bonded at first. Bonds grow by w/b per
# time where the surfaces touch, and pull when the indenter goes up, until it comes off at once: the
# state jumps there, if it is drawn slowly. Without recovery nothing sticks.
#
# Where whole bonds break slowly and on a small length (that is E*/C), the force is that of Johnson,
# Kendall and Roberts for a line contact, P(a) = pi E* a^2/(4 R) - (2 pi E* w a)^(1/2), the least of
# which is -(3/4) (4 pi E* w^2 R)^(1/3) (Barquins, J. Adhesion 26, 1988). Viscosity adds to that.
# No published parameters were found: N, mm, s below are our own, of a soft rubber.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, Sphere, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.materials import LinearElastic

RADIUS, SIZE, REACH = 10.0, 6.0, 1.2  # of the indenter; of the block; of the fine cells
WORK, STIFFNESS, GROWTH = 1e-3, 12.5, 0.05  # w, C; time b/w in which a bond grows
DEPTH, OFF, SPEED = 0.04, 0.08, 0.1  # pressed in; drawn off to; per time


def arguments(argv=None):
    given = dict(n=30, young=1.0, poisson=0.45)
    parser = ScriptParser("A glass indenter on a polymer", output="output/indenter", **given)
    parser.add_argument("--rest", type=number(least=0), default=0.5, help="time at the depth")
    parser.add_argument("--steps", type=number(int, above=0), default=40, help="on the way up")
    parser.add_argument("--order", type=int, choices=[1, 2], default=2, help="in time")
    return parser.parse(argv)


def polymer(args, comm, recovers):
    """Half of a block, and the Constant that is the centre of the indenter."""
    h = REACH / args.n
    x, square = graded(SIZE, h, args.n, args.n // 3), mesh.CellType.quadrilateral
    domain = create_grid(comm, (x, -graded(SIZE, h, 1, args.n // 2)[::-1]), square)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, centre, zero = fem.Function(V), fem.Constant(domain, (0.0, 0.0)), fem.Constant(domain, 0.0)

    def held(axis, at):
        W = V.sub(axis)
        on = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], at))
        return fem.dirichletbc(zero, fem.locate_dofs_topological(W, 1, on), W)

    face = mesh.locate_entities_boundary(
        domain, 1, lambda x: np.isclose(x[1], 0) & (x[0] < 1.5 * REACH)
    )
    given = dict(viscosity=GROWTH * WORK, beta=0.0, order=args.order, recovers=recovers)
    law = RCCM(STIFFNESS, STIFFNESS, WORK, **given)
    contact = ContactSurface(u, face, obstacle=Sphere(centre, RADIUS), law=law)
    energy = LinearElastic.from_young(args.young, args.poisson).energy(u) * ufl.dx
    bcs = [held(0, 0.0), held(1, -SIZE), held(0, SIZE)]
    return ContactProblem(energy, u, [contact], bcs=bcs), centre


def indented(args, comm, recovers, folder=None):
    """Depths, forces of both halves, and the history."""
    problem, centre = polymer(args, comm, recovers)
    way = np.array([OFF / 10, -DEPTH, -DEPTH, OFF])
    turns = np.cumsum([0.0, (way[0] + DEPTH) / SPEED, args.rest, (OFF + DEPTH) / SPEED])

    def load(t):
        centre.value[1] = RADIUS + np.interp(t, turns, way)

    stops = [
        np.linspace(a, b, n + 1)[1:]
        for a, b, n in zip(turns, turns[1:], (args.steps // 4, 5, args.steps), strict=False)
        if b > a
    ]
    times = [0.0, *np.concatenate(stops)]
    history = QuasiStatic(problem, load).run(times, at_jump="jump")
    if folder is not None:
        output.write_fields(folder, problem)
    depth = [-np.interp(s.time, turns, way) for s in history.steps]
    force = [2 * s.result.tables["contact"].rn.sum() for s in history.steps]
    return np.array(depth), np.array(force), history


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    modulus = args.young / (1 - args.poisson**2)
    johnson = 0.75 * (4 * np.pi * modulus * WORK**2 * RADIUS) ** (1 / 3)
    summary, curves = {"johnson_kendall_roberts": johnson}, {}
    for name, recovers in (("without_recovery", False), ("with_recovery", True)):
        depth, force, history = indented(args, comm, recovers, folder if recovers else None)
        top = int(np.argmin(force))
        e, end = history.steps[top].energies, history.energies
        summary[name] = {"pull_off": float(-force.min()), "most": float(force.max())}
        summary[name] |= {"stored": 2 * e.stored, "external": 2 * e.external}
        summary[name] |= {"residue": 2 * e.residue, "damage": 2 * end.damage}
        summary[name]["jumps"] = [s.time for s in history.steps if s.jump]
        curves[name.replace("_", " ")] = (depth, force)
        say(f"{name}: {summary[name]}")
    say(f"Johnson, Kendall and Roberts: {johnson:.4g} N/mm")
    if comm.rank == 0:
        labels = ("depth, mm", "force, N/mm")
        output.draw_curves(folder / "force.png", curves, labels=labels)
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
