"""Two triangles on the floor, of other masses and stiffnesses, each with one node that slips.

Both slip to the left beyond their critical friction, so that each leaves by itself: the growth is
the larger one of lambda^2 = (F S_nt - S_tt) / m. With the friction of one below it, it is that of
the other, wherever it is in the mesh.
"""

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials, meshing
from dolfinx_contact.analysis import stability_at_rest


def triangle(comm, at):
    corners = np.array([[at, 0.0], [at + 1.0, 0.0], [at, 1.0]])
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    cells = np.array([[0, 1, 2]]) if comm.rank == 0 else np.zeros((0, 3), dtype=np.int64)
    x = corners if comm.rank == 0 else corners[:0]
    return mesh.create_mesh(comm, cells=cells, x=x, e=element)


def attack(case):
    both = meshing.join([triangle(case.comm, at) for at in (0.0, 5.0)])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    x = ufl.SpatialCoordinate(domain)
    dx = ufl.Measure("dx", domain, subdomain_data=both.cell_tags)
    stiff = ufl.conditional(x[0] < 3, 1.0, 10.0)
    friction = fem.Constant(domain, 3.0), fem.Constant(domain, 2.2)
    F = ufl.conditional(x[0] < 3, *friction)
    load = [fem.Constant(domain, (0.0, 0.0)) for _ in range(2)]
    energy = materials.LinearElastic(100.0 * stiff, 82.0 * stiff).energy(u) * dx
    energy -= sum(ufl.dot(p, u) * dx(i) for i, p in enumerate(load, 1))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    slope = mesh.locate_entities_boundary(
        domain, 1, lambda x: np.isclose(x[0] + x[1], 1) | np.isclose(x[0] + x[1], 6)
    )
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(F))
    problem = ContactProblem(energy, u, [contact], bcs=[held])
    rho = ufl.conditional(x[0] < 3, 4.0, 1.0)
    for given in ((3.0, 2.2), (1.0, 2.2), (3.0, 1.0), (1.5, 1.2)):
        leaves = []
        for k, (own, part, density) in enumerate(zip(given, (1.0, 10.0), (4.0, 1.0), strict=True)):
            friction[k].value = own
            S_tt = 173.0 * part
            S_nt = 91.0 * part
            slip = -0.01
            load[k].value[:] = 6 * np.array([S_tt * slip - 9 * own, S_nt * slip - 9])
            leaves.append((own * S_nt - S_tt) / (density * 0.5 / 6))
        u.interpolate(lambda x: np.stack([-0.01 * (x[1] < 0.1) * (x[0] % 5 < 0.1), 0 * x[0]]))
        table = problem.solve().tables["contact"]
        letters = table.status.replace("d", "")
        answer = stability_at_rest(problem, density=rho)
        most = max([v for v, letter in zip(leaves, letters, strict=True) if letter != "k"] + [0])
        if most > 0:
            case.true(f"{given}: unstable, not {answer.label}", answer.label == "unstable")
            case.equal("growth", answer.growth, np.sqrt(most))
        else:
            case.true(f"{given} {letters}: stable, not {answer.label}", answer.label == "stable")
