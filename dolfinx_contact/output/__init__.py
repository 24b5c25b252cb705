# SPDX-License-Identifier: LGPL-3.0-or-later
"""What solves and branches leave behind: tables, fields, pictures; records that are resumed."""
# ruff: noqa: E402

from dolfinx_contact._name import refuse_mixture

refuse_mixture()  # asimov-contact's head, laid over ours, takes this folder for its own output.py

from dolfinx_contact.output.animation import animate
from dolfinx_contact.output.curves import (
    draw_chart,
    draw_convergence,
    draw_curves,
    draw_regions,
    draw_solutions,
)
from dolfinx_contact.output.diagrams import draw_diagram
from dolfinx_contact.output.evolution import EvolutionSeries
from dolfinx_contact.output.evolution_journal import EvolutionJournal, read_evolution
from dolfinx_contact.output.evolution_record import EvolutionRecord
from dolfinx_contact.output.fields import STATUS_CODES, write_fields
from dolfinx_contact.output.folder import output_folder, write_summary
from dolfinx_contact.output.functionals import leftmost, rightmost, total
from dolfinx_contact.output.hertz import Hertz
from dolfinx_contact.output.journal import Journal, read_journal
from dolfinx_contact.output.panels import draw_panels
from dolfinx_contact.output.path_journal import PathJournal, read_path
from dolfinx_contact.output.path_record import PathRecord
from dolfinx_contact.output.pictures import picture_of_body, picture_of_contact
from dolfinx_contact.output.progress import Progress
from dolfinx_contact.output.record import BranchRecord
from dolfinx_contact.output.recording import follow_with_journal
from dolfinx_contact.output.report import Report
from dolfinx_contact.output.resuming import resume
from dolfinx_contact.output.series import write_series
from dolfinx_contact.output.states import picture_of_states
from dolfinx_contact.output.table import write_contact_table, write_rows
from dolfinx_contact.output.tracing import journal_of
from dolfinx_contact.output.vibration import picture_of_vibration, write_vibration

__all__ = [
    "STATUS_CODES",
    "BranchRecord",
    "EvolutionJournal",
    "EvolutionRecord",
    "EvolutionSeries",
    "Hertz",
    "Journal",
    "PathJournal",
    "PathRecord",
    "Progress",
    "Report",
    "animate",
    "draw_chart",
    "draw_convergence",
    "draw_curves",
    "draw_diagram",
    "draw_panels",
    "draw_regions",
    "draw_solutions",
    "follow_with_journal",
    "journal_of",
    "leftmost",
    "output_folder",
    "picture_of_body",
    "picture_of_contact",
    "picture_of_states",
    "picture_of_vibration",
    "read_evolution",
    "read_journal",
    "read_path",
    "resume",
    "rightmost",
    "total",
    "write_contact_table",
    "write_fields",
    "write_rows",
    "write_series",
    "write_summary",
    "write_vibration",
]
