"""A block that sticks is moved off the one below: no theorem may call its solution the only one.

The right answer is that there is no force. Asked are Renard's criterion, what theorems say of the
problem, and every algorithm by its result.
"""

import numpy as np
from a03_off_the_edge import doubted, pressed
from bodies import two_blocks

from dolfinx_contact import Coulomb, Frictionless
from dolfinx_contact.analysis import renard_criterion


def attack(case):
    for law in (Frictionless(), Coulomb(0.05)):
        both = two_blocks(case.comm, (2, 1), (3, 1))
        problem = pressed(both, 2.0, law=law)
        for algorithm in ("newton", "gauss-seidel", "lemke"):
            result = problem.solve(algorithm=algorithm)
            doubted(case, result)
        case.equal("force", result.resultants["contact"], np.zeros(2))
        if result.uniqueness(proof_seconds=5.0).verdict == "proved":
            raise AssertionError("proved")
        if renard_criterion(problem).unique:
            raise AssertionError("Renard's criterion calls it certainly the only one")
