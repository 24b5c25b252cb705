# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I use quadrilaterals and hexahedra?
#
# Use a mesh of such cells; everything else is unchanged. In gmsh, set transfinite curves and
# `gmsh.model.mesh.setRecombine`, as in `demo_press_fit.py`. All cells of a mesh are of one kind.

from common import Block

pressures = {}
for cell in ("triangle", "quadrilateral", "tetrahedron", "hexahedron"):
    result = Block(n=4, cell=cell).problem().solve()
    pressures[cell] = result.resultants["contact"][-1]
    print(f"{cell}: {result.dofs} unknowns, force {pressures[cell]:.3f}, {result.counts}")
assert abs(pressures["triangle"] / pressures["quadrilateral"] - 1) < 0.05
assert abs(pressures["tetrahedron"] / pressures["hexahedron"] - 1) < 0.05
