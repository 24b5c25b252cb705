# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the user's UFL is made of: whether it belongs to a mesh, and whether ranks mean the same.

Nothing here communicates; `_errors.same_everywhere` compares what `described` returns.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._compat import dirichlet_value, domains_of, is_mesh_of
from dolfinx_contact._numbers import is_number

__all__ = [
    "data_of",
    "described",
    "refuse_displacement",
    "refuse_other_condition",
    "refuse_other_mesh",
]


def refuse_other_mesh(expression: Any, domain: mesh.Mesh, what: str) -> None:
    """Raise ``ValueError`` if a UFL expression or form has to do with another mesh.

    Args:
        expression: of any shape, or a form.
        domain: the mesh that it is to belong to.
        what: it is, for the message.
    """
    if isinstance(expression, ufl.Form):
        domains: Iterable[Any] = expression.ufl_domains()
        coefficients = expression.coefficients()
        constants = expression.constants()
    else:
        coefficients, constants, domains = data_of(expression)
    mine = domain.ufl_domain()
    for f in coefficients:
        if f.ufl_function_space().ufl_domain() != mine:
            raise ValueError(f"{what} {_is_or_has(f, expression)} a Function of another mesh")
    for c in constants:
        if c.ufl_domain() != mine:
            raise ValueError(f"{what} {_is_or_has(c, expression)} a Constant of another mesh")
    if any(d != mine for d in domains):
        raise ValueError(f"{what} belongs to another mesh")


def data_of(expression: Any) -> tuple[list[Any], list[Any], set[Any]]:
    """Functions and Constants in a UFL expression, in the order of UFL, and its meshes."""
    functions = set[Any]()
    constants = set[Any]()
    domains = set[Any]()
    for part in unique_pre_traversal(expression):
        if part._ufl_is_terminal_:
            domains.update(domains_of(part))
            if isinstance(part, ufl.Coefficient):
                functions.add(part)
            elif isinstance(part, ufl.Constant):
                constants.add(part)
    return (
        sorted(functions, key=lambda f: f.count()),
        sorted(constants, key=lambda c: c.count()),
        domains - {None},
    )


def refuse_displacement(u: fem.Function, obstacle: Any, *functions: Any) -> None:
    """Raise ``ValueError`` if gap or normal of an obstacle depend on the displacement.

    Args:
        u: the displacement.
        obstacle: it is, for the message.
        functions: in its UFL gap and normal.
    """
    if any(f is u for f in functions):
        raise ValueError(
            f"{obstacle} depends on the displacement: its gap and normal are those of the "
            "reference configuration, to which the displacement is added (the gap is then "
            "gap - u.n)"
        )


def _is_or_has(part: Any, whole: Any) -> str:
    return "is" if part is whole else "contains"


def described(value: Any, domain: mesh.Mesh) -> str:
    """The content of an argument, equal on ranks that mean the same.

    For UFL these are the values of its Constants and its signature, in which neither the counts of
    UFL's objects nor the values of Functions, which are spread over the ranks, occur.

    Args:
        value: number, UFL expression or form of ``domain``, Dirichlet condition, or anything with
            a `repr`.
        domain: mesh.
    """
    if isinstance(value, fem.DirichletBC):
        value = dirichlet_value(value)
        if hasattr(value, "function_space"):
            return "a Function"
        return repr(np.asarray(value.value).tolist())
    if is_number(value):
        return repr(float(value))
    if isinstance(value, ufl.constantvalue.Zero):
        return "0"
    if isinstance(value, ufl.core.expr.Expr):
        value = ufl.inner(value, value) * ufl.dx(domain=domain)
    if not isinstance(value, ufl.Form):
        return repr(value)
    values = [np.asarray(c.value).tolist() for c in value.constants()]
    return f"{', '.join(map(repr, values)) or 'an expression'} (form {value.signature()[:12]})"


def refuse_other_condition(bc: fem.DirichletBC, domain: mesh.Mesh) -> None:
    """Raise ``ValueError`` if a Dirichlet condition or its Function is of another mesh."""
    value = dirichlet_value(bc)
    spaces = [bc.function_space, getattr(value, "function_space", bc.function_space)]
    if not all(is_mesh_of(domain, space) for space in spaces):
        raise ValueError("a Dirichlet condition, or its value, is on a space of another mesh")
