# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of a branch at one value of its parameter."""

from __future__ import annotations

from dolfinx_contact._mpi import Arguments, collective, require, same_everywhere
from dolfinx_contact.continuation.arguments import (
    check_system,
    checked_gamma,
    checked_range,
)
from dolfinx_contact.continuation.branch import Branch, BranchPoint
from dolfinx_contact.continuation.follow import Route, follower_for
from dolfinx_contact.continuation.parameters import StepControl
from dolfinx_contact.continuation.system import System

__all__ = ["points_at", "require_solutions"]

_ALLOWED = 1e-6  # relative residual of a solution


def _check(a: Arguments) -> None:
    check_system(a.system)
    a.gamma = checked_gamma(a.gamma)
    a.gamma_range = checked_range(a.gamma_range, [a.gamma])
    if not isinstance(a.branch, Branch) or not a.branch.points:
        raise ValueError(f"a Branch with points is needed, got {type(a.branch).__name__}")


@collective("points_at", _check)
def points_at(
    system: System,
    branch: Branch,
    gamma: float,
    *,
    gamma_range: tuple[float, float],
    control: StepControl | None = None,
    route: Route = "auto",
) -> list[BranchPoint]:
    """Return the points of a branch at which its parameter is ``gamma``, in order. Collective.

    The data of the system are restored. Points in the small gap between a bifurcation and the first
    point of a branch that was traced out of it by steps are missed.

    Args:
        system: system of the branch.
        branch: complete branch.
        gamma: parameter, assumed to be monotone between neighbouring points of the branch and
            smooth folds.
        gamma_range: range of gamma of the branch.
        control: parameters of the corrector.
        route: method by which the branch was traced.

    Raises:
        ValueError: on every rank, if an argument is invalid or differs between ranks, or a point of
            the branch does not solve the present system.
        RuntimeError: on every rank, if a point that must exist is not found.
    """
    same_everywhere(system.comm, points_of_the_branch=len(branch.points))
    require_solutions(system, branch)
    system.check_parameter([gamma])
    low, high = gamma_range
    first = branch.points[0]
    x = system.create_vector()
    x.array[:] = first.y.array_r[: x.getLocalSize()]
    scale = high - low
    with (
        system.restored(always=True),
        follower_for(system, x, first.gamma, control, gamma_scale=scale, route=route) as follower,
    ):
        for point in branch.points:  # the first tangent that moves x sets its scale
            follower.bordered.set_scale(point.tangent, point.y)
        follower.bordered.require_scale()
        return follower.at(branch, gamma)


def require_solutions(system: System, branch: Branch) -> None:
    """Raise ``ValueError`` if a branch does not solve the present system. Collective.

    The residual is that of H itself: a recorded piece satisfies its own rows even if the friction
    coefficient has changed since.
    """
    x, b = system.create_vector(), system.create_vector()

    def error(point: BranchPoint) -> float:
        x.array[:] = point.y.array_r[: x.getLocalSize()]
        return system.residual(x, point.gamma, b, None)

    scales = system.scales
    worst = 0.0
    with system.restored(always=True):
        for _ in range(2):  # repeated, because the scales grow with the load
            worst = max(map(error, branch.points), default=0.0)
            if worst <= _ALLOWED:
                break
    system.scales = scales
    require(
        system.comm,
        worst <= _ALLOWED,
        f"not a solution of the problem as it is now: residual {worst:.1e} (allowed {_ALLOWED:g})",
    )
