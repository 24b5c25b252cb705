"""The same in 3D, slipping along (3, 4)/5: the load turns back where it begins to slip.

S = [[1, -1.5], [-1.5, 4]] along that line, the top moved along it by 1 and lifted by gamma from
-1 to 1, F = 1: by hand the point sticks to gamma = 0.2, slips while the load goes back to 0,
where it comes off, and hangs free from there, or is pressed again with its slip of 1.
"""

from a05_friction_folds import followed

STIFFNESS = [[1.0, 0.0, -0.9], [0.0, 1.0, -1.2], [-0.9, -1.2, 4.0]]


def attack(case):
    followed(case, STIFFNESS, [0.6, 0.8], 1.0, [0.2, 0.0], 0.1)
