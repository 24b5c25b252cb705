# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functionals of branches for records and journals: UFL forms and functions of the problem.

The functionals `leftmost`, `rightmost` and `total` are evaluated at contact points; `ut` and `rt`
are tangential components in 2D and norms in 3D.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._compat import merge_entity_maps
from dolfinx_contact._forms import compiled_form
from dolfinx_contact._mpi import everywhere, require, same_everywhere
from dolfinx_contact._ufl import described
from dolfinx_contact.body.bulk import weighted
from dolfinx_contact.equations.data import placed_data
from dolfinx_contact.laws import status
from dolfinx_contact.results.tables import ContactTable

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact
    from dolfinx_contact.problem import ContactProblem

__all__ = [
    "Functional",
    "Quantity",
    "compiled",
    "functional_forms",
    "leftmost",
    "rightmost",
    "total",
]

#: A scalar UFL form in the problem's Functions, or a function of the problem. In a body of
#: revolution the problem multiplies the integrals of forms by 2 pi r.
Functional: TypeAlias = "ufl.Form | Callable[[ContactProblem], float]"
#: Gap and tangential displacement, normal and tangential force.
Quantity: TypeAlias = Literal["un", "ut", "rn", "rt"]
OfProblem: TypeAlias = "Callable[[ContactProblem], float]"

_SAME = 1e-12  # relative difference of sums over the ranks
_COLUMNS = ("branch", "index", "gamma", "step", "corrections", "tau", "norm", "special", "status")


def leftmost(quantity: Quantity, surface: str | None = None) -> OfProblem:
    """Create a functional: value of a quantity at the first contact point of a surface.

    Contact points are sorted by coordinates, as in `ContactTable`.

    Args:
        quantity: column of `ContactTable`: ``"un"``, ``"ut"``, ``"rn"`` or ``"rt"``.
        surface: name of the surface; default: first surface of the problem.

    Raises:
        ValueError: if the quantity is unknown. The evaluation raises it if the surface is unknown.
    """
    return _of_table(quantity, surface, lambda values, _: float(values[0]))


def rightmost(quantity: Quantity, surface: str | None = None) -> OfProblem:
    """Create a functional: value of a quantity at the last contact point; see `leftmost`."""
    return _of_table(quantity, surface, lambda values, _: float(values[-1]))


def total(quantity: Literal["rn", "rt"], surface: str | None = None) -> OfProblem:
    """Create a functional: sum of a force over contact points, without support reactions.

    In 3D, the sum of ``rt`` is the norm of the resultant. Arguments and errors are as in
    `leftmost`.
    """
    if quantity not in ("rn", "rt"):
        raise ValueError(f"the quantity must be 'rn' or 'rt', got {quantity!r}")

    def summed(values: Array, t: ContactTable) -> float:
        in_space = t.dim == 3 and quantity == "rt"
        return float(np.linalg.norm(t.rt.sum(axis=0)) if in_space else values.sum())

    return _of_table(quantity, surface, summed)


def _of_table(quantity: str, surface: str | None, value: Callable[[Any, Any], float]) -> OfProblem:
    """Create a functional that applies ``value`` to a column of a contact table and the table."""
    if quantity not in ("un", "ut", "rn", "rt"):
        raise ValueError(f"the quantity must be un, ut, rn or rt, got {quantity!r}")

    def functional(problem: ContactProblem) -> float:
        surfaces = {s.name: s for s in problem.surfaces}
        name = next(iter(surfaces)) if surface is None else surface
        if name not in surfaces:
            raise ValueError(f"no surface is named {name!r}; there are: {', '.join(surfaces)}")
        t = problem.table(surfaces[name])
        column = getattr(t, quantity)
        return value(t.along(column) if quantity in ("ut", "rt") else column, t)

    return functional


# -- evaluation ------------------------------------------------------------------------------------


def compiled(
    problem: ContactProblem, functionals: Mapping[str, Functional]
) -> dict[str, Callable[[], float]]:
    """Compile functionals to functions of the present state of the problem. Collective.

    Raises:
        ValueError: on every rank, if a functional is neither a scalar form nor a function, if its
            name is empty or the name of a column, or if the functionals or their order differ
            between ranks.
    """
    with everywhere(problem.comm, "the functionals"):
        for name in functionals:
            if not isinstance(name, str) or not name:
                raise ValueError(f"the name of a functional must be a word, got {name!r}")
        clash = sorted({*_COLUMNS, *status.KINDS} & set(functionals))
        if clash:
            raise ValueError(f"functionals must not have the names of columns: {', '.join(clash)}")
        contents = {name: _content(problem, name, f) for name, f in functionals.items()}
    same_everywhere(problem.comm, functionals=list(contents))
    same_everywhere(problem.comm, functionals=contents)
    return {name: _evaluator(problem, name, f) for name, f in functionals.items()}


def functional_forms(
    system: ParametricContact, functionals: Mapping[str, Functional]
) -> dict[str, str]:
    """Return the section ``forms`` of the manifest for functionals. Not collective.

    A form is identified by a hash of its signature and of the places of its Functions and Constants
    in the problem; a Python function only by its name.
    """
    problem = system.problem
    places = {id(d.value): d.place for d in placed_data(problem.equations)}
    places |= {id(problem.u): "the displacement", id(system.constant): "gamma"}
    texts = {}
    for name, f in functionals.items():
        text = "a function"
        if isinstance(f, ufl.Form):
            data = (*f.coefficients(), *f.constants())
            signature = "; ".join([f.signature(), *(places.get(id(d), "another") for d in data)])
            text = hashlib.sha256(signature.encode()).hexdigest()[:32]
        texts[f"the functional {name!r}"] = text
    return texts


def _content(problem: ContactProblem, name: str, f: Functional) -> str:
    """Describe a functional by a text for the comparison between ranks."""
    if isinstance(f, ufl.Form):
        if f.arguments():
            raise ValueError(f"the functional {name!r} must be a scalar form")
        return described(f, problem.V.mesh)
    if not callable(f):
        raise ValueError(f"the functional {name!r} is neither a UFL form nor a function")
    return "a function"


def _evaluator(problem: ContactProblem, name: str, f: Functional) -> Callable[[], float]:
    """Return the function, collective when called, that evaluates a functional."""
    comm = problem.comm
    if isinstance(f, ufl.Form):
        maps = merge_entity_maps([s.submesh for s in problem.surfaces])
        form = compiled_form(weighted(f, axisymmetric=problem.equations.axisymmetric), maps)
        return lambda: _real(name, comm.allreduce(fem.assemble_scalar(form)))

    def value() -> float:
        with everywhere(comm, f"the functional {name!r}"):
            result = f(problem)
            try:
                number = complex(result)
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
    """Return the value of a functional as a real number.

    Raises:
        ValueError: if it is not real.
    """
    if np.imag(value) != 0.0:
        raise ValueError(
            f"the functional {name!r} must be real, got {value}: record its real and imaginary "
            "parts as two functionals"
        )
    return float(np.real(value))
