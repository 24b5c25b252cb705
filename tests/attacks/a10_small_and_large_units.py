"""A leaning block in nanometres and gigapascals, and of other sizes.

F has no unit: it is that of the block of size 1, by numpy.
"""

from mpi4py import MPI

from a10_all_listed import compare, energy_of, expected, leaning, made, tangent
from bodies import dense

from dolfinx_contact.analysis import critical_friction


def attack(case, units=((1e-9, 1e9), (1e9, 1e-9), (1e-6, 1e11))):
    own = leaning(MPI.COMM_SELF, 1.0, (3, 3))
    lists = expected(dense(tangent(energy_of(own), own)), own.V, 1.0)
    for length, stiffness in units:
        body = leaning(case.comm, 1.0, (3, 3), length)
        found = critical_friction(made(body, energy_of(body, stiffness)))
        compare(case, found, lists)


def honest(case):
    attack(case, ((1.0, 2.0),))
