"""Orders of convergence to manufactured solutions; `manufactured.py` makes them."""

import csv
import itertools
import sys

import pytest
from support.manufactured import CASES, TABLE

SHORT = [name for name, case in CASES.items() if not case.long]
LONG = [name for name, case in CASES.items() if case.long]


def as_tabled(name):
    """Assert that orders reach the theory and agree with the table in the manual."""
    case = CASES[name]
    orders, errors = case.measured()
    with TABLE.open(newline="") as file:
        rows = {row["error of"]: row for row in csv.DictReader(file) if row["name"] == name}
    assert set(rows) == set(orders)
    for quantity, order in orders.items():
        row = rows[quantity]
        assert order > case.orders[quantity] - 0.2
        assert (row["feature"], row["problem"]) == (case.feature, case.words)
        assert (int(row["coarse"]), int(row["fine"])) == case.n
        assert float(row["theory"]) == case.orders[quantity]
        assert order == pytest.approx(float(row["measured"]), abs=0.02)
        assert errors[quantity] == pytest.approx(float(row["last error"]), rel=0.1)


@pytest.mark.parametrize("name", SHORT)
@pytest.mark.verifies(
    "Coulomb",
    "integral contact",
    "hyperelastic bodies",
    reference="closed form: manufactured solutions",
    aspects=("2D",),
    figure="order >",
)
@pytest.mark.verifies(
    "mortar",
    reference="closed form: manufactured solutions",
    aspects=(
        "2D",
        "pairs",
    ),
    figure="order >",
)
@pytest.mark.verifies(
    "mixed contact",
    reference="closed form: manufactured solutions",
    aspects=("2D",),
    figure="order >",
)
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: manufactured solutions",
    aspects=("2D", "pairs", "large sliding"),
    figure="order >",
)
@pytest.mark.verifies(
    "quasi-static",
    reference="closed form: manufactured solutions",
    aspects=("3D",),
    figure="order >",
)
def test_errors_of_manufactured_solutions_have_their_orders(name):
    """Errors of a manufactured solution fall with their order, in space or in time."""
    as_tabled(name)


@pytest.mark.long
@pytest.mark.parametrize("name", LONG)
@pytest.mark.verifies(
    "Signorini",
    "Tresca",
    "normal compliance",
    "regularised friction",
    "RCCM adhesion",
    "bilinear cohesion",
    "bodies of revolution",
    "hyperelastic bodies",
    reference="closed form: manufactured solutions",
    aspects=("2D",),
    figure="order >",
)
@pytest.mark.verifies(
    "spheres",
    "level sets",
    "moving obstacles",
    reference="closed form: manufactured solutions",
    aspects=("2D", "large sliding"),
    figure="order >",
)
@pytest.mark.verifies(
    "cylinders",
    reference="closed form: manufactured solutions",
    aspects=("3D", "large sliding"),
    figure="order >",
)
@pytest.mark.verifies(
    "sliding pairs",
    reference="closed form: manufactured solutions",
    aspects=("2D", "pairs", "large sliding"),
    figure="order >",
)
@pytest.mark.verifies(
    "Coulomb",
    "integral contact",
    reference="closed form: manufactured solutions",
    aspects=(
        "2D",
        "3D",
    ),
    figure="order >",
)
@pytest.mark.verifies(
    "NSCD motion",
    reference="closed form: manufactured solutions",
    aspects=("3D",),
    figure="order >",
)
@pytest.mark.verifies(
    "matching meshes",
    reference="closed form: manufactured solutions",
    aspects=(
        "2D",
        "pairs",
    ),
    figure="order >",
)
def test_orders_of_other_laws_and_cells_reach_theory(name):
    """The same of other laws, cells and bodies."""
    as_tabled(name)


def test_the_table_has_all_cases():
    with TABLE.open(newline="") as file:
        found = [(row["name"], row["error of"]) for row in csv.DictReader(file)]
    assert found == [(name, quantity) for name, case in CASES.items() for quantity in case.orders]


def test_every_feature_has_a_row_or_a_reason():
    """None is left out, and none has both."""
    sys.path.insert(0, str(TABLE.parents[2] / "docs" / "_ext"))
    from verification import FEATURES

    with (TABLE.parent / "without_orders.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    reasons = [feature for row in rows for feature in row["features"].split("; ")]
    assert all(len(row["reason"]) > 20 for row in rows)
    with_rows = {case.feature for case in CASES.values()}
    assert sorted([*with_rows, *reasons]) == sorted(itertools.chain(*FEATURES.values()))
