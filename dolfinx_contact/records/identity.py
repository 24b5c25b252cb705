# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a contact problem is known by, on any number of ranks.

Mesh, elements, contact surfaces, forms and the numbers in them. So a run is not resumed with the
journal of another problem.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import mesh

from dolfinx_contact._compat import geometry_dofmap
from dolfinx_contact._mesh_mark import node_positions
from dolfinx_contact.equations.given_data import Datum, placed_data

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import ContactSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["difference", "identity", "mesh_hash", "other_data", "other_words", "same_words"]

_TOLERANCE = 1e-9  # of numbers that are given
_ROUND_OFF = 1e-14  # of the largest of the numbers of a Constant


def mesh_hash(domain: mesh.Mesh) -> str:
    """A hash of cells, nodes and coordinates, in the numbering of the input. Collective.

    It depends neither on the number of ranks nor on how cells and nodes are numbered there.

    Raises:
        ValueError: on every rank, if the cells of the mesh have no numbers, as in a submesh.
    """
    try:
        original = domain.topology.original_cell_index
    except RuntimeError as error:
        message = "a record needs a mesh whose cells have numbers of the input, not a submesh"
        raise ValueError(message) from error
    n = domain.topology.index_map(domain.topology.dim).size_local
    cells = geometry_dofmap(domain)[:n]
    # Adding zero makes -0.0 the same as 0.0.
    x = (domain.geometry.x[cells].reshape(n, -1) + 0.0).view(np.int64)
    return _hash(domain.comm, np.concatenate([_numbered(domain, original[:n]), x], axis=1))


