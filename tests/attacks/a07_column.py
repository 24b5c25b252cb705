"""A slender StVenant-Kirchhoff column, stuck on a floor, pressed below and beyond Euler's load.

The tangent stiffness at the solution is assembled densely on one rank, nodes that stick or are
clamped are held, and its eigenvalues by the mass say what grows. Not one contact point is at a
border. Beyond Euler's load there are several solutions; with so much friction all points stick in
each of those that are found.
"""

from mpi4py import MPI

import numpy as np
import scipy.linalg
from a10_all_listed import tangent
from bodies import block, copied, dense, nodes_of

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.analysis import stability_at_rest

RHO = 3.0


def column(comm, press, cells=(2, 10), cell="triangle", degree=1, **more):
    body = block(comm, cells, (0.1, 1.0), cell, degree)
    energy = materials.StVenantKirchhoff(1.0, 1.0).energy(body.u) * ufl.dx
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(40.0), **more)
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    body.moved.interpolate(lambda x: np.stack([0 * x[0], -press + 0 * x[0]]))
    body.u.interpolate(lambda x: np.stack([0 * x[0], -press * x[1]]))
    return body, energy, problem


def put(case, press, **more):
    body, _, problem = column(case.comm, press, **more)
    result = problem.solve()
    letters = set(result.tables["contact"].status)
    case.true(f"all stick: {letters}", letters == {"k"})
    answer = stability_at_rest(problem, density=RHO)
    more.pop("method", None)
    own, energy, _ = column(MPI.COMM_SELF, press, **more)
    copied(body.u, own.u)
    return compared(case, answer, energy, own, RHO)


def compared(case, answer, energy, own, density):
    """The least eigenvalue of a body whose ends are held; what is said of it must fit."""
    trial = ufl.TrialFunction(own.V)
    test = ufl.TestFunction(own.V)
    K = dense(tangent(energy, own))
    M = dense(density * ufl.dot(trial, test) * ufl.dx)
    free = nodes_of(own.V, lambda y: (y[:, 1] > 1e-6) & (y[:, 1] < 1 - 1e-6))
    free = np.concatenate([2 * free, 2 * free + 1])
    least = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], eigvals_only=True)[0]
    if least < 0:
        case.true(f"unstable, not {answer.label}", answer.label == "unstable")
        case.equal("growth", answer.growth, np.sqrt(-least), 1e-5)
    else:
        case.true(f"stable, not {answer.label}: {answer.reason}", answer.label == "stable")
    return least


def attack(case):
    least = [put(case, press) for press in (0.03, 0.08, 0.15)]
    case.true(f"some buckle and some do not: {least}", min(least) < 0 < max(least))


def honest(case):
    case.true("far below Euler", put(case, 0.005) > 0)
