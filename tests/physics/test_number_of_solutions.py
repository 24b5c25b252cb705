"""Numbers of solutions under refinement: `benchmarks/number_of_solutions.py`."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import number_of_solutions


@pytest.mark.parametrize("n", [1, 4, pytest.param(16, marks=pytest.mark.long)])
@pytest.mark.verifies("all solutions", reference="itself: coarser meshes", aspects=("2D", "proofs"))
def test_a_wedge_has_three_solutions_on_every_mesh(n):
    """A step of the rate law; one solution below the slope of the wedge."""
    for friction, number in ((0.1, 1), (0.3, 3), (0.5, 3)):
        record = number_of_solutions.rate(n, friction, 30.0)
        assert record["largest"] == number
        assert record["proved"] == 1
