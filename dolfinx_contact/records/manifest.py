# SPDX-License-Identifier: LGPL-3.0-or-later
"""Manifest of a record: hashes and numbers that identify a contact problem.

A record stores the manifest at its start and compares it once on resumption, so that a journal is
not continued with another problem. The manifest does not depend on the number of ranks. It has
three sections, each a dictionary by the names of the items:

- ``parts``: mesh, elements, contact surfaces, Dirichlet conditions and domains of integration, as
  descriptions or hashes;
- ``forms``: hashes of the UFL signatures of forms, obstacles and laws;
- ``values``: Constants as numbers, Functions as random projections.

A Function f with the coefficients f_cj, j = 1, 2, ..., in each cell c has the projections p_k =
sum_cj v_kc w_kj f_cj for k = 1, 2. The weights v_kc and w_kj are random numbers in [-1, 1). Cells
are numbered as in the input mesh. Two Functions are treated as equal if their projections agree to
1e-9 of sqrt(sum_cj f_cj^2). A hash of the values is not suitable, because values computed on
different numbers of ranks differ in their last digits.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._arrays import Indices, Ints
from dolfinx_contact._compat import geometry_dofmap
from dolfinx_contact._mpi import total
from dolfinx_contact.equations.data import Datum, placed_data
from dolfinx_contact.records.states import by_cells, coefficients, input_numbers

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["data_restored", "difference", "manifest_of", "memory_of", "values_of"]

Manifest = dict[str, dict[str, Any]]

_TOLERANCE = 1e-9  # relative, of Constants and of projections
_ROUND_OFF = 1e-14  # relative to the largest component of a Constant
_COMPUTED = 1e-6  # relative, of memory, whose round-off depends on the number of ranks
_NO_LENGTH = 1e-13  # gaps and prescribed displacements that count as zero, relative to the body
_LONGEST = 100  # largest number of characters of a value in a message
_NUMBER = re.compile(r"[-+]?\d+\.\d+(?:e[-+]?\d+)?")
_UFL = "the version of UFL"


def manifest_of(
    problem: ContactProblem,
    *,
    method: Sequence[str] = (),
    forms: Mapping[str, Any] | None = None,
    driven: Sequence[Any] = (),
) -> Manifest:
    """Return the sections ``parts`` and ``forms`` of the manifest. Collective.

    Args:
        problem: contact problem.
        method: description of the method and its parameters.
        forms: additional UFL forms by name, such as a damping form.
        driven: UFL expressions of a parameter that define Dirichlet data.

    Raises:
        ValueError: on every rank, if the cells of the mesh have no numbers, as in a submesh.
    """
    eq = problem.equations
    domain = problem.V.mesh
    spaces = [f.function_space for f in problem.fields]
    sizes = [V.dofmap.index_map.size_global * V.dofmap.index_map_bs for V in spaces]
    number = domain.topology.index_map(domain.topology.dim).size_local
    nodes = geometry_dofmap(domain)[:number]
    input_nodes = np.asarray(domain.geometry.input_global_indices, np.int64)[nodes]
    coordinates = domain.geometry.x[nodes].reshape(number, 3 * nodes.shape[1])
    fixed = by_cells(domain, coefficients(problem.V, eq.constraints.fixed.reshape(-1)))
    parts = {
        "the mesh": _hash(problem.comm, by_cells(domain, input_nodes)),
        "the coordinates of the mesh": _projected(domain, coordinates),
        "the number of unknowns": sum(sizes),
        "the elements": [str(V.ufl_element()) for V in spaces],
        "the unknowns with Dirichlet conditions": _hash(problem.comm, fixed),
        "the method": [_rounded(words) for words in method],
    }
    bodies = {"the body": eq.bulk.residual, **(forms or {})}
    for name, form in bodies.items():
        parts[f"the domains of integration of {name}"] = _domains(form, domain)
    signatures = {name: form.signature() for name, form in bodies.items()}
    signatures["the form of the body"] = signatures.pop("the body")
    for i, e in enumerate(driven, 1):
        signatures[f"the expression {i} that drives Dirichlet data"] = _signature(e, domain)
    for body in problem.rigid_bodies:
        words = _rounded(f"{body.about.tolist()} {body.fixed.tolist()}")
        expressions = [_signature(e, domain) for e in body.expressions]
        signatures[f"the rigid body {body.name!r}"] = "".join([words, *expressions])
    for s in problem.surfaces:
        own_parts, own_signatures = _of_surface(s)
        parts |= {f"{name} of {s.name!r}": part for name, part in own_parts.items()}
        signatures |= {f"{name} of {s.name!r}": text for name, text in own_signatures.items()}
    hashes = {name: _digest(text.encode()) for name, text in signatures.items()}
    return {"parts": parts, "forms": {_UFL: ufl.__version__, **hashes}}


def _of_surface(s: DiscreteSurface) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the manifest items of a surface, and the signatures of its obstacle and law."""
    parts = {
        "the contact method": s.method,
        "the facets": _entities(s.domain, s.dim - 1, s.submesh.parent_facets),
        "the multipliers": [*s.degrees, s.points.number_everywhere],
        "the kind of sliding": _sliding(s),
    }
    opposite = s.obstacle.opposite
    if opposite is not None:
        parts["the opposite facets"] = _entities(s.domain, s.dim - 1, opposite.master_facets)
    expressions = [_signature(e, s.domain) for e in s.given.at_points.values()]
    axisymmetric = " axisymmetric" if s.axisymmetric else ""
    signatures = {
        "the law": f"{s.law_at_points.compiled.signature} {s.law.averaging!r}{axisymmetric}",
        # After the law: these expressions include its data, and the first difference is named.
        "the obstacle": "".join([s.obstacle.mark, *expressions]),
    }
    return parts, signatures


