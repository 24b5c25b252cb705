"""Proofs that were stored once: they hold today, and every bound behind them is what it was.

`data/proofs.json` has proofs in the plane and in space with every kind of step, of laws mixed, and
data with errors; beside each what it says. A bound that becomes larger takes proofs away from who
has stored them, one that becomes smaller may prove what is false. So that both are seen, also in
what rounding contributes, bounds are recorded at a unit round-off of 2^-20, as sums with weights.
Whether they are *right* is a matter of `test_certificates.py`, `test_proofs_in_space.py` and
`test_bounds_in_closed_form.py`; who derives a better bound writes the record anew::

    docker/run python3 tests/unit/proofs/test_recorded_proofs.py
"""

import contextlib
import io
import itertools
import json
import re
import tempfile
from contextlib import contextmanager
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.proofs import check_proof as cp

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, one process")
FILE = Path(__file__).parents[2] / "data" / "proofs.json"
STORED = json.loads(FILE.read_text()) if FILE.exists() else []


@contextmanager
def coarse():
    """Arithmetic that is said to be rounded to 20 bits."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("_U", 2.0**-20), ("_SLACK", 2.0**-14), ("_ANGLES", 2.0**-18)):
            patch.setattr(cp, name, value)
        yield patch


def certificate_of(stored):
    data = {name: np.array(value) for name, value in stored["data"].items()}
    vectors = [np.array(y) for y in stored["vectors"]]
    return cp.Certificate(cp.ReducedProblem(**data), stored["steps"], vectors)


def said(proved):
    """What a proof says: numbers of statuses, and the states of the solutions."""
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


@pytest.mark.parametrize("number", range(len(STORED)))
def test_stored_proofs_hold(number):
    """They are taken, and say what they said."""
    stored = STORED[number]
    now = said(cp.check(certificate_of(stored)))
    then = stored["says"]
    for name in ("verdict", "inside", "border", "singular", "open"):
        assert now[name] == then[name]
    for name in ("states", "away"):
        for a, b in zip(now[name], then[name], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("number", range(len(STORED)))
def test_bounds_are_what_they_were(number):
    stored = STORED[number]
    found = dict(recorded(certificate_of(stored).problem.scaled, stored["steps"]))
    assert list(found) == list(stored["bounds"])
    for name, (value, size) in found.items():
        assert abs(value - stored["bounds"][name]) <= 1e-8 * size + 1e-300, name


def told(certificate, folder):
    """What the command says of a stored proof, but for numbers, and its status; the digests."""
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
    """Digests do not depend on the machine, and what is read is what was written."""
    certificate = certificate_of(STORED[number])
    assert told(certificate, tmp_path) == STORED[number]["told"]


# -- what is recorded ------------------------------------------------------------------------------


def summed(value):
    """A sum of numbers with weights, and of their sizes."""
    x = np.nan_to_num(np.asarray(value, dtype=float), nan=7e3, posinf=5e3, neginf=-3e3).ravel()
    return float(np.cos(0.7 * np.arange(len(x)) + 0.3) @ x), float(np.abs(x).sum())


def recorded(problem, steps):
    """Names and sums of the bounds of a problem."""
    of = in_space if problem.dim == 3 else in_the_plane
    with coarse() as patch:
        problem.__dict__.pop("least", None)
        for k, (name, value) in enumerate(of(problem, steps, patch)):
            yield f"{k} {name}", summed(value)


def of_energy(problem):
    e = cp._ellipsoid(problem)
    yield "least", problem.least
    for name in ("twice", "shift", "inverse", "inverse_off", "diagonal", "rho"):
        yield name, getattr(e, name)
    yield "flexibility", cp.flexibility(problem)[1]


def multipliers(problem):
    k = np.arange(len(problem.p))
    return np.cos(k + 0.5), np.linalg.solve(problem.S, np.sin(2 * k + 0.2))


def captured(patch, proves):
    """The form that has to be positive definite, and its error."""
    found = []
    with patch.context() as inner:
        inner.setattr(cp, "positive_definite", lambda Q, error: found.append((Q, error)) or True)
        found.append((np.array(float(proves())), np.zeros(0)))
    return found


def in_the_plane(problem, steps, patch):
    yield from of_energy(problem)
    ub = cp.bounded(problem)
    yield "bounded", ub
    for y in multipliers(problem):
        dual = cp.Dual(problem, y)
        yield "h", dual.least(ub)
        yield "round_off", dual.round_off(ub)
        for margin in (-3e3, 0.0, 1.0, 3e3):
            yield "impossible", dual.impossible(problem.statuses, ub, margin)
        for slot in range(6):
            yield "most", dual.most(problem.statuses, ub, slot, problem.points - 1)
    choices = cp.StatusRegion(problem, problem.statuses, ub).choices
    for codes in list(itertools.product(*choices))[::7][:12]:
        piece = cp.solve_piece(problem, np.array(codes, dtype=np.int8))
        yield f"piece {codes} {piece and piece.verdict}", np.zeros(0)
        if piece is None:
            continue
        yield "state", piece.state
        yield "away", piece.away
        for s in (*piece.slacks, piece.inequalities):
            yield "low", s.low
            yield "high", s.high
        own = 1 << piece.codes.astype(int)
        for more in (0, 1, 2, 3, 4, 5, 6, 9, 12, 16, 32, 80, 127):
            allowed = problem.statuses & (own | more)
            found = cp.differences(piece, allowed, ub)
            yield f"differences {found is not None}", np.zeros(0)
            if found is None:
                continue
            for name in ("unknown", "equal", "k1", "k2"):
                yield name, getattr(found, name)
            for name in ("rows", "tilts"):
                yield name, getattr(found, name).value
                yield f"errors of {name}", getattr(found, name).radius
            n = len(found.unknown)
            theta = 0.3 / (1 + problem.friction[found.unknown // 2])
            w = 1.0 + np.arange(n)
            for Q, error in captured(patch, lambda: found.prove(w, theta, 0.7)):  # noqa: B023
                yield "form", Q
                yield "error", error


def in_space(problem, steps, patch):
    yield from of_energy(problem)
    whole = cp.SpaceRegion.whole(problem)
    yield "bounded", whole.most
    halved = whole.cells
    if (problem.friction > 0).all():
        halved = whole.cells.halved(0)
        yield "halved", halved.ends
    for y in multipliers(problem):
        dual = cp.SpaceDual(problem, y)
        yield "h", dual.least(halved, whole.most)
        yield "round_off", dual.round_off(whole.most)
        for margin in (-3e3, 0.0, 1.0, 3e3):
            yield "impossible", dual.impossible(halved, whole.most, margin)
        for quantity in range(cp.MOST):
            yield "most", dual.most(halved, whole.most, quantity, problem.points - 1)
    starts = {tuple(s["codes"]): s["z"] for s in steps if "z" in s}
    for codes, z in starts.items():
        piece = cp.solve_in_space(problem, np.array(codes, dtype=np.int8), np.array(z))
        yield f"piece {codes} {piece and piece.verdict}", np.zeros(0)
        if piece is not None:
            yield from of_a_piece(piece, whole, patch)


def of_a_piece(piece, whole, patch):
    problem = piece.problem
    for name in ("z", "e", "inverse", "residual", "radius", "turn", "state", "away", "_alone"):
        yield name, getattr(piece, name)
    yield "growth", cp._growth(piece, 3.0 * piece.radius + 1e-3)
    for s in (piece.slack, piece.inequalities):
        yield "low", s.low
        yield "high", s.high
    cells = whole.cells
    near = np.ones(len(cells), dtype=bool)
    for i in np.flatnonzero(piece.slips):
        arcs = np.flatnonzero((cells.node == i) & (cells.kind == cp.IN_SLIP))
        if len(arcs):
            middles = cp.directions(cells.ends[arcs].mean(axis=1))
            near[arcs] = middles @ piece.e[i] > 0.5
            kept = cells.kept(near)
            yield "angles", cp.angles_of(piece, kept, int(i)) or np.zeros(0)
            for term in cp._columns_of_slip(piece, kept, whole.most, int(i)) or ():
                yield "vector", term.vector.value
                yield "off", term.vector.radius
                yield "middle", [term.column, term.middle, term.width]
    kind = {0: cp.IN_OPEN, 1: cp.IN_STICK, 2: cp.IN_SLIP}
    own = np.array([kind.get(int(c), cp.IN_OPEN) for c in piece.codes])
    own = np.where((piece.codes == 2) & (problem.friction == 0), cp.IN_CLOSED, own)
    most = whole.most.copy()
    most[[5, 7]] = -0.1 * np.abs(most[[6, 8]])
    for more in itertools.chain.from_iterable(
        itertools.combinations(range(4), k) for k in range(4)
    ):
        keep = near & ((cells.kind == own[cells.node]) | np.isin(cells.kind, more))
        kept = cells.kept(keep)
        found = cp.space_differences(piece, kept, most)
        yield f"differences {more} {found is not None}", np.zeros(0)
        if found is None:
            continue
        for name in ("unknown", "forms", "sizes", "errors", "has", "vanishing"):
            yield name, getattr(found, name)
        w = 1.0 + np.arange(found.has.size).reshape(found.has.shape)
        for Q, error in captured(patch, lambda: found.prove(w, 0.7)):  # noqa: B023
            yield "form", Q
            yield "error", error
    matrices = []
    with patch.context() as inner:
        inner.setattr(cp, "_contracts", lambda G: matrices.append(G) or True)
        keep = near & (cells.kind == own[cells.node])
        yield "only", float(cp.only_one(piece, cells.kept(keep), most))
    for G in matrices:
        yield "G", G


def write():
    for stored in STORED:
        certificate = certificate_of(stored)
        stored["says"] = said(cp.check(certificate))
        found = recorded(certificate.problem.scaled, stored["steps"])
        stored["bounds"] = {name: float(f"{value:.11g}") for name, (value, _) in found}
        with tempfile.TemporaryDirectory() as folder:
            stored["told"] = told(certificate, folder)
    FILE.write_text(json.dumps(STORED, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    write()
