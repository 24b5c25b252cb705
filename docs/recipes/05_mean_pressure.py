# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get the mean contact pressure over a region?
#
# The contact table contains the points of all ranks with their areas. The mean pressure over a part
# of the boundary is the average of its points, weighted by area. Over a physical group of gmsh it
# is the force divided by the area of the group, an integral over `body.ds("tread")`;
# `body.dx("tyre")` is the measure of a group of cells. Here a tyre of area 0.64 pi is pressed on
# the floor without friction.

import numpy as np
from common import Wheel

from dolfinx import fem

wheel = Wheel(friction=0.0)
wheel.put(down=0.05, forward=0.0, angle=0.0)
table = wheel.problem.solve().tables["contact"]
region = table.closed
mean = np.average(table.pressure[region], weights=table.area[region])
print(f"mean pressure {mean:.4f} on a length of {table.area[region].sum():.4f}")
one = fem.Constant(wheel.body.mesh, 1.0)
measures = [wheel.body.ds("tread"), wheel.body.dx("tyre")]
parts = [fem.assemble_scalar(fem.form(one * m)) for m in measures]  # of this rank
length, area = (wheel.body.mesh.comm.allreduce(part) for part in parts)
print(f"over the whole tread {table.rn.sum() / length:.4f}, volume per thickness {area:.4f}")
assert np.isclose(length, table.area.sum())
assert np.isclose(area, 0.64 * np.pi, rtol=0.01)
