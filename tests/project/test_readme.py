"""The examples of the README and of the landing page run as they stand."""

import re
from pathlib import Path

from mpi4py import MPI

import pytest

COMM = MPI.COMM_WORLD
README = Path(__file__).parents[2] / "README.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


@pytest.mark.ranks(2)
def test_readme_example(folder, monkeypatch):
    monkeypatch.chdir(folder)
    names: dict = {}
    exec(EXAMPLES[0], names)
    result = names["result"]
    assert result.kkt_violation < 1e-8
    assert min(result.counts[k] for k in ("stick", "slip")) > 0
    force = result.resultants["contact"]
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


@pytest.mark.skipif(COMM.size > 1, reason="looks at text")
def test_readme_shows_the_output_of_its_example(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    exec(EXAMPLES[0], {})
    (shown,) = re.findall(r"```text\n(.*?)```", README.read_text(), flags=re.DOTALL)
    assert capsys.readouterr().out.startswith(shown)


def test_readme_is_short_and_has_one_example():
    assert len(README.read_text().splitlines()) <= 150
    assert len(EXAMPLES) == 1


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
