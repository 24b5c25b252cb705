"""Every demo as it stands, with its defaults: it ends, and in less than five minutes.

`make test-long` runs them, each in a process and a folder of its own. How long they took is in
`demos_at_defaults.json` in the output folder (``OUTPUT``, else ``output``), and in what pytest
prints.
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
DEMOS = sorted((ROOT / "demos").glob("demo_*.py"))
LIMIT = 300.0  # seconds
TIMES = Path(os.environ.get("OUTPUT") or ROOT / "output") / "demos_at_defaults.json"


def keep(name, seconds):
    """Put what a demo took into the table of all."""
    TIMES.parent.mkdir(parents=True, exist_ok=True)
    known = json.loads(TIMES.read_text()) if TIMES.exists() else {}
    known[name] = round(seconds, 1)
    # Two workers may write: what is there is always whole.
    new = TIMES.with_suffix(f".{os.getpid()}.new")
    new.write_text(json.dumps(dict(sorted(known.items())), indent=1) + "\n")
    new.replace(TIMES)


@pytest.mark.long
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="it starts processes of its own")
@pytest.mark.parametrize("demo", DEMOS, ids=lambda path: path.stem)
def test_demo_at_its_defaults(demo, tmp_path):
    # Not as one of the ranks that the tests run on.
    inherited = ("OMPI_", "PMIX_", "PRTE_", "PMI_")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(inherited)}
    wanted = {k: v for k, v in os.environ.items() if k.startswith(("OMPI_MCA_btl", "OMPI_ALLOW"))}
    start = time.monotonic()
    found = subprocess.run(
        [sys.executable, str(demo), "--output", str(tmp_path)],
        env=kept | wanted,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    seconds = time.monotonic() - start
    keep(demo.stem, seconds)
    print(f"{demo.stem}: {seconds:.0f} s")
    assert found.returncode == 0, found.stderr[-3000:]
