"""Contact problems defined by a few numbers, and equivalent formulations of each problem.

A `Case` is a block of height 1 and modulus 1 over an obstacle, moved at its top. A `Place` rotates
or mirrors it, changes units, renumbers nodes and cells, or splits its face into two surfaces.
`Model` is the problem; its results are returned in the units and axes of the case, so that all
places can be compared. `test_properties.py` draws both.
"""

import itertools
from dataclasses import dataclass, fields
from functools import cached_property

from mpi4py import MPI

import numpy as np
from scipy.spatial.transform import Rotation

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    LevelSet,
    NormalCompliance,
    Sphere,
    Tresca,
)
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import LinearElastic
from support.blocks import CELLS

RADIUS = 3.0  # of spheres
STEP = 0.01  # height of a wave
WAVE = 2.0  # of its phase along the block
STIFFNESS = 20.0  # of compliant faces
#: Which way a cell of six tetrahedra is cut: along its edges, axis by axis.
WAYS = list(itertools.permutations(range(3)))


@dataclass(frozen=True)
class Saturating(FrictionLaw):
    """A law of a user: friction that no longer grows under large pressures."""

    friction: object
    most: object

    def bound(self, a, p):
        return self.friction * p / (1.0 + p / self.most)


@dataclass(frozen=True)
class Case:
    """A block that is pressed on an obstacle and dragged; lengths are relative to its height.

    Attributes:
        cell: cell type.
        cells: numbers of cells along each axis, the last one upwards.
        slant, bend: inclination of the block, and distance of its nodes from a grid.
        poisson: Poisson's ratio.
        law: contact law of the lower face.
        friction: coefficients at the left and at the right end.
        obstacle: plane, wave or sphere.
        tilt: slopes of the obstacle along the axes of the face.
        lift: gap below the node nearest to it.
        push, drag: displacements of the top downwards and along the face.
        load: body force.
    """

    cell: str = "tri"
    cells: tuple = (2, 1)
    slant: float = 0.0
    bend: float = 0.0
    poisson: float = 0.3
    law: str = "Coulomb"
    friction: tuple = (0.2, 0.2)
    obstacle: str = "plane"
    tilt: tuple = (0.0,)
    lift: float = 0.0
    push: float = 0.02
    drag: tuple = (0.0,)
    load: tuple = (0.0, 0.0)

    @property
    def dim(self):
        return len(self.cells)

    @property
    def grid(self):
        """Nodes in the unit square or cube (n, dim)."""
        axes = [np.linspace(0.0, 1.0, n + 1) for n in self.cells]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.dim)

    @property
    def points(self):
        """Nodes of the block (n, dim)."""
        g = self.grid
        x = g.copy()
        x[:, 0] += self.slant * g[:, -1]
        phase = g @ np.arange(3.0, 3.0 + 2 * self.dim, 2.0)
        for i in range(self.dim):
            x[:, i] += self.bend / max(self.cells) * np.sin(4 * phase + i + 1)
        return x

    @property
    def connectivity(self):
        """Nodes of the cells, in the order of DOLFINx (number, nodes)."""
        number = np.arange(len(self.grid)).reshape([n + 1 for n in self.cells])
        corners = []
        for at in itertools.product((0, 1), repeat=self.dim):  # the last axis fastest
            part = tuple(slice(i, i + n) for i, n in zip(at, self.cells, strict=True))
            corners.append(number[part].ravel())
        boxes = np.array(corners).T
        if self.cell in ("quad", "hex"):
            # Tensor products have their first axis fastest.
            order = np.arange(2**self.dim).reshape((2,) * self.dim).T.ravel()
            return boxes[:, order]
        steps = [2 ** (self.dim - 1 - i) for i in range(self.dim)]
        ways = [np.cumsum([0, *(steps[i] for i in way)]) for way in self._ways]
        return np.concatenate([boxes[:, way] for way in ways])

    @property
    def _ways(self):
        return WAYS if self.dim == 3 else list(itertools.permutations(range(2)))

    @property
    def normal(self):
        """Return the normal of the obstacle, towards the block."""
        n = np.append(-np.array(self.tilt), 1.0)
        return n / np.linalg.norm(n)

    @property
    def foot(self):
        """A point of the obstacle where the block would touch first if it sank by `lift`."""
        below = self.points[np.isclose(self.grid[:, -1], 0.0)]
        if self.obstacle == "sphere":
            along = below[:, :-1] - self.centre_along
            height = below[:, -1] - np.sqrt((RADIUS + self.lift) ** 2 - (along**2).sum(axis=1))
            return np.append(self.centre_along, height.min())
        above = (below @ self.normal - self.lift - self._wave(below)).min()
        return above * self.normal

    @property
    def centre_along(self):
        return 0.5 + np.array(self.tilt)

    def _wave(self, x):
        return STEP * np.sin(WAVE * x[:, 0]) if self.obstacle == "wave" else np.zeros(len(x))

    def gap(self, x):
        """Gap and normal into the obstacle at points (n, dim), without the package."""
        if self.obstacle == "sphere":
            d = x - self.foot
            distance = np.linalg.norm(d, axis=1)
            return distance - RADIUS, -d / distance[:, None]
        phi = (x - self.foot) @ self.normal - self._wave(x)
        slope = np.tile(self.normal, (len(x), 1))
        if self.obstacle == "wave":
            slope[:, 0] -= STEP * WAVE * np.cos(WAVE * x[:, 0])
        size = np.linalg.norm(slope, axis=1)
        return phi / size, -slope / size[:, None]

    def areas(self, nodes, parts):
        """Return areas of the nodes of the face by the vertex rule."""
        n = self.cells[:-1]
        grid = self.grid.reshape(*(k + 1 for k in self.cells), self.dim)
        face = np.arange(len(self.points)).reshape(grid.shape[:-1])[..., 0]
        found = np.zeros(len(self.points))
        for at in np.ndindex(*n):
            if n[0] >= 3 and parts and at[0] == 1:
                continue
            corners = face[tuple(slice(i, i + 2) for i in at)]
            for facet in [corners] if self.cell != "tet" else _halves(corners):
                for node, area in zip(facet.ravel(), _weights(self.points[facet]), strict=True):
                    found[node] += area
        return found[nodes]

    def bound(self, x, pressure):
        """Return the bound of the shear at points (n, dim) under a pressure (n,), independently."""
        left, right = self.friction
        F = left + (right - left) * x[:, 0]
        if self.law == "frictionless":
            return 0.0 * F
        if self.law == "Tresca":
            return 0.01 * F
        if self.law == "own":
            return F * pressure / (1.0 + pressure / 0.1)
        return F * pressure

    def __repr__(self):
        """Return the fields that differ from the defaults."""
        given = ", ".join(
            f"{f.name}={getattr(self, f.name)!r}"
            for f in fields(self)
            if getattr(self, f.name) != f.default
        )
        return f"Case({given})"


