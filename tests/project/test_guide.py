"""Examples of the guide run as they stand, page by page."""

import re
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
from cases._surfaces import ball, write_stl
from support.blocks import block, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    materials,
    meshing,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.records import read_journal

COMM = MPI.COMM_WORLD
GUIDE = Path(__file__).parents[2] / "docs" / "guide"


def examples(page):
    """The Python examples of a page, in order."""
    return re.findall(r"```python\n(.*?)```", (GUIDE / page).read_text(), flags=re.DOTALL)


def run(page, **names):
    """Run the examples of a page one after the other, returning their names."""
    for code in examples(page):
        exec(code, names)
    return names


def test_no_example_is_forgotten():
    pages = {page.name for page in GUIDE.glob("*.md") if examples(page.name)}
    assert pages == {"bodies.md", "histories.md", "laws.md", "records.md", "solving.md"}


def test_each_law_of_the_guide_presses_back():
    """Each law of the page presses back; those with a time are made so that a solve needs none."""
    names = run("laws.md")
    laws = [names[name] for name in ("spring", "soft", "both", "around")]
    laws.append(names["SlipWeakening"](0.6, 0.3, 0.01))
    laws.append(names["Adhesion"](100.0, 100.0, 1.0, 0.3, 0.0))
    for law in laws:
        result = block(n=4, law=law).solve()
        assert result.converged
        assert result.resultants["contact"][1] > 0


def write_tools(folder):
    """The files that the page on bodies reads: a ball in mm, and a box with the group `die`."""
    if COMM.rank == 0:
        points, cells = ball(2)
        write_stl(folder / "punch.stl", 1e3 * points, cells)
        write_stl(folder / "scan.stl", 1e3 * points, np.vstack([cells[:, ::-1], [0, 0, 1]]))
        gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        skin = [tag for _, tag in gmsh.model.getEntities(2)]
        gmsh.model.addPhysicalGroup(2, skin, name="die")
        gmsh.model.mesh.generate(2)
        gmsh.write(str(folder / "press.msh"))
        gmsh.finalize()
    COMM.barrier()


@pytest.mark.ranks(2)
def test_indenter_of_the_guide_carries_its_force(folder, monkeypatch):
    """On a cube that is held below; the force that the page gives arrives."""
    write_tools(folder)
    monkeypatch.chdir(folder)
    cube = mesh.create_unit_cube(COMM, 4, 4, 4)
    top, below = np.sort(facets(cube, 2, 1.0)), facets(cube, 2, 0.0)
    # The page has the top of its body at z = 0.
    cube.geometry.x[:] -= (0.5, 0.5, 1.0)
    V = fem.functionspace(cube, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    held = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, below), V)
    body = meshing.name_groups(cube, {"top": top})
    names = run("bodies.md", u=u, body=body)
    energy = materials.LinearElastic.from_young(1e6, 0.3).energy(u) * ufl.dx
    result = ContactProblem(energy, u, [names["contact"]], bcs=[held]).solve()
    indenter = result.rigid_bodies["indenter"]
    assert result.resultants["contact"][2] == pytest.approx(-1e3)
    assert indenter.displacement[2] < 0
    assert names["punch"].closed
    assert names["die"].closed


@pytest.mark.ranks(2)
def test_motion_of_the_guide_keeps_its_energy():
    """A cube falling onto a floor and keeping its energy."""
    cube = mesh.create_unit_cube(COMM, 2, 2, 2)
    V = fem.functionspace(cube, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    energy = materials.LinearElastic.from_young(1e3, 0.3).energy(u) * ufl.dx
    floor = HalfSpace((0.0, 0.0, -1e-5), (0.0, 0.0, 1.0))
    surface = ContactSurface(u, facets(cube, 2, 0.0), obstacle=floor, law=Coulomb(0.3))
    names = {"problem": ContactProblem(energy, u, [surface]), "V": V}
    exec(examples("histories.md")[-1], names)
    history = names["history"]
    assert history.complete
    forces = [step.result.resultants["contact"][2] for step in history.steps]
    assert forces[0] == 0.0
    assert max(forces) > 0.0
    before = 7.8e-9 / 2
    assert 0 < history.energies.kinetic < before
    assert abs(history.energies.residue) < 1e-6 * before


def test_histories_of_the_guide_continue():
    """A step from a snapshot, and histories continuing and beginning again."""
    square = mesh.create_unit_square(COMM, 2, 2)
    V = fem.functionspace(square, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    moved = fem.Constant(square, (0.0, -0.01))
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, facets(square, 1, 1.0)), V)
    energy = materials.LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(square, 1, 0.0), obstacle=floor, law=Coulomb(0.2))
    problem = ContactProblem(energy, u, [surface], bcs=[held])

    def load(t):
        moved.value[0] = 0.004 * t

    names = {"problem": problem, "load": load, "QuasiStatic": QuasiStatic}
    for code in examples("histories.md")[:-1]:
        exec(code, names)
    ends = [names[name] for name in ("history", "more", "again")]
    assert all(history.complete for history in ends)
    assert ends[0].energies.dissipated < ends[1].energies.dissipated


@pytest.mark.long
def test_recorded_branch_of_the_guide_resumes(folder, monkeypatch, capsys):
    """Followed, cut short, resumed and drawn, on any number of ranks."""
    monkeypatch.chdir(folder)
    names = run("records.md")
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
        assert Path("output/branch.png").stat().st_size > 5_000
        assert len(names["u_3"]) == len(names["surface"].x)
    said = COMM.bcast(capsys.readouterr().err)
    assert "branch 0: the budget of 10 steps is exhausted" in said


def test_two_solves_start_from_the_same_state():
    """Two solves from the same state."""
    problem = block(n=2, law=Coulomb(0.2))
    names = {"problem": problem, "surface": problem.surfaces[0]}
    exec(examples("solving.md")[0], names)
    shear = [abs(result.resultants["contact"][0]) for result in names["results"]]
    assert shear[1] > 1.5 * shear[0] > 0


def test_log_of_the_guide_appears():
    *_, code = examples("solving.md")
    solve = "from support.blocks import block\nblock(n=2).solve()\n"
    done = subprocess.run(
        [sys.executable, "-c", code + solve],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert "INFO:dolfinx_contact.solvers.newton:full steps, iteration 0: residual" in done.stderr
    assert "INFO:dolfinx_contact.solvers.linear:" in done.stderr
