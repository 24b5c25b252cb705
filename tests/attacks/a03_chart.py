"""A chart of friction and way: where a block has been moved off the one below nothing is proved.

Numbers of solutions at ways of 1.5 to 2.5 widths are those of a problem in which the block below is
still there. The right answer, without contact, is known by hand: all points are open.
"""

import numpy as np
from bodies import two_blocks

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, ParametricContact, materials
from dolfinx_contact.analysis import contact_family, count_solutions


def chart(case, ways):
    """Cells of a chart over friction and the way of a spring that draws the top."""
    both = two_blocks(case.comm, (2, 1), (2, 1))
    way = fem.Constant(both.domain, 0.0)
    friction = fem.Constant(both.domain, 0.1)
    facets = mesh.locate_entities_boundary(both.domain, 1, lambda x: np.isclose(x[1], 1))
    tags = mesh.meshtags(both.domain, 1, np.sort(facets), np.ones(len(facets), dtype=np.int32))
    ds = ufl.Measure("ds", both.domain, subdomain_data=tags)(1)
    pull = both.u - ufl.as_vector((way, -0.02))
    steel = materials.LinearElastic.from_young(1.0, 0.0)
    energy = steel.energy(both.u) * ufl.dx + 50.0 * ufl.dot(pull, pull) * ds
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(friction))
    problem = ContactProblem(energy, both.u, [pair], bcs=both.bcs[1:])
    family = contact_family(ParametricContact(problem, way), friction, mu_range=(0.05, 0.3))
    return count_solutions(family, mu_range=(0.05, 0.3), gamma_range=ways, cells=(2, 2), depth=0)


def attack(case):
    found = chart(case, (1.5, 2.5))
    for cell in found.cells:
        case.true(f"all open, not {cell.solutions}", cell.solutions == ("ooo",))
        case.unpromised("not proved", not cell.proved)
        if cell.proved:
            raise AssertionError(f"{cell.solutions} are proved")


def honest(case):
    found = chart(case, (-0.04, 0.05))
    case.true(f"proved, {[c.solutions for c in found.cells]}", found.proved)
