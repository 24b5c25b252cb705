"""A ring that is pressed, which the attacks on bodies of revolution share."""

import numpy as np
from bodies import block

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials

RIGHT = 10.0 * np.pi * (2.0**2 - 1.0**2)


def ring(case, weighted, material=None, axisymmetric=True, **data):
    """Force on a ring, 1 < r < 2, that is pressed by 0.01 of its height."""
    body = block(case.comm, **{"cells": (2, 2), "cell": "quadrilateral", **data})
    body.domain.geometry.x[:, 0] += 1.0
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -0.01 + 0 * x[0]]))
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    steel = materials.Axisymmetric(steel) if material is None else material(steel)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(
        body.u, body.bottom, obstacle=floor, law=Frictionless(), axisymmetric=axisymmetric
    )
    problem = ContactProblem(weighted(steel.energy(body.u), body), body.u, [contact], bcs=body.bcs)
    return problem.solve().resultants["contact"][1]


def warned(case):
    """How often the package has warned so far, on all ranks."""
    return case.comm.allreduce(len(case.warnings))


def settled(case, name, force, expected=RIGHT):
    """Of a form whose weight is wrong: refused, or warned of by itself, or the right force."""
    before = warned(case)
    try:
        found = force()
    except ValueError:
        found = expected
    if warned(case) == before:
        case.equal(name, found, expected)
    else:
        said = case.comm.bcast(case.warnings[-1] if case.comm.rank == 0 else "")
        case.true("the warning says of what", "2 pi r" in said)
