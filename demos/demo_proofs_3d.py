# SPDX-License-Identifier: LGPL-3.0-or-later
# # All solutions of a body in 3D, with a proof
#
# This demo illustrates how to:
#
# - find all static solutions of a 3D body with Coulomb friction (`find_solutions`);
# - save the proof that there are no others, and check it with numpy alone.
#
# The triangle $(0, 0)$, $(1, 0)$, $(0, 1)$ in the plane of $x$ and $z$ is extruded along $y$ and
# clamped on its slope. A body force wedges it against the floor $z = 0$. Above a certain friction
# coefficient it has three or seven solutions: points of its sole open, stick, or slip, each in a
# direction of its own.
#
# The proof is a tree. At each point the directions of slip are divided into arcs. Multipliers of
# the equilibrium exclude arcs and statuses. The remaining regions are narrowed until a quadratic
# form or an interval matrix shows that a region contains exactly one solution, or none.

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
)
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.proofs import check

comm = MPI.COMM_WORLD
n, layers, depth = 2, 1, 0.5  # cells along an edge, cells across, and the depth of the body
friction = 2.0
body_force = (-1.0, 0.1, -0.5)

# ## The mesh
#
# Each prism over a triangle is cut into three tetrahedra, so that neighbours match.

place = {}
for layer in range(layers + 1):
    for j in range(n + 1):
        for i in range(n + 1 - j):
            place[i, j, layer] = len(place)
nodes = np.array([(i / n, depth * layer / layers, j / n) for i, j, layer in place])
triangles = [[(i, j), (i + 1, j), (i, j + 1)] for j in range(n) for i in range(n - j)]
triangles += [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for j in range(n) for i in range(n - 1 - j)]
cells = []
for layer in range(layers):
    for corners in triangles:
        a, b, c = sorted(place[i, j, layer] for i, j in corners)
        up = {place[i, j, layer]: place[i, j, layer + 1] for i, j in corners}
        cells += [[a, b, c, up[c]], [a, b, up[b], up[c]], [a, up[a], up[b], up[c]]]
cells = np.array(cells, dtype=np.int64)
if comm.rank > 0:
    nodes, cells = nodes[:0], cells[:0]
element = basix.ufl.element("Lagrange", "tetrahedron", 1, shape=(3,))
domain = mesh.create_mesh(comm, cells=cells, x=nodes, e=ufl.Mesh(element))

# ## The problem

V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
u = fem.Function(V, name="displacement")
gamma = fem.Constant(domain, 1.0)
force = fem.Constant(domain, body_force)
energy = LinearElastic(1.0, 1.0).energy(u) * ufl.dx - gamma * ufl.dot(force, u) * ufl.dx
slope = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[0] + x[2], 1.0))
sole = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
clamped = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, slope), V)
floor = HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
surface = ContactSurface(u, sole, obstacle=floor, law=Coulomb(friction))
problem = ContactProblem(energy, u, [surface], bcs=[clamped])
system = ParametricContact(problem, gamma)

# ## All solutions
#
# An independent prototype finds the same number of solutions for this body.

say = io.Report(comm)
found = find_solutions(system, [system.create_vector()], 1.0, proof_seconds=120.0)
say(f"{found}")
folder = io.output_folder(comm, "output/proofs_3d")
for k, point in enumerate(found.points(system)):
    (total,) = system.result_at(point).resultants.values()
    status = system.letters(point.piece)
    say(f"{status}: normal force {total[2]:.8f}, shear force ({total[0]:.8f}, {total[1]:.8f})")
    plot.picture_of_contact(folder / f"solution_{k}.png", problem, title=status)

# ## The proof
#
# The certificate contains the tree and the data of the problem. Its checker imports numpy only; it
# is also available as `python3 -m dolfinx_contact check proof.npz`.

certificate = found.proof.certificate
checked = check(certificate)
if comm.rank == 0:
    certificate.save(folder / "proof.npz")
say(f"{certificate}: {checked}")
