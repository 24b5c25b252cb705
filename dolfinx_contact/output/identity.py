# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a contact problem is known by, on any number of ranks.

Mesh, elements, contact surfaces, forms and the numbers in them. So a run is not resumed with the
journal of another problem.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import mesh
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._compat import geometry_dofmap

if TYPE_CHECKING:
    from dolfinx_contact.points.surface import ContactSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["difference", "identity", "mesh_hash"]

_TOLERANCE = 1e-9


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
    columns = [
        original[:n, None],
        np.asarray(domain.geometry.input_global_indices)[cells],
        # Adding zero makes -0.0 the same as 0.0.
        (domain.geometry.x[cells].reshape(n, -1) + 0.0).view(np.int64),
    ]
    return _hash(domain.comm, np.concatenate([np.asarray(c, np.int64) for c in columns], axis=1))


def _hash(comm: MPI.Comm, rows: npt.NDArray[np.int64]) -> str:
    """A hash of the rows of all ranks, whatever their order. Collective."""
    unsigned = np.ascontiguousarray(rows).view(np.uint64)
    sums = np.array([np.sum(_mix(unsigned, seed), dtype=np.uint64) for seed in (1, 2)])
    # Sums modulo 2^64 do not depend on the order.
    comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
    return "".join(f"{int(s):016x}" for s in sums)


def _faces(s: ContactSurface) -> list[str]:
    """Hashes of the facets of a surface and of those opposite, by the nodes of the input."""
    domain, fdim = s.domain, s.dim - 1
    opposite, owned = s.obstacle.opposite, domain.topology.index_map(fdim).size_local
    nodes = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    found = []
    for facets in (s.submesh.parent_facets, *([opposite.master_facets] if opposite else [])):
        mine = facets[facets < owned]
        # DOLFINx divides by their number.
        at = mesh.entities_to_geometry(domain, fdim, mine) if len(mine) else np.zeros((0, 1), int)
        found.append(_hash(s.comm, np.sort(nodes[at], axis=1)))
    return found


def _mix(rows: npt.NDArray[np.uint64], seed: int) -> npt.NDArray[np.uint64]:
    """A hash of every row, by the finaliser of splitmix64."""
    h: npt.NDArray[np.uint64] = np.full(len(rows), seed, dtype=np.uint64)
    for column in rows.T:
        h = (h ^ column) + np.uint64(0x9E3779B97F4A7C15)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(31)
    return h


def identity(problem: ContactProblem, *, but: Sequence[Any] = ()) -> dict[str, Any]:
    """What the problem is known by, in words and numbers for the journal. Collective.

    Args:
        problem: the problem.
        but: Constants whose values vary.
    """
    eq, domain = problem.equations, problem.V.mesh
    words = [eq.bulk.residual.signature()]
    for s in problem.surfaces:
        words += [_signature(e, domain) for e in _given(s)]
        words.append(s.law_at_points.compiled.signature)
        words += [] if s.law.spread is None else [repr(s.law.spread)]
        words += ["axisymmetric"] if s.axisymmetric else []
    for body in problem.rigid_bodies:
        words.append(f"{body.about.tolist()} {body.fixed.tolist()}")
        words += [_signature(e, domain) for e in body.expressions]
    fixed = eq.fixed[: eq.owned_sizes[0]]
    x = problem.create_vector()
    unknowns = int(x.getSize())
    x.destroy()
    return {
        "mesh": mesh_hash(problem.V.mesh),
        "unknowns": unknowns,
        "elements": [str(f.function_space.ufl_element()) for f in problem.fields],
        "surfaces": [
            [s.name, s.method, problem.comm.allreduce(s.num_owned_points)] for s in problem.surfaces
        ],
        "faces": [_faces(s) for s in problem.surfaces],
        "fixed": problem.comm.allreduce(int(fixed.sum())),
        "ufl": ufl.__version__,
        "forms": hashlib.sha256("".join(words).encode()).hexdigest()[:32],
        "numbers": _numbers(problem, but),
    }


def _signature(e: Any, domain: mesh.Mesh) -> str:
    """What tells a UFL expression from others, but for values of Functions and Constants."""
    e = ufl.as_ufl(e)
    if isinstance(e, ufl.constantvalue.Zero):
        return "0"
    return str((ufl.inner(e, e) * ufl.dx(domain=domain)).signature())


def _given(s: ContactSurface) -> list[Any]:
    """What is given on a surface, in UFL."""
    return list(s.given.all)


def _numbers(problem: ContactProblem, but: Sequence[Any]) -> list[float]:
    """Values of the Constants in the problem: materials, loads, friction."""
    expressions = [e for s in problem.surfaces for e in _given(s)]
    expressions += [e for body in problem.rigid_bodies for e in body.expressions]
    values: list[float] = []
    seen: list[Any] = list(but)
    for e in (problem.equations.bulk.residual, *expressions):
        for c in extract_constants(e):
            if not any(c is other for other in seen):
                seen.append(c)
                values.extend(float(v) for v in np.real(np.ravel(c.value)))
    return values


def difference(recorded: Mapping[str, Any], present: Mapping[str, Any]) -> str:
    """In which respect two problems differ; empty if they are the same."""
    names = {
        "mesh": "another mesh",
        "unknowns": "another number of unknowns",
        "elements": "other elements",
        "surfaces": "other contact surfaces",
        "faces": "contact on other facets",
        "fixed": "other Dirichlet conditions",
        "forms": "other forms",
        "numbers": "other materials, loads or friction",
    }
    for key, words in names.items():
        # Another UFL may write the same form in another way.
        if key == "forms" and recorded["ufl"] != present["ufl"]:
            continue
        if key == "faces" and key not in recorded:  # in journals of old
            continue
        a, b = recorded[key], present[key]
        if key == "numbers":
            scale = np.maximum(np.abs(a), np.abs(b)) if len(a) == len(b) else None
            same = scale is not None and bool(
                np.all(np.abs(np.subtract(a, b)) <= _TOLERANCE * scale)
            )
        else:
            same = a == b
        if not same:
            return words
    return ""
