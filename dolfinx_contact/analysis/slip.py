# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Slip pattern: slipping points with their directions, and the corresponding rows of B.

Let n be unit normals from the body into the obstacle, d unit slip directions, and r = -r_n n + r_t
the forces on the body. Linear analyses of sliding contact split the jumps j = B u into three parts,

    N u = n.j,    D u = d.j    at slipping points,    H u = 0    for held components.

H contains n and all tangents at sticking points, the tangent across d in 3D if transverse slip is
held, and only n at points whose shear does not depend on the pressure. Components with Dirichlet
data are excluded: a point with prescribed slip is held, and a point with prescribed normal motion
is not in contact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._geometry import Gathered, plane_tangents
from dolfinx_contact._mpi import require
from dolfinx_contact._petsc import destroy, product, stacked
from dolfinx_contact.analysis.rows import (
    component_rows,
    free_axes,
    is_free,
    point_normals,
    require_nodes,
    split,
    unit,
)
from dolfinx_contact.body import rigid
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.laws.friction import Frictionless
from dolfinx_contact.laws.status import MINUS, PLUS, closed, senses

__all__ = ["TOLERANCE", "Direction", "Slip", "free_motions"]

#: Slip direction: a vector, of which the tangential part is used; ``"solution"`` for the slipping
#: points and directions of the solution in the Functions; or None for t = (-n_y, n_x) in 2D.
Direction = npt.ArrayLike | Literal["solution"] | None

TOLERANCE = 1e-6  # error of a direction cosine that counts as zero


class Slip:
    """Matrices that map displacements to the jump components of a slip pattern. Collective.

    Args:
        eq: contact problem with contact at nodes.
        direction: slip direction of all points as a vector, "solution" for the pattern of
            ``evaluation``, or None for the tangents (-n_y, n_x) in 2D.
        evaluation: solution, used if ``direction`` is "solution".
        steady: whether all closed points slide steadily: none is loose, and transverse slip is not
            held in 3D. By default the laws determine the loose points.

    Attributes:
        loose: mask of the closed points of this rank whose shear does not depend on the pressure,
            because they have no friction or slip under a prescribed bound, shape (n,).
        number: number of slipping points on all ranks.
        places: indices of the slipping points of this rank among its contact points.
        directions: unit slip directions of these points, shape (number of places, dim).
        N, D, H: matrices of normal jumps, slips and held components; 0 in Dirichlet columns.

    Raises:
        ValueError: on every rank, if the direction is not valid, or is normal to the surface at a
            point with friction, with ``method="integral"``, if several surfaces hold the same
            node, or if no point can slip.
    """

    def __init__(
        self,
        eq: ContactEquations,
        direction: Direction,
        evaluation: Evaluation | None,
        *,
        steady: bool = False,
    ):
        self._eq = eq
        self.comm = eq.comm
        n = point_normals(eq)
        smooth, given = np.zeros((2, len(n)), dtype=bool) if steady else _laws(eq)
        if isinstance(direction, str):
            require(eq.comm, direction == "solution", _unknown(direction))
            assert evaluation is not None
            touching, d = _of_state(eq, evaluation)
        else:
            touching, d = np.ones(len(n), dtype=bool), _along(eq, direction, smooth)
        self.loose = touching & (smooth | (given & d.any(axis=1)))
        require_nodes(eq)
        touching = touching & is_free(eq, n, 1 - TOLERANCE)
        loose = touching & self.loose
        _require_nodes_of_one(eq, touching, loose)
        slips = touching & ~loose & is_free(eq, d, 1 - TOLERANCE)
        self.places = np.flatnonzero(slips)
        self.number = int(eq.comm.allreduce(len(self.places)))
        require(eq.comm, self.number > 0, "no contact point can slip with friction")
        self.directions = d[slips]
        pressed = np.flatnonzero(touching & ~slips)
        # Held tangents, as far as Dirichlet data leave them free.
        across = np.eye(eq.dim) - np.einsum("ni,nj->nij", n, n)
        across -= np.einsum("ni,nj->nij", d, d) * slips[:, None, None]
        across *= (touching & ~loose & ~(slips & steady))[:, None, None]
        point, axes = free_axes(eq, across)
        held = np.concatenate([n[pressed], axes])
        self.N = component_rows(eq, self.places, n[slips])
        self.D = component_rows(eq, self.places, self.directions)
        self.H = component_rows(eq, np.concatenate([pressed, point]), held)

    def require_held(self) -> None:
        """Raise `ValueError` if a rigid motion is prevented only by friction. Collective."""
        eq = self._eq
        loose = free_motions(eq, [self.N, self.H])
        if len(loose):
            words = eq.scaling.parts.describe(loose)
            raise ValueError(f"the body slides without resistance ({words}): nothing is critical")

    def in_order(self, values: Array) -> tuple[Array, Array]:
        """Return positions and values at all slipping points, ordered by coordinates. Collective.

        Args:
            values: values at the n slipping points of this rank, shape (n, ...).
        """
        x, ids = (
            np.concatenate(parts)[self.places]
            for parts in zip(*((s.positions, s.points.ids) for s in self._eq.surfaces), strict=True)
        )
        gathered = Gathered(self.comm, x, ids)
        return gathered.positions, gathered(values)

    def destroy(self) -> None:
        """Free the matrices."""
        destroy(self.N, self.D, self.H)


