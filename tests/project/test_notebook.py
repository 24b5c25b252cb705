"""The code of the notebook runs, as a script."""

import json
import sys
import types
from pathlib import Path

from mpi4py import MPI

import matplotlib.image
import pytest

NOTEBOOK = Path(__file__).parents[2] / "docs/notebooks/first_steps.ipynb"


def cells():
    return json.loads(NOTEBOOK.read_text())["cells"]


@pytest.mark.long
@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="a notebook is one process")
def test_the_code_of_the_notebook(folder, monkeypatch):
    """It solves, finds all of three solutions, and shows a picture and a diagram."""
    shown = []
    display = types.ModuleType("IPython.display")
    display.Image = shown.append
    ipython = types.ModuleType("IPython")
    ipython.version_info = (9, 0)  # matplotlib asks
    ipython.get_ipython = lambda: None
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.chdir(folder)
    code = ["".join(c["source"]) for c in cells() if c["cell_type"] == "code"]
    lines = [line for part in code for line in part.splitlines() if not line.startswith("%")]
    names = {}
    exec("\n".join(lines), names)
    counts = names["result"].counts
    assert counts["stick"] > 0 < counts["slip"]
    assert len(names["found"].found) == 3
    assert names["found"].complete
    assert len(names["diagram"].branches) == 4
    assert shown == ["block.png", "diagram.png"]
    for name in shown:
        assert matplotlib.image.imread(folder / name).std() > 0.01


def test_the_notebook_has_no_outputs():
    for cell in cells():
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None


def test_the_notebook_installs_the_solver_and_begins_with_mpi():
    code = ["".join(c["source"]) for c in cells() if c["cell_type"] == "code"]
    assert "[solver]" in code[0]
    assert code[1].startswith("from mpi4py import MPI\n")
