"""The examples of the README run as they stand."""

import re
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.meshing import read_mesh

COMM = MPI.COMM_WORLD
README = Path(__file__).parents[1] / "README.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


def example(word):
    """The one Python example with this word."""
    (code,) = (block for block in EXAMPLES if word in block)
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


def test_all_solutions(capsys):
    names: dict = {}
    exec(example("find_solutions"), names)
    found = names["found"]
    assert found.complete
    assert "3 solutions at gamma = 1; proved to be all there are: " in capsys.readouterr().out
    # The corner is off the floor, sticks to it, or slips to the left.
    letters = [names["system"].letters(solution.piece) for solution in found.found]
    assert {word[0] for word in letters} == {"o", "k", "-"}
    assert {word[1:] for word in letters} == {"o" * 15 + "d"}


def test_it_is_short_and_every_example_runs():
    assert len(README.read_text().splitlines()) <= 200
    assert [example("read_mesh"), example("find_solutions")] == EXAMPLES


def places(file):
    """The headings of a page, as its links name them."""
    headings = re.findall(r"^#+ (.*)$", file.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^a-z0-9 -]", "", text.lower()).replace(" ", "-") for text in headings}


@pytest.mark.skipif(COMM.size > 1, reason="looks at files")
def test_links_lead_to_files():
    """Of the README and the guide, as they are read in the repository."""
    pages = [README, *(README.parent / "docs" / "guide").glob("*.md")]
    count = 0
    for page in [*pages, README.parent / "docs" / "limits.md"]:
        for link in re.findall(r"\]\(([^)\s]*)\)", page.read_text()):
            if link.startswith("http"):
                continue
            name, _, place = link.partition("#")
            file = page.parent / name if name else page
            assert file.exists(), f"{page.name}: {link}"
            assert not place or place in places(file), f"{page.name}: {link}"
            count += 1
    assert count > 80
