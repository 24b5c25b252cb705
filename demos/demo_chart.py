# SPDX-License-Identifier: LGPL-3.0-or-later
# # How many solutions, over the load and the friction coefficient
#
# This demo illustrates how to:
#
# - follow the folds of branches as the friction coefficient F varies too: curves in (F, gamma),
#   with the statuses along them, and the points at which they meet and end;
# - count the solutions between them, with proofs, in a chart whose cells are fine at the borders;
#   cells whose proof takes longer than `--seconds` are hatched.
#
# Without a mesh the body is Hild's triangle (see `demo_hild_triangle.py`) with lambda = mu = 1, of
# which one node moves, under the nodal force (-gamma, -1). Its folds lie at gamma = F, where stick
# ends, and at gamma = kt/k = 2, where the pressure vanishes. The two lines cross at the critical
# coefficient F = 2: below it the solution is unique. With a mesh it is a body as in
# `demo_followed_mesh.py`, under the body force (1 - gamma) (FX, FY) + gamma (GX, GY).
#
# A linear body is condensed onto its contact points, once. In that problem F multiplies the
# pressures of slipping points, so that along a fold gamma is a rational function of F until another
# point changes its status. Where it does is found exactly: there are no steps in F.

from mpi4py import MPI

import demo_followed_mesh
from demo_hild_triangle import element

from dolfinx_contact import output
from dolfinx_contact.analysis import contact_family, count_solutions, event_curves
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.continuation import follow


def arguments(argv=None):
    parser = ScriptParser("Numbers of solutions", output="output/chart", mesh=None, lame=None)
    force = dict(type=number(), nargs=4, metavar=("FX", "FY", "GX", "GY"))
    parser.add_argument("--body-force", default=(0.0, -6.0, -14.0, -6.0), **force)
    span = dict(type=number(above=0), nargs=2, metavar=("F0", "F1"), default=(1.0, 4.0))
    parser.add_argument("--friction", **span, help="least and largest coefficient")
    coefficients = dict(type=number(above=0), nargs="*", default=[])
    parser.add_argument("--at", **coefficients, help="list the folds at these coefficients")
    parser.add_argument("--cells", type=number(int, above=0), default=5, help="along an edge")
    parser.add_argument("--depth", type=number(int, least=0), default=2, help="of their division")
    parser.add_argument("--seconds", type=number(above=0), default=1.0, help="for a proof")
    args = parser.parse(argv)
    if not args.friction[0] < args.friction[1]:
        parser.error("--friction needs F0 < F1")
    if not all(args.friction[0] <= F <= args.friction[1] for F in args.at):
        parser.error("--at must lie in the range of --friction")
    return args


def problem(args):
    """The problem with gamma, and the range of that."""
    last = args.friction[1]
    if args.mesh is None:
        lame = args.lame or (1.0, 1.0)
        return element(lame, last, 1.0, (-2.0, 0.0), (0.0, -2.0)), (0.0, 1.2 * last)
    words = ["--mesh", args.mesh, "--friction", last, "--lame", *(args.lame or (100.0, 82.0))]
    words += ["--body-force", *args.body_force]
    options = demo_followed_mesh.arguments([str(word) for word in words])
    return demo_followed_mesh.system(options, MPI.COMM_WORLD), (0.0, 1.0)


# ## Branches at some coefficients, and the curves that pass through their folds
#
# The second parameter is the Constant in the friction law. A fold that no branch has met is not
# followed, so that branches at both ends of the range, and at `--at`, are better than one.


def curves_of(system, friction, span, gammas, coefficients):
    branches, iterations = [], 0
    for F in sorted({*span, *coefficients}, reverse=True):
        friction.value = F
        system.set_parameter(gammas[0])
        iterations += system.problem.solve().iterations
        x = system.create_vector()
        system.problem.write(x)
        branches.append((F, follow(system, x, gammas[0], gamma_range=gammas)))
    return event_curves(system, friction, branches, span, gammas), iterations


def main(argv=None):
    args = arguments(argv)
    comm, say = MPI.COMM_WORLD, output.Report(MPI.COMM_WORLD)
    folder, span = output.output_folder(comm, args.output), tuple(args.friction)
    system, gammas = problem(args)
    (surface,) = system.problem.surfaces
    friction = surface.law.friction
    curves, iterations = curves_of(system, friction, span, gammas, args.at)
    for curve in curves.folds:
        first, last = curve.span
        say(f"folds from F = {first:.10f} to {last:.10f}, gamma = {curve.at(last):.10f}")
        for s in curve.segments:
            say(f"   F = {s.low:.8f} to {s.high:.8f}: {' | '.join(s.statuses)}")
    say("\n".join(f"they meet at F = {F:.10f}, gamma = {gamma:.10f}" for F, gamma in curves.cusps))
    folds_at = {f"{F:g}": curves.folds_at(F) for F in args.at}
    say("\n".join(f"F = {F}: folds at {gammas}" for F, gammas in folds_at.items()))

    # ## Count between the curves
    family = contact_family(system, friction, span)
    grid = dict(cells=(args.cells, args.cells), depth=args.depth, seconds=args.seconds)
    chart = count_solutions(system.comm, family, span, gammas, curves=curves, **grid)
    if comm.rank == 0:
        labels = dict(labels=("friction coefficient F", r"load $\gamma$"))
        output.draw_chart(folder / "chart.png", chart, curves, **labels)
    named = [{"kind": c.kind, "points": c.points().tolist()} for c in curves.curves]
    cells = [[*c.middle, c.count, c.proved] for c in chart.cells]
    summary = {"converged": True, "newton_iterations": iterations, "proved": chart.proved}
    summary |= {"dofs": system.create_vector().getSize(), "curves": named, "cells": cells}
    summary |= {"cusps": [list(cusp) for cusp in curves.cusps], "folds_at": folds_at}
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
