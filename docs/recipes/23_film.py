# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I make a film?
#
# `plot.animate` draws a recorded history step by step and saves the movie of the deformation as a
# GIF, or as MP4 with imageio-ffmpeg. `scale` magnifies the displacement, which the title states;
# what is coloured (`fields`, `cmap`) and seen (`zoom`; in 3D `view` and `clip`) is given as for
# pictures. `plot.film` draws any states, as the shape of a vibration.

import numpy as np
from common import Block

from dolfinx_contact import plot
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.records import EvolutionRecord

block = Block()


def load(t):
    block.moved.value[0] = 0.004 + 0.02 * np.sin(2 * np.pi * t)


problem = block.problem()
problem.solve()
evolution = QuasiStatic(problem, load)
with EvolutionRecord("output/film", evolution) as record:
    evolution.run(np.linspace(0.0, 1.0, 5), record=record)
    file = plot.animate("to_and_fro.gif", record, scale=5.0, cmap="magma")
assert file.stat().st_size > 1000
