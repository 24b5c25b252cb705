# SPDX-License-Identifier: LGPL-3.0-or-later
# # How much of the contact surface touches?
#
# The part of the surface that touches (without regard to asperities) is the sum of the areas of the
# closed points, `table.closed`. In 2D areas are lengths. Here a cube is pressed on a ball
# without friction.

from common import Block

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, Sphere

block = Block(n=8, cell="hexahedron")
ball = Sphere(centre=(0.5, 0.5, -5.0), radius=5.0)
contact = ContactSurface(block.u, block.bottom, obstacle=ball, law=Frictionless())
table = ContactProblem(block.energy, block.u, [contact], bcs=block.bcs).solve().tables["contact"]
closed = table.closed
area = table.area[closed].sum()
print(f"{closed.sum()} of {len(closed)} points, {area:.4f} of {table.area.sum():.4f}")
assert 0 < area < table.area.sum()
