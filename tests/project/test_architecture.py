"""The layers of the package: allowed imports and public names."""

import ast
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from dolfinx_contact.points.surface import DiscreteSurface

PACKAGE = "dolfinx_contact"
ROOT = Path(__file__).parents[2] / PACKAGE
#: From the bottom up: a module imports from its own layer and the layers below. Private modules of
#: the root are tools that every layer may use.
LAYERS = [
    ("materials", "obstacles", "rigid_surfaces", "grids", "meshing"),
    ("body", "laws", "continuation"),
    ("points",),
    ("equations",),
    ("reduced",),
    ("solvers",),
    ("results",),
    ("algorithms",),
    ("proofs",),
    ("problem", "parametric"),
    ("analysis", "evolution"),
    ("io",),
    ("records",),
    ("explorer",),
    ("plot",),
    ("__main__",),
]
#: Imports from a higher layer in functions of these modules: questions about a state, algorithms.
FROM_ABOVE = (
    f"{PACKAGE}.algorithms.classical",
    f"{PACKAGE}.analysis.body_proofs",
)
ASKING = (f"{PACKAGE}.problem", f"{PACKAGE}.parametric", f"{PACKAGE}.solvers.strategies")
#: Modules that may import the package itself, which imports none of them.
ABOVE = ("io", "records", "plot", "explorer", "__main__")
#: The trusted part of proofs: one self-contained file.
CHECKER = f"{PACKAGE}.proofs.check_proof"


def module_of(file):
    parts = file.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(f): f for f in ROOT.rglob("*.py")}
#: Parts of scipy, which loads them when they are used. They take as long as all of the package.
SCIPY = ("integrate", "linalg", "optimize", "sparse", "spatial", "special")


