# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangle with one or several solutions.

A = (0, 0), B = (l, 0), C = (0, l), clamped on BC, may touch a rigid floor along AB; a traction acts
on AC. Of one element it is Hild's (Int. J. Appl. Math. Comput. Sci. 12 (2002) 41-50), of many that
of Ligursky and Renard.
"""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import explore
from dolfinx_contact.laws.status import letters
from dolfinx_contact.materials import LinearElastic

#: Descriptions of the results of `end_of`.
ENDS = {
    **{"o": "A opens", "k": "A sticks", "-": "A slips to the left", "+": "A slips to the right"},
    **{"c": "a cycle", "d": "diverges", "n": "does not converge"},
}


def linear_triangle(
    n, friction, load=(26.0, 7.5), lame=(100.0, 82.0), length=1.0, *, preload=(0, 0), law=None,
    comm=None,
):  # fmt: skip
    """The triangle under the traction preload - gamma load.

    Args:
        n: cells along an edge: n * n congruent triangles, half of a square.
        friction: coefficient of Coulomb's law.
        load: (F1, F2), by which gamma is multiplied.
        lame: Lame's coefficients.
        length: of AB.
        preload: numbers, or a function of the mesh that gives an expression.
        law: a function of the mesh that gives another law.
        comm: communicator, by default all ranks.
    """
    comm = comm or MPI.COMM_WORLD
    square = mesh.create_unit_square(comm, n, n, diagonal=mesh.DiagonalType.left)
    half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
    domain = mesh.create_submesh(square, 2, half)[0]
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    side = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], 0))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    domain.geometry.x[:] *= length

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, -1.0)
    ones = np.ones(len(side), dtype=np.int32)
    tags = mesh.meshtags(domain, 1, np.sort(side), ones)
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    if callable(preload):
        first = preload(domain)
    else:
        constant = np.array(preload, float)
        first = fem.Constant(domain, constant)
    traction = first - gamma * fem.Constant(domain, load)
    stored = LinearElastic(*lame).energy(u)
    energy = stored * ufl.dx - ufl.dot(traction, u) * ds
    held = fem.locate_dofs_topological(V, 1, slope)
    clamped = fem.dirichletbc(np.zeros(2), held, V)
    floor = HalfSpace((0, 0), (0, 1))
    law = Coulomb(friction) if law is None else law(domain)
    surface = ContactSurface(u, bottom, obstacle=floor, law=law)
    problem = ContactProblem(energy, u, [surface], bcs=[clamped])
    return ParametricContact(problem, gamma)


def element(lame, friction, length, load, preload=(0.0, 0.0)):
    """One element under the traction preload + gamma load, on every rank alone."""
    minus = -np.array(load, dtype=float)
    return linear_triangle(1, friction, minus, lame, length, preload=preload, comm=MPI.COMM_SELF)


def true_solutions(n, friction):
    """The triangle of n cells an edge, and the points of its branches at gamma = 1, by statuses."""
    system = linear_triangle(n, friction)
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0))
    ends = []
    for branch in diagram.branches:
        both = (branch.points[0], branch.points[-1])
        ends += [point for point in both if point.gamma == 1.0]
    return system, sorted(ends, key=lambda point: system.letters(point.piece))


def reduced(n, friction, load, lame):
    """The triangle at gamma = 1 on its contact points, as numpy arrays; on every rank alone."""
    system = linear_triangle(n, friction, load, lame, comm=MPI.COMM_SELF)
    system.constant.value = 1.0
    return system.problem.reduced()


def end_of(contact, outcome):
    """Return the final status of A in an algorithm, or its failure: a key of `ENDS`."""
    if outcome.converged:
        return str(letters(2)[contact.statuses(outcome.a, outcome.r)[0]])
    kinds = {"cycle": "c", "diverges": "d", "not finite": "d"}
    return next((kind for word, kind in kinds.items() if word in outcome.reason), "n")
