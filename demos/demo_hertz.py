# SPDX-License-Identifier: LGPL-3.0-or-later
# # Hertz contact of a curved body on a rigid plane
#
# This demo illustrates how to:
#
# - grade a built-in mesh towards a contact zone and give the body a curved face;
# - use planes of symmetry that end in the contact zone;
# - fit contact radius and peak pressure to the nodal pressures and compare them with Hertz's closed
#   forms, mesh by mesh, in 2D (line contact, plane strain) and 3D (point contact);
# - see where the contact sticks and where it slips, with friction.
#
# An elastic body whose lower face has radius of curvature $R$ is pressed on a rigid plane. If the
# contact is small against $R$ and the body, it is that of a half-space (Johnson, Contact Mechanics,
# 1985, sections 4.2 and 5.5): with $E^* = E/(1-\nu^2)$, $x$ the distance from the axis and $P$ the
# load (in 2D per unit length),
#
# $$p(x) = p_0\sqrt{1 - x^2/a^2},\qquad
# a = \sqrt{4PR/(\pi E^*)},\ p_0 = \frac{2P}{\pi a}\ \text{(line)},\qquad
# a = \sqrt[3]{3PR/(4E^*)},\ p_0 = \frac{3P}{2\pi a^2}\ \text{(point)}.$$

import argparse
import csv

from mpi4py import MPI

import matplotlib as mpl
import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    parse_arguments,
)
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.output import output_folder, write_contact_table, write_summary

mpl.use("Agg")
import matplotlib.pyplot as plt

CELLS = {
    "tri": mesh.CellType.triangle,
    "quad": mesh.CellType.quadrilateral,
    "tet": mesh.CellType.tetrahedron,
    "hex": mesh.CellType.hexahedron,
}


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="Hertz line and point contact on a rigid plane")
    parser.add_argument("--dim", type=int, choices=(2, 3), default=2, help="line or point contact")
    parser.add_argument("--friction", type=float, default=0.0)
    parser.add_argument(
        "--levels",
        type=int,
        nargs="+",
        metavar="N",
        help="meshes, each by its number of cells over the contact radius "
        "(default: 5 10 20 40 in 2D, 4 6 8 in 3D)",
    )
    parser.add_argument("--cell", choices=CELLS, help="default: quad in 2D, hex in 3D")
    parser.add_argument("--degree", type=int, choices=(1, 2), default=1)
    parser.add_argument("--young", type=float, default=210e3)
    parser.add_argument("--poisson", type=float, default=0.3)
    parser.add_argument("--radius", type=float, default=50.0, help="of curvature of the face")
    parser.add_argument(
        "--load",
        type=float,
        help="on the whole body, per unit length in 2D; approached from mesh to mesh "
        "(default: that of a contact radius of radius/50)",
    )
    parser.add_argument(
        "--size",
        type=float,
        help="half the width of the body, and its height, in contact radii "
        "(default: 40 in 2D, 15 in 3D)",
    )
    parser.add_argument("--output", default="output/hertz")
    args = parse_arguments(parser, argv)
    args.levels = args.levels or ([5, 10, 20, 40] if args.dim == 2 else [4, 6, 8])
    args.cell = args.cell or ("quad" if args.dim == 2 else "hex")
    if args.size is None:
        args.size = 40.0 if args.dim == 2 else 15.0
    if (args.dim == 2) != (args.cell in ("tri", "quad")):
        parser.error(f"--cell {args.cell} does not fit --dim {args.dim}")
    if min(args.levels) < 2:
        parser.error("--levels: fewer than 2 cells over the contact radius cannot be fitted")
    if not 5 <= args.size < np.inf:
        parser.error("--size must be at least 5: a smaller body is no half-space")
    if not (0 < args.radius < np.inf and 0 < args.young < np.inf and -1 < args.poisson < 0.5):
        parser.error("--radius and --young must be positive, --poisson in (-1, 1/2)")
    if not 0 <= args.friction < np.inf:
        parser.error("--friction must not be negative")
    stiffness = args.young / (1 - args.poisson**2)
    if args.load is None:
        a = args.radius / 50
        line = np.pi * stiffness * a**2 / (4 * args.radius)
        args.load = line if args.dim == 2 else 4 * stiffness * a**3 / (3 * args.radius)
    if not (args.load > 0 and closed_form(args, args.load)[0] < 0.1 * args.radius):
        parser.error("--load must be positive and the contact radius below a tenth of --radius")
    return args


