# SPDX-License-Identifier: LGPL-3.0-or-later
"""Does the default solver converge from zero, whatever the friction and the augmentation parameter?

Blocks in 2D and 3D on a plane, a tilted plane and a sphere, friction from 0 to 3, r automatic and
forced from 0.1 to 1e4 times Young's modulus over the size of the body. Prints a table of Newton
iterations and of the fallbacks that were needed, and writes it as JSON.

    python3 benchmarks/robustness.py --output robustness.json
"""

from __future__ import annotations

import argparse
import itertools
import json
import logging
import sys
from collections import Counter
from pathlib import Path

from mpi4py import MPI

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.harness import varied

from dolfinx_contact import ConvergenceError

FRICTION = [0.0, 0.05, 0.1, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0]
FACTORS = [None, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4]
BLOCKS = [
    *itertools.product([2], ["tri", "quad"], [8, 16, 32], ["plane", "tilted", "sphere"]),
    *itertools.product([3], ["tet", "hex"], [4, 6], ["plane", "tilted", "sphere"]),
]


def main() -> None:
    """Run the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", default="robustness.json")
    parser.add_argument("--quick", action="store_true", help="every fourth case")
    args = parser.parse_args()
    comm = MPI.COMM_WORLD
    logging.getLogger("dolfinx_contact").setLevel(logging.ERROR)
    records = []
    cases = list(itertools.product(BLOCKS, FACTORS))
    for (dim, cell, n, obstacle), factor in cases[:: 4 if args.quick else 1]:
        options = [f"--dim={dim}", f"--cell={cell}", f"--n={n}", f"--obstacle={obstacle}"]
        with varied(r=None if factor is None else factor * 1000.0):  # E = 1000, size 1
            problem = cases.block.problem(cases.block.arguments(options), comm)
        zero = problem.create_vector()
        for friction in FRICTION:
            problem.surfaces[0].law.friction.value = friction
            zero.set(0.0)
            problem.read(zero)
            record = {
                "dim": dim, "cell": cell, "n": n, "obstacle": obstacle, "friction": friction,
                "r_factor": factor,
            }  # fmt: skip
            try:
                result = problem.solve()
                record |= {
                    "strategy": result.reason,
                    "iterations": result.iterations,
                    "counts": result.counts,
                    "kkt": result.kkt_violation,
                }
            except ConvergenceError as error:
                record |= {"strategy": "failed", "iterations": 0, "message": str(error)}
                if comm.rank == 0:
                    print("FAILED", record, flush=True)
            records.append(record)
    if comm.rank == 0:
        report(records)
        Path(args.output).write_text(json.dumps(records, indent=1) + "\n")


def report(records: list[dict]) -> None:
    """Print strategies and iterations by r."""
    print(
        "| r / (E/L) | solves | full steps | automatic r | pivoting | line search | load | failed "
        "| median it. | max it. |"
    )
    print("|---" * 10 + "|")
    names = [
        "full steps", "full steps with the automatic r", "pivoting", "line search",
        "load increments", "failed",
    ]  # fmt: skip
    for factor in FACTORS:
        rows = [r for r in records if r["r_factor"] == factor]
        if rows:
            counts = Counter(r["strategy"] for r in rows)
            steps = [r["iterations"] for r in rows]
            cells = [len(rows), *(counts[n] for n in names), int(np.median(steps)), max(steps)]
            label = "automatic" if factor is None else f"{factor:g}"
            print(f"| {label} | " + " | ".join(str(c) for c in cells) + " |")


if __name__ == "__main__":
    main()
