"""A block that is moved until half of it hangs over the edge of the lower one, P1 and P2.

The force is at most that of the half that is still carried, and what bends of it; with the whole
width carried it would be 0.02 / 1.5. The problem in which the upper block is meshed where it goes
has the answer; its points that have nothing below carry nothing.
"""

from a03_off_the_edge import doubted, pressed
from bodies import two_blocks


def attack(case):
    for degree in (1, 2):
        reference = two_blocks(case.comm, (4, 2), (4, 1), at=0.5, degree=degree)
        expected = pressed(reference, 0.0).solve().resultants["contact"][1]
        case.true("part of the whole", 0.3 < expected / (0.02 / 1.5) < 0.9)
        both = two_blocks(case.comm, (4, 2), (4, 1), degree=degree)
        result = pressed(both, 0.5).solve()
        case.equal("force", result.resultants["contact"][1], expected, 0.02)
        doubted(case, result)
