"""A branch, and all solutions at a parameter that moves a block off the one below.

At its end the force is zero. What is found there may not be called complete.
"""

import numpy as np
from a03_off_the_edge import SAID
from bodies import two_blocks

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, ParametricContact, materials
from dolfinx_contact.continuation import find_solutions, follow


def attack(case):
    both = two_blocks(case.comm, (2, 1), (2, 1))
    gamma = fem.Constant(both.domain, 0.0)
    steel = materials.LinearElastic.from_young(1.0, 0.0)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(0.1))
    both.top.interpolate(lambda x: np.stack([0 * x[0], -0.02 + 0 * x[0]]))
    # The top is held by a stiff spring that is drawn along.
    facets = mesh.locate_entities_boundary(both.domain, 1, lambda x: np.isclose(x[1], 1))
    tags = mesh.meshtags(both.domain, 1, np.sort(facets), np.ones(len(facets), dtype=np.int32))
    ds = ufl.Measure("ds", both.domain, subdomain_data=tags)(1)
    pull = both.u - ufl.as_vector((gamma, -0.02))
    energy = steel.energy(both.u) * ufl.dx + 50.0 * ufl.dot(pull, pull) * ds
    problem = ContactProblem(energy, both.u, [pair], bcs=both.bcs[1:])
    system = ParametricContact(problem, gamma)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 2.0))
    case.equal("end of the branch", branch.points[-1].gamma, 2.0, 1e-9)
    end = problem.table(pair).rn.sum()
    case.equal("force at the end", end, 0.0)
    case.warned(SAID)
    problem.write(x)
    found = find_solutions(system, [x], 2.0)
    if found.complete:
        raise AssertionError("called complete")
