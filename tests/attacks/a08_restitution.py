"""A motion with impacts is resumed with another coefficient of restitution and another length of
step, plain numbers of the motion.

The right answer is the motion of the second script, never killed.
"""

from recorded import compare, pushed, resumed

from dolfinx_contact.evolution import NSCD

TIMES = (0.0, 0.04, 0.08, 0.12)


def make(comm, restitution):
    _, problem = pushed(comm, (4, 2), height=-0.005)
    return NSCD(problem, 1.0, dt=0.02, level="velocity", mass="lumped", restitution=restitution)


def attack(case):
    found = resumed(case.comm, lambda: make(case.comm, 0.9), lambda: make(case.comm, 0.1), TIMES)
    compare(case, found, make(case.comm, 0.1).run(TIMES))