def _along(eq: ContactEquations, direction: Direction, smooth: Mask) -> Array:
    """Return unit tangents along a direction; 0 at frictionless points where it is normal."""
    n = point_normals(eq)
    if direction is None:
        require(eq.comm, eq.dim == 2, "in 3D a direction of slip must be given")
        return plane_tangents(n)
    try:
        given = np.asarray(direction, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.full(0, np.nan)
    fits = given.shape == (eq.dim,) and bool(np.isfinite(given).all() and given.any())
    require(eq.comm, fits, _unknown(direction))
    along = unit(split(n, given / np.linalg.norm(given))[1], TOLERANCE)
    message = f"the direction of slip {given.tolist()} is normal to the contact surface"
    require(eq.comm, bool(along[~smooth].any(axis=1).all()), message)
    return along


def _of_state(eq: ContactEquations, evaluation: Evaluation) -> tuple[Mask, Array]:
    """Return a mask of the closed points of a solution, and unit slip directions or 0."""
    n = point_normals(eq)
    codes = np.concatenate([c for c in evaluation.statuses])
    touching = closed(codes)
    sense = senses(codes)
    sign = np.where(sense == PLUS, 1.0, np.where(sense == MINUS, -1.0, 0.0)) * touching
    if eq.dim == 2:
        tangent = plane_tangents(n)
    else:
        tangent = unit(split(n, np.concatenate([s.jump for s in evaluation.surfaces]))[1])
    return touching, sign[:, None] * tangent


def _laws(eq: ContactEquations) -> tuple[Mask, Mask]:
    """Return masks of points without friction and of points with a Tresca bound, shape (n,)."""
    flags = [(isinstance(s.law, Frictionless), s.law.bound_kind == "given") for s in eq.surfaces]
    numbers = [s.points.number for s in eq.surfaces]
    smooth, given = np.repeat(np.array(flags, dtype=bool), numbers, axis=0).T
    return smooth, given


def _unknown(direction: Any) -> str:
    return f'a direction of slip is a vector or "solution", got {direction!r}'


def _require_nodes_of_one(eq: ContactEquations, touching: Mask, loose: Mask) -> None:
    """Raise `ValueError` if rigid obstacles constrain a motion of a node twice. Collective.

    If a node touches several obstacles, all its contact points must be loose and have independent
    normals. A point that is not loose determines the motion of its node in all directions.

    Args:
        eq: contact problem.
        touching: mask of the closed points of this rank, shape (n,).
        loose: mask of the loose points (`Slip`), shape (n,).
    """
    on_obstacle = [i for i, s in enumerate(eq.surfaces) if not s.between_bodies]
    if len(on_obstacle) < 2:
        return
    to_global = eq.V.dofmap.index_map.local_to_global
    nodes = [to_global(s.points.trace_nodes[: s.points.number]) for s in eq.surfaces]
    surface = np.repeat(np.arange(len(nodes)), [len(part) for part in nodes])
    mine = touching & np.isin(surface, on_obstacle)
    parts = [v[mine] for v in (np.concatenate(nodes), surface, loose, point_normals(eq))]
    node, surface, loose, n = map(np.concatenate, zip(*eq.comm.allgather(parts), strict=True))
    order = np.argsort(node, kind="stable")
    for at in np.split(order, np.flatnonzero(np.diff(node[order])) + 1):
        if len(at) > 1 and not (loose[at].all() and np.linalg.matrix_rank(n[at]) == len(at)):
            names = " and ".join(eq.surfaces[i].name for i in np.unique(surface[at]))
            message = f"surfaces {names} hold nodes in common: leave a facet out between them"
            raise ValueError(message)


def free_motions(eq: ContactEquations, blocks: Sequence[PETSc.Mat]) -> Array:
    """Return the rigid motions not held by Dirichlet data or constraint rows. Collective.

    Args:
        eq: contact problem.
        blocks: matrices whose rows are constraints of the displacement.

    Returns:
        Basis of the free motions, one per row.
    """
    motions = eq.scaling.loose
    if len(motions) == 0:
        return motions
    rows = stacked(blocks)
    R = np.array([product(rows, motion.reshape(-1)) for motion in motions])
    rows.destroy()
    # combinations of motions without jumps on any rank
    return rigid.combine(eq.comm.allreduce(R @ R.T), motions)
