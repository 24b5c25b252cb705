# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I choose the discretisation of contact?
#
# `method="nodal"`, the default of linear (first order) elements: the law holds node by node.
# `"mixed"`, the default of quadratic (second order) elements: the law holds at every vertex for
# means around it, and pressures are linear on facets. `"integral"`: Gauss points, the law holds
# weakly. Pivoting and proofs need contact at the nodes, nodal or mixed. Pairs of degrees that are
# not stable are refused. See {doc}`the theory </theory/2_discretisations>`.

import numpy as np
from common import Block

forces = []
kinds = (1, "nodal"), (1, "mixed"), (1, "integral"), (2, "mixed"), (2, "integral")
for degree, method in kinds:
    result = Block(n=16, degree=degree).problem(method=method).solve()
    forces.append(result.resultants["contact"])
    print(f"P{degree} {method:8}: {forces[-1].round(4)}, violation {result.kkt_violation:.1e}")
assert np.allclose(forces[:3], forces[0], rtol=0.01)
