# SPDX-License-Identifier: LGPL-3.0-or-later
"""The verification page, generated from marks on the tests without running them.

A mark names the verified features and the reference of a test::

    @pytest.mark.verifies(
        "bodies of revolution",
        reference="closed form: Lame's pressure of a press fit",
        aspects=("2D", "pairs"),
    )

The word before the colon is a kind of reference (`REFERENCES`). A test of a combination that the
package rejects has the mark ``@pytest.mark.refuses("rigid bodies", aspects=("multigrid",))``. The
page quotes the assertions of a test, which contain its tolerances: those with the text
``figure="table.pressure"`` if the mark gives one, otherwise the first ones. A test counts under
"ranks" if it or its file has the mark ``pytest.mark.ranks``, which selects it in
`tests/conftest.py`; ``alone=True`` excludes tests in which every rank computes the same. The table
of verified numbers is `tests/data/verified.csv`.
"""

from __future__ import annotations

import ast
import csv
import itertools
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # tests read marks where there is no Sphinx
    from sphinx.application import Sphinx

#: Features of the package by chapter.
FEATURES = {
    "Laws": (
        *("Signorini", "Tresca", "Coulomb", "nonlocal friction", "orthotropic friction"),
        *("friction of the slip", "friction of speed and time", "several laws at once"),
        *("RCCM adhesion", "bilinear cohesion", "Maxwell layer"),
    ),
    "Laws of your own": ("interfaces of one's own", "laws of one's own"),
    "Regularised friction and penalties": ("normal compliance", "regularised friction"),
    "Obstacles": (
        *("planes", "spheres", "cylinders", "level sets", "moving obstacles"),
        "surfaces of facets",
    ),
    "Rigid bodies": ("rigid bodies",),
    "Pairs of bodies": (
        *("matching meshes", "mortar", "points in common", "sliding pairs", "self contact"),
    ),
    "Cracks": ("press fits", "cracks", "cracks that cross"),
    "Bulk": (
        "hyperelastic bodies",
        "nearly incompressible bodies",
        "anisotropic bodies",
        "bulk with kinks",
    ),
    "Bodies of revolution": ("bodies of revolution",),
    "Discretisations": ("nodal contact", "integral contact", "mixed contact"),
    "Checked results": ("balance of forces", "misfit and det F"),
    "Histories": ("quasi-static", "jumps", "energies of histories"),
    "Paths by arc length": ("arc length paths",),
    "Motion and impact": ("NSCD motion", "restitution", "energies of motions"),
    "Branches": ("branches", "pivoting", "friction as parameter"),
    "All solutions": (
        *("all solutions", "rays out of a kink", "certificates", "charts", "curves of folds"),
    ),
    "Uniqueness and critical friction": (
        *("critical friction", "uniqueness", "Renard's criterion"),
        *("shakedown", "steady sliding", "stability at rest"),
    ),
    "Records": (
        *("records of branches", "records of histories", "records of motions"),
        *("records of paths", "checkpoints", "observers", "stops"),
    ),
    "Pages": ("explorer",),
    "Pictures, films": ("pictures", "stresses", "files for ParaView"),
    "Large problems": ("multigrid", "Krylov branches"),
    "Classical algorithms": (
        *("Tresca's fixed point", "Uzawa", "penalty", "SOR", "Gauss-Seidel"),
        *("projected gradient", "Lemke", "interior point", "point problems in files"),
    ),
    "Newton's method": ("Newton's method", "loads in increments", "units", "options"),
}
#: Conditions under which a feature is tested; `RANKS` comes from the mark `ranks`.
RANKS = "ranks"
ASPECTS = (
    *("2D", "3D", "pairs", "large sliding", RANKS, "multigrid", "branches", "proofs", "records"),
)
#: Kinds of references, and whether they are independent of this package.
REFERENCES = {
    "closed form": True,
    "paper": True,
    "independent code": True,
    "enumeration": True,
    "theorem": True,
    "differences": False,
    "itself": False,
}
#: Largest number of quoted lines of a test.
MOST_LINES = 8


class MarkError(ValueError):
    """Invalid mark, with its file and line."""


