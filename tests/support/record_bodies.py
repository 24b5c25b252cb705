"""Small bodies and contact problems of the regression record, from public names only."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    SelfContact,
)
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import Axisymmetric, LinearElastic, NeoHookean, lame
from dolfinx_contact.meshing import crack, join

COMM = MPI.COMM_WORLD
CELLS = {
    "tri": mesh.CellType.triangle,
    "quad": mesh.CellType.quadrilateral,
    "tet": mesh.CellType.tetrahedron,
    "hex": mesh.CellType.hexahedron,
}
RUBBER = NeoHookean(*lame(1000.0, 0.3))
UNIT = (0.0, 1.0)


@dataclass
class Body:
    """A contact problem and the Function prescribing the displacement of its moved end."""

    problem: ContactProblem
    top: fem.Function | None = None

    def move(self, motion: Any) -> None:
        """Prescribe a constant displacement, or a function of positions (3, n)."""
        if not callable(motion):
            constant = np.asarray(motion, dtype=float)
            self.top.interpolate(lambda x: np.tile(constant[:, None], x.shape[1]))
        else:
            self.top.interpolate(motion)

    def driven(self, motion: Callable[[fem.Constant], Any]) -> ParametricContact:
        """The parametric problem in which gamma determines the displacement of the moved end."""
        gamma = fem.Constant(self.problem.V.mesh, 0.0)
        displacement = ufl.as_vector(motion(gamma))
        return ParametricContact(self.problem, gamma, driven=[(self.top, displacement)])


# -- meshes ----------------------------------------------------------------------------------------


def box(n, cell, comm=COMM):
    """Unit square or cube with n cells along each edge."""
    dim = 2 if cell in ("tri", "quad") else 3
    return create_grid(comm, [np.linspace(*UNIT, n + 1)] * dim, CELLS[cell])


def facets(domain, axis, value):
    """Boundary facets on a coordinate plane."""
    return mesh.locate_entities_boundary(
        domain, domain.topology.dim - 1, lambda x: np.isclose(x[axis], value, atol=1e-9)
    )


def tagged(domain, planes):
    """Tags of the facets on coordinate planes, from (axis, value) by tag."""
    found = [facets(domain, *plane) for plane in planes.values()]
    values = np.repeat(np.array([*planes], dtype=np.int32), [len(f) for f in found])
    every = np.concatenate(found)
    order = np.argsort(every)
    return mesh.meshtags(domain, domain.topology.dim - 1, every[order], values[order])


def stack(cell, lower, upper, height=1.0, level=0.0, overlap=0.0, turn=None):
    """Two boxes on each other.

    The facet tags are 1 (lower end), 2 and 3 (lower and upper side of the interface) and 4 (upper
    end).

    Args:
        cell: kind of cells, a key of `CELLS`.
        lower: number of cells along the interface and across it, and the interval that the lower
            box covers along each axis of the interface.
        upper: the same of the upper box.
        height: height of the lower box; that of the upper box is 1.
        level: last coordinate of the interface.
        overlap: depth of the upper box in the lower one.
        turn: rotation matrix applied to all positions (3, 3), by default none.
    """
    across = 1 if cell in ("tri", "quad") else 2
    boxes = []
    tags = []
    for first, (n, m, reach), z in ((1, lower, (-height, 0.0)), (3, upper, UNIT)):
        axes = [np.linspace(*reach, n + 1)] * across
        body = create_grid(COMM, [*axes, np.linspace(*z, m + 1)], CELLS[cell])
        tags.append(tagged(body, {first: (across, z[0]), first + 1: (across, z[1])}))
        body.geometry.x[:, across] -= overlap * (first == 3)
        boxes.append(body)
    both = join(boxes, facet_tags=tags)
    both.mesh.geometry.x[:, across] += level
    if turn is not None:
        both.mesh.geometry.x[:] = both.mesh.geometry.x @ turn.T
    return both


def part_of(domain, inside):
    """The submesh of the cells all of whose vertices satisfy a condition."""
    dim = domain.topology.dim
    return mesh.create_submesh(domain, dim, mesh.locate_entities(domain, dim, inside))[0]


# -- one body --------------------------------------------------------------------------------------


def displacement(domain, degree=1):
    """A displacement of Lagrange elements."""
    return fem.Function(fem.functionspace(domain, ("Lagrange", degree, (domain.geometry.dim,))))


def prescribed(u, where, value=None):
    """Dirichlet data on facets: a Function, or None for zero."""
    V = u.function_space
    dofs = fem.locate_dofs_topological(V, V.mesh.topology.dim - 1, where)
    return fem.dirichletbc(fem.Function(V) if value is None else value, dofs)


def elastic(young=1000.0, poisson=0.3):
    """The stored energy of a linear elastic body, as a function of its displacement."""
    return lambda u: LinearElastic.from_young(young, poisson).energy(u) * ufl.dx


def rubber(u):
    """The stored energy of a neo-Hookean body."""
    return RUBBER.energy(u) * ufl.dx(metadata={"quadrature_degree": 3})


def block(
    n=4,
    cell="tri",
    *,
    law=Coulomb(0.3),  # noqa: B008
    obstacle=None,
    motion=None,
    energy=None,
    degree=1,
    options=None,
    flipped=False,
    loose=False,
    domain=None,
    **surface,
):
    """A block in contact on its lower face, whose upper face is held or moved.

    Args:
        n: number of cells along each edge.
        cell: kind of cells, a key of `CELLS`.
        law: contact law.
        obstacle: what the block touches, by default the half-space below it.
        motion: displacement of the moved face, by default zero.
        energy: stored energy as a function of the displacement, by default `elastic`.
        degree: polynomial degree of the displacement.
        options: PETSc options.
        flipped: whether the upper face is in contact and the lower one held.
        loose: whether no face is held.
        domain: mesh, by default the unit square or cube.
        surface: further arguments of `ContactSurface`.
    """
    domain = box(n, cell) if domain is None else domain
    dim = domain.geometry.dim
    u = displacement(domain, degree)
    top = fem.Function(u.function_space)
    touching, held = (facets(domain, dim - 1, z) for z in (UNIT[::-1] if flipped else UNIT))
    obstacle = obstacle or HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    contact = ContactSurface(u, touching, obstacle=obstacle, law=law, **surface)
    bcs = [] if loose else [prescribed(u, held, top)]
    stored = (energy or elastic())(u)
    body = Body(ContactProblem(stored, u, [contact], bcs=bcs, petsc_options=options), top)
    if motion is not None:
        body.move(motion)
    return body


def disc(n, law, method="nodal", degree=1):
    """A disc of revolution on a floor, pressed and free to widen, with cells of all shapes."""
    domain = box(n, "quad")
    x = domain.geometry.x
    x[:, 0] = x[:, 0] ** 1.3
    x[:, 1] += 0.1 * np.sin(3 * x[:, 0]) * x[:, 1] * (1 - x[:, 1])
    u = displacement(domain, degree)
    V = u.function_space
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    contact = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=floor, law=law, method=method, axisymmetric=True
    )
    material = Axisymmetric(LinearElastic.from_young(1000.0, 0.3))
    energy = material.energy(u) * ufl.dx
    dofs = fem.locate_dofs_topological(V.sub(1), 1, facets(domain, 1, 1.0))
    bcs = [fem.dirichletbc(-0.01, dofs, V.sub(1))]
    return ContactProblem(energy, u, [contact], bcs=bcs, petsc_options={"snes_rtol": 1e-12})


def triangle(
    n, friction=3.0, *, load=(26.0, 7.5), lame=(100.0, 82.0), preload=None, law=None, comm=COMM
):
    """A right triangle on a floor, clamped on its slope, under a traction on its vertical side.

    It has one solution or several (Hild 2002; Ligursky and Renard).

    Args:
        n: number of cells along each edge.
        friction: coefficient of Coulomb's law.
        load: traction that is multiplied by -gamma.
        lame: Lame coefficients.
        preload: traction, an expression as a function of the mesh, by default zero.
        law: another law, as a function of the mesh.
        comm: communicator of the mesh.
    """
    square = mesh.create_unit_square(comm, n, n, diagonal=mesh.DiagonalType.left)
    domain = part_of(square, lambda x: x[0] + x[1] < 1 + 1e-9)
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    u = displacement(domain)
    gamma = fem.Constant(domain, -1.0)
    ds = ufl.Measure("ds", domain, subdomain_data=tagged(domain, {1: (0, 0.0)}))(1)
    first = fem.Constant(domain, np.zeros(2)) if preload is None else preload(domain)
    traction = first - gamma * fem.Constant(domain, load)
    energy = LinearElastic(*lame).energy(u) * ufl.dx - ufl.dot(traction, u) * ds
    law = Coulomb(friction) if law is None else law(domain)
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=law)
    problem = ContactProblem(energy, u, [contact], bcs=[prescribed(u, slope)])
    return ParametricContact(problem, gamma)


def bar(n, stiffness, law):
    """A bar on a bond, whose upper end is pulled up by gamma."""
    axes = [np.linspace(0.0, 0.05, 2), np.linspace(*UNIT, n + 1)]
    domain = create_grid(COMM, axes, CELLS["quad"])
    return block(domain=domain, law=law, energy=elastic(stiffness, 0.0)).driven(
        lambda gamma: (0.0, gamma)
    )


def cracked(n, law):
    """A block with a horizontal crack from its left side, in contact on the crack faces."""
    domain = box(n, "tri")
    domain.topology.create_entities(1)
    inside = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5) & (x[0] < 0.75 + 1e-9))
    every = [inside, facets(domain, 1, 0.0), facets(domain, 1, 1.0)]
    values = np.repeat(np.array([5, 1, 4], dtype=np.int32), [len(f) for f in every])
    order = np.argsort(np.concatenate(every))
    tags = mesh.meshtags(domain, 1, np.concatenate(every)[order], values[order])
    body = crack(domain, [5], facet_tags=tags)
    return pair(body, law=law, slave=5, master="5_opposite")


def hairpin(dim, h, law):
    """A U on its side whose inner face may touch itself, and whose upper arm is moved down.

    In 3D it is one cell wide. The nodes of the two arms do not lie opposite each other.
    """
    last = dim - 1
    axes = [np.linspace(0.0, 6.0, round(6 / h) + 1), np.linspace(0.0, 2.5, round(2.5 / h) + 1)]
    if dim == 3:
        axes.insert(1, np.array([0.0, h]))
    points, cells = _grid(axes)
    middle = points[cells].mean(axis=1)
    hole = (middle[:, 0] > 1) & (middle[:, last] > 1) & (middle[:, last] < 1.5)
    used, cells = np.unique(cells[~hole], return_inverse=True)
    points = points[used]
    cells = cells.reshape(-1, 2**dim)
    arm = (points[:, last] >= 1.5 - 1e-9) & (points[:, 0] > 1)
    points[arm, 0] = 1 + 5 * ((points[arm, 0] - 1) / 5) ** 1.15
    if COMM.rank > 0:
        points, cells = points[:0], cells[:0]
    kind = "quadrilateral" if dim == 2 else "hexahedron"
    element = ufl.Mesh(basix.ufl.element("Lagrange", kind, 1, shape=(dim,)))
    domain = mesh.create_mesh(COMM, cells=cells.astype(np.int64), x=points, e=element)

    inner = mesh.locate_entities_boundary(
        domain,
        last,
        lambda x: (x[0] > 1 - 1e-9) & (x[last] > 1 - 1e-9) & (x[last] < 1.5 + 1e-9),
    )
    middle = mesh.compute_midpoints(domain, last, inner)
    sides = np.isclose(middle[:, 0], 6.0)
    if dim == 3:
        sides |= (middle[:, 1] < 1e-9) | (middle[:, 1] > h - 1e-9)
    pressed = mesh.locate_entities_boundary(
        domain, last, lambda x: (x[last] > 2.5 - 1e-9) & (x[0] > 4.5)
    )
    u = displacement(domain)
    top = fem.Function(u.function_space)
    face = SelfContact(u, inner[~sides], law=law, direction=-np.eye(dim)[-1], search_distance=0.45)
    bcs = [prescribed(u, facets(domain, last, 0.0)), prescribed(u, pressed, top)]
    return Body(ContactProblem(rubber(u), u, [face], bcs=bcs), top)


def _grid(axes):
    """Points and cells of a grid of quadrilaterals or hexahedra, in the order of DOLFINx."""
    shape = [len(a) for a in axes]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    numbers = np.arange(len(points)).reshape(shape)
    corners = [()]
    for _ in axes:
        corners = [(*c, i) for i in (0, 1) for c in corners]
    corners = [
        numbers[tuple(slice(i, n - 1 + i) for i, n in zip(c, shape, strict=True))].ravel()
        for c in sorted(corners, key=lambda c: c[::-1])
    ]
    return points, np.stack(corners, axis=1)


# -- two bodies ------------------------------------------------------------------------------------


def pair(
    both,
    *,
    law=Coulomb(0.25),  # noqa: B008
    slave=3,
    master=2,
    motion=None,
    energy=None,
    degree=1,
    options=None,
    sides=False,
    **surface,
):
    """Two bodies in contact, the end with tag 1 held and the end with tag 4 moved.

    Args:
        both: mesh and facet tags, as of `stack`.
        law: contact law.
        slave: facet tag of the side with the contact points.
        master: facet tag of the opposite side.
        motion: displacement of the moved end, by default zero.
        energy: stored energy as a function of the displacement, by default `elastic`.
        degree: polynomial degree of the displacement.
        options: PETSc options.
        sides: whether the facets with x = 0 are held, and with them nodes of the interface.
        surface: further arguments of `ContactPair`.
    """
    u = displacement(both.mesh, degree)
    top = fem.Function(u.function_space)
    contact = ContactPair(u, both, slave=slave, master=master, law=law, **surface)
    ends = [prescribed(u, both.facet_tags.find(1)), prescribed(u, both.facet_tags.find(4), top)]
    if sides:
        ends.append(prescribed(u, facets(both.mesh, 0, 0.0)))
    stored = (energy or elastic())(u)
    body = Body(ContactProblem(stored, u, [contact], bcs=ends, petsc_options=options), top)
    if motion is not None:
        body.move(motion)
    return body


def two_blocks(n=4, law=Coulomb(0.25), ratio=1):  # noqa: B008
    """Two elastic blocks of different stiffness on each other."""
    both = stack("quad", (ratio * n, max(n // 2, 1), UNIT), (n, n, UNIT), 0.5)

    def energy(u):
        dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
        lower, upper = (
            LinearElastic.from_young(*given).energy(u) for given in ((300.0, 0.2), (1000.0, 0.3))
        )
        return upper * dx(2) + lower * dx(1)

    return pair(both, law=law, energy=energy)


# -- rigid surfaces --------------------------------------------------------------------------------


def polygon(n, centre, start=0.0):
    """Points and segments of a circle of radius 1."""
    angle = start + 2 * np.pi * np.arange(n) / n
    points = np.array(centre) + np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points, np.stack([np.arange(n), (np.arange(n) + 1) % n], axis=1)


def globe(n, centre):
    """Points and outward triangles of a sphere of radius 1, from n parallels and 2 n meridians."""
    angle = np.pi * np.arange(2 * n) / n
    rings = [
        (np.sin(a) * np.cos(angle), np.sin(a) * np.sin(angle), np.full(2 * n, np.cos(a)))
        for a in np.pi * np.arange(1, n) / n
    ]
    points = np.concatenate([np.stack(ring, axis=1) for ring in rings])
    north, south = len(points), len(points) + 1
    points = np.concatenate([points, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    cells = []
    for i in range(2 * n):
        j = (i + 1) % (2 * n)
        cells += [(north, i, j), (south, len(points) - 2 - 2 * n + j, len(points) - 2 - 2 * n + i)]
        for k in range(n - 2):
            a, b = 2 * n * k, 2 * n * (k + 1)
            cells += [(a + i, b + i, b + j), (a + i, b + j, a + j)]
    return np.array(centre) + points, np.array(cells)
