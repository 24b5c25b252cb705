# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of branches, histories and paths: journals and checkpoints, for resumption."""

from dolfinx_contact.records.branch_record import BranchRecord, resume
from dolfinx_contact.records.evolution_record import EvolutionRecord
from dolfinx_contact.records.functionals import leftmost, rightmost, total
from dolfinx_contact.records.journal import (
    EvolutionJournal,
    Journal,
    PathJournal,
    read_journal,
)
from dolfinx_contact.records.path_record import PathRecord
from dolfinx_contact.records.series import write_series
from dolfinx_contact.records.tracing import journal_of

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
    "resume",
    "rightmost",
    "total",
    "write_series",
]
