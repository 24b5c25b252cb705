# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in 3D, drawn with PyVista in a parallel projection."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import unit
from dolfinx_contact._install import optional
from dolfinx_contact.plot.figures import FIELD, FLOOR, INK, LINES, NOT_FINITE, TINTS
from dolfinx_contact.plot.in_2d import around, connected_parts
from dolfinx_contact.plot.scene import Options, Scene, finite_range

if TYPE_CHECKING:
    import pyvista

__all__ = ["draw_3d", "ensure_display"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

_UP = np.eye(3)[2]
_MANY = 20000  # number of facets from which on their edges would hide the colours
_RIM = dict(non_manifold_edges=False, manifold_edges=False)


#: Xvfb writes the number of its display to standard output. The shell waits until its standard
#: input is closed, which happens when this process ends in any way, and then ends Xvfb. Without
#: -noreset the server would restart, and refuse connections meanwhile, after its last client.
_SERVE = (
    "Xvfb -displayfd 1 -screen 0 1600x1200x24 -nolisten tcp -noreset 2>/dev/null & "
    "exec >&-; read _; kill $! 2>/dev/null"
)
_servers: list[subprocess.Popen[bytes]] = []


def draw_3d(
    scene: Scene, options: Options, reach: Array, limits: tuple[float, float] | None, width: int
) -> pyvista.Plotter:
    """Draw bodies in 3D; arguments as of `draw_scene`. Actors have names such as ``"body"``."""
    pv = optional("pyvista", "pictures")
    ensure_display()
    plotter = pv.Plotter(off_screen=True, lighting="light kit", border=False)
    plotter.set_background("white")
    length = 0.2 * float(np.linalg.norm(np.ptp(reach, axis=0)))
    ends = [_draw_arrows(plotter, options, name, length) for name in options.arrows]
    points = np.concatenate([reach, *ends])
    eye = _eye(options, np.ptp(points, axis=0))
    clip: dict[str, Array] = {}
    if options.clip is not None:
        point, normal = options.clip
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        clip = dict(normal=normal, origin=middle if point is None else point)
    _draw_body(plotter, scene, limits, clip)
    _draw_rims(plotter, scene, clip, float(np.linalg.norm(np.ptp(points, axis=0))))
    _draw_obstacles(plotter, scene, clip, eye)
    _set_camera(plotter, points, eye, width)
    place: dict[str, Any] = dict(position=(0.5, 0.96), viewport=True, font_size=13)
    title = plotter.add_text(scene.title, color=INK, name="title", **place)
    title.prop.justification_horizontal = "center"
    title.prop.justification_vertical = "center"
    # translucent facets in the order of their depth, otherwise some look like wedges; other ways
    # of anti-aliasing switch this off
    plotter.renderer.enable_depth_peeling(10)
    plotter.enable_anti_aliasing("fxaa")
    return plotter


def _draw_body(
    plotter: pyvista.Plotter,
    scene: Scene,
    limits: tuple[float, float] | None,
    clip: dict[str, Array],
) -> None:
    """Draw bodies in the colours of a field or of their connected parts."""
    # shading hardly changes the colours
    style: dict[str, Any] = dict(smooth_shading=True, split_sharp_edges=True, feature_angle=35)
    style |= dict(specular=0.0, ambient=0.72, diffuse=0.32, scalars="field")
    if len(scene.cells) < _MANY:
        style |= dict(show_edges=True, edge_color=INK, edge_opacity=0.3, line_width=1.0)
    x, cells, values = scene.inside or (scene.x, scene.cells, scene.values)
    body = _surface(x, cells) if scene.inside is None else _solid(x, cells)
    parts = connected_parts(cells, len(x)) % len(TINTS)
    body.point_data["field"] = parts if values is None else values
    if clip:
        body = body.clip(**clip).extract_surface()
    if values is None:
        style |= dict(cmap=TINTS, clim=(-0.5, len(TINTS) - 0.5), show_scalar_bar=False)
    else:
        bar = dict(title=scene.label, color=INK, fmt="%.3g", n_labels=5)
        bar |= dict(position_x=0.28, width=0.44, position_y=0.02, height=0.08)
        bar |= dict(title_font_size=22, label_font_size=20)
        style |= dict(clim=limits or finite_range(np.asarray(body.point_data["field"])))
        style |= dict(cmap=FIELD, nan_color=NOT_FINITE, scalar_bar_args=bar)
    plotter.add_mesh(body, name="body", **style)


def _draw_rims(plotter: pyvista.Plotter, scene: Scene, clip: dict[str, Array], size: float) -> None:
    """Draw the rims of contact surfaces: thick for slaves, thin for masters."""
    rims = [(cells, 0.0025) for cells in scene.slaves]
    rims += [(cells, 0.0012) for cells in scene.masters]
    for i, (cells, radius) in enumerate(rims):
        rim = _surface(scene.x, cells).extract_feature_edges(feature_edges=False, **_RIM)
        rim = rim.clip(**clip) if clip else rim
        if rim.n_points:
            plotter.add_mesh(rim.tube(radius=radius * size), color=INK, name=f"rim {i}")


def _draw_obstacles(
    plotter: pyvista.Plotter, scene: Scene, clip: dict[str, Array], eye: Array
) -> None:
    """Draw obstacles, transparent where they are between the eye and the body."""
    for i, o in enumerate(scene.obstacles):
        # normals of one sense, whatever the order of the vertices of the facets
        patch = _surface(o.x, o.cells).compute_normals(consistent_normals=True)
        patch = patch.clip(**clip) if clip else patch
        if not patch.n_points:
            continue
        is_through = bool(np.any(o.n @ eye > 0.05))
        look: dict[str, Any] = dict(opacity=0.3 if is_through else 0.75, specular=0.0, ambient=0.3)
        look |= dict(smooth_shading=True, split_sharp_edges=True)
        plotter.add_mesh(patch, color=FLOOR, name=f"obstacle {i}", **look)
        edges = patch.extract_feature_edges(30, **_RIM)
        if edges.n_points:
            plotter.add_mesh(edges, color="#7d858c", line_width=2.5, name=f"outline {i}")


def _draw_arrows(plotter: pyvista.Plotter, options: Options, name: str, length: float) -> Array:
    """Draw the arrows of a name, with the magnitude of the longest one in the legend.

    Args:
        plotter: plotter.
        options: options of the picture.
        name: name of the arrows.
        length: length of the longest arrow in the picture.

    Returns:
        Both ends of the arrows, shape (n, 3).
    """
    import pyvista as pv

    i = list(options.arrows).index(name)
    points, vectors = options.arrows[name]
    longest = float(np.linalg.norm(vectors, axis=1).max())
    cloud = pv.PolyData(points)
    cloud.point_data["vectors"] = length / (longest or 1.0) * vectors
    shape = pv.Arrow(tip_length=0.3, tip_radius=0.08, shaft_radius=0.03)
    glyphs = cloud.glyph(orient="vectors", scale="vectors", geom=shape)
    colour = LINES[i % len(LINES)]
    plotter.add_mesh(glyphs, color=colour, ambient=0.4, name=f"arrow {name}")
    place: dict[str, Any] = dict(position=(0.02, 0.9 - 0.05 * i), viewport=True, font_size=12)
    plotter.add_text(f"{name} ({longest:.3g})", color=colour, name=f"label {name}", **place)
    return np.concatenate([points, points + cloud.point_data["vectors"]])


def _set_camera(plotter: pyvista.Plotter, points: Array, eye: Array, width: float) -> None:
    """Look at points so that they fill the picture, and draw axes and a scale bar.

    Args:
        plotter: plotter.
        points: points that must be visible (n, 3).
        eye: unit vector from the body to the eye.
        width: largest width of the picture in pixels.
    """
    up = _UP if abs(eye @ _UP) < 0.99 else np.eye(3)[1]  # seen from above y points upwards
    right = unit(np.cross(up, eye))
    above = np.cross(eye, right)
    # the picture has a head for the title, and a foot for axes, colours and scale
    seen = np.stack([points @ right, points @ above], axis=1)
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide, tall = high - low
    head, foot, side = 70.0, 130.0, 30.0
    pixels = min((width - 2 * side) / wide, 1000.0 / tall)
    window = np.maximum([pixels * wide + 2 * side, pixels * tall + head + foot], [700, 450])
    plotter.window_size = round(window[0]), round(window[1])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    centre = (low + high) / 2 + [0.0, (head - foot) / 2 / pixels]
    focus = centre[0] * right + centre[1] * above + (points.mean(axis=0) @ eye) * eye
    plotter.camera_position = [focus + 3 * size * eye, focus, above]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = window[1] / 2 / pixels
    plotter.camera.clipping_range = 0.01 * size, 10 * size
    plotter.add_axes(viewport=(0.0, 0.0, 130 / window[0], 130 / window[1]), line_width=3)
    # a scale bar of a round length, in front of everything at the lower right
    step = 10.0 ** np.floor(np.log10(0.2 * window[0] / pixels))
    length = step * max(k for k in (1, 2, 5) if k * step <= 0.2 * window[0] / pixels)
    half = window / 2 / pixels
    end = focus + (half[0] - 40 / pixels) * right - (half[1] - 60 / pixels) * above + 2 * size * eye
    bar = optional("pyvista", "pictures").Line(end - length * right, end)
    plotter.add_mesh(bar, color=INK, line_width=5, name="scale bar")
    place = (1 - (40 + length * pixels) / window[0], 30 / window[1])
    text = dict(viewport=True, font_size=10, color=INK, name="scale")
    plotter.add_text(f"{length:g}", position=place, **text)


def _eye(options: Options, extent: Array) -> Array:
    """Unit vector from the body to the eye."""
    if options.eye is not None:
        return options.eye
    along = np.eye(3)[np.argmax(extent[:2])]
    across = np.cross(_UP, along)
    eye = 0.5 * along - across + 0.33 * _UP
    if options.clip is not None:
        n = options.clip[1]
        if abs(n @ _UP) > 0.9:  # a horizontal section is seen from above or below
            eye = 1.2 * n + 0.25 * along - 0.7 * across
        else:
            eye = n + 0.35 * unit(np.cross(n, _UP)) + 0.33 * _UP
    return unit(eye)


def _surface(x: Array, cells: Cells) -> Any:
    """Triangles or quadrilaterals as a mesh of PyVista."""
    import pyvista as pv

    loop = around(cells)
    return pv.PolyData(x, np.insert(loop, 0, loop.shape[1], axis=1).reshape(-1))


def _solid(x: Array, cells: Cells) -> Any:
    """Tetrahedra, or hexahedra in tensor order, as a mesh of PyVista."""
    import pyvista as pv

    is_tetrahedron = cells.shape[1] == 4
    order = cells if is_tetrahedron else cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    kind = pv.CellType.TETRA if is_tetrahedron else pv.CellType.HEXAHEDRON
    flat = np.insert(order, 0, order.shape[1], axis=1).reshape(-1)
    return pv.UnstructuredGrid(flat, np.full(len(cells), kind, dtype=np.uint8), x)


# -- display ---------------------------------------------------------------------------------------


def ensure_display() -> None:
    """Make sure that VTK can open a window, if need be on a virtual display. Not collective.

    VTK with X11 as its only window system (Debian's) aborts the process if it cannot connect to an
    X server. Therefore the connection is tried first, and Xvfb is started if it fails. With a
    display VTK renders well inside an MPI process; earlier versions of this package rendered in a
    second process because of the abort. Other builds of VTK fall back to EGL or OSMesa.

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
    """Return True if the X server that DISPLAY names accepts connections."""
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype = ctypes.c_void_p
    connection = x11.XOpenDisplay(None)
    if connection:
        x11.XCloseDisplay(ctypes.c_void_p(connection))
    return bool(connection)
