# SPDX-License-Identifier: LGPL-3.0-or-later
# # A law of one's own
#
# The friction coefficient falls from a static to a kinetic value with the distance slipped, as on
# faults and brake pads. The law takes a few lines of UFL; Newton's method, histories and records
# need nothing else. {doc}`The theory </theory/1_laws>` defines a law.

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import LinearElastic

# ## The law
#
# A `FrictionLaw` gives the bound on the shear at a point with the pressure $p$, the radius of the
# friction disc:
#
# $$b(p, s) = \left(F_k + (F_s - F_k) e^{-s/D}\right) p,$$
#
# where $s$ is the distance slipped, `a.slid`, which is part of the memory of a history. Numbers in
# the law become Constants, which can be changed later; they may also be Functions.


@dataclass(frozen=True)
class SlipWeakening(FrictionLaw):
    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a, p):
        fade = ufl.exp(-a.slid / self.distance)
        return (self.kinetic + (self.static - self.kinetic) * fade) * p


# ## A block that is pulled
#
# The block of the third tutorial is pressed and then pulled to the right. Its top moves by 0.06,
# which is enough for slip everywhere. Friction falls within a slip of about 0.02; if it fell faster
# than the block can relax, the block would jump. `QuasiStatic` warns of a step in which the state
# may jump, and `locate_jumps=True` determines whether it does.

DISTANCE = 0.02

comm = MPI.COMM_WORLD
domain = mesh.create_rectangle(comm, [[0, 0], [2, 1]], (24, 12), mesh.CellType.quadrilateral)
top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1))
bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))


def pulled(static, kinetic):
    """Ratios of shear to normal force along the way of the top, and the last table."""
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    moved = fem.Constant(domain, (0.0, -0.01))
    bcs = [fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, top), V)]
    law = SlipWeakening(static, kinetic, DISTANCE)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    contact = ContactSurface(u, bottom, obstacle=floor, law=law)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [contact], bcs=bcs)
    problem.solve()

    def load(t):
        moved.value[0] = t

    history = QuasiStatic(problem, load).run(np.linspace(0.0, 0.06, 31))
    forces = np.array([step.result.resultants["contact"] for step in history.steps])
    ways = np.array([step.time for step in history.steps])
    plot.picture_of_contact("contact.png", problem, state=history.steps[-1].state)
    return ways, -forces[:, 0] / forces[:, 1], history.steps[-1].result.tables["contact"]


# ## Results
#
# With equal coefficients the law is that of Coulomb. With a smaller kinetic coefficient the force
# rises and falls again while the block slips. The largest force is below that of the static
# coefficient, since the points do not slip at the same time.

curves = {}
for static, kinetic in ((0.4, 0.4), (0.4, 0.2)):
    ways, ratios, table = pulled(static, kinetic)
    curves[f"static {static}, kinetic {kinetic}"] = (ways, ratios)
    print(f"static {static}, kinetic {kinetic}: largest {ratios.max():.4f}, last {ratios[-1]:.4f}")
plot.draw_curves("force.png", curves, labels=("way of the top", "shear over normal force"))

# ## Check
#
# With Coulomb's law the ratio of the forces ends at the coefficient. With the weakening law every
# slipping point is at its own bound, which depends on the distance it has slipped:

coulomb = curves["static 0.4, kinetic 0.4"][1]
weakened = curves["static 0.4, kinetic 0.2"][1]
fade = np.exp(-table.slid / DISTANCE)
slips = table.slips
expected = (0.2 + 0.2 * fade) * table.rn
print(f"{slips.sum()} of {len(slips)} points slip, by {table.slid[slips].max():.4f} at most")
assert np.isclose(coulomb[-1], 0.4)
assert 0.2 < weakened[-1] < weakened.max() < 0.4
assert np.allclose(np.abs(table.along(table.rt))[slips], expected[slips], rtol=1e-6)

# `demo_own_law.py` defines a law with its own statuses, and `demo_own_interface.py` an interface
# that stores and dissipates energy, like a glue.
