"""Assumption: a stored proof is whole and belongs to its numbers.

Proofs are compared with an enumeration of all 4^m statuses in numpy, from the law alone. Files are
damaged and contain traps.
"""

import itertools
import os
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


def proved(*problem):
    return prove_solutions(ReducedProblem(*problem), proof_seconds=5.0)


def several():
    """The proof of a problem with several solutions."""
    seed = next(s for s in range(50) if number_of(*random_problem(s)) > 1)
    return proved(*random_problem(seed))


# --- numbers of solutions ---


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


@pytest.mark.parametrize("pull", [pytest.param(1.0, marks=pytest.mark.sample), 4.0, -4.0])
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


def damaged(folder):
    """Write files that are not proofs; yield their paths."""
    data = stored(folder)
    content = (folder / "proof.npz").read_bytes()
    for name, some in (
        ("empty", b""),
        ("end", content[-200:]),
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
        ("no list", data | {"steps": np.array('{"do": "pieces"}')}),
        ("no steps", data | {"steps": np.array("[3, null]")}),
        ("nan vectors", data | {"vectors": np.full((1, S.shape[0]), np.nan)}),
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
    """An object making a folder where it is unpickled."""

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
