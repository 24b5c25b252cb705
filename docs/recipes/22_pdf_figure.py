# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I make a PDF figure for a paper?
#
# Curves, diagrams of branches and charts are drawn by matplotlib in the format of the file's name:
# PDF or SVG, vector graphics that LaTeX includes, or PNG. Or draw the columns of a table yourself.
# Pictures of bodies have the same formats: `stress` or `field` colours the body; in 3D `view` is
# the direction to the eye and `clip` cuts the body open, `region` enlarges a detail, and `units`
# adds units to the labels. All functions return the axes, the figure or (3D) the plotter, which you
# can change.

from pathlib import Path

import numpy as np
from common import Block

from dolfinx_contact.plot import draw_curves, picture_of_body

table = Block(n=24).problem().solve().tables["contact"]
x = table.x[:, 0]
bound = table.bound / table.area
curves = {"pressure": (x, table.pressure), "shear": (x, np.abs(table.along(table.shear)))}
for file in ("figure.pdf", "figure.png"):
    axes = draw_curves(None, curves, dotted={"bound": (x, bound)}, labels=("x", "traction"))
    axes.set_xlim(0.0, 1.0)
    axes.figure.savefig(file)
cube = Block(n=6, cell="hexahedron")
problem = cube.problem()
problem.solve()
look = dict(view="-y", clip="-y", stress=cube.steel.full_stress(cube.u), units={"stress": "Pa"})
for file in ("inside.pdf", "inside.png"):
    picture_of_body(file, problem, **look)
    assert Path(file).stat().st_size > 1000
