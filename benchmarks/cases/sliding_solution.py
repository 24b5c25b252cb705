# SPDX-License-Identifier: LGPL-3.0-or-later
"""Algorithms through the critical friction.

Reference: closed form.

V. Rey (C. R. Mecanique 354, 2026) compares algorithms on an example with several solutions for
F > 3, and not all reach its sliding one. Hild's triangle with nu = 0 has the same threshold,
3 - 4 nu. The second problem is the triangle of `linear_triangle.py` under its own load.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _plots import draw_maps
from _triangle import ENDS, end_of, reduced

from dolfinx_contact import algorithms, io

ALGORITHMS = {
    "newton": algorithms.SemismoothNewton(),
    "tresca": algorithms.TrescaFixedPoint(max_iterations=1000),
    "uzawa": algorithms.Uzawa(max_iterations=1000),
    "penalty": algorithms.Penalty(),
    "gauss-seidel": algorithms.GaussSeidel(max_iterations=1000),
    "cg": algorithms.ProjectedGradient(max_iterations=3000),
    "lemke": algorithms.Lemke(),
    "interior-point": algorithms.InteriorPoint(max_iterations=60),
}

# The node A.
#
# With all other nodes open A has the stiffness [[kt, k], [k, kn]] and the load (-pt, -pn). It
# sticks for F >= pt/pn, opens for kt/k <= pt/pn, and slides to the left where pt/pn lies between F
# and kt/k. So F_c = kt/k; under a load with pt/pn > kt/k there are three solutions once F > pt/pn.


def corner(contact):
    """kt/k, pt/pn and pn of A, which comes first."""
    S = np.linalg.inv(contact.A[:2, :2])
    pt, pn = S @ contact.free[0]
    stiffness_ratio = S[0, 0] / S[0, 1]
    load_ratio = pt / pn
    return float(stiffness_ratio), float(load_ratio), float(-pn)


# Two problems.
#
# The load on Hild's triangle follows the friction, pt/pn = (3 + F)/2: below F = 3 it slides, and
# has no other solution; above, it has two more; at F = 3 all forces with rt = 3 rn, rn <= pn are
# solutions.


def element(friction, n):
    return reduced(1, friction, (1.5 + friction / 2, 1.0), (0.0, 0.5))


def triangle(friction, n):
    return reduced(n, friction, (26.0, 7.5), (100.0, 82.0))


# Where algorithms end.
#
# Starts are forces of a sliding node, rn = s pn and rt = F rn. What comes out, on the element (its
# sliding solution has s = 1/2):
#
# - Below F = 3 all end in the sliding solution; at F = 3, where s is free up to 1, iterations stay
#   at the solution that they begin with.
# - Above, Newton's method alone ends in it, from starts around it. From the fixed points of Tresca,
#   Uzawa and projected gradients it drives away, by F/3 a step of Tresca's: they end open from
#   smaller forces, stuck from larger ones. Penalisation, Gauss-Seidel and Lemke's method end open,
#   the interior point stuck, whatever the start.
#
# On the triangle of 8 nodes the same, but for Gauss-Seidel, which is a fixed point there, and
# Lemke's method, which ends stuck. Below F_c, where it opens, full Newton steps cycle (a solve of
# the whole problem then continues otherwise); at F_c the interior point does not converge.


def sweep(problem, n, frictions, starts):
    """By algorithm the words and the pressures rn/pn of the ends, (frictions, starts)."""
    size = len(frictions), len(starts)
    words = {name: np.full(size, "n") for name in ALGORITHMS}
    pressures = {name: np.full(size, np.nan) for name in ALGORITHMS}
    for i, friction in enumerate(frictions):
        contact = problem(friction, n)
        _, _, pn = corner(contact)
        direction = np.array([friction, 1.0])
        for name, algorithm in ALGORITHMS.items():
            for j, s in enumerate(starts):
                start = np.zeros((contact.number, 2))
                start[0] = s * pn * direction
                outcome = algorithm.run(contact, start=start)
                words[name][i, j] = end_of(contact, outcome)
                pressures[name][i, j] = outcome.r[0, 1] / pn
    return words, pressures


def main(argv=None):
    parser = ScriptParser("Through the critical friction", output="output/sliding_solution", n=8)
    parser.add_argument("--grid", type=number(int, least=2), default=6, help="starts")
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    cells = np.arange(args.grid)
    starts = (cells + 0.5) * 1.1 / args.grid  # none is the solution
    problems = {}
    for problem in (element, triangle):
        title = problem.__name__
        contact = problem(3.0, args.n)
        stiffness_ratio, load_ratio, _ = corner(contact)
        critical = max(stiffness_ratio, load_ratio)
        frictions = np.round(critical * np.array([0.8, 0.9, 1.0, 1.1, 1.2]), 12)
        words, pressures = sweep(problem, args.n, frictions, starts)
        ends = {name: ["".join(row) for row in letters] for name, letters in words.items()}
        say(f"{title}: the critical friction is {critical:.10g}")
        for name, rows in ends.items():
            found = [f"{f:.3g} {row}" for f, row in zip(frictions, rows, strict=True)]
            say(f"  {name:>14}: " + "  ".join(found))
        if comm.rank == 0:
            labels = ("$F$", "$r_n/p_n$ of A at the start")
            file = folder / f"{title}.png"
            draw_maps(file, frictions, starts, words, ENDS, labels=labels)
        problems[title] = {
            "critical": critical,
            "frictions": frictions.tolist(),
            "words": ends,
            "pressures": {name: values.tolist() for name, values in pressures.items()},
        }
    summary = problems["element"] | {"problems": problems}
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
