# SPDX-License-Identifier: LGPL-3.0-or-later
# # All solutions of one element: Hild's triangle
#
# This demo illustrates how to:
#
# - find **all** solutions of a problem with few contact points, and know that there are no others;
# - see where a problem has one, two, three or infinitely many solutions.
#
# P. Hild, *On finite element uniqueness studies for Coulomb's frictional contact model*, Int. J.
# Appl. Math. Comput. Sci. 12 (2002) 41-50, section 4: the triangle A = (0, 0), B = (l, 0),
# C = (0, l), one linear element, clamped on BC, in contact on AB, under a traction (F1, F2) on AC.
# Only A moves. Beyond the critical friction coefficient (lambda + 3 mu)/(lambda + mu) there are
# loads with three solutions: open, stuck, and slipping to the left; at it, there is a continuum.

from mpi4py import MPI

import numpy as np
from demo_linear_triangle import linear_triangle

from dolfinx_contact import output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.continuation import Branch, find_solutions
from dolfinx_contact.output import leftmost

#: What is looked at: A is the leftmost contact point.
SEEN = {name: leftmost(name) for name in ("ut", "un", "rt", "rn")}

# ## All solutions at a load
#
# Only A can change its status, so that there are four pieces. `find_solutions` looks at all of them
# and finds the ends of continua too. The element is so small that every rank solves it alone.


def element(lame, friction, length, load, preload=(0.0, 0.0)):
    """The triangle under the traction preload + gamma load."""
    minus = -np.array(load, dtype=float)
    return linear_triangle(1, friction, minus, lame, length, preload=preload, comm=MPI.COMM_SELF)


def solutions(system, gamma=1.0):
    """All solutions at gamma, in the order o, k, +, -; a continuum with its two ends."""
    found = find_solutions(system, [system.create_vector()], gamma)

    def named(these):
        rows = output.journal_of(system, [Branch(found.points(system, these))], SEEN).rows()
        return [{k: s[k] for k in ("status", *SEEN)} for s in rows]

    ends = [id(s) for c in found.continua for s in c.ends]
    records = named([s for s in found.found if id(s) not in ends])
    for c in found.continua:
        status = {"status": system.letters(c.piece)[0]}
        both = sorted(named(c.ends), key=lambda s: -s["rn"])
        records.append({**status, "continuum": True, "ends": [s | status for s in both]})
    return sorted(records, key=lambda s: "ok+-".index(s["status"]))


# ## The diagram of Proposition 2
#
# One picture per regime of friction (below, at and above the critical coefficient), as figures 2 to
# 4 of the paper. On every piece the state is linear in the load, so that its inequalities tell at
# which loads of a grid it holds a solution. The borders between the regions are lines through the
# origin, and two of them carry sets of their own: there `solutions` is asked.

WORDS = {"o": "separation", "k": "stick", "+": "slip right", "-": "slip left", "~": "a continuum"}
NAMES = {w: ", ".join(WORDS[c] for c in w) for w in ("o", "k", "+", "-", "ok-", "ok", "k-", "-~")}


def diagram(lame, friction, length, size):
    """Axes of a grid of loads, the statuses at each load, and those on the border lines."""
    # No load of the grid lies on a border: the axes are shifted, each by its own part of a cell.
    f1, f2 = (6 * (np.arange(size) + shift) / size - 3 for shift in (0.5317, 0.4829))
    up, down = (element(lame, friction, length, (1, 0), (0.0, sign)) for sign in (1.0, -1.0))
    sets, affine = np.full((size, size), ""), up.condensed(up.create_vector(), 0.0).system
    for code, letter in enumerate("ok+-"):
        piece = affine.piece(np.array([code], dtype=np.int8))
        if piece is not None:  # a singular one holds solutions on a line alone
            (s_0,), (s_1,) = piece.slack_coefficients  # s_0 is infinite where no inequality is
            slack = f1[:, None, None] * s_1 + f2[:, None] * np.where(np.isfinite(s_0), s_0, 0.0)
            sets = np.char.add(sets, np.where((slack >= 0).all(axis=2), letter, ""))
    critical = (lame[0] + 3 * lame[1]) / (lame[0] + lame[1])
    rays = [(s * m, sign) for m in {friction, critical} for s in (-1, 1) for sign in (-1, 1)]
    rays += [(sign, s * friction) for s in (-1, 1) for sign in (-1, 1)]
    found = [solutions(up if b > 0 else down, a / abs(b)) for a, b in rays]
    words = ["".join(s["status"] + "~" * ("continuum" in s) for s in these) for these in found]
    return (f1, f2), sets, list(zip(rays, words, strict=True))


def main(argv=None):
    given = dict(lame=(1.0, 1.0), friction=3.0, load=(-2.4, -1.0), length=1.0)
    parser = ScriptParser("Hild's element", output="output/hild_triangle", **given)
    parser.add_argument("--diagram", action="store_true", help="draw the regions of loads")
    parser.add_argument("--grid", type=number(int, least=2), default=160, help="loads on its edge")
    args = parser.parse(argv)
    comm, folder = MPI.COMM_WORLD, output.output_folder(MPI.COMM_WORLD, args.output)
    system = element(args.lame, args.friction, args.length, args.load)
    found = solutions(system)
    critical = (args.lame[0] + 3 * args.lame[1]) / (args.lame[0] + args.lame[1])
    lines = [f"F = {args.friction:g} (critical: {critical:g}):", *map(str, found)]
    output.Report(comm)("\n   ".join(lines))
    x = system.create_vector()
    points = find_solutions(system, [x], 1.0).points(system)
    if points and comm.rank == 0:
        output.picture_of_states(folder / "states.png", system, points)
    summary = {"converged": bool(found), "newton_iterations": 4, "solutions": found}
    summary |= {"dofs": x.getSize(), "critical_friction": critical}
    regimes = {"below": 0.5 * critical, "at": critical, "above": 1.5 * critical}
    for name, F in regimes.items() if args.diagram else ():
        axes, sets, lines = diagram(args.lame, F, args.length, args.grid)
        if comm.rank == 0:
            own = [(([0, 3 * a], [0, 3 * b]), word) for (a, b), word in lines if word not in sets]
            look = dict(lines=own, labels=("$F_1$", "$F_2$"), title=f"F = {F:.4g}, {name} critical")
            output.draw_regions(folder / f"regions_{name}_critical.png", *axes, sets, NAMES, **look)
        cells = {str(word): int(np.sum(sets == word)) for word in np.unique(sets)}
        lines = [{"load": list(ray), "solutions": word} for ray, word in lines]
        summary.setdefault("diagram", {})[name] = {"friction": F, "cells": cells, "lines": lines}
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
