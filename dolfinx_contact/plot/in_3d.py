# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in 3D, drawn with PyVista in a parallel projection."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonDataModel import vtkPlane, vtkPlaneCollection

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import tangential, unit
from dolfinx_contact._install import optional
from dolfinx_contact.plot.figures import FLOOR, INK, LINES, NOT_FINITE, around
from dolfinx_contact.plot.scene import Scene
from dolfinx_contact.results.outer_surface import Cells

__all__ = ["draw_3d", "ensure_display"]

_UP = np.eye(3)[2]
_SHARP = 35.0  # smallest angle between facets at a sharp edge, in degrees
_RIM = dict(non_manifold_edges=False, manifold_edges=False)
_HEAD, _FOOT, _SIDE = 60.0, 130.0, 30.0  # pixels for the title, axes and colour bar, and at a side
_SLACK = 10.0  # width in pixels of the drawn margin around the visible points
_AHEAD = 1e-3  # distance from the edges to the facets, relative to the picture
_TALL = 1000.0  # largest height of a body in pixels

#: Point and normal of a plane.
Plane: TypeAlias = tuple[Array, Array]

#: Xvfb writes the number of its display to standard output. The shell waits until its standard
#: input is closed, which happens when this process ends in any way, and then ends Xvfb. Without
#: -noreset the server would restart, and refuse connections meanwhile, after its last client.
_SERVE = (
    "Xvfb -displayfd 1 -screen 0 1600x1200x24 -nolisten tcp -noreset 2>/dev/null & "
    "exec >&-; read _; kill $! 2>/dev/null"
)
_servers: list[subprocess.Popen[bytes]] = []


def draw_3d(scene: Scene, width: int) -> pv.Plotter:
    """Draw a scene in 3D (`draw_scene`). Actors have names such as ``"body"``."""
    ensure_display()
    plotter = pv.Plotter(off_screen=True, lighting="light kit", border=False)
    plotter.set_background("white")
    eye = _default_eye(scene) if scene.view.eye is None else scene.view.eye
    up = _UP if abs(eye @ _UP) < 0.99 else np.eye(3)[1]  # seen from above y points upwards
    right = unit(np.cross(up, eye))
    frame = np.stack([right, np.cross(eye, right), eye])
    pixels = _set_camera(plotter, scene, frame, width)
    ahead = _AHEAD * float(np.linalg.norm(np.ptp(scene.visible, axis=0))) * eye
    section = _section(scene)
    _draw_body(plotter, scene, section, scene.shows_edges(pixels), ahead)
    _draw_surfaces(plotter, scene, eye)
    _draw_arrows(plotter, scene)
    # nothing in front of the section, under the title and the colour bar, and at the sides
    seen = scene.visible
    planes = [
        ((np.max(seen @ axis) + _SLACK / pixels) * axis, axis) for axis in (*frame[:2], *-frame[:2])
    ]
    if section is not None:
        planes.append((section[0] + 2 * ahead, section[1]))
    _hide(plotter, planes)
    _draw_scale(plotter, scene.view.units.get("length", ""), frame, pixels)
    plotter.add_text(scene.title, position="upper_edge", color=INK, font_size=13, name="title")
    # translucent facets in the order of their depth, otherwise some look like wedges; other ways
    # of anti-aliasing switch this off
    plotter.renderer.enable_depth_peeling(number_of_peels=10)
    plotter.enable_anti_aliasing("fxaa")
    return plotter


# -- bodies and obstacles --------------------------------------------------------------------------


def _draw_body(
    plotter: pv.Plotter,
    scene: Scene,
    section: Plane | None,
    every: bool,
    ahead: Array,
) -> None:
    """Draw bodies with edges, coloured by a field or, without a field, by connected part.

    Args:
        plotter: plotter to which the bodies are added.
        scene: bodies and obstacles.
        section: point and normal of the plane of a section; None for no section.
        every: whether the edges of all cells are drawn; otherwise only sharp edges and edges of the
            section.
        ahead: vector by which edges are moved towards the viewer, so that facets do not hide them.
    """
    values, colours, ends = scene.colours()
    whole = (_facets if section is None else _solid)(scene.x, scene.cells)
    whole["field"] = values
    # shading hardly changes the colours
    style: dict[str, Any] = dict(smooth_shading=True, split_sharp_edges=True, feature_angle=_SHARP)
    style |= dict(specular=0.0, ambient=0.72, diffuse=0.32, show_scalar_bar=False)
    style |= dict(scalars="field", cmap=colours, clim=ends, nan_color=NOT_FINITE)
    body = whole if section is None else whole.clip(origin=section[0], normal=section[1])
    plotter.add_mesh(body, name="body", **style)
    if scene.values is not None:
        _add_colour_bar(plotter, scene.label, ends)
    edges = _edges(whole, every)
    if section is not None:
        # slightly behind the section, which passes through vertices of symmetric meshes
        point, normal = section
        cut = whole.slice(origin=point - 0.1 * np.linalg.norm(ahead) * normal, normal=normal)
        edges = edges.merge(_edges(cut, every))
    if edges.n_points:
        look = dict(opacity=0.3, line_width=1.0) if every else dict(opacity=1.0, line_width=1.5)
        plotter.add_mesh(edges.translate(ahead), color=INK, lighting=False, name="edges", **look)


