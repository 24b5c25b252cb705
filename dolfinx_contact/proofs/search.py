# SPDX-License-Identifier: LGPL-3.0-or-later
"""Branch and bound for proofs: traversal of the search tree in 2D and 3D.

The search proposes steps, which the checker (`check_proof.follow`) accepts or rejects. `plane.py`
and `space.py` close a region (finish its proof) or branch it. In regions left open, Newton's method
searches for solutions; these are proved to exist, but others may exist as well.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from dolfinx_contact._arrays import Array, Codes, Mask
from dolfinx_contact.proofs.check_proof import (
    Certificate,
    InvalidCertificate,
    PieceSolution,
    Proved,
    ReducedProblem,
    SpacePiece,
    SpaceRegion,
    StatusRegion,
    differences,
    follow,
    space_differences,
    whole_region,
)
from dolfinx_contact.proofs.weights import Weights, find_weights

__all__ = ["MARGIN", "Search", "SearchNode"]

logger = logging.getLogger(__name__)

R = TypeVar("R", StatusRegion, SpaceRegion)

MARGIN = 4.0  # required ratio of a dual bound to its error, for acceptance on other machines


@dataclass
class SearchNode(Generic[R]):
    """Node of the search tree.

    Attributes:
        region: remaining statuses or cells, with bounds of the solutions.
        depth: number of branchings above the node; by default 0.
        hint: in 2D, statuses of the m points at which Newton's method starts, taken from the parent
            node, shape (m,); by default None.
    """

    region: R
    depth: int = 0
    hint: Codes | None = None


class Search(Generic[R]):
    """Base class of the searches for a proof.

    Args:
        problem: reduced problem.
        seconds: time limit after which regions are left open; by default 0.
        progress: function called with a description of the progress; by default none.

    Attributes:
        certificate: proof with the accepted steps.
        proved: statements proved by these steps.
        problem: reduced problem scaled by `ReducedProblem.scaled`.
    """

    def __init__(
        self,
        problem: ReducedProblem,
        seconds: float = 0.0,
        progress: Callable[[str], None] = lambda _: None,
    ):
        self.certificate = Certificate(problem)
        self.proved = Proved()
        self.problem = problem.scaled
        self._progress = progress
        self._end = time.monotonic() + seconds
        self._random = np.random.default_rng(0)

    def late(self) -> bool:
        """Return whether the time limit is exceeded."""
        return time.monotonic() > self._end

    def run(self, known: Iterable[Any]) -> None:
        """Search for all solutions.

        Args:
            known: known solutions: statuses, shape (m,), in 2D; displacements and forces, shape (m,
                6), in 3D.
        """
        region: Any = whole_region(self.problem)
        if self.step(region, do="rest") is not None:
            return
        self._begin(known)
        waiting: list[SearchNode[R]] = [SearchNode(region)]
        count = 0
        while waiting:
            node = waiting.pop()
            count += 1
            self._progress(
                f"region {count}, {len(waiting)} waiting, {len(self.proved.inside)} solutions"
            )
            waiting += self._treat(node)
        if self.proved.open_regions:
            self._look_in_open_regions()

    def step(self, region: Any, **step: Any) -> Sequence[Any] | None:
        """Check a step, append it to the certificate and return the remaining parts of the region.

        None if the checker rejects the step.
        """
        try:
            parts = follow(self.certificate, step, region, self.proved)
        except InvalidCertificate as error:
            logger.debug("a step was refused: %s", error)
            return None
        self.certificate.steps.append(step)
        return parts

    def only(
        self, region: R, piece: PieceSolution | SpacePiece, effort: int
    ) -> tuple[bool, Weights | None]:
        """Try to prove that a region contains no solution except the solution of a piece.

        Args:
            region: region.
            piece: solution for one given status per point.
            effort: iterations of each search for weights.

        Returns:
            Whether this is proved; and the weights of the inequalities. The weights are None if the
            conditions of the inequalities are not provably satisfied.
        """
        items: dict[str, Any] = {"do": "only", "codes": piece.codes.tolist()}
        if isinstance(piece, SpacePiece):
            assert isinstance(region, SpaceRegion)
            items["z"] = piece.z.tolist()
            d: Any = space_differences(piece, region.cells, region.most)
        else:
            assert isinstance(region, StatusRegion)
            d = differences(piece, region.allowed, region.ub)
        if d is None:
            return False, None
        w = find_weights(d, effort=effort, until=self._end)
        if w.proof is None:
            return False, w
        return self.step(region, **items, **w.proof) is not None, w

    def take_out(self, region: R, y: Array) -> tuple[Mask, bool]:
        """Exclude the statuses or cells that a vector of multipliers proves impossible.

        Args:
            region: region, modified in place.
            y: multipliers of the equilibrium equations, shape (dim m,) for m points.

        Returns:
            Mask of the excluded statuses, shape (m, 7), or of the excluded ones of k cells, shape
            (k,); and whether the region is proved empty.
        """
        excluded = region.excluded(y, MARGIN)
        if not excluded.any():
            return excluded, False
        steps = self.certificate.steps
        number = self.certificate.vector(y)
        if region.empties(excluded):
            steps.append({"do": "empty", "y": number})
            return excluded, True
        pairs = excluded.ndim == 2
        what: Any = (np.argwhere(excluded) if pairs else np.flatnonzero(excluded)).tolist()
        steps.append({"do": "exclude", "y": number, "what": what})
        vars(region).update(vars(region.without(what, excluded)[0]))
        return excluded, False

    def _begin(self, known: Iterable[Any]) -> None:
        raise NotImplementedError

    def _treat(self, node: SearchNode[R]) -> list[SearchNode[R]]:
        """Close a region (finish its proof) or branch it; return the resulting nodes."""
        raise NotImplementedError

    def _look_in_open_regions(self) -> None:
        raise NotImplementedError
