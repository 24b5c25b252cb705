# SPDX-License-Identifier: LGPL-3.0-or-later
# # Which solution? The algorithms where there are several
#
# This demo illustrates how to:
#
# - take a contact problem on its contact points alone (`ContactProblem.reduced`), as numpy arrays;
# - run the classical algorithms on it from any start, and see in which solution each ends, or
#   what else it does;
# - see what each does at the critical friction coefficient.
#
# Two problems with three solutions: Hild's element with F = 3 under the traction (-2.4, -1) (its
# corner A opens, sticks or slips to the left), and the triangle of `demo_linear_triangle.py` with
# 64 contact nodes, F = 1.7, at gamma = 1 (the same three at A, all other nodes open).
#
# Starts are contact forces (rt, rn) at A, from a grid. Lemke's method knows no start.

from mpi4py import MPI

import numpy as np
from demo_linear_triangle import linear_triangle

from dolfinx_contact import output
from dolfinx_contact._errors import on_root
from dolfinx_contact.algorithms import (
    GaussSeidel,
    InteriorPoint,
    Lemke,
    Penalty,
    ProjectedGradient,
    SemismoothNewton,
    TrescaFixedPoint,
    Uzawa,
)
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.laws.status import letters

ALGORITHMS = {
    "newton": SemismoothNewton(),
    "tresca": TrescaFixedPoint(),
    "uzawa": Uzawa(max_iterations=4000),
    "penalty": Penalty(),
    "gauss-seidel": GaussSeidel(max_iterations=2000),
    "cg": ProjectedGradient(max_iterations=2000),
    "lemke": Lemke(),
    "interior-point": InteriorPoint(),
}
NAMES = {
    "o": "A opens",
    "k": "A sticks",
    "-": "A slips to the left",
    "+": "A slips to the right",
    "c": "a cycle",
    "d": "diverges",
    "n": "does not converge",
}


# ## Where an algorithm ends
#
# The status of A in the solution, or what else happened.


def end_of(algorithm, contact, start=None):
    outcome = algorithm.run(contact, start=start)
    if outcome.converged:
        return str(letters(2)[contact.statuses(outcome.a, outcome.r)[0]]), outcome
    kinds = {"cycle": "c", "diverges": "d", "not finite": "d"}
    return next((k for word, k in kinds.items() if word in outcome.reason), "n"), outcome


def basins(contact, size):
    """Axes of a grid of starts, and by algorithm the word of each."""
    largest = 1.5 * float(np.abs(contact.p).max() * np.sqrt(contact.number))
    rt, rn = np.linspace(-largest, largest, size), np.linspace(0.0, largest, size)
    panels = {}
    for name, algorithm in ALGORITHMS.items():
        cells = np.full((size, size), "n")
        if name == "lemke":
            cells[:] = end_of(algorithm, contact)[0]
        else:
            for i, j in np.ndindex(size, size):
                start = np.zeros((contact.number, 2))
                start[0] = rt[i], rn[j]
                cells[i, j] = end_of(algorithm, contact, start)[0]
        panels[name] = cells
    return (rt, rn), panels


# ## The critical friction
#
# At F = (lambda + 3 mu)/(lambda + mu) the element has a continuum of solutions under the traction
# (-2 F, -2)/2: every slip between stick and separation. What does each algorithm make of it?


def report(problems, grid, folder):
    """All of it, on one rank."""
    summary = {}
    for title, contact, size in problems:
        found = {name: end_of(algorithm, contact) for name, algorithm in ALGORITHMS.items()}
        summary[title] = {
            "converged": {name: o.converged for name, (_, o) in found.items()},
            "iterations": {name: o.iterations for name, (_, o) in found.items()},
            "solution": {name: word for name, (word, _) in found.items()},
            "reason": {name: o.reason for name, (_, o) in found.items()},
        }
        if size and grid:
            axes, panels = basins(contact, min(size, grid))
            summary[title]["basins"] = {
                name: {str(w): int(np.sum(cells == w)) for w in np.unique(cells)}
                for name, cells in panels.items()
            }
            file = folder / f"basins_{title.replace(' ', '_')}.png"
            labels = ("$r_t$ of A at the start", "$r_n$ of A at the start")
            output.draw_panels(file, *axes, panels, NAMES, labels=labels)
    return summary


def reduced(n, friction, load, lame, gamma):
    system = linear_triangle(n, friction, load, lame, comm=MPI.COMM_SELF)
    system.constant.value = gamma
    return system.problem.reduced()


def main(argv=None):
    parser = ScriptParser("Which solution?", output="output/which_solution", n=64)
    parser.add_argument("--grid", type=number(int, least=0), default=24, help="starts on its edge")
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    hild, seed = (1.0, 1.0), (100.0, 82.0)

    def everything():
        element = reduced(1, 3.0, (2.4, 1.0), hild, 1.0)
        critical = reduced(1, 2.0, (2.0, 1.0), hild, 1.0)
        triangle = reduced(args.n, 1.7, (26.0, 7.5), seed, 1.0)
        problems = [("element", element, 40), ("critical", critical, 0), ("triangle", triangle, 12)]
        return report(problems, args.grid, folder)

    found = on_root(comm, everything)
    for title, what in found.items():
        say(f"{title}, from zero:")
        for name in ALGORITHMS:
            ended = NAMES[what["solution"][name]]
            say(f"   {name}: {ended} ({what['iterations'][name]}; {what['reason'][name]})")
    triangle = {k: found["triangle"][k] for k in ("converged", "iterations", "solution")}
    return output.write_summary(comm, folder, triangle | {"problems": found})


if __name__ == "__main__":
    main()
