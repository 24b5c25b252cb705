# SPDX-License-Identifier: LGPL-3.0-or-later
# # All solutions of one element: Hild's triangle
#
# This demo illustrates how to:
#
# - find **all** solutions of a contact problem with few contact points, by solving every piece of H
#   (every status held) and keeping the solutions that satisfy the contact law;
# - see where a problem has one, two, three or infinitely many solutions.
#
# P. Hild, *On finite element uniqueness studies for Coulomb's frictional contact model*, Int. J.
# Appl. Math. Comput. Sci. 12 (2002) 41-50, section 4: the triangle A = (0, 0), B = (l, 0),
# C = (0, l), one linear element, clamped on BC, in contact on AB, under a constant traction
# (F1, F2) on AC. Only A moves. Beyond the critical friction coefficient (lambda + 3 mu)/(lambda +
# mu) there are loads with three solutions: open, stuck, and slipping to the left; at it, there is a
# continuum.

import argparse
import itertools
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.laws import Status
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.output import output_folder, write_summary


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="All solutions of Hild's one-element problem")
    parser.add_argument("--lame", type=float, nargs=2, default=(1.0, 1.0), metavar=("LAMBDA", "MU"))
    parser.add_argument("--friction", type=float, default=3.0)
    parser.add_argument("--load", type=float, nargs=2, default=(-2.4, -1.0), metavar=("F1", "F2"))
    parser.add_argument("--length", type=float, default=1.0)
    parser.add_argument("--diagram", action="store_true", help="draw the regions of loads")
    parser.add_argument("--grid", type=int, default=160, help="loads along an edge of the diagram")
    parser.add_argument("--output", default="output/hild_triangle")
    args = parse_arguments(parser, argv)
    numbers = [*args.lame, *args.load, args.friction, args.length]
    if not np.isfinite(numbers).all():
        parser.error("--lame, --load, --friction and --length must be finite")
    if args.length <= 0 or args.friction < 0 or args.grid < 2:
        parser.error("needs --length > 0, --friction >= 0 and --grid >= 2")
    lmbda, mu = args.lame
    if mu <= 0 or lmbda + mu <= 0:
        parser.error("--lame needs mu > 0 and lambda + mu > 0, a stable material in plane strain")
    return args


# ## One element
#
# The problem is so small that every rank solves it alone; under `mpirun` the ranks only share the
# loads of the diagram.


def element(length, seed=None):
    """Displacement, measure of AC, facets of AB and the clamp on BC of the one-element body."""
    points = length * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    if seed is not None:
        points = points[np.random.default_rng(seed).permutation(3)]
    lagrange = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    cells = np.array([[0, 1, 2]], dtype=np.int64)
    domain = mesh.create_mesh(MPI.COMM_SELF, cells=cells, x=points, e=ufl.Mesh(lagrange))
    domain.topology.create_entities(1)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))

    def edge(where):
        return mesh.locate_entities_boundary(domain, 1, where)

    slope = edge(lambda x: np.isclose(x[0] + x[1], length))
    side = edge(lambda x: np.isclose(x[0], 0.0, atol=1e-9 * length))
    bottom = edge(lambda x: np.isclose(x[1], 0.0, atol=1e-9 * length))
    clamped = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    tags = mesh.meshtags(domain, 1, side, np.ones(len(side), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    return fem.Function(V, name="displacement"), ds, bottom, clamped


def triangle(lame, friction, length, r=None, seed=None):
    """The problem, and the Constant of its traction."""
    u, ds, bottom, clamped = element(length, seed)
    load = fem.Constant(u.function_space.mesh, (0.0, 0.0))
    energy = LinearElastic(*lame).energy(u) * ufl.dx - ufl.dot(load, u) * ds
    surface = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0), (0, 1)), law=Coulomb(friction))
    return ContactProblem(energy, u, [surface], bcs=[clamped], r=r), load


# ## The pieces
#
# With the status of A held, H is affine in the unknowns and in the load: its matrix and the
# residuals at two loads give the solution at every load. A singular piece that still has solutions
# has a line of them.


@dataclass
class Piece:
    """Solutions of one piece at A: (ut, un, rt, rn) = base(load) + s line, any s."""

    letter: str
    maps: np.ndarray  # 4 x 2, from the load to (ut, un, rt, rn)
    line: np.ndarray | None  # direction of the solutions if the piece is singular
    defect: np.ndarray  # residual left by the load, 0 if the piece can carry it
    dofs: int

    def at(self, load):
        return self.maps @ load


STATUSES = {
    "o": Status(np.zeros(2), np.zeros(2), np.zeros(2)),
    "k": Status(np.ones(2), np.ones(2), np.zeros(2)),
    "+": Status(np.ones(2), np.zeros(2), -np.ones(2)),
    "-": Status(np.ones(2), np.zeros(2), np.ones(2)),
}


