# SPDX-License-Identifier: LGPL-3.0-or-later
"""PNG pictures of a body and of its contact surfaces, without a display.

Only what is seen is gathered to rank 0: the boundary of a body in 3D, the body itself in 2D, the
contact surfaces. There a process of its own (`render.py`) draws it, because VTK without a display
may end its process. It gets a virtual display where xvfb-run is installed, else that of the caller,
else none, which is enough for some builds of VTK. A picture that cannot be drawn is a warning in
the log: no solve fails without it.
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
from typing import TYPE_CHECKING, Any, TypeAlias, Unpack

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la, mesh

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import same_everywhere
from dolfinx_contact._files import hidden_beside
from dolfinx_contact._ufl_data import refuse_other_mesh
from dolfinx_contact.io.fields import check_stress, of_cells, von_mises
from dolfinx_contact.io.gathering import Arrays, gather_cells
from dolfinx_contact.io.outside import OuterSurface, Outside, SurfaceState
from dolfinx_contact.laws.status import COLOURS, NAMES
from dolfinx_contact.plot.faces import (
    along_curve,
    flat_axes,
    is_straight,
    near_contact,
    spacing_of,
    turned_to,
)
from dolfinx_contact.plot.floors import lay_floors, moved_apart, on_plane, parts_of
from dolfinx_contact.plot.look import Look, checked_look, checked_scale, checked_units
from dolfinx_contact.results.fields import STATUS_CODES, contact_fields, vertex_state

if TYPE_CHECKING:
    from dolfinx_contact.equations.state import State
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = [
    "body_seen",
    "check_look",
    "draw",
    "magnified",
    "picture_of_body",
    "picture_of_contact",
    "surface_seen",
]

Floats: TypeAlias = npt.NDArray[np.float64]

logger = logging.getLogger(__name__)

#: Numbers beside `STATUS_CODES`, of slip in 2D with u_t < 0, and of slip that shows no sense.
_BACKWARD, _NO_SENSE = 4, 5
_OTHER_SLIP = "#999933"
_SECONDS = 120.0  # after which a picture is given up
_NOTHING = 1e-10  # of a force, what counts as none
_LITTLE = 1e-6  # of the largest traction, what is left of it where nothing touches


def _check_body(a: Arguments) -> None:
    a.file = Path(a.file)
    a.scale = checked_scale(a.scale)
    check_look(a)


def check_look(a: Arguments) -> None:
    """See that the look of a body can be drawn, or ``ValueError``. Not collective."""
    domain = a.problem.V.mesh
    known = checked_look(a.look, domain.topology.dim, stress=a.stress is not None)
    for name, e in known["fields"].items():
        if e is not None:
            refuse_other_mesh(e, domain, f"the field {name!r}")


@collective("a picture", _check_body)
def picture_of_body(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    *,
    state: State | None = None,
    stress: Any = None,
    scale: float = 1.0,
    title: str | None = None,
    **look: Unpack[Look],
) -> Path | None:
    """Draw the deformed body with its obstacles and the rims of its contact surfaces. Collective.

    Of a pair of bodies the rim of the slave is thick, that of the master thin. Plane obstacles are
    drawn where the body is, and let what is behind them be seen.

    Args:
        file: the picture, ``.png``; ``.pdf`` or ``.svg``, in which a plane body is drawn by lines,
            and one in 3D is a picture.
        problem: contact problem.
        state: state to draw; by default the Functions as they are.
        stress: 3 x 3 UFL stress (``material.full_stress(u)``), of several materials one of each
            cell tag as for `write_fields`, for the colours: von Mises stress, averaged to the
            vertices.
        scale: factor of the displacement and of the motion of obstacles, which is else where they
            are: a body that is drawn larger than it moves crosses them.
        title: above the picture; by default what it is, with the scale.
        look: ``fields``, ``view``, ``up``, ``clip``, ``zoom``, ``cmap``, ``apart``, ``units``: see
            `Look`.

    Returns:
        The file, on every rank; None where it could not be drawn.

    Raises:
        ModuleNotFoundError: on every rank, for a ``cmap`` without matplotlib.
        ValueError: on every rank, if the stress is not 3 x 3 or of another mesh, the scale is not
            finite, the look is none, or arguments differ between ranks.

    Example:
        ::

            plot.picture_of_body("block.pdf", problem, stress=steel.full_stress(u), view="front")
            plot.picture_of_body("inside.png", problem, fields="displacement", clip="-y")
    """
    with problem.at(state):
        kind, data = body_seen(problem, stress, scale, title, look)
    if data:
        lay_floors([data], problem.V.mesh.topology.dim)
    return draw(problem.comm, kind, data, Path(file))


def body_seen(
    problem: ContactProblem,
    stress: Any,
    scale: float,
    title: str | None,
    look: Mapping[str, Any],
) -> tuple[str, dict[str, Any]]:
    """What a picture of the body shows, for rank 0: its kind and data. Collective.

    Arguments and errors are those of `picture_of_body`.
    """
    tags = check_stress(problem, stress)
    dim = problem.V.mesh.topology.dim
    known = checked_look(look, dim, stress=stress is not None)
    outside = Outside(problem)
    surface = outside.surface()
    state = outside.state()
    values = {
        name: _averaged(outside.V, stress if e is None else e, tags if e is None else None, e)
        for name, e in known["fields"].items()
        if name != "displacement" or e is not None
    }
    numbered = {f"field {i}": v for i, v in enumerate(values.values())}
    averaged = outside.gather(numbered)
    inside = outside.inside(numbered) if known["clip"] is not None else {}
    kind = f"body_{dim}d"
    if surface is None or state is None:
        return kind, {}
    data = surface_seen(surface, state, scale, known["apart"])

    def colours(found: Arrays, u: npt.NDArray[Any]) -> Arrays:
        every = dict(zip(values, (found[k] for k in numbered), strict=True))
        size = np.linalg.norm(u, axis=1)
        return {name: every.get(name, size) for name in known["fields"]}

    data["colours"] = colours(averaged, state.u)
    if inside:
        x = inside["x"] + scale * inside["u"] + _off(surface, data["off"], inside)
        of_cells = colours(inside, inside["u"])
        data["inside"] = {"x": x, "cells": inside["cells"], "colours": of_cells}
    return kind, {"title": title or _title(scale), "look": known | {"fields": None}, **data}


def _off(surface: OuterSurface, off: Floats, inside: Arrays) -> Floats:
    """How far vertices inside of bodies are drawn apart, as those of their surface (n, 3)."""
    part = parts_of(inside["cells"], len(inside["x"]))
    places = np.searchsorted(inside["nodes"], surface.nodes)
    of_parts = np.zeros((part.max() + 1, 3))
    of_parts[part[places]] = off
    return np.asarray(of_parts[part])


def surface_seen(
    surface: OuterSurface, state: SurfaceState, scale: float, apart: float = 0.0
) -> dict[str, Any]:
    """What a picture shows of an outer surface at a state. Not collective.

    Args:
        surface: of the bodies.
        state: where they are.
        scale: factor of the displacement.
        apart: as of a `Look`.
    """
    x = _in_space(surface.x + scale * _in_space(state.u))
    obstacles = {name: state.obstacles[name] for name in surface.obstacles}
    normals = {name: _in_space(n) for name, (_, _, n) in obstacles.items()}
    off, off_obstacles = moved_apart(surface, x, normals, apart)
    data: dict[str, Any] = {"x": x + off, "cells": surface.cells, "off": off}
    data["part"] = parts_of(surface.cells, len(x))  # bodies that are not coloured differ in tint
    data["contact_x"], data["contact_cells"] = _faces(x + off, surface.contact)
    data["master_x"], data["master_cells"] = _faces(x + off, surface.opposite)
    data["obstacle_cells"] = list(surface.obstacles.values())
    data["obstacle_normals"] = list(normals.values())
    data["obstacle_x"] = []
    data["obstacle_flat"] = []
    for name, (floor, moved, _) in obstacles.items():
        points = _in_space(floor + scale * moved)
        on_it = x[np.unique(surface.contact[name])]
        # Of an obstacle with facets of its own those are drawn, flat or not.
        below = on_plane(points, normals[name], on_it) if len(on_it) == len(points) else None
        data["obstacle_flat"].append(below is not None)
        data["obstacle_x"].append((points if below is None else below) + off_obstacles[name])
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
    a.units = checked_units(a.units)
    known = a.surface is None or any(a.surface is s for s in a.problem.surfaces)
    if not known:
        name = getattr(a.surface, "name", a.surface)
        raise ValueError(f"the surface {name!r} is not one of the problem")


@collective("a picture", _check_contact)
def picture_of_contact(
    file: str | os.PathLike[str],
    problem: ContactProblem,
    *,
    surface: DiscreteSurface | None = None,
    state: State | None = None,
    title: str | None = None,
    units: tuple[str, str] = ("", ""),
) -> Path | None:
    """Draw pressure, shear and status of a contact surface. Collective.

    In 3D two maps of the surface, projected along the mean normal of what touches; in 2D the
    tractions and the friction bound over the length along the surface, or the coordinate if it is
    straight; of a law with bonds also the part of the shear that is friction, which the bound
    bounds. Where little of it touches or carries a traction, that and what is beside it are shown.
    Status and values are those of the vertices (`ContactProblem.contact_fields`).

    Args:
        file: the picture, ``.png``, ``.pdf`` or ``.svg``.
        problem: a contact problem, usually solved.
        surface: one of its surfaces, by default the first.
        state: state to draw; by default the Functions as they are.
        title: above the picture.
        units: of length and stress, for the labels.

    Returns:
        The file, on every rank; None where it could not be drawn.

    Raises:
        ValueError: on every rank, if the surface is not one of the problem, units are none, or
            arguments differ between ranks.
    """
    s = problem.surfaces[0] if surface is None else surface
    same_everywhere(problem.comm, surface=s.name)
    with problem.at(state) as shown:
        values = _contact_values(shown, s)
    bonded = s.law_at_points.compiled.bonded
    cells = s.points.vertices.dofmap.list[: s.submesh.mesh.topology.index_map(s.dim - 1).size_local]
    seen = gather_cells(s.comm, s.points.vertices, cells, values)
    data: dict[str, Any] = {"title": title or f"Contact surface: {s.name}", "units": units}
    data["bonded"] = bonded
    data["body"] = "slave" if s.between_bodies else "body"
    # So are nodes that a crack has not doubled, and those that have nothing opposite.
    inactive = "without contact" if s.between_bodies else "clamped"
    letters = "ok+d-" if s.dim == 2 else "oksd"
    names = NAMES | {"d": inactive}
    statuses = [(names[letter], COLOURS[letter]) for letter in letters]
    data["statuses"] = [*statuses, ("slip", _OTHER_SLIP)] if s.dim == 2 else statuses
    if s.comm.rank == 0:
        data |= seen | (_flat_curve(seen) if s.dim == 2 else _flat_surface(seen))
        codes = np.bincount(seen["status"].astype(int), minlength=len(data["statuses"]))
        data["counts"] = codes
    return draw(s.comm, f"contact_{s.dim}d", data, Path(file))


def _contact_values(problem: ContactProblem, s: DiscreteSurface) -> Arrays:
    """Values at the vertices of a surface, with a status of each colour. Collective."""
    number = problem.surfaces.index(s)
    found = problem.evaluate()
    fields = contact_fields(problem.equations, number, found)
    pressure = fields["pressure"].x.array
    status = fields["status"].x.array
    at_vertices = vertex_state(problem.equations, number, found)
    normal = at_vertices["n"]
    traction = fields["traction"].x.array.reshape(-1, s.dim)
    if s.dim == 2:
        # The two senses of slip have colours of their own, and so has slip that shows none.
        slips = status == STATUS_CODES["-"]
        plus, minus = at_vertices["plus"], at_vertices["minus"]
        status = np.where(slips & (minus > plus), _BACKWARD, status)
        status = np.where(slips & (plus == 0) & (minus == 0), _NO_SENSE, status)
    # What supports hold is not contact; and where nothing is pressed round-off would be all to see.
    carries = (status != STATUS_CODES["d"]) & _is_seen(problem, s, traction)
    values = {
        "pressure": np.where(carries, pressure, 0.0),
        "status": status,
        "shear": np.where(carries[:, None], traction + pressure[:, None] * normal, 0.0),
        "bound": at_vertices["bound"],
        "n": s.points.vertex_normals,
    }
    if s.law_at_points.compiled.bonded:
        adhesive = found.surfaces[number].answers.bond("traction")
        held = np.stack([s.points.at_vertices(t) for t in adhesive.T], axis=1)
        held -= np.sum(held * normal, axis=1)[:, None] * normal
        values["friction"] = values["shear"] - np.where(carries[:, None], held, 0.0)
    return values


# -- what is seen --------------------------------------------------------------------------------


def _title(scale: float) -> str:
    return ", ".join(["Deformed body", *magnified(scale)])


def magnified(scale: float) -> list[str]:
    """What a title tells of a scale of the displacement that is not 1, in a list."""
    return [] if scale == 1 else [f"displacement x {scale:g}"]


def _in_space(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Three components."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _flat_curve(seen: Arrays) -> dict[str, Any]:
    """Positions along a face in 2D, their label, the shear along it, and what is shown."""
    n = seen["n"]
    x = seen["x"][:, :2]
    touching = _touching(seen)
    vectors = {name: seen[name] for name in ("shear", "friction") if name in seen}
    if is_straight(x, seen["cells"]):
        edge = np.subtract(*x[seen["cells"][0]])
        across = np.array([-edge[1], edge[0]]) / np.linalg.norm(edge)
        axes, labels = flat_axes(across * np.sign(n.mean(axis=0) @ across), 2)
        at = x @ axes[:, 0]
        at_ends = at[seen["cells"]]
        along = {name: v @ axes[:, 0] for name, v in vectors.items()}
    else:
        at, at_ends, label = along_curve(x, seen["cells"], n, touching)
        labels = [label]
        along = {name: v[:, 1] * n[:, 0] - v[:, 0] * n[:, 1] for name, v in vectors.items()}
    near = near_contact(at, touching, float(np.abs(np.diff(at_ends)).mean()))
    return {"x": at, "ends": at_ends, "labels": labels, "near": near, **along}


def _flat_surface(seen: Arrays) -> dict[str, Any]:
    """The plane picture of a face in 3D, labels of its axes, the shear in it, and what is shown."""
    touching = _touching(seen)
    mean, cells = turned_to(seen["x"], seen["cells"], seen["n"], touching)
    axes, labels = flat_axes(mean, 3)
    nodes, places = np.unique(cells, return_inverse=True)
    flat = {name: seen[name][nodes] for name in ("pressure", "status", "bound")}
    x = seen["x"][nodes] @ axes
    cells = places.reshape(cells.shape)
    spacing = spacing_of(x, cells)
    near = [near_contact(x[:, k], touching[nodes], spacing) for k in range(2)]
    return flat | {
        "x": x,
        "cells": cells,
        "labels": labels,
        "shear": seen["shear"][nodes] @ axes,
        "near": near,
    }


def _touching(seen: Arrays) -> npt.NDArray[np.bool_]:
    """Vertices of a face where it sticks or slips, or a bond pulls."""
    closed = np.isin(seen["status"], [STATUS_CODES["k"], STATUS_CODES["s"], _BACKWARD, _NO_SENSE])
    size = np.hypot(seen["pressure"], np.linalg.norm(seen["shear"], axis=1))
    return np.asarray(closed | (size > _LITTLE * size.max(initial=0.0)))


def _averaged(
    V: fem.FunctionSpace, stress: Any, tags: mesh.MeshTags | None, scalar: Any = None
) -> npt.NDArray[np.float64]:
    """A field at the local vertices, NaN where it is not finite. Collective.

    A stress is the mean around a vertex, weighted by its hat function; a scalar the mean of what it
    is at the vertex in the cells around it, and so exact where it is continuous. Of a mean
    dilatation both are those of the cells.

    Args:
        V: of the vertices.
        stress: UFL, or UFL by cell tags, whose von Mises stress it is.
        tags: of cells, for the latter.
        scalar: UFL, which it is instead.
    """
    q = ufl.TestFunction(V)
    rule: dict[str, Any] = {"quadrature_degree": 2}
    if scalar is not None:
        # At the vertices a continuous field has its own values, which means would smear.
        rule = {"quadrature_rule": "vertex", "quadrature_degree": 1}
    dx = ufl.Measure("dx", V.mesh, subdomain_data=tags, metadata=rule)
    if scalar is not None:
        whole = of_cells(scalar, V.mesh) * q * dx
    elif tags is None:
        whole = of_cells(von_mises(stress), V.mesh) * q * dx
    else:
        parts = {tag: of_cells(von_mises(stress[tag]), V.mesh) for tag in sorted(stress)}
        whole = sum(size * q * dx(tag) for tag, size in parts.items())
    sums = []
    for form in (whole, q * dx):
        b = la.vector(V.dofmap.index_map, 1)
        b.array[:] = 0.0
        fem.assemble_vector(b.array, fem.form(form))
        b.scatter_reverse(la.InsertMode.add)
        b.scatter_forward()
        sums.append(b.array.copy())
    means = sums[0] / sums[1]
    return np.asarray(np.where(np.isfinite(means), means, np.nan))


def _is_seen(
    problem: ContactProblem, s: DiscreteSurface, traction: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Local vertices of a surface at which tractions (n, dim) are more than round-off. Collective.

    That of a body's forces is the round-off of its stiffness times its displacement.
    """
    u = s.comm.allreduce(float(np.max(np.abs(s.u.x.array), initial=0.0)), op=max)
    force = np.linalg.norm(traction, axis=1) * s.points.vertex_areas
    return np.asarray(force > _NOTHING * problem.equations.stiffness_scale * u)


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
