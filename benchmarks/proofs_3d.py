# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far proofs in space go, over the number of contact points and the friction.

Random stiffnesses (condition 10), four problems of each size and coefficient; blocks with one
solution, of the bodies of `demo_proofs_3d.py`; and its triangles with several. Columns: how many
are closed within the seconds, branches, steps, and the seconds of search and check.

    python3 benchmarks/proofs_3d.py --parts random blocks triangles --output proofs_3d.json
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
from timing import save

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "demos"))

import demo_proofs_3d

from dolfinx_contact.analysis import ReducedProblem, check, prove_solutions

SIZES = (2, 4, 8, 12, 16)
FRICTIONS = (0.5, 1.0, 2.0, 5.0)
BLOCKS = (4, 5, 7)
#: Cells, load and friction.
TRIANGLES = {
    "2x1, F = 2": ((2, 1), (-1, 0.1, -0.5), 2.0),
    "2x2, F = 3.5": ((2, 2), (-0.82, 0.23, -0.34), 3.5),
    "3x2, F = 3.5": ((3, 2), (-1, 0.2, -0.3), 3.5),
    "4x2, F = 2": ((4, 2), (-1, 0.2, -0.3), 2.0),
    "4x2, F = 3.5": ((4, 2), (-1, 0.2, -0.3), 3.5),
    "4x3, F = 3.5": ((4, 3), (-1, 0.2, -0.3), 3.5),
}


def random_problem(n, friction, number):
    """A stiffness of condition 10 and a load that presses."""
    rng = np.random.default_rng(100 * n + number)
    Q = np.linalg.qr(rng.normal(size=(3 * n, 3 * n)))[0]
    S = (Q * np.exp(rng.uniform(0, np.log(10), 3 * n))) @ Q.T
    p = rng.normal(size=3 * n) - np.tile([0, 0, 0.5], n)
    return ReducedProblem(S, p, np.full(n, friction))


def body(*words):
    """The reduced problem of a body of the demo."""
    args = demo_proofs_3d.arguments(list(map(str, words)))
    points = demo_proofs_3d.body(args, MPI.COMM_SELF).problem.reduced()
    errors = points.S_error, points.p_error
    return ReducedProblem(points.S, points.p, points.friction, points.bound, *errors)


def measured(problem, seconds):
    """A search and the check of its proof."""
    found = prove_solutions(problem, proof_seconds=seconds, progress=False)
    begun = time.perf_counter()
    check(found.certificate)
    steps = [step["do"] for step in found.certificate.steps]
    return {
        "points": problem.points,
        "verdict": found.verdict,
        "solutions": len(found.solutions),
        "open": len(found.open_regions),
        "steps": len(steps),
        "branches": steps.count("branch"),
        "seconds": found.seconds,
        "check_seconds": time.perf_counter() - begun,
    }


def described(name, records):
    """A row of the table."""
    closed = sum(r["verdict"] == "complete" for r in records)
    counts = sorted(r["solutions"] for r in records)
    branches, steps, open_ = (sorted(r[k] for r in records) for k in ("branches", "steps", "open"))
    times = ", ".join(f"{r['seconds']:.2g}" for r in sorted(records, key=lambda r: r["seconds"]))
    checks = max(r["check_seconds"] for r in records)
    return (
        f"| {name} | {closed} of {len(records)} | {counts} | {branches} | {steps} | {open_} |"
        f" {times} | {checks:.2g} |"
    )


def cases(parts):
    """Names, and what makes the problems of a row."""
    if "random" in parts:
        for n in SIZES:
            for F in FRICTIONS:
                yield f"random, n = {n}, F = {F:g}", [(random_problem, (n, F, k)) for k in range(4)]
    if "blocks" in parts:
        for n in BLOCKS:
            for F in (0.3, 0.6, 1.0):
                words = ["--shape", "block", "--cells", n, n, 2, "--load", 0.5, 0.2, -1]
                yield f"block, {n + 1} x {n + 1}, F = {F:g}", [(body, (*words, "--friction", F))]
    if "triangles" in parts:
        for name, (cells, load, F) in TRIANGLES.items():
            words = ["--cells", *cells, "--load", *load, "--friction", F]
            yield f"triangle {name}", [(body, words)]


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", default=["random", "blocks", "triangles"])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--output")
    args = parser.parse_args(argv)
    print("| problem | complete | solutions | branches | steps | open | search, s | check, s |")
    print("|" + 8 * "---|")
    found = {}
    for name, made in cases(args.parts):
        found[name] = [measured(make(*given), args.seconds) for make, given in made]
        print(described(name, found[name]), flush=True)
    if args.output:
        save(args.output, found)
    return found


if __name__ == "__main__":
    main()
