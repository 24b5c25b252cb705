# SPDX-License-Identifier: LGPL-3.0-or-later
# # A pile drawn out of soil
#
# This demo illustrates how to:
#
# - begin with bodies under stress: the earth pressure at rest, in balance for no displacement;
# - join bodies of revolution by a bond that breaks, and rubs the more the deeper it is (`RCCM`).
#
# A concrete pile of the radius a stands in soil of the weight g down to L. At rest the soil is, at
# y < 0, under the stresses g y along the axis and K0 g y across it, the pile under the latter (its
# own weight, one load more, is left out). The energy has them as sigma0 : eps(u), with the weight
# and the pressure from under L; -K0 g y presses on the shaft. The base has no contact: it is free.
#
# The soil is held at r = R, and shears like the cylinders of Randolph and Wroth (J. Geotech. Eng.
# Div. ASCE 104, 1978): a shear t of the shaft lifts it by t a/G ln(R/a). With one slip u all along
# a bond of the stiffness C and the work w = C u0^2 the pile is drawn by
#     P = 2 pi a L C u  up to u0,   then   2 pi a L C u0^4/u^3 + pi a mu K0 g L^2 (1 - (u0/u)^2),
# and its head, L0 above ground, lifted by u + P (ln(R/a)/(2 pi G L) + (L/3 + L0)/EA). In a soil
# softer than 3 C the curve could turn back. The ends of the soil are free, as no cylinders' are: it
# gives way by a part of the order R/L more, and bends, which presses at the base and frees the top.
# Units are m, kN and kPa; the parameters are our own choice, of a plausible order.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactPair, ContactProblem, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import Axisymmetric, LinearElastic, circumference
from dolfinx_contact.meshing import join

A, FREE, PILE, SOIL = 0.3, 0.5, (30e6, 0.2), (40e3, 0.3)  # a, L0, E and nu
WEIGHT, REST, BOND, U0 = 10.0, 0.5, 4e3, 7.5e-3  # g (under water), K0, C, u0


def arguments(argv=None):
    parser = ScriptParser("A pile drawn out of soil", output="output/pile", n=20, friction=0.5)
    parser.add_argument("--depth", type=number(above=0), default=10.0, help="of the base, L, m")
    parser.add_argument("--radius", type=number(above=A), default=5.0, help="of held soil, R, m")
    parser.add_argument("--steps", type=number(int, above=0), default=16, help="up to the peak")
    return parser.parse(argv)


def pile_in_soil(args, comm):
    """The problem, and the Constant by which the head of the pile is drawn."""
    L, R, shaft = args.depth, args.radius, np.linspace(-args.depth, 0.0, args.n + 1)
    pile, soil = (np.array([0, A]), np.append(shaft, FREE)), (np.geomspace(A, R, args.n + 1), shaft)
    bodies = [create_grid(comm, axes, mesh.CellType.quadrilateral) for axes in (pile, soil)]

    def tagged(domain, where, tag=1):
        found = mesh.locate_entities_boundary(domain, 1, where)
        return mesh.meshtags(domain, 1, np.sort(found), tag)

    near, sides = np.isclose, enumerate(bodies, 1)
    faces = [tagged(b, lambda x: near(x[0], A) & (x[1] < FREE / 2), tag) for tag, b in sides]
    both = join(bodies, facet_tags=faces)
    V = fem.functionspace(domain := both.mesh, ("Lagrange", 1, (2,)))
    u, drawn, bcs = fem.Function(V, name="displacement"), fem.Constant(domain, 0.0), []
    for i, value, axis, at in ((1, drawn, 1, FREE), (0, 0.0, 0, R), (1, 0.0, 0, R)):
        held = tagged(domain, lambda x, axis=axis, at=at: near(x[axis], at)).indices
        dofs = fem.locate_dofs_topological(V.sub(i), 1, held)
        bcs.append(fem.dirichletbc(value, dofs, V.sub(i)))
    (r, y), strain, around = ufl.SpatialCoordinate(domain), ufl.grad(u), circumference(domain)
    dx = ufl.Measure("dx", subdomain_data=both.cell_tags)
    ds = ufl.ds(subdomain_data=tagged(domain, lambda x: near(x[1], -L) & (x[0] > 0.9 * A)))
    stored = [Axisymmetric(LinearElastic.from_young(*m)).energy(u) for m in (PILE, SOIL)]
    across = REST * WEIGHT * ufl.min_value(y, 0.0) * (strain[0, 0] + u[0] / r)
    energy = (stored[0] + across) * around * dx(1) - WEIGHT * L * u[1] * around * ds(1)
    energy += (stored[1] + across + WEIGHT * (y * strain[1, 1] + u[1])) * around * dx(2)
    law = RCCM(BOND, BOND, BOND * U0**2, args.friction)
    bond = ContactPair(u, both, slave=1, master=2, law=law, axisymmetric=True)
    return ContactProblem(energy, u, [bond], bcs=bcs), drawn


