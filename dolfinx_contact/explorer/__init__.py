# SPDX-License-Identifier: LGPL-3.0-or-later
"""Self-contained HTML pages for exploring recorded branches and histories offline.

This extension reads the journals of records. `lines.py` turns a journal into columns and special
points, `surfaces.py` packs deformed bodies and contact tables (see `packing.py`), and
`html_page.py` writes the file with plotly and the scripts of this folder.
"""

from dolfinx_contact.explorer.html_page import SolutionCount, explorer

__all__ = ["SolutionCount", "explorer"]
