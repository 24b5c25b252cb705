# SPDX-License-Identifier: LGPL-3.0-or-later
# # A law of your own
#
# This demo illustrates how to:
#
# - write a friction law in a few lines: how large the shear may be (`FrictionLaw.bound`);
# - write any law of contact: what it answers, status by status, and where a status ends (`Law`).
#
# A law is UFL in the jump and the traction at one point (`ContactPoint`), and is written once.
# Statuses, derivatives, kinks of branches and the measures of a violation follow from it.

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.laws import OPEN, PLUS, STICK, Border, FrictionLaw, Law, StatusPiece
from dolfinx_contact.materials import LinearElastic

# ## Static and kinetic friction
#
# The coefficient falls from the static to the kinetic value as a point slips. Fields of a law may
# be numbers, Constants or Functions.


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
# Wood, say: the shear lies in an ellipse, wider across the grain than along it, and a slipping
# point dissipates the most, t = -p A (A u_t)/|A u_t| with A = diag(along, across). In q = A^{-1} t
# the ellipse is a disc, onto which q is projected. Distances to borders are positive inside.


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
        t, u = ([ufl.dot(v, axis) for axis in (e, f)] for v in (a.traction, a.u_t))
        A = (self.along, self.across)
        q = [t[i] / A[i] - a.r * A[i] * u[i] for i in range(2)]
        size = ufl.sqrt(q[0] ** 2 + q[1] ** 2)
        pressure, shear = -a.p * a.n, A[0] * q[0] * e + A[1] * q[1] * f
        return {
            OPEN: StatusPiece(0.0 * a.n, [Border(-a.p, PLUS)]),
            STICK: StatusPiece(pressure + shear, [Border(a.p, OPEN), Border(a.p - size, PLUS)]),
            PLUS: StatusPiece(
                pressure + a.p * shear / size, [Border(a.p, OPEN), Border(size - a.p, STICK)]
            ),
        }


def arguments(argv=None):
    block = dict(n=8, young=1000.0, poisson=0.3, press=0.01, shift=0.01)
    parser = ScriptParser("Friction laws of your own", output="output/own_law", **block)
    parser.add_argument("--along", type=number(above=0), default=0.1, help="friction coefficient")
    parser.add_argument("--across", type=number(above=0), default=0.4, help="the same")
    parser.add_argument("--angle", type=number(), default=0.5, help="of the grain, in radians")
    return parser.parse(argv)


# ## A block dragged over a floor, which pushes it aside where the law is orthotropic


def problem(law, args, comm=MPI.COMM_WORLD):
    domain = mesh.create_unit_cube(comm, args.n, args.n, args.n, mesh.CellType.hexahedron)
    bottom, top = (
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z)) for z in (0, 1)
    )
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    dofs = fem.locate_dofs_topological(V, 2, top)
    held = fem.dirichletbc(np.array([args.shift, 0.0, -args.press]), dofs, V)
    floor = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0, 0), (0, 0, 1)), law=law)
    energy = LinearElastic.from_young(args.young, args.poisson).energy(u) * ufl.dx
    return ContactProblem(energy, u, [floor], bcs=[held])


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    summary, laws = {}, {"orthotropic": Orthotropic(args.along, args.across, args.angle)}
    laws["weakening"] = SlipWeakening(args.across, args.along, 2.0 * args.shift)
    for name, law in laws.items():
        block = problem(law, args)
        result = block.solve()
        fx, fy, fz = result.resultants["contact"]
        say(f"{name}: the floor answers ({fx:.4g}, {fy:.4g}, {fz:.4g}); {result.counts}")
        output.picture_of_contact(folder / f"{name}.png", block)
        summary |= {f"{k}_{name}": v for k, v in result.summary().items()}
    return output.write_summary(comm, folder, result.summary() | summary)


if __name__ == "__main__":
    main()
