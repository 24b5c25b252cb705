# SPDX-License-Identifier: LGPL-3.0-or-later
"""All solutions of one element, diagram of loads.

Reference: Hild, Proposition 2. `demos/demo_hild_triangle.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _plots import draw_maps
from _triangle import element

from dolfinx_contact import io, plot, records
from dolfinx_contact.continuation import Branch, find_solutions
from dolfinx_contact.records import leftmost

#: Outputs; A is the leftmost contact point.
FUNCTIONALS = {name: leftmost(name) for name in ("ut", "un", "rt", "rn")}


def critical_friction(lame):
    """The coefficient beyond which there are loads with three solutions."""
    return (lame[0] + 3 * lame[1]) / (lame[0] + lame[1])


def solutions(system, gamma=1.0):
    """All solutions at gamma, in the order o, k, +, -; a continuum with its two ends."""
    start = system.create_vector()
    found = find_solutions(system, [start], gamma)

    def named(these):
        points = found.points(system, these)
        journal = records.journal_of(system, [Branch(points)], FUNCTIONALS)
        names = ("status", *FUNCTIONALS)
        return [{name: row[name] for name in names} for row in journal.rows()]

    ends = [id(s) for c in found.continua for s in c.ends]
    isolated = [s for s in found.found if id(s) not in ends]
    states = named(isolated)
    for continuum in found.continua:
        status = system.letters(continuum.piece)[0]
        both = named(continuum.ends)
        both.sort(key=lambda end: -end["rn"])
        for end in both:
            end["status"] = status
        states.append({"status": status, "continuum": True, "ends": both})
    states.sort(key=lambda state: "ok+-".index(state["status"]))
    return states


WORDS = {"o": "separation", "k": "stick", "+": "slip right", "-": "slip left", "~": "a continuum"}
SETS = ("o", "k", "+", "-", "ok-", "ok", "k-", "-~")
NAMES = {letters: ", ".join(WORDS[c] for c in letters) for letters in SETS}


def border_rays(lame, friction):
    """Points of the border lines, one on each side of the origin."""
    rays = []
    for slope in {friction, critical_friction(lame)}:
        for f1 in (-slope, slope):
            rays.append((f1, -1))
            rays.append((f1, 1))
    for f2 in (-friction, friction):
        rays.append((-1, f2))
        rays.append((1, f2))
    return rays


def diagram(lame, friction, length, size):
    """Axes of a grid of loads, the statuses at each load, and those on the border lines."""
    # No load of the grid lies on a border: the axes are shifted, each by its own part of a cell.
    cells = np.arange(size)
    f1 = 6 * (cells + 0.5317) / size - 3
    f2 = 6 * (cells + 0.4829) / size - 3
    up = element(lame, friction, length, (1, 0), (0.0, 1.0))
    down = element(lame, friction, length, (1, 0), (0.0, -1.0))

    sets = np.full((size, size), "")
    affine = up.condensed(up.create_vector(), 0.0).system
    for code, letter in enumerate("ok+-"):
        status = np.array([code], dtype=np.int8)
        piece = affine.piece(status)
        if piece is None:  # a singular one holds solutions on a line alone
            continue
        slacks = [affine.slacks(status, w)[0] for w in piece.coefficients]
        s_0, s_1 = (np.where(np.isfinite(s), s, 0.0) for s in slacks)  # inf: no inequality
        slack = f1[:, None, None] * s_1 + f2[:, None] * s_0
        holds = (slack >= 0).all(axis=2)
        sets = np.char.add(sets, np.where(holds, letter, ""))

    lines = []
    for a, b in border_rays(lame, friction):
        system = up if b > 0 else down
        word = ""
        for solution in solutions(system, a / abs(b)):
            word += solution["status"]
            if "continuum" in solution:
                word += "~"
        lines.append(((a, b), word))
    return (f1, f2), sets, lines


def draw_diagrams(args, folder, comm):
    """Draw the three regimes and return their statuses."""
    critical = critical_friction(args.lame)
    regimes = {"below": 0.5 * critical, "at": critical, "above": 1.5 * critical}
    shown = {}
    for name, friction in regimes.items():
        axes, sets, lines = diagram(args.lame, friction, args.length, args.grid)
        if comm.rank == 0:
            # Only lines with a set of their own are drawn.
            own = []
            for (a, b), word in lines:
                if word not in sets:
                    own.append((([0, 3 * a], [0, 3 * b]), word))
            maps = {f"F = {friction:.4g}, {name} critical": sets}
            labels = ("$F_1$", "$F_2$")
            picture = folder / f"regions_{name}_critical.png"
            draw_maps(picture, *axes, maps, NAMES, lines=own, labels=labels)
        cells = {str(word): int(np.sum(sets == word)) for word in np.unique(sets)}
        rays = [{"load": list(ray), "solutions": word} for ray, word in lines]
        shown[name] = {"friction": friction, "cells": cells, "lines": rays}
    return shown


def main(argv=None):
    given = dict(lame=(1.0, 1.0), friction=3.0, load=(-2.4, -1.0), length=1.0)
    parser = ScriptParser("Hild's element", output="output/hild_triangle", **given)
    parser.add_argument("--diagram", action="store_true", help="draw the regions of loads")
    edge = number(int, least=2)
    parser.add_argument("--grid", type=edge, default=160, help="loads on its edge")
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)

    system = element(args.lame, args.friction, args.length, args.load)
    found = solutions(system)
    critical = critical_friction(args.lame)
    lines = [f"F = {args.friction:g} (critical: {critical:g}):"]
    lines += [str(solution) for solution in found]
    say("\n   ".join(lines))

    x = system.create_vector()
    points = find_solutions(system, [x], 1.0).points(system)
    if points and comm.rank == 0:
        plot.picture_of_states(folder / "states.png", system, points)
    summary = {
        "converged": bool(found),
        "solutions": found,
        "dofs": x.getSize(),
        "critical_friction": critical,
    }
    if args.diagram:
        summary["diagram"] = draw_diagrams(args, folder, comm)
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
