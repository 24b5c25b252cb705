# SPDX-License-Identifier: LGPL-3.0-or-later
# # The common set-up of the recipes
#
# Five bodies from which the recipes start. To run a recipe, copy this file
# (`docs/recipes/common.py`) next to it.

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    meshing,
)
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame


def facets_where(domain, axis, value):
    """Facets of the boundary on a coordinate plane."""
    dim = domain.topology.dim - 1
    return mesh.locate_entities_boundary(domain, dim, lambda x: np.isclose(x[axis], value))


# ## A block on a floor
#
# A square or cube of edge 1, of Young's modulus 1000 and Poisson's ratio 0.3. Its top is moved down
# by 0.01 and aside by 0.004, its bottom lies on a rigid floor. In 2D forces are per thickness.


class Block:
    def __init__(self, n=8, cell="triangle", degree=1, domain=None, young=1000.0):
        if domain is None:
            kind = mesh.CellType[cell]
            plane = cell in ("triangle", "quadrilateral")
            create = mesh.create_unit_square if plane else mesh.create_unit_cube
            domain = create(MPI.COMM_WORLD, *([n] * (2 if plane else 3)), kind)
        dim = domain.geometry.dim
        self.mesh = domain
        self.top = facets_where(domain, dim - 1, 1.0)
        self.bottom = facets_where(domain, dim - 1, 0.0)
        self.V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
        self.u = fem.Function(self.V, name="displacement")
        self.moved = fem.Constant(domain, [0.004, *[0.0] * (dim - 2), -0.01])
        held = fem.locate_dofs_topological(self.V, dim - 1, self.top)
        self.bcs = [fem.dirichletbc(self.moved, held, self.V)]
        self.young = fem.Constant(domain, float(young))
        self.steel = LinearElastic.from_young(self.young, 0.3)
        self.energy = self.steel.energy(self.u) * ufl.dx
        self.floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])

    def surface(self, law, **options):
        return ContactSurface(self.u, self.bottom, obstacle=self.floor, law=law, **options)

    def problem(self, law=None, *, petsc_options=None, **options):
        surface = self.surface(law or Coulomb(0.3), **options)
        options = dict(bcs=self.bcs, petsc_options=petsc_options)
        return ContactProblem(self.energy, self.u, [surface], **options)


# ## A triangle with several solutions
#
# Half of a square, held on its slope, its bottom on a floor. The parameter gamma of the
# `ParametricContact` is the factor of the traction (-26, -7.5) on its vertical side. `join` copies
# the submesh to an ordinary mesh, so that branches can be recorded.


def triangle(friction=1.7, n=2):
    square = mesh.create_unit_square(MPI.COMM_WORLD, n, n, diagonal=mesh.DiagonalType.left)
    half = mesh.locate_entities(square, 2, lambda x: x[0] + x[1] < 1 + 1e-9)
    domain = meshing.join([mesh.create_submesh(square, 2, half)[0]]).mesh
    sides = {
        "slope": lambda x: np.isclose(x[0] + x[1], 1),
        "side": lambda x: np.isclose(x[0], 0),
        "bottom": lambda x: np.isclose(x[1], 0),
    }
    body = meshing.name_groups(domain, sides)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    gamma = fem.Constant(domain, -1.0)
    traction = gamma * fem.Constant(domain, (-26.0, -7.5))
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx
    energy -= ufl.dot(traction, u) * body.ds("side")
    bcs = [fem.dirichletbc(np.zeros(2), body.dofs(V, "slope"), V)]
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, body, tag="bottom", obstacle=floor, law=Coulomb(friction))
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=bcs), gamma)


# ## Two blocks, one on the other
#
# Two squares of edge 1 in one mesh, the upper one at y > 0. The lower one is held on its bottom,
# the upper one is moved on its top. Their cells may differ in size. The faces in contact are `sole`
# and `seat`.


