# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does the smallest friction that wedges cost, over the contact nodes?

The triangle of `cases.wedging` on meshes of 1 to 32 cells an edge: coefficient, whether it is
proved, and processor time of the reduction and the search, which has one process.

    python3 benchmarks/wedging.py --output wedging.json
"""

from __future__ import annotations

import argparse
import time

from cases._triangle import linear_triangle
from timing import save

from dolfinx_contact.analysis import wedging_friction


def measured(n, seconds):
    """The smallest friction of a mesh."""
    problem = linear_triangle(n, 1.0, lame=(100.0, 82.0)).problem
    begun = time.process_time()
    found = wedging_friction(problem, seconds=seconds)
    return {
        "points": len(found.state),
        "friction": found.friction,
        "complete": found.complete,
        "processor_seconds": time.process_time() - begun,
    }


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", nargs="+", type=int, default=[1, 2, 4, 8, 16, 32])
    parser.add_argument("--seconds", type=float, default=60.0, help="wall time of one search")
    parser.add_argument("--output")
    args = parser.parse_args(argv)
    records = {}
    print("| n | points | friction | proved | processor, s |")
    print("|" + 5 * "---|")
    for n in args.n:
        records[n] = found = measured(n, args.seconds)
        proved = "yes" if found["complete"] else "no"
        seconds = f"{found['processor_seconds']:.2g}"
        print(f"| {n} | {found['points']} | {found['friction']:.9g} | {proved} | {seconds} |")
    if args.output:
        save(args.output, records)
    return records


if __name__ == "__main__":
    main()
