"""A block on another is moved sideways, pressed all the while, until it is above nothing.

Three widths, in units from 1e-9 to 1e9: the force is zero, since there is nothing below. The twin
moves by 2 % of a facet, where the force is that of two springs in a row, with nothing to be said.
"""

import numpy as np
from bodies import two_blocks

import ufl

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, materials

SAID = "slid|sliding|left|edge|opposite|turned"
"""What a warning of sliding that is not small speaks of."""


def pressed(both, way, press=0.02, *, stress=1.0, law=None, **more):
    """A problem of two blocks with no transverse contraction; the top moved by (way, -press)."""
    steel = materials.LinearElastic.from_young(stress, 0.0)
    dim = both.domain.geometry.dim

    def top(x):
        rows = [way, *[0.0] * (dim - 2), -press]
        return np.stack([np.full(x.shape[1], row) for row in rows])

    both.top.interpolate(top)
    law = Frictionless() if law is None else law
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=law, **more)
    energy = steel.energy(both.u) * ufl.dx
    return ContactProblem(energy, both.u, [pair], bcs=both.bcs)


def doubted(case, result):
    """Take note of what a result says against itself; a proof or no word in it is an error."""
    case.warned(SAID)
    if result.unique == "proved" or not result.doubts:
        found = f"unique {result.unique}, doubts {result.doubts}, {case.off}"
        raise AssertionError(found)


def put(case, unit, stress):
    both = two_blocks(case.comm, unit=unit)
    result = pressed(both, 3 * unit, 0.02 * unit, stress=stress).solve()
    case.equal("force per width", result.resultants["contact"] / (unit * stress), [0.0, 0.0])
    doubted(case, result)


def attack(case):
    put(case, 1.0, 1.0)
    put(case, 1e-9, 1e9)
    put(case, 1e9, 1e-9)


def honest(case):
    for unit in (1.0, 1e-9):
        both = two_blocks(case.comm, unit=unit)
        result = pressed(both, 0.005 * unit, 0.0003 * unit).solve()
        force = result.resultants["contact"][1] / unit
        case.equal("two springs in a row", force, 0.0003 / 1.5, 1e-4)
        case.true("nothing is said", not case.warnings and not result.doubts)
