# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does it cost to ask whether a solution is the only one?

`problem.uniqueness()` after a solve from zero, over that solve and in milliseconds of processor
time; every run makes its problem again, warm, in turns, medians of three (`timing.py`). The solve
does not include the set-up. Blocks are those of `benchmarks/cases/block.py`, the triangle that of
`cases.linear_triangle`, at gamma = -1 (one solution) and 1 (three for 64 nodes), GRECO that of
`benchmarks/cases/greco_block.py`.

    python3 benchmarks/uniqueness_cost.py --output uniqueness.json
"""

from __future__ import annotations

import argparse
from functools import partial

from mpi4py import MPI

import cases.block
import cases.greco_block
from cases._triangle import linear_triangle
from timing import Timer, in_turns, save


def block(dim, n, comm):
    return cases.block.problem(cases.block.arguments([f"--dim={dim}", f"--n={n}"]), comm)


def greco(n, comm):
    return cases.greco_block.problem(cases.greco_block.arguments([f"--n={n}"]), comm)


def triangle(n, gamma, comm):
    system = linear_triangle(n, 1.7, comm=comm)
    system.set_parameter(gamma)
    return system.problem


CASES = {
    **{f"block {n}": partial(block, 2, n) for n in (8, 16, 32, 64, 128)},
    **{f"cube {n}": partial(block, 3, n) for n in (4, 6, 8, 12)},
    **{f"GRECO {n}": partial(greco, n) for n in (16, 32)},
    **{f"triangle {n}, {g:+g}": partial(triangle, n, g) for n in (16, 64) for g in (-1.0, 1.0)},
}


def measured(make, comm):
    """One solve and the question after it."""
    problem = make(comm)
    solve = Timer(comm)
    unique = Timer(comm)
    result = solve("solve", problem.solve)
    verdict = unique("unique", problem.uniqueness).verdict
    record = {
        "seconds": unique.processor,
        "solve_seconds": solve.processor,
        "verdict": verdict,
        "points": sum(result.counts.values()),
        "dofs": result.dofs,
    }
    return record


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--output")
    args = parser.parse_args(argv)
    comm = MPI.COMM_WORLD
    found = in_turns(comm, {name: partial(measured, CASES[name], comm) for name in args.cases})
    for record in found.values():
        record["ratio"] = record["seconds"] / record["solve_seconds"]
    if comm.rank == 0:
        print("| problem | points | unknowns | solve, ms | unique, ms | ratio | says |")
        print("|" + 7 * "---|")
        for name, r in found.items():
            times = f"{1e3 * r['solve_seconds']:.0f} | {1e3 * r['seconds']:.0f} | {r['ratio']:.2f}"
            print(f"| {name} | {r['points']} | {r['dofs']} | {times} | {r['verdict']} |")
        if args.output:
            save(args.output, found)
    return found


if __name__ == "__main__":
    main()
