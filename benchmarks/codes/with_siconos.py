# SPDX-License-Identifier: LGPL-3.0-or-later
"""Siconos: its C library, on the problem condensed onto the contact points (`reduced.py`).

u = W r + q with the compliance W = S^-1, the normal of each point first; q has the displacements
without contact, less the tangential ones of the step before. The displacements of the body follow
from the forces by a solve of scipy. The time is that of Siconos alone.

Settings: ``solver``, by its name in Siconos; ``tolerance``, ``iterations`` at most (None: Siconos'
defaults); ``points``, the file of reduced problems.
"""

from __future__ import annotations

import ctypes
import time
from ctypes import POINTER, c_bool, c_double, c_int, c_void_p

import numpy as np
from answers import debian_version, run
from judge import assembled
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


def solve(p, settings):
    if len(p.master_faces):
        raise NotImplementedError("the driver has contact with a rigid plane alone")
    lib = library()
    with np.load(settings["points"]) as data:
        S, loads, mu, frames, nodes = (data[k] for k in ("S", "p", "friction", "frames", "nodes"))
    d = p.dim
    order = np.roll(np.arange(len(S)).reshape(-1, d), 1, axis=1).reshape(-1)
    W = np.asfortranarray(np.linalg.inv(S)[np.ix_(order, order)])
    free = np.setdiff1d(np.arange(p.x.size), p.held)
    K, _ = assembled(p.x, p.cells, p.kind, p.E, p.nu, p.body_force)
    factors = splu(K[free][:, free].tocsc())
    r = np.zeros(len(S))
    before = np.zeros(len(S))
    us, forces, infos, seconds, iterations = [], [], [], 0.0, 0
    for s in range(p.steps):
        q = W @ loads[s][order] - before
        begun = time.perf_counter()
        slips, info, more, residual = solved(lib, d, W, q, mu, settings, r)
        seconds += time.perf_counter() - begun
        iterations += more
        infos.append(info)
        before = (slips + before).reshape(-1, d)
        before[:, 0] = 0.0
        before = before.reshape(-1)
        local = np.roll(r.reshape(-1, d), -1, axis=1)
        force = np.zeros((len(p.contact), d))
        force[nodes] = np.einsum("mij,mj->mi", frames, local)
        total = p.loads[s].copy()
        total[p.contact] += force
        u = np.zeros(p.x.size)
        u[p.held] = p.values[s]
        u[free] = factors.solve((total.reshape(-1) - K @ u)[free])
        us.append(u.reshape(p.x.shape))
        forces.append(force)
    good = not any(infos)
    record = {
        "version": debian_version("libsiconos-numerics7"),
        "says": f"{'solved' if good else f'info {max(infos)}'}, residual {residual:.0e}",
        "converged": good,
        "iterations": iterations,
        "seconds": seconds,
    }
    return np.stack(us), np.stack(forces), record


if __name__ == "__main__":
    run(solve)
