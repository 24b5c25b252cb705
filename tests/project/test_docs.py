"""The site: its recipes, tutorials and theory run, and every page can be found and read."""

import ast
import csv
import json
import re
import runpy
import sys
import types
from pathlib import Path

import matplotlib.image
import pytest

DOCS = Path(__file__).parents[2] / "docs"
RECIPES = sorted((DOCS / "recipes").glob("[0-9]*.py"))
TUTORIALS = sorted((DOCS / "tutorials").glob("[0-9]*.py"))
DEMOS = sorted((DOCS.parent / "demos").glob("demo_*.py"))
THEORY = sorted((DOCS / "theory").glob("*.md"))
TOUR = DOCS / "guided_tour.md"
#: Scripts of which each spends seconds on pictures, or on the derivatives of a law.
LONG = (
    *("22_pdf_figure", "23_film", "26_rolling", "35_friction_as_parameter", "38_scaling"),
    *("1_frictional_solve", "2_two_bodies_and_a_crack", "5_motion_and_impact", "6_law_of_your_own"),
)
#: Lines of code of a recipe, without imports and what is empty.
MOST_LINES = 15


def name_of(script):
    return getattr(script, "stem", None)


def scripts(found):
    """Cases of a test, of which some take long."""
    return [pytest.param(s, marks=pytest.mark.long) if s.stem in LONG else s for s in found]


def run(script, tmp_path, monkeypatch):
    """Run a script in a folder of its own; its assertions are the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(script.parent))
    monkeypatch.setattr(sys, "argv", [str(script)])
    return runpy.run_path(str(script))


@pytest.mark.parametrize("recipe", scripts(RECIPES), ids=name_of)
def test_recipe_runs(recipe, tmp_path, monkeypatch, capsys):
    run(recipe, tmp_path, monkeypatch)
    pictures = [f for f in tmp_path.rglob("*") if f.suffix in (".png", ".gif")]
    assert capsys.readouterr().out or pictures  # the page has something to show


@pytest.mark.parametrize("tutorial", scripts(TUTORIALS), ids=name_of)
def test_tutorial_runs(tutorial, tmp_path, monkeypatch):
    run(tutorial, tmp_path, monkeypatch)
    assert any(f.suffix == ".png" for f in tmp_path.rglob("*"))


def code_of(page):
    """The code of a page in Markdown, from its first block to its last."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return "\n".join(blocks)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("page", [p for p in [*THEORY, TOUR] if code_of(p)], ids=name_of)
def test_formulas_of_theory_pages_hold(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(DOCS / "recipes"))
    code = code_of(page)
    assert re.search(r"^\s*assert ", code, flags=re.MULTILINE)
    exec(compile(code, page.name, "exec"), {"__name__": page.stem})


def code_lines(script):
    """Lines of code without imports, classes that the reader defines, comments and empty lines."""
    text = script.read_text()
    left_out = set()
    for node in ast.parse(text).body:
        if isinstance(node, ast.Import | ast.ImportFrom | ast.ClassDef):
            left_out |= set(range(node.lineno, node.end_lineno + 1))
    return [
        line
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#") and number not in left_out
    ]


@pytest.mark.parametrize("recipe", RECIPES, ids=name_of)
def test_a_recipe_is_short_and_answers_a_question(recipe):
    text = recipe.read_text()
    title = re.search(r"^# # (.*)$", text, flags=re.MULTILINE)[1]
    assert title.endswith("?")
    assert len(code_lines(recipe)) <= MOST_LINES
    assert re.search(r"^\s*assert ", text, flags=re.MULTILINE)


def test_recipes_are_numbered():
    assert [path.stem[:2] for path in RECIPES] == [f"{i:02}" for i in range(1, 46)]


def test_every_script_is_on_a_page():
    """Recipes, tutorials, demos and theory are in the tables of contents leading to them."""
    recipes = (DOCS / "recipes" / "index.md").read_text().split()
    assert {path.stem for path in RECIPES} <= set(recipes)
    tutorials = (DOCS / "tutorials" / "index.md").read_text().split()
    assert {path.stem for path in TUTORIALS} <= set(tutorials)
    demos = (DOCS / "demos.md").read_text().split()
    assert {f"demos/{path.stem}" for path in DEMOS} <= set(demos)
    theory = (DOCS / "theory" / "index.md").read_text().split()
    assert {page.stem for page in THEORY} - {"index"} <= set(theory)


def test_every_recipe_is_asked_for():
    """The questions use other words than titles; `make docs-questions` searches the site."""
    with (DOCS / "questions.csv").open() as file:
        asked = {row["question"]: row["page"] for row in csv.DictReader(file)}
    assert len(asked) >= 40
    for path in RECIPES:
        questions = [q for q, page in asked.items() if page == f"recipes/{path.stem}"]
        title = re.search(r"^# # (.*)$", path.read_text(), flags=re.MULTILINE)[1]
        assert questions
        assert not any(q.lower() in title.lower() for q in questions), title
    for page in asked.values():
        assert any(DOCS.joinpath(f"{page}{suffix}").exists() for suffix in (".md", ".py")), page