@dataclass(frozen=True)
class Test:
    """A marked test.

    Attributes:
        file: path of its file below tests/.
        name: name of the test function.
        purpose: first line of its docstring, or its name in words.
        features: verified features, names from `FEATURES`.
        aspects: conditions of the test, names from `ASPECTS`.
        refuses: whether the test expects a ValueError.
        kind: kind of reference, a key of `REFERENCES`; empty if ``refuses``.
        reference: description of the reference.
        comparisons: quoted assertions.
        cases: values of parametrised tolerances in the assertions.
    """

    file: str
    name: str
    purpose: str
    features: tuple[str, ...]
    aspects: tuple[str, ...]
    refuses: bool
    kind: str
    reference: str
    comparisons: tuple[str, ...]
    cases: tuple[str, ...]

    @property
    def independent(self) -> bool:
        """Whether the reference does not come from this package."""
        return REFERENCES.get(self.kind, False)

    @property
    def id(self) -> str:
        """Identifier in the form of pytest."""
        return f"tests/{self.file}::{self.name}"


@dataclass(frozen=True)
class Cell:
    """Numbers of tests of a feature under one condition."""

    works: int = 0
    refused: int = 0

    def __str__(self) -> str:
        words = [f"works ({self.works})"] if self.works else []
        words += [f"refused ({self.refused})"] if self.refused else []
        return ", ".join(words) or "not yet"


@cache
def _parsed(text: str) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(text)


@cache
def _names(function: ast.FunctionDef) -> frozenset[str]:
    """Return the names used in a function, including its callees."""
    return frozenset(node.id for node in ast.walk(function) if isinstance(node, ast.Name))


class Module:
    """File of tests: its functions, and the functions that they call in the files of tests."""

    def __init__(self, file: str, texts: Mapping[str, str]):
        self.file = file
        self.text = texts[file]
        self._lines = self.text.splitlines()
        self._texts = texts
        self.tree = _parsed(self.text)
        self.functions = {
            node.name: node for node in self.tree.body if isinstance(node, ast.FunctionDef)
        }

    @cached_property
    def values(self) -> dict[str, ast.expr]:
        """Assigned expressions of the module by name."""
        return {
            node.targets[0].id: node.value
            for node in self.tree.body
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
        }

    @cached_property
    def imported(self) -> dict[str, tuple[Module, str]]:
        """Functions imported from other files of tests, by local name."""
        found = {}
        for node in self.tree.body:
            if not isinstance(node, ast.ImportFrom):
                continue
            name = f"{node.module}".replace(".", "/") + ".py"
            for file in self._texts:
                if f"/{file}".endswith(f"/{name}"):
                    other = Module(file, self._texts)
                    found |= {a.asname or a.name: (other, a.name) for a in node.names}
        return found

    def reached(self, function: ast.FunctionDef) -> list[tuple[Module, ast.FunctionDef]]:
        """Return a function and all functions that it calls, directly or not."""
        found: list[tuple[Module, ast.FunctionDef]] = [(self, function)]
        names = {(self.file, function.name)}
        for module, caller in found:
            for word in sorted(_names(caller)):
                there, name = module.imported.get(word, (module, word))
                if name in there.functions and (there.file, name) not in names:
                    names.add((there.file, name))
                    found.append((there, there.functions[name]))
        return found

    def source(self, node: ast.stmt) -> str:
        """Return the lines of a statement without indentation."""
        return textwrap.dedent("\n".join(self._lines[node.lineno - 1 : node.end_lineno]))


def _compares(node: ast.stmt) -> bool:
    """Return whether a statement is an assertion of Python or numpy."""
    if isinstance(node, ast.Assert):
        return True
    call = node.value if isinstance(node, ast.Expr) else None
    return isinstance(call, ast.Call) and ".assert_" in ast.unparse(call.func)


def _has_tolerance(source: str) -> bool:
    """Return whether an assertion contains a tolerance or a bound."""
    return bool(re.search(r"approx\(|allclose\(|[<>]", source))


@cache
def _asserted(function: ast.FunctionDef) -> tuple[ast.stmt, ...]:
    """Return all assertions of a function in order."""

    def below(node: ast.AST) -> Iterator[ast.stmt]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.stmt):
                if _compares(child):
                    yield child
                yield from below(child)
            elif isinstance(child, ast.excepthandler | ast.match_case):
                yield from below(child)

    return tuple(below(function))


