"""An observer of the user's raises on one rank alone, in many problems.

Every rank gets an error, the problems are dropped meanwhile, and a collective of one's own follows.
"""

import gc

from b03_failing_solves import made

from dolfinx_contact import Coulomb
from dolfinx_contact.evolution import NSCD, QuasiStatic


class OwnError(Exception):
    """Of the user."""


def attack(case):
    def raises(*_):
        if case.comm.rank == case.comm.size - 1:
            raise OwnError("on one rank")

    def evolution(problem):
        problem.solve()
        QuasiStatic(problem, lambda t: None).run([0.0, 1.0], observer=raises)

    def motion(problem):
        NSCD(problem, 1.0, dt=0.01).run([0.0, 0.01], observer=raises)

    caught = 0
    for k in range(8):
        for run in (evolution, motion):
            try:
                run(made(case, Coulomb(0.3)))
            except Exception:
                caught += 1
            if k % 2 == case.comm.rank:
                gc.collect()
    case.equal("sum over ranks", case.comm.allreduce(1), case.comm.size)
    case.equal("caught", caught, 16)
    result = made(case, Coulomb(0.3)).solve()
    case.equal("force", result.resultants["contact"][1], 10.0)
