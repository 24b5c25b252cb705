# SPDX-License-Identifier: LGPL-3.0-or-later
"""Proximal Galerkin methods next to semismooth Newton, without friction.

The latent variable proximal point algorithm (Keith and Surowiec, Found. Comput. Math. 2024;
Dokken, Farrell, Keith, Papadopoulos and Surowiec, Comput. Methods Appl. Mech. Engng 445, 2025)
replaces the inequality u.n <= g by u.n + exp(psi) = g with a latent variable psi on the contact
face, and solves a smooth problem for each proximal parameter alpha_k. This script is written from
these equations, with the parameters of the authors' Signorini example: alpha_k = 0.005 2^k
for k = 1, 2, ..., P2 for displacement and latent variable, tolerance 1e-6 for Newton's method (1e-5
in the first step) and for the change of the displacement.

A unit square or cube (E = 2e4, nu = 0.3) is pressed by a tenth of its height on a rigid
paraboloid of radius 2. Both methods have the same mesh, displacement space, normal (vertical) and
direct solver (MUMPS). Serial. For each solution:

- `penetration`: largest penetration on a fine grid of points of the face, over the motion;
- `violation`: Signorini's conditions at the vertices, for the means of the gap weighted with the
  hat functions and the projection of the pressure onto these functions: the largest of -gap,
  -pressure and min(gap, pressure), gaps over the motion and pressures over the largest one;
- `seconds`: processor time of a second solve on the same mesh, so that all forms are compiled.

`starts` solves the square of 16 cells from other displacements and latent variables.

    python3 benchmarks/public/proximal_galerkin.py
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem, geometry, mesh
from dolfinx.fem import petsc

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_SELF
YOUNG = 2e4
NU = 0.3
PRESS = 0.1
RADIUS = 2.0


class Block:
    """A square or cube with its displacement space, load and contact face."""

    def __init__(self, dim, n, degree=2):
        if dim == 2:
            self.mesh = mesh.create_unit_square(COMM, n, n)
        else:
            self.mesh = mesh.create_unit_cube(COMM, n, n, n)
        self.dim = dim
        self.V = fem.functionspace(self.mesh, ("Lagrange", degree, (dim,)))
        self.u = fem.Function(self.V)
        self.mesh.topology.create_connectivity(dim - 1, dim)
        self.top = self._facets(1.0)
        self.bottom = self._facets(0.0)
        self.energy = LinearElastic.from_young(YOUNG, NU).energy(self.u) * ufl.dx
        value = np.zeros(dim)
        value[-1] = -PRESS
        dofs = fem.locate_dofs_topological(self.V, dim - 1, self.top)
        self.bcs = [fem.dirichletbc(value, dofs, self.V)]
        x = ufl.SpatialCoordinate(self.mesh)
        self.gap = self._height(x)

    def _facets(self, height):
        d = self.dim - 1
        return mesh.locate_entities_boundary(self.mesh, d, lambda x: np.isclose(x[d], height))

    def _height(self, x):
        """Initial distance of points of the face from the paraboloid."""
        return sum((x[i] - 0.5) ** 2 for i in range(self.dim - 1)) / (2 * RADIUS)

    def penetration(self, per_edge=200):
        """Largest penetration on a grid of points of the face."""
        t = np.linspace(0.0, 1.0, per_edge + 1)
        grid = np.meshgrid(*[t] * (self.dim - 1))
        points = np.zeros((grid[0].size, 3))
        for axis, values in enumerate(grid):
            points[:, axis] = values.reshape(-1)
        tree = geometry.bb_tree(self.mesh, self.dim)
        near = geometry.compute_collisions_points(tree, points)
        cells = geometry.compute_colliding_cells(self.mesh, near, points)
        first = cells.array[cells.offsets[:-1]]
        normal = -self.u.eval(points, first)[:, -1]
        return float(np.max(normal - self._height(points.T)))

    def violation(self):
        """Largest violation of Signorini's conditions at the vertices, from displacements alone."""
        d = self.dim - 1
        hats = fem.functionspace(self.mesh, ("Lagrange", 1))
        hat, trial = ufl.TestFunction(hats), ufl.TrialFunction(hats)
        ones = np.ones(len(self.bottom), np.int32)
        tags = mesh.meshtags(self.mesh, d, np.sort(self.bottom), ones)
        ds = ufl.Measure("ds", self.mesh, subdomain_data=tags, metadata={"quadrature_degree": 4})(1)
        up = ufl.as_vector([0.0] * d + [hat])
        work = ufl.derivative(self.energy, self.u, up)
        forms = (hat * ds, (self.u[d] + self.gap) * hat * ds, work)
        vertices = fem.locate_dofs_topological(hats, d, self.bottom)
        area, gap, force = (petsc.assemble_vector(fem.form(f)).array[vertices] for f in forms)
        mass = fem.assemble_matrix(fem.form(hat * trial * ds)).to_scipy()
        pressure = np.linalg.solve(mass[np.ix_(vertices, vertices)].toarray(), force)
        gap = gap / area / PRESS
        pressure = pressure / pressure.max()
        return float(np.max([-gap, -pressure, np.minimum(gap, pressure)]))

    def force(self):
        """Vertical force on the clamped top, from the residual of the body."""
        residual = petsc.assemble_vector(fem.form(ufl.derivative(self.energy, self.u)))
        dofs = self.bcs[0].dof_indices()[0]
        return float(-residual.array[dofs[dofs % self.dim == self.dim - 1]].sum())


