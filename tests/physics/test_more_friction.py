"""Stronger friction with fewer solutions, against stiffnesses made by hand."""

from mpi4py import MPI

import numpy as np
import pytest
from support.demo_numbers import run
from support.enumeration import enumerated

serial = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, the same on every rank")

#: Displacements of the held nodes, as in `demo_friction_parameter.py`.
MOVED = {(0.5, 0.5): (-0.02, 0.0), (1.5, 1.5): (0.01, -0.01)}


def by_hand():
    """S and p of the two triangles in plane strain, E = 1, nu = 0.3."""
    lmbda = 0.3 / (1.3 * 0.4)
    mu = 0.5 / 1.3
    D = np.array([[lmbda + 2 * mu, lmbda, 0], [lmbda, lmbda + 2 * mu, 0], [0, 0, mu]])
    corners = np.array([(0, 0), (1, 0), *MOVED])
    K = np.zeros((8, 8))
    for cell in ([0, 1, 2], [1, 3, 2]):
        whole = np.column_stack([np.ones(3), corners[cell]])
        slopes = np.linalg.inv(whole)[1:]
        B = np.zeros((3, 6))
        B[0, 0::2], B[1, 1::2] = slopes
        B[2, 0::2], B[2, 1::2] = slopes[::-1]
        rows = (2 * np.array(cell)[:, None] + [0, 1]).reshape(-1)
        K[np.ix_(rows, rows)] += 0.5 * np.linalg.det(whole) * B.T @ D @ B
    return K[:4, :4], -K[:4, 4:] @ np.concatenate(list(MOVED.values()))


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


@serial
def test_folds_separate_numbers_of_solutions():
    """The enumeration of 16 pieces confirms the numbers one part in 10^7 below and above."""
    S, p = by_hand()
    for fold, below, above in ((1.7812751263, 1, 3), (7.0, 3, 1)):
        for side, count in ((-1e-7, below), (1e-7, above)):
            found, _ = enumerated(S, 1e4 * p, np.full(2, fold * (1 + side)))
            assert len(found) == count
