# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies in 3D, drawn with PyVista in a parallel projection."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._install import optional
from dolfinx_contact.plot.display import ensure_display
from dolfinx_contact.plot.figures import INK, LINES, with_unit
from dolfinx_contact.plot.in_2d import (
    FLOOR,
    NOT_FINITE,
    TINTS,
    around,
    connected_parts,
    field_label,
    finite_range,
    framed,
)
from dolfinx_contact.plot.look import Options
from dolfinx_contact.plot.scene import Scene

if TYPE_CHECKING:
    import pyvista

__all__ = ["draw_3d"]

Array = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]

_MANY = 20000  # number of facets from which on their edges would hide the colours
_RIM = dict(feature_edges=False, non_manifold_edges=False, manifold_edges=False)


def draw_3d(
    scene: Scene,
    options: Options,
    reach: Array,
    limits: Mapping[str, tuple[float, float]],
    width: int,
) -> pyvista.Plotter:
    """Draw bodies in 3D; arguments as of `draw_scene`. Actors have names such as ``"body"``."""
    pv = optional("pyvista", "pictures")
    ensure_display()
    names = list(scene.coloured) or [""]
    shape = (1, len(names))
    plotter = pv.Plotter(off_screen=True, shape=shape, lighting="light kit", border=False)
    plotter.set_background("white")
    length = 0.2 * float(np.linalg.norm(np.ptp(reach, axis=0)))
    arrows = {name: _scaled(arrow, length) for name, arrow in options.arrows.items()}
    points = np.concatenate([reach, *(p + k * v for p, v in arrows.values() for k in (0, 1))])
    low, high = framed(scene, options, points)
    if isinstance(options.zoom, float):
        # the outline of the points is smaller than that of their box
        corners = points.mean(axis=0) + (points - points.mean(axis=0)) / options.zoom
    else:
        corners = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
    for i, name in enumerate(names):
        plotter.subplot(0, i)
        eye = _draw_parts(plotter, scene, name, options, limits.get(name), points)
        _draw_arrows(plotter, options, arrows)
        _set_camera(plotter, corners, eye, options, width / len(names), len(names))
        if i == 0:
            place: dict[str, Any] = dict(position=(0.5, 0.96), viewport=True, font_size=13)
            title = plotter.add_text(scene.title, color=INK, name="title", **place)
            title.prop.justification_horizontal = "center"
            title.prop.justification_vertical = "center"
    # translucent facets in the order of their depth, otherwise some look like wedges; other ways
    # of anti-aliasing switch this off
    for renderer in plotter.renderers:
        renderer.enable_depth_peeling(10)
    plotter.enable_anti_aliasing("fxaa", all_renderers=True)
    return plotter


