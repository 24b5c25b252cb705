# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions of discontinuous spaces in the form of a body, where continuous ones are meant."""

from __future__ import annotations

import logging
from typing import Any

from mpi4py import MPI

import ufl
from dolfinx import fem
from ufl.algorithms import expand_derivatives, extract_coefficients
from ufl.corealg.traversal import unique_pre_traversal

__all__ = ["check_jumps"]

logger = logging.getLogger(__name__)


def check_jumps(form: ufl.Form, comm: MPI.Comm) -> None:
    """Look for Functions whose jumps from cell to cell a form leaves out. Not collective.

    Of a gradient of one that is nowhere on interior facets it warns: there the derivative of the
    jumps is missing.

    Args:
        form: energy or residual.
        comm: of the ranks, of which one warns.

    Raises:
        ValueError: if one stands on interior facets without a side.
    """
    if all(_is_continuous(f) for f in form.coefficients()):
        return
    inside = [i.integrand() for i in form.integrals_by_type("interior_facet")]
    without = sorted(f.name for e in inside for f in _without_side(e))
    if without:
        raise ValueError(
            f"the Function {without[0]!r} has two values on interior facets (dS), being of a "
            "discontinuous space: say which, f('+'), f('-') or avg(f), or take a continuous one"
        )
    beside = {f for e in inside for f in extract_coefficients(e)}
    lost = sorted(f.name for f in _differentiated(form) if f not in beside)
    if lost and comm.rank == 0:
        logger.warning(
            "the form takes the gradient of the Function %r, of a discontinuous space: what it "
            "jumps from cell to cell is left out; take a continuous one",
            lost[0],
        )


def _without_side(e: Any) -> set[fem.Function]:
    """Functions of discontinuous spaces outside of restrictions to a side."""
    if isinstance(e, ufl.classes.Restricted):
        return set()
    if isinstance(e, ufl.classes.Coefficient):
        return set() if _is_continuous(e) else {e}
    return {f for part in e.ufl_operands for f in _without_side(part)}


def _differentiated(form: ufl.Form) -> set[fem.Function]:
    """Functions of discontinuous spaces whose gradient is taken."""
    found = set()
    for integral in expand_derivatives(form).integrals():
        for node in unique_pre_traversal(integral.integrand()):
            if isinstance(node, ufl.classes.Grad):
                found |= {f for f in extract_coefficients(node) if not _is_continuous(f)}
    return found


def _is_continuous(f: fem.Function) -> bool:
    return f.ufl_function_space().ufl_element() in ufl.H1
