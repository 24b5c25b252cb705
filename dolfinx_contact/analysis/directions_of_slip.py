# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Critical friction in space over the direction of sliding.

For each direction d in the plane of contact, with all points slipping along it, the coefficients
of `critical_friction`: S_dd v = F S_nd v. F > 0 belongs to slip against d and F < 0 to slip along
d, so that half a circle of directions shows all of them. Friction is the same in all directions and
acts against the slip; slip across d is held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._errors import require
from dolfinx_contact._numbers import is_count
from dolfinx_contact.analysis.critical_friction import BodySolverKind, critical_friction
from dolfinx_contact.analysis.rows import Problem, point_normals, static_equations

__all__ = ["FrictionByDirection", "critical_friction_by_direction"]

Array = npt.NDArray[np.float64]
_TILTED = 1e-3  # least size of the mean of all normals


@dataclass(frozen=True, eq=False)
class FrictionByDirection:
    """The critical friction of a body that slides, by the direction of its slip.

    Attributes:
        angles: of the directions, from the first of `basis` to the second (k,).
        directions: unit vectors along which the body slips (k, 3).
        friction: the smallest coefficient of each with a real slip of one sign (k,); infinite where
            none was found, which shows nothing beyond `known_up_to`.
        known_up_to: coefficients below which none is missing (k,); infinite if all were computed.
        basis: two directions of the plane of contact (2, 3).
    """

    angles: Array
    directions: Array
    friction: Array
    known_up_to: Array
    basis: Array

    @property
    def smallest(self) -> float:
        """Of all directions; infinite if none has any."""
        return float(self.friction.min())

    @property
    def direction(self) -> Array:
        """In which it is reached (3,)."""
        return np.asarray(self.directions[int(self.friction.argmin())])

    def __str__(self) -> str:
        """The smallest, its direction, and how far all are known."""
        known = float(self.known_up_to.min())
        words = "all were computed" if known == np.inf else f"known up to {known:.6g}"
        if not np.isfinite(self.smallest):
            return f"no critical friction in {len(self.angles)} directions; {words}"
        along = ", ".join(f"{v:.4g}" for v in self.direction)
        return (
            f"critical friction {self.smallest:.9g} for slip along ({along}), the smallest of "
            f"{len(self.angles)} directions; {words}"
        )


def _check(a: Arguments) -> None:
    if not (is_count(a.number) and a.number >= 2 and a.number % 2 == 0):
        raise ValueError(f"the number of directions must be even, 2 or more, got {a.number!r}")


@collective("critical friction by direction", _check)
def critical_friction_by_direction(
    problem: Problem,
    *,
    number: int = 36,
    count: int = 1,
    dense: bool | None = None,
    solver: BodySolverKind = "auto",
) -> FrictionByDirection:
    """Critical coefficients of friction over the direction of sliding, in 3D. Collective.

    The plane of contact is that across the mean of all normals. Every second direction takes a
    factorisation of the body, or a hierarchy of multigrid.

    Args:
        problem: as of `critical_friction`.
        number: of directions, even, of equal angles.
        count: of eigenvalues, see `critical_friction`.
        dense: whether all are computed, see `critical_friction`.
        solver: of the body, see `critical_friction`.

    Raises:
        ValueError: on every rank, for a body in the plane, normals that cancel, a number that does
            not fit, and as `critical_friction`.
        RuntimeError: if SLEPc does not converge.
    """
    eq = static_equations(problem)
    require(eq.comm, eq.dim == 3, "directions of slip are of bodies in 3D")
    normals = eq.comm.allgather(point_normals(eq).reshape(-1, 3))
    mean = np.concatenate(normals).mean(axis=0)
    size = float(np.linalg.norm(mean))
    require(eq.comm, size > _TILTED, "the normals cancel: there is no plane of contact")
    basis = plane_across(mean / size)
    half = number // 2
    angles = 2 * np.pi * np.arange(number) / number
    directions = np.cos(angles)[:, None] * basis[0] + np.sin(angles)[:, None] * basis[1]
    friction = np.full(number, np.inf)
    known = np.full(number, np.inf)
    for i in range(half):
        found = critical_friction(problem, directions[i], count=count, dense=dense, solver=solver)
        values = np.array(found.one_signed)
        # Slip along d has F < 0, slip along -d has F > 0.
        friction[i] = np.abs(values[values < 0]).min(initial=np.inf)
        friction[i + half] = values[values > 0].min(initial=np.inf)
        known[[i, i + half]] = found.known_up_to
    return FrictionByDirection(angles, directions, friction, known, basis)


def plane_across(normal: Array) -> Array:
    """Two unit vectors across a unit normal, the first near x (or y), seen from the body (2, 3)."""
    axis = np.eye(3)[0] if abs(normal[0]) < 0.9 else np.eye(3)[1]
    first = axis - (axis @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(first, normal)])
