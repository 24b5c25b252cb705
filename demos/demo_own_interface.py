# SPDX-License-Identifier: LGPL-3.0-or-later
# # An interface law of your own
#
# This demo illustrates how to:
#
# - define an interface by its energy and its dissipation potential (`Interface`);
# - peel a sheet off a ductile glue, and compare the force with a closed form.
#
# The framework is that of Raous and of Del Piero (2010). With the jump $u$, the damage $D$ and the
# pressure $p$,
#
# $$\Psi = (1 - D)\, \frac{k}{2} |u|^2,\qquad
# \Phi = \frac{k}{2} K(D)^2\, \dot D + \mu D p\, |\dot u_t|,\qquad \dot D \ge 0.$$
#
# Hence $D$ grows where $|u|$ has reached $K(D)$. A ductile glue yields: its traction rises to the
# strength $s$ at the jump $a$, stays constant up to $b$, and falls to zero at $c$. For
# $1 - D > a/b$ this is $K = a/(1 - D)$, and otherwise $K = a c/(a + (1 - D)(c - b))$.
#
# A long sheet of thickness $t$ whose end has moved by $u$ is pulled with the force
# $\sqrt{2 E t\, W(u)}$, where $W$ is the area under the traction of the glue. The parameters are
# our own.

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import Interface, Internal
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
n, steps = 120, 50  # cells along the sheet, steps of the history
strength, a, b, c = 2.0, 0.1, 0.3, 0.6
young, thickness, length = 1e4, 0.1, 60.0

# ## The glue
#
# Damage, statuses and derivatives follow from the two potentials. An internal variable that `grows`
# cannot decrease; it ends at 1.


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
        left = 1 - state["damage"]
        on_plateau = self.rises / left
        on_fall = self.rises * self.breaks / (self.rises + left * (self.breaks - self.yields))
        K = ufl.conditional(ufl.gt(left, self.rises / self.yields), on_plateau, on_fall)
        breaking = self.strength / self.rises * K**2 / 2 * rates["damage"]
        rubbing = self.friction * state["damage"] * state.pressure * rates.slip
        return breaking + rubbing


# ## The sheet
#
# It moves along the floor only. The last cell and a half carry no glue, since the end is held.

corners = [[0.0, 0.0], [length, thickness]]
domain = mesh.create_rectangle(comm, corners, [n, 1], mesh.CellType.quadrilateral)
V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
u = fem.Function(V)
pull = fem.Constant(domain, 0.0)


def edge(axis, place):
    return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], place))


def held(axis, value, facets):
    W = V.sub(axis)
    return fem.dirichletbc(value, fem.locate_dofs_topological(W, 1, facets), W)


zero = fem.Constant(domain, 0.0)
bcs = [held(0, pull, edge(0, length)), held(1, zero, edge(1, thickness))]
bottom = edge(1, 0.0)
middles = mesh.compute_midpoints(domain, 1, bottom)[:, 0]
glued = bottom[middles < length * (1 - 1.5 / n)]
glue = DuctileGlue(strength, a, b, c)
contact = ContactSurface(u, glued, obstacle=HalfSpace((0, 0), (0, 1)), law=glue)
energy = LinearElastic.from_young(young, 0.0).energy(u) * ufl.dx
problem = ContactProblem(energy, u, [contact], bcs=bcs)

# ## The pull


def load(t):
    pull.value = t


history = QuasiStatic(problem, load).run(np.linspace(0.0, 1.2 * c, steps + 1))
tables = [step.result.tables["contact"] for step in history.steps]
force = np.array([-table.force[:, 0].sum() for table in tables])
jump = np.array([table.ut[:, 0].max() for table in tables])  # at the end of the glue

# ## Comparison

rise = np.minimum(jump, a) ** 2 / (2 * a)
plateau = np.clip(jump - a, 0, b - a)
fall = np.clip(jump - b, 0, c - b)
work = strength * (rise + plateau + fall - fall**2 / (2 * (c - b)))
exact = np.sqrt(2 * young * thickness * work)
worst = float(np.abs(force / exact - 1).max())
say = io.Report(comm)
say(f"force within {worst:.2e} of the closed form in all steps")
say(f"force at the end {force[-1]:.4f}, closed form {exact[-1]:.4f}")

folder = io.output_folder(comm, "output/own_interface")
if comm.rank == 0:
    labels = ("jump at the end", "force")
    curves, dotted = {"glued sheet": (jump, force)}, {"long bar": (jump, exact)}
    plot.draw_curves(folder / "force.png", curves, dotted=dotted, labels=labels)
plot.picture_of_contact(folder / "contact.png", problem, state=history.steps[-1].state)
