# SPDX-License-Identifier: LGPL-3.0-or-later
"""GetFEM: nodal contact by multipliers, Newton on the augmented equations.

Of two bodies it is that of nodes with the faces below them at rest: the matrices of its basic
contact brick have the displacements of both.

Settings: ``r``, the augmentation over Young's modulus; ``version``, of the augmented equations (1:
unsymmetric, Alart and Curnier; 3: with augmented multipliers); ``solve``, words for `Model.solve`;
``newmark``, beta and gamma of Newmark's scheme in a motion; ``residual``, to which it solves, and
whether that is ``relative`` to the largest nodal load. The loads of a step are not cut;
friction in a history is by the displacement of the step before.
"""

from __future__ import annotations

import time

import getfem as gf
import numpy as np
from answers import debian_version, run
from problems import tangents
from scipy.spatial import cKDTree

#: GetFEM's order of nodes, and its elements.
CELLS = {
    "tri3": ("GT_PK(2,1)", "FEM_PK(2,1)", "IM_TRIANGLE(2)", [0, 1, 2]),
    "quad4": ("GT_QK(2,1)", "FEM_QK(2,1)", "IM_GAUSS_PARALLELEPIPED(2,2)", [0, 1, 3, 2]),
    "hex8": (
        "GT_QK(3,1)", "FEM_QK(3,1)", "IM_GAUSS_PARALLELEPIPED(3,2)", [0, 1, 3, 2, 4, 5, 7, 6],
    ),
}  # fmt: skip


def apart(p):
    """Places of nodes (n, dim), bodies moved apart: GetFEM joins nodes at one place."""
    body = np.arange(len(p.x))
    while (body[p.cells] != body[p.cells].min(axis=1, keepdims=True)).any():
        np.minimum.at(body, p.cells, body[p.cells].min(axis=1, keepdims=True))
    number = np.unique(body, return_inverse=True)[1]
    return p.x + 2 * np.ptp(p.x, axis=0).max() * number[:, None]


def spaces(p):
    """Mesh, elements, integration, and the first degree of freedom of every node."""
    geometry, element, integration, order = CELLS[p.kind]
    mesh = gf.Mesh("empty", p.dim)
    x = apart(p)
    for cell in p.cells:
        mesh.add_convex(gf.GeoTrans(geometry), x[cell[order]].T)
    mf = gf.MeshFem(mesh, p.dim)
    mf.set_fem(gf.Fem(element))
    at = mf.basic_dof_nodes()[:, :: p.dim].T
    away, nearest = cKDTree(at).query(x)
    first = p.dim * nearest
    if away.max() > 1e-9 or len(np.unique(first)) != len(p.x):
        raise ValueError("GetFEM has joined nodes")
    return mesh, mf, gf.MeshIm(mesh, gf.Integ(integration)), first


def add_contact(model, p, mf, dofs, settings):
    """The contact brick; ``dofs`` of all nodes (n, dim); "before" is a step's start."""
    m = len(p.contact)
    below, shares = p.opposite()
    over = np.hstack([p.contact[:, None], below])  # nodes of each jump
    weights = np.hstack([np.ones((m, 1)), -shares])
    frame = tangents(p.normal)
    normal = gf.Spmat("empty", m, mf.nbdof())
    tangent = gf.Spmat("empty", (p.dim - 1) * m, mf.nbdof())
    for i, j in np.ndindex(over.shape):
        for k, dof in enumerate(dofs[over[i, j]]):
            normal.add(i, int(dof), -p.normal[k] * weights[i, j])
            for row, t in enumerate(frame, start=(p.dim - 1) * i):
                tangent.add(row, int(dof), t[k] * weights[i, j])
    model.add_variable("lambda_n", m)
    model.add_variable("lambda_t", (p.dim - 1) * m)
    model.add_initialized_data("r", [settings["r"] * p.E])
    model.add_initialized_data("friction", [p.mu])
    model.add_initialized_data("gap", p.gaps)
    model.add_initialized_data("alpha", p.area)
    model.add_initialized_data("gamma", [-1.0])  # the slip is that of u + gamma before
    model.add_initialized_fem_data("before", mf, np.zeros(mf.nbdof()))
    model.add_basic_contact_brick(
        "u", "lambda_n", "lambda_t", "r", normal, tangent, "friction", "gap", "alpha",
        settings["version"], "gamma", "before",
    )  # fmt: skip
    return frame


def solve(p, settings):
    gf.util("trace level", 0)
    gf.util("warning level", 0)
    begun = time.perf_counter()
    mesh, mf, mim, first = spaces(p)
    dofs = first[:, None] + np.arange(p.dim)
    model = gf.Model("real")
    model.add_fem_variable("u", mf)
    for part, (young, cells) in enumerate(p.materials, start=1):
        lmbda, mu = f"lmbda{part}", f"mu{part}"
        model.add_initialized_data(lmbda, [young * p.nu / ((1 + p.nu) * (1 - 2 * p.nu))])
        model.add_initialized_data(mu, [young / (2 * (1 + p.nu))])
        mesh.set_region(part, np.array([cells, np.full(len(cells), -1)]))
        model.add_isotropic_linearized_elasticity_brick(mim, "u", lmbda, mu, part)
    selected = gf.Spmat("empty", len(p.held), mf.nbdof())
    for i, dof in enumerate(dofs.reshape(-1)[p.held]):
        selected.add(i, int(dof), 1.0)
    model.add_variable("support", len(p.held))
    held = model.add_constraint_with_multipliers("u", "support", selected, p.values[0])
    load = model.add_explicit_rhs("u", np.zeros(mf.nbdof()))
    frame = add_contact(model, p, mf, dofs, settings)
    if p.density:  # the mean acceleration, and at rest to begin with
        model.add_Newmark_scheme("u", *settings["newmark"])
        model.add_initialized_data("density", [p.density])
        model.add_mass_brick(mim, "Dot2_u", "density")
        model.set_time_step(p.dt)
        vector = np.zeros(mf.nbdof())
        vector[dofs] = p.loads[0]
        model.set_private_rhs(load, vector)
        model.perform_init_time_derivative(p.dt / 20)
        model.solve()
    u = []
    forces = []
    iterations = 0
    good = True
    tolerance = settings["residual"]
    if settings["relative"]:
        tolerance *= np.abs(p.loads).max() or 1.0
    for step in range(p.steps):
        vector = np.zeros(mf.nbdof())
        vector[dofs] = p.loads[step]
        model.set_private_rhs(load, vector)
        model.set_private_rhs(held, p.values[step])
        if p.density:
            model.shift_variables_for_time_integration()
        more, converged = model.solve("max_res", tolerance, *settings["solve"])
        iterations += int(more)
        good = good and bool(converged)
        now = model.variable("u")
        model.set_variable("before", now)
        u.append(now[dofs])
        shear = model.variable("lambda_t").reshape(-1, p.dim - 1) @ frame
        forces.append(shear - model.variable("lambda_n")[:, None] * p.normal)
    seconds = time.perf_counter() - begun
    record = {
        "version": debian_version("python3-getfem"),
        "says": "converged" if good else "did not converge",
        "converged": good,
        "iterations": iterations,
        "seconds": seconds,
    }
    return np.stack(u), np.stack(forces), record


if __name__ == "__main__":
    run(solve)
