# SPDX-License-Identifier: LGPL-3.0-or-later
"""PNG pictures of a body and of its contact surfaces, without a display.

Only what is seen is gathered to rank 0: the boundary of a body in 3D, the body itself in 2D, the
contact surfaces. There a process of its own (`render.py`) draws it, because VTK without a display
may end its process. It gets a virtual display where xvfb-run is installed, else that of the caller,
else none, which is enough for some builds of VTK. A picture that cannot be drawn is a warning in
the log: no solve fails for want of it.
"""

from __future__ import annotations

import logging
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import same_everywhere
from dolfinx_contact._files import hidden_beside
from dolfinx_contact._numbers import is_number
from dolfinx_contact.io.fields import check_stress, von_mises
from dolfinx_contact.io.gathering import Arrays, gather_cells
from dolfinx_contact.io.outside import OuterSurface, Outside, SurfaceState
from dolfinx_contact.points.vertex_state import vertex_state
from dolfinx_contact.results.fields import STATUS_CODES

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import ContactSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["body_seen", "draw", "picture_of_body", "picture_of_contact", "surface_seen"]

logger = logging.getLogger(__name__)

_SECONDS = 120.0  # after which a picture is given up
_NOTHING = 1e-10  # of a force, what counts as none


def _check_body(a: Arguments) -> None:
    a.file = Path(a.file)
    a.scale = checked_scale(a.scale)


@collective("a picture", _check_body)
def picture_of_body(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    *,
    stress: Any = None,
    scale: float = 1.0,
    title: str | None = None,
) -> Path | None:
    """Draw the deformed body with its obstacles and the rims of its contact surfaces. Collective.

    Of a pair of bodies the rim of the slave is thick, that of the master thin.

    Args:
        file: the picture, ``.png``.
        problem: a contact problem, usually solved.
        stress: 3 x 3 UFL stress (``material.full_stress(u)``), of several materials one of each
            cell tag as for `write_fields`, for the colours: von Mises stress, averaged to the
            vertices.
        scale: factor of the displacement.
        title: above the picture.

    Returns:
        The file, on every rank; None where it could not be drawn.

    Raises:
        ValueError: on every rank, if the stress is not 3 x 3 or of another mesh, the scale is not
            finite, or arguments differ between ranks.
    """
    return draw(problem.comm, *body_seen(problem, stress, scale, title), Path(file))


def body_seen(
    problem: ContactProblem, stress: Any, scale: float, title: str | None
) -> tuple[str, dict[str, Any]]:
    """What a picture of the body shows, for rank 0: its kind and data. Collective.

    Arguments and errors are those of `picture_of_body`.
    """
    tags = check_stress(problem, stress)
    outside = Outside(problem)
    surface = outside.surface()
    state = outside.state()
    colours: Arrays = {}
    if stress is not None:
        averaged = outside.gather({"von_mises": _averaged(outside.V, stress, tags)})
        colours = {"von_mises": averaged["von_mises"]} if averaged else {}
    kind = f"body_{problem.V.mesh.topology.dim}d"
    if surface is None or state is None:
        return kind, {}
    words = title or _title(scale)
    return kind, {"title": words, **colours, **surface_seen(surface, state, scale)}


def surface_seen(surface: OuterSurface, state: SurfaceState, scale: float) -> dict[str, Any]:
    """What a picture shows of an outer surface at a state. Not collective.

    Args:
        surface: of the bodies.
        state: where they are.
        scale: factor of the displacement.
    """
    x = _in_space(surface.x + scale * _in_space(state.u))
    obstacles = [state.obstacles[name] for name in surface.obstacles]
    data: dict[str, Any] = {"x": x, "cells": surface.cells}
    data["contact_x"], data["contact_cells"] = _faces(x, surface.contact)
    data["master_x"], data["master_cells"] = _faces(x, surface.opposite)
    data["obstacle_x"] = [_in_space(floor + scale * moved) for floor, moved, _ in obstacles]
    data["obstacle_cells"] = list(surface.obstacles.values())
    data["obstacle_normals"] = [_in_space(n) for _, _, n in obstacles]
    return data


def _faces(
    x: npt.NDArray[np.float64], faces: Mapping[str, npt.NDArray[np.int64]]
) -> tuple[list[npt.NDArray[np.float64]], list[npt.NDArray[np.int64]]]:
    """Vertices of each of some faces, and its facets by these."""
    vertices = []
    facets = []
    for cells in faces.values():
        nodes, places = np.unique(cells, return_inverse=True)
        vertices.append(x[nodes])
        facets.append(places.reshape(cells.shape))
    return vertices, facets


