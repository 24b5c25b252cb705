# SPDX-License-Identifier: LGPL-3.0-or-later
"""Folds over load and friction, of any mesh.

Reference: closed form. `demos/demo_chart.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _triangle import element

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
)
from dolfinx_contact.analysis import contact_family, count_solutions, event_curves
from dolfinx_contact.continuation import follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import read_mesh


def arguments(argv=None):
    parser = ScriptParser("Numbers of solutions", output="output/chart", mesh=None, lame=None)
    add = parser.add_argument
    positive = number(above=0)
    count = number(int, above=0)
    depth = number(int, least=0)
    forces = ("FX", "FY", "GX", "GY")
    add("--body-force", type=number(), nargs=4, metavar=forces, default=(0.0, -6.0, -14.0, -6.0))
    span = dict(type=positive, nargs=2, metavar=("F0", "F1"), default=(1.0, 4.0))
    add("--friction", **span, help="least and largest coefficient")
    listed = dict(type=positive, nargs="*", default=[])
    add("--at", **listed, help="list the folds at these coefficients")
    add("--cells", type=count, default=5, help="along an edge")
    add("--depth", type=depth, default=2, help="of their division")
    add("--seconds", type=positive, default=1.0, help="for a proof")
    args = parser.parse(argv)
    least, largest = args.friction
    if not least < largest:
        parser.error("--friction needs F0 < F1")
    if not all(least <= F <= largest for F in args.at):
        parser.error("--at must lie in the range of --friction")
    return args


def meshed(args):
    """A meshed body with the parameter gamma, held on `dirichlet`; `contact` is above the floor."""
    body = read_mesh(MPI.COMM_WORLD, args.mesh, dim=2, groups=("dirichlet", "contact"))
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, 0.0)
    first = fem.Constant(domain, np.array(args.body_force[:2]))
    last = fem.Constant(domain, np.array(args.body_force[2:]))
    force = (1 - gamma) * first + gamma * last
    material = LinearElastic(*(args.lame or (100.0, 82.0)))
    energy = material.energy(u) * ufl.dx - ufl.dot(force, u) * ufl.dx
    clamped = fem.dirichletbc(np.zeros(2), body.dofs(V, "dirichlet"), V)
    floor = HalfSpace((0.0, body.bounds("contact")[0, 1]), (0.0, 1.0))
    law = Coulomb(args.friction[1])
    surface = ContactSurface(u, body, tag="contact", obstacle=floor, law=law)
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=[clamped]), gamma)


def problem(args):
    """The problem with gamma, and the range of that."""
    if args.mesh is not None:
        return meshed(args), (0.0, 1.0)
    largest = args.friction[1]
    lame = args.lame or (1.0, 1.0)
    triangle = element(lame, largest, 1.0, (-2.0, 0.0), (0.0, -2.0))
    return triangle, (0.0, 1.2 * largest)


def curves_of(system, friction, span, gammas, coefficients):
    first = gammas[0]
    branches = []
    iterations = 0
    for F in sorted({*span, *coefficients}, reverse=True):
        friction.value = F
        system.set_parameter(first)
        result = system.problem.solve()
        iterations += result.iterations
        x = system.create_vector()
        system.problem.write(x)
        branch = follow(system, x, first, gamma_range=gammas)
        branches.append((F, branch))
    curves = event_curves(system, friction, branches, mu_range=span, gamma_range=gammas)
    return curves, iterations


def report(say, curves, folds_at):
    for curve in curves.folds:
        first, last = curve.span
        say(f"folds from F = {first:.10f} to {last:.10f}, gamma = {curve.at(last):.10f}")
        for s in curve.segments:
            statuses = " | ".join(s.statuses)
            say(f"   F = {s.low:.8f} to {s.high:.8f}: {statuses}")
    meetings = [f"they meet at F = {F:.10f}, gamma = {gamma:.10f}" for F, gamma in curves.cusps]
    say("\n".join(meetings))
    folds = [f"F = {F}: folds at {found}" for F, found in folds_at.items()]
    say("\n".join(folds))


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    say = io.Report(comm)
    folder = io.output_folder(comm, args.output)
    span = tuple(args.friction)
    system, gammas = problem(args)
    (surface,) = system.problem.surfaces
    friction = surface.law.friction
    curves, iterations = curves_of(system, friction, span, gammas, args.at)
    folds_at = {f"{F:g}": curves.folds_at(F) for F in args.at}
    report(say, curves, folds_at)

    # ## Count between the curves
    family = contact_family(system, friction, mu_range=span)
    grid = dict(cells=(args.cells, args.cells), depth=args.depth, proof_seconds=args.seconds)
    chart = count_solutions(family, mu_range=span, gamma_range=gammas, curves=curves, **grid)
    if comm.rank == 0:
        axes = ("friction coefficient F", r"load $\gamma$")
        plot.draw_chart(folder / "chart.png", chart, curves, labels=axes)

    named = []
    for curve in curves.curves:
        points = curve.points().tolist()
        named.append({"kind": curve.kind, "points": points})
    cells = [[*cell.middle, cell.count, cell.proved] for cell in chart.cells]
    summary = {
        "converged": True,
        "newton_iterations": iterations,
        "proved": chart.proved,
        "dofs": system.create_vector().getSize(),
        "curves": named,
        "cells": cells,
        "cusps": [list(cusp) for cusp in curves.cusps],
        "folds_at": folds_at,
    }
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
