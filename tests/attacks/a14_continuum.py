"""The friction at which one point has a continuum of sliding states, F = S_tt / S_nt, and beside.

At that F, and where the load fits, every slip solves: neither the search nor the checker, as a
program, may say that a number of solutions is all there is. Beside it the closed form of one
point: stuck, sliding, open by hand.
"""

import numpy as np
from a14_counts import enumerated
from a14_tampered import on_root, run

from dolfinx_contact.analysis import ReducedProblem, check, prove_solutions

S = np.array([[2.0, -1.0], [-1.0, 3.0]])


def attack(case):
    # Sliding with ut > 0: un = 0, S_tt ut = -F rn + p_t, S_nt ut = rn + p_n.
    # So (S_tt + F S_nt) ut = p_t + F p_n, and 0 = 0 at F = 2 with p_t = -F p_n.
    p = np.array([2.0, -1.0])
    at = prove_solutions(ReducedProblem(S, p, np.array([2.0])), proof_seconds=5.0)
    case.true("a continuum is not a number of solutions", at.verdict != "complete")
    case.true("and so says the check", check(at.certificate).verdict != "complete")

    def checked(folder):
        at.certificate.save(folder / "proof.npz")
        return run(folder / "proof.npz")

    status, text = on_root(case, checked)
    case.true(f"the program does not call it all there is: {text}", "they are all" not in text)
    case.true(f"status {status} and no traceback", "Traceback" not in text)
    for F in (1.9, 2.1):
        for shear in (1.5, 1.99, 2.3, 4.0):
            load = np.array([shear, -1.0])
            answer = prove_solutions(ReducedProblem(S, load, np.array([F])), proof_seconds=5.0)
            case.true("beside it is complete", answer.verdict == "complete")
            expected = len(enumerated(S, load, np.array([F])))
            case.equal(f"solutions at F = {F}", len(answer.solutions), expected, 0.0)
