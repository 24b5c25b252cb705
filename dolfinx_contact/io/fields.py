# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields on the bodies and on their contact surfaces, for ParaView.

Files of the body contain the displacement, the Cauchy stress s and the von Mises stress (3/2 dev s
: dev s)^(1/2). Both stresses are linear in each cell and discontinuous between cells. Each contact
surface, for a pair the slave surface, is a separate mesh with the fields of
`ContactProblem.contact_fields`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl.algorithms import extract_coefficients
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._arrays import Indices
from dolfinx_contact._compat import interpolation_points
from dolfinx_contact._forms import compiled_expression, is_of_cells
from dolfinx_contact._mpi import collective, everywhere, same_everywhere
from dolfinx_contact._ufl import described, refuse_other_mesh
from dolfinx_contact.io.writers import Format, Writer

if TYPE_CHECKING:
    from dolfinx_contact.equations.state import State
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = [
    "StateFields",
    "body_fields",
    "check_stress",
    "of_cells",
    "von_mises",
    "write_fields",
]

# Distance of evaluation points from a corner, relative to the distance to the middle of the cell.
# FFCx rounds entries of its tables within 1e-6 of 1 to 1.
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

    - ``body.bp``: displacement of the bodies.
    - ``body_stress.bp``: stresses, with the displacement of the vertices.
    - ``contact.bp``, or ``contact_NAME.bp`` if a surface has another name: fields of a contact
      surface; for a pair of bodies, on the slave surface.
    - ``paraview.py``: a script that shows these files, ``paraview --script=FOLDER/paraview.py``.

    With ``format="vtk"`` the files are ``body.pvd``, ..., with one ``.vtu`` file per rank.

    Args:
        folder: output folder, created if necessary. Files of an earlier state with the same names,
            in either format, are replaced when all new files are complete.
        problem: contact problem.
        state: state to write; default: present values of the Functions.
        stress: 3 x 3 UFL stress, also in 2D: ``material.full_stress(u)``. For several materials in
            integrals over cell tags, one stress per tag: ``{1: steel.full_stress(u), 2:
            rubber.full_stress(u)}``. Consistency with the bulk form is not checked. Default: no
            stresses are written.
        format: "vtx" (``.bp``) or "vtk" (``.pvd`` and ``.vtu``, readable by PyVista and every
            ParaView); default: "vtx" if DOLFINx was built with ADIOS2, otherwise "vtk".

    Returns:
        Paths of the files, on every rank.

    Raises:
        OSError: on every rank, with the path and the reason, if a file cannot be written. Earlier
            files then remain.
        ValueError: on every rank, if the stress is not valid (not 3 x 3, of another mesh or
            displacement, or without a cell tag of the bulk), two surfaces would be written to the
            same file, the format is not available, or arguments differ between ranks.
    """
    fields = StateFields(problem, stress)
    with Writer(problem.comm, folder, format) as writer, problem.at(state) as shown:
        writer.write(0.0, fields.at(shown))
    return writer.files


class StateFields:
    """Functions to be written: fields of the bodies and of all contact surfaces. Collective.

    Args:
        problem: contact problem.
        stress: UFL stress, see `write_fields`.

    Raises:
        ValueError: on every rank, if the stress is not valid, or two surfaces share a file.
    """

    def __init__(self, problem: ContactProblem, stress: Any = None):
        self._stress = stress
        self._tags = check_stress(problem, stress)
        self._surfaces: dict[str, DiscreteSurface] = {}
        for s in problem.surfaces:
            name = re.sub(r"[^\w.-]+", "_", s.name)
            stem = "contact" if name == "contact" else f"contact_{name}"
            if stem in self._surfaces:
                names = [s.name for s in problem.surfaces]
                raise ValueError(f"the names of contact surfaces make the same file: {names}")
            self._surfaces[stem] = s

    def at(self, problem: ContactProblem) -> dict[str, list[fem.Function]]:
        """Return the Functions of each file for the present state. Collective.

        Args:
            problem: problem with the state and the law of its step (`ContactProblem.at`).
        """
        u = problem.u
        own = u.copy()
        own.name = "displacement"
        found = {"body": [own]}
        if self._stress is not None:
            # the displacement in the element of the stresses, to show them deformed
            domain = u.function_space.mesh
            f = fem.Function(fem.functionspace(domain, ("DG", 1, u.ufl_shape)), name="displacement")
            f.interpolate(u)
            found["body_stress"] = [*body_fields(u, self._stress, self._tags), f]
        for stem, surface in self._surfaces.items():
            found[stem] = list(problem.contact_fields(surface).values())
        return found


def von_mises(stress: Any) -> Any:
    """Return the UFL von Mises stress of a 3 x 3 UFL stress.

    Raises:
        ValueError: if the stress is not 3 x 3.
    """
    shape = getattr(stress, "ufl_shape", None)
    if shape != (3, 3):
        raise ValueError(
            f"the von Mises stress needs a 3 x 3 UFL stress, got {shape or stress!r}; in 2D pass "
            "material.full_stress(u), which includes the out-of-plane stress"
        )
    return ufl.sqrt(1.5 * ufl.inner(ufl.dev(stress), ufl.dev(stress)))


def check_stress(problem: ContactProblem, stress: Any) -> mesh.MeshTags | None:
    """Validate a stress. Collective.

    Returns:
        Cell tags of the bulk if the stress is given by cell tags, otherwise None.

    Raises:
        ValueError: on every rank, if the stress is not 3 x 3, belongs to another mesh or
            displacement, lacks a cell tag of the bulk, or differs between ranks.
    """
    domain = problem.u.function_space.mesh
    by_tag = stress if isinstance(stress, Mapping) else {None: stress}
    with everywhere(problem.comm, "the stress"):
        for e in by_tag.values():
            if e is not None:
                von_mises(e)
                refuse_other_mesh(e, domain, "the stress")
                _refuse_other_displacement(e, problem.u)
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


def _refuse_other_displacement(stress: Any, u: fem.Function) -> None:
    """Raise ``ValueError`` if a stress without ``u`` contains a Function of the same element."""
    functions = extract_coefficients(stress)
    others = [f for f in functions if f.ufl_element() == u.ufl_element() and f is not u]
    if others and u not in functions:
        raise ValueError(
            f"the stress depends on the Function {others[0].name!r}, not on the displacement of "
            "the problem: pass material.full_stress(problem.u)"
        )


def body_fields(
    u: fem.Function, stress: Any, tags: mesh.MeshTags | None = None
) -> list[fem.Function]:
    """Return Functions ``stress`` and ``von_mises``, discontinuous of degree 1. Collective.

    If the stress contains a UFL conditional that depends on the position and jumps between cells,
    each cell gets the limits from its interior.

    Args:
        u: displacement.
        stress: UFL stress, or UFL stresses by cell tag.
        tags: cell tags for stresses by tag.

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


