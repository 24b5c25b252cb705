"""Contact and support apart: resultants, the balance of forces, tables and fields."""

import csv

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import KINDS, block, box, facets
from support.pairs import displacement, held, stacked

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.io import write_contact_table
from dolfinx_contact.laws import status
from dolfinx_contact.materials import CiarletGeymonat, LinearElastic, NeoHookean
from dolfinx_contact.results.result import collect

#: What ranks do to each other is tested in all cases on two of them.
pytestmark = pytest.mark.ranks(2, every_case=True)

COMM = MPI.COMM_WORLD
STEEL = LinearElastic.from_young(1000.0, 0.3)


def floor(dim):
    return HalfSpace(np.zeros(dim), np.eye(dim)[-1])


def arch(n, degree, lift=0.01):
    """A body clamped on its left side, whose foot there is ``lift`` above the floor, pressed down.

    The underside falls to the right: the clamped contact node stays open.
    """
    domain = box(COMM, n, "tri")
    x = domain.geometry.x
    x[:, 1] += lift * (1 - x[:, 0]) * (1 - x[:, 1])
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    held = fem.locate_dofs_topological(V, 1, facets(domain, 0, 0.0))
    below = mesh.locate_entities_boundary(domain, 1, lambda x: x[1] < lift * (1 - x[0]) + 1e-9)
    surface = ContactSurface(u, below, obstacle=floor(2), law=Coulomb(0.3))
    load = fem.Constant(domain, (0.0, -20.0))
    energy = STEEL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    clamp = fem.dirichletbc(np.array([0.004, 0.0]), held, V)
    return ContactProblem(energy, u, [surface], bcs=[clamp])


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("material", ["linear", "neo-Hookean"])
@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "balance of forces",
    "hyperelastic bodies",
    reference="theorem: contact, support and loads are in equilibrium",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_all_forces_balance(dim, cell, material):
    """Body force, traction, clamped and half-fixed nodes: contact + support + external = 0."""
    domain = box(COMM, 4 if dim == 2 else 2, cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    x = ufl.SpatialCoordinate(domain)
    law = STEEL if material == "linear" else NeoHookean(600.0, 400.0)
    body = fem.Constant(domain, (3.0, -40.0) if dim == 2 else (3.0, 2.0, -40.0))
    pull = fem.Constant(domain, (5.0, -10.0) if dim == 2 else (5.0, -4.0, -10.0))
    right = facets(domain, 0, 1.0)
    ds = ufl.Measure("ds", domain, subdomain_data=mesh.meshtags(domain, dim - 1, np.sort(right), 1))
    energy = law.energy(u) * ufl.dx - ufl.dot(body, u) * ufl.dx - x[0] * ufl.dot(pull, u) * ds(1)
    left = facets(domain, 0, 0.0)
    symmetry = fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(0), dim - 1, left), V.sub(0))
    edge = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0], 1) & np.isclose(x[dim - 1], 1))
    held = fem.dirichletbc(np.full(dim, 0.001), edge, V)
    surface = ContactSurface(u, facets(domain, dim - 1, 0.0), obstacle=floor(dim), law=Coulomb(0.2))
    problem = ContactProblem(
        energy, u, [surface], bcs=[symmetry, held], petsc_options={"snes_rtol": 1e-12}
    )
    result = problem.solve()
    contact = result.resultants["contact"]
    table = result.tables["contact"]
    np.testing.assert_allclose(result.external, body.value + pull.value, rtol=1e-12)
    size = np.linalg.norm(contact) + np.linalg.norm(result.support)
    assert np.linalg.norm(contact + result.support + result.external) < 1e-9 * size
    assert result.imbalance < 1e-9
    # On the symmetry plane the normal multiplier is contact, the x component support.
    on_plane = np.isclose(table.x[:, 0], 0.0)
    assert not (table.letters[on_plane] == "d").any()
    assert table.rn[on_plane].min() > 0
    assert np.abs(table.force[on_plane, 0]).max() < 1e-12 * size
    assert np.abs(table.support[on_plane, 0]).min() > 1e-4 * size
    assert not table.support[on_plane, 1:].any()
    assert not table.support[~on_plane].any()
    summary = result.summary()
    assert summary["support"] == result.support.tolist()
    assert summary["external"] == result.external.tolist()
    assert summary["force_imbalance"] == result.imbalance


@pytest.mark.parametrize(("degree", "method"), [(1, "nodal"), (1, "mixed"), (2, "integral")])
@pytest.mark.verifies(
    "balance of forces",
    "nodal contact",
    "mixed contact",
    "integral contact",
    reference="closed form: a pressed block",
    aspects=("2D",),
)
def test_pressed_block_has_its_closed_form(degree, method):
    """A pressure of 3 on a block of width 1 without lateral strain: contact 3, support 0."""
    domain = box(COMM, 4, "tri")
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    p = fem.Constant(domain, 3.0)
    top = mesh.meshtags(domain, 1, np.sort(facets(domain, 1, 1.0)), 1)
    ds = ufl.Measure("ds", domain, subdomain_data=top)
    energy = LinearElastic.from_young(1000.0, 0.0).energy(u) * ufl.dx + p * u[1] * ds(1)
    left = fem.locate_dofs_topological(V.sub(0), 1, facets(domain, 0, 0.0))
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=floor(2), law=Frictionless(), method=method
    )
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(0.0, left, V.sub(0))])
    result = problem.solve()
    np.testing.assert_allclose(result.resultants["contact"], (0.0, 3.0), atol=1e-10)
    np.testing.assert_allclose(result.support, 0.0, atol=1e-10)
    np.testing.assert_allclose(result.external, (0.0, -3.0), atol=1e-12)
    np.testing.assert_allclose(result.tables["contact"].pressure, 3.0, rtol=1e-9)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(("degree", "at_end"), [(1, 1 / 2), (2, 1 / 6)])
