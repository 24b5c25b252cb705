# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I refine the mesh where contact ends?
#
# Adaptive mesh refinement is a loop: solve, find in the table where closed points have an open or
# another neighbour, refine the edges near there, and solve again on the finer mesh. Here the edge
# of the contact with a ball is refined twice.

import numpy as np
from common import Block

from dolfinx import mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, Sphere

ball = Sphere((0.5, -2.0), 2.0)
block = Block()
for _ in range(3):
    contact = ContactSurface(block.u, block.bottom, obstacle=ball, law=Frictionless())
    result = ContactProblem(block.energy, block.u, [contact], bcs=block.bcs).solve()
    table = result.tables["contact"]
    x, opens = table.x[:, 0], table.letters == "o"
    ends = x[:-1][opens[1:] != opens[:-1]]
    print(f"{len(x)} points, contact ends near {ends}")
    block.mesh.topology.create_entities(1)
    edges = mesh.locate_entities(
        block.mesh, 1, lambda x, e=ends: np.hypot(x[0] - e[:, None], x[1]).min(axis=0) < 0.2
    )
    block = Block(domain=mesh.refine(block.mesh, edges)[0])
assert len(x) > 2 * 9