def closed_form(args, u):
    """Force, displacement of the head, what lies between it and a slip, and the friction left."""
    L, EA, G = args.depth, np.pi * A**2 * PILE[0], SOIL[0] / 2 / (1 + SOIL[1])
    left, friction = U0 / np.maximum(u, U0), np.pi * A * args.friction * REST * WEIGHT * L**2
    force = 2 * np.pi * A * L * BOND * left**4 * u + friction * (1 - left**2)
    gives = np.log(args.radius / A) / (2 * np.pi * G * L) + (L / 3 + FREE) / EA
    return force, u + force * gives, gives, friction


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, drawn = pile_in_soil(args, comm)
    tables, n = [problem.solve().tables["contact"]], args.steps
    u = np.append(np.linspace(0.0, 2.0, 200), np.geomspace(2.0, 10.0, 100)[1:]) * U0
    (force, lift, gives, friction), (top, at, *_) = (closed_form(args, v) for v in (u, U0))
    times = np.append(np.linspace(0, 2 * at, 2 * n + 1), np.geomspace(2 * at, lift[-1], n + 1)[1:])
    with output.EvolutionSeries(folder, problem, every=n) as series:
        run = QuasiStatic(problem, lambda t: drawn.value.fill(t)).run(times, observer=series)
    tables += [s.result.tables["contact"] for s in run.steps]
    head = np.array([0.0, *(s.time for s in run.steps)])
    pull = np.array([-t.force[:, 1].sum() for t in tables])
    slip = np.array([t.area @ t.ut[:, 1] / t.area.sum() for t in tables])
    found = dict(peak=pull.max(), peak_closed_form=top, plateau=pull[-1], friction_limit=friction)
    found |= dict(plateau_closed_form=force[-1], at_rest=args.friction * tables[0].rn.sum())
    found |= dict(gives=(head - slip)[1] / pull[1], gives_closed_form=gives) | run.energies.row()
    found |= {"work_of_pull": (pull[1:] + pull[:-1]) @ np.diff(head) / 2}
    say("\n".join(f"{name}: {value:.6g}" for name, value in found.items()))
    found |= {"head": head, "force": pull, "closed_form": np.interp(head, lift, force)}
    if comm.rank == 0:
        names, dotted = ("head, m", "load, kN"), {"one slip, cylinders": (lift, force)}
        output.draw_curves(folder / "load.png", {"pile": (head, pull)}, dotted=dotted, labels=names)
        at = {f"head at {1e3 * head[i]:.3g} mm": tables[i] for i in (n // 2, n, 5 * n // 4, -1)}
        shear = {name: (t.shear[:, 1], t.x[:, 1]) for name, t in at.items()}
        output.draw_curves(folder / "shear.png", shear, labels=("shear on the pile, kPa", "y, m"))
    output.picture_of_body(folder / "body.png", problem)
    return output.write_summary(comm, folder, run.steps[-1].result.summary() | found)


if __name__ == "__main__":
    main()