def pieces(lame, friction, length):
    """The four pieces of the triangle, from the assembled matrices."""
    problem, load = triangle(lame, friction, length)
    (surface,) = problem.surfaces
    x, b = problem.create_vector(), problem.create_vector()
    found = []

    def residual(value):
        load.value[:] = value
        x.set(0.0)
        problem.residual(x, b)
        return b.array_r.copy()

    def observe(values):
        """(ut, un, rt, rn) at A, linear in the unknowns since the gap is zero."""
        x.array[:] = values
        problem.read(x)
        state = surface.state()
        at = int(np.argmin(np.linalg.norm(state["x"], axis=1)))
        force = state["traction"][at] * state["area"][at]
        return np.array([state["ut"][at, 0], state["un"][at], force[0], force[1]])

    for letter, status in STATUSES.items():
        with problem.status_held():
            problem.statuses = [status]
            x.set(0.0)
            problem.jacobian(x, problem.matrix)
            dense = problem.matrix.convert("dense", PETSc.Mat())
            J = dense.getDenseArray().copy()
            dense.destroy()
            rhs = -np.column_stack([residual((1.0, 0.0)), residual((0.0, 1.0))])
            # Rows and columns are scaled to tell a singular piece from a badly scaled one.
            rows = 1 / np.linalg.norm(J, axis=1)
            columns = 1 / np.linalg.norm(rows[:, None] * J, axis=0)
            U, s, Vt = np.linalg.svd(rows[:, None] * J * columns)
            rank = int(np.sum(s > 1e-12 * s[0]))
            scaled = rows[:, None] * rhs
            solution = columns[:, None] * (
                Vt[:rank].T @ ((U[:, :rank].T @ scaled) / s[:rank, None])
            )
            line = observe(columns * Vt[-1]) if rank < len(s) else None
            maps = np.column_stack([observe(solution[:, i]) for i in range(2)])
            found.append(Piece(letter, maps, line, U[:, rank:].T @ scaled, len(J)))
    problem.destroy()
    return found


# ## All solutions at a load
#
# A solution of a piece is one of the problem if it satisfies the contact law. At the borders
# between statuses two pieces share one, which is named once: open before stick before slip.


def law_slacks(letter, friction):
    """Rows a such that a . (ut, un, rt, rn) >= 0 for the status ``letter``."""
    rows = {
        "o": [(0, 1, 0, 0)],
        "k": [(0, 0, 0, 1), (0, 0, 1, friction), (0, 0, -1, friction)],
        "+": [(1, 0, 0, 0), (0, 0, 0, 1)],
        "-": [(-1, 0, 0, 0), (0, 0, 0, 1)],
    }
    return np.array(rows[letter], dtype=float)


def named(letter, values):
    ut, un, rt, rn = (float(v) + 0.0 for v in values)
    return {"status": letter, "ut": ut, "un": un, "rt": rt, "rn": rn}


def solutions(all_pieces, friction, load):
    """All solutions at ``load``, in the order o, k, +, -; a continuum with its two ends."""
    load = np.asarray(load, dtype=float)
    scale = np.array([np.abs(p.maps).max(axis=1) for p in all_pieces]).max(axis=0)
    scale = np.where(scale > 0, scale, 1.0) * max(np.linalg.norm(load), 1e-300)
    tolerance = 1e-11
    found, continua = [], []
    for piece in all_pieces:
        values, slacks = piece.at(load), law_slacks(piece.letter, friction)
        unit = np.abs(slacks) @ scale
        if piece.line is None:
            if (slacks @ values >= -tolerance * unit).all():
                found.append((piece.letter, values))
        elif np.abs(piece.defect @ load).max() <= tolerance * np.linalg.norm(load):
            # Where does values + s line satisfy the law? An interval of s.
            offset, slope = slacks @ values / unit, slacks @ piece.line / unit
            moving = np.abs(slope) > tolerance * np.abs(slope).max()
            bounds = -offset[moving] / slope[moving]
            low = bounds[slope[moving] > 0].max(initial=-np.inf)
            high = bounds[slope[moving] < 0].min(initial=np.inf)
            if np.isfinite([low, high]).all() and high - low > tolerance * max(abs(low), abs(high)):
                continua.append((piece.letter, [values + s * piece.line for s in (low, high)]))

    def same(a, b):
        return bool((np.abs(a - b) <= 1e-9 * scale).all())

    distinct = []
    for letter, values in found:
        known = [v for _, v in distinct] + [end for _, ends in continua for end in ends]
        if not any(same(values, other) for other in known):
            distinct.append((letter, values))
    records = [named(letter, values) for letter, values in distinct]
    for letter, ends in continua:
        ends = sorted((named(letter, end) for end in ends), key=lambda e: -e["rn"])
        records.append({"status": letter, "continuum": True, "ends": ends})
    return sorted(records, key=lambda r: "ok+-".index(r["status"]))


def label(records):
    """The set of solutions in one word: their statuses, a tilde marking a continuum."""
    return "".join(r["status"] + ("~" if r.get("continuum") else "") for r in records)


