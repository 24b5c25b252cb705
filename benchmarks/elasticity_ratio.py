# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does friction cost over plain elasticity?

The whole frictional solve of a block pressed and dragged on a plane or a sphere over one linear
elastic solve of the same mesh with the contact face glued, to 1e-8, by the fastest of the settings
of GAMG and BoomerAMG in `elastic_solve.py`. Both sides begin with the mesh, the function space and
the tagged facets, and end with the displacement in a Function. In between count,

- of elasticity: the UFL and the look-up of its compiled forms, the Dirichlet conditions; the
  sparsity pattern, the assembly of the stiffness and of the load; the multigrid set-up, rigid
  motions included; conjugate gradients until ||b - K x|| <= 1e-8 ||b||, confirmed (untimed) by a
  product with K;
- of contact: the same and the contact surface's, by the same routines of DOLFINx; the multigrid
  set-up; all Newton steps, until every physical measure of the residual is below 1e-8, and the
  tables of the result.

Meshing and compilation are excluded on both sides. Every run is warm, and the median of three
counts (`timing.py`): first all settings are timed in turns, then the three fastest of them in turns
with the contact solve; the fastest of these three is the denominator. Everything is in one process
on the same ranks.

    mpirun -n 2 python3 benchmarks/elasticity_ratio.py --n 43 --cell tet --output ratio.json

``--settings few`` tries those that were the fastest somewhere, names and patterns choose others.
PETSc options with the prefix ``contact_`` reach the solver of the contact problem.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from typing import NamedTuple

from mpi4py import MPI

import elastic_solve
import numpy as np
from timing import REPEATS, Timer, clean, in_turns, peak_gigabytes, save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    Sphere,
    parse_arguments,
)
from dolfinx_contact.materials import LinearElastic

FINALISTS = 3  # settings that run in turns with the contact solve
CELLS = {"tet": mesh.CellType.tetrahedron, "hex": mesh.CellType.hexahedron}


class Case(NamedTuple):
    """What is solved.

    Attributes:
        block: mesh, displacement and facets of ``args``, n and a communicator, a space first.
        elasticity: of ``args``, what `block` gives and settings: elastic solves by name.
        problem: of ``args``, a timer and what `block` gives: the contact problem.
    """

    block: Callable
    elasticity: Callable
    problem: Callable


def arguments(argv=None, defaults=None, **more):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--n", type=int, default=24, help="cells along an edge")
    parser.add_argument("--cell", choices=CELLS, default="tet")
    parser.add_argument("--degree", type=int, choices=[1, 2], default=1, help="of displacements")
    parser.add_argument("--friction", type=float, default=0.3)
    parser.add_argument("--obstacle", choices=["plane", "sphere"], default="plane")
    parser.add_argument("--press", type=float, default=0.02, help="downward motion of the top")
    parser.add_argument("--shift", type=float, default=0.004, help="sideways motion of the top")
    parser.add_argument("--radius", type=float, default=10.0, help="radius of the sphere")
    parser.add_argument("--poisson", type=float, default=0.3)
    parser.add_argument("--aspect", type=float, default=1.0, help="width over height of the block")
    parser.add_argument("--tolerance", type=float, default=1e-8, help="of both solves")
    parser.add_argument("--only", choices=["elasticity", "contact"], help="for peak memory alone")
    parser.add_argument(
        "--settings",
        nargs="+",
        default=["all"],
        help="of the elastic solve: all, few, names or patterns (see elastic_solve.py)",
    )
    parser.add_argument("--repeats", type=int, default=REPEATS, help="timed runs of each")
    parser.add_argument("--output", default="elasticity_ratio.json")
    parser.set_defaults(**(defaults or {}))
    for name, options in more.items():
        parser.add_argument(f"--{name}", **options)
    args = parse_arguments(parser, argv)
    try:
        args.settings = elastic_solve.chosen(args.settings)
    except ValueError as error:
        parser.error(str(error))
    return args


