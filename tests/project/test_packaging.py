"""Metadata of the package, messages about missing dependencies, and the Makefile."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import import_module
from itertools import chain
from pathlib import Path

from mpi4py import MPI

import pytest
from support.blocks import block

import dolfinx_contact
from dolfinx_contact import meshing
from dolfinx_contact._install import refuse_serial_copies
from dolfinx_contact.plot import draw_diagram, picture_of_states
from dolfinx_contact.records import Journal

COMM = MPI.COMM_WORLD
TREE = Path(__file__).resolve().parents[2]
SYSTEM = {
    "dolfinx",
    "ufl",
    "basix",
    "petsc4py",
    "slepc4py",
    "mpi4py",
}  # from Debian, conda or Docker


def imported(text):
    """Packages that a module asks for, by import or by `optional`."""
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module)
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "optional":
            names.add(node.args[0].value)
    return {name.partition(".")[0] for name in names}


def test_everything_that_is_imported_is_declared():
    project = tomllib.loads((TREE / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    ours = [extras[name] for name in ("pictures", "records", "explorer", "gmsh")]
    declared = {*project["dependencies"], *chain(*ours)}
    everything = (TREE / "dolfinx_contact").rglob("*.py")
    files = [f for f in everything if f.name != "in_paraview.py"]  # which ParaView runs
    asked = set().union(*(imported(f.read_text()) for f in files))
    names = {"imageio_ffmpeg": "imageio-ffmpeg", "vtkmodules": "pyvista"}  # pyvista installs VTK
    names |= dict.fromkeys(("PIL", "contourpy"), "matplotlib")  # which installs both
    asked = {names.get(name, name) for name in asked}
    assert asked - SYSTEM - set(sys.stdlib_module_names) - {"dolfinx_contact"} == declared
    assert (TREE / "dolfinx_contact" / "py.typed").exists()


def test_mpi_is_loaded_before_compiled_modules():
    """Also where a script begins with this package; wheels do not find their MPI otherwise."""
    code = """
import sys
class Seen:
    def find_spec(self, name, path=None, target=None):
        if name in ("petsc4py.PETSc", "dolfinx", "basix"):
            assert "mpi4py.MPI" in sys.modules, name
sys.meta_path.insert(0, Seen())
import dolfinx_contact
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def first_compiled(text, folder):
    """The first of the packages that a script loads, itself or by a module beside it."""
    for name in re.findall(r"^(?:from|import) (\w+)", text, flags=re.MULTILINE):
        if name in ("mpi4py", "petsc4py", "slepc4py", "dolfinx", "basix", "dolfinx_contact"):
            return name
        beside = folder / f"{name}.py"
        found = first_compiled(beside.read_text(), folder) if beside.exists() else None
        if found:
            return found
    return None


def test_scripts_begin_with_mpi():
    """Demos, recipes, tutorials and examples, so that they run on wheels."""
    first = {}
    for path in [*(TREE / "demos").glob("*.py"), *(TREE / "docs").glob("[rt]*/*.py")]:
        first[path.name] = first_compiled(path.read_text(), path.parent)
    for page in (TREE / "README.md", TREE / "docs" / "guide" / "records.md"):
        blocks = re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)
        for number, text in enumerate(blocks):
            first[f"{page.name}, example {number}"] = first_compiled(text, TREE)
    assert sum(name == "mpi4py" for name in first.values()) > 60
    # This package loads MPI before all others.
    assert set(first.values()) <= {"mpi4py", "dolfinx_contact", None}, first


@pytest.mark.parametrize(
    ("name", "value"), [("OMPI_COMM_WORLD_SIZE", "2"), ("PMI_SIZE", "3"), ("PMIX_RANK", "1")]
)
def test_serial_copies_are_refused(name, value):
    """N copies that another MPI's launcher has started."""
    said = rf"one of several \({name}={value}\), but mpi4py sees one rank.*Start the ranks with"
    with pytest.raises(RuntimeError, match=said):
        refuse_serial_copies({name: value})
    refuse_serial_copies({"OMPI_COMM_WORLD_SIZE": "1", "PMI_SIZE": "1", "PMIX_RANK": "0"})
    refuse_serial_copies({"PMI_SIZE": "many"})


