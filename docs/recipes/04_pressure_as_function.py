# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I get the contact pressure as a Function?
#
# `problem.contact_fields` gives pressure, traction, gap, slip and status as Functions on the mesh
# of the contact facets, each a field that may be integrated, written to a file or drawn. The
# multiplier of the surface is the traction on the body, a vector Function of the same mesh. The
# normal points from the body into the obstacle, so that the pressure is minus its normal part.
# `assemble_scalar` returns the integral over the part of a rank; `allreduce` adds all parts.

from common import Block

import ufl
from dolfinx import fem

problem = Block().problem()
result = problem.solve()
(surface,) = problem.surfaces
pressure = problem.contact_fields(surface)["pressure"]
force = fem.assemble_scalar(fem.form(pressure * ufl.dx(pressure.function_space.mesh)))
force = problem.comm.allreduce(force)
print(result.tables["contact"].pressure.max(), force, result.resultants["contact"][1])
assert abs(force - result.resultants["contact"][1]) < 1e-6 * force
