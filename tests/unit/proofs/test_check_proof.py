"""The checker of proofs as a referee runs it: one file, numpy alone, and nothing believed."""

import contextlib
import copy
import io
import json
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from support.enumeration import enumerated, random_problem

from dolfinx_contact.proofs import (
    Certificate,
    InvalidCertificate,
    ReducedProblem,
    check,
    prove_solutions,
)
from dolfinx_contact.proofs import check_proof as cp

CHECKER = Path(cp.__file__)
DATA = ("S", "p", "friction", "bound", "S_error", "p_error")
#: Runs a script where nothing but the standard library, and what else is named, can be imported.
ALONE = """
import runpy, sys
allowed = {*sys.stdlib_module_names, *sys.argv[1].split(",")}
for name in [n for n in sys.modules if n.split(".")[0] not in allowed | {"__main__"}]:
    del sys.modules[name]

class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] not in allowed:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Nothing())
sys.argv = sys.argv[2:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def alone(script, *arguments, modules="numpy"):
    command = [sys.executable, "-I", "-c", ALONE, modules, script, *arguments]
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def proofs():
    """Proofs containing every kind of step, of problems with several solutions."""
    rng = np.random.default_rng(5)
    found = []
    kinds = set()
    while not {"exclude", "only", "branch", "empty", "pieces"} <= kinds or len(found) < 12:
        S, p, F = random_problem(rng)
        m = len(F)
        g = np.where((F == 0) & (rng.random(m) < 0.5), rng.random(m), 0.0)
        errors = 1e-12 * np.abs(S).max() * np.ones_like(S), 1e-12 * np.ones_like(p)
        new = prove_solutions(ReducedProblem(S, p, F, g, *errors)).certificate
        of_these = {step["do"] for step in new.steps}
        if len(found) < 12 or not of_these <= kinds:
            found.append(new)
            kinds |= of_these
    return found


@pytest.fixture
def stored(tmp_path):
    """A proof of three solutions: one node, kt = kn = 2, k = 1, F = 3, p = (-2.5, -1)."""
    S = np.array([[2.0, 1.0], [1.0, 2.0]])
    p = np.array([-2.5, -1.0])
    prove_solutions(ReducedProblem(S, p, np.array([3.0]))).certificate.save(tmp_path / "proof.npz")
    return tmp_path / "proof.npz"


@pytest.mark.verifies(
    "certificates",
    reference="closed form: one node with three solutions",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_checker_needs_one_file_and_numpy(stored, tmp_path):
    """A copy of the file alone prints the claim, its data, and its limits."""
    script = shutil.copy(CHECKER, tmp_path / "copied.py")
    done = alone(script, stored)
    assert (done.returncode, done.stderr) == (0, "")
    proof = Certificate.load(stored)
    for words in (
        "data: 1 contact points",
        proof.problem.digest,
        proof.digest,
        "3 solutions as follows",
        "all there are",
        "is not part of the proof",
        "the proof holds",
    ):
        assert words in done.stdout
    letters = {line.split()[0] for line in done.stdout.splitlines() if "sum rn" in line}
    assert letters == {"o", "k", "-"}


def test_checker_names_the_missing_numpy(stored):
    done = alone(CHECKER, stored, modules="")
    assert done.returncode == 2
    assert done.stderr == "check_proof needs numpy, which this Python does not have\n"
    # What imports it is told by the error itself.
    imported = ALONE.replace('run_name="__main__"', 'run_name="check_proof"')
    command = [sys.executable, "-I", "-c", imported, "", str(CHECKER)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "ModuleNotFoundError: No module named 'numpy'" in done.stderr
    assert "needs numpy" not in done.stderr


def run(arguments, monkeypatch, capsys):
    """The exit status, output and errors of `python3 -m dolfinx_contact`."""
    monkeypatch.setattr(sys, "argv", ["dolfinx_contact", *map(str, arguments)])
    monkeypatch.delitem(sys.modules, "dolfinx_contact.__main__", raising=False)
    with pytest.raises(SystemExit) as end:
        runpy.run_module("dolfinx_contact", run_name="__main__")
    return end.value.code, *capsys.readouterr()


def test_the_command_is_the_same_code(stored, monkeypatch, capsys):
    code, out, _ = run(["check", stored], monkeypatch, capsys)
    assert code == 0
    assert out == alone(CHECKER, stored).stdout
    assert run([], monkeypatch, capsys)[0] == 2
    assert run(["check", stored.with_name("none.npz")], monkeypatch, capsys)[0] == 2


def test_checker_refuses_other_files(stored, monkeypatch, capsys):
    def status():
        code, out, errors = run(["check", stored], monkeypatch, capsys)
        assert out == ""
        return code, errors

    whole = stored.read_bytes()
    with np.load(stored) as archive:
        parts = dict(archive)
    for content in (b"", b"no proof", whole[: len(whole) // 2], whole[:-30]):
        stored.write_bytes(content)
        code, errors = status()
        assert (code, "is not a proof" in errors) == (1, True)
        assert "pickle" not in errors
    for name, value, words in (
        ("format", np.array("dolfinx_contact proof 2"), "of the format"),
        ("S", parts["S"].astype(np.float32), "no double numbers"),
        ("S", parts["S"].astype(object), "is not a proof"),
        ("S", -parts["S"], "not positive definite"),
        ("p", parts["p"][:1], "must have the shape"),
        ("p", parts["p"] * np.nan, "not finite"),
        ("steps", np.array("[" * 100_000), "is not a proof"),
        ("steps", np.array("[{"), "is not a proof"),
        ("steps", np.array("3"), "was changed"),
        ("digests", np.array(["", ""]), "was changed"),
        ("digests", parts["digests"][::-1], "was changed"),
    ):
        np.savez(stored, **{**parts, name: value})
        code, errors = status()
        assert (code, words in errors) == (1, True), (name, errors)
    del parts["p"]
    np.savez(stored, **parts)
    assert "parts are missing" in status()[1]


def test_an_open_proof_is_not_decided(stored, monkeypatch, capsys):
    proof = Certificate.load(stored)
    Certificate(proof.problem, [{"do": "open"}], []).save(stored)
    code, out, _ = run(["check", stored], monkeypatch, capsys)
    assert (code, out.splitlines()[-1]) == (1, "not decided")


def mutated(steps, rng):
    """The steps with one number, list or word of any of them changed."""
    steps = copy.deepcopy(steps)
    step = steps[rng.integers(len(steps))]
    place = step
    key = list(step)[rng.integers(len(step))]
    while isinstance(place[key], list) and place[key] and rng.random() < 0.9:
        place, key = place[key], int(rng.integers(len(place[key])))
    old = place[key]
    others = [None, "x", [], {}, True, -1, 0, 1, 2, 3, 10**30, 0.5, -1e300, float("nan"), 1e308]
    if isinstance(old, int | float) and not isinstance(old, bool):
        others += [old + 1, old - 1, -old, old * 1.5]
    elif isinstance(old, list):
        others += [old[:-1], [*old, *old], old[::-1]]
    elif isinstance(old, str):
        others += ["exclude", "bound", "empty", "only", "pieces", "branch", "rest", "open"]
    place[key] = others[rng.integers(len(others))]
    return steps


def says(proved):
    """Return the statements about solutions, without the open part."""
    return sorted(tuple(piece.codes.tolist()) for piece in proved.inside)


def test_a_changed_file_is_refused(proofs, tmp_path):
    rng = np.random.default_rng(6)
    for proof in proofs:
        path = tmp_path / "proof.npz"
        proof.save(path)
        with np.load(path) as archive:
            parts = dict(archive)
        for name in (*DATA, "vectors"):
            if parts[name].size == 0:
                continue
            other = parts[name].copy()
            k = rng.integers(other.size)
            other.flat[k] = np.nextafter(other.flat[k], np.inf)
            np.savez(path, **{**parts, name: other})
            with pytest.raises(InvalidCertificate):
                Certificate.load(path)
        for _ in range(5):
            steps = mutated(proof.steps, rng)
            np.savez(path, **{**parts, "steps": np.array(json.dumps(steps))})
            if json.dumps(steps) != json.dumps(proof.steps):
                with pytest.raises(InvalidCertificate, match="was changed"):
                    Certificate.load(path)


@pytest.mark.parametrize("tries", [15, pytest.param(1500, marks=pytest.mark.long)])
def test_a_forged_proof_proves_nothing_that_is_false(proofs, tries):
    """With corrected digests it is refused, or proves the same solutions.

    A changed proof may remain valid: with larger weights, a weaker bound or exclusion, or another
    order of parts. Its claim is then still true.
    """
    rng = np.random.default_rng(7)
    taken = 0
    for proof in proofs:
        expected = says(check(proof))
        for _ in range(tries):
            forged = Certificate(proof.problem, mutated(proof.steps, rng), proof.vectors)
            try:
                proved = check(forged)
            except InvalidCertificate:
                continue
            taken += 1
            if proved.verdict == "complete":
                assert says(proved) == expected
            assert set(says(proved)) <= set(expected)
            assert not proved.at_rest
    assert taken > 0


@pytest.mark.parametrize("number", [25, pytest.param(1000, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "certificates",
    reference="enumeration: all 4^m pieces",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_what_is_proved_is_what_is_there(number, tmp_path):
    """Stored, read and checked proofs against all 4^m pieces; other data are not proved by them."""
    rng = np.random.default_rng(8)
    several = 0
    node = np.array([[2.0, 1.0], [1.0, 2.0]])
    for k in range(number):
        S, p, F = random_problem(rng, most=4)
        F *= 3.0  # with more friction there are more solutions
        if k % 8 == 0:  # of two nodes that do not see each other: up to nine
            S = np.kron(np.eye(2), node)
            F = np.full(2, 3.0)
            p = -np.array([2.5, 1.0, 2.5, 1.0]) * rng.uniform(0.9, 1.1, 4)
        problem = ReducedProblem(S, p, F)
        certificate = prove_solutions(problem).certificate
        certificate.save(tmp_path / "proof.npz")
        proved = check(Certificate.load(tmp_path / "proof.npz"))
        expected, near = enumerated(S, p, F)
        if proved.verdict == "complete" and not near:
            assert says(proved) == expected
            several += len(expected) > 1
        # The same steps of other data prove what is true of these, or nothing.
        other = p + rng.standard_normal(len(p)) * 10.0 ** rng.integers(-4, 1)
        moved = Certificate(ReducedProblem(S, other, F), certificate.steps, certificate.vectors)
        try:
            proved = check(moved)
        except InvalidCertificate:
            continue
        expected, near = enumerated(S, other, F)
        if proved.verdict == "complete" and not near and not proved.at_rest:
            assert says(proved) == expected
    assert several >= number // 8


def test_scales_of_any_size_are_checked():
    S = 1e300 * np.eye(2)
    problem = cp.ReducedProblem(S, np.zeros(2), np.ones(1))
    assert cp.check(cp.Certificate(problem, [{"do": "rest"}], [])).at_rest
    nearly = np.array([[2, 1.999999999999667], [1.999999999999667, 2]])
    off = np.full((2, 2), 1.3393625178279571e-14)
    close = cp.ReducedProblem(nearly, np.ones(2), np.ones(1), None, off)
    assert close.scaled.least > 0


FILE = Path(__file__).parents[2] / "data" / "proofs.json"
STORED = json.loads(FILE.read_text()) if FILE.exists() else []


def certificate_of(stored):
    data = {name: np.array(value) for name, value in stored["data"].items()}
    vectors = [np.array(y) for y in stored["vectors"]]
    return cp.Certificate(cp.ReducedProblem(**data), stored["steps"], vectors)


def said(proved):
    """Return the claim of a proof: numbers of statuses, and states of the solutions."""
    regions = [getattr(r, "statuses", r) for r in proved.open_regions]
    return {
        "verdict": proved.verdict,
        "inside": [q.codes.tolist() for q in proved.inside],
        "border": [q.codes.tolist() for q in proved.border],
        "singular": [codes.tolist() for codes in proved.singular],
        "open": [r.tolist() for r in regions],
        "states": [q.state.tolist() for q in proved.inside],
        "away": [q.away.tolist() for q in proved.inside],
    }


def of_kind(*kinds, **new):
    """Return a forgery that changes all steps of some kinds."""

    def forge(proof):
        for step in proof.steps:
            if step["do"] in kinds:
                step |= {key: change(step, proof) for key, change in new.items()}

    return forge


def filled(value):
    """Return a change that fills an array of a step with a number."""
    return lambda step, _: np.full_like(np.array(step["weights"]), value).tolist()


def exchange_points(proof):
    last = proof.problem.points - 1
    for step in proof.steps:
        if "point" in step:
            step["point"] = last - step["point"]
        if "codes" in step:
            step["codes"] = step["codes"][::-1]
        if step["do"] == "exclude" and proof.problem.dim == 2:
            step["what"] = [[last - point, status] for point, status in step["what"]]


def exchange_multipliers(proof):
    """Shift the multipliers by one step; only those of singular pieces may remain."""
    if any(step["do"] == "exclude" for step in proof.steps):
        proof.vectors.append(proof.vectors.pop(0))


def exclude_everything(step, proof):
    if proof.problem.dim == 3:
        return list(range(8))
    return [[point, status] for point in range(proof.problem.points) for status in range(7)]


LEAVES = "pieces", "only", "leaf"
#: Changes of a stored proof that would prove something false, or nothing, if it were accepted.
FORGERIES = {
    "the last leaf is missing": lambda proof: proof.steps.pop(),
    "a leaf is repeated": lambda proof: proof.steps.append(proof.steps[-1]),
    "the steps are reversed": lambda proof: proof.steps.reverse(),
    "the load is forgotten": of_kind(*LEAVES, do=lambda *_: "rest"),
    "multipliers belong to other steps": exchange_multipliers,
    "leaves are declared empty": of_kind(*LEAVES, do=lambda *_: "empty", y=lambda *_: 0),
    "open regions are declared empty": of_kind("open", do=lambda *_: "empty", y=lambda *_: 0),
    "bounds are not numbers": of_kind("bound", value=lambda *_: np.nan),
    "bounds are minus infinity": of_kind("bound", value=lambda *_: -np.inf),
    "bounds are lowered by a half": of_kind(
        "bound", value=lambda step, _: step["value"] - 0.5 * abs(step["value"])
    ),
    "all statuses or cells are excluded": of_kind("exclude", what=exclude_everything),
    "a branch repeats its first part": of_kind(
        "branch", parts=lambda step, _: [step["parts"][0]] * len(step["parts"])
    ),
    "points are exchanged": exchange_points,
    "another piece is the only solution": of_kind(
        "only", "leaf", codes=lambda step, _: [0] * len(step["codes"])
    ),
    "weights are infinite": of_kind("only", weights=filled(np.inf)),
    "weights are negative": of_kind("only", weights=filled(-1.0)),
    "the slope of a uniqueness is not a number": of_kind("only", mu=lambda *_: np.nan),
}


@pytest.mark.parametrize("forge", FORGERIES.values(), ids=FORGERIES)
def test_a_forgery_of_whole_steps_is_refused(forge):
    """Its digests are those of the changed steps."""
    forged = 0
    for stored in STORED:
        proof = certificate_of(copy.deepcopy(stored))
        before = proof.digest
        forge(proof)
        if proof.digest == before:
            continue
        forged += 1
        with pytest.raises(InvalidCertificate):
            check(proof)
    assert forged > 0


@pytest.mark.parametrize("number", range(len(STORED)))
def test_stored_proofs_hold(number):
    stored = STORED[number]
    now = said(cp.check(certificate_of(stored)))
    then = stored["says"]
    for name in ("verdict", "inside", "border", "singular", "open"):
        assert now[name] == then[name]
    for name in ("states", "away"):
        for a, b in zip(now[name], then[name], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-13)


def told(certificate, folder):
    """Return the output of the command without numbers, its exit code, and the digests."""
    certificate.save(Path(folder) / "proof.npz")
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        status = cp.main([str(Path(folder) / "proof.npz")])
    words = re.sub(r"[-+]?\d\S*|[0-9a-f]{64}", "#", out.getvalue())
    return [status, words, certificate.problem.digest, certificate.digest]


@pytest.mark.parametrize("number", range(len(STORED)))
def test_a_bound_holds_within_its_rounding_error(number):
    """Other processors round sums differently. A value that is far too small is refused."""
    stored = STORED[number]
    bounds = [k for k, step in enumerate(stored["steps"]) if step["do"] == "bound"]
    for k in bounds[:3]:
        value = stored["steps"][k]["value"]
        for less, holds in ((abs(value - np.nextafter(value, -np.inf)), True), (1.0, False)):
            steps = [dict(step) for step in stored["steps"]]
            steps[k]["value"] = value - less
            certificate = certificate_of({**stored, "steps": steps})
            if holds:
                assert cp.check(certificate).verdict == stored["says"]["verdict"]
                continue
            with pytest.raises(cp.InvalidCertificate):
                cp.check(certificate)


@pytest.mark.parametrize("number", range(len(STORED)))
def test_the_command_says_what_it_said(number, tmp_path):
    """Digests do not depend on the machine."""
    certificate = certificate_of(STORED[number])
    assert told(certificate, tmp_path) == STORED[number]["told"]


def write():
    for stored in STORED:
        certificate = certificate_of(stored)
        stored["says"] = said(cp.check(certificate))
        with tempfile.TemporaryDirectory() as folder:
            stored["told"] = told(certificate, folder)
    FILE.write_text(json.dumps(STORED, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    write()
