"""The demo that `make demo` runs, on coarse meshes."""

import csv
import json

from mpi4py import MPI

import cases.dragged_body
import gmsh
import pytest

COMM = MPI.COMM_WORLD
FILES = {
    *("body.bp", "body_stress.bp", "contact.bp", "contact.csv", "summary.json"),
    *("body.png", "contact.png", "paraview.py"),
}


def check(folder, summary, friction=0.4):
    """Assert the state, the files and their agreement for any run."""
    assert summary["converged"]
    assert summary["ranks"] == COMM.size
    assert min(summary["open"], summary["stick"], summary["slip"]) > 0
    assert 0 < -summary["sum_rt_x"] < friction * summary["sum_rn"]
    assert summary == json.loads((folder / "summary.json").read_text())
    with open(folder / "contact.csv") as stream:
        rows = list(csv.DictReader(stream))
    letters = [row["status"] for row in rows]
    for key, letter in (("open", "o"), ("stick", "k"), ("slip", "s"), ("clamped", "d")):
        assert letters.count(letter) == summary[key]
    for key, column in (("sum_rn", "rn"), ("sum_rt_x", "rt_x"), ("sum_rt_y", "rt_y")):
        total = sum(float(row[column]) for row in rows)
        assert abs(total - summary[key]) < 1e-9 * summary["sum_rn"]


def test_dragged_body_demo_writes_every_named_file(folder, capsys):
    """Partly open, stuck and slipping; every file that is named exists."""
    capsys.readouterr()
    summary = cases.dragged_body.main(["--size", "0.15", "--output", str(folder)])
    printed = capsys.readouterr().out
    check(folder, summary)
    assert summary["kkt_violation"] < 1e-9
    assert summary["dofs"] < 2000
    found = {f.name for f in folder.iterdir()}
    assert found == FILES
    if COMM.rank == 0:
        assert "meshing, cell size 0.15" in printed
        assert "Newton  1: force" in printed
        for name in found:
            assert str(folder / name) in printed
        assert f"{summary['stick']} stick" in printed
    else:
        assert printed == ""


def barrel(file, names=("body", "contact", "top")):
    """A block with a round lower face, meshed line by line so that every gmsh makes the same."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    geo = gmsh.model.geo
    model = gmsh.model
    corners = [geo.addPoint(x, 0, z) for x, z in ((-1, 0.3), (1, 0.3), (1, 1), (-1, 1))]
    centre = geo.addPoint(0, 0, 0.3 + 1.6)
    lines = [
        geo.addCircleArc(corners[0], centre, corners[1]),
        *(geo.addLine(corners[i], corners[(i + 1) % 4]) for i in (1, 2, 3)),
    ]
    for line in lines:
        geo.mesh.setTransfiniteCurve(line, 11 if line in lines[::2] else 4)
    section = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    geo.mesh.setTransfiniteSurface(section)
    _, body, contact, _, top, _ = geo.extrude([(2, section)], 0, 1, 0, numElements=[4])
    geo.synchronize()
    for name, (dim, tag) in {"body": body, "contact": contact, "top": top}.items():
        if name in names:
            model.addPhysicalGroup(dim, [tag], name=name)
    model.mesh.generate(3)
    gmsh.write(str(file))
    gmsh.finalize()


@pytest.mark.ranks(2)
def test_dragged_body_refuses_a_mesh_without_its_top(folder):
    file = folder / "barrel.msh"
    if COMM.rank == 0:
        barrel(file, names=("body", "contact"))
    COMM.barrier()
    with pytest.raises(ValueError, match="named top; there are: contact"):
        cases.dragged_body.main([f"--mesh={file}", f"--output={folder}"])
    with pytest.raises(FileNotFoundError, match="there is no mesh file"):
        cases.dragged_body.main([f"--mesh={folder / 'no.msh'}", f"--output={folder}"])


@pytest.mark.ranks(2)
def test_demo_names_an_unwritable_folder_before_meshing(folder):
    """The error is raised on every rank before meshing."""
    blocked = folder / "file"
    if COMM.rank == 0:
        blocked.write_text("")
    COMM.barrier()
    with pytest.raises(OSError, match="cannot write to the output folder") as info:
        cases.dragged_body.main(["--size=0.01", f"--output={blocked}"])
    assert len(set(COMM.allgather(str(info.value)))) == 1


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--size=0", "must be at least 0.01, got 0"),
        ("--size=nan", "must be finite, got nan"),
        ("--degree=3", "invalid choice: '3'"),
        ("--size=9", "must be at most 0.5, got 9"),
    ],
)
def test_dragged_body_refuses_bad_options(option, message, capsys):
    with pytest.raises(SystemExit):
        cases.dragged_body.main([option])
    assert COMM.rank > 0 or message in capsys.readouterr().err
