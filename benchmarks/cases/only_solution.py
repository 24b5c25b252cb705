# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction up to which a regularised law has one solution.

Reference: the bound of the theorem.

With a smooth law of a width eps in place of Coulomb's threshold (`regularised.py`) the
contact problem is proved to have one solution for friction below C eps^2/|log h|, h the size of
the cells. The triangle tells what becomes of that on meshes: from the solution in which its
corner A creeps the coefficient falls, until a fold; below it A only lifts off. The fold neither
falls like eps^2 nor with the mesh: it is near that of the true law, for which no such bound is
known.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _triangle import linear_triangle, true_solutions

from dolfinx import fem

from dolfinx_contact import Coulomb, ParametricContact, Regularised, io, plot
from dolfinx_contact.continuation import follow


def arguments(argv=None):
    parser = ScriptParser("The only solution", output="output/only_solution", n=16, friction=2.0)
    parser.add_argument("--width", type=number(above=0), default=1e-4, help="eps, small")
    parser.add_argument("--shape", choices=["tanh", "sqrt", "polynomial"], default="tanh")
    return parser.parse(argv)


# The smooth problem, with F as the parameter.
#
# Newton's method begins at the true solution in which A sticks. In the smooth one it creeps.


def creeping(args, n, width):
    true, ends = true_solutions(n, args.friction)
    stuck = next(point for point in ends if true.letters(point.piece)[0] == "k")
    true.result_at(stuck)
    given = []

    def law(domain):
        F = fem.Constant(domain, args.friction)
        given.append(F)
        eps = fem.Constant(domain, width)
        return Regularised(Coulomb(F), eps, args.shape)

    loaded = linear_triangle(n, args.friction, law=law)
    loaded.set_parameter(1.0)
    problem = loaded.problem
    problem.u.x.array[:] = true.problem.u.x.array
    force = problem.surfaces[0].multiplier
    true_force = true.problem.surfaces[0].multiplier
    force.x.array[:] = true_force.x.array
    problem.solve()
    system = ParametricContact(problem, given[0])
    x = system.create_vector()
    problem.write(x)
    return system, x


# One mesh, one width.
#
# A branch in F at a held eps, from the creeping solution downwards.


def only_up_to(args, n, width):
    """The friction coefficient of the fold; None if the branch has none."""
    system, x = creeping(args, n, width)
    reach = (0.1, 1.1 * args.friction)
    way = follow(system, x, args.friction, gamma_range=reach, direction="decreasing")
    return way.folds[0].gamma if way.folds else None


# Two meshes, two widths.


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