def test_the_guided_tour_names_files_that_exist():
    package = DOCS.parent / "dolfinx_contact"
    heads = re.findall(r"^(`[^`]+\.py`(?:, `[^`]+\.py`)*)$", TOUR.read_text(), flags=re.MULTILINE)
    files = [name for head in heads for name in re.findall(r"`([^`]+)`", head)]
    assert len(files) > 25
    assert [name for name in files if not (package / name).exists()] == []


PACKAGE = Path(__file__).parents[2] / "dolfinx_contact"

#: What was written, and a plain word for it.
PRIVATE = {
    r"\bsaid\b": "documented, reported, given",
    r"\btold\b": "distinguished, reported, identified",
    r"\bgone\b": "moved, vanished, followed",
    r"\bstood\b": "was, unchanged",
    r"\bstands\b": "is, occurs, represents",
    r"\bkeeper\b": "the class that keeps it",
    r"\bcom(e|es|ing) by\b": "reach, obtain",
    r"\b(go|goes|going) on\b": "continue",
    r"\b(let|lets|letting) go\b": "release, detach",
    r"\bwants?\b": "requires, needs",
    r"\btaken for\b": "counts as, confused with",
    r"\blook(s|ed|ing)? at\b": "examine, check, depend on",
    r"\bask(s|ed)? (for|of)\b": "require, determine, request",
    r"\bways on\b|\bway on\b": "direction to continue",
    r"\bwhat (is|was|lies|lay) opposite\b": "the point opposite, the opposing body",
}


def docstrings(text):
    """Docstrings of a module, its classes and functions, by the line where they begin."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, kinds) and ast.get_docstring(node, clean=False):
            yield node.body[0].lineno, ast.get_docstring(node)


def private_words(text):
    """Return lines of docstrings with private words, these words, and their replacements."""
    found = []
    for line, doc in docstrings(text):
        prose = " ".join(re.sub(r"``.*?``|`[^`]*`", "", doc).split())
        for pattern, plain in PRIVATE.items():
            found += [(line, hit.group(), plain) for hit in re.finditer(pattern, prose)]
    return found


def test_docstrings_of_the_package_are_plain():
    found = [
        f"{path.relative_to(PACKAGE)}:{line}: {word!r}; rather: {plain}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for line, word, plain in private_words(path.read_text())
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("sentence", "words"),
    [
        ("Where a run goes\n    on from.", ["goes on"]),
        ("What is said of it, and told.", ["said", "told"]),
        ("The piece that (x, gamma) determines; see ``what is said``.", []),
    ],
)
def test_private_words_are_found(sentence, words):
    text = f'def f():\n    """{sentence}"""\n'
    assert [word for _, word, _ in private_words(text)] == words


README = Path(__file__).parents[2] / "README.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


@pytest.mark.ranks(2)
def test_readme_example_runs(folder, monkeypatch):
    monkeypatch.chdir(folder)
    names: dict = {}
    exec(EXAMPLES[0], names)
    result = names["problem"].solve()
    assert result.kkt_violation < 1e-8
    assert min(result.counts[k] for k in ("stick", "slip")) > 0
    force = result.resultants["floor"]
    assert force[2] > 0
    assert force[0] < 0  # dragged to the right, held back to the left
    assert any((folder / "output/block").iterdir())


@pytest.mark.ranks(2)
def test_landing_page_example_has_three_proved_solutions(capsys):
    page = (README.parent / "docs" / "index.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    names: dict = {}
    exec(code, names)
    solutions = names["solutions"]
    assert solutions.complete
    assert "3 solutions at gamma = 1; proved to be all there are: " in capsys.readouterr().out
    # The corner is off the floor, sticks to it, or slips to the left.
    letters = [names["system"].letters(solution.piece) for solution in solutions.found]
    assert {word[0] for word in letters} == {"o", "k", "-"}
    assert {word[1:] for word in letters} == {"o" * 15 + "d"}


def test_readme_shows_the_output_of_its_example(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    exec(EXAMPLES[0], {})
    (shown,) = re.findall(r"```text\n(.*?)```", README.read_text(), flags=re.DOTALL)
    exact, round_off = shown.split("violation of the law")
    assert len(re.findall(r"e-1[3-7]\b", round_off)) == 2
    assert capsys.readouterr().out.startswith(exact)


def test_readme_is_short_and_has_one_example():
    assert len(README.read_text().splitlines()) <= 150
    assert len(EXAMPLES) == 1


def places(file):
    """The headings of a page, as its links name them."""
    headings = re.findall(r"^#+ (.*)$", file.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^a-z0-9 -]", "", text.lower()).replace(" ", "-") for text in headings}


def test_links_lead_to_files():
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


NOTEBOOK = Path(__file__).parents[2] / "docs/notebooks/first_steps.ipynb"


def cells():
    return json.loads(NOTEBOOK.read_text())["cells"]


@pytest.mark.long
def test_notebook_shows_its_pictures(folder, monkeypatch):
    """The notebook solves, finds three solutions, and shows a picture and a diagram."""
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