def _interpolate(f: fem.Function, e: Any, cells: Indices | None) -> None:
    """Interpolate an expression into a DG1 Function, in all (None) or some local cells."""
    W = f.function_space
    e = of_cells(e, W.mesh)
    points = interpolation_points(W)
    if not _jumps_by_place(e):
        f.interpolate(fem.Expression(e, points), cells0=cells)
        return
    # At a corner the condition has the same value for all adjacent cells; slightly inside a cell it
    # has the value of the cell.
    inside = points + _INSIDE * (points.mean(axis=0) - points)
    if cells is None:
        index_map = W.mesh.topology.index_map(W.mesh.topology.dim)
        cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    dofs = W.dofmap.list[cells]
    size = W.dofmap.index_map_bs
    # A rank may have none of the cells.
    values = fem.Expression(e, inside).eval(W.mesh, cells).reshape(*dofs.shape, size)
    middle = values.mean(axis=1, keepdims=True)
    f.x.array.reshape(-1, size)[dofs] = middle + (values - middle) / (1 - _INSIDE)


def of_cells(e: Any, domain: mesh.Mesh) -> Any:
    """Return an expression that can be evaluated at any point of a cell. Collective.

    An expression defined only at the midpoints of cells is interpolated to DG0.

    Args:
        e: UFL expression; returned unchanged if it is defined everywhere.
        domain: mesh of the expression.
    """
    if not is_of_cells(e):
        return e
    W = fem.functionspace(domain, ("DG", 0, e.ufl_shape))
    f = fem.Function(W)
    f.interpolate(compiled_expression(e, interpolation_points(W)))
    return f


def _jumps_by_place(e: Any) -> bool:
    """Return whether an expression contains a conditional that depends on the position."""
    conditions = (n for n in unique_pre_traversal(e) if isinstance(n, ufl.classes.Condition))
    return any(
        isinstance(node, ufl.classes.SpatialCoordinate)
        for condition in conditions
        for node in unique_pre_traversal(condition)
    )
