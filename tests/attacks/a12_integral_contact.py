"""Points of a branch with integral contact of degree 2, and of mixed contact, as they are told.

The block comes down evenly with nu = 0: the closed form is that of any discretisation.
"""

from a12_point_stands import Reader, compared, lowered

from dolfinx_contact import Frictionless
from dolfinx_contact.continuation import follow


def attack(case):
    for degree, method in ((2, "integral"), (1, "mixed")):
        body, problem, contact, gamma, system = lowered(
            case, Frictionless(), degree=degree, method=method
        )
        reader = Reader(body, problem, contact, gamma)
        follow(system, system.create_vector(), 0.0, gamma_range=(0.0, 1.0), observer=reader)
        compared(case, reader)