# ## The diagram of Proposition 2
#
# One picture per regime of friction (below, at and above the critical coefficient), as figures 2 to
# 4 of the paper. Every cell is the set of solutions computed at a load. The borders between the
# regions are lines through the origin, computed as well, since two of them carry solution sets of
# their own: two solutions, or infinitely many. (On one of the two borders of the red region the
# slip to the left carries no pressure any more and is the separation; on the other it does not slip
# any more and is the stick.)

NAMES = {
    "o": "separation",
    "k": "stick",
    "+": "slip right (ut > 0)",
    "-": "slip left (ut < 0)",
    "k-": "2 solutions: stick, slip left",
    "ok": "2 solutions: separation, stick",
    "ok-": "3 solutions: separation, stick, slip left",
    "-~": "infinitely many, from stick to slip left",
}
COLOURS = {
    "o": "#dfe7ef",
    "k": "#f2d9a6",
    "+": "#b7d7b0",
    "-": "#c9b8dc",
    "k-": "#e07b39",
    "ok": "#3b6ea8",
    "ok-": "#c0392b",
    "-~": "#111111",
}


def diagram(comm, lame, friction, length, size):
    """Solution sets on a grid of loads and on the special lines; the loads are shared by ranks."""
    all_pieces = pieces(lame, friction, length)
    critical = (lame[0] + 3 * lame[1]) / (lame[0] + lame[1])
    # The two axes are shifted, each by its own part of a cell, so that no load of the grid lies on
    # a border between regions.
    cells = (np.arange(size) + 0.5) / size
    axes = [6 * cells - 3 + shift * 6 / size for shift in (0.0317, -0.0171)]
    rays = [(s * m, sign) for m in {friction, critical} for s in (-1, 1) for sign in (-1, 1)]
    rays += [(sign, s * friction) for s in (-1, 1) for sign in (-1, 1)]
    loads = [*itertools.product(*axes), *rays]
    mine = [label(solutions(all_pieces, friction, x)) for x in loads[comm.rank :: comm.size]]
    labels = [""] * len(loads)
    for rank, part in enumerate(comm.allgather(mine)):
        labels[rank :: comm.size] = part
    n = size * size
    return axes, np.array(labels[:n]).reshape(size, size), list(zip(rays, labels[n:], strict=True))


def draw(path, grid, cells, rays, title):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    present = [k for k in NAMES if k in cells or k in {name for _, name in rays}]
    codes = {k: i for i, k in enumerate(NAMES)}
    image = np.vectorize(codes.__getitem__)(cells)
    colours = ListedColormap([COLOURS[k] for k in NAMES])
    norm = BoundaryNorm(np.arange(len(NAMES) + 1) - 0.5, len(NAMES))
    figure, axes = plt.subplots(figsize=(6.4, 6.6), layout="constrained")
    axes.pcolormesh(*grid, image.T, cmap=colours, norm=norm, shading="nearest")
    reach = 2.95
    for (f1, f2), name in rays:
        if name in ("k-", "ok", "-~"):
            far = reach / max(abs(f1), abs(f2))
            axes.plot([0, far * f1], [0, far * f2], color=COLOURS[name], lw=3)
    axes.axhline(0, color="0.3", lw=0.6)
    axes.axvline(0, color="0.3", lw=0.6)
    axes.set(
        xlabel="$F_1$",
        ylabel="$F_2$",
        title=title,
        aspect="equal",
        xlim=(-reach, reach),
        ylim=(-reach, reach),
    )
    handles = [Patch(facecolor=COLOURS[k], edgecolor="0.4", label=NAMES[k]) for k in present]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    all_pieces = pieces(args.lame, args.friction, args.length)
    found = solutions(all_pieces, args.friction, args.load)
    critical = (args.lame[0] + 3 * args.lame[1]) / (args.lame[0] + args.lame[1])
    scalars = {
        "converged": bool(found),
        "newton_iterations": len(all_pieces),  # one linear solve a piece
        "dofs": all_pieces[0].dofs,
        "solutions": found,
        "critical_friction": critical,
    }
    if comm.rank == 0:
        print(f"F = {args.friction:g} (critical: {critical:g}), load {tuple(args.load)}:")
        for record in found:
            print("  ", record)
    if args.diagram:
        regimes = {"below": 0.5 * critical, "at": critical, "above": 1.5 * critical}
        scalars["diagram"] = {}
        for name, friction in regimes.items():
            grid, cells, rays = diagram(comm, args.lame, friction, args.length, args.grid)
            sets, counts = np.unique(cells, return_counts=True)
            scalars["diagram"][name] = {
                "friction": friction,
                "cells": dict(zip(sets.tolist(), counts.tolist(), strict=True)),
                "lines": [{"load": list(r), "solutions": s} for r, s in rays],
            }
            if comm.rank == 0:
                title = f"Hild's triangle, F = {friction:.4g}, {name} the critical coefficient"
                draw(folder / f"regions_{name}_critical.png", grid, cells, rays, title)
                print(
                    f"F = {friction:.4g}: {dict(zip(sets.tolist(), counts.tolist(), strict=True))}"
                )
    return write_summary(comm, folder, scalars)


if __name__ == "__main__":
    main()
