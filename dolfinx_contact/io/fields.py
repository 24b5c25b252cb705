# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields on the body and on its contact surfaces, for ParaView.

On the body: the displacement, the Cauchy stress and the von Mises stress
(3/2 dev s : dev s)^(1/2), both linear and discontinuous. On each contact surface, a mesh of its own
so that it opens beside the body, what `ContactProblem.contact_fields` returns. A pair of bodies has
these on the slave, and what is known of the master (`master`) in another file.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._collective import collective
from dolfinx_contact._compat import interpolation_points
from dolfinx_contact._errors import everywhere, same_everywhere
from dolfinx_contact._forms import compiled_expression, is_of_cells
from dolfinx_contact._ufl_data import described, refuse_other_mesh
from dolfinx_contact.io.disk import aside
from dolfinx_contact.io.folder import output_folder
from dolfinx_contact.io.master import MasterFace
from dolfinx_contact.io.script import write_script
from dolfinx_contact.io.writers import FieldSeries, FieldsOfFile, Format, checked_format

if TYPE_CHECKING:
    from dolfinx_contact.equations.state import State
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = [
    "Face",
    "body_fields",
    "check_stress",
    "faces",
    "of_cells",
    "state_fields",
    "von_mises",
    "write_fields",
]

# Of the way from a corner of a cell to its middle; FFCx takes 1 - 1e-6 in its tables for 1.
_INSIDE = 1e-5


@collective("write_fields")
def write_fields(
    folder: str | os.PathLike[str],
    problem: ContactProblem,
    *,
    state: State | None = None,
    stress: Any = None,
    format: Format = None,
) -> list[Path]:
    """Write a state of a problem for ParaView. Collective.

    ``body.bp`` holds the displacement, ``body_stress.bp`` the stresses with the displacement of the
    vertices, and ``contact.bp`` (or ``contact_NAME.bp``, if a surface has another name) the fields
    of a contact surface; of a pair of bodies these are on the slave, and ``contact_opposite.bp``
    (``contact_NAME_opposite.bp``) holds those of the master. ``format="vtk"`` writes ``body.pvd``,
    ... instead, with a ``.vtu`` of each rank. The script ``paraview.py`` in the folder shows them:
    ``paraview --script=FOLDER/paraview.py``.

    Args:
        folder: where to, made if need be. Files of an earlier state are replaced when all of the
            new ones are complete.
        problem: contact problem.
        state: state to write; by default the Functions as they are.
        stress: 3 x 3 UFL stress, in 2D too: ``material.full_stress(u)``. Of several materials, in
            a bulk of integrals over cell tags, one of each tag: ``{1: steel.full_stress(u), 2:
            rubber.full_stress(u)}``. It is evaluated as given; whether it is the stress of the bulk
            is not checked. Without it no stresses are written.
        format: "vtx" (``.bp``) or "vtk" (``.pvd`` and ``.vtu``, for PyVista and every ParaView); by
            default "vtx" unless DOLFINx was built without ADIOS2.

    Returns:
        The names of the files, on every rank.

    Raises:
        OSError: on every rank, with the path and the reason, if a file cannot be written. Earlier
            files then remain.
        ValueError: on every rank, if the stress is not 3 x 3 or of another mesh, or does not have
            the cell tags of the bulk, two surfaces would have one file, the format cannot be
            written, or arguments differ between ranks.
    """
    tags = check_stress(problem, stress)
    comm = problem.comm
    kind = checked_format(problem.comm, format)
    path = output_folder(comm, folder)
    with problem.at(state) as shown, aside(comm, path, "write_fields") as part:
        fields = state_fields(shown, faces(shown), stress, tags)
        written = FieldSeries(part, path, kind)
        try:
            written.write(0.0, fields)
        finally:
            written.close()
        write_script(comm, part, path)
    return written.files


