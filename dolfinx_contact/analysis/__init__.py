# SPDX-License-Identifier: LGPL-3.0-or-later
"""What can be proved of the solutions of a problem: that there are no others than those known.

What has to be trusted is in `checker.py` and what it imports (`rounding`, `reduced_problem`,
`energy`, `duality`, `pieces`, `differences`); the rest looks for proofs.
"""

from dolfinx_contact.analysis.certificate import Certificate
from dolfinx_contact.analysis.checker import InvalidCertificate, Proved, check
from dolfinx_contact.analysis.reduced_problem import ReducedProblem
from dolfinx_contact.analysis.solutions import ProvedSolution, ProvedSolutions, prove_solutions

__all__ = [
    "Certificate",
    "InvalidCertificate",
    "Proved",
    "ProvedSolution",
    "ProvedSolutions",
    "ReducedProblem",
    "check",
    "prove_solutions",
]