def closed_form(args, load):
    """Contact radius and peak pressure of Hertz."""
    stiffness = args.young / (1 - args.poisson**2)
    if args.dim == 2:
        a = np.sqrt(4 * load * args.radius / (np.pi * stiffness))
        return a, 2 * load / (np.pi * a)
    a = np.cbrt(3 * load * args.radius / (4 * stiffness))
    return a, 3 * load / (2 * np.pi * a**2)


# ## The approach
#
# The top face is pushed down. By how much? In 3D the approach of distant points is $a^2/R$, in 2D
# it has no limit; so take the closed forms for a half-space between the contact and a point of the
# axis at the depth $H$ of the top face (Johnson, sections 3.2 and 5.6). The sides of the body are
# free and not at infinity, so that the load differs from the one asked for by some percent. The
# closed forms are evaluated for the load that comes out, and the next mesh gets a better approach.


def approach(args, load):
    a, _ = closed_form(args, load)
    height, nu = args.size * a, args.poisson
    if args.dim == 2:
        stiffness = args.young / (1 - nu**2)
        return load / (np.pi * stiffness) * (2 * np.log(2 * height / a) - nu / (1 - nu))
    beyond = load * (1 + nu) * (3 - 2 * nu) / (2 * np.pi * args.young * height)
    return a**2 / args.radius - beyond


# ## The mesh
#
# Half of the body in 2D and a quarter in 3D: a built-in mesh of the unit square or cube, whose
# coordinates are then moved. Along each axis cells of the size $h = a/n$ cover the contact and some
# more, followed by as many that grow geometrically up to the far side. The lower face is a parabola
# or paraboloid; it goes on straight beyond $4a$, far from the contact, so that the body keeps its
# height at any load.
#
# Quadrilaterals and hexahedra are the better choice here: on such a regular grid their nodal
# pressures follow the profile to $O(h^2)$, those of triangles and tetrahedra to about $O(h)$. Only
# the fine part of the lower face is declared a contact surface; outside of it the gap stays open.


def graded(n, fine, length):
    """Coordinates from 0 to ``length``: ``fine`` cells of size 1/n, then n growing ones."""
    inner = np.arange(fine + 1) / n
    powers = np.arange(1, n + 1)
    low, high = 0.1, (length * n) ** (1 / n)
    for _ in range(200):
        growth = 0.5 * (low + high)
        if np.sum(growth**powers) / n < length - inner[-1]:
            low = growth
        else:
            high = growth
    return np.concatenate([inner, inner[-1] + np.cumsum(growth**powers) / n])


def build_mesh(args, comm, n, a):
    """The mesh, and the facets of its lower face that may touch."""
    up = args.dim - 1
    across = a * graded(n, int(np.ceil(1.25 * n)), args.size)
    upwards = a * graded(n, int(np.ceil(0.5 * n)), args.size)
    cells = [len(across) - 1] * up + [len(upwards) - 1]
    if args.dim == 2:
        domain = mesh.create_unit_square(comm, *cells, CELLS[args.cell])
    else:
        domain = mesh.create_unit_cube(comm, *cells, CELLS[args.cell])
    edge = (np.ceil(1.25 * n) + 0.5) / cells[0]
    contact = mesh.locate_entities_boundary(
        domain, up, lambda x: np.isclose(x[up], 0.0) & (x[:up] < edge).all(axis=0)
    )

    x = domain.geometry.x
    for i, grid in enumerate([across] * up + [upwards]):
        x[:, i] = np.interp(x[:, i] * cells[i], np.arange(cells[i] + 1), grid)
    distance = np.linalg.norm(x[:, :up], axis=1)
    near = np.minimum(distance, 4 * a)
    face = near * (2 * distance - near) / (2 * args.radius)
    x[:, up] += (1 - x[:, up] / upwards[-1]) * face
    return domain, contact


# ## The problem
#
# On the planes of symmetry the normal displacement vanishes. They meet the contact surface at right
# angles, so that they fix a tangential component of nodes that may touch: the reaction there
# belongs to the support, and the problem removes that component of the multiplier.
#
# Without friction the face is drawn inwards, unless the body is incompressible. Friction, if any,
# resists that: the middle sticks, a ring around it slips inwards. It acts in one static step, the
# history of the load is left out: the slip is measured from the unloaded body, so that a point that
# sticks has not moved at all. (Loaded little by little, it would keep what it slipped before it
# touched.) The closed forms are then approximate, by some percent at $\nu = 0.3$; a history, two
# bodies and the solution of Cattaneo and Mindlin are beyond this demo.


