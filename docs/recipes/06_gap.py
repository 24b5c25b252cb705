# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get the gap between body and obstacle?
#
# `un` of the contact table is the gap after the solve, the distance of a point from the obstacle,
# and zero where the body touches; `ut` is the tangential displacement. Here the right end of the
# block is lifted off by a floor that falls away.

import numpy as np
from common import Block

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace

block = Block()
floor = HalfSpace(point=(0.0, 0.0), normal=(0.02, 1.0))
contact = ContactSurface(block.u, block.bottom, obstacle=floor, law=Frictionless())
table = ContactProblem(block.energy, block.u, [contact], bcs=block.bcs).solve().tables["contact"]
for x, gap, letter in zip(table.x[:, 0], table.un, table.letters, strict=True):
    print(f"x = {x:.3f}: gap {gap:.5f} {letter}")
assert np.all(table.un[table.letters == "o"] > 0)
assert (table.letters == "o").any()
assert np.allclose(table.un[table.closed], 0.0, atol=1e-12)
