# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I work on a submesh?
#
# For contact on a subdomain, create a submesh of its cells and define space, facets and problem on
# it as on any other mesh. Data of the parent mesh are interpolated or given by position. Records of
# branches and histories do not support submeshes: `meshing.join([part]).mesh` is a copy that can be
# recorded.

from mpi4py import MPI

import numpy as np
from common import Block

from dolfinx import mesh

whole = mesh.create_rectangle(MPI.COMM_WORLD, [[0.0, 0.0], [2.0, 1.0]], (16, 8))
left = mesh.locate_entities(whole, 2, lambda x: x[0] <= 1.0 + 1e-9)
part = mesh.create_submesh(whole, 2, left)[0]
result = Block(domain=part).problem().solve()
same = Block(n=8).problem().solve()
print(result.resultants["contact"], result.counts)
assert np.allclose(result.resultants["contact"], same.resultants["contact"])
