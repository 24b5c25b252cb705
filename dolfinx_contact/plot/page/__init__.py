# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pages in which records and charts are explored: one HTML file each, without network.

What is shown is a `Scene` (`scene.py`); records are read by `of_records.py` and charts by
`of_charts.py`, and by nothing else here. `packing.py` makes arrays small, `writing.py` puts them
into the page with the library and the scripts of this folder, which run in the order of
`writing.SCRIPTS`.
"""

from dolfinx_contact.plot.page.scene import Scene, SolutionCount
from dolfinx_contact.plot.page.writing import explorer, watch

__all__ = ["Scene", "SolutionCount", "explorer", "watch"]
