"""Assumption: a stored proof is whole and belongs to its numbers, and its checker is alone.

Proofs are compared with an enumeration of all 4^m statuses in numpy, from the law alone. Files are
damaged, changed in one number, forged under other numbers, and set with traps; the checker is
copied to where only Python and numpy can be imported.
"""

import copy
import itertools
import os
import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, table_of
from support.checks import condensed, dense, on_rank_0, solved_start, tangent

import ufl
from dolfinx import fem

from dolfinx_contact import Coulomb, ParametricContact, materials
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.proofs import (
    Certificate,
    InvalidCertificate,
    ReducedProblem,
    check,
    check_proof,
    prove_solutions,
)

COMM = MPI.COMM_WORLD

CHECKER = Path(check_proof.__file__)


def enumerated(S, p, F):
    """All solutions of S a = r + p, ``(letters, a)``, by trying every status of every point.

    Args:
        S: stiffness, shape (2 m, 2 m), with a = (ut, un) point by point.
        p: load, shape (2 m,).
        F: friction, shape (m,).
    """
    m = len(F)
    found = []
    for letters in itertools.product("ok+-", repeat=m):
        A = np.zeros((4 * m, 4 * m))  # unknown: a (2 m) and r (2 m)
        b = np.zeros(4 * m)
        A[: 2 * m, : 2 * m] = S
        A[: 2 * m, 2 * m :] = -np.eye(2 * m)
        b[: 2 * m] = p
        for i, letter in enumerate(letters):
            row = 2 * m + 2 * i
            t, n = 2 * i, 2 * i + 1
            A[row + 1, 2 * m + n if letter == "o" else n] = 1
            if letter == "k":
                A[row, t] = 1
            else:
                A[row, 2 * m + t] = 1
                A[row, 2 * m + n] = {"o": 0, "+": F[i], "-": -F[i]}[letter]
        # Lengths and forces have different sizes in small and large units.
        scale = np.ones(4 * m)
        scale[: 2 * m] = 1 / np.abs(np.diag(S)).max()
        A = A * scale
        size = np.abs(A).max(axis=1)
        A, b = A / size[:, None], b / size
        if abs(np.linalg.det(A)) < 1e-12:
            continue
        x = np.linalg.solve(A, b) * scale
        a, r = x[: 2 * m].reshape(m, 2), x[2 * m :].reshape(m, 2)
        if all(_holds(c, a[i], r[i], F[i]) for i, c in enumerate(letters)):
            found.append(("".join(letters), a))
    return found


def _holds(letter, a, r, F):
    if letter == "o":
        return a[1] >= 0
    if letter == "k":
        return abs(r[0]) <= F * r[1]
    return r[1] >= 0 and (a[0] >= 0 if letter == "+" else a[0] <= 0)


