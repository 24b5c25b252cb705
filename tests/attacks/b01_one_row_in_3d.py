"""One layer of hexahedra that friction holds everywhere, dragged obliquely."""

from b01_one_row import stuck


def attack(case):
    methods = ("newton", "lemke", "gauss-seidel", "interior-point")
    stuck(case, [(1e9, 1e-6)], methods, (2, 2, 1), "hexahedron", (0.2, -0.1, -1.0))


def honest(case):
    stuck(case, [(1000.0, 1.0)], ("newton", "gauss-seidel"), (2, 2, 1), "hexahedron", (0, 0, -1))
