"""The site: its recipes, tutorials and theory run, and every page can be found and read."""

import ast
import csv
import re
import runpy
import sys
from pathlib import Path

from mpi4py import MPI

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


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="recipes write to a folder of one rank")
@pytest.mark.parametrize("recipe", scripts(RECIPES), ids=name_of)
def test_recipe(recipe, tmp_path, monkeypatch, capsys):
    run(recipe, tmp_path, monkeypatch)
    pictures = [f for f in tmp_path.rglob("*") if f.suffix in (".png", ".gif")]
    assert capsys.readouterr().out or pictures  # the page has something to show


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="tutorials write to a folder of one rank")
@pytest.mark.parametrize("tutorial", scripts(TUTORIALS), ids=name_of)
def test_tutorial(tutorial, tmp_path, monkeypatch):
    run(tutorial, tmp_path, monkeypatch)
    assert any(f.suffix == ".png" for f in tmp_path.rglob("*"))


def code_of(page):
    """The code of a page in Markdown, from its first block to its last."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return "\n".join(blocks)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("page", [p for p in [*THEORY, TOUR] if code_of(p)], ids=name_of)
def test_formulas_of_theory_pages_hold(page, tmp_path, monkeypatch):
    """The formulas that a page checks are those of the package, on any number of ranks."""
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
    assert [path.stem[:2] for path in RECIPES] == [f"{i:02}" for i in range(1, 45)]


def test_every_script_is_on_a_page():
    """Recipes, tutorials, demos and theory are in the tables of contents that lead to them."""
    recipes = (DOCS / "recipes" / "index.md").read_text().split()
    assert {path.stem for path in RECIPES} <= set(recipes)
    tutorials = (DOCS / "tutorials" / "index.md").read_text().split()
    assert {path.stem for path in TUTORIALS} <= set(tutorials)
    demos = (DOCS / "demos.md").read_text().split()
    assert {f"demos/{path.stem}" for path in DEMOS} <= set(demos)
    theory = (DOCS / "theory" / "index.md").read_text().split()
    assert {page.stem for page in THEORY} - {"index"} <= set(theory)


def test_every_recipe_is_asked_for():
    """By other words than those of its title; `make docs-questions` looks them up in the site."""
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
