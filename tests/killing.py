"""Runs in processes of their own, and their ends."""

import os
import signal
import subprocess
import tempfile
import time
from pathlib import Path

TREE = Path(__file__).resolve().parents[1]


def launch(ranks, script, *arguments):
    """Start a script of the tests on ranks of its own, without what this process has from its."""
    taken = ("OMPI_", "PRTE_", "PMIX_", "PETSC_OPTIONS")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(taken)}
    program = ["python3", str(TREE / "tests" / script), *map(str, arguments)]
    command = program if ranks == 1 else ["mpirun", "-n", str(ranks), *program]
    # A killed mpirun leaves its folder, in whose way a later one of the same number would be.
    own = tempfile.mkdtemp(prefix="ranks-")
    return subprocess.Popen(
        [TREE / "docker/run", *command],
        env=clean | {"DOLFINX_CONTACT_ENV": "direct", "TMPDIR": own},
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
    """SIGKILL for a process and all that it has started, and wait until they are gone."""
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
