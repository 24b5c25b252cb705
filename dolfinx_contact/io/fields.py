# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields on the body and on its contact surfaces, for ParaView.

On the body: the displacement, the Cauchy stress and the von Mises stress
(3/2 dev s : dev s)^(1/2), both linear and discontinuous. On each contact surface, a mesh of its own
so that it opens beside the body, what `ContactProblem.contact_fields` returns. A pair of bodies has
these on the slave, and what is known of the master (`master`) in another file.
"""

from __future__ import annotations

import logging
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
from dolfinx import fem, la, mesh
from ufl.algorithms import expand_derivatives, extract_coefficients
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._agreement import described, refuse_other_mesh
from dolfinx_contact._collective import collective
from dolfinx_contact._compat import interpolation_points
from dolfinx_contact._errors import everywhere, same_everywhere
from dolfinx_contact._forms import compiled_expression, compiled_form, is_of_cells
from dolfinx_contact.io.disk import aside
from dolfinx_contact.io.folder import output_folder
from dolfinx_contact.io.master import MasterFace
from dolfinx_contact.io.script import write_script
from dolfinx_contact.io.several import FieldSeries, FieldsOfFile
from dolfinx_contact.io.writers import Format, checked_format

if TYPE_CHECKING:
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
_OFF = 0.01  # by which forces of a stress may be off, relative
_ALL_STRAINS = np.array([[1.0, 0.4, -0.3], [-0.6, 0.8, 0.5], [0.2, -0.7, 0.9]])  # a gradient
_BY_TAG = "stress={1: steel.full_stress(u), 2: rubber.full_stress(u)}"

logger = logging.getLogger(__name__)


@collective("write_fields")
def write_fields(
    folder: str | os.PathLike[str],
    problem: ContactProblem,
    *,
    stress: Any = None,
    format: Format = None,
) -> list[Path]:
    """Write the present state of a problem for ParaView. Collective.

    ``body.bp`` holds the displacement, ``body_stress.bp`` the stresses with the displacement of the
    vertices, and ``contact.bp`` (or ``contact_NAME.bp``, if a surface has another name) the fields
    of a contact surface; of a pair of bodies these are on the slave, and ``contact_opposite.bp``
    (``contact_NAME_opposite.bp``) holds those of the master. With ``format="vtk"`` it is
    ``body.vtu``, ... ``paraview.py`` beside them shows them: ``paraview
    --script=FOLDER/paraview.py``.

    Args:
        folder: where to, made if need be. Files of an earlier state are replaced when all of the
            new ones are complete.
        problem: a contact problem, usually solved.
        stress: 3 x 3 UFL stress, in 2D too: ``material.full_stress(u)``. Of several materials, in
            a bulk of integrals over cell tags, one of each tag: ``{1: steel.full_stress(u), 2:
            rubber.full_stress(u)}``; one for all is refused there, but for one with a Function
            that is constant in each cell, of which there is a warning where its forces are not
            those of a linear bulk. Without it no stresses are written.
        format: "vtx" (``.bp``) or "vtk" (``.vtu``, which PyVista and every ParaView read); by
            default "vtx" unless DOLFINx was built without ADIOS2.

    Returns:
        The names of the files, on every rank.

    Raises:
        OSError: on every rank, with the path and the reason, if the folder cannot be written to,
            or has no room. It is then as it was.
        ValueError: on every rank, if the stress is not 3 x 3 or of another mesh, is that of one
            material where the bulk has several, or has not its cell tags, two surfaces would have
            one file, the format cannot be written, or arguments differ between ranks.
    """
    tags = check_stress(problem, stress)
    comm = problem.comm
    kind = checked_format(problem.comm, format)
    state = state_fields(problem, faces(problem), stress, tags)
    path = output_folder(comm, folder)
    with aside(comm, path, "write_fields") as part:
        written = FieldSeries(comm, part, path, kind, single=True)
        try:
            written.write(0.0, state)
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
        found.append(FieldsOfFile(prefix + face.stem, face.comm, list(face.fields().values())))
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
        fields: what is known on it at the state in the problem's Functions, by name. Collective.
    """

    stem: str
    comm: MPI.Comm
    fields: Callable[[], dict[str, fem.Function]]


