# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of branches, histories and paths: journals and checkpoints, for resumption.

`BranchRecord`, `EvolutionRecord` and `PathRecord` write records and resume interrupted runs.
`read_journal` reads a journal in any script, and `journal_of` creates a journal in memory.
"""

from typing import TYPE_CHECKING

from dolfinx_contact._install import loads
from dolfinx_contact.records.journal import (
    EvolutionJournal,
    Journal,
    PathJournal,
    read_journal,
)

if TYPE_CHECKING:
    from dolfinx_contact.records.branch_entries import journal_of
    from dolfinx_contact.records.branch_record import BranchRecord
    from dolfinx_contact.records.functionals import leftmost, rightmost, total
    from dolfinx_contact.records.series import write_series
    from dolfinx_contact.records.steps_record import EvolutionRecord, PathRecord

__all__ = [
    "BranchRecord",
    "EvolutionJournal",
    "EvolutionRecord",
    "Journal",
    "PathJournal",
    "PathRecord",
    "journal_of",
    "leftmost",
    "read_journal",
    "rightmost",
    "total",
    "write_series",
]

#: Names that need DOLFINx; the reader of journals needs NumPy only.
__getattr__ = loads(
    __name__,
    {
        "branch_entries": ("journal_of",),
        "branch_record": ("BranchRecord",),
        "functionals": ("leftmost", "rightmost", "total"),
        "series": ("write_series",),
        "steps_record": ("EvolutionRecord", "PathRecord"),
    },
)


def __dir__() -> list[str]:
    return __all__
