"""Two pressed blocks for files and balances."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    Frictionless,
)
from dolfinx_contact.meshing import join
from support.blocks import box, facets
from support.pairs import MATERIAL, displacement, held, tagged

COMM = MPI.COMM_WORLD


def blocks(cell, below, above, degree, method, *, law, gap=0.0):
    """Two unit blocks, one on the other; tags 1 below, 2 and 3 face to face, 4 above."""
    bodies = []
    tags = []
    for i, n in enumerate((below, above)):
        body = box(COMM, n, cell)
        up = body.topology.dim - 1
        z = i * (1 + gap)
        body.geometry.x[:, up] += z
        tags.append(tagged(body, **{f"t{2 * i + 1}": (up, z), f"t{2 * i + 2}": (up, z + 1)}))
        bodies.append(body)
    both = join(bodies, facet_tags=tags)
    u = displacement(both.mesh, degree)
    return both, u, ContactPair(u, both, slave=3, master=2, law=law, method=method)


def pressed(*case, friction=None, gap=0.0):
    """The upper block is moved: straight down in a box without friction, or aside as well."""
    law = Frictionless() if friction is None else Coulomb(friction)
    both, u, pair = blocks(*case, law=law, gap=gap)
    V = u.function_space
    dim = both.mesh.topology.dim
    shift = np.zeros(dim)
    shift[-1] = -0.02
    ends = []
    if friction is None:
        for i in range(dim - 1):
            for x in (0.0, 1.0):
                dofs = fem.locate_dofs_topological(V.sub(i), dim - 1, facets(both.mesh, i, x))
                ends.append(fem.dirichletbc(0.0, dofs, V.sub(i)))
    else:
        shift[0] = 0.02
    ends += [held(u, both.facet_tags, 1, np.zeros(dim)), held(u, both.facet_tags, 4, shift)]
    options = {"snes_rtol": 1e-12}
    return ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [pair], bcs=ends, petsc_options=options)
