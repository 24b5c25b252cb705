# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of deformed bodies with their obstacles.

The visible part is gathered to rank 0: the boundary of a body in 3D (and its interior for a
section), the cells of a body in 2D, the contact surfaces and the obstacles. Rank 0 draws with
matplotlib in 2D and with PyVista in 3D.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._ufl import refuse_other_mesh
from dolfinx_contact._validate import number
from dolfinx_contact.io.fields import check_stress, of_cells, von_mises
from dolfinx_contact.io.outside import Outside, VertexMeans
from dolfinx_contact.plot.figures import Drawing, drawn_on_root, save
from dolfinx_contact.plot.scene import Look, Options, Scene, in_space, options_of, scene_of

if TYPE_CHECKING:
    from dolfinx_contact.equations.state import State
    from dolfinx_contact.problem import ContactProblem

__all__ = ["body_scene", "check_look", "draw_scene", "picture_of_body", "title_of"]

Array = npt.NDArray[np.float64]

_NOT_FINITE = " (grey: not a number)"


def _check_body(a: Arguments) -> None:
    a.file = None if a.file is None else Path(a.file)
    check_look(a)


def check_look(a: Arguments) -> None:
    """Validate the scale and the look of a picture or film of a problem. Not collective."""
    a.scale = number(a.scale, "the scale of the displacement")
    domain = a.problem.V.mesh
    options = options_of(domain.topology.dim, **a.look)
    if isinstance(options.field, ufl.core.expr.Expr):
        refuse_other_mesh(options.field, domain, "the field")


@collective("a picture", _check_body)
def picture_of_body(
    file: str | os.PathLike[str] | None,
    problem: ContactProblem,
    *,
    state: State | None = None,
    stress: Any = None,
    scale: float = 1.0,
    title: str | None = None,
    **look: Unpack[Look],
) -> Drawing | None:
    """Draw the deformed body with its obstacles and the rims of its contact surfaces. Collective.

    The rim of a slave surface is thick, that of a master thin. Plane obstacles are drawn as a
    rectangle below the body. Obstacles between the eye and the body are transparent.

    Args:
        file: ``.png``, ``.pdf`` or ``.svg`` (in 3D the latter two contain an image); None writes
            nothing.
        problem: contact problem.
        state: state to draw, default the current Functions.
        stress: 3 x 3 UFL stress (``material.full_stress(u)``), or one for each cell tag as in
            `write_fields`. The colours are the von Mises stress, averaged to the vertices.
        scale: factor of the displacement and of the motion of obstacles, default 1. Bodies that are
            drawn with a larger displacement overlap resting obstacles.
        title: title of the picture, default the name of the picture and the scale.
        look: field, view, section, arrows: see `Look`.

    Returns:
        On rank 0 the matplotlib ``Figure`` in 2D and the ``pyvista.Plotter`` in 3D, which can be
        changed and written again; None on other ranks. Close a plotter that is not needed.

    Raises:
        ModuleNotFoundError: on every rank, if matplotlib or PyVista is not installed.
        OSError: on every rank, if the file cannot be written; an existing file is then unchanged.
        RuntimeError: on every rank, if VTK needs a display and there is none.
        ValueError: on every rank, if an argument is not admissible or differs between ranks.

    Example:
        ::

            plot.picture_of_body("block.pdf", problem, stress=steel.full_stress(u), view="-y")
            plot.picture_of_body("drag.png", problem, clip="-y", arrows={"drag": (top, motion)})
    """
    options = options_of(problem.V.mesh.topology.dim, **look)
    with problem.at(state):
        scene = body_scene(problem, stress, scale, options, title_of("Deformed body", scale, title))

    def draw() -> Drawing:
        assert scene is not None
        drawing = draw_scene(scene, options)
        save(drawing, file)
        return drawing

    return drawn_on_root(problem.comm, draw)


def draw_scene(
    scene: Scene,
    options: Options,
    *,
    reach: Array | None = None,
    limits: tuple[float, float] | None = None,
    width: int = 1600,
) -> Drawing:
    """Draw a scene. Not collective.

    Args:
        scene: bodies and obstacles.
        options: options of the picture.
        reach: points that must be visible (k, 3), default bodies and obstacles.
        limits: ends of the colours, default those of the scene.
        width: approximate width in pixels, default 1600.
    """
    if reach is None:
        scene = scene.above(scene.x)
        reach = np.concatenate([scene.x, *(o.x for o in scene.obstacles)])
    if scene.x[:, 2].any():
        from dolfinx_contact.plot.in_3d import draw_3d

        return draw_3d(scene, options, reach, limits, width)
    from dolfinx_contact.plot.in_2d import draw_2d

    return draw_2d(scene, options, reach, limits, width)


def title_of(words: str, scale: float, title: str | None = None) -> str:
    """Title of a picture, which mentions a scale of the displacement other than 1."""
    if title is not None:
        return title
    scaled = "" if scale == 1 else f"displacement x {scale:g}"
    return ", ".join(word for word in (words, scaled) if word)


# -- gathering -----------------------------------------------------------------------------------


def body_scene(
    problem: ContactProblem, stress: Any, scale: float, options: Options, title: str
) -> Scene | None:
    """Gather bodies and obstacles at the current Functions. Collective.

    Args:
        problem: contact problem.
        stress: see `picture_of_body`.
        scale: factor of the displacement.
        options: options of the picture.
        title: title of the picture.

    Returns:
        The scene on rank 0, None on other ranks.
    """
    tags = check_stress(problem, stress)
    outside = Outside(problem)
    surface = outside.surface()
    state = outside.state()
    # the field at the local vertices
    label = ""
    local: dict[str, Array] = {}
    if options.field is None and stress is not None:
        label = "von Mises stress"
        stresses = stress if isinstance(stress, Mapping) else {None: stress}
        sizes = {tag: von_mises(stresses[tag]) for tag in sorted(stresses)}
        local["field"] = _means(outside.V, sizes, tags, quadrature_degree=2)
    elif isinstance(options.field, str):  # the displacement needs no projection
        label = options.field
    elif options.field is not None:
        label = getattr(options.field, "name", "field")
        vertices = {"quadrature_rule": "vertex"}
        local["field"] = _means(outside.V, {None: options.field}, None, **vertices)
    on_surface = outside.gather(local)
    inside = outside.inside(local) if options.clip is not None else {}
    if surface is None or state is None:
        return None

    def values(arrays: Mapping[str, Array], u: Array) -> Array | None:
        if not label:
            return None
        return arrays["field"] if local else np.linalg.norm(u, axis=1)

    field = values(on_surface, state.u)
    if field is not None and not np.isfinite(field).all():
        label += _NOT_FINITE
    scene = replace(scene_of(surface, state, scale), values=field, label=label, title=title)
    if inside:
        x = inside["x"] + scale * in_space(inside["u"])
        scene = replace(scene, inside=(x, inside["cells"], values(inside, inside["u"])))
    return scene


def _means(
    V: fem.FunctionSpace,
    scalars: Mapping[int | None, Any],
    tags: mesh.MeshTags | None,
    **rule: Any,
) -> Array:
    """Return the `VertexMeans` of a field; NaN where it is not finite. Collective."""
    everywhere = {tag: of_cells(e, V.mesh) for tag, e in scalars.items()}
    means = VertexMeans(V, everywhere, tags, **rule)()
    return np.asarray(np.where(np.isfinite(means), means, np.nan))