@cache
def imports(name):
    """Modules of the package that a module imports, under TYPE_CHECKING and in functions too."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[name].read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                found.add(full if full in MODULES else node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name in MODULES}
    return found - {name, *(FROM_ABOVE if name in ASKING else ())}


def layer(name):
    """The layer of a module; -1 for tools, None for the root of the package."""
    if name == PACKAGE:
        return None
    part = name.split(".")[1]
    if part.startswith("_") and part != "__main__":
        return -1
    return next(i for i, parts in enumerate(LAYERS) if part in parts)


def test_every_module_has_a_layer():
    assert len(MODULES) > 100
    for name in MODULES:
        layer(name)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name", sorted(n for n in MODULES if layer(n) is not None))
def test_no_module_imports_from_a_higher_layer(name):
    """No module imports from a higher layer, and tools import only tools."""
    for other in imports(name):
        if other == PACKAGE:
            assert name.split(".")[1] in ABOVE, "lower layers must not import the package"
        else:
            assert layer(other) <= layer(name), f"{name} imports {other}"


def loaded_by(statement):
    """Modules that a new process has loaded after a statement."""
    code = f"{statement}; import sys; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout.split()


def test_what_a_static_solve_does_not_need_is_not_loaded():
    """Proofs, paths and other algorithms are not loaded before using them."""
    loaded = loaded_by(f"from {PACKAGE} import ContactProblem")
    above = ("analysis", "proofs", "evolution", "io", "plot", "records")
    strategies = ("algorithms", "continuation", "reduced")
    late = [f"{PACKAGE}.{part}" for part in (*above, *strategies)]
    late += [f"scipy.{name}" for name in SCIPY]
    assert not [name for name in loaded if name.startswith(tuple(late))]


#: Extensions use public names of the core, and private modules of the root, which are tools.
EXTENSIONS = ("algorithms", "analysis", "explorer", "proofs")


def public_names(name):
    """The names that a module lists in ``__all__``."""
    for node in ast.parse(MODULES[name].read_text()).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


@pytest.mark.parametrize(
    "name", sorted(n for n in MODULES if n.split(".")[1:2] and n.split(".")[1] in EXTENSIONS)
)
def test_extensions_use_public_names(name):
    package = ".".join(name.split(".")[:2])
    classes = {"self", "cls"}
    for node in ast.walk(ast.parse(MODULES[name].read_text())):
        if isinstance(node, ast.ClassDef):
            classes.add(node.name)
        elif isinstance(node, ast.ImportFrom) and node.module in MODULES:
            if layer(node.module) == -1 or node.module.startswith(package):
                continue
            for alias in node.names:
                is_module = f"{node.module}.{alias.name}" in MODULES
                assert is_module or alias.name in public_names(node.module), alias.name
        elif isinstance(node, ast.Attribute) and re.match("_[a-z]", node.attr):
            assert ast.unparse(node.value).split(".")[0] in classes, ast.unparse(node)


def test_imports_have_no_cycle():
    left = {name: imports(name) for name in MODULES}
    while True:
        free = [name for name, needs in left.items() if not needs & set(left)]
        if not free:
            break
        for name in free:
            del left[name]
    assert not left, f"these import one another: {sorted(left)}"


def test_public_classes_have_names_of_their_own():
    known = {}
    for name, file in MODULES.items():
        for node in ast.parse(file.read_text()).body:
            alias = isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation) == "TypeAlias"
            if not (alias or isinstance(node, ast.ClassDef)):
                continue
            word = node.target.id if alias else node.name
            if not word.startswith("_"):
                known.setdefault(word, []).append(name)
    assert len(known) > 200
    assert not {k: v for k, v in known.items() if len(v) > 1}


def test_continuation_imports_neither_ufl_nor_dolfinx():
    """Importing it loads neither UFL nor DOLFINx."""
    loaded = loaded_by(f"import {PACKAGE}.continuation")
    assert "petsc4py.PETSc" in loaded
    assert not {"ufl", "dolfinx", "basix", "ffcx"} & set(loaded)


def test_the_checker_stands_alone():
    """It imports the standard library and numpy only."""
    found = set()
    for node in ast.walk(ast.parse(MODULES[CHECKER].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found.add(node.module.split(".")[0])
    assert "numpy" in found
    assert found <= {"numpy", *sys.stdlib_module_names}


TESTS = Path(__file__).parents[1]
#: Tests that need private names, and why.
PRIVATE = {
    "project/test_packaging.py": "the import of the package fails before there are public names",
}


def trees():
    """Files of the tests, below their folder, as syntax trees."""
    for path in sorted(TESTS.rglob("*.py")):
        yield path.relative_to(TESTS).as_posix(), ast.parse(path.read_text())


def test_tests_of_several_ranks_are_marked():
    """A test needing several ranks is marked `ranks`, or is in a file of which all are.

    Tests without the mark run on one rank alone and need no other.
    """
    several = r"^((?:@.*\n)*@pytest\.mark\.skipif\(COMM\.size == 1,.*\n(?:@.*\n)*)def test_"
    for path in TESTS.rglob("test_*.py"):
        text = path.read_text()
        assert not re.search(r"skipif\([\w.]*size > 1", text), path.stem
        marked = re.search(r"^pytestmark = \[?\s*pytest\.mark\.ranks\(", text, flags=re.MULTILINE)
        for decorators in re.findall(several, text, flags=re.MULTILINE):
            assert marked or "mark.ranks(" in decorators, path.stem


def test_modules_of_tests_do_not_import_each_other():
    """Shared helpers are in `tests/support`."""
    for file, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module, *(alias.name for alias in node.names)]
            else:
                continue
            found = [n for n in names if n.rpartition(".")[2].startswith("test_")]
            assert not found, f"{file} imports {found}"


def test_tests_use_public_names():
    """Modules whose names begin with an underscore are private, and so are names that do."""
    for file, tree in trees():
        if file in PRIVATE:
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
                parts = [*node.module.split("."), *(alias.name for alias in node.names)]
                private = [p for p in parts if p.startswith("_") and p != "__main__"]
                assert not private, f"{file} imports {private}"


def test_names_of_tests_are_unique():
    names = [
        node.name
        for file, tree in trees()
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ]
    assert not [name for name, number in Counter(names).items() if number > 1]


def test_page_on_the_architecture_names_existing_files():
    text = (ROOT.parent / "docs" / "architecture.md").read_text()
    named = re.findall(r"`([a-z_]+(?:/[a-z_]*)*(?:\.py)?)`", text)
    paths = {name for name in named if "/" in name or name.endswith(".py")}
    missing = [p for p in paths if not ((ROOT / p).exists() or (ROOT.parent / p).exists())]
    assert not missing
    folders = {p.name for p in ROOT.iterdir() if (p / "__init__.py").exists()}
    assert not [folder for folder in folders if f"`{folder}/`" not in text]


def test_private_members_of_surfaces_are_used_by_points_alone():
    """Members that other layers need have no underscore (`ReadOnly._listed` hides it)."""
    for name, file in MODULES.items():
        if not name.startswith(f"{PACKAGE}.points"):
            found = re.findall(r"\b(?:s|surface|pair)\._[a-z]\w*", file.read_text())
            assert not [word for word in found if hasattr(DiscreteSurface, word.split(".")[1])]
