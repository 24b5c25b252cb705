"""Two materials in 3D, in a body of micrometres, and one on the other in triangles of degree 2.

Side by side the stresses are E times the strain, cell by cell, on whatever rank. In series both
halves carry 0.01/(0.5/1000 + 0.5/3000) = 15.
"""

import numpy as np
from a13_two_columns import GLASS, STEEL, columns, compared, on_floor, one_is_refused

import ufl
from dolfinx import mesh


def attack(case):
    kinds = (
        dict(cells=(2, 1, 1), size=(1.0, 1.0, 1.0)),
        dict(cells=(2, 1), size=(2e-6, 1e-6), cell="quadrilateral"),
        dict(cells=(2, 2), degree=2),
    )
    for kind in kinds:
        body, tags = columns(case.comm, **kind)
        stress = (-10.0, -30.0)
        if "degree" in kind:
            centres = mesh.compute_midpoints(body.domain, 2, tags.indices)
            values = np.where(centres[:, 1] < 0.5, 1, 2).astype(np.int32)
            tags = mesh.meshtags(body.domain, 2, tags.indices, values)
            stress = (-15.0, -15.0)
        dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
        problem = on_floor(body, STEEL.energy(body.u) * dx(1) + GLASS.energy(body.u) * dx(2))
        both = {2: GLASS.full_stress(body.u), 1: STEEL.full_stress(body.u)}
        middle = 0.5 * kind.get("size", (1.0,))[0]
        compared(case, problem, both, *stress, len(kind["cells"]) - 1, middle)
        one_is_refused(case, problem, STEEL.full_stress(body.u))
