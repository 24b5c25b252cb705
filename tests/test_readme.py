"""The examples of the README run as they stand."""

import re
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.meshing import read_mesh
from dolfinx_contact.records import read_journal

COMM = MPI.COMM_WORLD
README = Path(__file__).parents[1] / "README.md"


def example(word):
    """The one Python example with this word."""
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    (code,) = (block for block in blocks if word in block)
    return code


def ball_segment(file):
    """A block on a round face, as the README describes it."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    ball = occ.addSphere(0, 0, 1, 1)
    box = occ.addBox(-1, -1, 0, 2, 2, 0.6)
    occ.intersect([(3, ball)], [(3, box)])
    occ.synchronize()
    (body,) = gmsh.model.getEntities(3)
    faces = [tag for _, tag in gmsh.model.getBoundary([body], oriented=False)]
    top = [f for f in faces if gmsh.model.occ.getCenterOfMass(2, f)[2] > 0.59]
    gmsh.model.addPhysicalGroup(3, [body[1]], name="body")
    gmsh.model.addPhysicalGroup(2, top, name="top")
    gmsh.model.addPhysicalGroup(2, [f for f in faces if f not in top], name="contact")
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.2)
    gmsh.model.mesh.generate(3)
    gmsh.write(str(file))
    gmsh.finalize()


def test_readme_example(folder, monkeypatch):
    if COMM.rank == 0:
        ball_segment(folder / "body.msh")
    COMM.barrier()
    monkeypatch.chdir(folder)
    assert read_mesh(COMM, "body.msh", groups=("top", "contact")).mesh.geometry.dim == 3
    names: dict = {}
    exec(example("read_mesh"), names)
    result = names["result"]
    assert result.kkt_violation < 1e-8
    assert min(result.counts[k] for k in ("open", "slip")) > 0
    force = result.resultants["contact"]
    assert force[2] > 0
    assert np.sign(force[0]) == -1  # dragged to the right, held back to the left
    assert any((folder / "output/body").iterdir())


def test_readme_branch(folder, monkeypatch, capsys):
    """Followed, cut short, resumed and drawn, on any number of ranks."""
    monkeypatch.chdir(folder)
    names: dict = {}
    exec(example("BranchRecord"), names)
    assert names["branch"].reason == "gamma reached the end of its range"
    journal = read_journal("output/branch")
    assert len(journal.sessions) == 3
    assert any(Path("output/series/branch_0000_body.bp").iterdir())
    assert journal.columns()["gamma"][-1] == 1.0
    assert journal.columns()["energy"][-1] > 0
    if COMM.rank == 0:
        assert len(names["table"]) == len(names["journal"].columns()["gamma"]) > 11
        assert {"o", "k", "+", "-"} <= set("".join(names["table"]["status"]))
        assert set(names["events"]["kind"]) == {"event"}
        assert Path("output/branch.png").stat().st_size > 10_000
    said = COMM.bcast(capsys.readouterr().err)
    assert "branch 0: the budget of 10 steps is exhausted" in said


@pytest.mark.skipif(COMM.size > 1, reason="starts a process of its own")
def test_readme_log():
    """What it says of the log switches it on."""
    solve = "from blocks import block\nblock(n=2).solve()\n"
    done = subprocess.run(
        [sys.executable, "-c", example("logging.basicConfig") + solve],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert "INFO:dolfinx_contact.solvers.newton:full steps, iteration 0: residual" in done.stderr
    assert "INFO:dolfinx_contact.solvers.choice:" in done.stderr
