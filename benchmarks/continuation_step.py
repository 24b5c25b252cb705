# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does a step of a continuation cost over a warm static solve?

A body with a rounded sole is lowered on a floor and dragged. Its branch is followed, with the
detection of folds, bifurcations and changes of status on; then every point of it is solved for once
more by the static solver, from the point before it, with the same linear solver and to the same
tolerance. The two go in turns three times on one mesh, each time from new; the first steps and
solves warm them and do not count, of the others the medians of three do. Steps are grouped: those
that locate an event to round-off take many corrections.

    mpirun -n 2 python3 benchmarks/continuation_step.py --dim 3 --n 43 --steps 8

PETSc options with the prefixes ``contact_`` and ``continuation_`` reach the two solvers.
"""

from __future__ import annotations

import argparse
import logging
import time

from mpi4py import MPI

import numpy as np
from timing import REPEATS, Timer, clean, median, save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    parse_arguments,
)
from dolfinx_contact.continuation import Follower, Observer, StepControl
from dolfinx_contact.materials import LinearElastic

CELLS = {
    (2, "simplex"): mesh.CellType.triangle,
    (2, "tensor"): mesh.CellType.quadrilateral,
    (3, "simplex"): mesh.CellType.tetrahedron,
    (3, "tensor"): mesh.CellType.hexahedron,
}


def arguments(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--dim", type=int, choices=(2, 3), default=3)
    parser.add_argument("--n", type=int, default=24, help="cells along an edge")
    parser.add_argument("--cell", choices=("simplex", "tensor"), default="tensor")
    parser.add_argument("--friction", type=float, default=0.4)
    parser.add_argument("--steps", type=int, default=12, help="of the continuation")
    parser.add_argument("--skip", type=int, default=3, help="first steps that do not count")
    parser.add_argument("--kinks", choices=("exact", "batched", "stepping"))
    parser.add_argument("--tolerance", type=float, default=1e-10, help="of both")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="turns of the two")
    parser.add_argument("--output", default="continuation_step.json")
    return parse_arguments(parser, argv)


def foot(args, n, comm):
    """Mesh of the body, and the facets of its sole and of its top."""
    cell = CELLS[args.dim, args.cell]
    low = np.zeros(args.dim)
    high = np.ones(args.dim)
    box = mesh.create_rectangle if args.dim == 2 else mesh.create_box
    domain = box(comm, [low, high], [n] * args.dim, cell)
    last = args.dim - 1
    sole, top = (
        mesh.locate_entities_boundary(domain, last, lambda x, z=z: np.isclose(x[last], z))
        for z in (0.0, 1.0)
    )
    x = domain.geometry.x
    away = (x[:, 0] - 0.46) ** 2 + ((x[:, 1] - 0.53) ** 2 if args.dim == 3 else 0.0)
    x[:, last] += 0.08 * (1 - x[:, last]) * away
    return domain, sole, top


def lowered(args, domain, sole, top):
    """The body and its parameter: lowered by gamma, dragged by gamma^2."""
    last = args.dim - 1
    V = fem.functionspace(domain, ("Lagrange", 1, (args.dim,)))
    u = fem.Function(V)
    moved = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    sideways = 0.12 * gamma**2
    move = [sideways, -0.06 * gamma] if args.dim == 2 else [sideways, 0.4 * sideways, -0.06 * gamma]
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, last, top))
    point = np.zeros(args.dim)
    normal = np.eye(args.dim)[last]
    surface = ContactSurface(u, sole, obstacle=HalfSpace(point, normal), law=Coulomb(args.friction))
    problem = ContactProblem(
        LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx,
        u,
        [surface],
        bcs=[held],
        petsc_options={"snes_rtol": args.tolerance},
    )
    return ParametricContact(problem, gamma, driven=[(moved, ufl.as_vector(move))])


class Clock(Observer):
    """Notes when every point was accepted, and what had been applied by then."""

    def __init__(self, comm, solver):
        self.comm = comm
        self.solver = solver
        self.seen = []

    def step(self, step, state):
        self.comm.barrier()
        now = time.perf_counter()
        processor = self.comm.allreduce(time.process_time())
        work = self.solver.solves, self.solver.factorisations
        self.seen.append((now, *work, step.special, processor))


def follow(args, system, comm):
    """The steps of the branch, one record each, and its points."""
    x = system.create_vector()
    x.set(0.0)
    control = StepControl(kinks=args.kinks, tolerance=args.tolerance)
    with Follower(system, control, gamma_scale=1.0) as follower:
        clock = Clock(comm, follower.bordered.solver)
        start = follower.start(x, 0.0)
        branch = follower.run(start, gamma_range=(0.0, 1.0), max_steps=args.steps, observer=clock)
    steps = [
        {
            "gamma": point.gamma,
            "seconds": after[0] - before[0],
            "processor_seconds": after[4] - before[4],
            "applications": after[1] - before[1],
            "factorisations": after[2] - before[2],
            "corrections": point.corrections,
            "changes": sum(len(s.changes) for s in after[3]),
            "located": sum(s.located and not s.smooth for s in after[3]),
        }
        for before, after, point in zip(
            clock.seen[:-1], clock.seen[1:], branch.points[1:], strict=True
        )
    ]
    return steps, branch


def static(system, branch, comm):
    """Seconds and counts of the static solves from point to point."""
    records = []
    problem = system.problem
    for before, point in zip(branch.points[:-1], branch.points[1:], strict=True):
        x = system.create_vector()
        x.array[:] = before.y.array_r[: x.getLocalSize()]
        system.put(x, before.gamma, before.piece)
        system.set_parameter(point.gamma)
        timer = Timer(comm)
        result = timer("solve", problem.solve)
        records.append(
            {
                "seconds": timer.total,
                "processor_seconds": timer.processor,
                "newton_iterations": result.iterations,
                "krylov_iterations": sum(a.krylov_iterations for a in result.attempts),
            }
        )
        problem.write(x)
        away = point.y.array_r[: x.getLocalSize()] - x.array_r
        squares = comm.allreduce(np.array([away @ away, x.array_r @ x.array_r]))
        records[-1]["difference"] = float(np.sqrt(squares[0] / max(squares[1], 1e-300)))
        x.destroy()
    return records


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    logging.basicConfig(level=logging.WARNING)
    small = lowered(args, *foot(args, 3, comm))  # compiles all forms
    static(small, follow(args, small, comm)[1], comm)
    body = foot(args, args.n, comm)
    rounds = []
    for _ in range(args.repeats):
        clean(comm)
        system = lowered(args, *body)
        steps, branch = follow(args, system, comm)
        rounds.append((steps, static(system, branch, comm)))
        unknowns = system.create_vector().getSize()
        solver = system.problem.linear_solver.name
    steps, solves = (
        [median(runs) for runs in zip(*side, strict=True)] for side in zip(*rounds, strict=True)
    )
    pairs = list(zip(steps, solves, strict=True))[args.skip :]
    record = {
        "dim": args.dim,
        "n": args.n,
        "cell": args.cell,
        "ranks": comm.size,
        "repeats": args.repeats,
        "unknowns": unknowns,
        "linear_solver": solver,
        "steps": steps,
        "static": solves,
    }
    groups = {
        "batched": [p for p in pairs if not p[0]["located"]],
        "located": [p for p in pairs if p[0]["located"]],
    }
    for name, group in groups.items():
        if not group:
            continue
        of_steps, of_static = (sum(s["seconds"] for s in side) for side in zip(*group, strict=True))
        processor = [sum(s["processor_seconds"] for s in side) for side in zip(*group, strict=True)]
        record[name] = {
            "steps": len(group),
            "ratio": of_steps / of_static,
            "processor_ratio": processor[0] / processor[1],
            "step_seconds": of_steps / len(group),
            "static_seconds": of_static / len(group),
            "median_ratio": float(np.median([a["seconds"] / s["seconds"] for a, s in group])),
            "applications": float(np.mean([s["applications"] for s, _ in group])),
            "factorisations": float(np.mean([s["factorisations"] for s, _ in group])),
            "corrections": float(np.mean([s["corrections"] for s, _ in group])),
            "changes": float(np.mean([s["changes"] for s, _ in group])),
            "static_newton": float(np.mean([s["newton_iterations"] for _, s in group])),
            "static_krylov": float(np.mean([s["krylov_iterations"] for _, s in group])),
        }
    if comm.rank == 0:
        print(f"{record['unknowns']} unknowns in {args.dim}D, {comm.size} ranks, "
              f"{record['linear_solver']}")  # fmt: skip
        for name in groups:
            if name in record:
                print(f"  {name}:", ", ".join(f"{k} {v:.3g}" for k, v in record[name].items()))
        worst = max(s["difference"] for s in solves)
        print(f"  the two agree to {worst:.1e}", flush=True)
        save(args.output, record)
    return record


if __name__ == "__main__":
    main()
