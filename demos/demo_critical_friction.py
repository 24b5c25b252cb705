# SPDX-License-Identifier: LGPL-3.0-or-later
# # Critical friction: the coefficient at which solutions cease to be unique
#
# This demo illustrates how to:
#
# - compute the friction coefficients at which sliding solutions form continua;
# - decide by refinement whether such a coefficient belongs to the body or to the mesh;
# - compare it with the coefficient up to which a solution is certainly unique.
#
# If all contact points slip to the same side and stay in contact, a mode $v$ may be added to the
# solution without changing the contact law when
#
# $$S_{tt}\, v = F\, S_{nt}\, v,$$
#
# where $S$ is the stiffness condensed onto the contact points (Hassani, Hild, Ionescu and Sakki,
# 2003). This is an eigenvalue problem for $F$. At a real eigenvalue whose mode has one sign, a
# continuum of solutions exists.
#
# Two bodies are compared. For Hild's triangle the critical coefficient converges under mesh
# refinement. For a leaning parallelogram of width $W$ and height $H$ it falls like $2 W/H$: no
# friction coefficient is small enough for all bodies.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, io, plot
from dolfinx_contact.analysis import critical_friction, renard_criterion
from dolfinx_contact.materials import LinearElastic

comm = MPI.COMM_WORLD
meshes = [1, 2, 4, 8, 16]  # cells along an edge of the triangle
heights = [1.0, 2.0, 4.0, 8.0]  # of the parallelogram, over its width

# ## The bodies
#
# Neither the load nor the friction coefficient of the law enters the eigenvalue problem.


def on_floor(domain, clamped_facets, bottom, material):
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, clamped_facets), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(1.0))
    return ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[held])


def triangle(n):
    """Half of the unit square, clamped on its diagonal."""
    square = mesh.create_unit_square(comm, n, n, diagonal=mesh.DiagonalType.left)
    half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
    domain = mesh.create_submesh(square, 2, half)[0]
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    return on_floor(domain, slope, bottom, LinearElastic(100.0, 82.0))


def parallelogram(height, n=8):
    """A body of width 1 whose clamped top is shifted to the right by 1."""
    cells = [n, round(n * height)]
    corners = [[0.0, 0.0], [1.0, height]]
    domain = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral)
    top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    domain.geometry.x[:, 0] += domain.geometry.x[:, 1] / height
    return on_floor(domain, top, bottom, LinearElastic.from_young(1.0, 0.3))


# ## The triangle under refinement
#
# On one element the critical coefficient is $(\lambda + 3\mu)/(\lambda + \mu)$. On 2, 4 and 8
# elements an independent code gives 1.73663256, 1.68791278 and 1.66953114.
#
# Renard's criterion yields the coefficient up to which a solution is unique, given the directions
# of slip. For one common direction it converges too. If the directions alternate from node to node,
# it tends to zero like $h^{1/2}$; this is also the rate of the theoretical bound for all solutions.
# The first continuum occurs far above it.


def to_the_right(x):
    return np.tile([1.0, 0.0], (len(x), 1))


say = io.Report(comm)
critical, one_way, alternating = [], [], []
for n in meshes:
    problem = triangle(n)
    critical.append(critical_friction(problem).friction)
    one_way.append(renard_criterion(problem, to_the_right).friction)

    def to_and_fro(x, n=n):
        return (-1.0) ** np.round(n * x[:, :1]) * to_the_right(x)

    alternating.append(renard_criterion(problem, to_and_fro).friction)
    say(f"n = {n}: critical friction {critical[-1]:.8f}")
    say(f"  unique up to {one_way[-1]:.6f} (one direction), {alternating[-1]:.6f} (alternating)")
closed_form = (100.0 + 3 * 82.0) / (100.0 + 82.0)
say(f"one element: {critical[0]:.10f}, closed form {closed_form:.10f}")

# ## The parallelogram
#
# Its smallest critical coefficient is that of a slip which drives the body into the floor.

falls = []
for height in heights:
    falls.append(critical_friction(parallelogram(height)).friction)
    say(f"H/W = {height:g}: F = {falls[-1]:.4f}, F H/W = {falls[-1] * height:.3f}")

# ## The picture

folder = io.output_folder(comm, "output/critical_friction")
if comm.rank == 0:
    h = 1 / np.array(meshes)
    curves = {
        "critical friction": (h, critical),
        "unique, slips in one direction": (h, one_way),
        "unique, alternating slips": (h, alternating),
    }
    order = {"order 1/2": (h, alternating[-1] * np.sqrt(h / h[-1]))}
    labels = ("cell size h", "friction coefficient F")
    plot.draw_curves(folder / "refinement.png", curves, dotted=order, labels=labels, loglog=True)
