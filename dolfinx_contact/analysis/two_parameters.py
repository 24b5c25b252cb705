# SPDX-License-Identifier: LGPL-3.0-or-later
"""Curves of folds and events of a contact problem with two parameters.

The first parameter is gamma, the parameter of the branches. The second parameter is a Constant: the
friction coefficient or another load. The data must be affine in it. The problem is condensed onto
its contact points at two values of the second parameter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact._mpi import Arguments, collective, on_root, require
from dolfinx_contact._validate import located
from dolfinx_contact.analysis.body_proofs import why_not_provable
from dolfinx_contact.analysis.curve_search import follow_events
from dolfinx_contact.analysis.event_curves import EventCurves
from dolfinx_contact.analysis.family import ContactFamily
from dolfinx_contact.continuation import Branch
from dolfinx_contact.continuation.arguments import checked_range
from dolfinx_contact.continuation.follow import require_solutions
from dolfinx_contact.equations.validation import check_law
from dolfinx_contact.laws.coulomb import BORDERS, FIRST_BORDER
from dolfinx_contact.parametric import ParametricContact
from dolfinx_contact.reduced.gathered import GatheredPoints
from dolfinx_contact.reduced.point_problem import PointProblem
from dolfinx_contact.reduced.reduction import Reduction
from dolfinx_contact.reduced.scope import can_condense

__all__ = ["contact_family", "event_curves"]


_MUST = (
    "the load and the friction must be affine in the second parameter, and the stiffness and the "
    "rate of the first must not depend on it"
)


def _check_family(a: Arguments) -> None:
    if not isinstance(a.other, fem.Constant) or a.other.ufl_shape != ():
        raise ValueError("the second parameter must be a scalar Constant")
    if a.other is a.system.constant:
        raise ValueError("the second parameter must differ from gamma")
    a.mu_range = checked_range(a.mu_range, [], "mu")


@collective("two parameters", _check_family)
def contact_family(
    system: ParametricContact, other: fem.Constant, *, mu_range: tuple[float, float]
) -> ContactFamily:
    """Condense a problem with gamma and a second parameter onto its contact points. Collective.

    Args:
        system: problem with the load parameter gamma.
        other: second parameter mu, a scalar Constant.
        mu_range: smallest and largest mu, at which the friction coefficients must not be negative.

    Raises:
        ValueError: on every rank, unless the problem is 2D with a linear body, Coulomb friction and
            nodal contact, and its data contain mu and are affine in it.
    """
    low, high = mu_range
    system.equations.require_same_mesh()
    curved = system.not_affine_in(other)
    require(system.comm, not curved, f"{_MUST} ({curved})")
    (a, reach), (b, _) = (_condensed(system, other, mu) for mu in mu_range)
    loads, frictions = (a.p, b.p), (a.friction, b.friction)
    present = any(
        float(np.abs(y - x).max(initial=0.0)) > 1e-14 * float(np.abs(y).max(initial=0.0))
        for x, y in (loads, frictions)
    )
    require(system.comm, present, "the second parameter does not appear in the contact problem")
    v, slope = (np.asarray((y - x) / (high - low)) for x, y in (loads, frictions))
    p, friction = (np.asarray(x - low * rate) for x, rate in ((a.p, v), (a.friction, slope)))
    of_S, of_p, of_q = (np.maximum(x, y) for x, y in zip(_errors(a), _errors(b), strict=True))
    # Between the two values the load is a mean of the two loads.
    of_p = of_p + 8 * np.finfo(float).eps * (np.abs(a.p) + np.abs(low * v))
    assert a.rate is not None
    return ContactFamily(a.S, p, a.rate, v, friction, slope, of_S, of_p, of_q, reach, system.comm)


def _errors(problem: PointProblem) -> tuple[Array, Array, Array]:
    """Return error bounds of the stiffness, the load, and the derivative of the load in gamma."""
    assert problem.S_error is not None
    assert problem.p_error is not None
    assert problem.rate_error is not None
    return problem.S_error, problem.p_error, problem.rate_error


def _condensed(
    system: ParametricContact, other: fem.Constant, mu: float
) -> tuple[PointProblem, Array]:
    """Return the contact points and `ContactFamily.reach` at one mu and gamma = 0. Collective."""
    eq = system.equations
    with _put(other, mu), system.restored(always=True):
        system.set_parameter(0.0)
        for s, memory in zip(eq.surfaces, eq.memory, strict=True):
            s.update_geometry()
            with located(f"where the second parameter is {mu:g}"):
                check_law(s, memory)
        fits = system.is_linear and can_condense(system)
        fits = fits and not any(s.law.bound_kind == "given" for s in eq.surfaces)
        nothing = system.create_vector()
        condensed = Reduction(system, nothing, 0.0, exact=True) if fits else None
        nothing.destroy()
        obstacle = why_not_provable(eq, condensed)
        if condensed is not None:
            condensed.destroy()
        require(system.comm, not obstacle, f"two parameters: {obstacle}")
        assert condensed is not None
        return condensed.problem(unit=condensed.force_unit), condensed.points.reach


@contextmanager
def _put(other: fem.Constant, mu: float) -> Iterator[None]:
    """Context manager that sets the second parameter and restores its value afterwards."""
    before = other.value.copy()
    other.value = mu
    try:
        yield
    finally:
        other.value = before


def _check_curves(a: Arguments) -> None:
    a.branches = [(float(mu), branch) for mu, branch in a.branches]
    if not all(isinstance(branch, Branch) for _, branch in a.branches):
        raise ValueError("branches must be pairs of a value of the second parameter and a Branch")
    a.mu_range = checked_range(a.mu_range, [mu for mu, _ in a.branches], "mu")
    a.gamma_range = checked_range(a.gamma_range, [])


@collective("event curves", _check_curves)
def event_curves(
    system: ParametricContact,
    other: fem.Constant,
    branches: Sequence[tuple[float, Branch]],
    *,
    mu_range: tuple[float, float],
    gamma_range: tuple[float, float],
    folds_only: bool = True,
) -> EventCurves:
    """Compute the curves of folds and events of branches in a second parameter. Collective.

    Args:
        system: problem with the load parameter gamma.
        other: second parameter mu, a scalar Constant.
        branches: pairs (mu, branch), where the branch was followed with this mu.
        mu_range: smallest and largest mu.
        gamma_range: smallest and largest gamma.
        folds_only: whether only curves of folds are followed, and no events. Default True.

    Returns:
        Curves through the events of the branches, and all curves that they meet, exact up to
        round-off.

    Raises:
        ValueError: on every rank, for the reasons listed in `contact_family`; if ``branches`` is
            not a sequence of such pairs or contains a mu outside ``mu_range``; or if a point of a
            branch does not solve the present problem at its mu.
    """
    system.equations.require_same_mesh()
    for mu, branch in branches:
        with _put(other, mu):
            require_solutions(system, branch)
    family = contact_family(system, other, mu_range=mu_range)
    points = GatheredPoints(system)
    starts = [
        (codes, mu)
        for mu, branch in branches
        for codes in _borders(points, branch, folds_only=folds_only)
    ]
    return on_root(
        system.comm,
        lambda: follow_events(family, starts, mu_range, gamma_range, folds_only=folds_only),
    )


def _borders(points: GatheredPoints, branch: Branch, *, folds_only: bool) -> list[Codes]:
    """Return the statuses at the events of a branch where one point changes. Collective.

    The code of this point denotes its border; events at which several points change are omitted.
    """
    found = []
    for special in branch.folds if folds_only else branch.special:
        before, after = (
            points.gathered(branch.points[k].piece.codes)
            for k in (special.index - 1, special.index)
        )
        changed = np.flatnonzero(before != after)
        pairs = [tuple(sorted((int(before[i]), int(after[i])))) for i in changed]
        if len(pairs) == 1 and pairs[0] in BORDERS:
            codes = before.copy()
            codes[changed] = FIRST_BORDER + BORDERS.index(pairs[0])
            found.append(codes)
    return found