def values_of(
    problem: ContactProblem, *, more: Sequence[Datum] = (), but: Sequence[Any] = ()
) -> dict[str, Any]:
    """Return the section ``values`` of a manifest: all present data. Collective.

    Args:
        problem: contact problem.
        more: additional Functions and Constants, each with a description of its role, such as "the
            density".
        but: Functions and Constants to omit, such as the parameter of a branch.

    Returns:
        Dictionary whose keys describe the data. Values are lists of numbers for Constants, and
        dictionaries with ``projections`` and ``scale`` for Functions. One of the Functions is the
        prescribed displacement, which is 0 at free unknowns.
    """
    eq = problem.equations
    no_length = _NO_LENGTH * eq.body_size
    prescribed = coefficients(problem.V, np.asarray(eq.constraints.values(fill=0.0)).reshape(-1))
    found: dict[str, Any] = {
        "the prescribed displacement": _projected(problem.V.mesh, prescribed, no_length)
    }
    lengths = [f for s in eq.surfaces for f in ufl.algorithms.extract_coefficients(s.given.gap)]
    seen = list(but)
    for place, value in (*placed_data(eq, conditions=False), *more):
        if any(value is other for other in seen):
            continue
        seen.append(value)
        name = place
        while name in found:  # two Functions of one name in one form
            name += " (another)"
        if isinstance(value, fem.Function):
            least = no_length if any(value is f for f in lengths) else 0.0
            V = value.function_space
            found[name] = _projected(V.mesh, coefficients(V, value.x.array), least)
        else:
            found[name] = [float(v) for v in np.real(np.ravel(value.value))]
    return found


