"""The example of the README runs as it stands."""

import re
from pathlib import Path

from mpi4py import MPI

import numpy as np
from recorded_run import moved_block, start

import ufl

from dolfinx_contact.materials import NeoHookean
from dolfinx_contact.meshing import read_mesh

COMM = MPI.COMM_WORLD
README = Path(__file__).parents[1] / "README.md"


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
    code, _ = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    if COMM.rank == 0:
        ball_segment(folder / "body.msh")
    COMM.barrier()
    monkeypatch.chdir(folder)
    assert read_mesh(COMM, "body.msh", groups=("top", "contact")).mesh.geometry.dim == 3
    names: dict = {}
    exec(compile(code, "README.md", "exec"), names)
    result = names["result"]
    assert result.kkt_violation < 1e-8
    assert min(result.counts[k] for k in ("open", "slip")) > 0
    force = result.resultants["contact"]
    assert force[2] > 0
    assert np.sign(force[0]) == -1  # dragged to the right, held back to the left
    assert any((folder / "output/body").iterdir())


def test_readme_record(folder, monkeypatch):
    """The example of a record, with a block and `steel` for its material."""
    _, code = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    monkeypatch.chdir(folder)
    system, _ = moved_block(COMM, n=2)
    names = {
        "system": system,
        "u": system.problem.u,
        "steel": NeoHookean(600.0, 400.0),
        "x": start(system),
        "comm": COMM,
        "ufl": ufl,
    }
    # One rank draws; on others the same file would be written at the same time.
    exec(code if COMM.rank == 0 else code.replace("draw_diagram(", "(lambda *_: None)("), names)
    assert names["branch"].reason == "gamma reached the end of its range"
    table = names["table"]
    assert table["gamma"].iloc[-1] == 1.0
    assert table["energy"].iloc[-1] > 0
    assert len(names["events"]) > 0
    if COMM.rank == 0:
        assert Path("output/branch.png").stat().st_size > 10_000
