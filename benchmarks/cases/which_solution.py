# SPDX-License-Identifier: LGPL-3.0-or-later
"""In which solution algorithms end.

Reference: enumeration.

Two problems with three solutions: Hild's element with F = 3 under the traction (-2.4, -1) (its
corner A opens, sticks or slips to the left), and the triangle of `linear_triangle.py` with
16 contact nodes, F = 2, at gamma = 1 (the same three at A, all other nodes open).
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _plots import draw_maps
from _triangle import ENDS, end_of, reduced

from dolfinx_contact import algorithms, io

ALGORITHMS = {
    "newton": algorithms.SemismoothNewton(),
    "tresca": algorithms.TrescaFixedPoint(max_iterations=50),
    "uzawa": algorithms.Uzawa(max_iterations=1000),
    "penalty": algorithms.Penalty(),
    "gauss-seidel": algorithms.GaussSeidel(max_iterations=200),
    "cg": algorithms.ProjectedGradient(max_iterations=200),
    "lemke": algorithms.Lemke(),
    "interior-point": algorithms.InteriorPoint(max_iterations=60),
}

# Where an algorithm ends.
#
# The status of A in the solution, or what else happened. Starts are contact forces (rt, rn) at A,
# from a grid. Lemke's method knows no start.


def basins(contact, size):
    """Axes of a grid of starts, and by algorithm the word of each."""
    largest = 3.0 * float(np.abs(contact.p[:2]).max())
    rt = np.linspace(-largest, largest, size)
    rn = np.linspace(0.0, largest, size)
    panels = {name: np.full((size, size), "n") for name in ALGORITHMS}
    panels["lemke"][:] = end_of(contact, ALGORITHMS["lemke"].run(contact))
    for name in set(ALGORITHMS) - {"lemke"}:
        for i, j in np.ndindex(size, size):
            start = np.zeros((contact.number, 2))
            start[0] = rt[i], rn[j]
            outcome = ALGORITHMS[name].run(contact, start=start)
            panels[name][i, j] = end_of(contact, outcome)
    return (rt, rn), panels


# The problems.
#
# At F = (lambda + 3 mu)/(lambda + mu) = 2 the element has a continuum of solutions under the
# traction (-2, -1): every slip between stick and separation. They are so small that every rank
# solves them alone.


def main(argv=None):
    parser = ScriptParser("Which solution?", output="output/which_solution", n=16, friction=2.0)
    parser.add_argument("--grid", type=number(int, least=2), default=12, help="starts on its edge")
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    problems = {
        "element": (reduced(1, 3.0, (2.4, 1.0), (1.0, 1.0)), args.grid),
        "critical": (reduced(1, 2.0, (2.0, 1.0), (1.0, 1.0)), 0),
        "triangle": (reduced(args.n, args.friction, (26.0, 7.5), (100.0, 82.0)), args.grid // 4),
    }
    found = {}
    for title, (contact, size) in problems.items():
        outcomes = {name: algorithm.run(contact) for name, algorithm in ALGORITHMS.items()}
        words = {name: end_of(contact, o) for name, o in outcomes.items()}
        found[title] = {
            "converged": {name: o.converged for name, o in outcomes.items()},
            "iterations": {name: o.iterations for name, o in outcomes.items()},
            "solution": words,
        }
        for name, o in outcomes.items():
            what = ENDS[words[name]]
            say(f"{title}, {name} from zero: {what} ({o.iterations}; {o.reason})")
        if size:
            axes, panels = basins(contact, size)
            found[title]["basins"] = {k: "".join(cells.ravel()) for k, cells in panels.items()}
            labels = ("$r_t$ of A at the start", "$r_n$ of A at the start")
            if comm.rank == 0:
                file = folder / f"basins_{title}.png"
                draw_maps(file, *axes, panels, ENDS, labels=labels)
    return io.write_summary(comm, folder, found["triangle"] | {"problems": found})


if __name__ == "__main__":
    main()
