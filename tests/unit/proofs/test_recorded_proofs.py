"""Stored proofs of every kind: they hold today and prove what they proved.

`data/proofs.json` has proofs in the plane and in space with every kind of step, mixed laws and data
with errors, and for each its verdict, solutions and error bounds. To write what is proved again::

    docker/run python3 tests/unit/proofs/test_recorded_proofs.py
"""

import contextlib
import io
import json
import re
import tempfile
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.proofs import check_proof as cp

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, one process")
FILE = Path(__file__).parents[2] / "data" / "proofs.json"
STORED = json.loads(FILE.read_text()) if FILE.exists() else []


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


def write():
    for stored in STORED:
        certificate = certificate_of(stored)
        stored["says"] = said(cp.check(certificate))
        with tempfile.TemporaryDirectory() as folder:
            stored["told"] = told(certificate, folder)
    FILE.write_text(json.dumps(STORED, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    write()
