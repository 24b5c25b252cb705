# SPDX-License-Identifier: LGPL-3.0-or-later
"""Branch and bound for a proof: the walk through the tree, in 2D and 3D.

A search proposes steps; the checker (`check_proof.follow`) takes them or refuses them. `plane.py`
and `space.py` decide how a region is closed or branched. In regions that are left open, Newton's
method is started; the solutions that it finds are certain, but there may be others.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

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
Array = npt.NDArray[np.float64]

MARGIN = 4.0  # times the round-off, so that another machine accepts the same steps


@dataclass
class SearchNode(Generic[R]):
    """A region of the tree.

    Attributes:
        region: the region.
        depth: number of branches above it.
        hint: statuses of a solution of the parent's problem (m,), in 2D.
    """

    region: R
    depth: int = 0
    hint: npt.NDArray[np.int8] | None = None


class Search(Generic[R]):
    """Search for a proof.

    Args:
        problem: reduced problem.
        seconds: time after which regions are left open.
        progress: function called with a description of the progress.

    Attributes:
        certificate: steps so far.
        proved: statements that the steps prove.
        problem: scaled problem.
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
        """Whether time is over."""
        return time.monotonic() > self._end

    def run(self, known: Iterable[Any]) -> None:
        """Search for all solutions.

        Args:
            known: known solutions: statuses (m,) in 2D, states (m, 6) in 3D.
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
        """Take a step and return the remaining parts; None if the checker refuses it."""
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
        """Try to prove that a region holds no solution other than that of a piece.

        Args:
            region: region.
            piece: piece of the solution.
            effort: iterations of each search for weights.

        Returns:
            Whether the region is closed, and the weights; None if the inequalities do not apply.
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

    def take_out(self, region: R, y: Array) -> tuple[npt.NDArray[np.bool_], bool]:
        """Exclude from a region what a vector excludes.

        Args:
            region: changed.
            y: multipliers.

        Returns:
            Excluded statuses (m, 7) or cells (k,), and whether the region is proved empty.
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
        """Close a region, or branch it."""
        raise NotImplementedError

    def _look_in_open_regions(self) -> None:
        raise NotImplementedError
