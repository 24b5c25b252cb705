# SPDX-License-Identifier: LGPL-3.0-or-later
"""Maps of what holds where, side by side with one legend."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dolfinx_contact.plot.curves import _FILLS, _figure, _written

__all__ = ["draw_panels"]

_COLUMNS = 4


def draw_panels(
    file: str | os.PathLike[str],
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    panels: Mapping[str, npt.ArrayLike],
    names: Mapping[str, str],
    *,
    labels: tuple[str, str] = ("", ""),
) -> Path:
    """Draw maps over the same axes; on this rank alone.

    Args:
        file: the picture, of any kind that matplotlib writes.
        x: abscissae of the cells (n,).
        y: their ordinates (m,).
        panels: by title what holds in each cell, words (n, m).
        names: of the words, for the legend; their order gives the colours.
        labels: of the axes, TeX between dollars.

    Raises:
        OSError: with the path, if it cannot be written; it is then as it was.
        ValueError: if cells are not (n, m), or a word has no name.
    """
    words = {title: np.asarray(cells, dtype=str) for title, cells in panels.items()}
    for title, cells in words.items():
        if cells.shape != (np.size(x), np.size(y)):
            raise ValueError(f"{title}: {np.size(x)} x {np.size(y)} cells, got {cells.shape}")
        if set(cells.ravel().tolist()) - set(names):
            raise ValueError(f"{title}: no names for {set(cells.ravel().tolist()) - set(names)}")
    columns = min(_COLUMNS, len(words))
    rows = -(-len(words) // columns)
    figure = _figure((2.6 * columns, 2.6 * rows + 0.9))
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colours = {word: _FILLS[i % len(_FILLS)] for i, word in enumerate(names)}
    numbers = {word: i for i, word in enumerate(names)}
    look = dict(cmap=ListedColormap(list(colours.values())), vmin=-0.5, vmax=len(names) - 0.5)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat[len(words) :]:
        axes.set_axis_off()
    for axes, (title, cells) in zip(grid.flat, words.items(), strict=False):
        codes = np.vectorize(numbers.__getitem__)(cells)
        axes.pcolormesh(x, y, codes.T, shading="nearest", **look)
        axes.set_title(title, fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel(labels[0])
    for axes in grid[:, 0]:
        axes.set_ylabel(labels[1])
    present = {word for cells in words.values() for word in cells.ravel().tolist()}
    handles = [
        Patch(facecolor=colours[word], edgecolor="0.4", label=name)
        for word, name in names.items()
        if word in present
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return _written(figure, file)
