# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does friction cost over plain elasticity?

The whole frictional solve of a block pressed and dragged on a plane or a sphere (assembly, set-up,
all Newton steps) over one linear elastic solve of the same mesh with the contact face glued
(assembly, multigrid set-up, conjugate gradients to 1e-8; the faster of GAMG and BoomerAMG). Meshing
and compilation are excluded on both sides, both run in the same process on the same ranks.

    mpirun -n 2 python3 benchmarks/elasticity_ratio.py --n 43 --cell tet --output ratio.json

PETSc options with the prefix ``contact_`` reach the solver of the contact problem.
"""

from __future__ import annotations

import argparse
import json
import logging
import resource
import time
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import dolfinx.fem.petsc
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
from dolfinx_contact.solvers import prolong
from dolfinx_contact.solvers.hierarchy import Hierarchy

CELLS = {"tet": mesh.CellType.tetrahedron, "hex": mesh.CellType.hexahedron}


def arguments(argv=None, **more):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--n", type=int, default=24, help="cells along an edge")
    parser.add_argument("--cell", choices=CELLS, default="tet")
    parser.add_argument("--friction", type=float, default=0.3)
    parser.add_argument("--obstacle", choices=["plane", "sphere"], default="plane")
    parser.add_argument("--press", type=float, default=0.02, help="downward motion of the top")
    parser.add_argument("--shift", type=float, default=0.004, help="sideways motion of the top")
    parser.add_argument("--radius", type=float, default=10.0, help="radius of the sphere")
    parser.add_argument("--poisson", type=float, default=0.3)
    parser.add_argument("--aspect", type=float, default=1.0, help="width over height of the block")
    parser.add_argument("--tolerance", type=float, default=1e-8, help="of both solves")
    parser.add_argument("--nested", type=int, default=0, help="coarser meshes to solve on first")
    parser.add_argument("--only", choices=["elasticity", "contact"], help="for peak memory alone")
    parser.add_argument("--output", default="elasticity_ratio.json")
    for name, options in more.items():
        parser.add_argument(f"--{name}", **options)
    return parse_arguments(parser, argv)


class Timer:
    """Wall time of named parts, the slowest rank counts; and processor time of all ranks.

    On a machine that others use too the processor time is the fairer of the two.
    """

    def __init__(self, comm):
        self.comm, self.seconds, self.processor = comm, {}, 0.0

    def __call__(self, name, function):
        self.comm.barrier()
        start, cpu = time.perf_counter(), time.process_time()
        result = function()
        self.processor += self.comm.allreduce(time.process_time() - cpu)
        self.comm.barrier()
        self.seconds[name] = self.comm.allreduce(time.perf_counter() - start, op=max)
        return result

    @property
    def total(self):
        return sum(self.seconds.values())


def peak_gigabytes(comm):
    """Peak of the resident memory of all ranks so far, 10^9 bytes."""
    return comm.allreduce(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1e9


def block(args, n, comm):
    """Mesh, displacement and tagged ends of a block of unit height."""
    domain = mesh.create_box(
        comm, [[0, 0, 0], [args.aspect, args.aspect, 1]], [n, n, n], CELLS[args.cell]
    )
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    ends = [
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z)) for z in (0, 1)
    ]
    return V, *ends


def top_condition(args, V, top):
    dofs = fem.locate_dofs_topological(V, 2, top)
    return fem.dirichletbc(np.array([args.shift, 0.0, -args.press]), dofs, V)


def elasticity(args, V, bottom, top, kind):
    """One linear elastic solve with the bottom glued."""
    comm, timer = V.mesh.comm, Timer(V.mesh.comm)
    u = fem.Function(V)
    energy = LinearElastic.from_young(1.0, args.poisson).energy(u) * ufl.dx
    residual = ufl.derivative(energy, u, ufl.TestFunction(V))
    a = fem.form(ufl.derivative(residual, u, ufl.TrialFunction(V)))
    L = fem.form(-residual)
    glued = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, bottom), V)
    bcs = [top_condition(args, V, top), glued]

    def assemble():
        K = dolfinx.fem.petsc.assemble_matrix(a, bcs=bcs)
        K.assemble()
        b = dolfinx.fem.petsc.assemble_vector(L)
        dolfinx.fem.petsc.apply_lifting(b, [a], bcs=[bcs])
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        dolfinx.fem.petsc.set_bc(b, bcs)
        return K, b

    prefix = f"elastic_{kind}_"
    database = PETSc.Options()
    database[prefix + "amg_pc_type"] = kind
    hierarchy = Hierarchy(V, prefix)
    K, b = timer("assembly", assemble)
    ksp = PETSc.KSP().create(comm)
    ksp.setType("cg")
    ksp.setTolerances(rtol=args.tolerance, max_it=500)
    ksp.setOperators(K)
    K.setNearNullSpace(hierarchy.null_space)
    K.setOption(PETSc.Mat.Option.SPD, True)
    timer("set-up", lambda: (hierarchy.set_up(ksp.getPC()), ksp.setUp()))
    x = b.duplicate()
    timer("solve", lambda: ksp.solve(b, x))
    record = {
        "preconditioner": kind,
        "seconds": timer.total,
        "processor_seconds": timer.processor,
        "parts": timer.seconds,
        "iterations": ksp.getIterationNumber(),
        "peak_memory": peak_gigabytes(comm),
        "converged": ksp.getConvergedReason() > 0,
    }
    for thing in (ksp, K, b, x):
        thing.destroy()
    hierarchy.release()
    return record


def obstacle(args):
    if args.obstacle == "plane":
        return HalfSpace((0, 0, 0), (0, 0, 1))
    return Sphere((args.aspect / 2, args.aspect / 2, -args.radius), args.radius)


def contact_problem(args, V, bottom, top):
    u = fem.Function(V)
    surface = ContactSurface(u, bottom, obstacle=obstacle(args), law=Coulomb(args.friction))
    return ContactProblem(
        LinearElastic.from_young(1.0, args.poisson).energy(u) * ufl.dx,
        u,
        [surface],
        bcs=[top_condition(args, V, top)],
        petsc_options={"snes_rtol": args.tolerance},
    )


def contact(args, V, bottom, top, coarse=()):
    """The frictional solve from zero, by way of coarser meshes if there are any."""
    timer = Timer(V.mesh.comm)
    before, levels = None, []

    def coarse_solves():
        last = None
        for part in coarse:
            problem = contact_problem(args, *part)
            if last is not None:
                prolong(last, problem)
                last.destroy()
            result = problem.solve()
            levels.append({"unknowns": result.dofs, "newton_iterations": result.iterations})
            last = problem
        return last

    if coarse:
        before = timer("coarse solves", coarse_solves)
    problem = timer("problem", lambda: contact_problem(args, V, bottom, top))
    timer("linear solver", lambda: problem.linear_solver)
    if before is not None:
        timer("prolongation", lambda: prolong(before, problem))
        before.destroy()
    result = timer("solve", problem.solve)
    record = {
        "seconds": timer.total,
        "processor_seconds": timer.processor,
        "parts": timer.seconds,
        "coarse": levels,
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
    problem.destroy()
    return record


def warm_up(args, comm):
    """Compile all forms on a mesh of some cells."""
    V, bottom, top = block(args, 3, comm)
    contact(args, V, bottom, top, [block(args, 2, comm)])
    elasticity(args, V, bottom, top, "gamg")


def run(args, n, comm):
    """Both solves on the mesh of n cells along an edge."""
    V, bottom, top = block(args, n, comm)
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
        "memory_before": peak_gigabytes(comm),
    }
    if args.only != "contact":
        kinds = [elasticity(args, V, bottom, top, k) for k in ("gamg", "hypre")]
        record["elasticity"] = min(kinds, key=lambda r: r["seconds"])
        record["elasticity_by_preconditioner"] = kinds
        record["elasticity_seconds"] = record["elasticity"]["seconds"]
        record["memory_after_elasticity"] = peak_gigabytes(comm)
    if args.only != "elasticity":
        coarse = [block(args, n // 2**i, comm) for i in range(args.nested, 0, -1)]
        record["contact"] = contact(args, V, bottom, top, coarse)
        record["contact_seconds"] = record["contact"]["seconds"]
        record["memory_after_contact"] = peak_gigabytes(comm)
    if args.only is None:
        record["elasticity_ratio"] = record["contact_seconds"] / record["elasticity_seconds"]
        fewest = min(e["processor_seconds"] for e in kinds)
        record["elasticity_processor_seconds"] = fewest
        record["contact_processor_seconds"] = record["contact"]["processor_seconds"]
        record["processor_ratio"] = record["contact_processor_seconds"] / fewest
    return record


def show(record):
    print(f"{record['dofs']} dofs, {record['ranks']} ranks, {record['cell']}, {record['obstacle']}")
    for e in record.get("elasticity_by_preconditioner", []):
        parts = ", ".join(f"{k} {v:.2f}" for k, v in e["parts"].items())
        print(f"  elasticity {e['preconditioner']}: {e['seconds']:.2f} s ({parts}), "
              f"{e['iterations']} iterations, peak {e['peak_memory']:.2f} GB")  # fmt: skip
    if "contact" in record:
        c = record["contact"]
        parts = ", ".join(f"{k} {v:.2f}" for k, v in c["parts"].items())
        print(f"  contact: {c['seconds']:.2f} s ({parts}), {c['strategy']}, "
              f"{c['newton_iterations']} Newton, {c['krylov_iterations']} Krylov "
              f"{c['krylov_per_step']}, {c['counts']}, KKT {c['kkt_violation']:.1e}")  # fmt: skip
    if "elasticity_ratio" in record:
        print(f"  ratio {record['elasticity_ratio']:.2f}, "
              f"of processor time {record['processor_ratio']:.2f}")  # fmt: skip
    peaks = {k[7:]: round(v, 2) for k, v in record.items() if k.startswith("memory")}
    print(f"  peak memory in GB {peaks}", flush=True)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    logging.basicConfig(level=logging.WARNING)
    warm_up(args, comm)
    record = run(args, args.n, comm)
    if comm.rank == 0:
        show(record)
        Path(args.output).parent.mkdir(parents=True, exist_ok=True)
        Path(args.output).write_text(json.dumps(record, indent=1) + "\n")
    return record


if __name__ == "__main__":
    main()