def _numbered(domain: mesh.Mesh, original: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Numbers of the owned cells and of their nodes in the input."""
    nodes = np.asarray(domain.geometry.input_global_indices)
    cells = nodes[geometry_dofmap(domain)[: len(original)]]
    return np.concatenate([np.asarray(original, np.int64)[:, None], cells.astype(np.int64)], axis=1)


def _hash(comm: MPI.Comm, rows: npt.NDArray[np.int64]) -> str:
    """A hash of the rows of all ranks, whatever their order. Collective."""
    unsigned = np.ascontiguousarray(rows).view(np.uint64)
    sums = np.array([np.sum(_mix(unsigned, seed), dtype=np.uint64) for seed in (1, 2)])
    # Sums modulo 2^64 do not depend on the order.
    comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    return "".join(f"{int(s):016x}" for s in sums)


def _faces(s: ContactSurface) -> list[str]:
    """Hashes of the facets of a surface and of those opposite, by the nodes of the input."""
    domain = s.domain
    fdim = s.dim - 1
    opposite = s.obstacle.opposite
    owned = domain.topology.index_map(fdim).size_local
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    found = []
    for facets in (s.submesh.parent_facets, *([opposite.master_facets] if opposite else [])):
        mine = facets[facets < owned]
        # DOLFINx divides by their number.
        at = mesh.entities_to_geometry(domain, fdim, mine) if len(mine) else np.zeros((0, 1), int)
        found.append(_hash(s.comm, np.sort(nodes[at], axis=1)))
    return found


def _sliding_of(s: ContactSurface) -> list[Any]:
    """How a surface slides: whether it follows its obstacle; of faces that slide over others more.

    Of these how far they reach, planes of symmetry and the overlap that is taken from gaps, and of
    a face that slides over itself the direction, by which it has its slaves. Collective.
    """
    if not s.slides:
        return [s.displaced is not None, *s.points.choices]
    direction = s.obstacle.opposite.direction
    if direction is None:
        return ["over a face", *s.points.choices]
    return ["over itself", *map(float, direction), *s.points.choices]


def _parts(form: ufl.Form, domain: mesh.Mesh) -> list[str]:
    """Hashes of the cells or facets that the integrals of a form are over. Collective."""
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    found = []
    for integral in form.integrals():
        data = integral.subdomain_data()
        ids = integral.subdomain_id()
        if data is None or ids == "everywhere":
            continue
        here = [i for i in (ids if isinstance(ids, tuple) else (ids,)) if not isinstance(i, str)]
        if isinstance(data, mesh.MeshTags):
            dim = data.dim
            marked = data.indices[np.isin(data.values, here)] if here else data.indices
        else:
            dim, marked = _listed(data, here, integral.integral_type(), domain)
        mine = marked[marked < domain.topology.index_map(dim).size_local]
        at = mesh.entities_to_geometry(domain, dim, mine) if len(mine) else None
        rows = np.zeros((0, 1), int) if at is None else np.sort(nodes[at], axis=1)
        found.append(f"{integral.integral_type()} {ids} {_hash(domain.comm, rows)}")
    return sorted(found)


def _listed(
    lists: Sequence[tuple[int, npt.ArrayLike]], ids: Sequence[int], kind: str, domain: mesh.Mesh
) -> tuple[int, npt.NDArray[np.int32]]:
    """Dimension and local indices of what lists of cells, or of their facets, are of."""
    tdim = domain.topology.dim
    arrays = [np.asarray(part, np.int32).reshape(-1) for i, part in lists if not ids or i in ids]
    listed = np.concatenate([np.zeros(0, np.int32), *arrays])
    if kind == "cell":
        return tdim, np.unique(listed)
    domain.topology.create_connectivity(tdim, tdim - 1)
    facets = domain.topology.connectivity(tdim, tdim - 1)
    pairs = listed.reshape(-1, 2)
    of_pairs = [facets.links(cell)[facet] for cell, facet in pairs]
    return tdim - 1, np.unique(np.array(of_pairs, dtype=np.int32))


def _held(problem: ContactProblem, fixed: npt.NDArray[np.bool_]) -> list[float]:
    """Of each component, how many are held, and mean and root mean square of where. Collective."""
    n = problem.V.dofmap.index_map_bs
    which = fixed[: len(fixed) - len(fixed) % n].reshape(-1, n)
    x = node_positions(problem.V)[: len(which)]
    places = [x[k] for k in which.T]
    sums = [[len(at), *at.sum(axis=0), *(at**2).sum(axis=0)] for at in places]
    total = problem.comm.allreduce(np.array(sums, dtype=float))
    means = total[:, 1:] / np.maximum(total[:, :1], 1.0)
    means[:, 3:] **= 0.5
    return [float(v) for v in np.column_stack([total[:, :1], means]).ravel()]


def _held_at(problem: ContactProblem) -> str:
    """A hash of the unknowns that are held, cell by cell of the input. Collective."""
    domain = problem.V.mesh
    held = problem.equations.constraints.fixed
    n = domain.topology.index_map(domain.topology.dim).size_local
    original = np.asarray(domain.topology.original_cell_index[:n], np.int64)
    in_cells = held[problem.V.dofmap.list[:n]].reshape(n, -1)
    cell, place = np.nonzero(in_cells)
    return _hash(problem.comm, np.stack([original[cell], place.astype(np.int64)], axis=1))


def _mix(rows: npt.NDArray[np.uint64], seed: int) -> npt.NDArray[np.uint64]:
    """A hash of every row, by the finaliser of splitmix64."""
    h: npt.NDArray[np.uint64] = np.full(len(rows), seed, dtype=np.uint64)
    for column in rows.T:
        h = (h ^ column) + np.uint64(0x9E3779B97F4A7C15)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(31)
    return h


def identity(
    problem: ContactProblem,
    *,
    but: Sequence[Any] = (),
    forms: Sequence[ufl.Form] = (),
    more: Sequence[Datum] = (),
    functions: Sequence[str] = (),
    driven: Sequence[Any] = (),
) -> dict[str, Any]:
    """What the problem is known by, in words and numbers for the journal. Collective.

    Values of Functions are not in it (`records.kept_data`).

    Args:
        problem: the problem.
        but: Constants whose values vary.
        forms: others that go with it, as one of damping.
        more: data beside those of the problem, of which the Constants are taken.
        functions: elements of the Functions of which values are kept.
        driven: expressions by which a load drives Dirichlet data.
    """
    eq = problem.equations
    domain = problem.V.mesh
    words = _words(problem)
    fixed = eq.fixed[: eq.owned_sizes[0]]
    constants = _constants(problem, but, more)
    x = problem.create_vector()
    unknowns = int(x.getSize())
    x.destroy()
    whole = mesh_hash(domain)
    n = domain.topology.index_map(domain.topology.dim).size_local
    return {
        "mesh": whole,
        "cells": _hash(problem.comm, _numbered(domain, domain.topology.original_cell_index[:n])),
        "unknowns": unknowns,
        "elements": [str(f.function_space.ufl_element()) for f in problem.fields],
        "surfaces": [
            [s.name, s.method, problem.comm.allreduce(s.points.number)] for s in problem.surfaces
        ],
        "faces": [_faces(s) for s in problem.surfaces],
        "kinds": [[*s.degrees, *_sliding_of(s)] for s in problem.surfaces],
        "parts": _parts(eq.bulk.residual, domain),
        "other parts": [part for form in forms for part in _parts(form, domain)],
        "fixed": problem.comm.allreduce(int(fixed.sum())),
        "held": _held(problem, fixed),
        "held at": _held_at(problem),
        "ufl": ufl.__version__,
        "forms": hashlib.sha256("".join(words).encode()).hexdigest()[:32],
        "numbers": [float(v) for d in constants for v in np.real(np.ravel(d.value.value))],
        "places": [d.place for d in constants for _ in np.ravel(d.value.value)],
        "functions": list(functions),
        "driven": [hashlib.sha256(_signature(e, domain).encode()).hexdigest()[:32] for e in driven],
    }


def _words(problem: ContactProblem) -> list[str]:
    """What forms, surfaces, laws and rigid bodies are known by."""
    domain = problem.V.mesh
    words = [problem.equations.bulk.residual.signature()]
    for s in problem.surfaces:
        words += [_signature(e, domain) for e in s.given.all]
        words += [s.obstacle.mark] if s.obstacle.mark else []
        words.append(s.law_at_points.compiled.signature)
        words += [] if s.law.averaging is None else [repr(s.law.averaging)]
        words += ["axisymmetric"] if s.axisymmetric else []
    for body in problem.rigid_bodies:
        words.append(f"{body.about.tolist()} {body.fixed.tolist()}")
        words += [_signature(e, domain) for e in body.expressions]
    return words


def _signature(e: Any, domain: mesh.Mesh) -> str:
    """What a UFL expression is known by, but for values of Functions and Constants."""
    e = ufl.as_ufl(e)
    if isinstance(e, ufl.constantvalue.Zero):
        return "0"
    return str((ufl.inner(e, e) * ufl.dx(domain=domain)).signature())


_NUMBER = re.compile(r"(?<![\w.])([-+]?\d+\.?\d*(?:e[-+]?\d+)?)(?![\w.])")


def same_words(recorded: Sequence[str], found: Sequence[str]) -> bool:
    """Whether words are the same, numbers in them to 1e-9 of their size.

    Numbers that were integrals differ in their last digits on other ranks.
    """
    if len(recorded) != len(found):
        return False
    for a, b in zip(recorded, found, strict=True):
        if a == b:
            continue
        # Every other one of the parts is a number.
        parts = _NUMBER.split(a), _NUMBER.split(b)
        if len(parts[0]) != len(parts[1]) or parts[0][::2] != parts[1][::2]:
            return False
        was, now = (np.array([float(v) for v in part[1::2]]) for part in parts)
        if not np.allclose(was, now, rtol=_TOLERANCE, atol=0.0):
            return False
    return True


def other_words(recorded: Sequence[str], found: Sequence[str]) -> str:
    """Those that are not the same, as `same_words` has it."""
    was = list(recorded)
    now = list(found)
    if len(was) == len(now):
        others = [
            i for i, (a, b) in enumerate(zip(was, now, strict=True)) if not same_words([a], [b])
        ]
        was = [was[i] for i in others]
        now = [now[i] for i in others]
    return f"{', '.join(was)} was recorded, {', '.join(now)} is given"


def _constants(problem: ContactProblem, but: Sequence[Any], more: Sequence[Datum]) -> list[Datum]:
    """The Constants in the problem, each once: materials, loads, friction."""
    found: list[Datum] = []
    seen: list[Any] = list(but)
    for d in (*placed_data(problem.equations, conditions=False), *more):
        if not hasattr(d.value, "x") and not any(d.value is other for other in seen):
            seen.append(d.value)
            found.append(d)
    return found


def difference(recorded: Mapping[str, Any], present: Mapping[str, Any]) -> str:
    """In which respect two problems differ; empty if they are the same."""
    names = {
        "mesh": "another mesh",
        "unknowns": "another number of unknowns",
        "elements": "other elements",
        "surfaces": "other contact surfaces",
        "kinds": "other multipliers, or another kind of sliding",
        "faces": "contact on other facets",
        "fixed": "other Dirichlet conditions",
        "held": "Dirichlet conditions at other places",
        "held at": "Dirichlet conditions at other places",
        "forms": "other forms",
        "parts": "integrals over other cells or facets",
        "other parts": "damping over other cells or facets",
        "driven": (
            "other loads, materials or friction: Dirichlet data are driven in another way, so that "
            "what was recorded is no solution of this problem"
        ),
        "functions": "Functions of other elements",
        "numbers": "other materials, loads or friction",
    }
    for key, words in names.items():
        if key not in present:
            continue
        # Another UFL may write the same form in another way.
        if key == "forms" and recorded["ufl"] != present["ufl"]:
            continue
        a = recorded[key]
        b = present[key]
        if key == "numbers":
            places = present["places"]
            if len(a) != len(b):
                return words
            names_of = list(dict.fromkeys(places))
            other = _other_numbers(names_of, _by_place(places, a), _by_place(places, b))
            if other is not None:
                return words + other
        elif key == "held":
            size = float(np.max(np.abs(a), initial=0.0))
            if len(a) != len(b) or not np.allclose(a, b, rtol=0.0, atol=_TOLERANCE * size):
                return words
        elif a != b:
            return words
    return ""


def other_data(
    problem: ContactProblem,
    recorded: Sequence[Sequence[float]],
    found: Sequence[Sequence[float]],
) -> str | None:
    """Where Constants differ first, in words that begin with a colon; None if they do not.

    Args:
        problem: whose data they are.
        recorded: of data that were recorded, what `numbers_of` has.
        found: the same of those that are given.
    """
    places = [d.place for d in placed_data(problem.equations) if not hasattr(d.value, "x")]
    return _other_numbers(places, recorded, found, round_off=_ROUND_OFF)


def _other_numbers(
    places: Sequence[str],
    recorded: Sequence[Sequence[float]],
    found: Sequence[Sequence[float]],
    round_off: float = 0.0,
) -> str | None:
    """Where numbers differ first, in words that begin with a colon; None if they do not.

    Args:
        places: where they stand.
        recorded: those of every place.
        found: likewise.
        round_off: of numbers that were computed, relative to the largest at their place.
    """
    if not len(recorded) == len(found) == len(places):
        return (
            f": {len(recorded)} Constants were recorded, {len(found)} are given, as where one of "
            "them is a Function now"
        )
    for place, a, b in zip(places, recorded, found, strict=True):
        if len(a) != len(b) or _differ(a, b, round_off):
            return f": {_changed(place, a, b)}"
    return None


def _by_place(places: Sequence[str], numbers: Sequence[float]) -> list[list[float]]:
    """Numbers that stand in one place beside each other, in its order of first mention."""
    found: dict[str, list[float]] = {place: [] for place in places}
    for place, number in zip(places, numbers, strict=True):
        found[place].append(number)
    return list(found.values())


def _differ(recorded: Sequence[float], found: Sequence[float], round_off: float) -> bool:
    """Whether numbers differ, each beside itself but for the round-off of the largest."""
    a = np.array(recorded)
    b = np.array(found)
    size = float(np.max(np.abs(a), initial=0.0))
    # Moduli, ratios and loads are of different sizes, also as components of one Constant.
    own = np.maximum(np.abs(a), np.abs(b))
    tolerance = np.maximum(_TOLERANCE * own, round_off * size)
    # What is not finite is the same where it is of one kind.
    same = (a == b) | (np.isnan(a) & np.isnan(b))
    with np.errstate(invalid="ignore"):
        same |= np.abs(a - b) <= tolerance
    return not bool(same.all())


def _changed(place: str, recorded: Sequence[float], found: Sequence[float]) -> str:
    """What was and what is in a place, with so many digits that they differ."""
    for digits in (6, 10, 17):
        a, b = (", ".join(f"{v:.{digits}g}" for v in values) for values in (recorded, found))
        if a != b:
            break
    a, b = (f"({v})" if len(recorded) > 1 else v for v in (a, b))
    return f"{place}: {a} was recorded, {b} is given"
