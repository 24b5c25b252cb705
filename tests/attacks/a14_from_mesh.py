"""The proof that a solve leaves: are its S and p those of the mesh, whatever the number of ranks?

S and p are the Schur complement of a stiffness that is assembled here, densely and on every rank,
and the number of solutions is an enumeration in numpy. The states are compared, too.
"""

from mpi4py import MPI

import numpy as np
from a14_counts import enumerated
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import find_solutions

FRICTION = 0.5


def dense(form, V, bcs):
    """Matrix of a form as an array, on one rank."""
    return fem.assemble_matrix(fem.form(form), bcs).to_dense()


def made(comm, pull):
    body = block(comm, (2, 1), (1.0, 0.5))
    gamma = fem.Constant(body.domain, 1.0)
    traction = gamma * ufl.as_vector((pull, -1.0))
    energy = materials.LinearElastic(1.0, 1.0).energy(body.u) * ufl.dx
    energy -= ufl.dot(traction, body.u) * ufl.dx
    return body, gamma, energy


def attack(case, pulls=(4.0, -4.0)):
    for pull in pulls:
        body, gamma, energy = made(case.comm, pull)
        floor = HalfSpace((0, 0), (0, 1))
        law = Coulomb(FRICTION)
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        system = ParametricContact(problem, gamma)
        problem.solve()
        x = system.create_vector()
        problem.write(x)
        found = find_solutions(system, [x], 1.0)
        case.true("complete", found.complete)
        # The same by numpy, on this rank alone.
        own, _, energy = made(MPI.COMM_SELF, pull)
        trial = ufl.TrialFunction(own.V)
        test = ufl.TestFunction(own.V)
        K = dense(ufl.derivative(ufl.derivative(energy, own.u, test), own.u, trial), own.V, [])
        f = -fem.assemble_vector(fem.form(ufl.derivative(energy, own.u, test))).array
        y = own.V.tabulate_dof_coordinates()
        nodes = np.flatnonzero(np.isclose(y[:, 1], 0))
        nodes = nodes[np.argsort(y[nodes, 0])]
        a = np.stack([2 * nodes, 2 * nodes + 1], 1).ravel()
        tops = np.flatnonzero(np.isclose(y[:, 1], 0.5))
        rest = np.setdiff1d(np.arange(len(K)), [*a, *(2 * tops), *(2 * tops + 1)])
        inner = K[np.ix_(rest, rest)]
        S = K[np.ix_(a, a)]
        p = f[a]
        if len(rest):
            S = S - K[np.ix_(a, rest)] @ np.linalg.solve(inner, K[np.ix_(rest, a)])
            p = p - K[np.ix_(a, rest)] @ np.linalg.solve(inner, f[rest])
        # Normal n = (0, -1), tangent t = (1, 0), un = u_y.
        expected = enumerated(S, p, np.full(len(nodes), FRICTION))
        case.equal("solutions", len(found.found), len(expected), 0.0)
        table = problem.table(contact)
        state = np.stack([table.along(table.ut), table.un], 1)
        scale = np.abs(state).max() or 1.0
        off = [np.abs(state - other).max() for _, other in expected]
        case.true("what is solved is one of them", min(off) < 1e-8 * scale)


def honest(case):
    attack(case, (1.0,))
