# SPDX-License-Identifier: LGPL-3.0-or-later
# # A steel bar pulled out of concrete
#
# This demo illustrates how to:
#
# - join two bodies by a bond that breaks and leaves friction behind (`ContactPair` with `RCCM`);
# - draw the curve of load against slip, and see where the work of the pull has gone.
#
# Raous, Cangemi and Cocou's law is meant for such interfaces: reinforced concrete, piles in soil. A
# flat bar lies in concrete that is pressed on it, of which one half is shown, in plane strain. Its
# bond of the shear stiffness C holds up to the slip u0 = (w/C)^(1/2) and then damages; friction mu
# comes as it goes. Where the slip u is the same everywhere the force per width and length is
#
#     C u  up to u0,   then   w^2/(C u^3) + mu p (1 - w/(C u^2)),   at last the plateau mu p.
#
# All parameters are our own choice, of a plausible order (N and mm): no published set was found.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import RCCM, ContactPair, ContactProblem, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join

STEEL, CONCRETE = (210e3, 0.3), (30e3, 0.2)  # E in N/mm^2, nu
LENGTH, FREE, HALF, COVER = 80.0, 10.0, 8.0, 60.0  # of the bond; bar outside; bar and concrete


def arguments(argv=None):
    parser = ScriptParser("Steel in concrete", output="output/steel_concrete", n=16, friction=0.6)
    parser.add_argument("--bond", type=number(above=0), default=100.0, help="C, N/mm^3")
    parser.add_argument("--work", type=number(above=0), default=1.0, help="w, N/mm")
    parser.add_argument("--pressure", type=number(above=0), default=5.0, help="p, N/mm^2")
    parser.add_argument("--steps", type=number(int, above=0), default=8, help="for each u0")
    return parser.parse(argv)


def pull_out(args, comm):
    """The problem, and the Constant by which the end of the bar is pulled."""
    h, square = LENGTH / args.n, mesh.CellType.quadrilateral
    x = h * np.arange(args.n + 1)
    y = HALF + (COVER - HALF) * np.linspace(0.0, 1.0, args.n // 2 + 1) ** 1.5
    bar = np.append(x, LENGTH + FREE), np.linspace(0.0, HALF, max(args.n // 8, 1) + 1)
    both = join([create_grid(comm, axes, square) for axes in (bar, (x, y))])
    domain, parts = both.mesh, both.cell_tags

    def facets(axis, value, part=None):
        found = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], value))
        cells = domain.topology.connectivity(1, 2)
        of = parts.values[cells.array[cells.offsets[found]]]
        inside = mesh.compute_midpoints(domain, 1, found)[:, 0] < LENGTH + FREE * (axis == 0)
        return np.sort(found if part is None else found[(of == part) & inside])

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, pull, zero = fem.Function(V), fem.Constant(domain, 0.0), fem.Constant(domain, 0.0)
    held = [(0, pull, facets(0, LENGTH + FREE)), (1, zero, facets(1, 0.0))]
    held.append((0, zero, facets(0, LENGTH)))
    bcs = [
        fem.dirichletbc(value, fem.locate_dofs_topological(V.sub(i), 1, on), V.sub(i))
        for i, value, on in held
    ]
    dx = ufl.Measure("dx", domain, subdomain_data=parts)
    bodies = (LinearElastic.from_young(*given).energy(u) for given in (STEEL, CONCRETE))
    top = mesh.meshtags(domain, 1, facets(1, COVER), 1)
    pressed = args.pressure * u[1] * ufl.ds(subdomain_data=top)(1)
    energy = sum(e * dx(tag) for tag, e in enumerate(bodies, 1)) + pressed
    law = RCCM(args.bond, args.bond, args.work, args.friction)
    bond = ContactPair(u, facets(1, HALF, 1), master_facets=facets(1, HALF, 2), law=law)
    return ContactProblem(energy, u, [bond], bcs=bcs), pull


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    problem, pull = pull_out(args, comm)
    u0 = np.sqrt(args.work / args.bond)
    problem.solve()

    def load(t):
        pull.value = u0 * t

    n = args.steps
    times = np.append(np.arange(3 * n) / n, np.linspace(3.0, 10.0, 4 * n))
    with output.EvolutionSeries(folder, problem, every=n) as series:
        history = QuasiStatic(problem, load).run(times, observer=series)
    tables = [s.result.tables["contact"] for s in history.steps]
    slip = np.array([t.area @ t.ut[:, 0] / t.area.sum() for t in tables])
    force = np.array([-t.force[:, 0].sum() for t in tables])
    mean, broken = tables[-1].rn.sum() / LENGTH, np.maximum(slip / u0, 1.0)
    exact = np.where(slip < u0, args.bond * slip, args.bond * u0 / broken**3)
    exact = LENGTH * (exact + args.friction * mean * (1 - broken**-2.0))
    e, top = history.energies, int(np.argmax(force))
    summary = {
        "slip": slip,
        "force": force,
        "uniform": exact,
        **{"peak": force[top], "peak_slip": slip[top], "normal": mean * LENGTH},
        **{"plateau": force[-1], "plateau_closed_form": exact[-1]},
        **{"friction_limit": args.friction * args.pressure * LENGTH},
        **{"external": e.external, "stored": e.stored, "dissipated": e.dissipated},
        **{"damage": e.damage, "residue": e.residue, "work_of_bond": args.work * LENGTH},
    }
    for name in list(summary)[3:]:
        say(f"{name}: {summary[name]:.6g}")
    if comm.rank == 0:
        look = dict(labels=("mean slip, mm", "pull, N/mm"), dotted={"uniform slip": (slip, exact)})
        output.draw_curves(folder / "pull_out.png", {"plane strain": (slip, force)}, **look)
    output.picture_of_body(folder / "body.png", problem, scale=10.0)
    return output.write_summary(comm, folder, history.steps[-1].result.summary() | summary)


if __name__ == "__main__":
    main()
