# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I make a convergence study?
#
# Solve on finer and finer meshes and compare a number. Three of them give the rate of convergence,
# which is limited by the regularity of the solution at the ends of contact and sticking. Here the
# number is the elastic energy, which converges approximately like the square of the error in its
# norm; the corners of the clamped side limit its order.

import numpy as np
from common import Block

from dolfinx_contact.plot import draw_curves

sizes = np.array([4, 8, 16, 32])
energies = np.array([Block(n).problem().solve().energies["bulk"] for n in sizes])
changes = np.abs(np.diff(energies))
orders = np.log2(changes[:-1] / changes[1:])
print("energies", energies, "orders", orders)
draw_curves(
    "convergence.png",
    {"change of the energy": (1 / sizes[1:], changes)},
    labels=("cell size", "change of the energy"),
    loglog=True,
)
assert np.all(orders > 0.7)
