# SPDX-License-Identifier: LGPL-3.0-or-later
"""A ductile glue.

Reference: a long bar. `demos/demo_own_interface.py` explains the problem.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import Interface, Internal
from dolfinx_contact.materials import LinearElastic

S = 2.0  # strength
A = 0.1  # jumps at the ends of the rise,
B = 0.3  # of the plateau
C = 0.6  # and of the fall
YOUNG = 1e4
THICKNESS = 0.1
LENGTH = 60.0


@dataclass(frozen=True)
class DuctileGlue(Interface):
    strength: Any
    rises: Any  # a
    yields: Any  # b
    breaks: Any  # c
    friction: Any = 0.0
    damage: Any = 0.0  # at the start
    internal = (Internal("damage", "grows", end=1.0),)

    def energy(self, state):
        stiffness = (1 - state["damage"]) * self.strength / self.rises
        return stiffness / 2 * ufl.dot(state.jump, state.jump)

    def dissipation(self, rates, state):
        a = self.rises
        b = self.yields
        c = self.breaks
        left = 1 - state["damage"]
        on_plateau = a / left
        on_fall = a * c / (a + left * (c - b))
        K = ufl.conditional(ufl.gt(left, a / b), on_plateau, on_fall)
        breaking = self.strength / a * K**2 / 2 * rates["damage"]
        rubbing = self.friction * state["damage"] * state.pressure * rates.slip
        return breaking + rubbing


def work(u):
    """Area under the traction of the glue up to a jump."""
    rise = np.minimum(u, A)
    plateau = np.clip(u - A, 0, B - A)
    fall = np.clip(u - B, 0, C - B)
    lost = fall**2 / (2 * (C - B))
    return S * (rise**2 / (2 * A) + plateau + fall - lost)


def arguments(argv=None):
    parser = ScriptParser("A sheet that is pulled off", output="output/own_interface", n=120)
    parser.add_argument("--steps", type=number(int, above=0), default=50, help="number of steps")
    return parser.parse(argv)


def glued(args, comm):
    """A sheet on a floor, pressed on it, and the Constant that draws its end along."""
    cell = mesh.CellType.quadrilateral
    corners = [[0.0, 0.0], [LENGTH, THICKNESS]]
    domain = mesh.create_rectangle(comm, corners, [args.n, 1], cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    pull = fem.Constant(domain, 0.0)
    still = fem.Constant(domain, 0.0)

    def edge(axis, at):
        return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], at))

    def held(axis, value, facets):
        W = V.sub(axis)
        dofs = fem.locate_dofs_topological(W, 1, facets)
        return fem.dirichletbc(value, dofs, W)

    end = edge(0, LENGTH)
    top = edge(1, THICKNESS)
    bcs = [held(0, pull, end), held(1, still, top)]
    free = LENGTH * (1 - 1.5 / args.n)  # what is held is no contact
    below = edge(1, 0.0)
    middles = mesh.compute_midpoints(domain, 1, below)
    glued_facets = below[middles[:, 0] < free]
    floor = HalfSpace((0, 0), (0, 1))
    glue = DuctileGlue(S, A, B, C)
    contact = ContactSurface(u, glued_facets, obstacle=floor, law=glue)
    material = LinearElastic.from_young(YOUNG, 0.0)
    energy = material.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [contact], bcs=bcs)
    return problem, pull


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, pull = glued(args, comm)

    def load(t):
        pull.value = t

    times = np.linspace(0.0, 1.2 * C, args.steps + 1)
    history = QuasiStatic(problem, load).run(times)
    tables = [s.result.tables["contact"] for s in history.steps]
    force = np.array([-t.force[:, 0].sum() for t in tables])
    u = np.array([t.ut[:, 0].max() for t in tables])  # where the glue ends
    exact = np.sqrt(2 * YOUNG * THICKNESS * work(u))
    off = np.abs(force / exact - 1)
    found = {"u": u, "force": force, "exact": exact, "off": np.max(off)}
    found |= history.energies.row()
    words = [f"{name}: {found[name]:.4g}" for name in ("off", "external", "damage", "residue")]
    say("; ".join(words))
    if comm.rank == 0:
        look = dict(labels=("jump at the end", "pull"), dotted={"a long bar": (u, exact)})
        plot.draw_curves(folder / "pull.png", {"glued sheet": (u, force)}, **look)
    plot.picture_of_contact(folder / "contact.png", problem, state=history.steps[-1].state)
    last = history.steps[-1].result
    summary = last.summary() | found
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