def problem(args, comm, n, a, delta):
    domain, contact = build_mesh(args, comm, n, a)
    up, height = args.dim - 1, args.size * a
    V = fem.functionspace(domain, ("Lagrange", args.degree, (args.dim,)))
    u = fem.Function(V, name="displacement")
    bcs = []
    for i in range(args.dim):
        place, value = (height, -delta) if i == up else (0.0, 0.0)
        facets = mesh.locate_entities_boundary(
            domain, up, lambda x, i=i, place=place: np.isclose(x[i], place, atol=1e-9 * height)
        )
        dofs = fem.locate_dofs_topological(V.sub(i), up, facets)
        bcs.append(fem.dirichletbc(value, dofs, V.sub(i)))

    law = Coulomb(args.friction) if args.friction > 0 else Frictionless()
    plane = HalfSpace(np.zeros(args.dim), np.eye(args.dim)[up])
    surface = ContactSurface(u, contact, obstacle=plane, law=law)
    material = LinearElastic.from_young(args.young, args.poisson)
    return ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=bcs)


# ## Radius and peak pressure
#
# $p^2$ is linear in $x^2$, so a linear least-squares fit over the nodes inside $0.9\,a$, each with
# its area, gives $p_0$ and $a$ without looking at the edge, where a node covers both sides. The
# rest is recorded as well: the largest nodal pressure as it is, the deviation from the profile, and
# the sizes of the zones as the nodes that touch or stick show them.


def from_axis(table):
    """Distances of the contact points from the axis of the body."""
    return np.linalg.norm(table.x[:, :-1], axis=1)


def measure(args, table, n, result):
    """Radius and peak pressure of one mesh against the closed forms for its load."""
    up = args.dim - 1
    load = float(table.rn.sum()) * 2**up
    a, p0 = closed_form(args, load)
    x, p = from_axis(table), table.pressure
    inside = x < 0.9 * a
    weight = np.sqrt(table.area[inside])
    columns = np.column_stack([np.ones(inside.sum()), -(x[inside] ** 2)])
    squared, slope = np.linalg.lstsq(
        columns * weight[:, None], p[inside] ** 2 * weight, rcond=None
    )[0]
    radius, peak = np.sqrt(squared / slope), np.sqrt(squared)
    profile = p0 * np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
    deviation = np.sqrt(np.average((p - profile)[inside] ** 2, weights=table.area[inside])) / p0

    def zone(letters):
        """Radius of the disc that has the area of the nodes with these letters."""
        area = float(table.area[np.isin(table.letters, list(letters))].sum())
        return area if args.dim == 2 else np.sqrt(4 * area / np.pi)

    measured = {
        "cells_over_radius": n,
        "h_over_a": closed_form(args, args.load)[0] / n / a,
        "dofs": result.dofs,
        "newton_iterations": result.iterations,
        "strategy": result.reason,
        "load": load,
        "radius": radius,
        "radius_closed_form": a,
        "radius_error": abs(radius / a - 1),
        "peak_pressure": peak,
        "peak_pressure_closed_form": p0,
        "peak_pressure_error": abs(peak / p0 - 1),
        "largest_pressure": p.max(),
        "largest_pressure_error": abs(p.max() / p0 - 1),
        "profile_error": deviation,
        "touching_radius": zone("k+-s"),
    }
    if args.friction > 0:
        measured["stick_radius"] = zone("k")
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in measured.items()}


# ## Tables and pictures


HEADER = "cells/a   dofs  Newton        load           a   error       p_0   error   max p   error"


def row(level):
    return (
        f"{level['cells_over_radius']:7d} {level['dofs']:6d} {level['newton_iterations']:7d}"
        f" {level['load']:11.5g} {level['radius']:11.5g} {100 * level['radius_error']:6.2f}%"
        f" {level['peak_pressure']:9.5g} {100 * level['peak_pressure_error']:6.2f}%"
        f" {level['largest_pressure']:7.5g} {100 * level['largest_pressure_error']:6.2f}%"
    )