def faces(problem: ContactProblem) -> list[Face]:
    """All faces: every surface, and after a pair its master. Collective.

    Raises:
        ValueError: if two would have one file.
    """
    found = []
    for s in problem.surfaces:
        name = re.sub(r"[^\w.-]+", "_", s.name)
        stem = "contact" if name == "contact" else f"contact_{name}"
        found.append(Face(stem, s.submesh.mesh.comm, partial(problem.contact_fields, s)))
        if s.between_bodies:
            master = MasterFace(problem, s)
            found.append(Face(f"{stem}_opposite", master.submesh.mesh.comm, master.fields))
    stems = [face.stem for face in found]
    if len(set(stems)) < len(stems):
        names = [s.name for s in problem.surfaces]
        raise ValueError(f"the names of contact surfaces make the same file: {names}")
    return found


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
    """See that a stress, if there is one, can be that of a problem. Collective.

    Returns:
        The cell tags of the bulk if the stress is given tag by tag.

    Raises:
        ValueError: on every rank, if it is not 3 x 3, of another mesh, of one material of several,
            does not have the cell tags of the bulk, or differs between ranks.
    """
    compared: Any = None
    tags = None
    names = ""
    domain = problem.u.function_space.mesh
    with everywhere(problem.comm, "the stress"):
        if isinstance(stress, Mapping):
            tags = _cell_tags(problem)
        for e in _expressions(stress):
            von_mises(e)
            refuse_other_mesh(e, domain, "the stress")
        if tags is not None:
            wrong = [tag for tag in stress if not isinstance(tag, int | np.integer)]
            if wrong:
                raise ValueError(f"cell tags of a stress are whole numbers, not {wrong[0]!r}")
            compared = [(int(tag), described(stress[tag], domain)) for tag in sorted(stress)]
        elif stress is not None:
            names = _refuse_one_of_several(problem, stress)
            compared = described(stress, domain)
    same_everywhere(problem.comm, stress=compared)
    _doubt_pressures(problem, stress)
    if names:
        _doubt_forces(problem, stress, names)
    if tags is not None:
        _require_tags(domain, tags, {int(tag) for tag in stress})
    return tags


def _expressions(stress: Any) -> list[Any]:
    """One expression, or those of all tags."""
    if isinstance(stress, Mapping):
        return list(stress.values())
    return [] if stress is None else [stress]


def _cell_integrals(problem: ContactProblem) -> list[ufl.Integral]:
    return list(problem.equations.bulk.residual.integrals_by_type("cell"))


def _cell_tags(problem: ContactProblem) -> mesh.MeshTags:
    """The tags of the cells over whose parts the bulk is integrated, or ``ValueError``."""
    for integral in _cell_integrals(problem):
        tags = integral.subdomain_data()
        if isinstance(tags, mesh.MeshTags):
            return tags
    raise ValueError(
        "a stress by cell tags needs a bulk with cell tags, ufl.Measure('dx', "
        "subdomain_data=cell_tags); of a bulk without them give one expression"
    )


def _require_tags(domain: mesh.Mesh, tags: mesh.MeshTags, given: set[int]) -> None:
    """``ValueError`` on every rank if cells have no stress, or a stress no cells. Collective."""
    comm = domain.comm
    n = domain.topology.index_map(domain.topology.dim).size_local
    parts = comm.allgather((set(np.unique(tags.values).tolist()), int(np.sum(tags.indices < n))))
    known = set().union(*(found for found, _ in parts))
    if known != given:
        raise ValueError(f"the stress has the cell tags {sorted(given)}, the bulk {sorted(known)}")
    size = domain.topology.index_map(domain.topology.dim).size_global
    if sum(count for _, count in parts) < size:
        raise ValueError("the stress is given by cell tags, but some cells have none")


def _refuse_one_of_several(problem: ContactProblem, stress: Any) -> str:
    """``ValueError`` if a stress without parts is given for a bulk of several materials.

    Returns:
        The tags of these if the stress may be that of all of them, by a Function that is constant
        in each cell; else "".
    """
    materials: dict[Any, list[str]] = {}
    beside = False
    for integral in _strained(problem):
        names = integral.subdomain_id()
        for name in names if isinstance(names, tuple) else (names,):
            if name in ("everywhere", "otherwise"):
                beside = True
            else:
                materials.setdefault(name, []).append(_described(integral))
    different = {repr(sorted(forms)) for forms in materials.values()}
    if len(different) < 2 and not (beside and different):
        return ""
    tags = ", ".join(map(str, sorted(materials)))
    if any(f is not problem.u and _is_cellwise(f) for f in extract_coefficients(stress)):
        return tags
    raise ValueError(
        "the stress is that of one material, but the bulk has different integrals over cell "
        f"tags ({tags}): give one of each tag, {_BY_TAG}"
    )


