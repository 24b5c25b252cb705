# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I choose slave and master?
#
# The side with the finer mesh should be the slave and the other one the master. If the meshes are
# similar, the slave is the smaller, softer or more curved side: the wheel, not the rail. Statuses
# and pressures belong to the nodes of the slave. Uniform tractions are transmitted exactly in both
# cases; here both are compared.

import numpy as np
from common import TwoBlocks

forces = {}
for slave, master in (("sole", "seat"), ("seat", "sole")):  # the sole is finer
    blocks = TwoBlocks(n_upper=8, n_lower=5)
    pair = blocks.pair(slave=slave, master=master)
    table = blocks.problem(pair).solve().tables["contact"]
    forces[slave] = table.rn.sum()
    print(
        f"slave {slave}: {len(table.un)} points, pressures {table.pressure.min():.6f} to "
        f"{table.pressure.max():.6f}"
    )
assert np.isclose(forces["sole"], forces["seat"])
assert np.isclose(forces["sole"], 5.0)
