"""Errors about tags of cells, complex loads, gaps of cracks, and names of surfaces."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    ParametricContact,
    materials,
    meshing,
)
from dolfinx_contact.continuation import follow

COMM = MPI.COMM_WORLD


# -- meshing -------------------------------------------------------------------------------------


def marked(domain, dim, entities, value):
    entities = np.sort(entities).astype(np.int32)
    return mesh.meshtags(domain, dim, entities, np.full(len(entities), value, dtype=np.int32))


def cells_of(domain, value=1):
    return marked(domain, 2, np.arange(domain.topology.index_map(2).size_local), value)


def middle(domain, most=2.0):
    return mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5) & (x[0] < most + 1e-9))


def test_problem_refuses_cell_integrals_with_and_without_tags():
    """DOLFINx itself ends with an assertion."""
    held = block(n=2)
    u, domain = held.u, held.V.mesh
    dx = ufl.Measure("dx", domain, subdomain_data=cells_of(domain))
    bulk = materials.LinearElastic.from_young(1e3, 0.3).energy(u) * dx(1)
    with pytest.raises(ValueError, match="integrals over the cells have tags, and others"):
        ContactProblem(bulk - u[1] * ufl.dx, u, held.contacts, bcs=held.bcs)
    ContactProblem(bulk - u[1] * dx, u, held.contacts, bcs=held.bcs).solve()


def test_problem_refuses_complex_loads():
    held = block(n=2)
    real = fem.Constant(held.V.mesh, 1.0)  # a compiled form of the same signature exists
    ContactProblem(held.energy - real * held.u[1] * ufl.dx, held.u, held.contacts)
    load = fem.Constant(held.V.mesh, 1.0 + 1.0j)
    with pytest.raises(ValueError, match="complex values"):
        ContactProblem(held.energy - load * held.u[1] * ufl.dx, held.u, held.contacts)


# -- pairs ---------------------------------------------------------------------------------------


def cracked(gap, most=2.0, **given):
    """Return a plate that is clamped below and above, with a crack in its middle up to ``most``."""
    domain = box(COMM, 4, "quad")
    body = meshing.crack(domain, [5], facet_tags=marked(domain, 1, middle(domain, most), 5))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gap = fem.Constant(body.mesh, gap)
    opened = given.pop("shape", lambda g, x: g)(gap, ufl.SpatialCoordinate(body.mesh))
    pair = ContactPair(u, body.facet_tags, slave=5, master=6, law=Coulomb(0.3), gap=opened, **given)
    bcs = []
    for height in (0.0, 1.0):
        dofs = fem.locate_dofs_topological(V, 1, facets(body.mesh, 1, height))
        bcs.append(fem.dirichletbc(np.zeros(2), dofs, V))
    energy = materials.LinearElastic.from_young(1e3, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [pair], bcs=bcs), gap


def test_solve_and_follow_refuse_a_gap_that_becomes_negative():
    """A press fit needs ``interference=True``."""
    problem, gap = cracked(1e-3)
    assert problem.solve().counts["open"] == 5
    gap.value = -1e-3
    with pytest.raises(ValueError, match=r"given gap is -0\.001; interference=True"):
        problem.solve()
    system = ParametricContact(problem, gap)
    x = problem.create_vector()
    with pytest.raises(ValueError, match=r"given gap is -0\.001; interference=True"):
        follow(system, x, 1e-3, gamma_range=(-1e-3, 1e-3))
    gap.value = 2e-3
    assert problem.solve().counts["open"] == 5


def test_interference_at_the_front_of_a_crack_is_refused():
    problem, _ = cracked(-1e-3, 0.5, interference=True)
    with pytest.raises(ValueError, match=r"gap is -0\.001 at the front of the crack"):
        problem.solve()
    fades = cracked(-1e-3, 0.5, interference=True, shape=lambda g, x: g * (1 - 2 * x[0]))[0]
    result = fades.solve()
    assert result.counts["clamped"] == 1
    assert result.tables["contact"].rn.max() > 0


# -- names and words -----------------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_results_list_the_names_of_surfaces_for_an_unknown_name():
    result = block(n=2).solve()
    for named in (result.tables, result.resultants):
        with pytest.raises(KeyError, match="nothing is named 'Contact' here; names: 'contact'"):
            named["Contact"]
    with pytest.raises(KeyError, match="names: none"):
        result.pairs["contact"]
    assert result.tables.get("Contact") is None
