"""Faces that touch themselves, in space."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.pairs import displacement
from support.sliding_bodies import hairpin, smooth

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, Frictionless, SelfContact
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(*lame(1000.0, 0.3))
ARM, RADIUS, THICK = 1.5, 0.3, 0.1  # of a plate that is folded
LENGTH = 2 * ARM + np.pi * RADIUS
APART = 2 * RADIUS - THICK  # the arms
TURN = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()


class Plate:
    """A thin plate, both of whose faces may touch themselves, and each other."""

    def __init__(self, comm=COMM, cell=mesh.CellType.tetrahedron):
        corners = [(0.0, 0.0, 0.0), (LENGTH, 0.5, THICK)]
        domain = mesh.create_box(comm, corners, [24, 3, 1], cell)
        faces = mesh.locate_entities_boundary(
            domain, 2, lambda x: (x[2] < 1e-9) | (x[2] > THICK - 1e-9)
        )
        # Of the facets of the sides none has all its nodes on one of the faces.
        middles = mesh.compute_midpoints(domain, 2, faces)
        faces = faces[np.abs(np.abs(middles[:, 2] - THICK / 2) - THICK / 2) < 1e-9]
        self.u = displacement(domain)
        self.V = self.u.function_space
        given = {"law": Frictionless(), "direction": (1, 0, 0), "search_distance": 0.6}
        self.contact = SelfContact(self.u, faces, **given)
        self.pair = discretise(self.contact)
        n = self.V.dofmap.index_map.size_local
        self.X = self.V.tabulate_dof_coordinates()[:n]

    def folded(self, down=0.0):
        """Displacements of the owned nodes: a U, turned, whose upper arm comes down."""
        s, y, z = self.X.T
        h = z - THICK / 2
        angle = np.clip((s - ARM) / RADIUS, 0.0, np.pi)
        below = np.minimum(s, ARM)
        above = np.maximum(s - ARM - np.pi * RADIUS, 0.0)
        x = below + (RADIUS - h) * np.sin(angle) - above
        z = RADIUS - (RADIUS - h) * np.cos(angle)
        z = z - down * np.clip(above / 0.6, 0.0, 1.0)
        return np.stack([x, y, z], axis=1) @ TURN.T - self.X

    def facing(self, u):
        return self.pair.points.at(u, None).facing.nodal


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("cell", [mesh.CellType.tetrahedron, mesh.CellType.hexahedron])
@pytest.mark.verifies(
    "self contact",
    reference="closed form: the gap between the arms of a folded plate",
    aspects=("3D", "large sliding"),
)
def test_a_folded_plate(cell):
    """Arms face each other once, neighbours and the other face of a thin plate do not."""
    plate = Plate(cell=cell)
    n = plate.pair.points.number
    X = plate.X[plate.pair.points.vertex_trace_dofs[:n]]
    for scale in (0.0, 1e-2):  # through the thickness nothing faces, though it is near
        bent = scale * smooth(plate.X, 4, 1.0)
        assert not plate.facing(bent).weight.any()
    nodal = plate.facing(plate.folded())
    inner = X[:, 2] > THICK / 2
    upper = X[:, 0] > LENGTH - ARM
    assert not nodal.weight[:n][~inner].any()
    assert not nodal.weight[:n][X[:, 0] < ARM].any()
    inside = inner & upper & (X[:, 0] > LENGTH - ARM + 0.3) & (X[:, 0] < LENGTH - 0.3)
    assert COMM.allreduce(int(inside.sum())) >= 20
    np.testing.assert_allclose(nodal.gap[:n][inside], APART, rtol=1e-9)
    areas = plate.pair.points.areas
    np.testing.assert_allclose(nodal.weight[:n][inside], areas[inside], rtol=1e-9)
    # The same on one rank.
    total = COMM.allreduce(nodal.weight[:n].sum())
    alone = Plate(MPI.COMM_SELF, cell)
    assert total == pytest.approx(alone.facing(alone.folded()).weight.sum(), rel=1e-9)


# -- a hairpin -------------------------------------------------------------------------------------


def extruded(flat, width, layers):
    """Hexahedra of quadrilaterals that are all on one rank, along y; x and y become x and z."""
    cells = flat.geometry.dofmap.astype(np.int64)
    x = flat.geometry.x
    n = len(x)
    y = np.linspace(0.0, width, layers + 1)
    points = np.concatenate([np.stack([x[:, 0], np.full(n, a), x[:, 1]], axis=1) for a in y])
    many = [np.concatenate([cells + k * n, cells + (k + 1) * n], axis=1) for k in range(layers)]
    cells = np.concatenate(many)
    if COMM.rank:
        cells, points = cells[:0], points[:0]
    element = basix.ufl.element("Lagrange", "hexahedron", 1, shape=(3,))
    return mesh.create_mesh(COMM, cells=cells, x=points, e=element)


def pressed_hairpin(domain, inner):
    """Force that closes the arms, per width, and the result."""
    dim = domain.geometry.dim
    u = displacement(domain)
    V = u.function_space
    law = Frictionless()
    along = -np.eye(dim)[-1]
    face = SelfContact(u, inner, law=law, direction=along, search_distance=0.45)
    last = dim - 1
    below = fem.locate_dofs_geometrical(V, lambda x: x[last] < 1e-9)
    W = V.sub(last)
    facets = mesh.locate_entities_boundary(
        domain, last, lambda x: (x[last] > 2.5 - 1e-9) & (x[0] > 4.5)
    )
    above = fem.locate_dofs_topological(W, last, facets)
    value = fem.Constant(domain, 0.0)
    bcs = [fem.dirichletbc(np.zeros(dim), below, V), fem.dirichletbc(value, above, W)]
    if dim == 3:  # plane strain
        sides = mesh.exterior_facet_indices(domain.topology)
        middles = mesh.compute_midpoints(domain, 2, sides)
        width = COMM.allreduce(domain.geometry.x[:, 1].max(), max)
        sides = sides[(middles[:, 1] < 1e-9) | (middles[:, 1] > width - 1e-9)]
        dofs = fem.locate_dofs_topological(V.sub(1), 2, sides)
        bcs.append(fem.dirichletbc(0.0, dofs, V.sub(1)))
    energy = RUBBER.energy(u) * ufl.dx(metadata={"quadrature_degree": 3})
    problem = ContactProblem(energy, u, [face], bcs=bcs)

    def load(t):
        value.value = -t

    history = QuasiStatic(problem, load).run(np.linspace(0.0, 0.6, 3))
    assert history.reason == "the last time is reached"
    reactions = problem.evaluate().reactions
    mine = above[above < len(reactions)]
    return -COMM.allreduce(reactions[mine].sum()), history.steps[-1].result


@pytest.mark.verifies(
    "self contact",
    "hyperelastic bodies",
    reference="itself: plane strain in the plane",
    aspects=("3D", "large sliding"),
)
def test_a_hairpin_in_plane_strain():
    """A U drawn out along y and held there: force and contact are those in the plane."""
    flat, _ = hairpin(0.25)
    found = []
    for domain in (flat, extruded(hairpin(0.25, comm=MPI.COMM_SELF)[0], 0.25, 1)):
        last = domain.geometry.dim - 1

        def inner(x, last=last):
            z = x[last]
            return (x[0] > 1 - 1e-9) & (z > 1 - 1e-9) & (z < 1.5 + 1e-9)

        domain.topology.create_connectivity(last, last + 1)
        facets = mesh.locate_entities_boundary(domain, last, inner)
        middles = mesh.compute_midpoints(domain, last, facets)
        facets = facets[~np.isclose(middles[:, 0], 6.0)]
        if last == 2:
            middles = mesh.compute_midpoints(domain, last, facets)
            facets = facets[(middles[:, 1] > 1e-9) & (middles[:, 1] < 0.25 - 1e-9)]
        found.append(pressed_hairpin(domain, facets))
    (plane, in_plane), (space, in_space) = found
    closed = [np.sum(r.tables["contact"].letters != "o") for r in (in_plane, in_space)]
    assert closed[0] >= 3
    assert closed[1] == 2 * closed[0]
    assert space / 0.25 == pytest.approx(plane, rel=1e-6)
    assert in_space.pairs["contact"].imbalance < 1e-13