def _comparisons(module: Module, function: ast.FunctionDef, figure: str) -> tuple[str, ...]:
    """Return the quoted assertions of a test.

    If ``figure`` is given, these are the assertions that contain it. Otherwise assertions with a
    tolerance come first, those of the test before those of its helpers, up to `MOST_LINES`.
    """
    sources = [
        there.source(node)
        for there, reached in module.reached(function)
        for node in _asserted(reached)
    ]
    if figure:
        return tuple(source for source in sources if figure in source)
    sources.sort(key=lambda source: not _has_tolerance(source))
    shown: list[str] = []
    for source in sources:
        if shown and "\n".join((*shown, source)).count("\n") >= MOST_LINES:
            break
        shown.append(source)
    return tuple(shown)


def _cases(function: ast.FunctionDef, comparisons: tuple[str, ...]) -> tuple[str, ...]:
    """Return names and values of parametrised tolerances in the quoted assertions."""
    words = set(re.findall(r"\w+", " ".join(comparisons)))
    found: dict[str, list[str]] = {}
    for call in function.decorator_list:
        if not (isinstance(call, ast.Call) and ast.unparse(call.func).endswith(".parametrize")):
            continue
        try:
            names = ast.literal_eval(call.args[0])
            cases = ast.literal_eval(call.args[1])
        except ValueError:  # cases that are computed
            continue
        names = (names,) if isinstance(names, str) else names
        for case in cases:
            values = (case,) if len(names) == 1 else case
            for name, value in zip(names, values, strict=True):
                if name in words and isinstance(value, float):
                    found.setdefault(name, []).append(f"{value:g}")
    return tuple(f"{name}: {', '.join(dict.fromkeys(v))}" for name, v in found.items())


def _raises(module: Module, function: ast.FunctionDef) -> bool:
    """Return whether a test expects a ValueError."""
    return any(
        isinstance(node, ast.Call)
        and ast.unparse(node.func) == "pytest.raises"
        and "ValueError" in ast.unparse(node.args[0])
        for _, reached in module.reached(function)
        for node in ast.walk(reached)
    )


def _on_ranks(module: Module, function: ast.FunctionDef) -> bool:
    """Return whether a test also runs on two ranks without the option --long.

    The test, one of its cases or its file has the mark `ranks`, and the test is not marked `long`
    or `chatty`.
    """
    marks = list(function.decorator_list)
    if "pytestmark" in module.values:
        marks.append(module.values["pytestmark"])
    marks = [module.values.get(m.id, m) if isinstance(m, ast.Name) else m for m in marks]
    for mark in marks:
        text = ast.unparse(mark)
        if re.fullmatch(r"pytest\.mark\.(chatty|long)", text):
            return False
    return any("pytest.mark.ranks(" in ast.unparse(mark) for mark in marks)


def _mark(module: Module, function: ast.FunctionDef, call: ast.Call) -> Test:
    """Return the test that carries a mark."""

    def wrong(reason: str) -> MarkError:
        return MarkError(f"tests/{module.file}:{call.lineno}: {function.name}: {reason}")

    try:
        features = tuple(ast.literal_eval(a) for a in call.args)
        given = {str(k.arg): ast.literal_eval(k.value) for k in call.keywords}
    except ValueError:
        raise wrong("marks are read without being run: only constants") from None
    refuses = ast.unparse(call.func).endswith(".refuses")
    aspects = given.pop("aspects", ())
    kind, _, reference = given.pop("reference", "").partition(": ")
    figure = given.pop("figure", "")
    alone = given.pop("alone", False)
    known = set(itertools.chain(*FEATURES.values()))
    if given:
        raise wrong(f"a mark has no {', '.join(given)}")
    if not features or not set(features) <= known:
        raise wrong(f"no such feature: {', '.join(sorted(set(features) - known)) or 'none'}")
    if not isinstance(aspects, tuple) or not set(aspects) <= set(ASPECTS):
        raise wrong(f"aspects are a tuple of {', '.join(ASPECTS)}, got {aspects!r}")
    comparisons: tuple[str, ...] = ()
    if refuses:
        if kind or figure:
            raise wrong("a mark `refuses` has no reference and no figure")
        if not aspects:
            raise wrong("a mark `refuses` needs aspects")
        if not _raises(module, function):
            raise wrong("no ValueError is expected")
    else:
        if kind not in REFERENCES or not reference:
            raise wrong(f"a reference begins with one of {', '.join(REFERENCES)} and a colon")
        if RANKS in aspects:
            raise wrong("whether it runs on several ranks is the mark `ranks`")
        comparisons = _comparisons(module, function, figure)
        if not comparisons:
            raise wrong(f"nothing is compared {f'with {figure!r} in it' if figure else ''}".strip())
        if not alone and _on_ranks(module, function):
            aspects = (*aspects, RANKS)
        if not (aspects or REFERENCES[kind]):
            raise wrong("it changes no cell: aspects, or an independent reference")
    document = ast.get_docstring(function) or function.name.removeprefix("test_").replace("_", " ")
    purpose = " ".join(document.split("\n\n")[0].split())
    return Test(
        file=module.file,
        name=function.name,
        purpose=purpose[0].upper() + purpose[1:],
        features=features,
        aspects=tuple(a for a in ASPECTS if a in aspects),
        refuses=refuses,
        kind=kind,
        reference=reference,
        comparisons=comparisons,
        cases=_cases(function, comparisons),
    )