def _check_contact(a: Arguments) -> None:
    a.file = Path(a.file)
    known = a.surface is None or any(a.surface is s for s in a.problem.surfaces)
    if not known:
        name = getattr(a.surface, "name", a.surface)
        raise ValueError(f"the surface {name!r} is not one of the problem")


@collective("a picture", _check_contact)
def picture_of_contact(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    *,
    surface: ContactSurface | None = None,
    title: str | None = None,
) -> Path | None:
    """Draw pressure, shear and status of a contact surface. Collective.

    In 3D two maps of the surface, projected along its mean normal; in 2D the tractions and the
    friction bound against the position along the surface. Status and values are those of the
    vertices (`ContactProblem.contact_fields`).

    Args:
        file: the picture, ``.png``.
        problem: a contact problem, usually solved.
        surface: one of its surfaces, by default the first.
        title: above the picture.

    Returns:
        The file, on every rank; None where it could not be drawn.

    Raises:
        ValueError: on every rank, if the surface is not one of the problem, or arguments differ
            between ranks.
    """
    s = problem.surfaces[0] if surface is None else surface
    same_everywhere(problem.comm, surface=s.name)
    fields = problem.contact_fields(s)
    pressure = fields["pressure"].x.array
    status = fields["status"].x.array
    at_vertices = vertex_state(s)
    normal = at_vertices["n"]
    traction = fields["traction"].x.array.reshape(-1, s.dim)
    # What supports hold is not contact; and where nothing is pressed round-off would be all to see.
    carries = (status != STATUS_CODES["d"]) & _is_seen(problem, s, traction)
    values = {
        "pressure": np.where(carries, pressure, 0.0),
        "status": status,
        "shear": np.where(carries[:, None], traction + pressure[:, None] * normal, 0.0),
        "bound": at_vertices["bound"],
        "n": s.points.vertex_normals,
    }
    cells = s.points.vertices.dofmap.list[: s.submesh.mesh.topology.index_map(s.dim - 1).size_local]
    seen = gather_cells(s.comm, s.points.vertices, cells, values)
    data: dict[str, Any] = {"title": title or f"Contact surface: {s.name}"}
    data["body"] = "slave" if s.between_bodies else "body"
    # So are nodes that a crack has not doubled, and those that have nothing opposite.
    data["clamped"] = "without contact" if s.between_bodies else "clamped"
    if s.comm.rank == 0:
        axes, labels = _flat_axes(seen["n"].mean(axis=0), s.dim)
        shear = seen["shear"] @ axes
        data |= {**seen, "x": seen["x"][:, : s.dim] @ axes, "labels": labels}
        data["shear"] = shear if s.dim == 3 else shear[:, 0]
        codes = np.bincount(seen["status"].astype(int), minlength=len(set(STATUS_CODES.values())))
        data["counts"] = codes
    return draw(s.comm, f"contact_{s.dim}d", data, Path(file))


# -- what is seen --------------------------------------------------------------------------------


def checked_scale(scale: Any) -> float:
    """The factor of a displacement as a number, or ``ValueError``. Not collective."""
    if not (is_number(scale) and np.isfinite(scale)):
        raise ValueError(f"the scale of the displacement must be a finite number, got {scale!r}")
    return float(scale)


def _title(scale: float) -> str:
    return "Deformed body" if scale == 1 else f"Deformed body, displacement x {scale:g}"


def _in_space(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Three components."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _averaged(
    V: fem.FunctionSpace, stress: Any, tags: mesh.MeshTags | None
) -> npt.NDArray[np.float64]:
    """Means of the von Mises stress around the local vertices, weighted by their hat functions.

    Args:
        V: of the vertices.
        stress: UFL, or UFL by cell tags.
        tags: of cells, for the latter.
    """
    q = ufl.TestFunction(V)
    dx = ufl.Measure("dx", V.mesh, subdomain_data=tags, metadata={"quadrature_degree": 2})
    if tags is None:
        whole = von_mises(stress) * q * dx
    else:
        whole = sum(von_mises(stress[tag]) * q * dx(tag) for tag in sorted(stress))
    sums = []
    for form in (whole, q * dx):
        b = la.vector(V.dofmap.index_map, 1)
        b.array[:] = 0.0
        fem.assemble_vector(b.array, fem.form(form))
        b.scatter_reverse(la.InsertMode.add)
        b.scatter_forward()
        sums.append(b.array.copy())
    return np.asarray(sums[0] / sums[1])


