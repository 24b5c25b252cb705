# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I make a PDF figure for a paper?
#
# Curves, diagrams of branches and charts are drawn by matplotlib in the format of the file's name:
# PDF, SVG or PNG. Or draw the columns of a table yourself. Pictures of bodies are PNG.

from pathlib import Path

import numpy as np
from common import Block

from dolfinx_contact.plot import draw_curves

table = Block(n=24).problem().solve().tables["contact"]
x = table.x[:, 0]
bound = np.divide(table.bound, table.area)
shear = np.abs(table.along(table.shear))
curves = {"pressure": (x, table.pressure), "shear": (x, shear)}
for file in ("figure.pdf", "figure.png"):
    draw_curves(file, curves, dotted={"friction bound": (x, bound)}, labels=("x", "traction"))
assert Path("figure.pdf").read_bytes().startswith(b"%PDF")
