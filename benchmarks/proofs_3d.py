# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far proofs in space go, over the number of contact points and the friction.

Random stiffnesses (condition 10), four problems of each size and coefficient; blocks with one
solution, of the bodies of `cases.proofs_3d`; and its triangles with several. Columns: how many
are closed within the seconds of processor time, solutions, branches, steps, open regions, and the
processor time and wall time of searches, and the time of the check. On a machine that others use a
search may take ``--patience`` times the seconds of wall time.

    python3 benchmarks/proofs_3d.py --parts random blocks triangles --output proofs_3d.json
"""

from __future__ import annotations

import argparse
import time

from mpi4py import MPI

import cases.proofs_3d
import numpy as np
from timing import save

from dolfinx_contact.proofs import ReducedProblem, check, prove_solutions

SIZES = (2, 4, 8, 12, 16)
FRICTIONS = (0.5, 1.0, 2.0, 5.0)
BLOCKS = (4, 5, 7)
#: Cells, load and friction, and other options of the demo.
TRIANGLES = {
    "2x1, F = 2": ((2, 1), (-1, 0.1, -0.5), 2.0),
    "2x2, F = 3.5": ((2, 2), (-0.82, 0.23, -0.34), 3.5),
    "3x2, F = 3.5": ((3, 2), (-1, 0.2, -0.3), 3.5),
    "4x2, F = 2": ((4, 2), (-1, 0.2, -0.3), 2.0),
    "4x2, F = 3.5": ((4, 2), (-1, 0.2, -0.3), 3.5),
    "4x3, F = 3.5": ((4, 3), (-1, 0.2, -0.3), 3.5),
    "wedge, h = 0.5, F = 3": ((2, 2), (-26, 1, -7.5), 3.0, "--lame", 100, 82),
    "wedge, h = 0.25, F = 3": ((4, 2), (-26, 1, -7.5), 3.0, "--lame", 100, 82),
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
    args = cases.proofs_3d.arguments(list(map(str, words)))
    points = cases.proofs_3d.body(args, MPI.COMM_SELF).problem.reduced()
    errors = points.S_error, points.p_error
    return ReducedProblem(points.S, points.p, points.friction, points.bound, *errors)


def measured(problem, seconds):
    """A search and the check of its proof."""
    begun = time.process_time()
    found = prove_solutions(problem, proof_seconds=seconds, progress=False)
    processor = time.process_time() - begun
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
        "processor_seconds": processor,
        "seconds": found.seconds,
        "check_seconds": time.perf_counter() - begun,
    }


def described(name, records, seconds):
    """A row of the table; closed is what is complete within seconds of processor time."""
    closed = [r["verdict"] == "complete" and r["processor_seconds"] <= seconds for r in records]
    counts = sorted(r["solutions"] for r in records)
    branches, steps, open_ = (sorted(r[k] for r in records) for k in ("branches", "steps", "open"))
    times, walls = (
        ", ".join(f"{value:.2g}" for value in sorted(r[key] for r in records))
        for key in ("processor_seconds", "seconds")
    )
    checks = max(r["check_seconds"] for r in records)
    return (
        f"| {name} | {sum(closed)} of {len(records)} | {counts} | {branches} | {steps} | {open_} |"
        f" {times} | {walls} | {checks:.2g} |"
    )


def cases(parts, sizes, frictions):
    """Names, and what makes the problems of a row."""
    if "random" in parts:
        for n in sizes:
            for F in frictions:
                yield f"random, n = {n}, F = {F:g}", [(random_problem, (n, F, k)) for k in range(4)]
    if "blocks" in parts:
        for n in BLOCKS:
            for F in (0.3, 0.6, 1.0):
                words = ["--shape", "block", "--cells", n, n, 2, "--load", 0.5, 0.2, -1]
                yield f"block, {n + 1} x {n + 1}, F = {F:g}", [(body, (*words, "--friction", F))]
    if "triangles" in parts:
        for name, (cells, load, F, *others) in TRIANGLES.items():
            words = ["--cells", *cells, "--load", *load, "--friction", F, *others]
            yield f"triangle {name}", [(body, words)]


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", default=["random", "blocks", "triangles"])
    parser.add_argument("--sizes", nargs="+", type=int, default=SIZES)
    parser.add_argument("--frictions", nargs="+", type=float, default=FRICTIONS)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--patience", type=float, default=1.0)
    parser.add_argument("--output")
    args = parser.parse_args(argv)
    columns = ("problem", "closed", "solutions", "branches", "steps", "open")
    print("|", " | ".join((*columns, "processor, s", "wall, s", "check, s")), "|")
    print("|" + 9 * "---|")
    found = {}
    for name, made in cases(args.parts, args.sizes, args.frictions):
        wall = args.seconds * args.patience
        found[name] = [measured(make(*given), wall) for make, given in made]
        print(described(name, found[name], args.seconds), flush=True)
    if args.output:
        save(args.output, found)
    return found


if __name__ == "__main__":
    main()
