# SPDX-License-Identifier: LGPL-3.0-or-later
"""One figure of several states of a 2D body: deformed meshes, statuses of contact points."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx import fem

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import on_root
from dolfinx_contact._files import part_of
from dolfinx_contact._optional import optional
from dolfinx_contact.continuation import BranchPoint
from dolfinx_contact.equations.order import by_coordinates
from dolfinx_contact.io.gathering import gather_cells
from dolfinx_contact.io.outside import patch
from dolfinx_contact.laws.status import COLOURS, NAMES
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.plot.floors import floor_below
from dolfinx_contact.plot.look import checked_scale
from dolfinx_contact.plot.render import around

__all__ = ["picture_of_states"]


def _check(a: Arguments) -> None:
    a.file = Path(a.file)
    a.points = list(a.points)
    a.scale = checked_scale(a.scale)
    if a.system.problem.V.mesh.geometry.dim != 2 or not a.points:
        raise ValueError("states are drawn side by side for 2D bodies, and at least one is needed")


@collective("a picture of states", _check)
def picture_of_states(
    file: str | os.PathLike[str],
    system: ParametricContact,
    points: Sequence[BranchPoint],
    *,
    titles: Sequence[str] = (),
    scale: float = 1.0,
) -> Path:
    """Draw states of a 2D body side by side. Collective.

    Args:
        file: the picture, ``.png``.
        system: the problem that the points belong to; its Functions are left at the last one.
        points: of branches.
        titles: one for each point.
        scale: factor of the displacement.

    Returns:
        The file.

    Raises:
        OSError: on every rank, with the path, if it cannot be written; it is then as it was.
        ValueError: on every rank, if the body is not 2D, there is no point, the scale is not
            finite, or arguments differ between ranks.
    """
    comm = system.comm
    path = Path(file)
    optional("matplotlib", "pictures")  # on every rank, although one draws
    seen = [_seen(system, point) for point in points]

    def draw() -> None:
        with part_of(path) as part:
            _draw(part, seen, list(titles) or [""] * len(points), scale)

    on_root(comm, draw)
    return path


def _seen(system: ParametricContact, point: BranchPoint) -> dict[str, Any]:
    """Mesh, displacement and contact points of a state, on rank 0."""
    tables = list(system.result_at(point).tables.values())
    u = system.problem.u
    domain = u.function_space.mesh
    V = fem.functionspace(domain, ("Lagrange", 1))
    moved = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    moved.interpolate(u)
    cells = V.dofmap.list[: domain.topology.index_map(2).size_local]
    seen = gather_cells(system.comm, V, cells, {"u": moved.x.array.reshape(-1, 2)})
    patches = [patch(s) for s in system.problem.surfaces]
    if not seen:
        return {}
    contact = []
    for p, table, s in zip(patches, tables, system.problem.surfaces, strict=True):
        order = by_coordinates(p["x"], p["ids"])
        # Gauss points are no vertices: their statuses have no mark.
        known = len(order) == len(table.letters)
        letters = table.letters if known else np.full(len(order), "")
        shown = order[:0] if s.between_bodies else order
        floor = p["floor"][shown], p["moved"][shown]
        contact.append((p["x"][order, :2], p["u"][order], letters, *floor))
    return seen | {"contact": contact}


def _draw(file: Path, seen: Sequence[dict[str, Any]], titles: Sequence[str], scale: float) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    count = len(seen)
    every = np.concatenate([s["x"][:, :2] + scale * s["u"] for s in seen])
    low = every.min(axis=0)
    high = every.max(axis=0)
    margin = 0.05 * float((high - low).max())
    width, height = (high - low) + 2 * margin
    columns, panel = _layout(count, float(height / width))
    rows = -(-count // columns)
    size = max(columns * panel + 1.3, 4.5), rows * (panel * height / width + 0.4) + 0.9
    figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    # One scale of colours for all states, so that they can be compared.
    sizes = [np.linalg.norm(s["u"], axis=1) for s in seen]
    norm = mpl.colors.Normalize(0.0, max(float(v.max()) for v in sizes) or 1.0)
    for axis in axes.flat[count:]:
        axis.set_axis_off()
    for axis, state, values, title in zip(axes.flat, seen, sizes, titles, strict=False):
        deformed = _draw_state(axis, state, values, norm, scale)
        axis.set_xlim(low[0] - margin, high[0] + margin)
        axis.set_ylim(low[1] - margin, high[1] + margin)
        axis.set(aspect="equal", xticks=[], yticks=[])
        axis.set_title(title, fontsize=10)
        axis.spines[:].set_visible(False)
    bar = figure.colorbar(deformed, ax=axes, shrink=0.8, pad=0.01, aspect=30)
    bar.set_label("|u|")
    bar.outline.set_linewidth(0.5)
    letters = {k for s in seen for part in s["contact"] for k in part[2]}
    present = [k for k in NAMES if k in letters]
    marks = [
        plt.Line2D([], [], marker="o", ls="", color=COLOURS[k], label=NAMES[k]) for k in present
    ]
    note = f"displacement x {scale:.3g}; grey: undeformed"
    figure.legend(
        handles=marks,
        loc="outside lower center",
        ncols=len(marks),
        frameon=False,
        title=note,
        title_fontsize=9,
    )
    figure.savefig(file, dpi=130)
    plt.close(figure)


def _draw_state(axis: Any, state: dict[str, Any], values: Any, norm: Any, scale: float) -> Any:
    """The body before and after, contact points and floors; the cells that values colour."""
    from matplotlib.collections import PolyCollection

    x = state["x"][:, :2]
    cells = around(state["cells"])
    edges = {"facecolor": "none", "edgecolor": "#d5d9de", "linewidth": 0.3}
    axis.add_collection(PolyCollection(x[cells], **edges))
    deformed = PolyCollection(
        (x + scale * state["u"])[cells],
        array=values[cells].mean(axis=1),
        norm=norm,
        cmap="GnBu",
        edgecolor="#5b6b7b",
        lw=0.25,
    )
    axis.add_collection(deformed)
    for place, u, letters, floor, moved in state["contact"]:
        marked = letters != ""
        colours = [COLOURS[k] for k in letters[marked]]
        where = (place + scale * u)[marked]
        area = float(np.clip(14 * 40 / max(len(where), 1), 3, 14))
        rim = 0.3 if len(where) <= 60 else 0.1
        axis.scatter(*where.T, c=colours, s=area, zorder=3, edgecolors="0.2", linewidths=rim)
        axis.plot(*floor_below(floor + scale * moved, where).T, color="0.15", lw=1.0, zorder=1)
    return deformed


def _layout(count: int, ratio: float) -> tuple[int, float]:
    """Columns of panels of this height over width, and their width in inches.

    Panels are as large as a page takes, with few empty places; one row is easier to compare.
    """
    found = []
    for columns in range(1, count + 1):
        rows = -(-count // columns)
        width = min(12.0 / columns, (9.0 / rows - 0.4) / ratio)
        fill = count / (rows * columns)
        found.append((width * fill * (1.3 if rows == 1 else 1.0), -columns, width))
    _, columns, width = max(found)
    return -columns, width