def _add_colour_bar(plotter: pv.Plotter, label: str, ends: tuple[float, float]) -> None:
    """Add a colour bar with round numbers for the mesh that was drawn last."""
    from matplotlib.ticker import MaxNLocator

    low, high = ends
    many = 5 if 1e-3 <= max(-low, high) < 1e5 else 3  # fewer labels with exponents, which are wide
    ticks = MaxNLocator(many, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    ticks = ticks[(low <= ticks) & (ticks <= high)]
    look: dict[str, Any] = dict(color=INK, fmt="%.6g", title_font_size=22)
    look |= dict(position_x=0.27, width=0.46, position_y=0.02, height=0.08, label_font_size=20)
    bar = plotter.add_scalar_bar(title=f"{label}\n", **look)
    bar.SetCustomLabels(pv.convert_array(ticks, deep=True))
    bar.SetUseCustomLabels(True)


def _draw_surfaces(plotter: pv.Plotter, scene: Scene, eye: Array) -> None:
    """Draw the rims of contact surfaces, and the obstacles, transparent in front of the body.

    The unit vector ``eye`` points from the body to the viewer.
    """
    # the rims of contact surfaces: thick for slaves, thin for masters
    size = float(np.linalg.norm(np.ptp(scene.visible, axis=0)))
    rims = [(cells, 0.0025 * size) for cells in scene.slaves]
    rims += [(cells, 0.0012 * size) for cells in scene.masters]
    for i, (cells, radius) in enumerate(rims):
        rim = _facets(scene.x, cells).extract_feature_edges(feature_edges=False, **_RIM)
        if rim.n_points:
            plotter.add_mesh(rim.tube(radius=radius), color=INK, name=f"rim {i}")
    # obstacles, transparent where they are between the eye and the body
    for i, o in enumerate(scene.obstacles):
        # consistent normals, independent of the order of the vertices of the facets
        patch = _facets(o.x, o.cells).compute_normals(consistent_normals=True)
        look: dict[str, Any] = dict(opacity=0.3 if np.any(o.n @ eye > 0.05) else 0.75, ambient=0.3)
        look |= dict(smooth_shading=True, split_sharp_edges=True, specular=0.0)
        plotter.add_mesh(patch, color=FLOOR, name=f"obstacle {i}", **look)
        edges = _edges(patch, every=False)
        if edges.n_points:
            plotter.add_mesh(edges, color="#7d858c", line_width=2.5, name=f"outline {i}")


def _draw_arrows(plotter: pv.Plotter, scene: Scene) -> None:
    """Draw the arrows of a scene, with their legends at the upper left of the picture."""
    shape = pv.Arrow(tip_length=0.3, tip_radius=0.08, shaft_radius=0.03)
    for i, (label, (points, vectors)) in enumerate(scene.view.arrows.items()):
        cloud = pv.PolyData(points)
        cloud["vectors"] = vectors
        glyphs = cloud.glyph(orient="vectors", scale="vectors", geom=shape)
        name, colour = label.rpartition(" (")[0], LINES[i % len(LINES)]
        plotter.add_mesh(glyphs, color=colour, ambient=0.4, name=f"arrow {name}")
        place: dict[str, Any] = dict(position=(0.02, 0.94 - 0.05 * i), viewport=True, font_size=12)
        plotter.add_text(label, color=colour, name=f"label {name}", **place)


def _facets(x: Array, cells: Cells) -> Any:
    """Return triangles or quadrilaterals as a PyVista mesh."""
    return pv.PolyData.from_regular_faces(x, around(cells))


def _solid(x: Array, cells: Cells) -> Any:
    """Return tetrahedra, or hexahedra in tensor order, as a PyVista mesh."""
    kind = pv.CellType.TETRA if cells.shape[1] == 4 else pv.CellType.HEXAHEDRON
    order = cells if cells.shape[1] == 4 else cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    return pv.UnstructuredGrid({kind: order}, x)


def _edges(cells: Any, every: bool) -> Any:
    """Return the edges of a mesh: all (``every``), or only sharp edges and boundary edges."""
    if every:
        return cells.extract_all_edges()
    return cells.extract_feature_edges(feature_angle=_SHARP, **_RIM)


def _section(scene: Scene) -> Plane | None:
    """Return a point, by default in the middle, and the normal of the section, or None."""
    if scene.view.clip is None:
        return None
    point, normal = scene.view.clip
    if point is None:
        inner = scene.x if scene.view.region is None else scene.visible
        point = (inner.min(axis=0) + inner.max(axis=0)) / 2
    return point, normal


def _hide(plotter: pv.Plotter, planes: Sequence[Plane]) -> None:
    """Hide the parts of all meshes that lie on the positive side of any of the planes."""
    hidden = vtkPlaneCollection()
    for point, normal in planes:
        plane = vtkPlane()
        plane.SetOrigin(point)
        plane.SetNormal(-normal)
        hidden.AddItem(plane)
    for actor in plotter.actors.values():
        if isinstance(actor, pv.Actor):
            actor.mapper.SetClippingPlanes(hidden)


# -- camera ----------------------------------------------------------------------------------------


def _default_eye(scene: Scene) -> Array:
    """Return the default unit vector from the body to the viewer.

    The viewer looks obliquely from above; with a section, onto the cut.
    """
    wide, deep, _ = np.ptp(scene.x, axis=0)
    along = np.eye(3)[int(deep > 1.1 * wide)]
    oblique = 0.5 * along - np.cross(_UP, along) + 0.33 * _UP
    if scene.view.clip is None:
        return unit(oblique)
    _, normal = scene.view.clip
    return unit(normal + 0.6 * tangential(oblique, normal))


def _set_camera(plotter: pv.Plotter, scene: Scene, frame: Array, width: float) -> float:
    """Place the camera so that the bodies fill the picture; return the pixels per length.

    Args:
        plotter: plotter whose camera is placed.
        scene: bodies and obstacles.
        frame: unit vectors to the right, upwards and towards the viewer, shape (3, 3).
        width: largest width of the picture in pixels.
    """
    seen = scene.visible @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent = high - low
    tall = min(width - _HEAD - _FOOT, _TALL)
    pixels = min((width - 2 * _SIDE) / extent[0], tall / extent[1])
    window = np.maximum(pixels * extent[:2] + [2 * _SIDE, _HEAD + _FOOT], [700, 450])
    plotter.window_size = round(window[0]), round(window[1])
    focus = (low + high) / 2 + np.array([0.0, (_HEAD - _FOOT) / 2 / pixels, 0.0])
    everything = np.concatenate([scene.visible, scene.x, *(o.x for o in scene.obstacles)])
    depth = float(np.linalg.norm(np.ptp(everything, axis=0)))
    eye = focus @ frame + 3 * depth * frame[2]
    plotter.camera_position = [eye, focus @ frame, frame[1]]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = window[1] / 2 / pixels
    plotter.camera.clipping_range = 0.01 * depth, 10 * depth
    plotter.add_axes(viewport=(0.0, 0.0, *(_FOOT / window)), line_width=3)
    return float(pixels)


def _draw_scale(plotter: pv.Plotter, unit_of_length: str, frame: Array, pixels: float) -> None:
    """Draw a scale bar with a round length at the lower right, in front of everything.

    Args:
        plotter: plotter with its camera.
        unit_of_length: unit of length in the label.
        frame: unit vectors to the right, upwards and towards the viewer, shape (3, 3).
        pixels: number of pixels per length.
    """
    window = np.array(plotter.window_size)
    longest = 0.2 * window[0] / pixels
    lengths = 10.0 ** np.floor(np.log10(longest)) * np.array([1, 2, 5])
    length = lengths[lengths <= longest][-1]
    end = np.array([window[0] / 2 - 40, 60 - window[1] / 2, 0.0]) / pixels @ frame
    end += (2 * np.array(plotter.camera.position) + plotter.camera.focal_point) / 3
    line = pv.Line(pointa=end - length * frame[0], pointb=end)
    plotter.add_mesh(line, color=INK, line_width=5, name="scale bar")
    left = [window[0] - 40 - length * pixels, 30] / window
    look: dict[str, Any] = dict(viewport=True, font_size=10, color=INK, name="scale")
    plotter.add_text(f"{length:g} {unit_of_length}".strip(), position=left, **look)


# -- display ---------------------------------------------------------------------------------------


def ensure_display() -> None:
    """Ensure that VTK can open a window, if necessary on a virtual display. Not collective.

    A VTK whose only window system is X11, such as Debian's, aborts the process if it cannot connect
    to an X server. Therefore the connection is tried first, and Xvfb is started if it fails. With a
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
