"""More coefficients than are computed: how far those of smallest size are known must be true.

With ``dense=False`` few are computed. Every coefficient below ``known_up_to`` must be among them,
and none may be called absent that numpy has below it; ``complete`` only where all are there.
"""

from mpi4py import MPI

import numpy as np
from a10_all_listed import energy_of, expected, leaning, made, tangent
from bodies import dense

from dolfinx_contact.analysis import critical_friction


def put(case, offset, count):
    body = leaning(case.comm, offset, (12, 2))
    found = critical_friction(made(body, energy_of(body)), dense=False, count=count)
    own = leaning(MPI.COMM_SELF, offset, (12, 2))
    one, mixed, unreal = expected(dense(tangent(energy_of(own), own)), own.V, 1.0)
    case.true("something is known", found.known_up_to > 0)
    below = found.known_up_to * (1 - 1e-6)
    for what, those, truth in (
        ("of one sign", found.one_signed, one),
        ("of both signs", found.mixed, mixed),
        ("complex", found.unreal, unreal),
    ):
        sizes = np.sort([abs(F) for F in those])
        true_sizes = np.sort([abs(F) for F in truth])
        case.equal(f"{what} that are known", sizes[sizes < below], true_sizes[true_sizes < below])
        for size in sizes:
            case.true(f"{what}: {size} is one", np.min(np.abs(true_sizes / size - 1)) < 1e-6)
    least = one[0] if one else np.inf
    if found.friction is None:
        case.true("None up to what is known", abs(least) >= below)
    elif abs(found.friction) < below:
        case.equal("friction", found.friction, least)
    number = len(one) + len(mixed) + len(unreal)
    got = len(found.one_signed) + len(found.mixed) + len(found.unreal)
    case.true("complete only with all", not found.complete or got == number)
    case.true(
        f"infinite only if complete, {found.known_up_to} {got} {number}",
        np.isfinite(found.known_up_to) or got == number,
    )


def attack(case):
    put(case, 0.0, 1)
    put(case, 1.0, 1)
    put(case, -2.0, 3)


def honest(case):
    put(case, 1.0, 13)
