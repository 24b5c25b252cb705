# SPDX-License-Identifier: LGPL-3.0-or-later
"""This package, by its public names."""

from __future__ import annotations

import time

from mpi4py import MPI

import numpy as np
from answers import run

import basix.ufl
import ufl
from dolfinx import fem, mesh

import dolfinx_contact
from dolfinx_contact import ContactPair, ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import LinearElastic

#: Names of cells, and DOLFINx's order of their nodes.
CELLS = {
    "tri3": ("triangle", [0, 1, 2]),
    "quad4": ("quadrilateral", [0, 1, 3, 2]),
    "hex8": ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6]),
}


class Body:
    """The mesh of a problem in DOLFINx, and which of its numbers are which."""

    def __init__(self, p):
        name, order = CELLS[p.kind]
        element = basix.ufl.element("Lagrange", name, 1, shape=(p.dim,))
        cells = p.cells[:, order].astype(np.int64)
        self.mesh = mesh.create_mesh(MPI.COMM_SELF, cells, p.x, ufl.Mesh(element))
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (p.dim,)))
        self._inputs = np.asarray(self.mesh.geometry.input_global_indices)
        self.dof = np.empty(len(p.x), dtype=np.int32)  # block of a node
        self.dof[self._inputs[self.mesh.geometry.dofmap]] = self.V.dofmap.list
        tdim = self.mesh.topology.dim
        self.mesh.topology.create_connectivity(tdim - 1, tdim)
        facets = mesh.exterior_facet_indices(self.mesh.topology)
        nodes = mesh.entities_to_geometry(self.mesh, tdim - 1, facets, False)
        keys = np.sort(self._inputs[nodes], axis=1)
        self._facet = {tuple(key): f for key, f in zip(keys, facets, strict=True)}

    def facets(self, faces):
        """Facets of faces that are given by nodes."""
        return np.array([self._facet[tuple(f)] for f in np.sort(faces, axis=1)], dtype=np.int32)

    def by_cells(self, values):
        """A Function that is constant on cells, of values of these (c,)."""
        constants = fem.functionspace(self.mesh, ("Discontinuous Lagrange", 0))
        function = fem.Function(constants)
        cells = constants.dofmap.list[:, 0]
        function.x.array[cells] = values[self.mesh.topology.original_cell_index]
        return function

    def nodal(self, u):
        """Values of a Function at the nodes (n, dim)."""
        return u.x.array.reshape(-1, self.V.dofmap.index_map_bs)[self.dof]


def conditions(p, body):
    """Dirichlet data, and the Constants with the columns of ``values`` that they follow."""
    groups = {}
    for j, dof in enumerate(p.held):
        groups.setdefault((dof % p.dim, *p.values[:, j]), []).append(j)
    bcs = []
    constants = []
    for (component, *_), columns in groups.items():
        constant = fem.Constant(body.mesh, 0.0)
        dofs = p.dim * body.dof[p.held[columns] // p.dim] + component
        dofs = np.sort(dofs).astype(np.int32)
        bcs.append(fem.dirichletbc(constant, dofs, body.V.sub(int(component))))
        constants.append((constant, columns[0]))
    return bcs, constants


def residual_of(p, body, u):
    """The form of the body and its loads, and the Constants of the tractions."""
    v = ufl.TestFunction(body.V)
    material = LinearElastic.from_young(p.E, p.nu)
    times = body.by_cells(p.times) if len(p.times) else 1
    residual = times * ufl.inner(material.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    if p.body_force.any():
        residual -= ufl.dot(fem.Constant(body.mesh, p.body_force), v) * ufl.dx
    tractions = []
    if len(p.faces):
        facets = body.facets(p.faces)
        order = np.argsort(facets)
        tags = mesh.meshtags(
            body.mesh, p.dim - 1, facets[order], p.tags[order].astype(np.int32) + 1
        )
        ds = ufl.Measure("ds", body.mesh, subdomain_data=tags)
        for tag in range(p.tractions.shape[1]):
            tractions.append(fem.Constant(body.mesh, np.zeros(p.dim)))
            residual -= ufl.dot(tractions[-1], v) * ds(tag + 1)
    return residual, tractions


def made(p, settings):
    """The contact problem, its body, and a function that sets the data of a step."""
    body = Body(p)
    u = fem.Function(body.V)
    bcs, constants = conditions(p, body)
    residual, tractions = residual_of(p, body, u)
    facets = body.facets(p.contact_faces)
    if len(p.master_faces):
        master = body.facets(p.master_faces)
        surface = ContactPair(u, facets, law=Coulomb(p.mu), master_facets=master, normal=-p.normal)
    else:
        plane = HalfSpace(p.point, p.normal)
        surface = ContactSurface(u, facets, obstacle=plane, law=Coulomb(p.mu))

    def load(step):
        step = round(step)
        for constant, column in constants:
            constant.value = p.values[step, column]
        for tag, traction in enumerate(tractions):
            traction.value[:] = p.tractions[step, tag]

    load(0)
    problem = ContactProblem(residual, u, [surface], bcs=bcs, **settings)
    return problem, body, load


def forces_of(p, table):
    """Contact forces of a table at the contact nodes (m, dim)."""
    away = np.linalg.norm(p.x[p.contact][:, None] - table.x[None, :, : p.dim], axis=2)
    return table.force[away.argmin(axis=1)]


def solve(p, settings):
    begun = time.perf_counter()
    problem, body, load = made(p, settings)
    found, u = [], []

    def keep(step):
        u.append(body.nodal(problem.u))
        found.append(step.result)

    if p.density:
        end = p.dt * p.steps
        NSCD(problem, p.density, dt=p.dt).run([0.0, end], observer=keep, progress=False)
    else:
        found.append(problem.solve())
        u.append(body.nodal(problem.u))
    if p.steps > 1 and not p.density:
        times = np.arange(p.steps, dtype=float)
        QuasiStatic(problem, load).run(times, sudden=np.inf, observer=keep, progress=False)
    seconds = time.perf_counter() - begun
    forces = np.stack([forces_of(p, r.tables["contact"]) for r in found])
    record = {
        "version": dolfinx_contact.__version__,
        "says": found[-1].reason,
        "converged": all(bool(r.converged) for r in found),
        "iterations": int(sum(r.iterations for r in found)),
        "seconds": seconds,
        "unique": found[-1].unique,
    }
    return np.stack(u), forces, record


if __name__ == "__main__":
    run(solve)
