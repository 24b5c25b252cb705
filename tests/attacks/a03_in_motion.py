"""A block that slides without friction beyond the edge of the one below, and should fall.

It has a velocity to the right and a weight; after two widths nothing is below it, so that the
contact force is zero and it falls freely from there.
"""

import numpy as np
from a03_off_the_edge import SAID
from bodies import two_blocks

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials
from dolfinx_contact.evolution import NSCD


def attack(case):
    both = two_blocks(case.comm, (2, 1), (4, 1))
    steel = materials.LinearElastic.from_young(100.0, 0.0)
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    energy = steel.energy(both.u) * dx + 0.01 * both.u[1] * dx(1)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Frictionless())
    problem = ContactProblem(energy, both.u, [pair], bcs=both.bcs[1:])
    velocity = fem.Function(both.V)
    cells = both.parts.find(1)
    velocity.interpolate(lambda x: np.stack([1.0 + 0 * x[0], 0 * x[0]]), cells0=cells)
    velocity.x.scatter_forward()
    motion = NSCD(problem, 1.0, dt=0.2, velocity=velocity)
    history = motion.run([0.0, 2.0])
    force = history.steps[-1].result.resultants["contact"][1]
    case.equal("force over the weight", force / 0.01, 0.0, 1e-3)
    case.warned(SAID)