def write_levels(folder, levels):
    with open(folder / "convergence.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, levels[0])
        writer.writeheader()
        writer.writerows(levels)


def plot_convergence(args, folder, levels):
    figure, axes = plt.subplots(figsize=(5, 4), layout="constrained")
    h = np.array([level["h_over_a"] for level in levels])
    labels = {
        "radius_error": "radius $a$ (fit)",
        "peak_pressure_error": "peak pressure $p_0$ (fit)",
        "largest_pressure_error": "largest nodal pressure",
        "profile_error": "profile, root mean square",
    }
    for key, label in labels.items():
        axes.loglog(h, [level[key] for level in levels], "o-", label=label)
    axes.loglog(h, levels[0]["profile_error"] * (h / h[0]) ** 2, "k:", label="$(h/a)^2$")
    axes.axhline(0.02, color="grey", linewidth=0.8)
    axes.set(xlabel="$h/a$", ylabel="relative error", title=title(args))
    axes.legend(fontsize="small")
    figure.savefig(folder / "convergence.png", dpi=150)
    plt.close(figure)


def title(args):
    kind = "line" if args.dim == 2 else "point"
    return f"Hertz {kind} contact" + (f", F = {args.friction:g}" if args.friction > 0 else "")


def plot_pressure(args, folder, table, level):
    a, p0 = level["radius_closed_form"], level["peak_pressure_closed_form"]
    figure, axes = plt.subplots(figsize=(5, 4), layout="constrained")
    x = np.linspace(0, 1, 400)
    axes.plot(x, np.sqrt(1 - x**2), "k-", linewidth=1, label="Hertz")
    axes.plot(from_axis(table) / a, table.pressure / p0, "o", markersize=3, label="nodes")
    axes.set(xlabel="$x/a$", ylabel="$p/p_0$", title=title(args))
    axes.legend()
    figure.savefig(folder / "pressure.png", dpi=150)
    plt.close(figure)


COLOURS = {"o": "lightgrey", "k": "tab:blue", "+": "tab:orange", "-": "tab:red", "s": "tab:red"}
NAMES = {"o": "open", "k": "stick", "+": "slip outwards", "-": "slip inwards", "s": "slip"}


def plot_friction(args, folder, table, level):
    """Status of the nodes: in 2D over the used part of the friction bound, in 3D in the face."""
    a = level["radius_closed_form"]
    x, closed = table.x / a, table.letters != "o"
    figure, axes = plt.subplots(figsize=(5.5, 4), layout="constrained")
    if args.dim == 2:
        shear = table.along(table.shear)
        used = np.divide(shear, args.friction * table.pressure, where=closed, out=0 * shear)
        places = x[:, 0], used
        axes.axhline(1, color="grey", linewidth=0.8)
        axes.axhline(-1, color="grey", linewidth=0.8)
        axes.set(xlabel="$x/a$", ylabel="$q/(Fp)$")
    else:
        places = x[:, 0], x[:, 1]
        angle = np.linspace(0, np.pi / 2, 100)
        for size, style in ((a, "k-"), (level["stick_radius"], "b--")):
            axes.plot(size / a * np.cos(angle), size / a * np.sin(angle), style, linewidth=0.8)
        axes.quiver(*places, *table.shear[:, :2].T, width=0.003, color="dimgrey")
        axes.set(xlabel="$x/a$", ylabel="$y/a$", aspect="equal")
    for letter, colour in COLOURS.items():
        mask = table.letters == letter
        if mask.any():
            axes.plot(*(v[mask] for v in places), "o", color=colour, label=NAMES[letter], ms=4)
    axes.set_title(title(args))
    figure.legend(loc="outside right upper", fontsize="small")
    figure.savefig(folder / "friction.png", dpi=150)
    plt.close(figure)


# ## All meshes
#
# From one mesh to the next the approach is corrected for the load that came out: it grows like
# $P$ (nearly) in 2D and like $P^{2/3}$ in 3D.


def solve(args, comm, report=lambda text: None):
    """Result of the finest mesh, and what was measured on each."""
    a, _ = closed_form(args, args.load)
    delta, levels = approach(args, args.load), []
    report(HEADER)
    for n in args.levels:
        contact = problem(args, comm, n, a, delta)
        result = contact.solve()
        contact.destroy()
        levels.append(measure(args, result.tables["contact"], n, result))
        delta *= (args.load / levels[-1]["load"]) ** (1.0 if args.dim == 2 else 2 / 3)
        report(row(levels[-1]))
    return result, levels


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)

    def report(text):
        if comm.rank == 0:
            print(text, flush=True)

    result, levels = solve(args, comm, report)
    table, finest = result.tables["contact"], levels[-1]
    report("points: " + ", ".join(f"{v} {k}" for k, v in result.counts.items() if v))
    if args.friction > 0:
        ratio = finest["stick_radius"] / finest["touching_radius"]
        report(f"stick zone {ratio:.2f} of the contact; the closed forms are approximate here")
    if comm.rank == 0:
        write_levels(folder, levels)
        plot_convergence(args, folder, levels)
        plot_pressure(args, folder, table, finest)
        if args.friction > 0:
            plot_friction(args, folder, table, finest)
    write_contact_table(comm, folder, [table])
    return write_summary(comm, folder, {**finest, **result.summary(), "levels": levels})


if __name__ == "__main__":
    main()
