# SPDX-License-Identifier: LGPL-3.0-or-later
"""The journal of a path by arc length: the load at its points, its folds and kinks."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact.records.evolution_journal import EvolutionJournal
from dolfinx_contact.records.lines import FILE_NAME, parse

__all__ = ["PathJournal", "read_path"]


@dataclass
class PathJournal(EvolutionJournal):
    """What was recorded, as an `EvolutionJournal`; times are arc lengths."""

    kind: ClassVar[str] = "a path"
    of_states: ClassVar[tuple[str, ...]] = (
        *EvolutionJournal.of_states,
        *("gamma", "arrived", "number", "length", "known", "reason"),
    )
    of_steps: ClassVar[tuple[str, ...]] = ("row",)

    @property
    def gammas(self) -> npt.NDArray[np.float64]:
        """The load at the start and at all accepted points."""
        return np.array([s["gamma"] for s in self.states])

    @property
    def folds(self) -> list[dict[str, Any]]:
        """The rows of points at which the load turns back."""
        return [row for row in self.rows() if row["event"].endswith("fold")]

    @property
    def kinks(self) -> list[dict[str, Any]]:
        """The rows of points at which statuses change and the load goes on."""
        return [row for row in self.rows() if row["event"] == "kink"]


def read_path(folder: str | os.PathLike[str]) -> PathJournal:
    """Read the journal of a folder, on this rank alone; it may be that of a run that goes on.

    Raises:
        OSError: if there is none.
        ValueError: if it is damaged, or no journal of a path.
    """
    return parse((Path(folder) / FILE_NAME).read_bytes(), PathJournal)
