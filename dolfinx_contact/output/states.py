# SPDX-License-Identifier: LGPL-3.0-or-later
"""One figure of several states of a 2D body: deformed meshes, statuses of contact points."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dolfinx import fem

from dolfinx_contact._errors import on_root
from dolfinx_contact.continuation import BranchPoint
from dolfinx_contact.output.disk import part_of
from dolfinx_contact.output.pictures import gather_cells, patch
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.result import by_coordinates

__all__ = ["STATUS_COLOURS", "STATUS_NAMES", "picture_of_states"]

STATUS_NAMES = {
    "o": "open",
    "k": "stick",
    "+": "slip, $u_t > 0$",
    "-": "slip, $u_t < 0$",
    "s": "slip",
    "d": "clamped",
}
STATUS_COLOURS = {
    "o": "#c9d1db",
    "k": "#2e6db4",
    "+": "#2e9e4f",
    "-": "#e8892b",
    "s": "#e8892b",
    "d": "#555555",
}


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
        ValueError: if the body is not 2D, or there is no point.
    """
    if system.problem.V.mesh.geometry.dim != 2 or not points:
        raise ValueError("states are drawn side by side for 2D bodies, and at least one is needed")
    seen = [_seen(system, point) for point in points]
    path = Path(file)

    def draw() -> None:
        with part_of(path) as part:
            _draw(part, seen, list(titles) or [""] * len(points), scale)

    on_root(system.comm, draw)
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
    for p, table in zip(patches, tables, strict=True):
        order = by_coordinates(p["x"])
        # Gauss points are no vertices: their statuses have no mark.
        known = len(order) == len(table.letters)
        letters = table.letters if known else np.full(len(order), "")
        floor = p["x"][:, :2] + p["gap"][:, None] * p["n"]
        contact.append((p["x"][order, :2], p["u"][order], letters, floor[order]))
    return seen | {"contact": contact}


def _draw(file: Path, seen: Sequence[dict[str, Any]], titles: Sequence[str], scale: float) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection

    count = len(seen)
    columns = min(count, 4 if count != 6 else 3)
    rows = -(-count // columns)
    every = np.concatenate([s["x"][:, :2] + scale * s["u"] for s in seen])
    low, high = every.min(axis=0), every.max(axis=0)
    margin = 0.05 * float((high - low).max())
    ratio = float((high - low)[1] + 2 * margin) / float((high - low)[0] + 2 * margin)
    width = 12.0 / columns
    figure, axes = plt.subplots(
        rows,
        columns,
        figsize=(12, rows * (min(width * ratio, 6.0) + 0.5) + 0.5),
        squeeze=False,
        layout="constrained",
    )
    for axis in axes.flat[count:]:
        axis.set_axis_off()
    for axis, state, title in zip(axes.flat, seen, titles, strict=False):
        x, cells = state["x"][:, :2], _around(state["cells"])
        edges = {"facecolor": "none", "edgecolor": "#d5d9de", "linewidth": 0.3}
        axis.add_collection(PolyCollection(x[cells], **edges))
        size = np.linalg.norm(state["u"], axis=1)[cells].mean(axis=1)
        deformed = PolyCollection(
            (x + scale * state["u"])[cells], array=size, cmap="GnBu", edgecolor="#5b6b7b", lw=0.25
        )
        axis.add_collection(deformed)
        for place, u, letters, floor in state["contact"]:
            marked = letters != ""
            colours = [STATUS_COLOURS[k] for k in letters[marked]]
            where = (place + scale * u)[marked]
            axis.scatter(*where.T, c=colours, s=14, zorder=3, edgecolors="0.2", linewidths=0.3)
            axis.plot(*floor.T, color="0.15", lw=1.0, zorder=1)
        axis.set_xlim(low[0] - margin, high[0] + margin)
        axis.set_ylim(low[1] - margin, high[1] + margin)
        axis.set(aspect="equal", xticks=[], yticks=[])
        axis.set_title(title, fontsize=8)
        axis.spines[:].set_visible(False)
    letters = {k for s in seen for part in s["contact"] for k in part[2]}
    present = [k for k in STATUS_NAMES if k in letters]
    marks = [
        plt.Line2D([], [], marker="o", ls="", color=STATUS_COLOURS[k], label=STATUS_NAMES[k])
        for k in present
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


def _around(cells: Any) -> Any:
    """Cells with their vertices in cyclic order: quadrilaterals come as a tensor product."""
    return cells if cells.shape[1] == 3 else cells[:, [0, 1, 3, 2]]
