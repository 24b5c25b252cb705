# SPDX-License-Identifier: LGPL-3.0-or-later
"""What solves and branches leave behind: tables, fields, pictures; records that are resumed."""

from dolfinx_contact.output.diagrams import draw_diagram
from dolfinx_contact.output.fields import STATUS_CODES, write_fields
from dolfinx_contact.output.folder import output_folder, write_summary
from dolfinx_contact.output.journal import Journal, read_journal
from dolfinx_contact.output.pictures import picture_of_body, picture_of_contact
from dolfinx_contact.output.progress import Progress
from dolfinx_contact.output.record import BranchRecord
from dolfinx_contact.output.resuming import resume
from dolfinx_contact.output.series import write_series
from dolfinx_contact.output.states import picture_of_states
from dolfinx_contact.output.table import write_contact_table

__all__ = [
    "STATUS_CODES",
    "BranchRecord",
    "Journal",
    "Progress",
    "draw_diagram",
    "output_folder",
    "picture_of_body",
    "picture_of_contact",
    "picture_of_states",
    "read_journal",
    "resume",
    "write_contact_table",
    "write_fields",
    "write_series",
    "write_summary",
]
