"""Every case of the benchmarks with its default options ends in less than five minutes.

`make test-long` runs them, each in its own process and folder. `cases_at_defaults.json` in the
output folder (``OUTPUT``, by default ``output``) lists the times, which pytest prints as well.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from mpi4py import MPI

import pytest

ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "benchmarks" / "cases").glob("[a-z]*.py"))
LIMIT = 300.0  # seconds
TIMES = Path(os.environ.get("OUTPUT") or ROOT / "output") / "cases_at_defaults.json"


def keep(name, seconds):
    """Add the time of a case to the table."""
    TIMES.parent.mkdir(parents=True, exist_ok=True)
    times = json.loads(TIMES.read_text()) if TIMES.exists() else {}
    times[name] = round(seconds, 1)
    # Two workers may write; the file is replaced as a whole.
    new = TIMES.with_suffix(f".{os.getpid()}.new")
    new.write_text(json.dumps(dict(sorted(times.items())), indent=1) + "\n")
    new.replace(TIMES)


@pytest.mark.long
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="it starts its own processes")
@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_case_at_its_defaults(case, tmp_path):
    # The process must not count as a rank of the tests.
    foreign = ("OMPI_", "PMIX_", "PRTE_", "PMI_")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(foreign)}
    wanted = {k: v for k, v in os.environ.items() if k.startswith(("OMPI_MCA_btl", "OMPI_ALLOW"))}
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, str(case), "--output", str(tmp_path)],
        env=kept | wanted,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    seconds = time.monotonic() - start
    keep(case.stem, seconds)
    print(f"{case.stem}: {seconds:.0f} s")
    assert done.returncode == 0, done.stderr[-3000:]