def test_serial_copies_are_refused_at_import():
    done = subprocess.run(
        [sys.executable, "-c", "import dolfinx_contact"],
        env=os.environ | {"PMI_SIZE": "2"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("RuntimeError: this process is one of several")


@pytest.mark.ranks(2)
def test_ranks_of_one_run_are_not_copies():
    if COMM.size > 1:
        refuse_serial_copies({"PMI_SIZE": str(COMM.size)})


def missing(monkeypatch, *packages):
    """Let imports of the packages fail as if they were not installed."""
    for name in packages:
        for module in [m for m in sys.modules if m.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, module)

    class Nowhere:
        def find_spec(self, name, path=None, target=None):
            if name.partition(".")[0] in packages:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(sys, "meta_path", [Nowhere(), *sys.meta_path])


def test_installed_command_is_the_module(monkeypatch, capsys):
    """It is `python3 -m dolfinx_contact` with the same command line."""
    project = tomllib.loads((TREE / "pyproject.toml").read_text())["project"]
    module, _, function = project["scripts"]["dolfinx_contact"].partition(":")
    command = getattr(import_module(module), function)
    monkeypatch.setattr(sys, "argv", ["dolfinx_contact", "check", "no_such_proof.npz"])
    assert command() == 2
    assert "no_such_proof.npz" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("package", "extra", "do"),
    [
        ("pandas", "records", lambda: Journal().to_pandas()),
        ("pandas", "records", lambda: Journal().special()),
        ("pandas", "records", lambda: block(n=2).solve().tables["contact"].to_pandas()),
        ("matplotlib", "pictures", lambda: draw_diagram("x.png", Journal())),
        ("gmsh", "gmsh", lambda: meshing.mesh_from_gmsh(COMM, lambda: None)),
    ],
)
def test_a_missing_package_is_named(monkeypatch, package, extra, do):
    missing(monkeypatch, package)
    match = rf"{package} is not installed: .*'signorini-coulomb\[{extra}\]'"
    with pytest.raises(ModuleNotFoundError, match=match):
        do()


def test_plots_name_the_missing_matplotlib(monkeypatch):
    """One rank draws, and all ranks raise the error about the missing library."""
    missing(monkeypatch, "matplotlib")
    u = block(n=2).u
    problem = type("Problem", (), {"V": u.function_space})
    system = type("System", (), {"problem": problem, "comm": COMM})
    with pytest.raises(ModuleNotFoundError, match="matplotlib is not installed"):
        picture_of_states("x.png", system, [None])


@pytest.mark.parametrize("output", ["out put", 'it\'s "here"'])
def test_demo_works_in_a_folder_with_blanks(tmp_path, output):
    """Also in a checkout whose path has blanks."""
    tree = tmp_path / "a check out"
    (tree / "docker").mkdir(parents=True)
    shutil.copy(TREE / "Makefile", tree)
    run = tree / "docker" / "run"
    run.write_text('#!/bin/sh\nfor word in "$@"; do echo "<$word>"; done\n')
    run.chmod(0o755)
    done = subprocess.run(
        ["make", "--no-print-directory", "-s", "demo", f"OUTPUT={output}"],
        cwd=tree,
        capture_output=True,
        text=True,
        check=True,
    )
    words = done.stdout.splitlines()
    assert f"<{output}/linear_triangle>" in words
    assert f"<{output}/dragged_body>" in words


def test_recipes_have_the_version_and_what_is_required():
    """`packaging/`: conda, Spack, Debian; `make packages` builds and tries the last."""
    version = re.escape(dolfinx_contact.__version__)
    assert re.search(rf'^  version: "{version}"$', read("packaging/conda/recipe.yaml"), re.M)
    spack = read("packaging/spack/py_signorini_coulomb/package.py")
    assert re.search(rf'^    version\("{version}"', spack, re.M)
    assert re.match(rf"signorini-coulomb \({version}-1\)", read("packaging/debian/changelog"))
    assert re.search(rf"^version: {version}$", read("CITATION.cff"), re.M)
    assert re.search(rf"version = {{{version}}}", read("docs/citing.md"))
    project = tomllib.loads(read("pyproject.toml"))["project"]
    least = project["requires-python"].removeprefix(">=")
    assert f'python_min: "{least}"' in read("packaging/conda/recipe.yaml")
    assert f"python@{least}:" in spack
    wheel = project["optional-dependencies"]["solver"][0]
    assert "fenics-dolfinx >=0.9,<0.12" in read("packaging/conda/recipe.yaml")
    assert "py-fenics-dolfinx@0.9:0.11" in spack
    assert "<0.12" in wheel
    for name in project["dependencies"]:
        assert f"    - {name}\n" in read("packaging/conda/recipe.yaml")
        assert f'"py-{name}"' in spack


def read(path):
    return (TREE / path).read_text()
