# SPDX-License-Identifier: LGPL-3.0-or-later
"""A curved body on a plane, 2D and 3D, mesh by mesh.

Reference: Hertz.

Friction acts in one static step: the slip is measured from the unloaded body, so that a point
that sticks has not moved at all. The closed forms are then approximate, by some percent.
"""

from mpi4py import MPI

import numpy as np
from _case import CELLS, ScriptParser, number
from _hertz import Hertz

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    io,
    plot,
)
from dolfinx_contact.grids import create_grid, graded
from dolfinx_contact.materials import LinearElastic


def arguments(argv=None):
    given = dict(dim=2, friction=0.0, cell=None, degree=1, young=210e3, poisson=0.3)
    parser = ScriptParser("Hertz contact", output="output/hertz", **given)
    add = parser.add_argument
    positive = number(above=0)
    add("--method", choices=("nodal", "integral", "mixed"), help="of contact (default: automatic)")
    add("--levels", type=number(int, least=2), nargs="+", metavar="N", help="cells over the radius")
    add("--radius", type=positive, default=50.0, help="of curvature of the face")
    add("--load", type=positive, help="on the whole body, roughly (default: contact radius R/50)")
    add("--size", type=number(least=5), help="half width and height of the body in contact radii")
    args = parser.parse(argv)
    stiffness = args.young / (1 - args.poisson**2)
    parts = 2 ** (args.dim - 1)
    args.hertz = Hertz(args.dim, args.radius, stiffness, parts)
    args.load = args.load or args.hertz.load(args.radius / 50)
    if args.dim == 2:
        levels = [5, 10, 20, 40]
        size = 40.0
    else:
        levels = [4, 6, 8]
        size = 15.0
    args.levels = args.levels or levels
    args.size = args.size or size
    if not args.hertz.radius(args.load) < 0.1 * args.radius:
        parser.error("--load: the contact radius must be below a tenth of --radius")
    return args


# The problem.
#
# Half of the body in 2D and a quarter in 3D. Along each axis cells of the size a/n cover the
# contact and some more, followed by as many that grow geometrically. The lower face is a parabola
# or paraboloid that continues straight beyond 4 a. Only its fine part is a contact surface. On the
# planes of symmetry the normal displacement vanishes, and the top face is pushed down.


def problem(args, comm, n, a, delta):
    up = args.dim - 1
    h = a / n
    height = args.size * a
    fine = int(np.ceil(1.25 * n))
    fine_upwards = int(np.ceil(0.5 * n))
    across = graded(height, h, fine, n)
    upwards = graded(height, h, fine_upwards, n)
    axes = [across] * up + [upwards]
    domain = create_grid(comm, axes, CELLS[args.cell])
    tolerance = 1e-9 * height
    inside = across[fine] + 0.5 * a / n

    def touches(x):
        near = (x[:up] < inside).all(axis=0)
        return (x[up] < tolerance) & near

    bottom = mesh.locate_entities_boundary(domain, up, touches)
    x = domain.geometry.x
    away = np.linalg.norm(x[:, :up], axis=1)
    near = np.minimum(away, 4 * a)
    fade = 1 - x[:, up] / height  # the top stays flat
    x[:, up] += fade * near * (2 * away - near) / (2 * args.radius)

    V = fem.functionspace(domain, ("Lagrange", args.degree, (args.dim,)))
    u = fem.Function(V, name="displacement")

    def held(i, place, value):
        W = V.sub(i)
        face = mesh.locate_entities_boundary(
            domain, up, lambda x: np.isclose(x[i], place, atol=tolerance)
        )
        dofs = fem.locate_dofs_topological(W, up, face)
        return fem.dirichletbc(value, dofs, W)

    bcs = [held(i, 0.0, 0.0) for i in range(up)]
    bcs.append(held(up, height, -delta))
    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    floor = HalfSpace(np.zeros(args.dim), np.eye(args.dim)[up])
    surface = ContactSurface(u, bottom, obstacle=floor, law=law, method=args.method)
    material = LinearElastic.from_young(args.young, args.poisson)
    return ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=bcs)


# All meshes.
#
# The first approach is that of a half-space; the next ones correct it for the load that came out.


def solve(args, comm, say=lambda text: None):
    """Return problem and result of the finest mesh, and the numbers of each mesh."""
    a = args.hertz.radius(args.load)
    delta = args.hertz.approach(args.load, args.size * a, args.poisson)
    power = 1.0 if args.dim == 2 else 2 / 3  # approach ~ load^power
    levels = []
    for n in args.levels:
        body = problem(args, comm, n, a, delta)
        result = body.solve()
        found = args.hertz.compare(result.tables["contact"])
        level = {
            "cells_over_radius": n,
            "h_over_a": a / n / found["radius_closed_form"],
            "dofs": result.dofs,
            "newton_iterations": result.iterations,
            "strategy": result.reason,
        }
        level.update(found)
        levels.append(level)
        errors = [f"{key} {value:.2%}" for key, value in found.items() if key.endswith("error")]
        say(f"{n} cells over the radius, load {found['load']:.5g}: {', '.join(errors)}")
        delta *= (args.load / found["load"]) ** power
    return body, result, levels


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    body, result, levels = solve(args, comm, say)
    say.result(result)
    finest = levels[-1]
    if comm.rank == 0:
        errors = [key for key in finest if key.endswith("error")]
        h = np.array([level["h_over_a"] for level in levels])
        curves = {key.replace("_", " "): (h, [level[key] for level in levels]) for key in errors}
        first = levels[0][errors[0]]
        slope = {"order 2": (h, first * (h / h[0]) ** 2)}
        look = dict(labels=("size of cells over the contact radius, $h/a$", "error"), loglog=True)
        plot.draw_curves(folder / "convergence.png", curves, dotted=slope, **look)
        args.hertz.draw(folder / "pressure.png", result.tables["contact"])
    if args.friction > 0:
        plot.picture_of_contact(folder / "friction.png", body)
    io.write_rows(comm, folder / "convergence.csv", levels)
    io.write_contact_table(comm, folder, result.tables.values())
    summary = finest | result.summary()
    summary["levels"] = levels
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