def _draw_parts(
    plotter: pyvista.Plotter,
    scene: Scene,
    name: str,
    options: Options,
    limits: tuple[float, float] | None,
    points: Array,
) -> Array:
    """Draw bodies, rims, obstacles and arrows; return the direction to the eye."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    eye = _eye(options, np.ptp(points, axis=0))

    def clipped(part: Any) -> Any:
        if options.clip is None:
            return part
        point, normal = options.clip
        return part.clip(normal=normal, origin=middle if point is None else point)

    # bodies in the colours of a field or of their connected parts; shading hardly changes colours
    style: dict[str, Any] = dict(smooth_shading=True, split_sharp_edges=True, feature_angle=35)
    style |= dict(specular=0.0, ambient=0.72, diffuse=0.32)
    if len(scene.cells) < _MANY:
        style |= dict(show_edges=True, edge_color=INK, edge_opacity=0.3, line_width=1.0)
    x, cells, values = scene.inside or (scene.x, scene.cells, scene.values)
    body = _surface(x, cells) if scene.inside is None else _solid(x, cells)
    body.point_data["part"] = connected_parts(cells, len(x)) % len(TINTS)
    for field, array in values.items():
        body.point_data[field] = array
    body = clipped(body)
    if scene.inside is not None:
        body = body.extract_surface()
    if name:
        shown = np.asarray(body.point_data[name])
        style |= dict(scalars=name, clim=limits or finite_range(shown), cmap=options.cmap)
        bar = dict(title=field_label(name, shown, options), color=INK, fmt="%.3g", n_labels=5)
        bar |= dict(position_x=0.28, width=0.44, position_y=0.02, height=0.08)
        bar |= dict(title_font_size=22, label_font_size=20)
        style |= dict(nan_color=NOT_FINITE, scalar_bar_args=bar)
    else:
        style |= dict(scalars="part", cmap=TINTS, clim=(-0.5, len(TINTS) - 0.5))
        style["show_scalar_bar"] = False
    plotter.add_mesh(body, name="body", **style)
    # rims of contact surfaces: thick for slaves, thin for masters
    rims = [(cells, 0.0025) for cells in scene.slaves]
    rims += [(cells, 0.0012) for cells in scene.masters]
    for i, (cells, radius) in enumerate(rims):
        rim = clipped(_surface(scene.x, cells).extract_feature_edges(**_RIM))
        if rim.n_points:
            plotter.add_mesh(rim.tube(radius=radius * size), color=INK, name=f"rim {i}")
    # obstacles, transparent where they are between the eye and the body
    for i, o in enumerate(scene.obstacles):
        # normals of one sense, whatever the order of the vertices of the facets
        patch = clipped(_surface(o.x, o.cells).compute_normals(consistent_normals=True))
        if not patch.n_points:
            continue
        is_through = bool(np.any(o.n @ eye > 0.05))
        look: dict[str, Any] = dict(opacity=0.3 if is_through else 0.75, specular=0.0, ambient=0.3)
        look |= dict(smooth_shading=True, split_sharp_edges=True)
        plotter.add_mesh(patch, color=FLOOR, name=f"obstacle {i}", **look)
        edges = patch.extract_feature_edges(30, non_manifold_edges=False, manifold_edges=False)
        if edges.n_points:
            plotter.add_mesh(edges, color="#7d858c", line_width=2.5, name=f"outline {i}")
    return eye


def _scaled(arrows: Array, length: float) -> Array:
    """Points and vectors (2, n, 3), the longest of which has a length in the picture."""
    longest = float(np.linalg.norm(arrows[1], axis=1).max())
    return np.stack([arrows[0], length / (longest or 1.0) * arrows[1]])


def _draw_arrows(plotter: pyvista.Plotter, options: Options, arrows: Mapping[str, Array]) -> None:
    """Draw the arrows of a look, with the magnitude of the longest one in the legend."""
    import pyvista as pv

    for i, (name, (points, vectors)) in enumerate(arrows.items()):
        cloud = pv.PolyData(points)
        cloud.point_data["vectors"] = vectors
        shape = pv.Arrow(tip_length=0.3, tip_radius=0.08, shaft_radius=0.03)
        glyphs = cloud.glyph(orient="vectors", scale="vectors", geom=shape)
        colour = LINES[i % len(LINES)]
        plotter.add_mesh(glyphs, color=colour, ambient=0.4, name=f"arrow {name}")
        longest = float(np.linalg.norm(options.arrows[name][1], axis=1).max())
        place: dict[str, Any] = dict(position=(0.02, 0.9 - 0.05 * i), viewport=True, font_size=12)
        plotter.add_text(f"{name} ({longest:.3g})", color=colour, name=f"label {name}", **place)


def _set_camera(
    plotter: pyvista.Plotter, corners: Array, eye: Array, options: Options, width: float, count: int
) -> None:
    """Look at points so that they fill the picture, and draw axes and a scale bar.

    Args:
        plotter: plotter.
        corners: points that must be visible (n, 3).
        eye: unit vector from the body to the eye.
        options: options of the picture.
        width: largest width of a panel in pixels.
        count: number of panels.
    """
    up = options.up
    if abs(eye @ up) > 0.99:  # seen from above or below: y points upwards
        up = np.eye(3)[1] if abs(eye[1]) < 0.9 else np.eye(3)[0]
    right = np.cross(up, eye) / np.linalg.norm(np.cross(up, eye))
    above = np.cross(eye, right)
    # the picture has a head for the title, and a foot for axes, colours and scale
    seen = np.stack([corners @ right, corners @ above], axis=1)
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide, tall = high - low
    head, foot, side = 70.0, 130.0, 30.0
    pixels = min((width - 2 * side) / wide, 1000.0 / tall)
    window = np.maximum([pixels * wide + 2 * side, pixels * tall + head + foot], [700, 450])
    plotter.window_size = round(count * window[0]), round(window[1])
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    centre = (low + high) / 2 + [0.0, (head - foot) / 2 / pixels]
    focus = centre[0] * right + centre[1] * above + (corners.mean(axis=0) @ eye) * eye
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
    plotter.add_text(with_unit(f"{length:g}", options.units[0]), position=place, **text)


def _eye(options: Options, extent: Array) -> Array:
    """Unit vector from the body to the eye."""
    if options.eye is not None:
        return options.eye
    up = options.up
    along = np.eye(3)[np.argmax(extent * (1 - np.abs(up)))]
    along = (along - (along @ up) * up) / np.linalg.norm(along - (along @ up) * up)
    across = np.cross(up, along)
    eye = 0.5 * along - across + 0.33 * up
    if options.clip is not None:
        n = options.clip[1]
        if abs(n @ up) > 0.9:  # a horizontal section is seen from above or below
            eye = 1.2 * n + 0.25 * along - 0.7 * across
        else:
            eye = n + 0.35 * np.cross(n, up) / np.linalg.norm(np.cross(n, up)) + 0.33 * up
    return np.asarray(eye / np.linalg.norm(eye))


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
