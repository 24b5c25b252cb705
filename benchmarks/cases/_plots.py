# SPDX-License-Identifier: LGPL-3.0-or-later
"""Maps of words over two axes."""

import numpy as np

from dolfinx_contact.plot.figures import FILLS

COLUMNS = 4


def draw_maps(file, x, y, maps, names, *, lines=(), labels=("", "")):
    """Draw maps over the same axes with one legend; only on this rank.

    Args:
        file: file of the picture, in any format of matplotlib.
        x: abscissae of the cells, shape (n,).
        y: ordinates of the cells, shape (m,).
        maps: words of the cells (n, m) by title.
        names: legend of the words; their order gives the colours.
        lines: curves ((x, y), word) that are drawn in every map.
        labels: labels of the axes, TeX between dollars.

    Raises:
        KeyError: if a word has no name.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    columns = min(COLUMNS, len(maps))
    rows = -(-len(maps) // columns)
    size = 6.4 if len(maps) == 1 else 2.6
    figure = Figure(figsize=(size * columns, size * rows + 0.9), layout="constrained")
    FigureCanvasAgg(figure)
    numbers = {word: i for i, word in enumerate(names)}
    colours = {word: FILLS[i % len(FILLS)] for word, i in numbers.items()}
    look = dict(cmap=ListedColormap(list(colours.values())), vmin=-0.5, vmax=len(names) - 0.5)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    present = {word for _, word in lines}
    for axes in grid.flat[len(maps) :]:
        axes.set_axis_off()
    for axes, (title, cells) in zip(grid.flat, maps.items(), strict=False):
        words = np.asarray(cells, dtype=str)
        present |= set(words.ravel().tolist())
        codes = np.array([[numbers[word] for word in row] for row in words])
        axes.pcolormesh(x, y, codes.T, shading="nearest", **look)
        limits = dict(xlim=axes.get_xlim(), ylim=axes.get_ylim())
        for curve, word in lines:
            axes.plot(*curve, color=colours[word], lw=3)
        axes.set(**limits)
        axes.set_title(title, fontsize="medium")
    for axes in grid[-1]:
        axes.set_xlabel(labels[0])
    for axes in grid[:, 0]:
        axes.set_ylabel(labels[1])
    handles = [
        Patch(facecolor=colours[word], edgecolor="0.4", label=name)
        for word, name in names.items()
        if word in present
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(file, dpi=130)
    return file
