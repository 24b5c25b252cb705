"""One row of cells that friction holds everywhere, for algorithms that are less at home there."""

from b01_one_row import stuck


def attack(case):
    others = ("tresca", "uzawa", "penalty", "sor", "projected-gradient")
    stuck(case, [(1e6, 1e-3)], others, cells=(2, 1))
