"""Stronger friction with fewer solutions."""

import pytest
from support.demo_numbers import run


@pytest.mark.verifies(
    "friction as parameter",
    "branches",
    reference="enumeration: folds of stiffnesses made by hand",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_branch_with_more_friction_turns_back_twice(folder):
    """The branch turns back at F = 7 and at F = 1.78, and ends alone."""
    names = run("friction_parameter", folder)
    folds = [special.gamma for special in names["branch"].folds]
    assert folds == pytest.approx([7.0, 1.7812751263], rel=1e-9)
    assert [len(words) for words in names["solutions"]] == [1, 3, 1]
    assert names["solutions"][1] == ["--", "k-", "o-"]
    picture = folder / "output" / "friction_parameter" / "branch.png"
    assert picture.stat().st_size > 10_000
