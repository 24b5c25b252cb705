"""Faces sliding off the rim of an open rigid surface."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import CELLS, facets
from support.pairs import displacement, tagged

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, ContactSurface, Coulomb, RigidSurface
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.grids import create_grid
from dolfinx_contact.laws import Frictionless
from dolfinx_contact.materials import NeoHookean, lame
from dolfinx_contact.meshing import join

COMM = MPI.COMM_WORLD
RUBBER = NeoHookean(*lame(1000.0, 0.3))
END = 0.8  # of the tool, below a block from 0 to 1
TIMES = [0.0, 1.0, *np.linspace(1.1, 2.0, 10)]


def law_of(friction):
    return Coulomb(friction) if friction else Frictionless()


def led_off(u, surface, held, top, *, at_sides=()):
    """The steps of a block that is pressed by 0.05 and led off the tool."""
    dim = len(u)
    domain = u.function_space.mesh
    way = fem.Constant(domain, [0.0] * dim)
    bcs = [*held, fem.dirichletbc(way, top, u.function_space), *at_sides]
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    problem = ContactProblem(RUBBER.energy(u) * dx, u, [surface], bcs=bcs)

    def load(t):
        way.value[0] = max(t - 1.0, 0.0)
        way.value[dim - 1] = -0.05 * min(t, 1.0)

    history = QuasiStatic(problem, load).run(TIMES, shortest=0.02)
    return [step for step in history.steps if step.time in TIMES]


def off_surface(dim, cell, friction, *, method="nodal", n=8, overlap=0.0, end=END):
    """Forces on a block leaving an open rigid surface, and the work of its loads.

    In space the block is a slice. It starts in the surface by an overlap that is removed.
    """
    ends = np.linspace(0.0, 1.0, n + 1)
    body = create_grid(COMM, [ends, *[[0.0, 1.0 / n]] * (dim - 2), ends], CELLS[cell])
    u = displacement(body)
    V = u.function_space
    if dim == 2:
        tool = RigidSurface([[-3.0, overlap], [end, overlap]], [[1, 0]])
    else:
        corners = [[-3.0, -1.0], [end, -1.0], [end, 1.0], [-3.0, 1.0]]
        tool = RigidSurface([[*x, overlap] for x in corners], [[0, 1, 2], [0, 2, 3]])
    below = facets(body, dim - 1, 0.0)
    given = dict(obstacle=tool, law=law_of(friction), method=method)
    given |= {"remove_overlap": 1.01 * overlap} if overlap else {}
    face = ContactSurface(u, below, **given)
    top = fem.locate_dofs_topological(V, dim - 1, facets(body, dim - 1, 1.0))
    sides = []
    if dim == 3:
        W = V.sub(1)
        planes = np.union1d(facets(body, 1, 0.0), facets(body, 1, 1.0 / n))
        dofs = fem.locate_dofs_topological(W, 2, planes)
        sides = [fem.dirichletbc(fem.Constant(body, 0.0), dofs, W)]
    steps = led_off(u, face, [], top, at_sides=sides)
    forces = np.array([step.result.resultants["contact"] for step in steps])
    return forces, [step.energies.external for step in steps]


def off_pair(cell, friction, n=8):
    """The same of a tool that is a mesh, and held as a whole: its face is the slave."""
    ends = np.linspace(0.0, 1.0, n + 1)
    block = create_grid(COMM, [ends, ends], CELLS[cell])
    under = create_grid(COMM, [np.linspace(-0.6, END, n), [-0.2, 0.0]], CELLS[cell])
    tags = [tagged(block, t1=(1, 0.0), t2=(1, 1.0)), tagged(under, t3=(1, 0.0))]
    both = join([block, under], facet_tags=tags)
    u = displacement(both.mesh)
    V = u.function_space
    pair = ContactPair(
        u, both, slave=3, master=1, law=law_of(friction), sliding="large", search_distance=0.2
    )
    tool = np.unique(V.dofmap.list[both.cell_tags.find(2)]).astype(np.int32)
    held = [fem.dirichletbc(np.zeros(2), tool, V)]
    top = fem.locate_dofs_topological(V, 1, both.facet_tags.find(2))
    steps = led_off(u, pair, held, top)
    return -np.array([step.result.pairs["contact"].slave for step in steps])


@pytest.mark.each_value
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(("cell", "method"), [("tri", "nodal"), ("quad", "integral")])
@pytest.mark.verifies(
    "surfaces of facets",
    "Signorini",
    "Coulomb",
    "quasi-static",
    reference="itself: the same tool as a body that is held; closed form: Coulomb's force",
    aspects=("2D", "pairs", "large sliding"),
)
def test_open_tool_agrees_with_a_meshed_tool(friction, cell, method):
    """Forces fall with the contact that remains on the tool to zero, as between a pair.

    Without a rotating force no energy is added.
    """
    found, work = off_surface(2, cell, friction, method=method)
    wanted = off_pair(cell, friction)
    whole = wanted[0, 1]
    # The face leaves the mesh of the tool at its very end, the surface within a facet of the face.
    before = [t < 1.75 for t in TIMES[1:]]
    off = (found - wanted)[before, 1] / whole
    assert np.abs(off).max() < 0.04
    assert abs(off.mean()) < 0.025
    assert (np.diff(found[:, 1]) < 1e-9 * whole).all()
    sliding = found[2:]
    np.testing.assert_allclose(sliding[:, 0], -friction * sliding[:, 1], atol=1e-8 * whole)
    assert np.abs(found[-1]).max() < 1e-9 * whole
    dragged = friction * np.cumsum((found[1:, 1] + found[:-1, 1]) / 2 * np.diff(TIMES[1:]))
    start = 1 if friction else 0  # it slides from the second step on
    np.testing.assert_allclose(
        np.diff(work)[start:], np.diff(dragged, prepend=0.0)[start:], atol=1e-8 * whole
    )
    assert work[0] > 0.02 * whole


@pytest.mark.parametrize("friction", [pytest.param(0.0, marks=pytest.mark.long), 0.3])
@pytest.mark.verifies(
    "surfaces of facets",
    "Coulomb",
    "quasi-static",
    reference="itself: plane strain",
    aspects=("2D", "3D", "large sliding"),
)
def test_slice_leaves_as_the_plane(friction):
    """A slice of hexahedra over a surface of triangles, as quadrilaterals over one segment."""
    n = 4
    found = n * off_surface(3, "hex", friction, n=n)[0]
    wanted = off_surface(2, "quad", friction, n=n)[0]
    np.testing.assert_allclose(found[:, [0, 2]], wanted, atol=1e-7 * wanted[0, 1])
    assert wanted[0, 1] > 40.0
