# SPDX-License-Identifier: LGPL-3.0-or-later
"""Siconos: its C library, on the problem condensed onto the contact points by scipy.

u = W r + q with the compliance W, the normal of each point first; q has the gaps and the
displacements without contact, less the tangential ones of the step before. Jumps of two bodies are
those of nodes over the faces below them at rest. The displacements of the bodies follow from the
forces by a solve of scipy. The time is that of Siconos alone.

Settings: ``solver``, by its name in Siconos; ``tolerance``, ``iterations`` at most (None: Siconos'
defaults).
"""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_bool, c_double, c_int, c_void_p

import numpy as np
from answers import debian_version, processor_time, run
from judge import assembled
from problems import cell_sizes, tangents
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import splu

#: Numbers of solvers in 2D and 3D (Friction_cst.h of Siconos 4.4).
SOLVERS = {"NSGS": (400, 500), "LEMKE": (404, None), "ENUM": (405, None), "NSN_AC": (None, 504)}
_DENSE = 0
_ITERATIONS_AT_MOST, _ITERATIONS = 0, 1
_TOLERANCE, _RESIDUAL = 0, 1


class Options(ctypes.Structure):
    """The head of SolverOptions.h's struct."""

    _fields_ = (
        ("solver", c_int), ("is_set", c_bool), ("isize", c_int), ("iparam", POINTER(c_int)),
        ("dsize", c_int), ("dparam", POINTER(c_double)),
    )  # fmt: skip


def library():
    found = ctypes.CDLL("libsiconos_numerics.so.7")
    doubles = POINTER(c_double)
    found.solver_options_create.restype = POINTER(Options)
    found.solver_options_create.argtypes = [c_int]
    found.NM_create_from_data.restype = c_void_p
    found.NM_create_from_data.argtypes = [c_int, c_int, c_int, c_void_p]
    found.frictionContactProblem_new_with_data.restype = c_void_p
    found.frictionContactProblem_new_with_data.argtypes = [
        c_int, ctypes.c_size_t, c_void_p, doubles, doubles,
    ]  # fmt: skip
    for driver in (found.fc2d_driver, found.fc3d_driver):
        driver.restype = c_int
        driver.argtypes = [c_void_p, doubles, doubles, POINTER(Options)]
    return found


def pointer(array):
    return array.ctypes.data_as(POINTER(c_double))


def solved(lib, dim, W, q, mu, settings, r):
    """Forces of one step, begun with ``r``; what the driver returns, iterations and residual."""
    number = SOLVERS[settings["solver"]][dim - 2]
    if number is None:
        raise NotImplementedError(f"Siconos has no {settings['solver']} in {dim}D")
    options = lib.solver_options_create(number)
    if settings["iterations"] is not None:
        options.contents.iparam[_ITERATIONS_AT_MOST] = settings["iterations"]
    if settings["tolerance"] is not None:
        options.contents.dparam[_TOLERANCE] = settings["tolerance"]
    matrix = lib.NM_create_from_data(_DENSE, len(q), len(q), W.ctypes.data)
    problem = lib.frictionContactProblem_new_with_data(
        dim, len(mu), matrix, pointer(q), pointer(mu)
    )
    u = np.zeros_like(q)
    driver = lib.fc2d_driver if dim == 2 else lib.fc3d_driver
    info = driver(problem, pointer(r), pointer(u), options)
    iterations = options.contents.iparam[_ITERATIONS]
    return u, info, iterations, options.contents.dparam[_RESIDUAL]


def jumps(p):
    """Matrix of the jumps (m d, n d), normal first, in terms of displacements."""
    below, shares = p.opposite()
    nodes = np.hstack([p.contact[:, None], below])
    weights = np.hstack([np.ones((len(nodes), 1)), -shares])
    frame = np.vstack([p.normal, tangents(p.normal)])
    rows = p.dim * np.arange(len(nodes))[:, None, None, None] + np.arange(p.dim)[:, None]
    columns = p.dim * nodes[:, :, None, None] + np.arange(p.dim)
    values = weights[:, :, None, None] * frame
    rows, columns, values = np.broadcast_arrays(rows, columns, values)
    entries = (values.reshape(-1), (rows.reshape(-1), columns.reshape(-1)))
    return coo_matrix(entries, shape=(p.dim * len(nodes), p.x.size)).tocsr(), frame


