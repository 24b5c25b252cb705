"""The steps of one proof under the numbers of another problem, with digests that are right.

Who makes a certificate anew by ``Certificate(problem, steps, vectors)`` has valid hashes. What
counts is then whether the steps prove it of these numbers: the check fails, leaves something
open, or finds just the solutions that an enumeration in numpy has.
"""

import numpy as np
from a14_counts import enumerated, random_problem

from dolfinx_contact.analysis import (
    Certificate,
    InvalidCertificate,
    ReducedProblem,
    check,
    prove_solutions,
)


def attack(case):
    given = [random_problem(seed, m=2 + seed % 2) for seed in range(10)]
    truth = [len(enumerated(*g)) for g in given]
    problems = [ReducedProblem(*g) for g in given]
    proofs = [prove_solutions(p, proof_seconds=5.0).certificate for p in problems]
    wrong = []
    refused = 0
    for i, problem in enumerate(problems):
        for j, proof in enumerate(proofs):
            if problem.points != proof.problem.points or i == j:
                continue
            try:
                answer = check(Certificate(problem, proof.steps, proof.vectors))
            except InvalidCertificate:
                refused += 1
                continue
            if answer.verdict == "complete" and len(answer.inside) != truth[i]:
                wrong.append((i, j))
    case.true(f"every forged proof is refused or right, not {wrong}", not wrong)
    case.true("some problems have several solutions", max(truth) > 1)
    case.true("numbers of solutions differ", np.unique(truth).size > 1)
