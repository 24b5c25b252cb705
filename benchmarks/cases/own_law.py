# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slip weakening and orthotropic friction.

Reference: the contact law. `demos/demo_own_law.py` explains the problem.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, io, plot
from dolfinx_contact.laws import OPEN, PLUS, STICK, Border, FrictionLaw, Law, StatusPiece
from dolfinx_contact.materials import LinearElastic


@dataclass(frozen=True)
class SlipWeakening(FrictionLaw):
    static: Any
    kinetic: Any
    distance: Any

    def bound(self, a, p):
        drop = self.static - self.kinetic
        return (self.kinetic + drop * ufl.exp(-a.slid / self.distance)) * p


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

        def projected(coefficient, axis):
            traction = ufl.dot(a.traction, axis)
            slip = ufl.dot(a.u_t, axis)
            return traction / coefficient - a.r * coefficient * slip

        q_along = projected(self.along, e)
        q_across = projected(self.across, f)
        size = ufl.sqrt(q_along**2 + q_across**2)
        pressure = -a.p * a.n
        shear = self.along * q_along * e + self.across * q_across * f
        largest = a.p * shear / size

        closes = Border(-a.p, PLUS)
        opens = Border(a.p, OPEN)
        slips = Border(a.p - size, PLUS)
        sticks = Border(size - a.p, STICK)
        return {
            OPEN: StatusPiece(0.0 * a.n, [closes]),
            STICK: StatusPiece(pressure + shear, [opens, slips]),
            PLUS: StatusPiece(pressure + largest, [opens, sticks]),
        }


def arguments(argv=None):
    block = dict(n=8, young=1000.0, poisson=0.3, press=0.01, shift=0.01)
    parser = ScriptParser("Friction laws of your own", output="output/own_law", **block)
    positive = number(above=0)
    parser.add_argument("--along", type=positive, default=0.1, help="friction coefficient")
    parser.add_argument("--across", type=positive, default=0.4, help="the same")
    parser.add_argument("--angle", type=number(), default=0.5, help="of the grain, in radians")
    return parser.parse(argv)


def problem(law, args, comm=MPI.COMM_WORLD):
    domain = mesh.create_unit_cube(comm, args.n, args.n, args.n, mesh.CellType.hexahedron)
    bottom = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0))
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1))
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    dofs = fem.locate_dofs_topological(V, 2, top)
    shift = np.array([args.shift, 0.0, -args.press])
    held = fem.dirichletbc(shift, dofs, V)
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=law)
    elastic = LinearElastic.from_young(args.young, args.poisson)
    energy = elastic.energy(u) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=[held])


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    orthotropic = Orthotropic(args.along, args.across, args.angle)
    weakening = SlipWeakening(args.across, args.along, 2.0 * args.shift)
    summary = {}
    for name, law in (("orthotropic", orthotropic), ("weakening", weakening)):
        block = problem(law, args)
        result = block.solve()
        fx, fy, fz = result.resultants["contact"]
        say(f"{name}: the floor answers ({fx:.4g}, {fy:.4g}, {fz:.4g}); {result.counts}")
        plot.picture_of_contact(folder / f"{name}.png", block)
        for key, value in result.summary().items():
            summary[f"{key}_{name}"] = value
    last = result.summary()
    return io.write_summary(comm, folder, last | summary)


if __name__ == "__main__":
    main()