def _halves(corners):
    """The triangles of a square (2, 2) below tetrahedra, which are cut along its diagonal."""
    (a, b), (c, d) = corners
    return np.array([a, b, d]), np.array([a, c, d])


def _weights(x):
    """Return weights of a segment, a triangle or a bilinear facet (2, 2, 3) by the vertex rule."""
    if len(x) == 3:
        return np.full(3, np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0])) / 6)
    if x.ndim == 2:
        return np.full(2, np.linalg.norm(x[1] - x[0]) / 2)
    sides = x[1] - x[0], x[:, 1] - x[:, 0]  # along both axes of the facet
    corners = [np.cross(sides[0][j], sides[1][i]) for i in (0, 1) for j in (0, 1)]
    return np.linalg.norm(corners, axis=1) / 4


@dataclass(frozen=True)
class Place:
    """An equivalent formulation of a case.

    Attributes:
        turn: rotation angles in degrees, one in 2D and three in 3D.
        mirrored: whether left and right are exchanged.
        moved: translation along every axis, relative to the height.
        length, stress: units of the case in units of the solved problem.
        order: seed of another order of nodes and cells.
        parts: number of surfaces of the face; one row of facets between two surfaces is left out.
    """

    turn: tuple = ()
    mirrored: bool = False
    moved: float = 0.0
    length: float = 1.0
    stress: float = 1.0
    order: int = 0
    parts: int = 1

    def axes(self, dim):
        """An orthogonal matrix."""
        Q = np.eye(dim)
        if self.turn and dim == 2:
            c, s = np.cos(np.radians(self.turn[0])), np.sin(np.radians(self.turn[0]))
            Q = np.array([[c, -s], [s, c]])
        elif self.turn:
            Q = Rotation.from_euler("xyz", self.turn, degrees=True).as_matrix()
        return Q @ np.diag([-1.0] + [1.0] * (dim - 1)) if self.mirrored else Q