def block(args, n, comm):
    """Mesh, displacement and tagged ends of a block of unit height."""
    domain = mesh.create_box(
        comm, [[0, 0, 0], [args.aspect, args.aspect, 1]], [n, n, n], CELLS[args.cell]
    )
    V = fem.functionspace(domain, ("Lagrange", args.degree, (3,)))
    ends = [
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z)) for z in (0, 1)
    ]
    return V, *ends


def top_condition(args, V, top):
    dofs = fem.locate_dofs_topological(V, 2, top)
    return fem.dirichletbc(np.array([args.shift, 0.0, -args.press]), dofs, V)


def elasticity(args, V, bottom, top, settings):
    """Functions by name, each a linear elastic solve with the bottom glued."""

    def conditions():
        return [top_condition(args, V, top), elastic_solve.glued(V, bottom)]

    return {
        s.name: elastic_solve.run_of(s, V, conditions, args.poisson, args.tolerance)
        for s in settings
    }


def obstacle(args):
    if args.obstacle == "plane":
        return HalfSpace((0, 0, 0), (0, 0, 1))
    return Sphere((args.aspect / 2, args.aspect / 2, -args.radius), args.radius)


def contact_problem(args, timer, V, bottom, top):
    return timer("problem", lambda: _problem(args, V, bottom, top))


def _problem(args, V, bottom, top):
    u = fem.Function(V)
    surface = ContactSurface(u, bottom, obstacle=obstacle(args), law=Coulomb(args.friction))
    return ContactProblem(
        LinearElastic.from_young(1.0, args.poisson).energy(u) * ufl.dx,
        u,
        [surface],
        bcs=[top_condition(args, V, top)],
        petsc_options={"snes_rtol": args.tolerance},
    )


BLOCK = Case(block, elasticity, contact_problem)


def contact(args, body, case=BLOCK):
    """The frictional solve from zero."""
    record = _contact(args, body, case)
    clean(body[0].mesh.comm)  # before the run that is next in turn
    return record


def _contact(args, body, case):
    timer = Timer(body[0].mesh.comm)
    problem = case.problem(args, timer, *body)
    timer("linear solver", lambda: problem.linear_solver)
    result = timer("solve", problem.solve)
    record = {
        **timer.record,
        "linear_solver": problem.linear_solver.name,
        "strategy": result.reason,
        "newton_iterations": result.iterations,
        "krylov_iterations": sum(a.krylov_iterations for a in result.attempts),
        "krylov_per_step": [s.krylov for s in result.history][1:],
        "flips": [s.flips for s in result.history],
        "residuals": [s.measures.worst for s in result.history],
        "hierarchies": getattr(problem.linear_solver, "builds", 0),
        "counts": result.counts,
        "kkt_violation": result.kkt_violation,
        "unknowns": result.dofs,
        "sum_rn": float(result.tables["contact"].rn.sum()),
    }
    return record


def compile_forms(args, comm, case=BLOCK):
    """Compile all forms on a mesh of some cells."""
    body = case.block(args, 3, comm)
    contact(args, body, case)
    for run in case.elasticity(args, *body, args.settings[:1]).values():
        run()


