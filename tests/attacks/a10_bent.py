"""A hyperelastic body that is squeezed and sheared: its coefficients belong to that state.

The tangent stiffness at the displacement in the Functions is assembled densely, and S_tt v = F S_nt
v solved in numpy; then the displacement is changed, and the answer must change with it. The bottom
stays on y = 0, where the displacement has no normal part.
"""

from mpi4py import MPI

import numpy as np
from a10_all_listed import compare, expected, leaning, made, tangent
from bodies import dense

import ufl

from dolfinx_contact import materials
from dolfinx_contact.analysis import critical_friction


def shape(shear, press):
    return lambda x: np.stack([shear * x[1] + 0 * x[0], -press * x[1] * (1 + 0.5 * x[0])])


def attack(case):
    rubber = materials.StVenantKirchhoff(1.0, 1.0)
    body = leaning(case.comm, 0.5, (3, 3))
    own = leaning(MPI.COMM_SELF, 0.5, (3, 3))
    problem = made(body, rubber.energy(body.u) * ufl.dx)
    form = tangent(rubber.energy(own.u) * ufl.dx, own)
    for shear, press in ((0.0, 0.0), (1.0, 0.1), (-0.7, 0.15), (0.0, 0.0)):
        body.u.interpolate(shape(shear, press))
        own.u.interpolate(shape(shear, press))
        found = critical_friction(problem)
        compare(case, found, expected(dense(form), own.V, 1.0))