def marked_tests(texts: Mapping[str, str]) -> list[Test]:
    """Return all marked tests.

    Args:
        texts: contents of the files in the folder of tests, by path.

    Raises:
        MarkError: if a mark has an unknown feature, aspect or kind of reference, if its test
            contains no assertion, or if the mark contradicts the test.
    """
    return [test for file in sorted(texts) for test in marks_in(file, texts)]


def marks_in(file: str, texts: Mapping[str, str]) -> list[Test]:
    """Return the marked tests of one file; their helpers may be in other files."""
    if not re.search(r"pytest\.mark\.(verifies|refuses)\(", texts[file]):
        return []
    module = Module(file, texts)
    return [
        _mark(module, function, call)
        for function in module.functions.values()
        for call in function.decorator_list
        if isinstance(call, ast.Call)
        and re.fullmatch(r"pytest\.mark\.(verifies|refuses)", ast.unparse(call.func))
    ]


def read_tests(folder: Path) -> dict[str, str]:
    """Return the contents of the files in a folder of tests by path."""
    files = folder.rglob("*.py")
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files}


def matrix(tests: list[Test]) -> dict[str, dict[str, Cell]]:
    """Return the matrix of features and conditions.

    Returns:
        For each feature a cell for each of `ASPECTS`, and under "reference" a cell with the number
        of tests against independent references.
    """
    rows: dict[str, dict[str, Cell]] = {}
    for feature in itertools.chain(*FEATURES.values()):
        of_it = [t for t in tests if feature in t.features]
        rows[feature] = {"reference": Cell(sum(t.independent for t in of_it))}
        for aspect in ASPECTS:
            with_it = [t for t in of_it if aspect in t.aspects]
            refused = sum(t.refuses for t in with_it)
            rows[feature][aspect] = Cell(len(with_it) - refused, refused)
    return rows


def _place(feature: str) -> str:
    """Return the anchor of a feature on the page."""
    return "verified-" + re.sub(r"\W+", "-", feature.lower())


def matrix_page(tests: list[Test]) -> str:
    """Return the matrix as MyST."""
    lines = [
        f"| feature | independent reference | {' | '.join(ASPECTS)} |",
        "|---" * (len(ASPECTS) + 2) + "|",
    ]
    for feature, cells in matrix(tests).items():
        alone = cells["reference"].works
        row = [f"yes ({alone})" if alone else "not yet", *(str(cells[a]) for a in ASPECTS)]
        lines.append(f"| [{feature}](#{_place(feature)}) | {' | '.join(row)} |")
    return "\n".join(lines)


def _entry(test: Test) -> list[str]:
    """Return the entry of a test as lines of a definition list."""
    against = "Refused" if test.refuses else f"*{test.kind.capitalize()}*: {test.reference}"
    aspects = f" ({', '.join(test.aspects)})" if test.aspects else ""
    purpose = re.sub(r"([\\*_$|<>\[\]^#])", r"\\\1", test.purpose)
    lines = [purpose, f": {against}{aspects}. `{test.id}`"]
    if test.comparisons:
        lines += ["", "  ```python"]
        lines += [f"  {line}".rstrip() for c in test.comparisons for line in c.splitlines()]
        lines += ["  ```"]
    if test.cases:
        lines += ["", f"  Cases: {'; '.join(test.cases)}."]
    return [*lines, ""]


