"""Bodies starting in each other: refused, a press fit, or removed without stress."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import CELLS
from support.pairs import displacement

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Frictionless,
    SelfContact,
)
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic, lame
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
OVERLAP = 0.04
LMBDA, MU = lame(1000.0, 0.3)
KINDS = [(dim, kind) for dim in (2, 3) for kind in ("small", "large", "itself")]


def strips(dim):
    """Two bodies on each other, of height 1, of which the upper one starts in the lower one."""
    parts = []
    for name, low, cells in (("lower", -1.0, 2), ("upper", -OVERLAP, 3)):
        aside = [np.linspace(0.0, 1.0, cells + 1)] * (dim - 1)
        kind = "quad" if dim == 2 else "hex"
        body = create_grid(COMM, [*aside, low + np.linspace(0.0, 1.0, 3)], CELLS[kind])
        height = 0.0 if name == "lower" else -OVERLAP
        tag = 1 if name == "lower" else 2

        def here(x, height=height):
            return np.isclose(x[dim - 1], height)

        facets = np.sort(mesh.locate_entities_boundary(body, dim - 1, here))
        tags = np.full(len(facets), tag, dtype=np.int32)
        parts.append((body, mesh.meshtags(body, dim - 1, facets, tags)))
    bodies, tags = zip(*parts, strict=True)
    return join(bodies, facet_tags=tags)


def surface(u, both, sliding, **given):
    """A pair of both faces, or one face of both."""
    if sliding == "itself":
        facets = np.union1d(both.facet_tags.find(1), both.facet_tags.find(2))
        return SelfContact(u, facets, law=Frictionless(), **given)
    return ContactPair(u, both, slave=2, master=1, law=Frictionless(), sliding=sliding, **given)


def pressed(dim, sliding, **given):
    """The strips between plates, in uniaxial strain."""
    both = strips(dim)
    u = displacement(both.mesh)
    V = u.function_space
    pair = surface(u, both, sliding, **given)
    bcs = []
    for axis in range(dim):
        ends = (-1.0, 1.0 - OVERLAP) if axis == dim - 1 else (0.0, 1.0)
        W = V.sub(axis)

        def here(x, axis=axis, ends=ends):
            return np.isclose(x[axis], ends[0]) | np.isclose(x[axis], ends[1])

        facets = mesh.locate_entities_boundary(both.mesh, dim - 1, here)
        dofs = fem.locate_dofs_topological(W, dim - 1, facets)
        bcs.append(fem.dirichletbc(fem.Constant(both.mesh, 0.0), dofs, W))
    energy = LinearElastic(LMBDA, MU).energy(u) * ufl.dx
    return ContactProblem(energy, u, [pair], bcs=bcs)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("dim", "sliding"), KINDS)
@pytest.mark.verifies(
    "press fits",
    reference="closed form: uniaxial strain by half the overlap, or none where it is removed",
    aspects=("2D", "3D", "pairs", "large sliding"),
)
def test_press_fit_has_the_pressure_of_half_the_overlap(dim, sliding):
    """A press fit has the pressure of half the overlap in each strip; removed it leaves nothing."""
    modulus = LMBDA + 2 * MU
    fit = pressed(dim, sliding, interference=1.01 * OVERLAP).solve()
    table = fit.tables["contact"]
    facing = np.isfinite(table.un)
    assert facing.sum() >= 3 ** (dim - 1)
    np.testing.assert_allclose(table.pressure[facing], 0.5 * OVERLAP * modulus, rtol=1e-8)
    free = pressed(dim, sliding, remove_overlap=1.01 * OVERLAP)
    result = free.solve()
    np.testing.assert_allclose(result.tables["contact"].un[facing], 0.0, atol=1e-14)
    np.testing.assert_allclose(result.tables["contact"].force, 0.0, atol=1e-10)
    np.testing.assert_allclose(free.u.x.array, 0.0, atol=1e-13)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("dim", "sliding"), KINDS)
@pytest.mark.refuses("press fits", aspects=("2D", "3D", "pairs", "large sliding"))
def test_an_overlap_beyond_its_limit_is_refused(dim, sliding):
    """More than is allowed, and arguments that say two things or none."""
    both = strips(dim)
    u = displacement(both.mesh)
    if sliding == "small":
        beyond = ({"gap": -0.1, "interference": 0.09}, r"gap is -0\.1; interference allows 0\.09")
    else:  # else they would not find each other, and nothing would press
        beyond = (
            {"interference": True, "search_distance": 0.9 * OVERLAP},
            r"(farther|more) than the search distance 0\.036",
        )
    for options, words in (
        beyond,
        ({}, r"overlap by 0\.04; interference=True for a press fit"),
        ({"interference": 0.9 * OVERLAP}, r"overlap by 0\.04; interference allows 0\.036"),
        ({"remove_overlap": 0.9 * OVERLAP}, r"overlap by 0\.04; remove_overlap allows 0\.036"),
        ({"interference": -1.0}, "interference must be True, False or the largest overlap"),
        ({"remove_overlap": True}, "remove_overlap must be the largest overlap that is removed"),
        ({"interference": True, "remove_overlap": 0.1}, "and not both"),
    ):
        with pytest.raises(ValueError, match=words):
            discretise(surface(u, both, sliding, **options))