def run(args, n, comm, case=BLOCK):
    """Both solves on the mesh of n cells along an edge."""
    body = case.block(args, n, comm)
    V = body[0]
    V.mesh.topology.create_connectivity(2, 3)
    record = {
        "n": n,
        "cell": args.cell,
        "friction": args.friction,
        "obstacle": args.obstacle,
        "poisson": args.poisson,
        "aspect": args.aspect,
        "ranks": comm.size,
        "dofs": 3 * V.dofmap.index_map.size_global,
        "repeats": args.repeats,
        "memory_before": peak_gigabytes(comm),
    }
    finalists = {}
    if args.only != "contact":
        runs = case.elasticity(args, *body, args.settings)
        tried = in_turns(comm, runs, args.repeats)
        record["elasticity_by_preconditioner"] = list(tried.values())
        record["memory_after_elasticity"] = peak_gigabytes(comm)
        order = by_seconds(tried.values())
        if not order:
            raise RuntimeError("no setting solves the elastic problem")
        finalists = {r["setting"]: runs[r["setting"]] for r in order[:FINALISTS]}
        best = order
    if args.only != "elasticity":
        both = {"contact": lambda: contact(args, body, case), **finalists}
        both = in_turns(comm, both, args.repeats)
        record["contact"] = both.pop("contact")
        record["contact_seconds"] = record["contact"]["seconds"]
        record["contact_processor_seconds"] = record["contact"]["processor_seconds"]
        record["memory_after_contact"] = peak_gigabytes(comm)
        best = by_seconds(both.values())
        record["elasticity_finalists"] = best
    if args.only != "contact":
        record["elasticity"] = best[0]
        record["elasticity_setting"] = best[0]["setting"]
        record["elasticity_seconds"] = best[0]["seconds"]
        record["elasticity_processor_seconds"] = min(e["processor_seconds"] for e in best)
    if args.only is None:
        record["elasticity_ratio"] = record["contact_seconds"] / record["elasticity_seconds"]
        record["processor_ratio"] = (
            record["contact_processor_seconds"] / record["elasticity_processor_seconds"]
        )
    return record


def by_seconds(records):
    """Those that converged, the fastest first."""
    return sorted((r for r in records if r["converged"]), key=lambda r: r["seconds"])


def show(record):
    print(f"{record['dofs']} dofs, {record['ranks']} ranks, {record['cell']}")
    tried = record.get("elasticity_by_preconditioner", [])
    for e in [*by_seconds(tried), *(r for r in tried if not r["converged"])]:
        print(f"  {_line(e)}")
    if record.get("elasticity_finalists"):
        print("  in turns with the contact solve:")
        for e in record["elasticity_finalists"]:
            print(f"  {_line(e)}")
    if "contact" in record:
        c = record["contact"]
        parts = ", ".join(f"{k} {v:.2f}" for k, v in c["parts"].items())
        runs = ", ".join(f"{s:.2f}" for s in c["runs"])
        print(f"  contact: {c['seconds']:.2f} s of {runs} ({parts}), {c['strategy']}, "
              f"{c['newton_iterations']} Newton, {c['krylov_iterations']} Krylov "
              f"{c['krylov_per_step']}, {c['counts']}, KKT {c['kkt_violation']:.1e}")  # fmt: skip
    if "elasticity_ratio" in record:
        print(f"  ratio {record['elasticity_ratio']:.2f} over {record['elasticity_setting']}, "
              f"of processor time {record['processor_ratio']:.2f}")  # fmt: skip
    peaks = {k[7:]: round(v, 2) for k, v in record.items() if k.startswith("memory")}
    print(f"  peak memory in GB {peaks}", flush=True)


def _line(e):
    """An elastic solve."""
    if not e["converged"]:
        return f"{e['setting']}: fails (PETSc's reason {e['reason']})"
    parts = ", ".join(f"{k} {v:.2f}" for k, v in e["parts"].items())
    return (
        f"{e['setting']}: {e['seconds']:.3f} s ({parts}), {e['iterations']} iterations, "
        f"residual {e['true_residual']:.1e}, peak {e['peak_memory']:.2f} GB"
    )


def main(argv=None):
    return measure(arguments(argv), BLOCK)


def measure(args, case):
    """Compile, run, show and save."""
    comm = MPI.COMM_WORLD
    logging.basicConfig(level=logging.WARNING)
    compile_forms(args, comm, case)
    record = run(args, args.n, comm, case)
    if comm.rank == 0:
        show(record)
        save(args.output, record)
    return record


if __name__ == "__main__":
    main()
