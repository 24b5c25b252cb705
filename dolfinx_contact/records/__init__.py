# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of branches, histories and paths: journals and checkpoints, for resumption.

`BranchRecord`, `EvolutionRecord` and `PathRecord` write records and resume killed runs;
`read_journal` reads them in any script, and `journal_of` makes a journal without the disk.
"""

from dolfinx_contact.records.branch_record import BranchRecord
from dolfinx_contact.records.functionals import leftmost, rightmost, total
from dolfinx_contact.records.journal import (
    EvolutionJournal,
    Journal,
    PathJournal,
    read_journal,
)
from dolfinx_contact.records.points import journal_of
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
