# SPDX-License-Identifier: LGPL-3.0-or-later
"""Entries of journals for points of branches: functionals, numbers of statuses, special points."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._agreement import described
from dolfinx_contact._compat import merge_entity_maps
from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact._forms import compiled_form
from dolfinx_contact.body.weighting import weighted
from dolfinx_contact.continuation import BranchPoint, Change, Node, SpecialPoint
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.equations.data import placed_data
from dolfinx_contact.equations.order import Gathered, by_coordinates
from dolfinx_contact.laws import status
from dolfinx_contact.records.columns import (
    ChangeEntry,
    JournalNode,
    NodePoint,
    PointEntry,
    RayEntry,
    SpecialEntry,
)

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact
    from dolfinx_contact.problem import ContactProblem

__all__ = ["Functional", "compiled", "entry_of", "functional_forms", "node_of", "places"]

#: A scalar UFL form in the problem's Functions, or a function of the problem. In a body of
#: revolution the problem multiplies the integrals of forms by 2 pi r.
Functional: TypeAlias = "ufl.Form | Callable[[ContactProblem], float]"

_SAME = 1e-12  # relative: what sums over the ranks may differ by


def places(problem: ContactProblem) -> dict[str, list[list[float]]]:
    """Coordinates of the contact points by surface, in the order of `letters`. Collective."""
    return {
        s.name: Gathered(s.comm, s.positions, s.points.ids).positions.tolist()
        for s in problem.surfaces
    }


def entry_of(
    system: ParametricContact,
    index: int,
    point: BranchPoint,
    special: Sequence[SpecialPoint],
    norm: float,
) -> PointEntry:
    """The entry of the journal for a point, but for its functionals. Collective.

    Args:
        system: the problem.
        index: of the point on its branch.
        point: the point.
        special: points on the way to it.
        norm: of the unknowns.
    """
    letters = system.letters(point.piece)
    return PointEntry(
        index=index,
        gamma=point.gamma,
        step=point.step,
        corrections=point.corrections,
        tau=point.tau,
        status=letters,
        special=[SpecialEntry(**_described(system, s)) for s in special],
        norm=norm,
        functionals={},
    )


def node_of(system: ParametricContact, layout: Layout, node: Node) -> JournalNode:
    """The entry of the journal for a node of a diagram. Collective."""
    rays = [
        RayEntry(status=system.letters(ray.piece), gamma=layout.gamma(ray.tangent))
        for ray in node.rays
    ]
    point = NodePoint(**_described(system, node.point), method=node.point.method)
    return JournalNode(point=point, rays=rays, edges=list(node.edges))


def _described(system: ParametricContact, s: SpecialPoint) -> dict[str, Any]:
    """Fields of the entry of a special point. Collective."""
    return {
        "kind": s.kind,
        "smooth": s.smooth,
        "gamma": s.gamma,
        "parity": s.parity,
        "others": len(s.others),
        "complete": s.complete,
        "bracket": list(s.bracket) if s.bracket is not None else None,
        "changes": _places(system, s.changes),
    }


def _places(system: ParametricContact, changes: Sequence[Change]) -> list[ChangeEntry]:
    """Changes by place, in order of coordinates: the same on any number of ranks."""
    if not changes:
        return []
    known = list(zip(system.positions, system._ids, strict=True))
    mine = {i: known[c.point] for i, c in enumerate(changes) if c.rank == system.comm.rank}
    places = {i: place for part in system.comm.allgather(mine) for i, place in part.items()}
    x, ids = (np.array(v) for v in zip(*(places[i] for i in range(len(changes))), strict=True))
    names = [str(letter) for letter in status.letters(x.shape[1])]
    surfaces = [s.name for s in system.problem.surfaces]
    return [
        ChangeEntry(
            surface=surfaces[ids[i, 0]],
            x=x[i].tolist(),
            before=names[changes[i].before],
            after=names[changes[i].after],
        )
        for i in by_coordinates(x, ids)
    ]


def compiled(
    problem: ContactProblem, functionals: Mapping[str, Functional]
) -> dict[str, Callable[[], float]]:
    """Functions that evaluate the functionals at the problem's Functions. Collective.

    Raises:
        ValueError: on every rank, if a functional is neither a scalar form nor a function, has no
            name or that of a column, or the functionals differ between ranks, in their order too.
    """
    with everywhere(problem.comm, "the functionals"):
        _check_names(functionals)
        kinds = {name: _kind(problem, name, f) for name, f in functionals.items()}
    same_everywhere(problem.comm, functionals=list(kinds))
    same_everywhere(problem.comm, functionals=kinds)
    return {name: _evaluator(problem, name, f) for name, f in functionals.items()}


def functional_forms(
    system: ParametricContact, functionals: Mapping[str, Functional]
) -> dict[str, str]:
    """The section ``forms`` of the manifest for functionals. Not collective.

    A form is known by the hash of its signature and of the places of its Functions and Constants in
    the problem, a Python function only by its name.
    """
    problem = system.problem
    places = {id(d.value): d.place for d in placed_data(problem.equations)}
    places |= {id(problem.u): "the displacement", id(system.constant): "gamma"}
    found = {}
    for name, f in functionals.items():
        text = "a function"
        if isinstance(f, ufl.Form):
            data = (*f.coefficients(), *f.constants())
            signature = "; ".join([f.signature(), *(places.get(id(d), "another") for d in data)])
            text = hashlib.sha256(signature.encode()).hexdigest()[:32]
        found[f"the functional {name!r}"] = text
    return found


def _check_names(functionals: Mapping[str, Functional]) -> None:
    for name in functionals:
        if not isinstance(name, str) or not name:
            raise ValueError(f"the name of a functional must be a word, got {name!r}")
    reserved = {
        "branch",
        "index",
        "gamma",
        "step",
        "corrections",
        "tau",
        "norm",
        "special",
        "status",
    }
    clash = sorted((reserved | set(status.KINDS)) & set(functionals))
    if clash:
        raise ValueError(f"functionals must not have the names of columns: {', '.join(clash)}")


def _kind(problem: ContactProblem, name: str, f: Functional) -> str:
    """The content of a functional, equal on ranks that mean the same."""
    if isinstance(f, ufl.Form):
        if f.arguments():
            raise ValueError(f"the functional {name!r} must be a scalar form")
        return described(f, problem.V.mesh)
    if not callable(f):
        raise ValueError(f"the functional {name!r} is neither a UFL form nor a function")
    return "a function"


def _evaluator(problem: ContactProblem, name: str, f: Functional) -> Callable[[], float]:
    comm = problem.comm
    if isinstance(f, ufl.Form):
        maps = merge_entity_maps([s.submesh for s in problem.surfaces])
        form = compiled_form(weighted(f, axisymmetric=problem.equations.axisymmetric), maps)
        return lambda: _real(name, comm.allreduce(fem.assemble_scalar(form)))

    def value() -> float:
        with everywhere(comm, f"the functional {name!r}"):
            found = f(problem)
            try:
                number = complex(found)
            except (TypeError, ValueError):
                raise ValueError(f"the functional {name!r} did not return a number") from None
            number = _real(name, number)
        numbers = comm.allgather(number)
        same = np.allclose(numbers, numbers[0], rtol=_SAME, atol=0, equal_nan=True)
        message = f"the functional {name!r} differs between ranks ({numbers[:4]}): sum over them"
        require(comm, same, message)
        return float(numbers[0])

    return value


def _real(name: str, value: complex) -> float:
    """The value of a functional.

    Raises:
        ValueError: if it is not real.
    """
    if np.imag(value) != 0.0:
        raise ValueError(
            f"the functional {name!r} must be real, got {value}: record its real and imaginary "
            "parts as two functionals"
        )
    return float(np.real(value))
