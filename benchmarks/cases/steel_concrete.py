# SPDX-License-Identifier: LGPL-3.0-or-later
"""A steel bar in concrete.

Reference: uniform slip.

Raous, Cangemi and Cocou's law is meant for such interfaces: reinforced concrete, piles in soil. A
flat bar lies in concrete that is pressed on it, of which one half is shown, in plane strain. Its
bond of the shear stiffness C holds up to the slip u0 = (w/C)^(1/2) and then damages; friction mu
comes as it goes. Where the slip u is the same everywhere the force per width and length is

    C u  up to u0,   then   w^2/(C u^3) + mu p (1 - w/(C u^2)),   at last the plateau mu p.

All parameters are our own choice, of a plausible order (N and mm): no published set was found.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactPair, ContactProblem, io, plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join, name_groups

STEEL = (210e3, 0.3)  # E in N/mm^2, nu
CONCRETE = (30e3, 0.2)
LENGTH = 80.0  # of the bond
FREE = 10.0  # of the bar outside
HALF = 8.0  # of the bar
COVER = 60.0  # of the concrete


def arguments(argv=None):
    parser = ScriptParser("Steel in concrete", output="output/steel_concrete", n=16, friction=0.6)
    parser.add_argument("--bond", type=number(above=0), default=100.0, help="C, N/mm^3")
    parser.add_argument("--work", type=number(above=0), default=1.0, help="w, N/mm")
    parser.add_argument("--pressure", type=number(above=0), default=5.0, help="p, N/mm^2")
    parser.add_argument("--steps", type=number(int, above=0), default=8, help="for each u0")
    return parser.parse(argv)


def pull_out(args, comm):
    """The problem, and the Constant by which the end of the bar is pulled."""
    square = mesh.CellType.quadrilateral
    h = LENGTH / args.n
    x = h * np.arange(args.n + 1)
    bar_x = np.append(x, LENGTH + FREE)
    bar_y = np.linspace(0.0, HALF, max(args.n // 8, 1) + 1)
    bar = create_grid(comm, (bar_x, bar_y), square)
    depth = np.linspace(0.0, 1.0, args.n // 2 + 1) ** 1.5  # finer towards the bar
    concrete_y = HALF + (COVER - HALF) * depth
    concrete = create_grid(comm, (x, concrete_y), square)

    def at(axis, value):
        return lambda x: np.isclose(x[axis], value)

    def bond(x):
        return np.isclose(x[1], HALF) & (x[0] < LENGTH + 1e-9)

    bar_sides = {"bar_face": bond, "end": at(0, LENGTH + FREE), "mirror": at(1, 0.0)}
    concrete_sides = {"concrete_face": bond, "mouth": at(0, LENGTH), "top": at(1, COVER)}
    both = join(
        [
            name_groups(bar, bar_sides, cells="steel"),
            name_groups(concrete, concrete_sides, cells="concrete"),
        ]
    )
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    pull = fem.Constant(domain, 0.0)
    zero = fem.Constant(domain, 0.0)

    bcs = [
        fem.dirichletbc(value, both.dofs(V.sub(axis), name), V.sub(axis))
        for name, axis, value in (("end", 0, pull), ("mirror", 1, zero), ("mouth", 0, zero))
    ]
    of_steel = LinearElastic.from_young(*STEEL).energy(u) * both.dx("steel")
    of_concrete = LinearElastic.from_young(*CONCRETE).energy(u) * both.dx("concrete")
    pressed = args.pressure * u[1] * both.ds("top")
    energy = of_steel + of_concrete + pressed
    law = RCCM(args.bond, args.bond, args.work, args.friction)
    pair = ContactPair(u, both, slave="bar_face", master="concrete_face", law=law)
    return ContactProblem(energy, u, [pair], bcs=bcs), pull


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problem, pull = pull_out(args, comm)
    u0 = np.sqrt(args.work / args.bond)
    problem.solve()

    def load(t):
        pull.value = u0 * t

    n = args.steps
    fine = np.arange(3 * n) / n
    coarse = np.linspace(3.0, 10.0, 4 * n)
    times = np.append(fine, coarse)
    with io.EvolutionSeries(folder, problem, every=n) as series:
        history = QuasiStatic(problem, load).run(times, observer=series)

    tables = [s.result.tables["contact"] for s in history.steps]
    slip = np.array([t.area @ t.ut[:, 0] / t.area.sum() for t in tables])
    force = np.array([-t.force[:, 0].sum() for t in tables])
    normal = tables[-1].rn.sum() / LENGTH
    broken = np.maximum(slip / u0, 1.0)
    adhesion = np.where(slip < u0, args.bond * slip, args.bond * u0 / broken**3)
    friction = args.friction * normal * (1 - broken**-2.0)
    uniform = LENGTH * (adhesion + friction)

    energies = history.energies
    top = int(np.argmax(force))
    numbers = {
        "peak": force[top],
        "peak_slip": slip[top],
        "normal": normal * LENGTH,
        "plateau": force[-1],
        "plateau_closed_form": uniform[-1],
        "friction_limit": args.friction * args.pressure * LENGTH,
        "external": energies.external,
        "stored": energies.stored,
        "dissipated": energies.dissipated,
        "damage": energies.damage,
        "residue": energies.residue,
        "work_of_bond": args.work * LENGTH,
    }
    for name, value in numbers.items():
        say(f"{name}: {value:.6g}")

    if comm.rank == 0:
        curves = {"plane strain": (slip, force)}
        dotted = {"uniform slip": (slip, uniform)}
        labels = ("mean slip, mm", "pull, N/mm")
        plot.draw_curves(folder / "pull_out.png", curves, dotted=dotted, labels=labels)
    plot.picture_of_body(folder / "body.png", problem, scale=10.0)
    summary = history.steps[-1].result.summary()
    summary |= {"slip": slip, "force": force, "uniform": uniform}
    return io.write_summary(comm, folder, summary | numbers)


if __name__ == "__main__":
    main()
