# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Critical friction in 3D as a function of the sliding direction.

For each unit vector d in the plane of contact, slips v d, one factor v per point, cause the shears
(S_dd v) d and the pressures S_nd v, with blocks of the stiffness S of the contact points. The
critical coefficients are the eigenvalues F of S_dd v = F S_nd v (`critical_friction`). F > 0
belongs to sliding in the direction -d and F < 0 to sliding in the direction d, so that half a
circle of directions is sufficient. Friction is isotropic and opposes the slip; transverse slip is
prevented.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from dolfinx_contact._arrays import Array
from dolfinx_contact._mpi import Arguments, collective, require
from dolfinx_contact._petsc import destroy
from dolfinx_contact._validate import count
from dolfinx_contact.analysis.critical_friction import (
    BodySolverKind,
    check_request,
    constrained_body,
    critical_friction,
    softness_of,
    solver_of_body,
    takes_all,
)
from dolfinx_contact.analysis.rows import (
    Problem,
    component_rows,
    free_axes,
    is_free,
    on_gathered,
    point_normals,
    require_nodes,
    static_equations,
)
from dolfinx_contact.analysis.slip import TOLERANCE, Slip, free_motions
from dolfinx_contact.analysis.slip_modes import SlipModes
from dolfinx_contact.reduced.constrained_body import columns_of

__all__ = ["FrictionByDirection", "critical_friction_by_direction"]

_TILTED = 1e-3  # smallest length of the mean normal


@dataclass(frozen=True, eq=False)
class FrictionByDirection:
    """Critical friction of a sliding body as a function of the slip direction.

    Attributes:
        angles: angles of the k directions, measured from the first vector of `basis` towards the
            second, shape (k,).
        directions: unit vectors along which the body slips, shape (k, 3).
        friction: for each direction, the smallest coefficient with a real slip of one sign, shape
            (k,); infinite if none was found up to `known_up_to`.
        known_up_to: for each direction, the coefficient below which the search is complete, shape
            (k,); infinite if all coefficients were computed.
        basis: two unit vectors that span the plane of contact, shape (2, 3).
    """

    angles: Array
    directions: Array
    friction: Array
    known_up_to: Array
    basis: Array

    @property
    def smallest(self) -> float:
        """Smallest coefficient of all directions; infinite if none was found."""
        return float(self.friction.min())

    @property
    def direction(self) -> Array:
        """Direction with the smallest coefficient, shape (3,)."""
        return np.asarray(self.directions[int(self.friction.argmin())])

    def __str__(self) -> str:
        """Return the smallest coefficient, its direction, and the range that was searched."""
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
    if count(a.number, "number", least=2) % 2:
        raise ValueError(f"number must be even, got {a.number!r}")
    check_request(a)


@collective("critical friction by direction", _check)
def critical_friction_by_direction(
    problem: Problem,
    *,
    number: int = 36,
    count: int = 1,
    dense: bool | None = None,
    solver: BodySolverKind = "auto",
) -> FrictionByDirection:
    """Compute the critical friction in 3D for all sliding directions. Collective.

    The plane of contact is perpendicular to the mean normal. If all coefficients are computed, one
    factorisation of the body (or one multigrid hierarchy) serves all directions; otherwise each
    pair of opposite directions needs its own, because the held components depend on the direction.

    Args:
        problem: contact problem, as for `critical_friction`.
        number: number of equally spaced directions, an even number. Default 36.
        count: number of eigenvalues, see `critical_friction`.
        dense: whether all eigenvalues are computed, see `critical_friction`.
        solver: solver of the body, see `critical_friction`.

    Raises:
        ValueError: on every rank, for a 2D body, for normals whose mean vanishes, for an odd number
            of directions, and for the reasons listed in `critical_friction`.
        RuntimeError: if SLEPc does not converge.
    """
    eq = static_equations(problem)
    require(eq.comm, eq.dim == 3, "directions of slip are for bodies in 3D")
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
    points = _AllTangents(problem, solver)
    try:
        few = points.held and takes_all(dense, points.number, points.solver)
        for i in range(half):
            if few:
                values = points.coefficients(directions[i])
            else:
                found = critical_friction(
                    problem, directions[i], count=count, dense=dense, solver=solver
                )
                values = np.array(found.one_signed)
                known[[i, i + half]] = found.known_up_to
            # Slip along d has F < 0, slip along -d has F > 0.
            friction[i] = np.abs(values[values < 0]).min(initial=np.inf)
            friction[i + half] = values[values > 0].min(initial=np.inf)
    finally:
        points.destroy()
    return FrictionByDirection(angles, directions, friction, known, basis)


