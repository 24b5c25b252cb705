# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I prescribe an initial stress or a thermal strain?
#
# Add its work to the energy. For a stress s0 that exists before the load, the term is s0 : eps(u).
# For a thermal strain alpha T it is -(3 lambda + 2 mu) alpha T tr(eps), in 3D and in plane strain.
# If moduli and temperature are Constants, they can change between two solves. Here a block that is
# held on all sides is heated twice; its pressure is E alpha T / (1 - 2 nu).

import numpy as np
from common import Block, facets_where

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, Frictionless

block = Block()
block.moved.value[:] = 0.0, 0.0
sides = np.concatenate([facets_where(block.mesh, 0, x) for x in (0.0, 1.0)])
held = fem.locate_dofs_topological(block.V.sub(0), 1, sides)
bcs = [*block.bcs, fem.dirichletbc(0.0, held, block.V.sub(0))]
expansion = fem.Constant(block.mesh, 0.0)  # alpha T
work = block.young / (1 - 2 * 0.3) * expansion * ufl.div(block.u) * ufl.dx
problem = ContactProblem(block.energy - work, block.u, [block.surface(Frictionless())], bcs=bcs)
for temperature in (100.0, 200.0):
    expansion.value = 1e-5 * temperature
    pressure = problem.solve().tables["contact"].pressure
    print(temperature, pressure)
    assert np.allclose(pressure, 0.025 * temperature)
