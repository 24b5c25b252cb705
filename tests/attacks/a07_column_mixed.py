"""The column again, of triangles with mixed contact, and of quadrilaterals with nodal contact."""

from a07_column import put


def attack(case):
    least = [put(case, press, method="mixed") for press in (0.01, 0.2)]
    case.true(f"one buckles: {least}", min(least) < 0)
    put(case, 0.3, cells=(1, 6), cell="quadrilateral")
