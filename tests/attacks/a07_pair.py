"""Two columns on each other, stuck, that float on springs or are driven away by them.

Where all points stick both bodies move as one: a translation grows with sqrt(-k / rho), where the
density rho is the same in both, and at least as fast as that where it is not. Nothing else holds
them.
"""

import numpy as np
from bodies import two_blocks

import ufl

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials
from dolfinx_contact.analysis import stability_at_rest


def put(case, k, densities):
    both = two_blocks(case.comm, (2, 2), (2, 1))
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    steel = materials.LinearElastic(1.0, 1.0)
    press = ufl.as_vector((0.0, 0.1))
    energy = steel.energy(both.u) * dx + k / 2 * ufl.dot(both.u, both.u) * dx
    energy += ufl.dot(press, both.u) * dx(1) - 2 * ufl.dot(press, both.u) * dx(2)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(20.0))
    problem = ContactProblem(energy, both.u, [pair])
    letters = set(problem.solve().tables["contact"].status)
    case.true(f"all stick: {letters}", letters == {"k"})
    x = ufl.SpatialCoordinate(both.domain)
    rho = ufl.conditional(ufl.gt(x[1], 0), densities[0], densities[1])
    answer = stability_at_rest(problem, density=rho)
    if k < 0:
        case.true(f"unstable, not {answer.label}: {answer.reason}", answer.label == "unstable")
        growth = np.sqrt(-k / densities[0])
        if densities[0] == densities[1]:
            case.equal("growth", answer.growth, growth)
        else:
            # Rayleigh: at least as fast as with the translation alone.
            mean = (densities[0] + 0.5 * densities[1]) / 1.5
            case.true("grows", answer.growth >= np.sqrt(-k / mean) * (1 - 1e-9))
    else:
        case.true(f"stable, not {answer.label}: {answer.reason}", answer.label == "stable")


def attack(case):
    put(case, -0.05, (2.0, 2.0))
    put(case, -0.05, (1.0, 9.0))
    put(case, 0.05, (1.0, 9.0))
