# SPDX-License-Identifier: LGPL-3.0-or-later
# # An interface of your own
#
# This demo illustrates how to:
#
# - write an interface by an energy and a potential of dissipation (`Interface`): its damage, its
#   statuses and all derivatives follow;
# - pull a sheet off that is glued to a floor, along it.
#
# The frame is that of Raous and of Del Piero (Eur. J. Mech. A/Solids 29, 2010). With the damage D,
#
#     Psi = (1 - D) k |u|^2/2,    Phi = k K(D)^2/2 D' + mu D p |u_t'|,    D' >= 0,
#
# so that D grows where k |u|^2/2 has come to k K(D)^2/2: K(D) is the jump at which a glue of the
# damage D goes on to break. Ductile glue yields: its traction rises to s at a, stays up to b, and
# falls to nothing at c. For D below 1 - a/b this is K = a/(1 - D), then a c/(a + (1 - D)(c - b)).
#
# A long sheet of the thickness t and Young's modulus E whose end has moved by u is pulled by
# (2 E t W(u))^(1/2), W being the area under the traction up to u. All parameters are our own.

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import Interface, Internal
from dolfinx_contact.materials import LinearElastic

S, A, B, C = 2.0, 0.1, 0.3, 0.6  # strength; jumps at the ends of rise, plateau and fall
YOUNG, THICKNESS, LENGTH = 1e4, 0.1, 60.0


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
        a, b, c, left = self.rises, self.yields, self.breaks, 1 - state["damage"]
        K = ufl.conditional(ufl.gt(left, a / b), a / left, a * c / (a + left * (c - b)))
        breaking = self.strength / a * K**2 / 2 * rates["damage"]
        return breaking + self.friction * state["damage"] * state.pressure * rates.slip


def work(u):
    """Area under the traction of the glue up to a jump."""
    rise, fall = np.minimum(u, A), np.clip(u - B, 0, C - B)
    return S * (rise**2 / (2 * A) + np.clip(u - A, 0, B - A) + fall - fall**2 / (2 * (C - B)))


def arguments(argv=None):
    parser = ScriptParser("A sheet that is pulled off", output="output/own_interface", n=120)
    parser.add_argument("--steps", type=number(int, above=0), default=50, help="number of steps")
    return parser.parse(argv)


def glued(args, comm):
    """A sheet on a floor, pressed on it, and the Constant that draws its end along."""
    cell, corners = mesh.CellType.quadrilateral, [[0.0, 0.0], [LENGTH, THICKNESS]]
    domain = mesh.create_rectangle(comm, corners, [args.n, 1], cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, pull, still = fem.Function(V), fem.Constant(domain, 0.0), fem.Constant(domain, 0.0)
    end, top, below = (
        mesh.locate_entities_boundary(domain, 1, lambda x, i=i, at=at: np.isclose(x[i], at))
        for i, at in ((0, LENGTH), (1, THICKNESS), (1, 0.0))
    )
    free = LENGTH * (1 - 1.5 / args.n)  # what is held is no contact
    floor = below[mesh.compute_midpoints(domain, 1, below)[:, 0] < free]
    bcs = [
        fem.dirichletbc(value, fem.locate_dofs_topological(V.sub(i), 1, facets), V.sub(i))
        for i, value, facets in ((0, pull, end), (1, still, top))
    ]
    glue = ContactSurface(u, floor, obstacle=HalfSpace((0, 0), (0, 1)), law=DuctileGlue(S, A, B, C))
    energy = LinearElastic.from_young(YOUNG, 0.0).energy(u) * ufl.dx
    return ContactProblem(energy, u, [glue], bcs=bcs), pull


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, pull = glued(args, comm)

    def load(t):
        pull.value = t

    times = np.linspace(0.0, 1.2 * C, args.steps + 1)
    history = QuasiStatic(problem, load).run(times)
    tables = [s.result.tables["contact"] for s in history.steps]
    force = np.array([-t.force[:, 0].sum() for t in tables])
    u = np.array([t.ut[:, 0].max() for t in tables])  # where the glue ends
    exact = np.sqrt(2 * YOUNG * THICKNESS * work(u))
    summary = {"u": u, "force": force, "exact": exact, "off": np.max(np.abs(force / exact - 1))}
    summary |= history.energies.row()
    say("; ".join(f"{k}: {summary[k]:.4g}" for k in ("off", "external", "damage", "residue")))
    if comm.rank == 0:
        look = dict(labels=("jump at the end", "pull"), dotted={"a long bar": (u, exact)})
        output.draw_curves(folder / "pull.png", {"glued sheet": (u, force)}, **look)
    output.picture_of_contact(folder / "contact.png", problem)
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
