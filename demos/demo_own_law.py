# SPDX-License-Identifier: LGPL-3.0-or-later
# # A friction law of your own
#
# This demo illustrates how to:
#
# - write a friction law in a few lines, by its bound on the shear (`FrictionLaw.bound`);
# - write any contact law, status by status (`Law`).
#
# A law is UFL in the jump and the traction at one point (`ContactPoint`). It is written once; the
# derivatives for Newton's method, the statuses, the kinks of branches and the measures of a
# violation are derived from it.

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, io, plot
from dolfinx_contact.laws import OPEN, PLUS, STICK, Border, FrictionLaw, Law, StatusPiece
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
n = 8  # cells along an edge
along, across, angle = 0.1, 0.4, 0.5  # friction coefficients, and the angle of the grain
shift, press = 0.01, 0.01  # of the top

# ## Static and kinetic friction
#
# The friction coefficient falls from a static to a kinetic value with the slip $s$,
#
# $$|t| \le \left(\mu_k + (\mu_s - \mu_k)\, e^{-s/d}\right) p.$$
#
# `a.slid` is the slip and `p` the pressure. The fields of a law may be numbers, Constants or
# Functions.


@dataclass(frozen=True)
class SlipWeakening(FrictionLaw):
    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a, p):
        drop = self.static - self.kinetic
        return (self.kinetic + drop * ufl.exp(-a.slid / self.distance)) * p


# ## Orthotropic friction
#
# On wood, the shear lies in an ellipse that is wider across the grain than along it. A slipping
# point dissipates the most energy:
#
# $$t = -p\, A\, \frac{A u_t}{|A u_t|},\qquad A = \mathrm{diag}(\mu_{\text{along}},
# \mu_{\text{across}}).$$
#
# In the coordinates $q = A^{-1} t$ the ellipse is a disc, onto which $q$ is projected. Each status
# has a traction and borders, which are functions that are positive inside. The augmentation
# parameter `a.r` scales displacements to tractions.


@dataclass(frozen=True)
class Orthotropic(Law):
    along: Any
    across: Any
    angle: Any  # of the grain with the x axis

    def pieces(self, a):
        grain = ufl.as_vector([ufl.cos(self.angle), ufl.sin(self.angle), 0.0])
        grain = grain - ufl.dot(grain, a.n) * a.n
        e = grain / ufl.sqrt(ufl.dot(grain, grain))
        f = ufl.cross(a.n, e)

        def scaled(coefficient, axis):
            traction = ufl.dot(a.traction, axis)
            slip = ufl.dot(a.u_t, axis)
            return traction / coefficient - a.r * coefficient * slip

        q_along = scaled(self.along, e)
        q_across = scaled(self.across, f)
        size = ufl.sqrt(q_along**2 + q_across**2)
        pressure = -a.p * a.n
        shear = self.along * q_along * e + self.across * q_across * f

        closes = Border(-a.p, PLUS)
        opens = Border(a.p, OPEN)
        slips = Border(a.p - size, PLUS)
        sticks = Border(size - a.p, STICK)
        return {
            OPEN: StatusPiece(0.0 * a.n, [closes]),
            STICK: StatusPiece(pressure + shear, [opens, slips]),
            PLUS: StatusPiece(pressure + a.p * shear / size, [opens, sticks]),
        }


# ## A block dragged over a floor
#
# The top of an elastic cube is pressed down and moved in the $x$ direction.


def block(law):
    domain = mesh.create_unit_cube(comm, n, n, n, mesh.CellType.hexahedron)
    bottom = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0))
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1))
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    dofs = fem.locate_dofs_topological(V, 2, top)
    moved = fem.dirichletbc(np.array([shift, 0.0, -press]), dofs, V)
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=law)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=[moved])


# Orthotropic friction pushes the block sideways although the motion is along $x$. A law that is
# wrongly implemented would violate the residual of the contact law, which is evaluated
# independently of Newton's method.
#
# Newton's method with full steps does not converge from zero to the orthotropic solution, because
# the coefficient along the grain is small. The first solve therefore takes twice this coefficient,
# and the second one begins with its solution. A number in a law is a Constant of the problem.

say = io.Report(comm)
folder = io.output_folder(comm, "output/own_law")
laws = {
    "orthotropic": Orthotropic(along, across, angle),
    "weakening": SlipWeakening(static=across, kinetic=along, distance=2 * shift),
}
results = {}
for name, law in laws.items():
    problem = block(law)
    if name == "orthotropic":
        problem.surfaces[0].law.along.value = 2 * along
        problem.solve()
        problem.surfaces[0].law.along.value = along
    results[name] = result = problem.solve()
    force = result.resultants["contact"]
    say(f"{name}: force of the floor {np.round(force, 4)}, {result.counts}")
    say(f"{name}: violation of the contact law {result.kkt_violation:.1e}")
    plot.picture_of_contact(folder / f"{name}.png", problem)

# ## Verification
#
# Where a point slips, the vector of the scaled shears $t_e/\mu_{\text{along}}$ and
# $t_f/\mu_{\text{across}}$ must have the length $p$.

table = results["orthotropic"].tables["contact"]
c, s = np.cos(angle), np.sin(angle)
t_along = table.rt[:, 0] * c + table.rt[:, 1] * s
t_across = -table.rt[:, 0] * s + table.rt[:, 1] * c
slips = table.letters == "s"
length = np.hypot(t_along / along, t_across / across)[slips]
worst = float(np.abs(length / table.rn[slips] - 1).max())
say(f"slipping points are on the ellipse to {worst:.1e}")
