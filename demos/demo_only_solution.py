# SPDX-License-Identifier: LGPL-3.0-or-later
# # Where regularised friction has one solution
#
# This demo illustrates how to:
#
# - follow a solution in the friction coefficient, for a law of your choice;
# - read from its fold up to which coefficient it is the only one.
#
# With a smooth law of a width eps in place of Coulomb's threshold (`demo_regularised.py`) the
# contact problem is proved to have one solution for friction below C eps^2/|log h|, h the size of
# the cells. The triangle tells what becomes of that on meshes: from the solution in which its
# corner A creeps the coefficient falls, until a fold; below it A only lifts off. The fold neither
# falls like eps^2 nor with the mesh: it is near that of the true law, for which no such bound is
# known.

from mpi4py import MPI

import numpy as np
from demo_regularised import arguments, creeping

from dolfinx_contact import io, plot
from dolfinx_contact.continuation import follow

# ## One mesh, one width
#
# A branch in F at a held eps, from the creeping solution downwards.


def only_up_to(args, n, width):
    """The friction coefficient of the fold; None if the branch has none."""
    system, x, _, _ = creeping(args, n, "F", width)
    reach = (0.1, 1.1 * args.friction)
    way = follow(system, x, args.friction, gamma_range=reach, direction="decreasing")
    return way.folds[0].gamma if way.folds else None


# ## Two meshes, two widths


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    widths = [args.width, 10 * args.width]
    folds = {}
    bounds = {}
    curves = {}
    for n in (args.n // 2, args.n):
        found = [only_up_to(args, n, width) for width in widths]
        for width, friction in zip(widths, found, strict=True):
            case = f"n = {n}, eps = {width:g}"
            folds[case] = friction
            bounds[case] = width**2 / abs(np.log(1.0 / n))
            say(f"{case}: the only solution up to F = {friction}")
            say(f"  eps^2/|log h| = {bounds[case]:.3g}")
        curves[f"n = {n}"] = (widths, [np.nan if f is None else f for f in found])
    if comm.rank == 0:
        labels = (r"$\varepsilon$", "friction of the fold")
        plot.draw_curves(folder / "fold.png", curves, labels=labels)
    return io.write_summary(comm, folder, {"critical_friction": folds, "bound": bounds})


if __name__ == "__main__":
    main()
