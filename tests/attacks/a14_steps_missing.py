"""Proofs with steps left out, doubled or in another order, of which the digests are right.

A changed proof is refused, or says what the whole one says, or that something is open; it never
proves another number of solutions. The number is an enumeration in numpy.
"""

import copy

from a14_counts import enumerated, random_problem

from dolfinx_contact.analysis import (
    Certificate,
    InvalidCertificate,
    ReducedProblem,
    check,
    prove_solutions,
)


def variants(steps):
    """Lists of steps that are not those of the proof."""
    for k in range(min(len(steps), 12)):
        yield steps[:k] + steps[k + 1 :]
        yield steps[: k + 1] + steps[k:]
        yield steps[k:] + steps[:k]
        for key, value in steps[k].items():
            if isinstance(value, int) and not isinstance(value, bool):
                for other in (value + 1, value - 1, -value, 10**6):
                    yield [*steps[:k], steps[k] | {key: other}, *steps[k + 1 :]]
            elif isinstance(value, list):
                for other in (value[1:], value[::-1], value + value, []):
                    yield [*steps[:k], steps[k] | {key: other}, *steps[k + 1 :]]
    yield []


def attack(case):
    wrong = []
    tried = 0
    lengths = []
    for seed in range(6):
        S, p, F = random_problem(seed, m=3)
        expected = len(enumerated(S, p, F))
        whole = prove_solutions(ReducedProblem(S, p, F), proof_seconds=5.0)
        lengths.append(len(whole.certificate.steps))
        case.equal("solutions of the whole proof", len(whole.solutions), expected, 0.0)
        for steps in variants(whole.certificate.steps):
            proof = whole.certificate
            changed = Certificate(proof.problem, copy.deepcopy(steps), proof.vectors)
            tried += 1
            try:
                answer = check(changed)
            except InvalidCertificate:
                continue
            if answer.verdict == "complete" and len(answer.inside) != expected:
                wrong.append((seed, steps))
    case.true(f"no changed proof says anything else, {len(wrong)} of {tried} do", not wrong)
    case.true("something was tried", tried > 10)
