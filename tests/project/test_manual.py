"""The verification manual: its cells are made of marks on the tests, and unknown ones refused."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_ext"))

import verification as manual  # noqa: E402

BODY = """
    found = pressed(2)
    assert found.status == "o"
    np.testing.assert_allclose(found.pressure, 3.0, rtol=tolerance)
"""
HEAD = "from mpi4py import MPI\nimport pytest\n\n\n"
SHOWN = '@pytest.mark.verifies("mortar", reference="closed form: a pressure", aspects=("2D",))\n'
RANKS = "@pytest.mark.ranks(2)\n"


def file_of(marks, body=BODY, name="pressure"):
    """A file of one test under some marks."""
    return {"test_one.py": f"{HEAD}{marks}def test_{name}(tolerance):{body}"}


def without(text, name):
    """A file without one of its tests, and without the marks on it."""
    function = manual.Module("test.py", {"test.py": text}).functions[name]
    first = min(node.lineno for node in (function, *function.decorator_list))
    lines = text.splitlines(keepends=True)
    return "".join(lines[: first - 1] + lines[function.end_lineno :])


@pytest.fixture(scope="module")
def texts():
    return manual.read_tests(ROOT / "tests")


@pytest.fixture(scope="module")
def tests(texts):
    return manual.marked_tests(texts)


def test_there_are_marks_of_all_kinds(tests):
    assert len({t.id for t in tests}) >= 120
    assert {t.kind for t in tests if not t.refuses} == set(manual.REFERENCES)
    assert any(t.refuses for t in tests)
    seen = {aspect for t in tests for aspect in t.aspects}
    assert seen == set(manual.ASPECTS)


def test_features_occur_once():
    every = [f for features in manual.FEATURES.values() for f in features]
    assert len(set(every)) == len(every)


def test_every_feature_has_a_test(tests):
    for feature, cells in manual.matrix(tests).items():
        assert any(cell.works for cell in cells.values()), feature


def test_manual_reads_purpose_features_and_comparisons_of_a_test():
    cases = '@pytest.mark.parametrize(("n", "tolerance"), [(1, 1e-9), (2, 1e-6)])\n'
    body = f'\n    """As in print."""{BODY}'
    (test,) = manual.marked_tests(file_of(SHOWN + RANKS + cases, body))
    assert (test.id, test.purpose) == ("tests/test_one.py::test_pressure", "As in print.")
    assert (test.features, test.aspects) == (("mortar",), ("2D", "ranks"))
    assert (test.kind, test.reference) == ("closed form", "a pressure")
    assert test.independent
    assert test.comparisons == (
        "np.testing.assert_allclose(found.pressure, 3.0, rtol=tolerance)",
        'assert found.status == "o"',
    )
    assert test.cases == ("tolerance: 1e-09, 1e-06",)
    page = manual.benchmarks_page([test])
    for words in (*test.comparisons, test.id, "*Closed form*: a pressure (2D, ranks)", *test.cases):
        assert words in page


def test_manual_shows_the_named_comparison():
    figure = SHOWN.replace('aspects=("2D",)', 'figure="status"')
    (test,) = manual.marked_tests(file_of(figure))
    assert test.comparisons == ('assert found.status == "o"',)


def test_comparisons_of_helpers_count():
    """Comparisons in functions that the test calls count, in its file and in imported files."""
    helpers = {
        "blocks.py": "def check(x):\n    assert abs(x) < 1e-8\n",
        "test_one.py": f"{HEAD}from blocks import check as right\n\n\n{SHOWN}"
        "def test_pressure():\n    there()\n\n\ndef there():\n    right(3)\n",
    }
    (test,) = manual.marked_tests(helpers)
    assert test.comparisons == ("assert abs(x) < 1e-8",)


@pytest.mark.parametrize(
    "marks",
    [
        "",
        RANKS + "@pytest.mark.chatty\n",
        RANKS + "@pytest.mark.long\n",
    ],
)
def test_manual_marks_tests_on_one_rank(marks):
    (test,) = manual.marked_tests(file_of(SHOWN + marks))
    assert test.aspects == ("2D",)


@pytest.mark.parametrize(
    ("head", "marks"),
    [
        ("", RANKS),
        ("", '@pytest.mark.parametrize("n", [pytest.param(1, marks=pytest.mark.ranks(2, 3))])\n'),
        ("pytestmark = pytest.mark.ranks(2, every_case=True)\n", ""),
        ("pytestmark = [pytest.mark.ranks(2), pytest.mark.usefixtures('x')]\n", ""),
        ("shared = pytest.mark.ranks(2)\n", "@shared\n"),
    ],
)
def test_manual_marks_tests_on_two_ranks(head, marks):
    text = file_of(SHOWN + marks)["test_one.py"].replace(HEAD, HEAD + head)
    (test,) = manual.marked_tests({"test_one.py": text})
    assert test.aspects == ("2D", "ranks")


@pytest.mark.parametrize(
    ("marks", "body", "message"),
    [
        (SHOWN.replace("2D", "4D"), BODY, "aspects are a tuple of 2D, 3D, .* got .'4D'"),
        (SHOWN.replace('("2D",)', '"2D"'), BODY, "aspects are a tuple"),
        (SHOWN.replace("2D", "ranks"), BODY, "is the mark `ranks`"),
        (SHOWN.replace("mortar", "glue"), BODY, "no such feature: glue"),
        (SHOWN.replace('"mortar", ', ""), BODY, "no such feature: none"),
        (SHOWN.replace("closed form", "a friend"), BODY, "a reference begins with one of"),
        (SHOWN.replace("closed form: ", ""), BODY, "a reference begins with one of"),
        (SHOWN.replace("aspects", "aspect"), BODY, "a mark has no aspect"),
        (SHOWN.replace('"mortar"', "MORTAR"), BODY, "without being run"),
        (SHOWN.replace('aspects=("2D",)', 'figure="shear"'), BODY, "compared with 'shear' in it"),
        (SHOWN, "\n    pressed(2)\n", "nothing is compared"),
        ('@pytest.mark.verifies("mortar", reference="itself: x", alone=True)\n', BODY, "no cell"),
        ('@pytest.mark.refuses("mortar", aspects=("3D",))\n', BODY, "no ValueError is expected"),
        ('@pytest.mark.refuses("mortar")\n', BODY, "needs aspects"),
        (SHOWN.replace("verifies", "refuses"), BODY, "has no reference"),
    ],
)
def test_manual_refuses_malformed_marks(marks, body, message):
    with pytest.raises(manual.MarkError, match=rf"tests/test_one.py:5: test_pressure: .*{message}"):
        manual.marked_tests(file_of(marks, body))


def test_cells_of_the_matrix_tell_what_works():
    """Works, refused, both, or not yet."""
    refused = '@pytest.mark.refuses("mortar", aspects=("2D", "3D"))\n'
    raising = "\n    with pytest.raises(ValueError, match='no'):\n        pressed(3)\n"
    texts = file_of(SHOWN) | {"test_two.py": file_of(refused, raising)["test_one.py"]}
    row = manual.matrix(manual.marked_tests(texts))["mortar"]
    words = [str(row[aspect]) for aspect in ("2D", "3D", "pairs")]
    assert words == ["works (1), refused (1)", "refused (1)", "not yet"]
    assert row["reference"].works == 1
    line = (
        "| [mortar](#verified-mortar) | yes (1) | works (1), refused (1) | refused (1) | not yet |"
    )
    assert line in manual.matrix_page(manual.marked_tests(texts))


def test_a_test_that_is_deleted_changes_a_cell(texts, tests):
    """Every marked test does; the only one of its kind leaves "not yet" behind."""
    whole = manual.matrix(tests)
    for name in {t.id for t in tests}:
        # Cells of its features, which others do not change.
        features = {f for t in tests if t.id == name for f in t.features}
        near = [t for t in tests if features & {*t.features}]
        assert manual.matrix([t for t in near if t.id != name]) != manual.matrix(near), name
    last = {t.file: t for t in tests}
    for file, test in last.items():
        fewer = manual.marks_in(file, {**texts, file: without(texts[file], test.name)})
        assert fewer == [t for t in tests if t.file == file and t.name != test.name]
    refused = (t for t in tests if t.refuses and "bodies of revolution" in t.features)
    (only,) = (t for t in refused if "3D" in t.aspects)
    assert str(whole["bodies of revolution"]["3D"]) == "refused (1)"
    fewer = {**texts, only.file: without(texts[only.file], only.name)}
    cells = manual.matrix(manual.marked_tests(fewer))
    assert str(cells["bodies of revolution"]["3D"]) == "not yet"


def test_the_page_includes_all_parts(tests):
    """The generated part of the page names every test."""
    text = (ROOT / "docs" / "verification.md").read_text()
    assert re.findall(r"^% (\w+)$", text, flags=re.MULTILINE) == [
        *("verified", "numbers", "matrix", "orders", "reasons", "benchmarks")
    ]
    page = manual.benchmarks_page(tests)
    for test in tests:
        assert f"`{test.id}`" in page
