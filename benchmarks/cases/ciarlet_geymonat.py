# SPDX-License-Identifier: LGPL-3.0-or-later
"""Six branches of a hyperelastic block.

Reference: GetFEM. `demos/demo_ciarlet_geymonat.py` explains the problem.
"""

import time

from mpi4py import MPI

import numpy as np
from _case import ScriptParser

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
    records,
)
from dolfinx_contact.continuation import Branch, explore
from dolfinx_contact.materials import CiarletGeymonat
from dolfinx_contact.records import leftmost, rightmost, total

#: Outputs: both corners, and the forces of the floor.
FUNCTIONALS = {
    "ut_left": leftmost("ut"),
    "un_left": leftmost("un"),
    "ut_right": rightmost("ut"),
    "un_right": rightmost("un"),
    "sum_rt": total("rt"),
    "sum_rn": total("rn"),
}


def block(nx, ny, friction, *, mm=1.0, MPa=1.0):
    """The block with gamma in its traction; a millimetre and a megapascal in the units used."""
    comm = MPI.COMM_WORLD
    cell = mesh.CellType.quadrilateral
    corners = [[0.0, 0.0], [40.0 * mm, 80.0 * mm]]
    domain = mesh.create_rectangle(comm, corners, [nx, ny], cell)

    def edge(axis, value):
        return mesh.locate_entities_boundary(
            domain, 1, lambda x: np.isclose(x[axis], value * mm, atol=1e-9 * mm)
        )

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 1.0)
    sides = np.sort(np.concatenate([edge(0, 0.0), edge(0, 40.0)]))
    tags = mesh.meshtags(domain, 1, sides, np.ones(len(sides), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    x = ufl.SpatialCoordinate(domain)
    across = 2.0 * MPa + 0 * x[0]
    up = 0.12 * MPa * (20.0 - x[0] / mm)
    traction = ufl.as_vector([across, up])
    material = CiarletGeymonat(4000.0 * MPa, 120.0 * MPa, 30.0 * MPa)
    energy = material.energy(u) * ufl.dx(metadata={"quadrature_degree": 4})
    energy += gamma * ufl.dot(traction, u) * ds
    top = fem.locate_dofs_topological(V, 1, edge(1, 80.0))
    held = fem.dirichletbc(np.zeros(2), top, V)
    floor = HalfSpace((0, 0), (0, 1))
    bottom = edge(1, 0.0)
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
    problem = ContactProblem(energy, u, [surface], bcs=[held])
    return ParametricContact(problem, gamma)


def gammas_outwards(branch):
    """gamma along a branch, listed from its end at the degenerate point."""
    gammas = [p.gamma for p in branch.points]
    if abs(gammas[0]) < abs(gammas[-1]):
        return gammas
    return gammas[::-1]


def main(argv=None):
    given = dict(nx=20, ny=40, friction=1.0)
    parser = ScriptParser("A hyperelastic block", output="output/ciarlet_geymonat", **given)
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    system = block(args.nx, args.ny, args.friction)
    result = system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    begun = time.perf_counter()
    diagram = explore(system, [(x, 1.0)], gamma_range=(-1.0, 1.0), progress=True)
    seconds = time.perf_counter() - begun

    # The first branch was followed from its far end, the others from the degenerate point.
    far = []
    for edge in diagram.edges:
        end = 0 if edge.start is None else -1
        far.append(edge.branch.points[end])

    def by_load_and_statuses(k):
        return -far[k].gamma, system.letters(far[k].piece)

    order = sorted(range(len(far)), key=by_load_and_statuses)
    ends = [far[k] for k in order]
    branches = [diagram.branches[k] for k in order]
    journal = records.journal_of(system, branches, FUNCTIONALS)
    found = records.journal_of(system, [Branch(ends)], FUNCTIONALS).rows()
    titles = [f"branch {k}: gamma = {p.gamma:g}" for k, p in enumerate(ends)]
    plot.picture_of_states(folder / "states.png", system, ends, titles=titles)
    if comm.rank == 0:
        seen = {
            "ut_left": "$u_t$ of the left corner",
            "un_left": "gap of the left corner",
            "sum_rn": "normal force",
        }
        plot.draw_diagram(folder / "diagram.png", journal, seen, strips=6)
    for title, s in zip(titles, found, strict=True):
        say(f"{title}, {s['status']}, left corner {s['ut_left']:.6g}, {s['un_left']:.6g}")
    summary = diagram.summary()
    methods = ", ".join(summary["methods"])
    points = sum(summary["points"])
    say(f"rays out of the degenerate point: {methods}")
    say(f"{points} points in {seconds:.1f} s; pictures in {folder}")

    gammas = [gammas_outwards(branch) for branch in branches]
    summary["newton_iterations"] = result.iterations
    summary["dofs"] = result.dofs
    summary["branches"] = found
    summary["points"] = [len(along) for along in gammas]
    summary["gammas"] = gammas
    summary["augmentation"] = system.problem.surfaces[0].points.mean_augmentation
    summary["explore_seconds"] = seconds
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
