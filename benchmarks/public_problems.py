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

from dolfinx_contact.algorithms import LocalProblem, RayTermination, load_local
from dolfinx_contact.proofs import ReducedProblem, prove_solutions

HEAD = "| problem | dim, points | F | rank | algorithm | steps | s | violation | statement | s |"


def solved(problem: LocalProblem, sweeps: int):
    """Solve by Lemke's method in 2D, otherwise or if it fails by Gauss-Seidel."""
    start = time.process_time()
    solution = None
    if problem.dim == 2:
        with suppress(RayTermination):
            solution = problem.solve("lemke")
    if solution is None or solution.violation > 1e-8:
        solution = problem.solve(max_iterations=sweeps)
    return solution, time.process_time() - start


def statement(problem: LocalProblem, solution, seconds: float) -> tuple[str, float]:
    """What is known of the solutions, and the processor seconds that it took."""
    if problem.rank < len(problem.q):
        if solution.violation > 1e-8:
            return "singular; not solved", 0.0
        freedom = problem.reaction_freedom(solution)
        if freedom:
            return f"singular; forces with these velocities: dimension {freedom}", 0.0
        return "singular; forces are unique for these velocities", 0.0
    start = time.process_time()
    points = problem.points()
    try:
        reduced = ReducedProblem(points.S, points.p, points.friction)
    except ValueError as error:
        return str(error), 0.0
    known = []
    if solution.violation < 1e-8:
        a = points.displacements(solution.r)
        if problem.dim == 2:
            known = [points.statuses(a, solution.r)]
        else:
            known = [np.hstack([a, solution.r])]
    proved = prove_solutions(reduced, known=known, proof_seconds=seconds, progress=False)
    return str(proved).splitlines()[0], time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder with files .dat and .hdf5")
    parser.add_argument("--proof-seconds", type=float, default=60.0, help="limit of each proof")
    parser.add_argument("--sweeps", type=int, default=20000, help="limit of Gauss-Seidel")
    parser.add_argument("--points", type=int, default=400, help="largest number of points")
    options = parser.parse_args()
    print(HEAD, "|---" * 10 + "|", sep="\n")
    for file in sorted(options.folder.iterdir()):
        if file.suffix not in (".dat", ".hdf5"):
            continue
        try:
            problem = load_local(file)
        except ValueError as error:
            print(f"| {file.name} | not read: {str(error).rpartition(': ')[2]} |" + " |" * 8)
            continue
        if problem.number > options.points:
            continue
        solution, seconds = solved(problem, options.sweeps)
        what, spent = statement(problem, solution, options.proof_seconds)
        low, high = problem.friction.min(), problem.friction.max()
        friction = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        print(
            f"| {file.stem} | {problem.dim}D, {problem.number} | {friction} | {problem.rank} of "
            f"{len(problem.q)} | {solution.algorithm} | {solution.iterations} | {seconds:.2f} | "
            f"{solution.violation:.0e} | {what} | {spent:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
