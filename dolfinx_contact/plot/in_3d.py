# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in 3D, drawn with PyVista in a parallel projection."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from typing import Any, TypeAlias

import numpy as np
import pyvista as pv

from dolfinx_contact._geometry import unit
from dolfinx_contact._install import optional
from dolfinx_contact.plot.figures import FLOOR, INK, LINES, NOT_FINITE
from dolfinx_contact.plot.in_2d import colours_of
from dolfinx_contact.plot.scene import Array, Cells, Scene, around

__all__ = ["draw_3d", "ensure_display"]

_UP = np.eye(3)[2]
_SHARP = 35.0  # angle between facets, in degrees, from which on their edge is sharp
_RIM = dict(non_manifold_edges=False, manifold_edges=False)
_HEAD, _FOOT, _SIDE = 70.0, 130.0, 30.0  # pixels for the title, axes and colour bar, and at a side
_AHEAD = 1e-3  # distance from the edges to the facets, relative to the picture
_TALL = 1000.0  # largest height of a body in pixels

#: Normals and points.
Planes: TypeAlias = list[tuple[Array, Array]]

#: Xvfb writes the number of its display to standard output. The shell waits until its standard
#: input is closed, which happens when this process ends in any way, and then ends Xvfb. Without
#: -noreset the server would restart, and refuse connections meanwhile, after its last client.
_SERVE = (
    "Xvfb -displayfd 1 -screen 0 1600x1200x24 -nolisten tcp -noreset 2>/dev/null & "
    "exec >&-; read _; kill $! 2>/dev/null"
)
_servers: list[subprocess.Popen[bytes]] = []


def draw_3d(
    scene: Scene, visible: Array, limits: tuple[float, float] | None, width: int
) -> pv.Plotter:
    """Draw bodies in 3D, see `draw_scene`. Actors have names such as ``"body"``."""
    ensure_display()
    plotter = pv.Plotter(off_screen=True, lighting="light kit", border=False)
    plotter.set_background("white")
    size = float(np.linalg.norm(np.ptp(visible, axis=0)))
    eye = scene.eye if scene.eye is not None else _default_eye(scene, np.ptp(visible, axis=0))
    frame = _frame(eye)
    ends = _draw_arrows(plotter, scene, visible)
    planes: Planes = []
    if scene.clip is not None:
        point, normal = scene.clip
        if point is None:  # through the middle of the bodies or of the detail
            inner = scene.x if scene.region is None else visible
            point = (inner.min(axis=0) + inner.max(axis=0)) / 2
        planes.append((normal, point))
    if scene.region is None:
        visible = np.concatenate([visible, ends])
    else:  # nothing is drawn under the title and the colour bar
        for axis in (*frame[:2], *-frame[:2]):
            planes.append((axis, np.max(visible @ axis) * axis))
    pixels = _set_camera(plotter, scene, visible, frame, width)
    _draw_body(plotter, scene, limits, planes, pixels, _AHEAD * size * eye)
    _draw_surfaces(plotter, scene, eye, size, planes)
    plotter.add_text(scene.title, position="upper_edge", color=INK, font_size=13, name="title")
    # translucent facets in the order of their depth, otherwise some look like wedges; other ways
    # of anti-aliasing switch this off
    plotter.renderer.enable_depth_peeling(10)
    plotter.enable_anti_aliasing("fxaa")
    return plotter


def _draw_body(
    plotter: pv.Plotter, scene: Scene, limits: Any, planes: Planes, pixels: float, ahead: Array
) -> None:
    """Draw bodies in the colours of a field or of their connected parts, with edges.

    Args:
        plotter: plotter.
        scene: bodies and obstacles.
        limits: ends of the colours, default those of the scene.
        planes: normals and points of planes, in front of which nothing is drawn; the first one is
            the section, if there is one.
        pixels: number of pixels per length.
        ahead: translation of the edges to the eye, so that they are in front of the facets.
    """
    values, colours, ends = colours_of(scene.cells, len(scene.x), scene.values, limits)
    whole = (_facets if scene.clip is None else _solid)(scene.x, scene.cells)
    whole["field"] = values
    body = _clipped(whole, planes).extract_surface()
    # edges of all cells, or sharp ones and those of the section
    every = scene.shows_edges(pixels)
    edges = _clipped(_edges(whole.extract_surface(), every), planes)
    if scene.clip is not None:
        normal, point = planes[0]
        section = whole.slice(normal=normal, origin=point)
        edges = edges.merge(_clipped(_edges(section, every), planes[1:]))
    if edges.n_points:
        look = dict(opacity=0.3, line_width=1.0) if every else dict(opacity=1.0, line_width=1.5)
        plotter.add_mesh(edges.translate(ahead), color=INK, lighting=False, name="edges", **look)
    # shading hardly changes the colours
    style: dict[str, Any] = dict(smooth_shading=True, split_sharp_edges=True, feature_angle=_SHARP)
    style |= dict(specular=0.0, ambient=0.72, diffuse=0.32)
    bar = dict(title=f"{scene.label}\n", color=INK, fmt="%.3g", n_labels=5, title_font_size=22)
    bar |= dict(position_x=0.28, width=0.44, position_y=0.02, height=0.08, label_font_size=20)
    style |= dict(scalars="field", cmap=colours, clim=ends, nan_color=NOT_FINITE)
    with_bar = scene.values is not None
    plotter.add_mesh(body, name="body", show_scalar_bar=with_bar, scalar_bar_args=bar, **style)


