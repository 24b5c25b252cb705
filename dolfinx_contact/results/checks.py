# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is to be doubted in a state or a problem, measured and said.

- Gap and normal are those of the reference configuration. At the points of a curved obstacle the
  distance to it is measured where they are now: the *misfit*.
- det F = det(I + grad u) <= 0 where a hyperelastic body is turned inside out. Energies that do not
  grow without bound there (St Venant-Kirchhoff), and large Newton steps, let that pass.
- An obstacle on the wrong side, or so far away that a friction bound given in advance acts on a
  free surface.
"""

from __future__ import annotations

import logging

import numpy as np
import numpy.typing as npt

from dolfinx_contact.body.cells import midpoints
from dolfinx_contact.body.deformation import smallest_jacobian
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.order import by_coordinates
from dolfinx_contact.equations.state import State
from dolfinx_contact.laws.status import closed
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["misfits", "warn_of_inversion", "warn_of_obstacles"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]

_LARGEST_MISFIT = 1e-3  # of the body's size, above which there is a warning
_FAR = 10.0  # body sizes


# -- states --------------------------------------------------------------------------------------


def warn_of_inversion(eq: ContactEquations, u: Array) -> float | None:
    """The smallest det F of a body that is not linear, with a warning if it is not positive.

    None for bodies that are linear in u, whose strains are small by assumption. Collective.
    """
    if eq.bulk.linear:
        return None
    value, place = smallest_jacobian(eq.V, u, axisymmetric=eq.axisymmetric)
    if not value > 0 and eq.comm.rank == 0:
        logger.warning(
            "the body is turned inside out: det F = %.3g in the cell at %s of the reference "
            "configuration",
            value,
            _shown(place),
        )
    return value


def misfits(eq: ContactEquations, state: State) -> dict[str, float | None]:
    """By surface, how far the gap of the law is off where the points are now. Collective.

    At closed points, which the law has on the obstacle, the distance by which they hang above or in
    it; at open points how deep they are in it, which the law does not see. Zero on flat obstacles,
    None where the obstacle does not say (`obstacles.gap_at`). Logs a warning if one is above 1e-3
    of the body's size.
    """
    found: dict[str, float | None] = {}
    for s, clamped, contact in zip(
        eq.surfaces, eq.constraints.clamped, state.surfaces, strict=True
    ):
        if s.obstacle.flat:
            found[s.name] = 0.0
            continue
        true_gaps = s.true_gaps()
        if true_gaps is None:
            found[s.name] = None
            continue
        true, law = true_gaps, eq.gaps(s, state)
        depth = np.maximum(np.maximum(-true, 0) - np.maximum(-law, 0), 0)
        off = np.where(closed(contact.statuses), np.abs(true - law), depth)
        if s.method != "integral":
            off = np.where(clamped[: len(off)], 0.0, off)
        gather = s.comm.allgather
        found_there = (s.positions, s.points.ids, true, off)
        x, ids, true, off = (np.concatenate(gather(v)) for v in found_there)
        order = by_coordinates(x, ids)
        x, true, off = x[order], true[order], off[order]
        # Of points with the same value, up to round-off, the first in the table.
        i = int(np.flatnonzero(~(off < (1 - 1e-9) * np.max(off)))[0])
        found[s.name] = float(off[i])
        if not off[i] <= _LARGEST_MISFIT * eq.body_size and s.comm.rank == 0:
            logger.warning(
                "%s: the sliding is not small: gap and normal are those of the reference "
                "configuration, and that of the point which was at %s is off by %.3g (%.2g of the "
                "body's size); the point is %.3g %s the obstacle",
                s.name,
                _shown(x[i]),
                off[i],
                off[i] / eq.body_size,
                abs(true[i]),
                "inside" if true[i] < 0 else "away from",
            )
    return found


# -- obstacles -----------------------------------------------------------------------------------


def warn_of_obstacles(eq: ContactEquations) -> None:
    """Warn of obstacles on the wrong side and of friction far from one. Collective."""
    for s in eq.surfaces:
        n = s.points.vertices.dofmap.index_map.size_local
        gaps = s.points.vertex_gaps[:n]
        nearest = s.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=min)
        if not np.isfinite(nearest):
            continue  # a solve refuses it
        given = not s.law.needs_pressure and s.law.spread is None
        if given and nearest > _FAR * eq.body_size:
            bound = float(np.nanmax(s.friction_slope(), initial=0.0))
            if s.comm.allreduce(bound, op=max) > 0 and s.comm.rank == 0:
                logger.warning(
                    "%s: the friction bound of Tresca acts on the whole surface, and the obstacle "
                    "is %.3g away, more than ten times the size of the body",
                    s.name,
                    nearest,
                )
        _warn_of_side(eq, s, nearest)


def _warn_of_side(eq: ContactEquations, s: ContactSurface, lowest: float) -> None:
    """Warn if the contact normal points into the body where that comes nearest. Collective.

    Of a body that is deep in its obstacle those points decide that are deepest, and where they face
    neither way (the rims of a round foot) those that are nearest to the obstacle's surface.
    """
    tolerance, gaps = 1e-9 * eq.body_size, s.points.vertex_gaps
    closest = s.comm.allreduce(float(np.min(np.abs(gaps), initial=np.inf)), op=min)
    deepest, x = _facing(s, gaps <= lowest + tolerance)
    if deepest < -0.5:
        opposed = deepest, x
    elif deepest < 0.5:
        opposed = _facing(s, np.abs(gaps) <= closest + tolerance)
    else:
        return
    if opposed[0] < -0.5 and s.comm.rank == 0:
        logger.warning(
            "%s: where the body comes nearest to the obstacle, at %s, the contact normal points "
            "into the body: the obstacle is on the wrong side (a plane with its normal reversed, a "
            "sphere inside the body)",
            s.name,
            _shown(opposed[1]),
        )


def _facing(s: ContactSurface, marked: npt.NDArray[np.bool_]) -> tuple[float, Array]:
    """Largest n.N over the facets around ``marked`` local vertices, N outward, and where."""
    domain, dim, m = s.domain, s.dim, len(s.submesh.parent_facets)
    corners = s.points.vertices.dofmap.list[:m]
    # Without the round-off in them, so that the first of several places is the same everywhere.
    x = _rounded(s.points.vertices.tabulate_dof_coordinates()[:, :dim])
    to_cells = domain.topology.connectivity(dim - 1, dim)
    inside = midpoints(domain, to_cells.array[to_cells.offsets[s.submesh.parent_facets]])
    edges = x[corners[:, 1:dim]] - x[corners[:, :1]]
    if dim == 2:
        N = np.stack([edges[:, 0, 1], -edges[:, 0, 0]], axis=1)
    else:
        N = np.cross(edges[:, 0], edges[:, 1])
    N *= np.sign(np.sum(N * (x[corners[:, 0]] - inside), axis=1))[:, None]
    N /= np.linalg.norm(N, axis=1)[:, None]
    along = np.einsum("fd,fvd->fv", N, s.points.vertex_normals[corners])
    along = np.round(np.where(marked[corners], along, -np.inf).reshape(-1), 9)
    places = x[corners.reshape(-1)[along == np.max(along, initial=-np.inf)]].tolist()
    mine: tuple[float, list[float]] = (
        float(np.max(along, initial=-np.inf)),
        min(places, default=[]),
    )
    # The same place on any number of ranks.
    value, place = min(s.comm.allgather(mine), key=lambda part: (-part[0], part[1]))
    return value, np.array(place)


def _rounded(x: Array) -> Array:
    """Coordinates to nine digits of the largest."""
    size = 10.0 ** np.ceil(np.log10(np.max(np.abs(x), initial=1e-300)))
    return np.round(x / size, 9) * size + 0.0


def _shown(x: npt.ArrayLike) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in _rounded(np.asarray(x))) + ")"
