"""A stored proof of which one number is changed, in S, p, F, the errors, the steps or vectors.

Such a file proves nothing any more, and the checker, run as a file of its own, has to say so by
its exit status; also with ``python3 -O``, which drops every ``assert``. Unchanged it holds.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from a14_counts import enumerated, random_problem

from dolfinx_contact.analysis import ReducedProblem, check_proof, prove_solutions

CHECKER = Path(check_proof.__file__)


def several():
    """A proved problem of several solutions."""
    for seed in range(50):
        S, p, F = random_problem(seed)
        if len(enumerated(S, p, F)) > 1:
            return prove_solutions(ReducedProblem(S, p, F), proof_seconds=5.0)
    raise AssertionError("no problem with several solutions")


def run(path, *options):
    """Exit status and output of the checker as a program."""
    command = [sys.executable, *options, str(CHECKER), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout + done.stderr


def changes(data):
    """The content of the file with one thing changed each."""
    for key in ("S", "p", "friction", "bound", "S_error", "p_error"):
        other = data[key].copy()
        other.flat[0] = np.nextafter(other.flat[0], np.inf)
        yield key, data | {key: other}
    text = str(data["steps"])
    yield "steps", data | {"steps": np.array(text.replace("]", ", 0]", 1))}
    if data["vectors"].size:
        other = data["vectors"].copy()
        other.flat[0] += 1.0
        yield "vectors", data | {"vectors": other}
    yield "digests", data | {"digests": data["digests"][::-1]}


def on_root(case, do):
    """What ``do`` of a temporary folder gives on rank 0, on every rank."""
    answer = None
    if case.comm.rank == 0:
        with tempfile.TemporaryDirectory() as folder:
            answer = do(Path(folder))
    return case.comm.bcast(answer)


def tried(folder, tampered):
    path = folder / "proof.npz"
    several().certificate.save(path)
    if not tampered:
        return [("as it was", *run(path)), ("with -O", *run(path, "-O"))]
    with np.load(path) as stored:
        data = {key: stored[key] for key in stored}
    answers = []
    for number, (what, content) in enumerate(changes(data)):
        np.savez(path, **content)
        answers.append((what, *run(path, *(["-O"] if number % 2 else []))))
    return answers


def attack(case):
    for what, status, text in on_root(case, lambda folder: tried(folder, True)):
        case.true(f"with another {what} status 1 without traceback", status == 1)
        case.true(f"no traceback ({what})", "Traceback" not in text)
        case.true(f"no word of a proof that holds ({what})", "the proof holds" not in text)


def honest(case):
    for what, status, text in on_root(case, lambda folder: tried(folder, False)):
        case.true(f"status 0 {what}", status == 0 and "the proof holds" in text)