def _draw_surfaces(
    plotter: pv.Plotter, scene: Scene, eye: Array, size: float, planes: Planes
) -> None:
    """Draw the rims of contact surfaces, and the obstacles."""
    # the rims of contact surfaces: thick for slaves, thin for masters
    rims = [(cells, 0.0025) for cells in scene.slaves] + [
        (cells, 0.0012) for cells in scene.masters
    ]
    for i, (cells, radius) in enumerate(rims):
        rim = _facets(scene.x, cells).extract_feature_edges(feature_edges=False, **_RIM)
        rim = _clipped(rim, planes)
        if rim.n_points:
            plotter.add_mesh(rim.tube(radius=radius * size), color=INK, name=f"rim {i}")
    words = "\n\nblack: rims of the contact surfaces" if rims else ""  # below the title
    plotter.add_text(words, position="upper_edge", font_size=9, color=INK, name="legend")
    # obstacles, transparent where they are between the eye and the body
    for i, o in enumerate(scene.obstacles):
        # normals of one sense, whatever the order of the vertices of the facets
        patch = _facets(o.x, o.cells).compute_normals(consistent_normals=True)
        patch = _clipped(patch, planes)
        if not patch.n_points:
            continue
        look: dict[str, Any] = dict(opacity=0.3 if np.any(o.n @ eye > 0.05) else 0.75, ambient=0.3)
        look |= dict(smooth_shading=True, split_sharp_edges=True, specular=0.0)
        plotter.add_mesh(patch, color=FLOOR, name=f"obstacle {i}", **look)
        edges = patch.extract_feature_edges(30, **_RIM)
        if edges.n_points:
            plotter.add_mesh(edges, color="#7d858c", line_width=2.5, name=f"outline {i}")


def _draw_arrows(plotter: pv.Plotter, scene: Scene, visible: Array) -> Array:
    """Draw arrows, with the magnitude of the longest one of each name; return their ends."""
    ends = [np.zeros((0, 3))]
    shape = pv.Arrow(tip_length=0.3, tip_radius=0.08, shaft_radius=0.03)
    for i, (label, (points, vectors)) in enumerate(scene.scaled_arrows(visible).items()):
        cloud = pv.PolyData(points)
        cloud["vectors"] = vectors
        glyphs = cloud.glyph(orient="vectors", scale="vectors", geom=shape)
        name, colour = list(scene.arrows)[i], LINES[i % len(LINES)]
        plotter.add_mesh(glyphs, color=colour, ambient=0.4, name=f"arrow {name}")
        place: dict[str, Any] = dict(position=(0.02, 0.94 - 0.05 * i), viewport=True, font_size=12)
        plotter.add_text(label, color=colour, name=f"label {name}", **place)
        ends += [points, points + vectors]
    return np.concatenate(ends)


def _edges(facets: Any, every: bool) -> Any:
    """Return the edges of facets: every one, or sharp ones and those of the boundary."""
    return facets.extract_all_edges() if every else facets.extract_feature_edges(_SHARP, **_RIM)


def _clipped(data: Any, planes: Planes) -> Any:
    """Return a mesh without the parts in front of planes."""
    for normal, point in planes:
        data = data.clip(normal=normal, origin=point)
    return data


def _frame(eye: Array) -> Array:
    """Return the unit vectors to the right, upwards and towards the viewer, shape (3, 3)."""
    up = _UP if abs(eye @ _UP) < 0.99 else np.eye(3)[1]  # seen from above y points upwards
    right = unit(np.cross(up, eye))
    return np.stack([right, np.cross(eye, right), eye])


