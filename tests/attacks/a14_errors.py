"""A proof for S and p with errors: is it true of all that lie within them?

Problems are taken by chance from within the errors and enumerated in numpy: where the proof is
complete they have as many solutions, each within the bounds that it gives. Errors so large that
numbers differ must not end in "complete". An S that is not symmetric has its other half as error.
"""

import numpy as np
from a14_counts import enumerated, random_problem

from dolfinx_contact.analysis import ReducedProblem, check, prove_solutions


def attack(case):
    rng = np.random.default_rng(1)
    complete = 0
    for seed in range(8):
        S, p, F = random_problem(seed)
        for size in (1e-3, 1e-2, 0.3):
            S_error = size * 0.05 * np.ones_like(S)
            p_error = size * np.ones_like(p)
            skew = size * 0.02 * np.triu(np.ones_like(S), 1)
            try:
                problem = ReducedProblem(S + skew, p, F, S_error=S_error, p_error=p_error)
            except ValueError:
                continue  # not certainly positive definite
            proved = check(prove_solutions(problem, proof_seconds=2.0).certificate)
            if proved.verdict != "complete":
                continue
            complete += 1
            for _ in range(6):
                dS = rng.uniform(-1, 1, S.shape) * S_error
                other = S + (dS + dS.T) / 2
                other_p = p + rng.uniform(-1, 1, p.shape) * p_error
                found = enumerated(other, other_p, F)
                case.equal("solutions", len(found), len(proved.inside), 0.0)
    case.true("some are complete", complete > 4)
