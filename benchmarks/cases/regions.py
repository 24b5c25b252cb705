# SPDX-License-Identifier: LGPL-3.0-or-later
"""Regions of loads with equal solutions.

Reference: Hild, Proposition 2.

The body is Hild's triangle (see `hild_triangle.py`), or one of more elements (`--n`), under
a traction (F1, F2) on its vertical side. With one element the pictures are figures 2 to 4 of
P. Hild, *On finite element uniqueness studies for Coulomb's frictional contact model*, Int. J.
Appl. Math. Comput. Sci. 12 (2002) 41-50, whose Proposition 2 lists the solutions in closed form:
below the critical friction coefficient (lambda + 3 mu)/(lambda + mu) the four regions of
separation, stick and slip to the right and to the left fill the plane; above it those of
separation and stick overlap, and there slip to the left is a third solution. At it two curves
coincide, and between them is a continuum.

A body without load and gap has the solution zero, and multiples of solutions are solutions: all
curves are straight, and end at F1 = F2 = 0.
"""

from mpi4py import MPI

from _case import ScriptParser, number
from _triangle import linear_triangle

import ufl
from dolfinx import fem

from dolfinx_contact import io, plot
from dolfinx_contact.analysis import contact_family, event_curves, solution_regions
from dolfinx_contact.continuation import follow

WORDS = {"o": "separation", "k": "stick", "+": "slip right", "-": "slip left"}
SETS = [("o",), ("k",), ("+",), ("-",), ("-", "k", "o")]
NAMES = {s: ", ".join(WORDS[letter] for letter in reversed(s)) for s in SETS}

# The body with two parameters.
#
# F2 is that of the branches, F1 a Constant beside it.


def loaded(n, friction, lame, length):
    """The problem with the parameter F2, and F1."""
    found = []

    def first(domain):
        other = fem.Constant(domain, 1.0)
        found.append(other)
        return ufl.as_vector([other, 0.0])

    system = linear_triangle(n, friction, (0.0, -1.0), lame, length, preload=first)
    return system, found[0]


# The curves.
#
# A branch that is followed through all F2, once for either sign of a small F1, meets the borders;
# from its events the curves are followed exactly, in both parameters. A border that neither branch
# meets, nor one of their curves, would be missing; `explained` tells whether the regions beside
# every curve differ as its statuses say.


def curves_of(system, other, size):
    branches = []
    iterations = 0
    span = (-size, size)
    for value in (-size / 10, size / 10):
        other.value = value
        system.set_parameter(-size)
        result = system.problem.solve()
        iterations += result.iterations
        x = system.create_vector()
        system.problem.write(x)
        branch = follow(system, x, -size, gamma_range=span)
        branches.append((value, branch))
    curves = event_curves(
        system, other, branches, mu_range=span, gamma_range=span, folds_only=False
    )
    return curves, iterations


def record_of(friction, curves, regions):
    """Return the entry of the summary for one friction coefficient."""
    lines = []
    for curve in curves.curves:
        statuses = curve.segments[0].statuses
        points = curve.points().tolist()
        lines.append({"kind": curve.kind, "statuses": statuses, "points": points})
    cells = []
    for cell in regions.cells:
        row = {"load": cell.middle, "solutions": cell.solutions, "proved": cell.proved}
        cells.append(row)
    return {
        "friction": friction,
        "proved": regions.proved,
        "explained": regions.explained,
        "curves": lines,
        "cells": cells,
    }


def main(argv=None):
    given = dict(n=1, lame=(1.0, 1.0), length=1.0)
    parser = ScriptParser("Regions of loads", output="output/regions", **given)
    parser.add_argument("--size", type=number(above=0), default=3.0, help="largest F1 and F2")
    parser.add_argument("--seconds", type=number(above=0), default=5.0, help="for a proof")
    several = dict(type=number(above=0), nargs="*", default=[0.5, 1.0, 1.5])
    parser.add_argument("--over-critical", **several, help="friction over the critical coefficient")
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    say = io.Report(comm)
    folder = io.output_folder(comm, args.output)
    span = (-args.size, args.size)
    lmbda, mu = args.lame
    summary = {"converged": True, "newton_iterations": 0, "regions": []}
    for part in args.over_critical:
        F = part * (lmbda + 3 * mu) / (lmbda + mu)
        system, other = loaded(args.n, F, args.lame, args.length)
        curves, iterations = curves_of(system, other, args.size)
        family = contact_family(system, other, mu_range=span)
        regions = solution_regions(
            family, curves, mu_range=span, gamma_range=span, proof_seconds=args.seconds
        )
        sets = {cell.solutions for cell in regions.cells}
        words = [", ".join(solutions) for solutions in sorted(sets, key=len)]
        proved = f"proved {regions.proved}, curves explain all changes {regions.explained}"
        say(f"F = {F:g}: {len(curves.curves)} curves; {proved}; solutions of the regions:")
        say("   " + "; ".join(words))
        if comm.rank == 0:
            file = folder / f"regions_{part:g}.png"
            names = NAMES if args.n == 1 else None
            look = dict(labels=("$F_1$", "$F_2$"), title=f"F = {F:.4g}")
            plot.draw_chart(file, regions, curves, names, **look)
        summary["regions"].append(record_of(F, curves, regions))
        summary["newton_iterations"] += iterations
        summary["dofs"] = system.create_vector().getSize()
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