class _AllTangents:
    """Response of the contact points to forces along all tangents. Collective.

    With all normal displacements held, a unit force along each tangent causes the slips in a column
    of C and the pressures in a column of P. Unit slips in the directions of the columns of d cause
    the shears S_dd = d^T C^-1 d and the pressures S_nd = P C^-1 d.

    Args:
        problem: contact problem.
        solver: solver of the body.

    Attributes:
        number: number of points in contact.
        held: whether the body has no free rigid motion if the normal displacements of these points
            are held.
        solver: solver of the body, ``direct`` or ``amg``.
    """

    def __init__(self, problem: Problem, solver: BodySolverKind):
        self._eq = eq = static_equations(problem)
        require_nodes(eq)
        self._u = problem.evaluate().u
        n = point_normals(eq)
        touching = is_free(eq, n, 1 - TOLERANCE)
        across = np.eye(eq.dim) - np.einsum("ni,nj->nij", n, n)
        self._places = np.flatnonzero(touching)
        self._point, self._axes = free_axes(eq, across * touching[:, None, None])
        self._N = component_rows(eq, self._places, n[touching])
        self._tangents = component_rows(eq, self._point, self._axes)
        self.held = len(free_motions(eq, [self._N])) == 0
        self.number = int(eq.comm.allreduce(len(self._places)))
        self.solver = solver_of_body(eq, [self._N], solver)

    def coefficients(self, direction: Array) -> Array:
        """Return all critical F of a direction with a real slip of one sign; requires `held`."""
        eq = self._eq
        slip = Slip(eq, direction, None)
        softness = softness_of(slip.D, eq.bulk.stiffness(self._u))
        slip.destroy()
        C, P = self._responses
        held = ~slip.loose[self._point]
        along = self._point[:, None] == slip.places
        slips = np.where(along, self._axes @ slip.directions.T, 0.0)
        pressed = np.searchsorted(self._places, slip.places)
        # Each rank has its own points: the directions of all ranks form a block diagonal matrix.
        slips = block_diag(*(eq.comm.allgather(slips[held])))

        def real_ones(C: Array, P: Array, kept: Array, softness: Array) -> Array:
            forces = np.linalg.solve(C[np.ix_(kept, kept)], slips)
            flexibility = np.linalg.inv(slips.T @ forces)
            modes = SlipModes.of_matrix(flexibility, P[:, kept] @ forces @ flexibility, softness)
            return np.asarray(modes.friction[modes.one_signed].real)

        return on_gathered(eq.comm, real_ones, C, P[pressed], held, softness)

    @cached_property
    def _responses(self) -> tuple[Array, Array]:
        """Rows on this rank of C and P, the slips and pressures under unit forces, as columns.

        Collective when first computed.
        """
        body = constrained_body(self._eq, self._u, [self._N], self.solver)
        try:
            return body.respond(columns_of(self._tangents), self._tangents)
        finally:
            body.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects."""
        destroy(self._N, self._tangents)


def plane_across(normal: Array) -> Array:
    """Return two orthonormal vectors perpendicular to a unit normal, shape (2, 3).

    The first is the x axis projected onto the tangent plane, or the y axis if the normal is close
    to the x axis.
    """
    axis = np.eye(3)[0] if abs(normal[0]) < 0.9 else np.eye(3)[1]
    first = axis - (axis @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(first, normal)])
