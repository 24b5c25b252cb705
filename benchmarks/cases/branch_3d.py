# SPDX-License-Identifier: LGPL-3.0-or-later
"""A rounded 3D foot (was `3d_branch`).

Reference: exact location of kinks. `demos/demo_3d_branch.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

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
from dolfinx_contact.continuation import Follower, StepControl
from dolfinx_contact.materials import LinearElastic

GAP = 0.005  # between floor and sole
CENTRE = (0.46, 0.53)  # where the sole is lowest


def arguments(argv=None):
    given = dict(friction=0.4, young=1000.0, poisson=0.3, max_steps=500, kinks="batched")
    parser = ScriptParser("A 3D body, up to sliding", output="output/3d_branch", **given)
    add = parser.add_argument
    add("--n", type=number(int, least=2), default=16, help="cells along an edge")
    add("--lower", type=number(above=GAP), default=0.06, help="the top by this")
    add("--shift", type=number(), default=0.12, help="and sideways by this")
    add("--round", type=number(least=0, below=1), default=0.08, help="of the sole")
    return parser.parse(argv)


def foot(args, comm):
    n = args.n
    domain = mesh.create_unit_cube(comm, n, n, n, mesh.CellType.hexahedron)
    sole = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1.0))
    x = domain.geometry.x
    squares = (x[:, :2] - CENTRE) ** 2
    x[:, 2] += args.round * (1 - x[:, 2]) * squares.sum(axis=1)

    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    moved = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    aside = args.shift * gamma**2
    move = ufl.as_vector([0.94 * aside, 0.34 * aside, -args.lower * gamma])
    dofs = fem.locate_dofs_topological(V, 2, top)
    held = fem.dirichletbc(moved, dofs)
    floor = HalfSpace((0.0, 0.0, -GAP), (0.0, 0.0, 1.0))
    surface = ContactSurface(u, sole, obstacle=floor, law=Coulomb(args.friction))
    material = LinearElastic.from_young(args.young, args.poisson)
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[held])
    return ParametricContact(problem, gamma, driven=[(moved, move)]), material


def first_contact(system):
    """The predicate of the event at which the lowest point closes. Collective."""
    heights = system.positions[:, 2]
    least = system.comm.allreduce(heights.min(initial=np.inf), op=MPI.MIN)
    return lambda change: heights[change.point] == least and change.before == 0


def draw(folder, comm, system, material, branch, journal):
    """The body where most points stick, where most stick and slip, at the end; and the branch."""
    problem = system.problem
    columns = journal.columns()
    gammas = columns["gamma"]
    most = {
        "sticking": columns["stick"],
        "partial_slip": columns["stick"] * columns["slip"],
        "sliding": gammas,
    }
    for name, values in most.items():
        best = values.argmax()
        system.result_at(branch.points[best])  # into the problem
        title = f"gamma = {gammas[best]:.4f}"
        plot.picture_of_contact(folder / f"contact_{name}.png", problem, title=title)
    stress = material.full_stress(problem.u)
    plot.picture_of_body(folder / "body.png", problem, stress=stress)
    if comm.rank == 0:
        labels = {"sum_rn": "normal force", "sum_rt": "tangential force"}
        plot.draw_diagram(folder / "branch.png", journal, labels)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    say = io.Report(comm)
    folder = io.output_folder(comm, args.output)
    system, material = foot(args, comm)
    x = system.create_vector()  # zero: in its place, nothing touches
    locate = first_contact(system) if args.kinks == "batched" else None
    control = StepControl(kinks=args.kinks)
    with Follower(system, control, gamma_scale=1.0, locate=locate) as follower:
        start = follower.start(x, 0.0)
        branch = follower.run(
            start, gamma_range=(0.0, 1.0), max_steps=args.max_steps, progress=True
        )
    forces = {"sum_rn": records.total("rn"), "sum_rt": records.total("rt")}
    journal = records.journal_of(system, [branch], forces)
    draw(folder, comm, system, material, branch, journal)

    columns = journal.columns()
    names = ("gamma", "open", "stick", "slip", *forces)
    numbers = zip(*(columns[name].tolist() for name in names), strict=True)
    seen = [dict(zip(names, row, strict=True)) for row in numbers]
    changes = np.diff(np.sign(columns["stick"]))
    gone = np.flatnonzero(changes < 0) + 1  # the last point that stuck has given way
    sliding = float(columns["gamma"][gone[-1]]) if len(gone) else None
    events = [s for s in branch.special if s.changes]
    summary = branch.summary()
    summary["dofs"] = x.getSize()
    summary["events"] = sum(len(s.changes) for s in events)
    summary["first_contact"] = min((s.gamma for s in events), default=None)
    summary["full_sliding_by"] = sliding
    summary["along"] = seen
    summary["end"] = seen[-1]
    for key in ("dofs", "points", "reason", "events", "first_contact", "full_sliding_by", "end"):
        say(f"{key}: {summary[key]}")
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
