# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shakedown of a block, search for counterexamples.

Reference: Klarbring, Ciavarella and Barber. `demos/demo_shakedown.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
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
from dolfinx_contact.algorithms import PointProblem
from dolfinx_contact.analysis import shakedown, wedging_friction
from dolfinx_contact.analysis.shakedown import shakedown_of
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

DOWN = -0.01  # motion of the top
ACROSS = 0.002  # its amplitude to and fro


def arguments(argv=None):
    parser = ScriptParser("Shakedown", output="output/shakedown", n=6, friction=0.3)
    parser.add_argument("--cases", type=number(int, above=0), default=200, help="of the search")
    return parser.parse(argv)


# A block on a floor, or on its mirror image.
#
# Of the pair both ends move, the lower one against the upper.


def block(n, friction, *, mirrored):
    """The problem, and the motions of its ends, Constants."""
    comm = MPI.COMM_WORLD
    cell = mesh.CellType.quadrilateral
    side = np.linspace(0.0, 1.0, n + 1)
    half = np.linspace(0.0, 0.5, max(n // 2, 1) + 1)
    bodies = [create_grid(comm, (side, half), cell)]
    if mirrored:
        bodies.append(create_grid(comm, (side, half - 0.5), cell))
    both = join(bodies)
    V = fem.functionspace(both.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    touching = mesh.locate_entities_boundary(both.mesh, 1, lambda x: np.isclose(x[1], 0.0))
    to_cells = both.mesh.topology.connectivity(1, 2)
    cells = to_cells.array[to_cells.offsets[touching]]
    upper = np.isin(cells, both.cell_tags.find(1))
    ends = []
    bcs = []
    for y in (0.5, -0.5) if mirrored else (0.5,):
        ends.append(fem.Constant(both.mesh, np.array([0.0, 0.0])))
        facets = mesh.locate_entities_boundary(both.mesh, 1, lambda x, y=y: np.isclose(x[1], y))
        bcs.append(fem.dirichletbc(ends[-1], fem.locate_dofs_topological(V, 1, facets), V))
    law = Coulomb(friction)
    if mirrored:
        contact = ContactPair(u, touching[upper], master_facets=touching[~upper], law=law)
    else:
        contact = ContactSurface(u, touching, obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [contact], bcs=bcs), ends


def moved(ends, across):
    """A function that moves the ends down and across, the lower one the other way."""

    def load():
        for sign, end in zip((1.0, -1.0), ends, strict=False):
            end.value[:] = (sign * across, sign * DOWN)

    return load


def bounds(n, friction, *, mirrored):
    """The static bound, with cycles below it and above it."""
    problem, ends = block(n, friction, mirrored=mirrored)
    corners = [moved(ends, ACROSS), moved(ends, -ACROSS)]
    steady = moved(ends, 0.0)
    below = shakedown(problem, corners, steady=steady, cycles=100)
    factor = 1.05 * below.factor if np.isfinite(below.factor) else 1.0
    above = shakedown(problem, corners, steady=steady, factor=factor, cycles=100, starts=0)
    return below, above, wedging_friction(problem).friction


# Two points.
#
# A search among random stiffnesses of two points that are pressed, with two corners of a load. What
# counts is a cycle below the bound that slips for ever with steps half as long too.


def search(cases):
    """Points, loads and results for which the bound promises rest that does not come."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(cases):
        B = rng.normal(size=(4, 4))
        friction = rng.uniform(0.2, 0.6)
        points = PointProblem(B @ B.T / 4 + 0.3 * np.eye(4), np.zeros(4), np.full(2, friction))
        steady = np.array([0.0, -1.0, 0.0, -1.0]) + 0.2 * rng.normal(size=4)
        loads = steady + 0.5 * rng.normal(size=(2, 4))
        result = shakedown_of(points, loads, steady, cycles=200)
        if not result.broken:
            continue
        finer = shakedown_of(points, loads, steady, cycles=200, steps=8)
        if len(finer.broken) == len(result.broken):
            found.append((points, loads, steady, result))
    return found


def draw(folder, name, below, above, friction):
    """Work of friction in cycles, and the slips and forces at rest."""
    work = {f"0.95, {c.start}": (1 + np.arange(c.number), c.dissipation) for c in below.cycles}
    (over,) = above.cycles
    work["1.05"] = (1 + np.arange(over.number), over.dissipation)
    few = {key: (x[:10], np.asarray(y)[:10]) for key, (x, y) in work.items()}
    labels = ("cycle", "work of friction")
    plot.draw_curves(folder / f"{name}_work.png", few, labels=labels)
    x = np.arange(len(below.slip)) / max(len(below.slip) - 1, 1)
    forces = {f"shear at corner {k}": (x, r[:, 0]) for k, r in enumerate(below.forces)}
    pressure = {f"F rn at corner {k}": (x, friction * r[:, 1]) for k, r in enumerate(below.forces)}
    plot.draw_curves(folder / f"{name}_rest.png", forces | pressure, labels=("x", "force"))


def summary_of(below, above, wedging):
    return {
        "factor": below.factor,
        "complete": below.complete,
        "theorem_holds": below.theorem_holds,
        "opened": "".join("o" if o else "c" for o in below.opened),
        "below": sorted({c.ending for c in below.cycles}),
        "above": sorted({c.ending for c in above.cycles}),
        "wedging": wedging,
    }


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    summary = {}
    for name in ("pair", "floor"):
        below, above, wedging = bounds(args.n, args.friction, mirrored=name == "pair")
        say(f"{name}: {below}\nabove it: {above.cycles[0]}\nwedged from F = {wedging:.6g} on")
        if comm.rank == 0:
            draw(folder, name, below, above, args.friction)
        summary[name] = summary_of(below, above, wedging)
    found = search(args.cases)
    for points, loads, steady, result in found[:3]:
        say(f"S = {points.S.tolist()}\nF = {points.friction[0]:.17g}, steady {steady.tolist()}")
        say(f"corners {loads.tolist()}\n{result}")
    mixed = [r for *_, r in found if any(c.ending == "rest" for c in r.cycles)]
    say(
        f"{len(found)} of {args.cases} never come to rest from some start, {len(mixed)} from others"
    )
    summary["broken"] = len(found)
    summary["broken_from_some_starts"] = len(mixed)
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