def moved(lib, p, settings):
    """A motion by Moreau and Jean's scheme with theta = 1/2 and no restitution (s, n, dim).

    (M + h^2 K/4) (v' - v) = h (f - K (u + h v/2)) + C^T r, u' = u + h (v + v')/2; where u + h v/2
    penetrates, Siconos finds the impulse r with v_N' >= 0.
    """
    K, _ = assembled(p.x, p.cells, p.kind, p.E, p.nu, p.body_force)
    mass = np.zeros(len(p.x))
    size = cell_sizes(p.x, p.cells, p.kind) / p.cells.shape[1]
    for column in p.cells.T:
        np.add.at(mass, column, p.density * size)
    free = np.setdiff1d(np.arange(p.x.size), p.held)
    h = p.dt
    M = diags(np.repeat(mass, p.dim))
    factors = splu((M + h**2 / 4 * K)[free][:, free].tocsc())
    C, _ = jumps(p)
    W = C[:, free] @ factors.solve(C[:, free].T.toarray())
    gaps = p.gaps
    u, v = np.zeros(p.x.size), np.zeros(p.x.size)
    us, infos, iterations, seconds, worst = [], [], 0, 0.0, 0.0
    for s in range(p.steps):
        at = u + h / 2 * v
        v = v.copy()
        old = v.copy()
        v[free] += factors.solve(h * (p.loads[s].reshape(-1) - K @ at)[free])
        near = np.flatnonzero(gaps + (C @ at)[:: p.dim] <= 0)
        if len(near):
            rows = (p.dim * near[:, None] + np.arange(p.dim)).reshape(-1)
            some = np.asfortranarray(W[np.ix_(rows, rows)])
            r, mu = np.zeros(len(rows)), np.full(len(near), p.mu)
            begun = processor_time()
            _, info, more, residual = solved(lib, p.dim, some, (C @ v)[rows], mu, settings, r)
            seconds += processor_time() - begun
            iterations += more
            infos.append(info)
            worst = max(worst, residual)
            v[free] += factors.solve((C[rows].T @ r)[free])
        u = u + h / 2 * (old + v)
        us.append(u.reshape(p.x.shape))
    return np.stack(us), None, record_of(infos, worst, iterations, seconds)


def record_of(infos, residual, iterations, seconds):
    good = not any(infos)
    return {
        "version": debian_version("libsiconos-numerics7"),
        "says": f"{'solved' if good else f'info {max(infos)}'}, residual {residual:.0e}",
        "converged": good,
        "iterations": iterations,
        "seconds": seconds,
    }


def solve(p, settings):
    lib = library()
    if p.density:
        return moved(lib, p, settings)
    d = p.dim
    K, _ = assembled(p.x, p.cells, p.kind, p.E, p.nu, p.body_force, p.times)
    free = np.setdiff1d(np.arange(p.x.size), p.held)
    factors = splu(K[free][:, free].tocsc())
    pivots = np.abs(factors.U.diagonal())
    if pivots.min() < 1e-12 * pivots.max():
        raise ValueError("there is a compliance of bodies alone that supports hold")
    C, frame = jumps(p)
    W = np.asfortranarray(C[:, free] @ factors.solve(C[:, free].T.toarray()))
    mu = np.full(len(p.contact), p.mu)
    gap = np.zeros((len(mu), d))
    gap[:, 0] = p.gaps
    r = np.zeros(len(W))
    before = np.zeros_like(gap)
    us, forces, infos, seconds, iterations = [], [], [], 0.0, 0

    def displaced(load):
        u = np.zeros(p.x.size)
        u[p.held] = p.values[s]
        u[free] = factors.solve((load - K @ u)[free])
        return u

    for s in range(p.steps):
        load = p.loads[s].reshape(-1)
        q = C @ displaced(load) + (gap - before).reshape(-1)
        begun = processor_time()
        _, info, more, residual = solved(lib, d, W, q, mu, settings, r)
        seconds += processor_time() - begun
        iterations += more
        infos.append(info)
        u = displaced(load + C.T @ r)
        before = (C @ u).reshape(-1, d)
        before[:, 0] = 0.0
        us.append(u.reshape(p.x.shape))
        forces.append(r.reshape(-1, d) @ frame)
    record = record_of(infos, residual, iterations, seconds)
    return np.stack(us), np.stack(forces), record


if __name__ == "__main__":
    run(solve)