def state_fields(
    problem: ContactProblem,
    on_faces: Sequence[Face],
    stress: Any = None,
    tags: mesh.MeshTags | None = None,
    prefix: str = "",
) -> list[FieldsOfFile]:
    """What files have of the state in a problem's Functions. Collective.

    Args:
        problem: the problem.
        on_faces: its `faces`.
        stress: see `write_fields`.
        tags: as `check_stress` returned them.
        prefix: of the stems.

    Returns:
        The displacement, the stresses if they are wanted, and the fields of every face.
    """
    found = [FieldsOfFile(f"{prefix}body", problem.comm, [problem.u])]
    if stress is not None:
        u = problem.u
        stresses = [*body_fields(u, stress, tags), _at_corners(u)]
        found.append(FieldsOfFile(f"{prefix}body_stress", problem.comm, stresses))
    for face in on_faces:
        fields = list(face.fields(problem).values())
        found.append(FieldsOfFile(prefix + face.stem, face.comm, fields))
    return found


def _at_corners(u: fem.Function) -> fem.Function:
    """The displacement with the element of the stresses, so that these can be shown deformed."""
    domain = u.function_space.mesh
    f = fem.Function(fem.functionspace(domain, ("DG", 1, u.ufl_shape)), name="displacement")
    f.interpolate(u)
    return f


@dataclass(frozen=True)
class Face:
    """A face with a file of its own.

    Attributes:
        stem: of the file, without suffix.
        comm: of its mesh.
        fields: function of the problem: the fields on the face at the state in the Functions, by
            name. Collective.
    """

    stem: str
    comm: MPI.Comm
    fields: Callable[[ContactProblem], dict[str, fem.Function]]


def faces(problem: ContactProblem) -> list[Face]:
    """All faces: every surface, and after a pair its master. Collective.

    Raises:
        ValueError: if two would have one file.
    """
    found = []
    for s in problem.surfaces:
        name = re.sub(r"[^\w.-]+", "_", s.name)
        stem = "contact" if name == "contact" else f"contact_{name}"
        found.append(Face(stem, s.submesh.mesh.comm, partial(_surface_fields, s)))
        if s.between_bodies:
            master = MasterFace(problem, s)
            found.append(Face(f"{stem}_opposite", master.submesh.mesh.comm, master.fields))
    stems = [face.stem for face in found]
    if len(set(stems)) < len(stems):
        names = [s.name for s in problem.surfaces]
        raise ValueError(f"the names of contact surfaces make the same file: {names}")
    return found


def _surface_fields(s: DiscreteSurface, problem: ContactProblem) -> dict[str, fem.Function]:
    """The fields on a contact surface. Collective."""
    return problem.contact_fields(s)


def von_mises(stress: Any) -> Any:
    """UFL von Mises stress of a 3 x 3 UFL stress.

    Raises:
        ValueError: if the stress is not 3 x 3.
    """
    shape = getattr(stress, "ufl_shape", None)
    if shape != (3, 3):
        raise ValueError(
            f"the von Mises stress needs a 3 x 3 UFL stress, got {shape or stress!r}; in 2D pass "
            "material.full_stress(u), which knows the stress across the plane"
        )
    return ufl.sqrt(1.5 * ufl.inner(ufl.dev(stress), ufl.dev(stress)))


def check_stress(problem: ContactProblem, stress: Any) -> mesh.MeshTags | None:
    """Validate a stress. Collective.

    Returns:
        The cell tags of the bulk if the stress is given by cell tags.

    Raises:
        ValueError: on every rank, if it is not 3 x 3, of another mesh, does not have the cell tags
            of the bulk, or differs between ranks.
    """
    domain = problem.u.function_space.mesh
    by_tag = stress if isinstance(stress, Mapping) else {None: stress}
    with everywhere(problem.comm, "the stress"):
        for e in by_tag.values():
            if e is not None:
                von_mises(e)
                refuse_other_mesh(e, domain, "the stress")
    given = {tag: e if e is None else described(e, domain) for tag, e in by_tag.items()}
    same_everywhere(problem.comm, stress=sorted(given.items(), key=str))
    if not isinstance(stress, Mapping):
        return None
    integrals = problem.equations.bulk.residual.integrals_by_type("cell")
    data = [i.subdomain_data() for i in integrals]
    tags = next((d for d in data if isinstance(d, mesh.MeshTags)), None)
    if tags is None:
        raise ValueError(
            "a stress by cell tags needs a bulk with cell tags, ufl.Measure('dx', "
            "subdomain_data=cell_tags); for a bulk without them give one expression"
        )
    cells = domain.topology.index_map(domain.topology.dim)
    tagged = (set(tags.values.tolist()), int(np.sum(tags.indices < cells.size_local)))
    parts = problem.comm.allgather(tagged)
    known = set[int]().union(*(values for values, _ in parts))
    if known != set(stress) or sum(count for _, count in parts) < cells.size_global:
        raise ValueError(
            f"the stress has the cell tags {sorted(stress, key=str)}, the bulk {sorted(known)}; "
            "every cell needs one of them"
        )
    return tags


