"""The Constant of the density of a falling block is changed between two runs of its motion.

Under the force 10 per volume it falls with 10, with the density 2 with 5; its momentum is not
what is kept then, but its velocity.
"""

from a02_motion_attributes import falling, speed


def attack(case):
    body, _weight, density, motion = falling(case)
    motion.run([0.0, 0.02])
    case.equal("speed", speed(case, body, motion), -0.2)
    density.value = 2.0
    motion.run([0.02, 0.04])
    case.equal("speed of twice the mass", speed(case, body, motion), -0.3)
