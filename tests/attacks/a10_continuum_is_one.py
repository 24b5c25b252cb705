"""At the coefficient that is found, slips are added to a sliding state: both must be solutions.

The load is one under which the body slides with all points pressed. Its friction is set to the
coefficient, the slip is added with the displacement that the answer has, and the residual of the
body must be that of Coulomb's law: rt = F rn of a slip against the direction, at every point, by
forces assembled here. The direction is given as a vector with a normal part, of no unit length.
"""

import numpy as np
from a10_all_listed import energy_of, leaning, made

import ufl
from dolfinx import fem, la

from dolfinx_contact.analysis import critical_friction


def attack(case):
    for offset, direction in ((1.0, None), (1.0, (-7.0, 3.0)), (-1.0, (0.2, -5.0))):
        body = leaning(case.comm, offset, (4, 4))
        problem = made(body, energy_of(body))
        found = critical_friction(problem, direction)
        case.true("there is one", found.friction is not None)
        sign = 1.0 if direction is None else np.sign(direction[0])
        body.u.x.array[:] = found.displacement.x.array
        # Forces on the body that hold the displacement, at the nodes of the bottom.
        form = fem.form(ufl.derivative(energy_of(body), body.u, ufl.TestFunction(body.V)))
        forces = fem.assemble_vector(form)
        forces.scatter_reverse(la.InsertMode.add)
        forces.scatter_forward()
        nodes = fem.locate_dofs_topological(body.V, 1, body.bottom)
        nodes = nodes[nodes < body.V.dofmap.index_map.size_local]
        r = forces.array.reshape(-1, 2)[nodes]
        a = body.u.x.array.reshape(-1, 2)[nodes]
        parts = case.comm.allgather((r, a))
        r = np.concatenate([p[0] for p in parts])
        a = np.concatenate([p[1] for p in parts])
        case.equal("no normal displacement", a[:, 1], np.zeros(len(a)), 1e-9)
        case.true("slips along the direction", (sign * a[:, 0]).min() > -1e-9)
        case.equal("rt = F rn against the direction", sign * r[:, 0], found.friction * r[:, 1])