def memory_of(problem: ContactProblem) -> dict[str, Any]:
    """Return the memory of the contact points for a manifest. Collective.

    Returns:
        Memory at the start of the present step, and its duration, in the format of `values_of`;
        empty under the static law.
    """
    found: dict[str, Any] = {}
    no_length = _NO_LENGTH * problem.equations.body_size
    for s, memory in zip(problem.surfaces, problem.equations.memory, strict=True):
        if memory is None:
            continue
        of = f" of {s.name!r} at the start of the step"
        points = s.in_order
        vectors = {"jump": memory.jump} if memory.place is None else {"place": memory.place}
        for name, values in (*vectors.items(), *memory.fields.items()):
            whole = points(values).reshape(-1)
            weights = np.random.RandomState(0).uniform(-1.0, 1.0, (len(whole), 2))
            least = no_length * len(whole) ** 0.5 if name in vectors else 0.0
            tolerance = max(_COMPUTED * float(np.linalg.norm(whole)), least)
            projections = (whole @ weights).tolist()
            scale = tolerance / _TOLERANCE  # `difference` multiplies it by _TOLERANCE
            found[f"the memory {name}{of}"] = {"projections": projections, "scale": scale}
        found["the duration" + of] = [float(memory.step)]
    return found


def difference(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Describe the first difference between two sections of a manifest; "" if they agree.

    Signatures of different versions of UFL cannot be compared and count as equal.
    """
    if recorded.get(_UFL) != now.get(_UFL):
        return ""  # signatures of the same form depend on the version of UFL
    for name in dict.fromkeys((*recorded, *now)):
        if name not in recorded or name not in now:
            return f"{name} ({'missing now' if name in recorded else 'not recorded'})"
        if not _same(recorded[name], now[name]):
            numbered = "; Constants without a name are numbered in the order of their creation"
            hint = numbered if re.match(r"the Constant \d", name) else ""
            return name + _both(recorded[name], now[name]) + hint
    return ""


@contextmanager
def data_restored(problem: ContactProblem) -> Iterator[None]:
    """Context manager that restores the values of all data of a problem. Not collective."""
    arrays = [d.values for d in placed_data(problem.equations)]
    values = [a.copy() for a in arrays]
    try:
        yield
    finally:
        for array, before in zip(arrays, values, strict=True):
            array[...] = before


# -- comparing -------------------------------------------------------------------------------------


def _same(a: Any, b: Any) -> bool:
    """Return whether two values of a manifest agree: numbers to 1e-9, others exactly."""
    if isinstance(a, dict) and isinstance(b, dict) and "projections" in a:
        tolerance = _TOLERANCE * max(a["scale"], b["scale"])
        return np.allclose(a["projections"], b["projections"], 0, tolerance, equal_nan=True)
    if _is_constant(a) and _is_constant(b) and len(a) == len(b):
        sizes = np.abs([*a, *b])
        tolerance = _ROUND_OFF * np.max(sizes[np.isfinite(sizes)], initial=0.0)
        return np.allclose(a, b, _TOLERANCE, tolerance, equal_nan=True)
    return bool(a == b)


def _is_constant(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(v, float) for v in value)


def _both(recorded: Any, now: Any) -> str:
    """Return both values in parentheses; "" if they are hashes, projections or too long."""
    words = [", ".join(map(repr, v)) if _is_constant(v) else str(v) for v in (recorded, now)]
    hidden = isinstance(recorded, dict) or re.fullmatch("[0-9a-f]{32}", words[0])
    if hidden or max(map(len, words)) > _LONGEST:
        return ""
    return f" ({words[0]} recorded, {words[1]} now)"


# -- Functions and hashes --------------------------------------------------------------------------


def _projected(domain: mesh.Mesh, values: npt.NDArray[Any], least: float = 0.0) -> dict[str, Any]:
    """Return two random projections of values at cells, and their scale. Collective.

    Args:
        domain: mesh of the cells.
        values: values at the owned cells, shape (cells, values per cell).
        least: magnitude of values that count as zero when projections are compared.
    """
    cells = domain.topology.index_map(domain.topology.dim).size_global
    # the numbers of this generator do not depend on the version of NumPy
    generator = np.random.RandomState(0)
    of_cells = generator.uniform(-1.0, 1.0, (cells, 2))[input_numbers(domain)[: len(values)]]
    of_values = generator.uniform(-1.0, 1.0, (values.shape[1], 2))
    real = np.real(values)
    projections = np.sum(of_cells * (real @ of_values), axis=0)
    sums = total(domain.comm, [*projections, np.vdot(real, real), real.size])
    scale = max(sums[2] ** 0.5, least * sums[3] ** 0.5 / _TOLERANCE)
    return {"projections": sums[:2].tolist(), "scale": float(scale)}


def _hash(comm: MPI.Comm, values: npt.NDArray[Any]) -> str:
    """Return a hash of the values on rank 0, the same on every rank. Collective."""
    return comm.bcast(_digest(values.tobytes()))


def _hash_of_rows(comm: MPI.Comm, rows: Ints) -> str:
    """Return a hash of the rows of all ranks, independent of their order. Collective."""
    parts = comm.gather(rows) or [rows]
    whole = np.concatenate([part for part in parts if len(part)] or [rows])
    return _hash(comm, whole[np.lexsort(whole.T)])


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


def _rounded(text: str) -> str:
    """Round the numbers in a text to nine digits, as computed numbers depend on the ranks."""
    return _NUMBER.sub(lambda number: f"{float(number[0]):.9g}", text)


def _signature(e: Any, domain: mesh.Mesh) -> str:
    """Return the signature of a UFL expression, independent of the values of its data."""
    e = ufl.as_ufl(e)
    if isinstance(e, ufl.constantvalue.Zero):
        return "0"
    return str((ufl.inner(e, e) * ufl.dx(domain=domain)).signature())


# -- parts -----------------------------------------------------------------------------------------


def _entities(domain: mesh.Mesh, dim: int, entities: Indices) -> str:
    """Return a hash of entities, identified by the input numbers of their nodes. Collective."""
    owned = entities[entities < domain.topology.index_map(dim).size_local]
    nodes = np.asarray(domain.geometry.input_global_indices, np.int64)
    # DOLFINx divides by their number.
    at = mesh.entities_to_geometry(domain, dim, owned) if len(owned) else np.zeros((0, 1), int)
    return _hash_of_rows(domain.comm, np.sort(nodes[at], axis=1))


def _domains(form: ufl.Form, domain: mesh.Mesh) -> str:
    """Return a hash of the cells or facets over which a form is integrated. Collective."""
    numbers = input_numbers(domain)
    owned_cells = domain.topology.index_map(domain.topology.dim).size_local
    texts = []
    for integral in form.integrals():
        data = integral.subdomain_data()
        ids = integral.subdomain_id()
        if data is None or ids == "everywhere":
            continue
        chosen = [i for i in (ids if isinstance(ids, tuple) else (ids,)) if not isinstance(i, str)]
        if isinstance(data, mesh.MeshTags):
            marked = data.indices[np.isin(data.values, chosen)] if chosen else data.indices
            entities = _entities(domain, data.dim, marked)
        else:  # lists of cells, or of pairs of a cell and a facet
            parts = [np.ravel(part) for tag, part in data if not chosen or tag in chosen]
            columns = 1 if integral.integral_type() == "cell" else 2
            pairs = np.concatenate([np.zeros(0, np.int64), *parts]).reshape(-1, columns)
            owned = pairs[pairs[:, 0] < owned_cells]
            rows = np.column_stack([numbers[owned[:, 0]], owned[:, 1:]])
            entities = _hash_of_rows(domain.comm, rows)
        texts.append(f"{integral.integral_type()} {ids} {entities}")
    return _digest("; ".join(sorted(texts)).encode())


def _sliding(s: DiscreteSurface) -> list[Any]:
    """Describe the kind of sliding of a surface as a list. Collective.

    It contains the kind; for self-contact the direction by which slave facets are selected; the
    search distance, planes of symmetry and the removed overlap.
    """
    kind: list[Any] = ["along its obstacle" if s.displaced is not None else "small"]
    if s.slides:
        direction = s.obstacle.opposite.direction
        kind = ["large"] if direction is None else ["self-contact", *map(float, direction)]
    return [*kind, *s.points.choices]
