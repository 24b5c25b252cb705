"""Two bodies of one row each that stick where their nodes cannot move: the forces are by hand.

The upper one hangs at its held top, the lower lies on its held bottom, friction 20 between them;
the interface is two rows of nodes. Compared with the same body in one piece, glued.
"""

import numpy as np
from bodies import block

import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import LinearProblem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials, meshing


def attack(case):
    lower, upper = (block(case.comm, (3, 1), (1.0, 0.5), "quadrilateral") for _ in range(2))
    upper.domain.geometry.x[:, 1] += 0.5
    body = meshing.join([lower.domain, upper.domain])
    tags = body.cell_tags

    def facets(y, tag):
        found = mesh.locate_entities_boundary(body.mesh, 1, lambda x: np.isclose(x[1], y))
        body.mesh.topology.create_connectivity(1, 2)
        cells = body.mesh.topology.connectivity(1, 2)
        kind = {int(c): int(v) for c, v in zip(tags.indices, tags.values, strict=True)}
        return np.array([f for f in found if kind[int(cells.links(f)[0])] == tag], dtype=np.int32)

    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    steel = materials.LinearElastic.from_young(100.0, 0.3)
    force = fem.Constant(body.mesh, (0.2, -1.0))
    energy = steel.energy(u) * ufl.dx - ufl.dot(force, u) * ufl.dx
    press = fem.Function(V)
    top = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1))
    press.interpolate(lambda x: np.stack([0.0 * x[0], -0.02 + 0 * x[0]]))
    below = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 0))
    bcs = [fem.dirichletbc(press, top), fem.dirichletbc(np.zeros(2), below, V)]
    pair = ContactPair(
        u, facets(0.5, 2), master_facets=facets(0.5, 1), law=Coulomb(20.0), method="nodal"
    )
    problem = ContactProblem(energy, u, [pair], bcs=bcs)

    whole = block(case.comm, (3, 2), (1.0, 1.0), "quadrilateral")
    glued = steel.energy(whole.u) * ufl.dx
    glued -= ufl.dot(fem.Constant(whole.domain, (0.2, -1.0)), whole.u) * ufl.dx
    whole.moved.interpolate(lambda x: np.stack([0.0 * x[0], -0.02 + 0 * x[0]]))
    du = ufl.TrialFunction(whole.V)
    v = ufl.TestFunction(whole.V)
    zero = fem.locate_dofs_topological(whole.V, 1, whole.bottom)
    held = [*whole.bcs, fem.dirichletbc(np.zeros(2), zero, whole.V)]
    F = ufl.derivative(glued, whole.u, v)
    a = ufl.derivative(F, whole.u, du)
    L = -ufl.replace(F, {whole.u: 0 * whole.u})
    right = LinearProblem(a, L, bcs=held).solve()
    middle = fem.assemble_scalar(fem.form(ufl.dot(right, right) * ufl.dx))
    middle = case.comm.allreduce(middle)
    for algorithm in ("newton", "lemke", "gauss-seidel"):
        u.x.array[:] = 0.0
        result = problem.solve(algorithm=algorithm)
        found = case.comm.allreduce(fem.assemble_scalar(fem.form(ufl.dot(u, u) * ufl.dx)))
        case.equal(f"{algorithm}: |u|^2", found, middle, 1e-6)
        case.true(f"{algorithm} sticks", set(result.tables["contact"].letters) == {"k"})