def random_problem(seed, m=2):
    """S, p and F of a body that is pressed, with much friction and often several solutions."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((2 * m, 2 * m))
    S = A @ A.T + 0.05 * np.eye(2 * m)
    p = rng.standard_normal(2 * m)
    p[1::2] -= 0.5
    return (S + S.T) / 2, p, np.full(m, 2.0)


def number_of(S, p, F):
    return len(enumerated(S, p, F))


def proved(*problem, seconds=5.0, **errors):
    return prove_solutions(ReducedProblem(*problem, **errors), proof_seconds=seconds)


def several():
    """The proof of a problem with several solutions."""
    seed = next(s for s in range(50) if number_of(*random_problem(s)) > 1)
    return proved(*random_problem(seed))


# --- numbers of solutions ---


@pytest.mark.parametrize("unit", [pytest.param(1.0, marks=pytest.mark.sample), 1e-9, 1e9])
def test_all_solutions_of_random_problems_are_proved(unit):
    numbers = []
    for seed in (*range(8), *range(20, 28)):
        S, p, F = random_problem(seed)
        answer = proved(S * unit, p * unit, F)
        assert answer.verdict == check(answer.certificate).verdict == "complete"
        numbers.append(number_of(S, p, F))
        assert len(answer.solutions) == numbers[-1]
    assert max(numbers) > 1


def test_a_continuum_is_not_a_number_of_solutions(folder):
    """At F = S_tt / |S_nt| = 2 and p_t = -F p_n every slip solves."""
    S = np.array([[2.0, -1.0], [-1.0, 3.0]])
    answer = proved(S, np.array([2.0, -1.0]), np.array([2.0]))
    assert answer.verdict != "complete"
    assert check(answer.certificate).verdict != "complete"

    def checked():
        answer.certificate.save(folder / "proof.npz")
        return run(folder / "proof.npz")

    _, text = on_rank_0(checked)
    assert "they are all" not in text
    assert "Traceback" not in text


@pytest.mark.parametrize("friction", [1.9, 2.1])
@pytest.mark.parametrize("shear", [1.5, 1.99, 2.3, 4.0])
def test_next_to_a_continuum_all_solutions_are_proved(friction, shear):
    problem = (
        np.array([[2.0, -1.0], [-1.0, 3.0]]),
        np.array([shear, -1.0]),
        np.array([friction]),
    )
    answer = proved(*problem)
    assert answer.verdict == "complete"
    assert len(answer.solutions) == number_of(*problem)


def test_a_proof_with_errors_holds_for_all_problems_within_them():
    """An S that is not symmetric has its other half as an error."""
    rng = np.random.default_rng(1)
    complete = 0
    for seed in range(8):
        S, p, F = random_problem(seed)
        for size in (1e-3, 1e-2, 0.3):
            errors = {"S_error": size * 0.05 * np.ones_like(S), "p_error": size * np.ones_like(p)}
            skew = size * 0.02 * np.triu(np.ones_like(S), 1)
            try:
                answer = check(proved(S + skew, p, F, seconds=2.0, **errors).certificate)
            except ValueError:  # not certainly positive definite
                continue
            if answer.verdict != "complete":
                continue
            complete += 1
            for _ in range(6):
                dS = rng.uniform(-1, 1, S.shape) * errors["S_error"]
                dp = rng.uniform(-1, 1, p.shape) * errors["p_error"]
                assert number_of(S + (dS + dS.T) / 2, p + dp, F) == len(answer.inside)
    assert complete > 4


@pytest.mark.parametrize("pull", [1.0, 4.0, -4.0])
def test_the_proof_of_a_mesh_is_that_of_its_dense_stiffness(pull):
    """On any number of ranks: S and p are a Schur complement assembled here on one."""

    def made(comm):
        body = block((2, 1), (1.0, 0.5), "tri", comm=comm)
        gamma = fem.Constant(body.domain, 1.0)
        traction = gamma * ufl.as_vector((pull, -1.0))
        energy = materials.LinearElastic(1.0, 1.0).energy(body.u) * ufl.dx
        return body, gamma, energy - ufl.dot(traction, body.u) * ufl.dx

    body, gamma, energy = made(COMM)
    problem = body.problem(Coulomb(0.5), energy)
    system = ParametricContact(problem, gamma)
    found = find_solutions(system, [solved_start(system)], 1.0)
    assert found.complete
    table = table_of(problem)
    own, _, energy = made(MPI.COMM_SELF)
    K = dense(tangent(energy, own))
    f = -fem.assemble_vector(fem.form(ufl.derivative(energy, own.u))).array
    y = own.V.tabulate_dof_coordinates()
    bottom, top = (np.flatnonzero(np.isclose(y[:, 1], at)) for at in (0.0, 0.5))
    bottom = bottom[np.argsort(y[bottom, 0])]
    kept, gone = ((2 * nodes[:, None] + np.arange(2)).ravel() for nodes in (bottom, top))
    # The load is condensed as one more column.
    extended = np.block([[K, -f[:, None]], [-f[None, :], np.zeros((1, 1))]])
    S = condensed(extended, np.append(kept, len(K)), gone)
    right = enumerated(S[:-1, :-1], -S[:-1, -1], np.full(len(bottom), 0.5))
    assert len(found.found) == len(right)
    state = np.stack([table.along(table.ut), table.un], 1)
    assert min(np.abs(state - a).max() for _, a in right) < 1e-8 * np.abs(state).max()


# --- forged proofs ---


def test_steps_of_one_proof_do_not_prove_another_problem():
    """``Certificate(problem, steps, vectors)`` has valid hashes."""
    given = [random_problem(seed, m=2 + seed % 2) for seed in range(10)]
    numbers = [number_of(*g) for g in given]
    assert np.unique(numbers).size > 1
    proofs = [proved(*g).certificate for g in given]
    for i, problem in enumerate([ReducedProblem(*g) for g in given]):
        for j, proof in enumerate(proofs):
            if problem.points != proof.problem.points or i == j:
                continue
            try:
                answer = check(Certificate(problem, proof.steps, proof.vectors))
            except InvalidCertificate:
                continue
            assert answer.verdict != "complete" or len(answer.inside) == numbers[i]


def variants(steps):
    """Return lists of steps that do not belong to the proof."""
    yield []
    for k in range(min(len(steps), 12)):
        yield steps[:k] + steps[k + 1 :]
        yield steps[: k + 1] + steps[k:]
        yield steps[k:] + steps[:k]
        for key, value in steps[k].items():
            others = []
            if isinstance(value, int) and not isinstance(value, bool):
                others = [value + 1, value - 1, -value, 10**6]
            elif isinstance(value, list):
                others = [value[1:], value[::-1], value + value, []]
            for other in others:
                yield [*steps[:k], steps[k] | {key: other}, *steps[k + 1 :]]


@pytest.mark.parametrize("seed", range(6))
def test_a_proof_with_other_steps_proves_no_other_number(seed):
    problem = random_problem(seed, m=3)
    number = number_of(*problem)
    whole = proved(*problem)
    assert len(whole.solutions) == number
    proof = whole.certificate
    for steps in variants(proof.steps):
        changed = Certificate(proof.problem, copy.deepcopy(steps), proof.vectors)
        try:
            answer = check(changed)
        except InvalidCertificate:
            continue
        assert answer.verdict != "complete" or len(answer.inside) == number


# --- files ---


def run(path, *options):
    """Exit status and output of the checker as a program."""
    command = [sys.executable, *options, str(CHECKER), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout + done.stderr


def stored(folder):
    """The arrays of a stored proof of several solutions."""
    several().certificate.save(folder / "proof.npz")
    with np.load(folder / "proof.npz") as file:
        return {key: file[key] for key in file}


def test_a_stored_proof_holds_under_another_name(folder):
    def checked():
        (folder / "a folder").mkdir()
        path = folder / "a folder" / "my proof.npz"
        several().certificate.save(path)
        return [run(path), run(path, "-O")]

    for status, text in on_rank_0(checked):
        assert status == 0
        assert "the proof holds" in text


def changed(data):
    """The content of a file with one thing changed, by name."""
    for key in ("S", "p", "friction", "bound", "S_error", "p_error"):
        other = data[key].copy()
        other.flat[0] = np.nextafter(other.flat[0], np.inf)
        yield data | {key: other}
    yield data | {"steps": np.array(str(data["steps"]).replace("]", ", 0]", 1))}
    if data["vectors"].size:
        yield data | {"vectors": data["vectors"] + 1.0}
    yield data | {"digests": data["digests"][::-1]}


def test_a_proof_with_one_number_changed_does_not_hold(folder):
    """The exit status shows it, also with ``python3 -O``, which drops every ``assert``."""

    def checked():
        answers = []
        for number, content in enumerate(changed(stored(folder))):
            np.savez(folder / "proof.npz", **content)
            answers.append(run(folder / "proof.npz", *(["-O"] if number % 2 else [])))
        return answers

    for status, text in on_rank_0(checked):
        assert status == 1
        assert "Traceback" not in text
        assert "the proof holds" not in text


def damaged(folder):
    """Write files that are not proofs; yield their paths."""
    data = stored(folder)
    content = (folder / "proof.npz").read_bytes()
    for name, some in (
        ("empty", b""),
        ("short", content[: len(content) // 2]),
        ("end", content[-200:]),
        ("text", b"the proof holds\n"),
        ("flipped", content[:200] + bytes([content[200] ^ 255]) + content[201:]),
    ):
        (folder / f"{name}.npz").write_bytes(some)
        yield folder / f"{name}.npz"
    S = data["S"]
    for name, other in (
        ("missing", {k: v for k, v in data.items() if k != "p_error"}),
        ("shape", data | {"S": S[:-1]}),
        ("flat", data | {"S": S.ravel()}),
        ("nan", data | {"p": np.full_like(data["p"], np.nan)}),
        ("inf", data | {"S_error": np.full_like(S, np.inf)}),
        ("complex", data | {"S": S + 0j}),
        ("words", data | {"friction": np.array(["1.0", "1.0"])}),
        ("less", data | {"friction": -data["friction"]}),
        ("none", data | {"S": np.zeros((0, 0)), "p": np.zeros(0)}),
        ("no json", data | {"steps": np.array("[{")}),
        ("no list", data | {"steps": np.array('{"do": "pieces"}')}),
        ("no steps", data | {"steps": np.array("[3, null]")}),
        ("nan vectors", data | {"vectors": np.full((1, S.shape[0]), np.nan)}),
        ("format", data | {"format": np.array("dolfinx_contact proof 99")}),
    ):
        np.savez(folder / f"{name}.npz", **other)
        yield folder / f"{name}.npz"


def test_damaged_files_are_refused_without_a_traceback(folder):
    """The exit code is 1, and 2 if the file does not exist."""

    def checked():
        accepted = []
        for path in damaged(folder):
            try:
                Certificate.load(path)
                accepted.append(path.name)
            except InvalidCertificate:
                pass
        (folder / "folder.npz").mkdir()
        names = ("nan.npz", "empty.npz", "folder.npz", "nothing.npz")
        return accepted, [run(folder / name) for name in names]

    accepted, ends = on_rank_0(checked)
    assert not accepted
    assert all(status in (1, 2) and "Traceback" not in text for status, text in ends)
    assert ends[0][0] == 1
    assert ends[-1][0] == 2


class Trap:
    """An object that makes a folder where it is unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def test_objects_in_a_file_are_not_unpickled(folder):
    def checked():
        data = stored(folder)
        accepted = []
        for key in (*data, "another"):
            trap = np.empty((), dtype=object)
            trap[()] = Trap(folder / f"sprung_{key}")
            path = folder / f"trap_{key}.npz"
            np.savez(path, **(data | {key: trap}))
            try:
                Certificate.load(path)
                accepted.append(key)
            except InvalidCertificate:
                pass
        return accepted, run(folder / "trap_p.npz"), list(folder.glob("sprung_*"))

    accepted, (status, text), sprung = on_rank_0(checked)
    assert set(accepted) <= {"another"}
    assert status == 1
    assert "Traceback" not in text
    assert not sprung


