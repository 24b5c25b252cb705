# SPDX-License-Identifier: LGPL-3.0-or-later
"""Draws an animation: ``python animate.py vibration PICTURE.gif``, as `render.py` draws pictures.

A program of its own like that one, with pickled data on standard input.
"""

from __future__ import annotations

import pickle
import sys
from typing import Any

import numpy as np

Data = dict[str, Any]

INK = "#22262b"


def vibration(data: Data, file: str) -> None:
    """One period of a vibration in the colours of the size of its displacement, over the body."""
    import imageio  # noqa: F401  by which PyVista writes animations
    import pyvista

    pyvista.OFF_SCREEN = True
    x = data["x"]
    cells = data["cells"]
    mode = data["real"] + 1j * data["imaginary"]
    loop = cells if cells.shape[1] == 3 else cells[:, [0, 1, 3, 2]]
    faces = np.insert(loop, 0, loop.shape[1], axis=1).reshape(-1)
    body = pyvista.PolyData(x, faces)
    rest = pyvista.PolyData(x, faces)
    largest = float(np.sqrt((np.abs(mode) ** 2).sum(axis=1)).max())
    plotter = pyvista.Plotter(off_screen=True, window_size=(800, 608), lighting="light kit")
    plotter.set_background("white")
    body.point_data["size"] = np.zeros(len(x))
    look: Data = dict(show_edges=True, edge_color=INK, edge_opacity=0.3, show_scalar_bar=False)
    plotter.add_mesh(body, scalars="size", clim=(0.0, largest), cmap="Spectral_r", **look)
    plotter.add_mesh(rest.extract_feature_edges(30.0), color=INK, line_width=1.0)
    plotter.add_text(str(data["title"]), position="upper_edge", font_size=11, color=INK)
    flat = bool(np.ptp(x[:, 2]) == 0)
    eye, up = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)) if flat else ((0.5, -1.0, 0.33), (0.0, 0.0, 1.0))
    centre = np.array(body.center)
    plotter.camera_position = [centre + 2.2 * body.length * np.array(eye), centre, up]
    plotter.open_gif(file, fps=12)
    for part in np.arange(data["frames"]) / data["frames"]:
        u = (mode * np.exp(2j * np.pi * part)).real
        body.points = x + u
        body.point_data["size"] = np.linalg.norm(u, axis=1)
        plotter.write_frame()
    plotter.close()


if __name__ == "__main__":
    kind, file = sys.argv[1:]
    try:
        {"vibration": vibration}[kind](pickle.load(sys.stdin.buffer), file)
    except ModuleNotFoundError as error:
        extra = "python3 -m pip install 'signorini-coulomb[output]'"
        sys.exit(f"{error.name} is not installed: {extra}")
