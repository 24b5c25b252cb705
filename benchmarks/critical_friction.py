# SPDX-License-Identifier: LGPL-3.0-or-later
"""Critical friction of large bodies: multigrid beside a factorisation.

A cube of n^3 hexahedra that leans by half its width, clamped at its top, all of its bottom slipping
along x. For each n and solver: the coefficient, the relative residual of what is listed, how far
coefficients are known, solves and cycles of multigrid, seconds, and gigabytes of all ranks
at their peak (each size after the smaller ones, so that the last is its own).

    docker/run mpirun -n 2 python3 benchmarks/critical_friction.py --n 9 20 43
"""

from __future__ import annotations

import argparse
import resource

from mpi4py import MPI

import numpy as np
from timing import Timer, save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.analysis import critical_friction
from dolfinx_contact.materials import LinearElastic


def leaning_cube(n, comm):
    domain = mesh.create_unit_cube(comm, n, n, n, mesh.CellType.hexahedron)
    bottom, top = (
        mesh.locate_entities_boundary(domain, 2, lambda x, z=z: np.isclose(x[2], z))
        for z in (0.0, 1.0)
    )
    domain.geometry.x[:, 0] += 0.5 * domain.geometry.x[:, 2]
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V)
    clamped = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, top), V)
    floor = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0, 0), (0, 0, 1)), law=Coulomb(1.0))
    energy = LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [floor], bcs=[clamped])


def measured(n, solver, comm):
    problem = leaning_cube(n, comm)
    timer = Timer(comm)
    along = (1.0, 0.0, 0.0)
    found = timer(
        "critical friction",
        lambda: critical_friction(problem, along, dense=False, solver=solver),
    )
    peak = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * 1024e-9
    dofs = problem.u.function_space.dofmap.index_map.size_global * 3
    problem.destroy()
    return {
        "n": n,
        "dofs": dofs,
        "points": (n + 1) ** 2,
        "solver": solver,
        "friction": found.friction,
        "known_up_to": found.known_up_to,
        "residual": found.residual,
        "solves": found.solves,
        "iterations": found.iterations,
        "seconds": timer.total,
        "processor_seconds": timer.processor,
        "gigabytes": peak,
    }


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", nargs="+", type=int, default=[9, 20])
    parser.add_argument("--solvers", nargs="+", choices=("direct", "amg"), default=["amg"])
    parser.add_argument("--output")
    args = parser.parse_args(argv)
    comm = MPI.COMM_WORLD
    found = []
    names = ["n", "unknowns", "points", "solver", "F", "known up to", "residual"]
    names += ["solves", "iterations", "seconds", "processor", "GB"]
    if comm.rank == 0:
        print("| " + " | ".join(names) + " |")
        print("|" + len(names) * "---|")
    for n in args.n:
        for solver in args.solvers:
            found.append(measured(n, solver, comm))
            if comm.rank == 0:
                r = found[-1]
                what = f"{r['n']} | {r['dofs']} | {r['points']} | {r['solver']}"
                what += f" | {r['friction']:.9f} | {r['known_up_to']:.6f} | {r['residual']:.0e}"
                work = f"{r['solves'] or ''} | {r['iterations'] or ''}"
                cost = f"{r['seconds']:.1f} | {r['processor_seconds']:.1f} | {r['gigabytes']:.2f}"
                print(f"| {what} | {work} | {cost} |", flush=True)
    if comm.rank == 0 and args.output:
        save(args.output, found)
    return found


if __name__ == "__main__":
    main()
