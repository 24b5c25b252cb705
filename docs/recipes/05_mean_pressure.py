# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get the mean contact pressure over a region?
#
# The contact table has all points of all ranks with their areas: take the mean over those of the
# region, weighted by area. Here the region is the left half of the bottom.

import numpy as np
from common import Block

result = Block(n=16).problem().solve()
table = result.tables["contact"]
region = table.x[:, 0] <= 0.5
mean = np.average(table.pressure[region], weights=table.area[region])
print(f"mean pressure {mean:.4f} on a length of {table.area[region].sum():.4f}")
force = np.sum(table.pressure[region] * table.area[region])
assert np.isclose(force, table.rn[region].sum())
