# SPDX-License-Identifier: LGPL-3.0-or-later
"""Output: fields for ParaView, tables, summaries, and progress messages of scripts."""

from dolfinx_contact.io.evolution_series import EvolutionSeries
from dolfinx_contact.io.fields import write_fields
from dolfinx_contact.io.files import output_folder, write_summary
from dolfinx_contact.io.report import Report
from dolfinx_contact.io.table import write_contact_table, write_rows
from dolfinx_contact.results.surface_fields import STATUS_CODES

__all__ = [
    "STATUS_CODES",
    "EvolutionSeries",
    "Report",
    "output_folder",
    "write_contact_table",
    "write_fields",
    "write_rows",
    "write_summary",
]
