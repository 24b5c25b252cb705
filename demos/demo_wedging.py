# SPDX-License-Identifier: LGPL-3.0-or-later
# # Wedged: friction that holds a body without any load
#
# This demo illustrates how to:
#
# - compute the smallest friction with which a body that was loaded and unloaded may stay wedged,
#   with a proof that there is no smaller one (`wedging_friction`);
# - compare it with the critical friction of sliding states, and with the friction up to which a
#   solution is certainly the only one;
# - see a body stay wedged, or not, by a history of loading and unloading.
#
# Kim, Jang and Barber (2019): a state of forces and displacements without load, in which every
# point is off the floor, or touches it with a force in its friction cone. The direction of the
# shear is free: what happened before decides it. Everything is homogeneous, so that neither a load
# nor its history enters. On a coarse mesh of the triangle (`_triangle`) the coefficient is that of
# the first continuum of sliding states; it lies below from four contact nodes on, where points in
# the middle lift off.

from mpi4py import MPI

import numpy as np
from _case import ScriptParser
from _triangle import linear_triangle

from dolfinx_contact import io, plot
from dolfinx_contact.analysis import critical_friction, renard_criterion, wedging_friction
from dolfinx_contact.evolution import QuasiStatic

LOAD = (-98.5, -17.4)  # a traction that wedges the triangle as it goes
SHARES = (0.95, 1.1, 1.3)  # of the smallest friction that wedges: coefficients of histories


def arguments(argv=None):
    parser = ScriptParser("Wedged", output="output/wedging", n=8, lame=(100.0, 82.0))
    return parser.parse(argv)


# ## The coefficient, and others beside it
#
# That of sliding states: a slip of all points that changes nothing. Renard's: up to which a
# solution that slips to the right everywhere is certainly the only one.


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


# ## Loaded and unloaded
#
# With memory the friction law is about the increments of slip. The traction grows from nothing and
# falls to nothing again; what is left of the normal force is what wedges the body.


def left_after_unloading(n, lame, friction):
    """The largest normal force under the load, and after it. Collective."""
    system = linear_triangle(n, friction, LOAD, lame)
    problem = system.problem
    times = np.linspace(0.0, 2.0, 9)
    moved = QuasiStatic(problem, lambda t: system.set_parameter(min(t, 2.0 - t)))
    forces = []
    for step in moved.run(times).steps:
        (force,) = step.result.resultants.values()
        forces.append(float(force[1]))
    return max(forces), forces[-1]


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

    few = min(args.n, 8)
    smallest = levels[meshes.index(few)][0].friction if few in meshes else found.friction
    histories = []
    for share in SHARES:
        most, rest = left_after_unloading(few, args.lame, share * smallest)
        histories.append({"friction": share * smallest, "loaded": most, "unloaded": rest})
        say(f"F = {share:g} of it, n = {few}: normal force {most:.6g}, after unloading {rest:.6g}")

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
        "histories": histories,
    }
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
