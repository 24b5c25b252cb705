# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I choose slave and master?
#
# The side with the finer mesh should be the slave and the other one the master. If the meshes are
# similar, the slave is the smaller, softer or more curved side: the wheel, not the rail. Statuses
# and pressures belong to the nodes of the slave. Uniform tractions are transmitted exactly in both
# cases; here both are compared.

import numpy as np
from common import TwoBlocks

from dolfinx_contact import ContactPair, Coulomb

forces = {}
for slave in ("fine", "coarse"):
    blocks = TwoBlocks(n_upper=8, n_lower=5)
    faces = (blocks.sole, blocks.base) if slave == "fine" else (blocks.base, blocks.sole)
    pair = ContactPair(blocks.u, faces[0], master_facets=faces[1], law=Coulomb(0.3))
    table = blocks.problem(pair).solve().tables["contact"]
    forces[slave] = table.rn.sum()
    print(
        f"slave {slave}: {len(table.un)} points, pressures {table.pressure.min():.6f} to "
        f"{table.pressure.max():.6f}"
    )
assert np.isclose(forces["fine"], forces["coarse"])
assert np.isclose(forces["fine"], 5.0)
