"""Docstrings of the package are in plain English: words that readers stumbled over stay away."""

import ast
import re
from pathlib import Path

from mpi4py import MPI

import pytest

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
    """Lines of docstrings, the words in them that are listed, and what to write instead."""
    found = []
    for line, doc in docstrings(text):
        prose = " ".join(re.sub(r"``.*?``|`[^`]*`", "", doc).split())
        for pattern, plain in PRIVATE.items():
            found += [(line, hit.group(), plain) for hit in re.finditer(pattern, prose)]
    return found


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="reads files only")
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