MODULES = """
import runpy, sys
sys.argv = ["check_proof.py", {proof!r}]
status = None
try:
    runpy.run_path({checker!r}, run_name="__main__")
except SystemExit as end:
    status = end.code
known = {{*sys.stdlib_module_names, "sitecustomize"}}
tops = {{name.partition(".")[0] for name in sys.modules}}
print("OUTSIDE", sorted(t for t in tops if t not in known and not t.startswith("_")), status)
"""


def test_the_checker_alone_imports_numpy_only_and_says_the_same(folder):
    """The output contains the hash of the data and says that the mesh is not part of the proof."""

    def checked():
        proof = several().certificate
        proof.save(folder / "proof.npz")
        copied = shutil.copy(CHECKER, folder / "alone.py")
        # No variable of MPI or Python: a child of mpirun is a process of its own.
        clean = ("PATH", "HOME", "LC_ALL", "XDG_CACHE_HOME")
        env = {k: os.environ[k] for k in clean if k in os.environ}
        code = MODULES.format(proof=str(folder / "proof.npz"), checker=str(copied))
        options = dict(capture_output=True, text=True, timeout=100, cwd=folder)
        alone = subprocess.run([sys.executable, "-I", "-c", code], env=env, **options)
        env["PYTHONPATH"] = str(CHECKER.parents[2])
        env["OMPI_ALLOW_RUN_AS_ROOT"] = env["OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"] = "1"
        command = [sys.executable, "-m", "dolfinx_contact", "check", "proof.npz"]
        package = subprocess.run(command, env=env, **options)
        return alone.stdout, package.stdout, package.returncode, proof.problem.digest

    alone, package, status, digest = on_rank_0(checked)
    said, _, outside = alone.partition("OUTSIDE")
    assert outside.strip() == "['numpy'] 0"
    assert said.strip() == package.strip()
    assert status == 0
    assert digest in said
    assert "mesh" in said