@dataclass(frozen=True)
class Found:
    """A solution in the units and axes of its case, point by point in the order of their positions.

    Attributes:
        x, area, n, un, ut, force, pressure, shear, bound: columns of the contact table.
        u: displacement at the nodes in the order of `Case.points`; serial only.
        result: result of the package.
    """

    x: np.ndarray
    area: np.ndarray
    n: np.ndarray
    un: np.ndarray
    ut: np.ndarray
    force: np.ndarray
    pressure: np.ndarray
    shear: np.ndarray
    bound: np.ndarray
    result: object

    @cached_property
    def rn(self):
        return -np.sum(self.force * self.n, axis=1)

    @cached_property
    def rt(self):
        return self.force + self.rn[:, None] * self.n


class Model:
    """The contact problem of a case at a place; all its numbers are Constants.

    Args:
        case, place: case and place.
        comm: communicator.
    """

    def __init__(self, case, place=Place(), comm=MPI.COMM_SELF):
        self.case = case
        self.place = place
        self.comm = comm
        self.Q = place.axes(case.dim)
        self.origin = np.full(case.dim, place.moved)
        self.mesh = self._mesh()
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (case.dim,)))
        self.u = fem.Function(self.V)
        self._constants()
        self.surfaces = [
            ContactSurface(
                self.u,
                facets,
                obstacle=self._obstacle(),
                law=self._law(),
                name=f"part {i}",
                sliding="small",
            )
            for i, facets in enumerate(self._parts())
        ]
        law = LinearElastic.from_young(self.young, self.poisson)
        self.stored = law.energy(self.u) * ufl.dx
        self.energy = self.stored - ufl.dot(self.load, self.u) * ufl.dx
        held = fem.locate_dofs_topological(self.V, case.dim - 1, self._facets(1.0))
        self.problem = ContactProblem(
            self.energy,
            self.u,
            self.surfaces,
            bcs=[fem.dirichletbc(self.top, held, self.V)],
            petsc_options={"snes_rtol": 1e-10},
        )

    # -- the body --------------------------------------------------------------------------------

    def put(self, vectors):
        """Vectors or lengths of the case, turned."""
        return np.asarray(vectors) @ self.Q.T

    def back(self, vectors):
        """Vectors of the problem in the axes of the case."""
        return np.asarray(vectors)[..., : self.case.dim] @ self.Q

    def _mesh(self):
        case = self.case
        cells = case.connectivity
        nodes = np.arange(len(case.grid))
        if self.place.order:
            random = np.random.default_rng(self.place.order)
            nodes = random.permutation(len(nodes))
            cells = random.permutation(np.argsort(nodes)[cells])
            if case.cell in ("tri", "tet"):
                cells = random.permuted(cells, axis=1)
        self.nodes = nodes
        x = self.place.length * (self.put(case.points[nodes]) + self.origin)
        if self.comm.rank > 0:
            cells, x = cells[:0], x[:0]
        kind = CELLS[case.cell].name
        element = basix.ufl.element("Lagrange", kind, 1, shape=(case.dim,))
        return mesh.create_mesh(self.comm, cells=cells.astype(np.int64), x=x, e=ufl.Mesh(element))

    def _at(self, facets):
        """Where the nodes of facets are in the grid (facets, nodes, dim)."""
        fdim = self.case.dim - 1
        at = mesh.entities_to_geometry(self.mesh, fdim, facets)
        original = self.nodes[self.mesh.geometry.input_global_indices]
        return self.case.grid[original][at.reshape(len(facets), -1)]

    def _facets(self, height):
        """Facets of the boundary below (0) or above (1)."""
        fdim = self.case.dim - 1
        self.mesh.topology.create_connectivity(fdim, fdim + 1)
        exterior = mesh.exterior_facet_indices(self.mesh.topology)
        if len(exterior) == 0:
            return exterior
        return exterior[np.isclose(self._at(exterior)[..., -1], height).all(axis=1)]

    def _parts(self):
        """Facets of the surfaces; nobody has the second row if there is to be a gap."""
        facets = self._facets(0.0)
        if self.case.cells[0] < 3 or self.place.parts == 0:
            return [facets]
        row = np.zeros(0, dtype=int)
        if len(facets):
            row = np.floor(self._at(facets)[..., 0].mean(axis=1) * self.case.cells[0]).astype(int)
        if self.place.parts == 1:
            return [facets[row != 1]]
        return [facets[row < 1], facets[row > 1]]

    # -- its data --------------------------------------------------------------------------------

    def _constants(self):
        def number():
            return fem.Constant(self.mesh, 1.0)

        def vector():
            return fem.Constant(self.mesh, np.ones(self.case.dim))

        self.young, self.poisson = number(), number()
        self.left, self.change, self.most, self.stiff = number(), number(), number(), number()
        self.first, self.load, self.top = vector(), vector(), vector()
        self.corner, self.foot, self.normal, self.wave = vector(), vector(), vector(), vector()
        self.radius, self.step = number(), number()
        self.set(self.case)

    def set(self, case, part=1.0):
        """Give the problem the data of a case of the same body, with a part of its loads."""
        L, stress = self.place.length, self.place.stress
        self.case = case
        self.young.value = stress
        self.poisson.value = case.poisson
        left, right = np.array(case.friction) * (0.01 * stress if case.law == "Tresca" else 1.0)
        self.left.value, self.change.value = left, right - left
        self.most.value = 0.1 * stress
        self.stiff.value = STIFFNESS * stress / L
        axis = np.eye(case.dim)[0]
        self.first.value = self.put(axis) / L
        self.corner.value = L * self.origin
        self.load.value = part * stress / L * self.put(case.load)
        self.top.value = part * L * self.put([*case.drag, -case.push])
        self.foot.value = L * (self.put(case.foot) + self.origin)
        self.normal.value = self.put(case.normal)
        self.wave.value = WAVE / L * self.put(axis)
        self.radius.value, self.step.value = L * RADIUS, L * STEP

    def _obstacle(self):
        if self.case.obstacle == "sphere":
            return Sphere(self.foot, self.radius)
        if self.case.obstacle == "plane":
            return HalfSpace(self.foot, self.normal)
        wave, step, foot, corner = self.wave, self.step, self.foot, self.corner
        return LevelSet(
            lambda x: ufl.dot(x - foot, self.normal) - step * ufl.sin(ufl.dot(wave, x - corner))
        )

    def _law(self):
        x = ufl.SpatialCoordinate(self.mesh)
        F = self.left + self.change * ufl.dot(self.first, x - self.corner)
        return {
            "frictionless": Frictionless(),
            "Coulomb": Coulomb(F),
            "Tresca": Tresca(F),
            "compliance": NormalCompliance(self.stiff, friction=Coulomb(F)),
            "own": Saturating(F, self.most),
        }[self.case.law]

    # -- what it finds ---------------------------------------------------------------------------

    def solve(self):
        """Solve and return the solution."""
        return self.found(self.problem.solve(progress=False))

    def found(self, result):
        """A result in the units and axes of the case."""
        L = self.place.length
        area = L ** (self.case.dim - 1)
        tables = result.tables.values()

        def all_of(name):
            return np.concatenate([getattr(t, name) for t in tables])

        x = self.back(all_of("x")) / L - self.back(self.origin)
        order = np.lexsort(np.round(x, 6).T)
        return Found(
            x[order],
            all_of("area")[order] / area,
            self.back(all_of("n"))[order],
            all_of("un")[order] / L,
            self.back(all_of("ut"))[order] / L,
            self.back(all_of("force"))[order] / (self.place.stress * area),
            all_of("pressure")[order] / self.place.stress,
            self.back(all_of("shear"))[order] / self.place.stress,
            all_of("bound")[order] / (self.place.stress * area),
            result,
        )

    def displacement(self):
        """Return nodal displacements in the order of `Case.points`, shape (n, dim); serial."""
        return self.of_nodes(self.u.x.array) / self.place.length

    def forces(self):
        """Return nodal forces of the body and its loads in the order of `Case.points`; serial."""
        rows = fem.assemble_vector(fem.form(ufl.derivative(self.energy, self.u)))
        return self.of_nodes(rows.array) / (
            self.place.stress * self.place.length ** (self.case.dim - 1)
        )

    def volume(self):
        return self._integral(1.0) / self.place.length**self.case.dim

    def potential(self):
        """Work of the body force."""
        unit = self.place.stress * self.place.length**self.case.dim
        return self._integral(ufl.dot(self.load, self.u)) / unit

    def _integral(self, value):
        return fem.assemble_scalar(fem.form(value * ufl.dx(self.mesh)))

    def of_nodes(self, values):
        """Values at the nodes in the order of `Case.points`, in the axes of the case."""
        L = self.place.length
        x = self.V.tabulate_dof_coordinates()
        x = self.back(x) / L - self.back(self.origin)
        order = np.argmin(((self.case.points[:, None] - x[None]) ** 2).sum(axis=-1), axis=1)
        return self.back(values.reshape(-1, self.case.dim)[order])