def _doubt_pressures(problem: ContactProblem, stress: Any) -> None:
    """Warn if pressures are not those of the bulk, that of a mean dilatation or not. Collective."""
    by_tag = stress if isinstance(stress, Mapping) else {None: stress}
    for tag, e in by_tag.items():
        if e is None or problem.comm.rank > 0:
            continue
        bulk = [is_of_cells(i.integrand()) for i in _strained(problem) if _is_over(i, tag)]
        where = "" if tag is None else f" of the cell tag {tag}"
        if any(bulk) and not is_of_cells(e):
            logger.warning(
                "the pressure in the stress%s is that of every point, of which the body has the "
                "mean over each cell alone: it may be wrong by orders of magnitude where lambda is "
                "large, and shear is not; give material.mean_dilatation_stress(u)",
                where,
            )
        elif is_of_cells(e) and not any(bulk):
            logger.warning(
                "the stress%s is that of a mean dilatation, which the bulk has not: give "
                "material.full_stress(u)",
                where,
            )


def _is_over(integral: ufl.Integral, tag: int | None) -> bool:
    """Whether an integral is over the cells of a tag, or over all."""
    names = integral.subdomain_id()
    names = names if isinstance(names, tuple) else (names,)
    return tag is None or tag in names or bool({"everywhere", "otherwise"} & set(names))


def _doubt_forces(problem: ContactProblem, stress: Any, names: str) -> None:
    """Warn if the forces of a stress are not those of a linear bulk. Collective.

    Both are taken by their change with a displacement that has all strains, so that loads and the
    present state do not matter. Bodies of revolution are not checked.
    """
    bulk = problem.equations.bulk
    if not bulk.linear or problem.equations.axisymmetric:
        return
    V = problem.u.function_space
    v = ufl.TestFunction(V)
    dim = V.mesh.geometry.dim
    w = fem.Function(V)
    w.interpolate(lambda x: _ALL_STRAINS[:dim, :dim] @ x[:dim])
    strain = ufl.grad(v)

    def work(stress: Any) -> ufl.Form:
        parts = (stress[i, j] * strain[i, j] for i in range(dim) for j in range(dim))
        return sum(parts) * ufl.dx(domain=V.mesh)

    if is_of_cells(stress):
        there, at_rest = (ufl.replace(stress, {problem.u: f}) for f in (w, fem.Function(V)))
        of_stress = work(of_cells(there, V.mesh) - of_cells(at_rest, V.mesh))
    else:
        of_stress = ufl.derivative(work(stress), problem.u, w)
    of_bulk = ufl.derivative(ufl.Form(_strained(problem)), bulk.displacement, w)
    forces = []
    for form in (of_stress, of_bulk):
        b = fem.assemble_vector(compiled_form(expand_derivatives(form)))
        b.scatter_reverse(la.InsertMode.add)
        forces.append(b.array[: V.dofmap.index_map.size_local * V.dofmap.index_map_bs])
    squares = [np.sum((forces[0] - forces[1]) ** 2), np.sum(forces[1] ** 2)]
    off, size = problem.comm.allreduce(np.array(squares))
    if off > _OFF**2 * size and problem.comm.rank == 0:
        logger.warning(
            "the forces of the stress are not those of the bulk, of which they are off by %.2g: a "
            "Function that is constant in each cell is to tell the materials of the cell tags (%s) "
            "apart; or give one of each tag, %s",
            np.sqrt(off / size) if size else np.inf,
            names,
            _BY_TAG,
        )


def _strained(problem: ContactProblem) -> list[ufl.Integral]:
    """Integrals over cells that resist strains."""
    return [i for i in _cell_integrals(problem) if _has_strain(problem, i)]


def _is_cellwise(f: Any) -> bool:
    return bool(f.ufl_element().embedded_superdegree == 0)


def _has_strain(problem: ContactProblem, integral: ufl.Integral) -> bool:
    """Whether an integral resists a strain, as no load does."""
    u = problem.equations.bulk.displacement
    rate = expand_derivatives(ufl.derivative(ufl.Form([integral]), u))
    nodes = (n for i in rate.integrals() for n in unique_pre_traversal(i.integrand()))
    return any(isinstance(n, ufl.classes.Grad) for n in nodes)


def _described(integral: ufl.Integral) -> str:
    """An integrand with the values of its Constants and the Functions in it."""
    form = ufl.Form([integral.reconstruct(subdomain_id="everywhere", metadata={})])
    values = [np.asarray(c.value).tolist() for c in form.constants()]
    return f"{form.signature()} {values} {[id(f) for f in form.coefficients()]}"


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