def benchmarks_page(tests: list[Test]) -> str:
    """Return all marked tests as MyST: a folded block per chapter, tests at their first feature."""
    lines = []
    written: set[str] = set()
    for chapter, features in FEATURES.items():
        lines += [f"::::{{dropdown}} {chapter}", ""]
        for feature in features:
            lines += [f"({_place(feature)})=", f"**{feature[0].upper()}{feature[1:]}**", ""]
            of_it = [t for t in tests if feature in t.features]
            first = [t for t in of_it if t.features[0] == feature and t.id not in written]
            written |= {t.id for t in first}
            lines += [line for test in first for line in _entry(test)]
            here = {t.id for t in first}
            other = dict.fromkeys(t.id for t in of_it if t.id not in here)
            if other:
                lines += [f"{'Also' if first else 'By'} {', '.join(f'`{i}`' for i in other)}.", ""]
            if not of_it:
                lines += ["Not yet.", ""]
        lines += ["::::", ""]
    return "\n".join(lines)


def numbers(tests: list[Test]) -> str:
    """Return the numbers of tests as text."""
    shown = [t for t in tests if not t.refuses]
    alone = sum(t.independent for t in shown)
    without = [f for f, cells in matrix(tests).items() if not cells["reference"].works]
    words = (
        f"{len(shown)} marks verify features, {alone} of them against independent references; "
        f"{len(tests) - len(shown)} verify that a combination is rejected."
    )
    if without:
        words += f" Features without an independent reference: {', '.join(without)}."
    return words


def verified_page(text: str) -> str:
    """Return the table of verified numbers as MyST.

    Args:
        text: contents of tests/data/verified.csv, which a test compares with the demos.
    """
    head = ("quantity", "reference", "exact", "ours", "error", "demo")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for row in csv.DictReader(text.splitlines()):
        demo = f"{{doc}}`{row['demo']} </demos/demo_{row['demo']}>`"
        cells = [row[name] for name in head[:-1]]
        lines.append(f"| {' | '.join([*cells, demo])} |")
    return "\n".join(lines)


def orders_page(text: str) -> str:
    """Return the orders of convergence as MyST.

    Args:
        text: contents of tests/data/orders.csv, which a test compares with measured orders.
    """
    head = "name", "feature", "problem", "fine", "error of", "theory", "measured", "last error"
    titles = *head[:3], "cells or steps", *head[4:]
    lines = [f"| {' | '.join(titles)} |", "|---" * len(head) + "|"]
    lines += [
        f"| {' | '.join(row[k] for k in head)} |" for row in csv.DictReader(text.splitlines())
    ]
    return "\n".join(lines)


def reasons_page(text: str) -> str:
    """Return the features without an order of convergence, with the reason, as MyST.

    Args:
        text: contents of tests/data/without_orders.csv.
    """
    lines = ["| features | reason |", "|---|---|"]
    for row in csv.DictReader(text.splitlines()):
        lines.append(f"| {row['features'].replace(';', ',')} | {row['reason']} |")
    return "\n".join(lines)


def fill_page(app: Sphinx, name: str, source: list[str]) -> None:
    """Replace the comments of the page by the generated parts."""
    if name != "verification":
        return
    folder = Path(app.srcdir).parent / "tests"
    tests = marked_tests(read_tests(folder))
    for word, text in (
        ("verified", verified_page((folder / "data" / "verified.csv").read_text())),
        ("numbers", numbers(tests)),
        ("matrix", matrix_page(tests)),
        ("orders", orders_page((folder / "data" / "orders.csv").read_text())),
        ("reasons", reasons_page((folder / "data" / "without_orders.csv").read_text())),
        ("benchmarks", benchmarks_page(tests)),
    ):
        source[0] = re.sub(rf"^% {word}$", lambda _, text=text: text, source[0], flags=re.MULTILINE)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the handler with Sphinx."""
    app.connect("source-read", fill_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
