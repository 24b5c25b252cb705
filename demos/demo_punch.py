# SPDX-License-Identifier: LGPL-3.0-or-later
# # A punch from an STL file
#
# This demo illustrates how to:
#
# - read a rigid tool from a file of triangles (`RigidSurface.read`);
# - press it into a soft slab by a force and drag it (`RigidBody`);
# - measure the error due to the triangles, since the shape is also available exactly.
#
# The tool is a ball of radius 1. Its file, in millimetres, is written here. The tool is pressed
# down by a force and then moved sideways with friction. The triangles are chords of the ball; the
# error falls with the square of their size.

from mpi4py import MPI

import numpy as np
from scipy.spatial import ConvexHull

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    RigidBody,
    RigidSurface,
    Sphere,
    io,
    plot,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame

comm = MPI.COMM_WORLD
n = 8  # cells along an edge of the slab
cuts = [4, 8]  # of the edges of an icosahedron, which is projected onto the ball
friction, force_on_tool, distance, steps = 0.3, 60.0, 0.2, 4
radius, mm = 1.0, 1e-3
centre = np.array([0.0, 0.0, radius])
say = io.Report(comm)
folder = io.output_folder(comm, "output/punch")

# ## The file
#
# The edges of an icosahedron are divided, and the points are moved onto the ball. The convex hull
# of these points gives the triangles, whose corners are ordered so that their normals point
# outwards. `RigidSurface.read` accepts STL files in text and in binary form; a closed surface with
# consistent normals has a definite inside.


def ball(parts):
    """Points and outward triangles of an icosahedron whose edges are cut into parts."""
    golden = (1 + 5**0.5) / 2
    corners = np.array([[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)])
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)])
    points = np.array(
        [
            (a * i + b * j + c * (parts - i - j)) / parts
            for a, b, c in corners[ConvexHull(corners).simplices]
            for i in range(parts + 1)
            for j in range(parts + 1 - i)
        ]
    )
    points /= np.linalg.norm(points, axis=1)[:, None]
    points = points[np.unique(np.round(points, 9), axis=0, return_index=True)[1]]
    triangles = ConvexHull(points).simplices
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inward = np.einsum("ki,ki->k", np.cross(b - a, c - a), a) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return centre + radius * points, triangles


def write_stl(file, points, triangles):
    lines = ["solid tool"]
    for corners in points[triangles]:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal /= np.linalg.norm(normal)
        lines.append("facet normal " + " ".join(f"{v:.9g}" for v in normal))
        lines.append("outer loop")
        lines += ["vertex " + " ".join(f"{v:.9g}" for v in corner) for corner in corners]
        lines += ["endloop", "endfacet"]
    file.write_text("\n".join([*lines, "endsolid tool"]))


# ## The slab and the tool
#
# The tool may move vertically under its force and follows a prescribed horizontal path. A
# `RigidBody` has six degrees of freedom: each is loaded (`load`), prescribed (`motion`), or held
# (`held`). The slab is neo-Hookean, so that gap and normal are evaluated at the displaced points.


def pressed(shape):
    corners = [np.array([-1.0, -1.0, -0.8]), np.array([1.0, 1.0, 0.0])]
    cells = (n, n, max(n // 3, 1))
    domain = mesh.create_box(comm, corners, cells, mesh.CellType.hexahedron)
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V, name="displacement")
    force, path = fem.Constant(domain, 0.0), fem.Constant(domain, 0.0)
    tool = RigidBody(
        shape,
        about=(0.0, 0.0, 0.0),
        load={"z": force},
        motion={"x": path},
        held=["y", "rx", "ry", "rz"],
        name="tool",
    )
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
    bottom = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], -0.8))
    contact = ContactSurface(u, top, obstacle=tool, law=Coulomb(friction))
    held = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, bottom), V)
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    energy = NeoHookean(*lame(1000.0, 0.3)).energy(u) * dx
    problem = ContactProblem(energy, u, [contact], bcs=[held])

    def load(t):
        force.value = -force_on_tool * min(t, 1.0)
        path.value = distance * max(t - 1.0, 0.0)

    times = [0.0, 0.5, *np.linspace(1.0, 2.0, steps + 1)]
    return problem, QuasiStatic(problem, load).run(times).steps[-1].result


# ## Comparison
#
# The same history is computed for the exact ball and for two files. The depth of the tool under
# its force is compared. Halving the triangles divides the error by four. In every step the contact
# forces on the tool balance the applied force.

shapes = {"exact": Sphere(centre, radius)}
for parts in cuts:
    file = folder / f"ball_{parts}.stl"
    if comm.rank == 0:
        points, triangles = ball(parts)
        write_stl(file, points / mm, triangles)
    comm.barrier()
    shapes[parts] = RigidSurface.read(file, scale=mm, comm=comm)
depths = {}
for name, shape in shapes.items():
    problem, result = pressed(shape)
    tool = result.rigid_bodies["tool"]
    depths[name] = -float(tool.motion[2])
    drag = abs(float(tool.contact[0]))
    triangles = "" if name == "exact" else f" ({len(shape.cells)} triangles)"
    say(f"{name}{triangles}: depth {depths[name]:.6f}, drag {drag:.5f}")
errors = [abs(depths[parts] / depths["exact"] - 1) for parts in cuts]
orders = np.log2(np.array(errors[:-1]) / errors[1:])
say(f"errors of the depth {[f'{e:.2e}' for e in errors]}, order {orders[0]:.2f}, expected 2")
imbalance = abs(float(tool.contact[2]) / force_on_tool - 1)
say(f"the slab balances the force on the tool up to {imbalance:.1e}")
plot.picture_of_body(folder / "punch.png", problem)