def _is_seen(
    problem: ContactProblem, s: ContactSurface, traction: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Local vertices of a surface at which tractions (n, dim) are more than round-off. Collective.

    That of a body's forces is the round-off of its stiffness times its displacement.
    """
    u = s.comm.allreduce(float(np.max(np.abs(s.u.x.array), initial=0.0)), op=max)
    force = np.linalg.norm(traction, axis=1) * s.points.vertex_areas
    return np.asarray(force > _NOTHING * problem.equations.stiffness_scale * u)


def _flat_axes(n: npt.NDArray[np.float64], dim: int) -> tuple[npt.NDArray[np.float64], list[str]]:
    """Axes (dim, dim - 1) of the plane across ``n`` with labels: coordinate axes if nearly one."""
    size = np.linalg.norm(n)
    names = "xyz"[:dim]
    n = n / size if size > 0.1 else np.eye(dim)[-1]  # a closed surface has no side to look at
    across = np.abs(n) < 0.05
    if across.sum() == dim - 1:
        return np.eye(dim)[:, across], [name for name, a in zip(names, across, strict=True) if a]
    if dim == 2:
        return np.array([[-n[1]], [n[0]]]), ["position along the surface"]
    first = np.eye(3)[np.argmin(np.abs(n))]
    first = first - (first @ n) * n
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(first, n)], axis=1), ["along the surface", "across"]


# -- drawing -------------------------------------------------------------------------------------


def draw(
    comm: MPI.Comm, kind: str, data: Mapping[str, Any], file: Path, *, count: int = 1
) -> Path | None:
    """Draw on rank 0; whether it worked is known on every rank. Collective.

    Args:
        comm: communicator.
        kind: what, a function of `render.py`.
        data: that it shows, of rank 0.
        file: the picture.
        count: of pictures in the file, each of which has its time.
    """
    failure = _draw_apart(kind, data, file, _SECONDS * count) if comm.rank == 0 else None
    failure = comm.bcast(failure)
    if failure is None:
        return file
    if comm.rank == 0:
        logger.warning("no picture %s: %s", file, failure)
    return None


def _draw_apart(kind: str, data: Mapping[str, Any], file: Path, seconds: float) -> str | None:
    """Draw in a process of its own; why it failed, or None."""
    in_space = "body_3d" in (kind, data.get("kind"))
    part = hidden_beside(file)
    source = Path(__file__).with_name("render.py")
    program = [*_display(needed=in_space), sys.executable, str(source), kind, str(part)]
    try:
        # A file and no pipe: PETSc takes the SIGPIPE of a reader that dies for an error of its own.
        with tempfile.TemporaryFile() as stream, tempfile.TemporaryFile() as messages:
            pickle.dump(dict(data), stream)
            stream.seek(0)
            streams: dict[str, Any] = dict(stdin=stream, stdout=messages, stderr=messages)
            code = _run(program, seconds, streams)
            messages.seek(0)
            lines = messages.read().decode(errors="replace").strip().splitlines()
        if code == 0:
            part.replace(file)
            return None
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    finally:
        with suppress(OSError):  # the reason is known by then
            for left in file.parent.glob(f"{part.name}*"):
                left.unlink()
    last = lines[-1] if lines else ""
    # A shell, as xvfb-run is, adds 128 to the number of a signal.
    signalled = -code if code < 0 else code - 128
    if signalled > 0:
        return (
            f"the drawing process was ended by signal {signalled}, as VTK does without a display "
            f"(install Xvfb, or set DISPLAY). {last}"
        )
    return last or f"the drawing process returned {code}"


def _display(*, needed: bool) -> list[str]:
    """What a program is run by that may need a display: a virtual one where that is installed."""
    if not needed or shutil.which("xvfb-run") is None:
        return []
    screen = "-screen 0 1600x1200x24 -nolisten tcp"
    return ["xvfb-run", "--auto-servernum", f"--server-args={screen}"]


def _run(program: Sequence[str], seconds: float, streams: Mapping[str, Any]) -> int:
    """Run a program, which ends with all that it began; its code.

    Raises:
        subprocess.TimeoutExpired: if it takes longer.
    """
    process = subprocess.Popen(program, start_new_session=True, **streams)
    try:
        return process.wait(seconds)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