class TwoBlocks:
    def __init__(self, n_upper=4, n_lower=4, moved=(0.0, -0.01), poisson=0.0):
        upper = mesh.create_rectangle(MPI.COMM_WORLD, [[0, 0], [1, 1]], (n_upper, n_upper))
        lower = mesh.create_rectangle(MPI.COMM_WORLD, [[0, -1], [1, 0]], (n_lower, n_lower))
        upper_sides = {"sole": facets_where(upper, 1, 0.0), "top": facets_where(upper, 1, 1.0)}
        lower_sides = {"seat": facets_where(lower, 1, 0.0), "base": facets_where(lower, 1, -1.0)}
        self.body = meshing.join(
            [meshing.name_groups(upper, upper_sides), meshing.name_groups(lower, lower_sides)]
        )
        self.V = fem.functionspace(self.body.mesh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(self.V, name="displacement")
        self.moved = fem.Constant(self.body.mesh, moved)
        self.bcs = [
            fem.dirichletbc(self.moved, self.body.dofs(self.V, "top"), self.V),
            fem.dirichletbc(np.zeros(2), self.body.dofs(self.V, "base"), self.V),
        ]
        self.energy = LinearElastic.from_young(1000.0, poisson).energy(self.u) * ufl.dx

    def problem(self, pair):
        return ContactProblem(self.energy, self.u, [pair], bcs=self.bcs)

    def pair(self, law=None, **options):
        options = {"slave": "sole", "master": "seat", "law": law or Coulomb(0.3)} | options
        return ContactPair(self.u, self.body, **options)


# ## A wheel with a rubber tyre
#
# A ring of radii 0.6 and 1, its axle at the origin, above a floor at y = -1. The hub moves as a
# rigid body: `put(down, forward, angle)` gives its displacement.


def draw_ring(size):
    occ = gmsh.model.occ
    outer = occ.addDisk(0, 0, 0, 1, 1)
    inner = occ.addDisk(0, 0, 0, 0.6, 0.6)
    (ring, *_), _ = occ.cut([(2, outer)], [(2, inner)])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [ring[1]], name="tyre")
    for _, curve in gmsh.model.getBoundary([ring], oriented=False):
        radius = gmsh.model.getBoundingBox(1, curve)[3]
        gmsh.model.addPhysicalGroup(1, [curve], name="tread" if radius > 0.8 else "hub")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(2)


class Wheel:
    def __init__(self, size=0.12, friction=0.5):
        self.body = meshing.mesh_from_gmsh(MPI.COMM_WORLD, lambda: draw_ring(size))
        self.V = fem.functionspace(self.body.mesh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(self.V, name="displacement")
        self.hub = fem.Function(self.V)
        held = fem.dirichletbc(self.hub, self.body.dofs(self.V, "hub"))
        energy = NeoHookean(*lame(10.0, 0.4)).energy(self.u) * ufl.dx
        floor = HalfSpace((0.0, -1.0), (0.0, 1.0))
        law = Coulomb(friction)
        surface = ContactSurface(self.u, self.body, tag="tread", obstacle=floor, law=law)
        self.problem = ContactProblem(energy, self.u, [surface], bcs=[held])

    def put(self, down, forward, angle):
        c, s = np.cos(angle), np.sin(angle)

        def moved(x):
            turned = [c * x[0] + s * x[1], -s * x[0] + c * x[1]]
            return np.stack([turned[0] - x[0] + forward, turned[1] - x[1] - down])

        self.hub.interpolate(moved)


# ## A block with a crack
#
# A square of edge 1 with an inclined crack in its middle, to be drawn by `mesh_from_gmsh`; its
# groups are `base`, `top` and `fault`.


def draw_cracked(size=0.06):
    occ = gmsh.model.occ
    block = occ.addRectangle(0, 0, 0, 1, 1)
    ends = [occ.addPoint(0.3, 0.6, 0), occ.addPoint(0.7, 0.4, 0)]
    fault = occ.addLine(*ends)
    _, parts = occ.fragment([(2, block)], [(1, fault)])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [tag for _, tag in parts[0]], name="block")
    gmsh.model.addPhysicalGroup(1, [tag for _, tag in parts[1]], name="fault")
    for dim, tag in gmsh.model.getEntities(1):
        height = gmsh.model.occ.getCenterOfMass(dim, tag)[1]
        if height < 1e-6 or height > 1 - 1e-6:
            gmsh.model.addPhysicalGroup(1, [tag], name="base" if height < 0.5 else "top")
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(2)
