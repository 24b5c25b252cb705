"""A block of tetrahedra dragged until it slides: shear is friction times pressure at the nodes.

`find_solutions` in 3D, units of 1e9 and 1e-9, friction up to 2.
"""

from b04_what_solve_finds import found

from dolfinx_contact import materials


def attack(case):
    for young, friction in ((1e9, 0.2), (1e-9, 1.0)):
        steel = materials.LinearElastic.from_young(young, 0.3)
        found(
            case, steel.energy, (0.05, -0.02, -0.02), friction, cell="tetrahedron", cells=(1, 1, 1)
        )


def honest(case):
    steel = materials.LinearElastic.from_young(1000.0, 0.3)
    found(case, steel.energy, (0.001, 0.0, -0.02), 0.5, cell="tetrahedron", cells=(1, 1, 1))
