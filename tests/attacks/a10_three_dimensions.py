"""A leaning box that slips obliquely in 3D, against numpy.

All points slip along d, the tangential part of a vector, and slip across d is held. The
coefficients are the eigenvalues of S_dd v = F S_nd v.
"""

from mpi4py import MPI

import numpy as np
from a10_all_listed import made_3d, sorted_by_slips
from bodies import condensed, dense, nodes_of

from dolfinx_contact.analysis import critical_friction


def attack(case):
    direction = np.array([3.0, 4.0, 7.0])
    d = np.array([0.6, 0.8, 0.0])
    problem, _, _ = made_3d(case.comm)
    found = critical_friction(problem, direction)
    _, own, form = made_3d(MPI.COMM_SELF)
    K = dense(form)
    bottom = nodes_of(own.V, lambda y: np.isclose(y[:, 2], 0))
    top = nodes_of(own.V, lambda y: np.isclose(y[:, 2], 1))
    kept = (3 * bottom[:, None] + np.arange(3)).ravel()
    S = condensed(K, kept, (3 * top[:, None] + np.arange(3)).ravel())
    m = len(bottom)
    along = np.kron(np.eye(m), d).T
    normal = np.kron(np.eye(m), [0, 0, 1]).T
    lists = sorted_by_slips(along.T @ S @ along, normal.T @ S @ along)
    case.equal("of one sign", found.one_signed, lists[0])
    case.equal("of both signs", found.mixed, lists[1])
    sizes = sorted(abs(F) for F in found.unreal)
    case.equal("complex", sizes, sorted(abs(F) for F in lists[2]))
