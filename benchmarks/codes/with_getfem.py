# SPDX-License-Identifier: LGPL-3.0-or-later
"""GetFEM: nodal contact by multipliers, Newton on the augmented equations.

Of two bodies it is that of nodes with the faces below them at rest: the matrices of its basic
contact brick have the displacements of both.

Settings: ``r``, the augmentation over Young's modulus; ``version``, of the augmented equations (1:
unsymmetric, Alart and Curnier; 3: with augmented multipliers); ``solve``, words for `Model.solve`;
``newmark``, beta and gamma of Newmark's scheme in a motion; ``residual``, to which it solves, and
whether that is ``relative`` to the largest nodal load; ``release``, the distance in which its
raytracing finds bodies that slide far. The loads of a step are not cut;
friction in a history is by the displacement of the step before.
"""

from __future__ import annotations

import getfem as gf
import numpy as np
from answers import debian_version, processor_time, run
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
    """Places of nodes (n, dim), bodies moved apart: GetFEM joins nodes at one place.

    Bodies that slide far are where they are, since they do not touch to begin with.
    """
    if p.law:
        return p.x
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


#: Energies by the names of the judge, of F in the plane.
ENERGIES = {
    "iso1": "mu/2*((Norm_sqr(F)+1)*pow(J,-2/3)-3)+(lmbda/2+mu/3)*sqr(J-1)",
    "log": "mu/2*(Norm_sqr(F)-2-2*log(J))+lmbda/2*sqr(log(J))",
}


def add_bodies_that_slide(model, p, mesh, mf, mim, settings):
    """Hyperelastic bodies, and the brick of contact with friction by raytracing.

    Both bodies are in one mesh and one displacement, at their places here. What is returned has to
    be kept as long as the model.
    """
    for part, (young, cells) in enumerate(p.materials, start=1):
        mesh.set_region(part, np.array([cells, np.full(len(cells), -1)]))
        lmbda, mu = young * p.nu / ((1 + p.nu) * (1 - 2 * p.nu)), young / (2 * (1 + p.nu))
        energy = ENERGIES[p.law].replace("lmbda", repr(float(lmbda)))
        energy = energy.replace("mu", repr(float(mu)))
        energy = energy.replace("F", "(Id(2)+Grad_u)").replace("J", "Det(Id(2)+Grad_u)")
        model.add_nonlinear_term(mim, energy, part)
    slave, master = len(p.materials) + 1, len(p.materials) + 2
    mesh.set_region(slave, faces_of(p, mesh, p.contact_faces))
    mesh.set_region(master, faces_of(p, mesh, p.master_faces))
    multipliers = gf.MeshFem(mesh, p.dim)
    multipliers.set_classical_fem(1)
    model.add_filtered_fem_variable("lambda", multipliers, slave)
    model.add_initialized_data("r", [settings["r"] * p.E])
    model.add_initialized_data("friction", [p.mu])
    model.add_initialized_data("alpha", [1.0])
    model.add_fem_data("before", mf)
    release = settings["release"]
    brick = model.add_integral_large_sliding_contact_brick_raytracing(
        "r", release, "friction", "alpha", 0
    )
    where = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(2,4)"))
    model.add_slave_contact_boundary_to_large_sliding_contact_brick(
        brick, where, slave, "u", "lambda", "before"
    )
    model.add_master_contact_boundary_to_large_sliding_contact_brick(
        brick, where, master, "u", "before"
    )
    return multipliers, where


def faces_of(p, mesh, faces):
    """GetFEM's cells and faces (2, f), of faces that are given by nodes."""
    wanted = {tuple(np.round(p.x[list(f)].mean(axis=0), 9)) for f in faces}
    x, outer = mesh.pts(), mesh.outer_faces()
    found = []
    for cell, face in outer.T:
        nodes = mesh.pid_in_faces([[cell], [face]])
        if tuple(np.round(x[:, nodes].mean(axis=1), 9)) in wanted:
            found.append((cell, face))
    if len(found) != len(faces):
        raise ValueError("not all faces are those of cells")
    return np.array(found).T


def add_bodies(model, p, mesh, mim):
    """Linear elastic bodies."""
    for part, (young, cells) in enumerate(p.materials, start=1):
        lmbda, mu = f"lmbda{part}", f"mu{part}"
        model.add_initialized_data(lmbda, [young * p.nu / ((1 + p.nu) * (1 - 2 * p.nu))])
        model.add_initialized_data(mu, [young / (2 * (1 + p.nu))])
        mesh.set_region(part, np.array([cells, np.full(len(cells), -1)]))
        model.add_isotropic_linearized_elasticity_brick(mim, "u", lmbda, mu, part)


def vector_of(mf, dofs, values):
    """The vector of nodal values (n, dim)."""
    vector = np.zeros(mf.nbdof())
    vector[dofs] = values
    return vector


def begin_motion(model, p, mim, load, vector, settings):
    """Newmark's scheme, from rest, with the mean acceleration under the first load."""
    model.add_Newmark_scheme("u", *settings["newmark"])
    model.add_initialized_data("density", [p.density])
    model.add_mass_brick(mim, "Dot2_u", "density")
    model.set_time_step(p.dt)
    model.set_private_rhs(load, vector)
    model.perform_init_time_derivative(p.dt / 20)
    model.solve()


def solve(p, settings):
    gf.util("trace level", 0)
    gf.util("warning level", 0)
    begun = processor_time()
    mesh, mf, mim, first = spaces(p)
    dofs = first[:, None] + np.arange(p.dim)
    model = gf.Model("real")
    model.add_fem_variable("u", mf)
    if not p.law:
        add_bodies(model, p, mesh, mim)
    selected = gf.Spmat("empty", len(p.held), mf.nbdof())
    for i, dof in enumerate(dofs.reshape(-1)[p.held]):
        selected.add(i, int(dof), 1.0)
    model.add_variable("support", len(p.held))
    held = model.add_constraint_with_multipliers("u", "support", selected, p.values[0])
    load = model.add_explicit_rhs("u", np.zeros(mf.nbdof()))
    if p.law:
        _kept = add_bodies_that_slide(model, p, mesh, mf, mim, settings)
    else:
        frame = add_contact(model, p, mf, dofs, settings)
    if p.density:
        begin_motion(model, p, mim, load, vector_of(mf, dofs, p.loads[0]), settings)
    u = []
    forces = []
    iterations = 0
    good = []
    tolerance = settings["residual"]
    if settings["relative"]:
        tolerance *= np.abs(p.loads).max() or 1.0
    for step in range(p.steps):
        model.set_private_rhs(load, vector_of(mf, dofs, p.loads[step]))
        model.set_private_rhs(held, p.values[step])
        if p.density:
            model.shift_variables_for_time_integration()
        more, converged = model.solve("max_res", tolerance, *settings["solve"])
        iterations += int(more)
        good.append(bool(converged))
        now = model.variable("u")
        model.set_variable("before", now)
        u.append(now[dofs])
        if p.law:
            continue
        shear = model.variable("lambda_t").reshape(-1, p.dim - 1) @ frame
        forces.append(shear - model.variable("lambda_n")[:, None] * p.normal)
    seconds = processor_time() - begun
    record = {
        "version": debian_version("python3-getfem"),
        "says": "converged" if all(good) else "did not converge",
        "converged": all(good),
        "steps": sum(good),
        "iterations": iterations,
        "seconds": seconds,
    }
    if p.law:
        record["law"] = p.law
    return np.stack(u), np.stack(forces) if forces else None, record


if __name__ == "__main__":
    run(solve)
