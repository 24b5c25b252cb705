"""The verified numbers of the demos, and the table of them in the documentation."""

import csv

import pytest
from support.demo_numbers import NUMBERS, ROOT, TABLE, run

#: Demos that take a few seconds; the others run with --long.
QUICK = ("block", "hild_triangle", "friction_parameter", "critical_friction", "two_cylinders")


def table():
    with TABLE.open() as file:
        return list(csv.DictReader(file))


def test_every_demo_has_a_number():
    names = {path.stem.removeprefix("demo_") for path in (ROOT / "demos").glob("*.py")}
    assert names == set(NUMBERS)
    expected = [(name, number.quantity) for name in NUMBERS for number in NUMBERS[name]]
    assert [(row["demo"], row["quantity"]) for row in table()] == expected


@pytest.mark.parametrize(
    "name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.long) for n in NUMBERS]
)
def test_demo_has_its_verified_numbers(name, tmp_path):
    names = run(name, tmp_path)
    shown = {row["quantity"]: row for row in table() if row["demo"] == name}
    for number in NUMBERS[name]:
        ours, exact, error = number.evaluated(names)
        assert error <= number.tolerance, (number.quantity, ours, exact)
        if exact:
            assert ours == pytest.approx(float(shown[number.quantity]["ours"]), rel=1e-4)
    pictures = [file for file in tmp_path.rglob("*") if file.suffix in (".png", ".gif")]
    assert pictures
