# SPDX-License-Identifier: LGPL-3.0-or-later
# # A fibre pulled out of a matrix
#
# This demo illustrates how to:
#
# - solve for bodies of revolution (`axisymmetric`): half of a section is meshed, forces are whole;
# - clamp a fibre by what the matrix shrinks, a misfit of the radii (`gap`, `interference`);
# - let a bond break along an interface that rubs (`RCCM`), step by step, past the jump at the end.
#
# A polymer fibre of radius a lies in a stiff matrix that has shrunk on it: Lame's pressure p holds
# it, and a bond of the stiffness C and the work w. Its end is drawn. While the other end is at rest
# a bar of the stiffness EA knows the force by the slip u where it leaves the matrix,
#   P^2 = 4 pi a EA Phi(u),  Phi = C u^2/2 up to u0 = (w/C)^(1/2), beyond it
#   Phi = w - w u0^2/(2 u^2) + mu p (u - u0 + u0 (u0/u - 1)).
# The matrix is held around. Its face may be one of a crack that the fibre bridges: by symmetry that
# opens by 2 u, until the load is highest. When the bond has broken all along, the fibre has stored
# more than is left of it takes: the state jumps to friction alone, 2 pi a L mu p (sliding is small:
# L stays). The numbers (mm, N) are no source's; with Poisson's ratio 0 tension thins no fibre.

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

A, B, FREE = 0.25, 1.0, 0.5  # radii of fibre and matrix, length of fibre outside
FIBRE, MATRIX, BOND, WORK = 5e3, 30e3, 625.0, 0.01
U0, EA = np.sqrt(WORK / BOND), np.pi * A**2 * FIBRE


def arguments(argv=None):
    parser = ScriptParser("A fibre that is pulled out", output="output/pull_out", n=8, friction=0.3)
    add = parser.add_argument
    add("--length", type=number(above=0), default=10.0, help="of the fibre in the matrix, mm")
    add("--misfit", type=number(least=0), default=6e-5, help="of the radii, mm")
    add("--end", type=number(above=0), default=0.12, help="where the fibre is drawn to, mm")
    add("--steps", type=number(int, above=0), default=60, help="on the way")
    return parser.parse(argv)


def lame(misfit):
    return misfit / A / (1 / FIBRE + (B**2 + A**2) / (B**2 - A**2) / MATRIX)


def facets(domain, axis, at, top=np.inf):
    found = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[axis], at))
    return np.sort(found[mesh.compute_midpoints(domain, 1, found)[:, 1] < top])


def problem(args, comm):
    """The problem, and the Constant by which the end of the fibre is drawn."""
    L, n = args.length, args.n
    up, out = (np.linspace(0, x, max(1, round(x * n)) + 1) for x in (L, FREE))
    fibre = np.linspace(0, A, 3), np.append(up, L + out[1:])
    matrix = A + (B - A) * np.array([0, 0.1, 0.3, 0.6, 1]), up
    bodies = [create_grid(comm, x, mesh.CellType.quadrilateral) for x in (fibre, matrix)]
    tags = [mesh.meshtags(b, 1, facets(b, 0, A, L), i) for i, b in enumerate(bodies, 1)]
    both = join(bodies, facet_tags=tags)
    V = fem.functionspace(both.mesh, ("Lagrange", 1, (2,)))
    u, drawn = fem.Function(V, name="displacement"), fem.Constant(both.mesh, 0.0)
    dx, around = ufl.Measure("dx", subdomain_data=both.cell_tags), circumference(both.mesh)
    materials = [Axisymmetric(LinearElastic.from_young(E, 0.0)) for E in (FIBRE, MATRIX)]
    energy = sum(m.energy(u) * around * dx(i) for i, m in enumerate(materials, 1))
    given = dict(slave=1, master=2, gap=-args.misfit, interference=True, axisymmetric=True)
    given["law"] = RCCM(BOND, BOND, WORK, args.friction)
    at = [(drawn, facets(both.mesh, 1, L + FREE)), (0.0, facets(both.mesh, 0, B))]
    W, pair = V.sub(1), ContactPair(u, both, **given)
    bcs = [fem.dirichletbc(v, fem.locate_dofs_topological(W, 1, f), W) for v, f in at]
    return ContactProblem(energy, u, [pair], bcs=bcs), drawn


def closed_form(u, shear):
    v = np.maximum(u, U0)
    rubbed = shear * (v - U0 + U0 * (U0 / v - 1))
    phi = np.where(u < U0, BOND * u**2 / 2, WORK - WORK * (U0 / v) ** 2 / 2 + rubbed)
    return np.sqrt(4 * np.pi * A * EA * phi)


def main(argv=None):
    args, comm = arguments(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    bodies, drawn = problem(args, comm)
    clamped = bodies.solve().tables["contact"]

    def load(t):
        drawn.value = t * args.end

    times, shear = np.linspace(0.0, 1.0, args.steps + 1), args.friction * lame(args.misfit)
    with output.EvolutionSeries(folder, bodies, every=5) as series:
        steps = QuasiStatic(bodies, load).run(times, at_jump="jump", observer=series).steps
    tables = [s.result.tables["contact"] for s in steps]
    force = np.array([-s.result.resultants["contact"][1] for s in steps])
    foot, mouth = np.transpose([t.ut[[0, -1], 1] for t in tables])
    end, closed = args.end * np.array([s.time for s in steps]), closed_form(mouth, shear)
    found = {"pressure": clamped.rn.sum() / (area := clamped.area.sum()), "peak": force.max()}
    found |= {"plateau": force[-1], "plateau_closed_form": area * shear}
    found |= {"pressure_closed_form": lame(args.misfit)}
    say(", ".join(f"{name} {value:.6g}" for name, value in found.items()))
    rows = {"end": end, "mouth": mouth, "foot": foot, "force": force, "closed_form": closed}
    rows |= {k: [getattr(s.energies, k) for s in steps] for k in ("external", "residue")}
    if comm.rank == 0:
        still = foot < 0.1 * U0
        bar, names = {"bar": (end[still], closed[still])}, ("end of the fibre, mm", "force, N")
        output.draw_curves(folder / "curve.png", {"": (end, force)}, dotted=bar, labels=names)
    output.picture_of_body(folder / "body.png", bodies)
    output.write_contact_table(comm, folder, tables[-1:])
    found |= {"jumps": [s.time * args.end for s in steps if s.jump], "curve": rows}
    return output.write_summary(comm, folder, steps[-1].result.summary() | found)


if __name__ == "__main__":
    main()