def body_fields(
    u: fem.Function, stress: Any, tags: mesh.MeshTags | None = None
) -> list[fem.Function]:
    """``stress`` and ``von_mises`` as discontinuous Functions of degree 1. Collective.

    Where conditions of the place make it jump between cells, each has the values of its own side.

    Args:
        u: the displacement.
        stress: UFL, or UFL by cell tags.
        tags: of cells, for the latter.

    Raises:
        ValueError: on every rank, if the stress is not a 3 x 3 UFL expression.
    """
    fields = []
    for name, shape, of in (("stress", (3, 3), lambda e: e), ("von_mises", (), von_mises)):
        W = fem.functionspace(u.function_space.mesh, ("DG", 1, shape))
        f = fem.Function(W, name=name)
        if tags is None:
            _interpolate(f, of(stress), None)
        else:
            for tag in sorted(stress):
                _interpolate(f, of(stress[tag]), tags.find(tag))
            f.x.scatter_forward()
        fields.append(f)
    return fields


def _interpolate(f: fem.Function, e: Any, cells: npt.NDArray[np.int32] | None) -> None:
    """Put an expression into a discontinuous Function of degree 1, in some cells or all."""
    W = f.function_space
    points = interpolation_points(W)
    by_cells = is_of_cells(e)
    if not (by_cells or _jumps_by_place(e)):
        f.interpolate(fem.Expression(e, points), cells0=cells)
        return
    # At a corner between two cells the condition has one answer for both. A little inside each
    # cell it has that of the cell.
    share = 1.0 if by_cells else _INSIDE
    inside = points + share * (points.mean(axis=0) - points)
    if cells is None:
        here = W.mesh.topology.index_map(W.mesh.topology.dim)
        cells = np.arange(here.size_local + here.num_ghosts, dtype=np.int32)
    dofs = W.dofmap.list[cells]
    size = W.dofmap.index_map_bs
    # A rank may have none of the cells.
    values = fem.Expression(e, inside).eval(W.mesh, cells).reshape(*dofs.shape, size)
    if not by_cells:
        middle = values.mean(axis=1, keepdims=True)
        values = middle + (values - middle) / (1 - _INSIDE)
    f.x.array.reshape(-1, size)[dofs] = values


def of_cells(e: Any, domain: mesh.Mesh) -> Any:
    """What is known at the middles of cells alone, as a Function of these; else the expression.

    Collective.

    Args:
        e: UFL.
        domain: its mesh.
    """
    if not is_of_cells(e):
        return e
    f = fem.Function(fem.functionspace(domain, ("DG", 0, e.ufl_shape)))
    dim = domain.topology.dim
    here = domain.topology.index_map(dim)
    cells = np.arange(here.size_local + here.num_ghosts, dtype=np.int32)
    values = compiled_expression(e, np.full((1, dim), 0.5)).eval(domain, cells)
    dofs = f.function_space.dofmap.list[cells, 0]
    f.x.array.reshape(-1, f.function_space.dofmap.index_map_bs)[dofs] = values.reshape(
        len(cells), -1
    )
    return f


def _jumps_by_place(e: Any) -> bool:
    """Whether a condition of the position is in an expression, as of a modulus of two parts."""
    conditions = (n for n in unique_pre_traversal(e) if isinstance(n, ufl.classes.Condition))
    return any(
        isinstance(node, ufl.classes.SpatialCoordinate)
        for condition in conditions
        for node in unique_pre_traversal(condition)
    )
