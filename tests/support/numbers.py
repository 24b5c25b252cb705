"""Dense linear algebra on one rank, as an independent computation."""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl
from dolfinx import fem


def dense(form: Any) -> np.ndarray:
    """Return the matrix of a bilinear form on a mesh of one rank, without conditions."""
    return fem.assemble_matrix(fem.form(form)).to_dense()


def tangent(energy: Any, body: Any) -> Any:
    """Return the second derivative of an energy, a bilinear form."""
    trial = ufl.TrialFunction(body.V)
    test = ufl.TestFunction(body.V)
    return ufl.derivative(ufl.derivative(energy, body.u, test), body.u, trial)


def nodes_of(V: fem.FunctionSpace, where: Any) -> np.ndarray:
    """Return the nodes (not dofs) on one rank where ``where(y)`` holds, sorted by coordinates.

    Args:
        V: vector space.
        where: mask of positions, shape (n, 3).
    """
    y = V.tabulate_dof_coordinates()
    found = np.flatnonzero(where(y))
    return found[np.lexsort(y[found].round(12).T[::-1])]


def condensed(K: np.ndarray, kept: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Return the Schur complement of ``K`` on ``kept``; dofs ``gone`` are held at zero."""
    rest = np.setdiff1d(np.arange(len(K)), np.concatenate([kept, gone]))
    S = K[np.ix_(kept, kept)]
    if len(rest):
        S = S - K[np.ix_(kept, rest)] @ np.linalg.solve(
            K[np.ix_(rest, rest)], K[np.ix_(rest, kept)]
        )
    return S


def copy_values(u: fem.Function, own: fem.Function) -> None:
    """Copy the values of a vector Function of all ranks to one on COMM_SELF. Collective.

    Args:
        u: vector Function.
        own: Function of the same element on the same mesh, on one rank.
    """
    dim = u.function_space.dofmap.index_map_bs
    x = u.function_space.tabulate_dof_coordinates()
    parts = u.function_space.mesh.comm.allgather((x, u.x.array.reshape(-1, dim)))
    places = np.concatenate([p[0] for p in parts])
    values = np.concatenate([p[1] for p in parts])
    for i, y in enumerate(own.function_space.tabulate_dof_coordinates()):
        nearest = np.argmin(np.linalg.norm(places - y, axis=1))
        own.x.array[dim * i : dim * (i + 1)] = values[nearest]
