# SPDX-License-Identifier: LGPL-3.0-or-later
# # A rubber ring pressed flat
#
# This demo illustrates how to:
#
# - let a face touch itself (`SelfContact`);
# - press a body that is held by contact alone;
# - verify self-contact by symmetry.
#
# A ring lies between two rigid plates without friction. The upper plate descends until the inner
# face of the ring touches itself. By symmetry the upper half of the ring behaves the same above a
# rigid plane in the middle. That model needs no search for opposite facets, so that it is an
# independent check. The mesh of the whole ring is rotated by a part of a cell: nodes of the inner
# face meet facets, not nodes.

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
    SelfContact,
    io,
    plot,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame

comm = MPI.COMM_WORLD
n = 64  # cells around the ring, a multiple of 4
inner, outer = 0.8, 1.0  # radii
pressed, steps = 1.7, 34  # of the upper plate
rotation = 0.3  # of the mesh, over a cell
rubber = NeoHookean(*lame(1.0, 0.4))

# ## The mesh
#
# The nodes lie on circles. The cells are listed on rank 0, and DOLFINx distributes them.


def ring(count, whole):
    """Quadrilaterals of the ring, or of its upper half: count cells around."""
    layers = max(round(n * (outer - inner) / (2 * np.pi * inner)), 2)
    places = count if whole else count + 1
    angle = 2 * np.pi * (np.arange(places) + (rotation if whole else 0.0)) / n
    r = np.linspace(inner, outer, layers + 1)
    points = np.multiply.outer(r, np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2)
    i, j = (index.reshape(-1) for index in np.meshgrid(np.arange(count), np.arange(layers)))
    after = (i + 1) % places
    corners = [j * places + i, j * places + after, (j + 1) * places + i, (j + 1) * places + after]
    cells = np.stack(corners, axis=1).astype(np.int64)
    if comm.rank > 0:
        points, cells = points[:0], cells[:0]
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=points, e=ufl.Mesh(element))


def on_circle(domain, radius):
    return mesh.locate_entities_boundary(
        domain, 1, lambda x: np.isclose(np.hypot(x[0], x[1]), radius)
    )


def node_held(V, component, point):
    """Hold one component of the displacement of the node at a point."""
    W = V.sub(component)
    node = mesh.locate_entities_boundary(
        V.mesh, 0, lambda x: np.hypot(x[0] - point[0], x[1] - point[1]) < 1e-8
    )
    return fem.dirichletbc(0.0, fem.locate_dofs_topological(W, 0, node), W)


# ## The whole ring, and its upper half
#
# Nothing pushes the ring sideways, so that one node may be held in this direction. The plate is
# moved through the Constant that is a point on it.


def problem_of(whole):
    domain = ring(n if whole else n // 2, whole)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    plate = fem.Constant(domain, (0.0, outer))
    above = HalfSpace(plate, (0.0, -1.0))
    inside, outside = on_circle(domain, inner), on_circle(domain, outer)
    law = Frictionless()
    if whole:
        heights = mesh.compute_midpoints(domain, 1, outside)[:, 1]
        upper, lower = outside[heights > 0.1], outside[heights < -0.1]
        floor = HalfSpace((0.0, -outer), (0.0, 1.0))
        surfaces = [
            SelfContact(u, inside, law=law, name="inside", search_distance=0.3),
            ContactSurface(u, upper, obstacle=above, law=law, name="plate"),
            ContactSurface(u, lower, obstacle=floor, law=law, name="floor"),
        ]
        angle = 2 * np.pi * (round(0.75 * n) + rotation) / n
        bcs = [node_held(V, 0, (outer * np.cos(angle), outer * np.sin(angle)))]
    else:
        middle = HalfSpace((0.0, 0.0), (0.0, 1.0))
        surfaces = [
            ContactSurface(u, inside, obstacle=middle, law=law, name="inside"),
            ContactSurface(u, outside, obstacle=above, law=law, name="plate"),
        ]
        W = V.sub(1)
        cut = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0.0))
        bcs = [fem.dirichletbc(0.0, fem.locate_dofs_topological(W, 1, cut), W)]
        bcs.append(node_held(V, 0, (0.0, outer)))
    energy = rubber.energy(u) * ufl.dx(metadata={"quadrature_degree": 4})
    return ContactProblem(energy, u, surfaces, bcs=bcs), plate


# ## The history
#
# The step in which the inner face first touches itself is difficult; it may be halved.

say = io.Report(comm)
times = np.linspace(0.0, pressed, steps + 1)
forces = {}
for whole in (False, True):
    problem, plate = problem_of(whole)

    def load(t, plate=plate, share=1 if whole else 2):
        plate.value[1] = outer - t / share

    history = QuasiStatic(problem, load).run(times, halve_steps=True)
    accepted = [step for step in history.steps if step.time in times]
    forces[whole] = np.array([-step.result.resultants["plate"][1] for step in accepted])

# ## Comparison
#
# Both forces belong to the last step. Their difference is a discretisation error: with 128 cells
# around the ring it is 0.14 per cent.

ratio = float(forces[True][-1] / forces[False][-1])
say(f"force of the plate {forces[True][-1]:.5f}, of the half ring {forces[False][-1]:.5f}")
say(f"ratio {ratio:.4f}, by symmetry 1")

folder = io.output_folder(comm, "output/flattened_ring")
plot.picture_of_body(folder / "ring.png", problem)
if comm.rank == 0:
    curves = {"whole ring": (times[1:], forces[True])}
    dotted = {"half ring": (times[1:], forces[False])}
    labels = ("displacement of the plate", "force")
    plot.draw_curves(folder / "force.png", curves, dotted=dotted, labels=labels)
