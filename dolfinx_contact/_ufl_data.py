# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL of the user: its Functions, Constants and meshes, and its content as text.

Nothing here is collective; `_errors.same_everywhere` compares the values of `described` between
ranks.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl
from dolfinx import fem, mesh
from ufl.corealg.traversal import unique_pre_traversal

from dolfinx_contact._compat import dirichlet_value, domains_of, is_mesh_of
from dolfinx_contact._validate import is_number

__all__ = [
    "data_of",
    "described",
    "refuse_displacement",
    "refuse_other_condition",
    "refuse_other_mesh",
]


def data_of(expression: Any) -> tuple[list[Any], list[Any], set[Any]]:
    """Return the Functions and Constants of a UFL expression, in UFL's order, and its meshes."""
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


def refuse_other_mesh(expression: Any, domain: mesh.Mesh, what: str) -> None:
    """Raise ``ValueError`` if a UFL expression or form belongs to another mesh.

    Args:
        expression: UFL expression of any shape, or form.
        domain: required mesh.
        what: name of the expression in the message.
    """
    if isinstance(expression, ufl.Form):
        functions, constants = expression.coefficients(), expression.constants()
        domains = set(expression.ufl_domains())
    else:
        functions, constants, domains = data_of(expression)
    required = domain.ufl_domain()
    for kind, data in (("Function", functions), ("Constant", constants)):
        for d in data:
            if set(domains_of(d)) != {required}:
                verb = "is" if d is expression else "contains"
                raise ValueError(f"{what} {verb} a {kind} of another mesh")
    if domains - {required}:
        raise ValueError(f"{what} belongs to another mesh")


def refuse_displacement(u: fem.Function, what: str, *functions: Any) -> None:
    """Raise ``ValueError`` if the displacement is among the Functions of an obstacle or a law.

    Args:
        u: displacement.
        what: name of the obstacle or law in the message.
        functions: Functions in its UFL.
    """
    if any(f is u for f in functions):
        raise ValueError(
            f"{what} depends on the displacement: its gap and normal are those of the reference "
            "configuration, to which the displacement is added (the gap is then gap - u.n)"
        )


def refuse_other_condition(bc: fem.DirichletBC, domain: mesh.Mesh) -> None:
    """Raise ``ValueError`` if a Dirichlet condition or its Function belongs to another mesh."""
    value = dirichlet_value(bc)
    spaces = [bc.function_space, getattr(value, "function_space", bc.function_space)]
    if not all(is_mesh_of(domain, space) for space in spaces):
        raise ValueError("a Dirichlet condition, or its value, is on a space of another mesh")


def described(value: Any, domain: mesh.Mesh) -> str:
    """Return the content of an argument as text, equal on ranks that pass the same argument.

    UFL is described by the values of its Constants and by its signature, which contains neither the
    counts of UFL's objects nor the values of Functions, which are distributed over the ranks.

    Args:
        value: number, UFL expression or form on ``domain``, Dirichlet condition, or any object with
            a `repr`.
        domain: mesh.
    """
    if isinstance(value, fem.DirichletBC):
        value = dirichlet_value(value)
        is_function = hasattr(value, "function_space")
        return "a Function" if is_function else repr(np.asarray(value.value).tolist())
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
