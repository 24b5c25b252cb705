# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact problems that others have published: solved, and where possible proved.

    python3 benchmarks/public_problems.py FOLDER --proof-seconds 60

reads every local or global problem in FOLDER (FCLib's HDF5, Siconos' text formats), for example
`numerics/src/FrictionContact/test/data` of Siconos, and prints a table in Markdown: size, friction,
rank of the compliance, algorithm, time, violation of the law, and a statement on the solutions. If
the compliance is regular, `proofs.prove_solutions` searches for all solutions. If it is singular,
the statement is the dimension of the set of forces with the same velocities. Seconds are processor
seconds on one core.
"""

import argparse
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from local_problem import LocalProblem, read

from dolfinx_contact.algorithms import RayTermination
from dolfinx_contact.proofs import ReducedProblem, prove_solutions

HEAD = "| problem | dim, points | F | rank | algorithm, steps | s | violation | statement | s |"


def solved(problem: LocalProblem, sweeps: int) -> tuple[str, np.ndarray, int]:
    """Solve by Lemke's method in 2D, otherwise or if it fails by Gauss-Seidel.

    Returns:
        Name of the algorithm, forces (m, dim), and number of pivots or sweeps.
    """
    if problem.dim == 2:
        with suppress(RayTermination):
            r, steps = problem.by_lemke()
            if problem.violation(r) <= 1e-8:
                return "lemke", r, steps
    return "gauss-seidel", *problem.by_sweeps(sweeps)


def statement(problem: LocalProblem, r: np.ndarray, seconds: float) -> str:
    """Describe the solutions; proofs stop after the given seconds."""
    solves = problem.violation(r) <= 1e-8
    if problem.rank < len(problem.q):
        if not solves:
            return "singular W; not solved"
        freedom = problem.reaction_freedom(r)
        if freedom:
            return f"singular W; set of forces of dimension {freedom}"
        return "singular W; forces unique for the velocities"
    points = problem.points()
    try:
        reduced = ReducedProblem(points.S, points.p, points.friction)
    except ValueError as error:
        return str(error)
    known = []
    if solves:
        a = points.displacements(r)
        known = [points.statuses(a, r) if problem.dim == 2 else np.hstack([a, r])]
    proved = prove_solutions(reduced, known=known, proof_seconds=seconds, progress=False)
    return str(proved).splitlines()[0]


def row(name: str, problem: LocalProblem, sweeps: int, seconds: float) -> str:
    """Return the row of the table for a problem."""
    begun = time.process_time()
    algorithm, r, steps = solved(problem, sweeps)
    solve_seconds = time.process_time() - begun
    begun = time.process_time()
    what = statement(problem, r, seconds)
    proof_seconds = time.process_time() - begun
    low, high = problem.friction.min(), problem.friction.max()
    friction = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    return (
        f"| {name} | {problem.dim}D, {problem.number} | {friction} | {problem.rank} of "
        f"{len(problem.q)} | {algorithm}, {steps} | {solve_seconds:.2f} | "
        f"{problem.violation(r):.0e} | {what} | {proof_seconds:.1f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder with files .dat and .hdf5")
    parser.add_argument("--proof-seconds", type=float, default=60.0, help="limit of each proof")
    parser.add_argument("--sweeps", type=int, default=20000, help="limit of Gauss-Seidel")
    parser.add_argument("--points", type=int, default=400, help="largest number of points")
    options = parser.parse_args()
    print(HEAD, "|---" * 9 + "|", sep="\n")
    for file in sorted(options.folder.iterdir()):
        if file.suffix not in (".dat", ".hdf5"):
            continue
        try:
            problem = read(file)
        except (KeyError, ValueError) as error:
            print(f"| {file.name} | not read: {error} |" + " |" * 7)
            continue
        if problem.number <= options.points:
            print(row(file.stem, problem, options.sweeps, options.proof_seconds), flush=True)


if __name__ == "__main__":
    main()