def _set_camera(
    plotter: pv.Plotter, scene: Scene, points: Array, frame: Array, width: float
) -> float:
    """Look at points so that they fill the picture, and draw axes and a scale bar.

    Args:
        plotter: plotter.
        scene: bodies and obstacles.
        points: points that must be visible, shape (n, 3).
        frame: see `_frame`.
        width: largest width of the picture in pixels.

    Returns:
        Number of pixels per length.
    """
    right, _, eye = frame
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent = high - low
    tall = min(width - _HEAD - _FOOT, _TALL)
    pixels = min((width - 2 * _SIDE) / extent[0], tall / extent[1])
    window = np.maximum(pixels * extent[:2] + [2 * _SIDE, _HEAD + _FOOT], [700, 450])
    plotter.window_size = round(window[0]), round(window[1])
    depth = float(np.linalg.norm(np.ptp(np.concatenate([points, scene.x]), axis=0)))
    focus = (low + high) / 2 + [0.0, (_HEAD - _FOOT) / 2 / pixels, 0.0]
    plotter.camera_position = [focus @ frame + 3 * depth * eye, focus @ frame, frame[1]]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = window[1] / 2 / pixels
    plotter.camera.clipping_range = 0.01 * depth, 10 * depth
    plotter.add_axes(viewport=(0.0, 0.0, *(_FOOT / window)), line_width=3)
    # a scale bar of a round length, in front of everything at the lower right
    longest = 0.2 * window[0] / pixels
    lengths = 10.0 ** np.floor(np.log10(longest)) * np.array([1, 2, 5])
    length = lengths[lengths <= longest][-1]
    end = focus + np.array([window[0] / 2 - 40, 60 - window[1] / 2, 0.0]) / pixels
    end = end @ frame + 2 * depth * eye
    line = pv.Line(end - length * right, end)
    plotter.add_mesh(line, color=INK, line_width=5, name="scale bar")
    left = [window[0] - 40 - length * pixels, 30] / window
    words = f"{length:g} {scene.unit}".strip()
    look: dict[str, Any] = dict(viewport=True, font_size=10, color=INK, name="scale")
    plotter.add_text(words, position=left, **look)
    return float(pixels)


def _default_eye(scene: Scene, extent: Array) -> Array:
    """Return the unit vector from the body to the eye: obliquely from above, into a section."""
    along = np.eye(3)[np.argmax(extent[:2])]
    across = np.cross(_UP, along)
    if scene.clip is None:
        return unit(0.5 * along - across + 0.33 * _UP)
    n = scene.clip[1]
    if abs(n @ _UP) > 0.9:  # a horizontal section is seen from above or below
        return unit(1.2 * n + 0.25 * along - 0.7 * across)
    return unit(n + 0.35 * unit(np.cross(n, _UP)) + 0.33 * _UP)


def _facets(x: Array, cells: Cells) -> Any:
    """Triangles or quadrilaterals as a mesh of PyVista."""
    return pv.PolyData.from_regular_faces(x, around(cells))


def _solid(x: Array, cells: Cells) -> Any:
    """Return tetrahedra, or hexahedra in tensor order, as a PyVista mesh."""
    kind = pv.CellType.TETRA if cells.shape[1] == 4 else pv.CellType.HEXAHEDRON
    order = cells if cells.shape[1] == 4 else cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    return pv.UnstructuredGrid({kind: order}, x)


# -- display ---------------------------------------------------------------------------------------


def ensure_display() -> None:
    """Make sure that VTK can open a window, if need be on a virtual display. Not collective.

    VTK with X11 as its only window system (Debian's) aborts the process if it cannot connect to an
    X server. Therefore the connection is tried first, and Xvfb is started if it fails. With a
    display VTK renders well inside an MPI process. Other builds of VTK fall back to EGL or OSMesa.

    Raises:
        ModuleNotFoundError: if VTK is not installed.
        RuntimeError: if VTK needs an X server, and there is neither a display nor Xvfb.
    """
    optional("vtkmodules.vtkRenderingOpenGL2", "pictures")  # registers the class of windows
    window = optional("vtkmodules.vtkRenderingCore", "pictures").vtkRenderWindow()
    if window.GetClassName() != "vtkXOpenGLRenderWindow" or _connects():
        return
    number = b""
    if shutil.which("Xvfb"):
        stdin, _ = os.pipe()  # the kernel closes the other end when this process ends
        server = subprocess.Popen(
            ["sh", "-c", _SERVE], stdin=stdin, stdout=subprocess.PIPE, start_new_session=True
        )
        os.close(stdin)
        _servers.append(server)
        number = server.stdout.readline().strip() if server.stdout else b""
    if not number:
        raise RuntimeError("VTK needs a display to draw in 3D: install Xvfb, or set DISPLAY")
    os.environ["DISPLAY"] = f":{number.decode()}"


def _connects() -> bool:
    """Return whether the X server named by DISPLAY accepts connections."""
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    connection = x11.XOpenDisplay(None)
    if connection:
        x11.XCloseDisplay(ctypes.c_void_p(connection))
    return bool(connection)
