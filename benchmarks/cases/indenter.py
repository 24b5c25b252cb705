# SPDX-License-Identifier: LGPL-3.0-or-later
"""An indenter drawn off a polymer.

Reference: Johnson, Kendall and Roberts.

A rigid cylinder of the radius R is pressed into a soft block (plane strain, half of it is
computed), rests for a time, and is drawn off. Nothing is bonded at first. Bonds grow by w/b per
time where the surfaces touch, and pull when the indenter goes up, until it comes off at once: the
state jumps there, if it is drawn slowly. Without recovery nothing sticks.

Where whole bonds break slowly and on a small length (that is E*/C), the force is that of Johnson,
Kendall and Roberts for a line contact, P(a) = pi E* a^2/(4 R) - (2 pi E* w a)^(1/2), the least of
which is -(3/4) (4 pi E* w^2 R)^(1/3) (Barquins, J. Adhesion 26, 1988). Viscosity adds to that.
No published parameters were found: N, mm, s below are our own, of a soft rubber.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, Sphere, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.materials import LinearElastic

RADIUS = 10.0  # of the indenter
SIZE = 6.0  # of the block
REACH = 1.2  # of the fine cells
WORK = 1e-3  # w
STIFFNESS = 12.5  # C
GROWTH = 0.05  # time b/w in which a bond grows
DEPTH = 0.04  # pressed in
OFF = 0.08  # drawn off to
SPEED = 0.1  # per time


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
    x = graded(SIZE, h, args.n, args.n // 3)
    square = mesh.CellType.quadrilateral
    below = graded(SIZE, h, 1, args.n // 2)
    domain = create_grid(comm, (x, -below[::-1]), square)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    centre = fem.Constant(domain, (0.0, 0.0))
    zero = fem.Constant(domain, 0.0)

    def held(axis, at):
        W = V.sub(axis)
        on = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], at))
        dofs = fem.locate_dofs_topological(W, 1, on)
        return fem.dirichletbc(zero, dofs, W)

    def may_touch(x):
        near = x[0] < 1.5 * REACH
        return np.isclose(x[1], 0) & near

    face = mesh.locate_entities_boundary(domain, 1, may_touch)
    given = dict(viscosity=GROWTH * WORK, beta=0.0, order=args.order, recovers=recovers)
    law = RCCM(STIFFNESS, STIFFNESS, WORK, **given)
    indenter = Sphere(centre, RADIUS)
    contact = ContactSurface(u, face, obstacle=indenter, law=law)
    material = LinearElastic.from_young(args.young, args.poisson)
    energy = material.energy(u) * ufl.dx
    bcs = [held(0, 0.0), held(1, -SIZE), held(0, SIZE)]
    problem = ContactProblem(energy, u, [contact], bcs=bcs)
    return problem, centre


def indented(args, comm, recovers, folder=None):
    """Depths, forces of both halves, and the history."""
    problem, centre = polymer(args, comm, recovers)
    way = np.array([OFF / 10, -DEPTH, -DEPTH, OFF])
    down = (way[0] + DEPTH) / SPEED
    up = (OFF + DEPTH) / SPEED
    turns = np.cumsum([0.0, down, args.rest, up])

    def load(t):
        centre.value[1] = RADIUS + np.interp(t, turns, way)

    times = [0.0]
    for k, steps in enumerate([args.steps // 4, 5, args.steps]):
        begin, end = turns[k : k + 2]
        if end > begin:  # without a rest there is none
            stops = np.linspace(begin, end, steps + 1)
            times.extend(stops[1:])
    history = QuasiStatic(problem, load).run(times, locate_jumps=True, at_jump="jump")
    if folder is not None:
        io.write_fields(folder, problem, state=history.steps[-1].state)
    depth = [-np.interp(s.time, turns, way) for s in history.steps]
    force = [2 * s.result.tables["contact"].rn.sum() for s in history.steps]
    return np.array(depth), np.array(force), history


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    modulus = args.young / (1 - args.poisson**2)
    johnson = 0.75 * (4 * np.pi * modulus * WORK**2 * RADIUS) ** (1 / 3)
    found = {"johnson_kendall_roberts": johnson}
    curves = {}
    for name, recovers in (("without_recovery", False), ("with_recovery", True)):
        fields = folder if recovers else None
        depth, force, history = indented(args, comm, recovers, fields)
        # The energies of the whole block, where the indenter is pulled most and at the end.
        strongest = int(np.argmin(force))
        energies = history.steps[strongest].energies
        last = history.energies
        found[name] = {
            "pull_off": float(-force.min()),
            "most": float(force.max()),
            "stored": 2 * energies.stored,
            "external": 2 * energies.external,
            "residue": 2 * energies.residue,
            "damage": 2 * last.damage,
            "jumps": [s.time for s in history.steps if s.jump],
        }
        title = name.replace("_", " ")
        curves[title] = (depth, force)
        say(f"{name}: {found[name]}")
    say(f"Johnson, Kendall and Roberts: {johnson:.4g} N/mm")
    if comm.rank == 0:
        labels = ("depth, mm", "force, N/mm")
        plot.draw_curves(folder / "force.png", curves, labels=labels)
    result = history.steps[-1].result
    summary = result.summary() | found
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
