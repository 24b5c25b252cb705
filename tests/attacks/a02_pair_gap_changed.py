"""The gap of a pair follows a Constant between solves; then another gap is set in its place.

Blocks of the heights 1 and 1/2 with nu = 0 are springs in series: the pressure is E (d - gap)/1.5.
"""

import numpy as np
from bodies import two_blocks

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials


def _pair(case):
    both = two_blocks(case.comm, (2, 1), (2, 1))
    u = both.u
    gap = fem.Constant(both.domain, 0.0)
    pair = ContactPair(u, both.slave, master_facets=both.master, law=Coulomb(0.1), gap=gap)
    both.top.interpolate(lambda x: np.outer((0.0, -0.01), np.ones_like(x[0])))
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    problem = ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=both.bcs)
    return gap, pair, problem


def _through(case, gap, problem):
    for size in (0.0, 0.004, 0.02, 0.006):
        gap.value = size
        force = problem.solve().resultants["contact"][1]
        case.equal(f"force at a gap of {size}", force, 1000.0 / 1.5 * max(0.0, 0.01 - size))


def attack(case):
    gap, pair, problem = _pair(case)
    _through(case, gap, problem)
    pair.gap = 0.008
    case.equal("force at another gap", problem.solve().resultants["contact"][1], 4 / 3)


def honest(case):
    gap, _, problem = _pair(case)
    _through(case, gap, problem)
