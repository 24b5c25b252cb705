# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a solve leaves behind: tables, summaries, ParaView fields, pictures."""

from dolfinx_contact.output.fields import STATUS_CODES, write_fields
from dolfinx_contact.output.folder import output_folder, write_summary
from dolfinx_contact.output.journal import Journal, read_journal
from dolfinx_contact.output.pictures import picture_of_body, picture_of_contact
from dolfinx_contact.output.progress import Progress
from dolfinx_contact.output.record import BranchRecord, resume
from dolfinx_contact.output.states import picture_of_states
from dolfinx_contact.output.table import write_contact_table

__all__ = [
    "STATUS_CODES",
    "BranchRecord",
    "Journal",
    "Progress",
    "output_folder",
    "picture_of_body",
    "picture_of_contact",
    "picture_of_states",
    "read_journal",
    "resume",
    "write_contact_table",
    "write_fields",
    "write_summary",
]
