# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wedging coefficients and branches.

Reference: exact problems. `demos/demo_wedging.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser
from _triangle import linear_triangle

from dolfinx_contact import io, plot
from dolfinx_contact.analysis import critical_friction, renard_criterion, wedging_friction
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength

LOAD = (-98.5, -17.4)  # a traction that wedges the triangle as it goes
SHARES = (0.99, 1.01, 1.3)  # of the smallest friction that wedges: coefficients of branches
#: Loaded, unloaded, loaded again, unloaded and pulled: directions, and where they end below.
WAYS = (("increasing", 0.0), ("back", 0.0), ("back", 0.0), ("back", -1.0))
NEAR = 0.02  # of loads in the picture of the branches without load
NONE = 1e-9  # of the force under the load, a force that is none


def arguments(argv=None):
    parser = ScriptParser("Wedged", output="output/wedging", n=8, lame=(100.0, 82.0))
    return parser.parse(argv)


def level(n, lame):
    problem = linear_triangle(n, 1.0, lame=lame).problem
    found = wedging_friction(problem)
    sliding = critical_friction(problem).friction
    renard = renard_criterion(problem, lambda x: np.tile([1.0, 0.0], (len(x), 1))).friction
    return found, abs(sliding) if sliding else np.nan, renard


def draw_state(file, found):
    """Gap, slip and forces of the wedged state along the edge, from the corner."""
    ut, un, rt, rn = found.state.T
    x = np.arange(len(un)) / len(un)
    curves = {
        "gap over its largest": (x, un / (np.abs(un).max() or 1.0)),
        "slip over its largest": (x, ut / (np.abs(ut).max() or 1.0)),
        "normal force": (x, rn),
        "shear over F": (x, rt / found.friction),
    }
    plot.draw_curves(file, curves, labels=("x", f"F = {found.friction:.6g}"))


def ways_of(n, lame, friction):
    """Of every way its points: load, normal force and shear (k, 3). Collective."""
    system = linear_triangle(n, friction, LOAD, lame)
    system.set_parameter(0.0)
    path = ArcLength(system)
    control = StepControl(kinks="exact", initial=0.5, maximum=0.5)
    ways = []
    for direction, least in WAYS:
        way = path.run(gamma_range=(least, 1.0), direction=direction, control=control)
        forces = [next(iter(step.result.resultants.values())) for step in way.steps]
        rows = [(step.gamma, y, x) for step, (x, y) in zip(way.steps, forces, strict=True)]
        ways.append(np.array(rows, dtype=float))
        if ways[-1][-1, 1] <= NONE * ways[0][-1, 1]:
            break  # off the floor
    return ways


def described(friction, ways):
    """Return the force without load, the load that frees the body, and their final ratio."""
    loaded = ways[0][-1, 1]
    last = ways[-1][ways[-1][:, 1] > NONE * loaded]
    return {
        "friction": friction,
        "loaded": loaded,
        "unloaded": [ways[1][-1, 1], ways[1][-1, 2]],
        "pulled": min(float(last[:, 0].min()), 0.0),
        "load_over_force": float(last[-1, 0] / last[-1, 1]),
    }


def draw_ways(folder, paths):
    """Normal force against load: unloaded, loaded again and pulled, and the same near no load."""
    curves = {}
    near = {}
    for share, ways in paths.items():
        name = f"F = {share:g} of it"
        every = np.concatenate(ways)
        last = ways[-1][np.abs(ways[-1][:, 0]) < NEAR]
        curves[name] = (every[:, 0], every[:, 1])
        if abs(share - 1) < NEAR:
            near[name] = (last[:, 0], last[:, 1])
    labels = ("load", "normal force")
    plot.draw_curves(folder / "branches.png", curves, labels=labels)
    plot.draw_curves(folder / "branches_without_load.png", near, labels=labels)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    meshes = [n for n in (1, 2, 4, 8, 16) if n < args.n] + [args.n]
    levels = [level(n, args.lame) for n in meshes]
    for n, (found, sliding, renard) in zip(meshes, levels, strict=True):
        say(f"n = {n}: {found}; sliding {sliding:.8g}, Renard {renard:.6g}")
    found = levels[-1][0]

    few, (of_few, _, _) = [row for row in zip(meshes, levels, strict=True) if row[0] <= 8][-1]
    paths = {share: ways_of(few, args.lame, share * of_few.friction) for share in SHARES}
    branches = [described(share * of_few.friction, ways) for share, ways in paths.items()]
    for share, branch in zip(SHARES, branches, strict=True):
        left, pulled = branch["unloaded"][0], branch["pulled"]
        words = f"free below a load of {pulled:.6g}" if pulled < 0 else "free without load"
        say(f"F = {share:g} of it, n = {few}: unloaded, normal force {left:.6g}; {words}")

    if comm.rank == 0:
        draw_state(folder / "state.png", found)
        h = [1.0 / n for n in meshes]
        curves = {
            "wedged": (h, [row[0].friction for row in levels]),
            "sliding in continua": (h, [row[1] for row in levels]),
            "one solution (Renard)": (h, [row[2] for row in levels]),
        }
        labels = ("size of cells h", "friction coefficient")
        plot.draw_curves(folder / "coefficients.png", curves, labels=labels)
        draw_ways(folder, paths)
    summary = {
        "wedging": found.friction,
        "lower": found.lower,
        "complete": found.complete,
        "seconds": found.seconds,
        "statuses": found.statuses,
        "levels": [
            {"n": n, "wedging": row[0].friction, "sliding": row[1], "renard": row[2]}
            for n, row in zip(meshes, levels, strict=True)
        ],
        "branches": branches,
    }
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