def proximal(block, first=0.005, tolerance=1e-6, latent_degree=2, latent=0.0):
    """Solve by proximal steps; return the Newton steps of each.

    Args:
        block: body, whose displacement is the start and is overwritten.
        first: alpha_0; step k = 1, 2, ... has the proximal parameter alpha_0 2^k.
        tolerance: for Newton's method and for the change of the displacement.
        latent_degree: degree of the latent variable.
        latent: constant start of the latent variable.
    """
    domain = block.mesh
    d = block.dim - 1
    face, to_parent = mesh.create_submesh(domain, d, block.bottom)[:2]
    index_map = domain.topology.index_map(d)
    to_face = np.full(index_map.size_local, -1)
    to_face[to_parent] = np.arange(len(to_parent))
    maps = {face: to_face}
    tags = mesh.meshtags(domain, d, np.sort(block.bottom), np.ones(len(block.bottom), np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags, metadata={"quadrature_degree": 4})(1)
    W = fem.functionspace(face, ("Lagrange", latent_degree))
    u = block.u
    psi = fem.Function(W)
    before = fem.Function(W)
    psi.x.array[:] = before.x.array[:] = latent
    alpha = fem.Constant(domain, PETSc.ScalarType(first))
    Q = ufl.MixedFunctionSpace(block.V, W)
    v, w = ufl.TestFunctions(Q)
    du, dpsi = ufl.TrialFunctions(Q)
    energy = ufl.derivative(block.energy, u, v)
    residual = alpha * energy + (psi - before) * v[d] * ds
    residual += (-u[d] + ufl.exp(psi) - block.gap) * w * ds
    jacobian = ufl.derivative(residual, u, du) + ufl.derivative(residual, psi, dpsi)
    F = fem.form(ufl.extract_blocks(residual), entity_maps=maps)
    J = fem.form(ufl.extract_blocks(jacobian), entity_maps=maps)
    b = petsc.create_vector_block(F)
    A = petsc.create_matrix_block(J)
    x = b.duplicate()
    solver = PETSc.KSP().create(COMM)
    solver.setOperators(A)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    size = len(u.x.array)

    def newton(limit):
        for steps in range(250):
            state = np.concatenate([u.x.array, psi.x.array])
            x.setArray(state)
            with b.localForm() as local:
                local.set(0.0)
            petsc.assemble_vector_block(b, F, J, bcs=block.bcs, x0=x, alpha=-1.0)
            norm = b.norm()
            if not np.isfinite(norm):
                raise RuntimeError("Newton's method diverged")
            if steps == 0:
                start = norm
            if norm <= max(limit, limit * start):
                return steps
            A.zeroEntries()
            petsc.assemble_matrix_block(A, J, bcs=block.bcs)
            A.assemble()
            solver.solve(b, x)
            u.x.array[:] -= x.array[:size]
            psi.x.array[:] -= x.array[size:]
        raise RuntimeError("Newton's method did not converge in 250 steps")

    counts = []
    old = u.x.array.copy()
    for k in range(1, 26):
        alpha.value = first * 2**k
        counts.append(newton(10 * tolerance if k == 1 else tolerance))
        change = np.linalg.norm(u.x.array - old)
        old = u.x.array.copy()
        before.x.array[:] = psi.x.array
        if change <= tolerance:
            break
    return counts


def ours(block, method=None, solver="direct"):
    """Solve by semismooth Newton; return the result."""
    x = ufl.SpatialCoordinate(block.mesh)
    height = -block._height(x)
    up = np.zeros(block.dim)
    up[-1] = 1.0
    point = ufl.as_vector([0.0] * (block.dim - 1) + [height])
    floor = HalfSpace(point=point, normal=up)
    options = {} if method is None else {"method": method}
    surface = ContactSurface(block.u, block.bottom, obstacle=floor, law=Frictionless(), **options)
    linear = {"linear_solver": solver}
    problem = ContactProblem(block.energy, block.u, [surface], bcs=block.bcs, petsc_options=linear)
    return problem.solve()


def starts(n=16):
    """Print the Newton steps from other starts; a start is a displacement and a latent variable."""
    random = np.random.default_rng(1)
    places = {
        "zero": lambda u: 0.0 * u,
        "lowered by the motion": lambda u: np.tile([0.0, -PRESS], len(u) // 2),
        "random, up to the motion": lambda u: random.uniform(-PRESS, PRESS, len(u)),
    }
    methods = {"Newton, default": lambda block: [ours(block).iterations]}
    for latent in (0.0, -5.0, 5.0):
        name = f"proximal Galerkin, psi_0 = {latent}"
        methods[name] = lambda block, latent=latent: proximal(block, latent=latent)
    rows = []
    for method, solve in methods.items():
        for place, start in places.items():
            block = Block(2, n)
            block.u.x.array[:] = start(block.u.x.array)
            record = {"method": method, "start": place}
            try:
                record["newton_steps"] = sum(solve(block))
                record["force"] = block.force()
            except RuntimeError as error:
                record["failed"] = str(error)
            rows.append(record)
            print(", ".join(f"{k} {v}" for k, v in record.items()), flush=True)
    return rows


def solved(solve, dim, n):
    """Solve twice on one mesh; return the record of the second solve."""
    for _ in range(2):
        block = Block(dim, n)
        begun = time.process_time()
        try:
            found = solve(block)
        except RuntimeError as error:
            return {"failed": str(error)}
        seconds = time.process_time() - begun
    steps = found if isinstance(found, list) else [found.iterations]
    return {
        "newton_steps": sum(steps),
        "proximal_steps": len(steps),
        "force": block.force(),
        "penetration": block.penetration() / PRESS,
        "violation": block.violation(),
        "seconds": seconds,
    }


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", nargs="*", type=int, default=[8, 16, 32])
    parser.add_argument("--cells-3d", nargs="*", type=int, default=[4, 8])
    parser.add_argument("--output", type=Path)
    args = parser.parse_args(argv)
    records = []
    runs = {
        f"proximal Galerkin, alpha_0 = {first}": lambda b, first=first: proximal(b, first)
        for first in (0.005, 1e-4, 0.02, 0.1, 1.0)
    }
    runs["proximal Galerkin, latent P1"] = lambda b: proximal(b, latent_degree=1)
    runs["Newton, default"] = ours
    runs["Newton, default, automatic linear solver"] = lambda b: ours(b, solver="auto")
    runs["Newton, integral"] = lambda b: ours(b, "integral")
    for dim, levels in ((2, args.cells), (3, args.cells_3d)):
        for n in levels:
            for name, solve in runs.items():
                record = {"dim": dim, "n": n, "method": name, **solved(solve, dim, n)}
                records.append(record)
                print(", ".join(f"{k} {v}" for k, v in record.items()), flush=True)
    found = {"meshes": records, "starts": starts()}
    if args.output:
        args.output.write_text(json.dumps(found, indent=1))
    return found


if __name__ == "__main__":
    main()
