# SPDX-License-Identifier: LGPL-3.0-or-later
"""All solutions of a contact problem, with a proof of completeness.

The problem is reduced to its contact points (`check_proof.ReducedProblem`).

Only the checker (`check_proof.py`) has to be trusted; it needs only numpy. The other modules search
for proofs: `plane.py` in 2D and `space.py` in 3D.
"""

from dolfinx_contact.proofs.check_proof import (
    Certificate,
    InvalidCertificate,
    Proved,
    ReducedProblem,
    check,
)
from dolfinx_contact.proofs.solutions import ProvedSolution, ProvedSolutions, prove_solutions

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
