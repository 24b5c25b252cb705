# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I make a film?
#
# To save a movie of the deformation, `plot.film` draws states one after the other and writes a GIF,
# or an MP4 with imageio-ffmpeg: the states of a history, those of a record (`record.state(k)`), or
# the shapes of a vibration. `scale` magnifies the displacement, which the title states; `stress`,
# `field` and in 3D `view` and `clip` are those of pictures, and `size` is the size in pixels. To
# begin with the initial state, pass `[start, *(step.state for step in history.steps)]` with
# `start = problem.snapshot()`. A film of the contact pressure has the same arguments.

import numpy as np
from common import Block

from dolfinx_contact import plot
from dolfinx_contact.evolution import QuasiStatic

block = Block()


def load(t):
    block.moved.value[0] = 0.004 + 0.02 * np.sin(2 * np.pi * t)


problem = block.problem()
problem.solve()
evolution = QuasiStatic(problem, load)
history = evolution.run(np.linspace(0.0, 1.0, 5))
file = plot.film("to_and_fro.gif", problem, history.steps, scale=5.0)
plot.film_of_contact("pressure.gif", problem, history.steps, units={"stress": "Pa"})
assert file.stat().st_size > 1000
