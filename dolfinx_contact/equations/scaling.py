# SPDX-License-Identifier: LGPL-3.0-or-later
"""What follows the stiffness of a body: its typical size, the r of surfaces, and loose motions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.equations.augmentation import automatic_augmentation, require_hoop_stiffness
from dolfinx_contact.equations.loose import LooseMotions
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.points.surface import ContactSurface

if TYPE_CHECKING:
    from dolfinx_contact.body.moving import MovingBody

__all__ = ["Scaling"]

Array = npt.NDArray[np.float64]
_MUCH = 10.0  # times the stiffness, beyond which scales are taken anew


class Scaling:
    """Typical stiffness of a body, augmentation of its surfaces, motions that contact has to hold.

    Args:
        bulk: the body.
        V: space of its displacement.
        surfaces: where it may touch; they get their r.
        fixed: local nodes x dim, components that Dirichlet data fix.
        rigid: the rigid bodies that surfaces touch.
        body_size: a length.
        forced_r: augmentation parameter; None for the automatic one. Collective, as all here.

    Attributes:
        stiffness: mean diagonal entry.
        automatic_r: at the local vertices of each surface.
        at_vertices: stiffness of a node by its area, there.
        loose: rigid motions that neither stiffness nor Dirichlet data hold.

    Raises:
        ValueError: on every rank, if the stiffness is zero or not finite.
    """

    def __init__(
        self,
        bulk: Bulk | MovingBody,
        V: fem.FunctionSpace,
        surfaces: Sequence[ContactSurface],
        fixed: npt.NDArray[np.bool_],
        rigid: RigidBodies,
        body_size: float,
        forced_r: float | None,
    ):
        self._bulk = bulk
        self._V = V
        self._surfaces = surfaces
        self._comm = V.mesh.comm
        self._given = fixed, rigid
        self._size = body_size
        self._forced = forced_r
        self.stiffness = 0.0
        self._mark = -1
        self.automatic_r = [0.0 * s.points.r for s in surfaces]
        self.at_vertices = [0.0 * s.points.r for s in surfaces]
        self.loose: LooseMotions
        self.follow(bulk.displacement.x.array.copy())

    def follow(self, u: Array) -> None:
        """Take scales anew where data have made the body more than ten times stiffer or softer.

        A body that is not linear is measured at ``u``, at all local dofs. If another problem has
        had the surfaces in between they get the r of this one.
        """
        if self._anywhere(self._bulk.stiffness_mark != self._mark):
            self._measure(u)
        self._augment(self._forced)

    def _measure(self, u: Array) -> None:
        surfaces = self._surfaces
        fixed, rigid = self._given
        K = self._bulk.stiffness(u)
        around = surfaces[0].axisymmetric
        if around:
            require_hoop_stiffness(K)
        scale, automatic, at_vertices = automatic_augmentation(K, self._V, surfaces, self._size)
        moves = None if self._bulk.has_mass else K
        self.loose = LooseMotions(moves, self._V, surfaces, fixed, rigid, axisymmetric=around)
        self._mark = self._bulk.stiffness_mark
        a = np.concatenate([[self.stiffness], *self.automatic_r])
        b = np.concatenate([[scale], *automatic])
        if self._anywhere(bool(np.any(np.maximum(a, b) > _MUCH * np.minimum(a, b)))):
            self.stiffness = scale
            self.automatic_r = automatic
            self.at_vertices = at_vertices

    def _anywhere(self, here: bool) -> bool:
        return bool(self._comm.allreduce(int(here)))

    @contextmanager
    def automatic(self) -> Iterator[None]:
        """Use the automatic r while the context lasts."""
        self._augment(None)
        try:
            yield
        finally:
            self._augment(self._forced)

    def _augment(self, forced: float | None) -> None:
        for s, r in zip(self._surfaces, self.automatic_r, strict=True):
            s.points.set_augmentation(r if forced is None else np.full_like(r, forced))
