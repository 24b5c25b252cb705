# SPDX-License-Identifier: LGPL-3.0-or-later
"""This package, by its public names, on as many ranks as it is run with.

Settings: ``law``, the elastic law if it is not the problem's; others are those of `ContactProblem`.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from answers import processor_time, run
from scipy.spatial import cKDTree

import basix.ufl
import ufl
from dolfinx import fem, mesh

import dolfinx_contact
from dolfinx_contact import ContactPair, ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD

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
        own = slice(None) if COMM.rank == 0 else slice(0)  # the first rank has the input
        cells = p.cells[own, order].astype(np.int64)
        self.mesh = mesh.create_mesh(COMM, cells=cells, x=p.x[own], e=ufl.Mesh(element))
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (p.dim,)))
        self._inputs = np.asarray(self.mesh.geometry.input_global_indices)
        self.dof = np.full(len(p.x), -1, dtype=np.int32)  # block of a node; -1: of other ranks
        self.dof[self._inputs[self.mesh.geometry.dofmap]] = self.V.dofmap.list
        tdim = self.mesh.topology.dim
        self.mesh.topology.create_connectivity(tdim - 1, tdim)
        facets = mesh.exterior_facet_indices(self.mesh.topology)
        nodes = mesh.entities_to_geometry(self.mesh, tdim - 1, facets, False)
        keys = np.sort(self._inputs[nodes], axis=1)
        self._facet = {tuple(key): f for key, f in zip(keys, facets, strict=True)}

    def facets(self, faces):
        """Facets of faces that are given by nodes; -1: of other ranks."""
        found = [self._facet.get(tuple(f), -1) for f in np.sort(faces, axis=1)]
        return np.array(found, dtype=np.int32)

    def own_facets(self, faces):
        """The same, without those of other ranks."""
        found = self.facets(faces)
        return found[found >= 0]

    def by_cells(self, values):
        """A Function that is constant on cells, of values of these (c,)."""
        constants = fem.functionspace(self.mesh, ("Discontinuous Lagrange", 0))
        function = fem.Function(constants)
        cells = constants.dofmap.list[:, 0]
        function.x.array[cells] = values[self.mesh.topology.original_cell_index]
        return function

    def nodal(self, u):
        """Values of a Function at the nodes (n, dim), of all ranks."""
        index = self.V.dofmap.index_map
        own = (self.dof >= 0) & (self.dof < index.size_local)
        values = np.zeros((len(self.dof), self.V.dofmap.index_map_bs))
        values[own] = u.x.array.reshape(-1, self.V.dofmap.index_map_bs)[self.dof[own]]
        return COMM.allreduce(values)


def conditions(p, body):
    """Dirichlet data, and the Constants with the columns of ``values`` that they follow."""
    groups = {}
    for j, dof in enumerate(p.held):
        groups.setdefault((dof % p.dim, *p.values[:, j]), []).append(j)
    bcs = []
    constants = []
    for (component, *_), columns in groups.items():
        constant = fem.Constant(body.mesh, 0.0)
        blocks = body.dof[p.held[columns] // p.dim]
        dofs = np.sort(p.dim * blocks[blocks >= 0] + component).astype(np.int32)
        bcs.append(fem.dirichletbc(constant, dofs, body.V.sub(int(component))))
        constants.append((constant, columns[0]))
    return bcs, constants


def iso1(first, J, lmbda, mu):
    return mu / 2 * (J ** (-2 / 3) * first - 3) + (lmbda + 2 * mu / 3) / 2 * (J - 1) ** 2


def log(first, J, lmbda, mu):
    return mu / 2 * (first - 3 - 2 * ufl.ln(J)) + lmbda / 2 * ufl.ln(J) ** 2


#: Energies in plane strain, by the names of the judge.
ENERGIES = {"iso1": iso1, "log": log}


def stored(p, body, u, law):
    """The energy of hyperelastic bodies."""
    mu = p.E / (2 * (1 + p.nu))
    lmbda = p.E * p.nu / ((1 + p.nu) * (1 - 2 * p.nu))
    F = ufl.Identity(2) + ufl.grad(u)
    energy = ENERGIES[law](ufl.inner(F, F) + 1, ufl.det(F), lmbda, mu)
    return body.by_cells(p.times) * energy * ufl.dx(degree=3)  # two points a side


def residual_of(p, body, u, law):
    """The form of the body and its loads, and the Constants of the tractions."""
    if law:
        return stored(p, body, u, law), []
    v = ufl.TestFunction(body.V)
    material = LinearElastic.from_young(p.E, p.nu)
    times = body.by_cells(p.times) if len(p.times) else 1
    residual = times * ufl.inner(material.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    if p.body_force.any():
        residual -= ufl.dot(fem.Constant(body.mesh, p.body_force), v) * ufl.dx
    tractions = []
    if len(p.faces):
        facets = body.facets(p.faces)
        order = np.argsort(facets)[np.count_nonzero(facets < 0) :]
        tags = mesh.meshtags(
            body.mesh, p.dim - 1, facets[order], p.tags[order].astype(np.int32) + 1
        )
        ds = ufl.Measure("ds", body.mesh, subdomain_data=tags)
        for tag in range(p.tractions.shape[1]):
            tractions.append(fem.Constant(body.mesh, np.zeros(p.dim)))
            residual -= ufl.dot(tractions[-1], v) * ds(tag + 1)
    return residual, tractions


def made(p, settings, law=""):
    """The contact problem, its body, and a function that sets the data of a step."""
    body = Body(p)
    u = fem.Function(body.V)
    bcs, constants = conditions(p, body)
    residual, tractions = residual_of(p, body, u, law)
    facets = body.own_facets(p.contact_faces)
    if len(p.master_faces):
        master = body.own_facets(p.master_faces)
        how = {"sliding": "large"} if law else {"normal": -p.normal}
        surface = ContactPair(u, facets, law=Coulomb(p.mu), master_facets=master, **how)
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
    return table.force[cKDTree(table.x[:, : p.dim]).query(p.x[p.contact])[1]]


def solve(p, settings):
    begun = processor_time()
    settings = dict(settings)
    law = settings.pop("law", p.law)
    settings.pop("ranks", None)  # as many as there are
    problem, body, load = made(p, settings, law)
    found, u = [], []
    last = problem  # of the last step

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
        how = {"extrapolate": True, "rays": False} if law else {}
        start = problem.snapshot()
        evolution = QuasiStatic(problem, load)
        history = evolution.run(times, observer=keep, progress=False, **how)
        states = [start, *(step.state for step in history.steps)]
        last = problem.step_from(states[-2], step=1.0)
    seconds = COMM.allreduce(processor_time() - begun)
    forces = np.stack([forces_of(p, r.tables["contact"]) for r in found])
    record = {
        "version": dolfinx_contact.__version__,
        "says": found[-1].reason,
        "converged": all(bool(r.converged) for r in found),
        "steps": sum(bool(r.converged) for r in found),
        "iterations": int(sum(r.iterations for r in found)),
        "seconds": seconds,
        "unique": None if p.density else last.uniqueness().verdict,
    }
    if law:
        record["law"] = law
    return np.stack(u), forces, record


if __name__ == "__main__":
    run(solve, writes=COMM.rank == 0)