@pytest.mark.verifies(
    "balance of forces",
    reference="closed form: compressed blocks whose top is held by two conditions",
    aspects=("2D", "pairs"),
)
def test_reaction_of_each_support_has_its_closed_form(degree, at_end):
    """A stress of 5 in both blocks; the middle node of the top counts for the last condition."""
    n = 4
    both = stacked(2, "quad", n)
    u = displacement(both.mesh, degree)
    V = u.function_space
    halves = [
        fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 2) & (x[0] < 0.5 + 1e-9)),
        fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 2) & (x[0] > 0.5 - 1e-9)),
    ]
    bcs = [fem.dirichletbc(np.array([0.0, -0.01]), dofs, V) for dofs in halves]
    bcs.append(held(u, both.facet_tags, 1, (0.0, 0.0)))
    energy = LinearElastic.from_young(1000.0, 0.0).energy(u) * ufl.dx
    pair = ContactPair(u, both, slave=3, master=2, law=Frictionless())
    problem = ContactProblem(energy, u, [pair], bcs=bcs)
    result = problem.solve()
    middle = 5.0 * at_end / n  # force at the middle node from the facet in one half
    expected = [(0.0, -2.5 + middle), (0.0, -2.5 - middle), (0.0, 5.0)]
    np.testing.assert_allclose(result.supports, expected, atol=1e-10)
    np.testing.assert_allclose(result.supports.sum(axis=0), result.support, atol=1e-10)
    words = ", ".join(f"(0, {force:g})" for _, force in expected)
    assert f"reactions of Dirichlet data: {words};" in str(result)


def test_an_imbalance_is_measured_and_said(caplog):
    problem = block(n=4, cell="tri")
    assert problem.solve().imbalance < 1e-9
    assert not caplog.records
    problem.surfaces[0].multiplier.x.array[:] *= 1.1
    result = collect(problem.equations, problem.evaluate(), [])
    # The support is that of a body with these contact forces; free nodes are out of balance.
    assert 0.01 < result.imbalance < 0.1
    assert "out of balance" in result.warnings["imbalance"]


def test_clamped_points_are_in_the_contact_table(folder):
    result = arch(12, 1).solve()
    assert result.counts["clamped"] == 1
    assert result.imbalance < 1e-9
    table = result.tables["contact"]
    counts = status.count(table.status)
    assert str(table).startswith(f"contact: {len(table.x)} points ({counts['open']} open, ")
    assert len(str(table)) < 200
    write_contact_table(COMM, folder, [table])
    with open(folder / "contact.csv") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0])[-4:] == ["status", "support_x", "support_y", "support_z"]
    assert [r["status"] for r in rows] == list(table.letters)
    clamped = rows[0]
    rest = rows[1:]
    assert clamped["status"] == "d"
    for key in ("rn", "rt", "rt_x", "rt_y", "pressure", "shear"):
        assert clamped[key] == "0.0"
    assert float(clamped["support_x"]) == table.support[0, 0] != 0.0
    assert float(clamped["support_y"]) == table.support[0, 1] != 0.0
    assert all(float(r[f"support_{axis}"]) == 0.0 for r in rest for axis in "xyz")
    assert sum(float(r["rn"]) for r in rest) > 1.0


@pytest.mark.parametrize(("aside", "letter"), [(0.01, "+"), (0.0, "k"), (-0.001, "-")])
def test_a_prescribed_slip_is_no_violation(aside, letter):
    """Where the support moves a closed node along the floor friction has nothing to hold."""
    domain = box(COMM, 3, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=HalfSpace((0.0, 0.0), (0.0, 1.0)), law=Coulomb(0.3)
    )
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    side = fem.locate_dofs_topological(V.sub(0), 1, facets(domain, 0, 0.0))
    bcs = [fem.dirichletbc(np.array([0.01, -0.01]), top, V), fem.dirichletbc(aside, side, V.sub(0))]
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    result = ContactProblem(energy, u, [surface], bcs=bcs).solve()
    assert result.kkt_violation < 1e-9
    table = result.tables["contact"]
    assert table.letters[0] == letter
    assert table.bound[0] == 0.0 < table.rn[0]


@pytest.mark.parametrize(
    "material", [NeoHookean(600.0, 400.0), CiarletGeymonat(4000.0, 120.0, 30.0)]
)
def test_body_without_load_has_no_forces(material):
    """Nothing touches it: the stresses are round-off, also after it was pressed and lifted."""
    problem = block(material=material, obstacle=HalfSpace((0.0, -0.1), (0.0, 1.0)), top=(0.0, 0.0))
    result = problem.solve()
    assert (result.iterations, result.kkt_violation) == (0, 0.0)
    (moved,) = problem.bcs
    for height in (-0.15, 0.05, 0.1, 0.2):
        moved.g.value[1] = height
        result = problem.solve()
        assert result.kkt_violation < 1e-8
        assert (result.counts["open"] == 5) == (height > 0)
