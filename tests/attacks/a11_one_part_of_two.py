"""Two materials in one energy, of which one has the weight and the other has not.

With nu = 0 the column splits by the radius: E_1 on 1 < r < 1.5, E_2 on 1.5 < r < 2. They stand in
one integral, one weighted, or in two integrals over cell tags. The twin has weights everywhere.
"""

from functools import partial

import numpy as np
from rings import ring, settled

import ufl
from dolfinx import mesh

from dolfinx_contact.materials import circumference


def split(case, weights, tagged):
    def weighted(psi, body):
        domain = body.domain
        around = circumference(domain)
        pick = [around if has else 1.0 for has in weights]
        r = ufl.SpatialCoordinate(domain)[0]
        if not tagged:
            inner = ufl.conditional(ufl.lt(r, 1.5), 1.0, 0.0)
            return (inner * psi * pick[0] + (1 - inner) * 2 * psi * pick[1]) * ufl.dx
        cells = np.arange(domain.topology.index_map(2).size_local, dtype=np.int32)
        outer = mesh.compute_midpoints(domain, 2, cells)[:, 0] > 1.5
        tags = mesh.meshtags(domain, 2, cells, np.where(outer, 2, 1).astype(np.int32))
        dx = ufl.Measure("dx", domain, subdomain_data=tags)
        return psi * pick[0] * dx(1) + 2 * psi * pick[1] * dx(2)

    return ring(case, weighted)


EXPECTED = 10.0 * np.pi * ((1.5**2 - 1) + 2 * (2**2 - 1.5**2))


def attack(case):
    for weights in ((True, False), (False, True)):
        for tagged in (False, True):
            name = f"force, weights {weights}, tagged {tagged}"
            force = partial(split, case, weights, tagged)
            settled(case, name, force, EXPECTED)


def honest(case):
    case.equal("force, tagged", split(case, (True, True), True), EXPECTED, 1e-6)
