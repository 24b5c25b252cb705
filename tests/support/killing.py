"""Runs that are killed, interrupted and resumed, and comparison of their records."""

import os
import random
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from dolfinx_contact.records import read_journal

TREE = Path(__file__).resolve().parents[2]


def launch(ranks, script, *arguments):
    """Start a script of the tests on its own ranks, without the MPI environment of this process."""
    taken = ("OMPI_", "PRTE_", "PMIX_", "PETSC_OPTIONS")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(taken)}
    # As a module: next to a script of this folder, its numbers.py would hide Python's.
    program = ["python3", "-m", f"support.{Path(script).stem}", *map(str, arguments)]
    command = program if ranks == 1 else ["mpirun", "-n", str(ranks), *program]
    # A killed mpirun leaves its folder, in whose way a later one of the same number would be.
    own = tempfile.mkdtemp(prefix="ranks-")
    path = os.pathsep.join([str(TREE / "tests"), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [TREE / "docker/run", *command],
        env=clean | {"DOLFINX_CONTACT_ENV": "direct", "TMPDIR": own, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def family(pid):
    """A process and its descendants."""
    try:
        threads = list(Path(f"/proc/{pid}/task").iterdir())
        children = " ".join((t / "children").read_text() for t in threads)
    except OSError:
        return [pid]
    return [pid, *(q for child in children.split() for q in family(int(child)))]


def kill(process):
    """Send SIGKILL to a process and its descendants, and wait until they have ended.

    Every rank of mpirun is in its own process group, so that a group cannot be killed.
    """
    pids = family(process.pid)
    for pid in pids:
        try:
            os.kill(pid, signal.SIGKILL)
        except ProcessLookupError:
            continue
    process.wait()
    for pid in pids:
        while alive(pid):
            time.sleep(0.005)


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def killed_and_resumed(script, arguments, first, folder, known, kills):
    """Kill sessions of a recording script at random moments, and let the last one end.

    Every session uses another number of ranks, records at least one point, and neither loses nor
    changes earlier points.

    Args:
        script: script of the tests, whose first argument is the folder.
        arguments: arguments of all sessions.
        first: further arguments of the first session; the others have ``--resume``.
        folder: folder of the record.
        known: folder of a record of the same run without kills.
        kills: number of kills.
    """
    random.seed(5)
    path = folder / "journal.jsonl"
    total = (known / path.name).stat().st_size
    moments = [0.1 + 0.8 / kills * (i + random.uniform(0.0, 0.8)) for i in range(kills)]
    recorded = []
    for session, moment in enumerate(moments):
        more = ["--resume"] if session else first
        process = launch(1 + session % 3, script, folder, *arguments, *more)
        # Time passes between a look at the file and the kill: any moment of a step may be hit.
        delay = random.uniform(0.0, 0.05)
        before = len(recorded[-1]) if recorded else 0
        while (
            (path.stat().st_size if path.exists() else 0) < moment * total
            or len(read_journal(folder).rows()) == before  # every session records something
        ):
            if process.poll() is not None:  # the last steps may be written between two looks
                assert process.returncode == 0, (folder / "said.0").read_text()
                break
            time.sleep(0.002)
        time.sleep(delay)
        kill(process)
        recorded.append(read_journal(folder).rows())
    process = launch(2, script, folder, *arguments, "--resume")
    assert process.wait(timeout=300) == 0, (folder / "said.0").read_text()
    journal = read_journal(folder)
    assert [s["ranks"] for s in journal.sessions] == [*(1 + i % 3 for i in range(kills)), 2]
    for rows in recorded:
        assert rows == journal.rows()[: len(rows)]
    lengths = [len(rows) for rows in recorded]
    assert sorted(set(lengths)) == lengths
    assert len(journal.rows()) > lengths[-1]


ENERGIES = ("external", "stored", "dissipated", "residue", "kinetic", "contact")


def require_same(folder, other, tolerance=1e-10):
    """Assert that journals and stored points of two records have the same states."""
    a, b = (read_journal(path) for path in (folder, other))
    assert [s.status for s in a.states] == [s.status for s in b.states]
    rows = a.rows(), b.rows()
    for name in rows[0][0]:
        found, wanted = (np.array([row[name] for row in each]) for each in rows)
        if wanted.dtype.kind != "f":
            if name not in ("newton_iterations", "strategy"):
                np.testing.assert_array_equal(found, wanted, err_msg=name)
            continue
        energy = name in ENERGIES
        scale = max(r["external"] for r in rows[1]) if energy else np.abs(wanted).max(initial=0)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * scale, err_msg=name)
    norm = max(s.size for s in b.states)
    for s, t in zip(a.states, b.states, strict=True):
        assert abs(s.size - t.size) <= tolerance * norm
    found = kept_of(folder, a)
    wanted = kept_of(other, b)
    length = max(np.abs(w[name]).max(initial=0.0) for w in wanted for name in w if "jump" in name)
    for f, w in zip(found, wanted, strict=True):
        assert sorted(f) == sorted(w)
        for name in f:
            scale = length if "jump" in name else np.abs(w[name]).max(initial=0)
            atol = tolerance * scale if w[name].dtype.kind == "f" else 0
            np.testing.assert_allclose(f[name], w[name], rtol=0, atol=atol, err_msg=name)


def kept_of(folder, journal):
    """The arrays of all states: statuses and memory."""
    files = [folder / "checkpoints" / f"{s.checkpoint}.npz" for s in journal.states]
    every = [dict(np.load(file)) for file in files]
    return [{k: v for k, v in f.items() if k.startswith(("statuses", "memory"))} for f in every]


class Stop(Exception):
    """Exception of an observer."""


def stopping(number):
    def observer(step):
        if step.number == number:
            raise Stop

    return observer
