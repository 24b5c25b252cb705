# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two round bodies in contact: their sections in gmsh, and a study of their meshes beside Hertz.

Half of a section is a polygon: sides along the circle, which grow with the distance from the
contact as the cells between do, then the equator (a flat end) and the axis. The first sides may
touch.
"""

from mpi4py import MPI

import gmsh
import numpy as np
from _case import ScriptParser, number

from dolfinx_contact import io, plot


def parser(name, ratio):
    """Return the parser of such a case; ``ratio`` is the default of ``--ratio``."""
    words = ScriptParser("Two round bodies", output=f"output/{name}", friction=0.0)
    add = words.add_argument
    size = number(above=0, most=2)
    positive = number(above=0)
    sizes = [1.0, 0.5, 0.25]
    add("--levels", type=size, nargs="+", default=sizes, help="cell sizes there, mm")
    add("--ratio", type=positive, default=ratio, help="of the lower body's cells over that")
    return words


def quarter(size, sign, radius):
    """Return the number of sides that may touch, and the corners (x, y) of a quarter of a disc.

    Args:
        size: length of the sides at the contact, (0, 0).
        sign: 1 for a disc above the contact, -1 for one below.
        radius: radius of the disc.
    """
    end = 0.5 * np.pi * radius
    s = [0.0]
    while s[-1] < end:
        growth = 0.1 * max(s[-1] - 12, 0)
        s.append(s[-1] + size + growth)
    angle = 0.5 * np.pi * np.array(s) / s[-1]
    x = radius * np.sin(angle)
    y = sign * (radius - np.sqrt(radius**2 - x**2))
    may_touch = int((x < 0.5 * radius).sum())
    corners = list(zip(x, y, strict=True))
    corners.append((0.0, sign * radius))
    return may_touch, corners


def draw(bodies):
    """Draw and mesh bodies in the current model of gmsh, in groups ``name`` and ``name face``, ...

    Args:
        bodies: by name the number of sides that may touch and the corners: first those of these
            sides, from the axis outwards; the last two sides are ``end`` and ``axis``.
    """
    geo = gmsh.model.geo
    group = gmsh.model.addPhysicalGroup
    for name, (face, corners) in bodies.items():
        distance = np.linalg.norm(corners, axis=1)
        sizes = corners[1][0] + 0.1 * distance
        points = []
        for (x, y), size in zip(corners, sizes, strict=True):
            points.append(geo.addPoint(x, y, 0, size))
        sides = []
        for start, end in zip(points, np.roll(points, -1), strict=True):
            sides.append(geo.addLine(start, end))
        for side in sides[:face]:
            geo.mesh.setTransfiniteCurve(side, 2)
        loop = geo.addCurveLoop(sides)
        body = geo.addPlaneSurface([loop])
        geo.synchronize()
        group(2, [body], name=name)
        group(1, sides[:face], name=f"{name} face")
        group(1, sides[-2:-1], name=f"{name} end")
        group(1, sides[-1:], name=f"{name} axis")
    gmsh.model.mesh.generate(2)


def study(args, problem, hertz):
    """Solve the problem on each mesh, compare with Hertz and write the results.

    Args:
        args: options of `parser`.
        problem: function of the cell size, the options and the communicator.
        hertz: closed forms.
    """
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    levels = []
    for size in args.levels:
        bodies = problem(size, args, comm)
        result = bodies.solve()
        table = result.tables["contact"]
        found = hertz.compare(table)
        level = {
            "size": size,
            "dofs": result.dofs,
            "force": found["load"],
            "radius": found["touching_radius"],
            "hertz_radius": found["radius_closed_form"],
            "peak": found["peak_pressure"],
            "hertz_peak": found["peak_pressure_closed_form"],
        }
        levels.append(level)
        say(", ".join(f"{name} {value:.6g}" for name, value in level.items()))
    say.result(result)
    if comm.rank == 0:
        hertz.draw(folder / "pressure.png", table)
    plot.picture_of_body(folder / "body.png", bodies)
    io.write_rows(comm, folder / "convergence.csv", levels)
    io.write_contact_table(comm, folder, [table])
    summary = result.summary() | level
    summary["levels"] = levels
    return io.write_summary(comm, folder, summary)
