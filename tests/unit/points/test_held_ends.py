"""Mortars whose ends are held: the dual functions there go to the nodes around them."""

import numpy as np
import pytest
from support.mortars import BASE, TILT, solids, solved_patch, stacked
from support.pairs import MATERIAL, displacement, held

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless

REACH = (0.0, 1.0)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    ("cells", "sides", "fixed", "clamped"),
    [
        ((6, 5), (3, 2), (1, 5), 1),
        ((5, 6), (2, 3), (1, 5), 1),
        ((7, 3), (3, 2), (1, 5, 6), 2),
        ((7, 3), (2, 3), (1, 5, 6), 2),
    ],
)
@pytest.mark.verifies(
    "mortar",
    reference="closed form: a linear displacement",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_pressure_and_shear_at_held_ends_are_uniform(cells, sides, fixed, clamped):
    """Both bodies are held aside: uniform pressure and shear go to the master up to its end."""
    both = stacked(*cells, REACH, REACH, "tri")
    aside = tuple({4, 5, 6} - set(fixed))
    options = {"method": "nodal", "fixed": fixed}
    table = solved_patch(both, np.eye(2), BASE, sides, (1, 1), aside, **options)
    assert table.count("d") == clamped


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "counts", "sides", "fixed", "clamped"),
    [
        ("tet", (2, 3), (2, 3), (5,), 3),
        ("hex", (3, 4), (2, 3), (5, 6, 7, 8), 12),
        ("tet", (4, 3), (3, 2), (5, 7), 7),
    ],
)
@pytest.mark.verifies(
    "mortar",
    reference="closed form: a linear displacement",
    aspects=(
        "3D",
        "pairs",
    ),
)
def test_pressure_and_shear_at_held_ends_in_space_are_uniform(cell, counts, sides, fixed, clamped):
    base = np.array([[0.3, -0.1, 0.02], [0.07, 0.1, -0.03], [0.01, 0.04, -0.5]])
    both = solids(*counts, REACH, REACH, cell)
    options = {"method": "nodal", "fixed": (1, *fixed)}
    aside = tuple({4, 5, 6, 7, 8} - set(fixed))
    table = solved_patch(both, TILT, base, sides, (1, 1), aside, **options)
    assert table.count("d") == clamped


def parts(below, above, law, *, hold=(1, 2), sides=(3, 2)):
    """Two blocks under a load, the left sides of some held: energy, u, pair, Dirichlet data."""
    both = stacked(below, above, REACH, REACH)
    u = displacement(both.mesh)
    V = u.function_space
    left = fem.locate_dofs_topological(V, 1, both.facet_tags.find(5))
    of_parts = [fem.locate_dofs_topological(V, 2, both.cell_tags.find(part)) for part in hold]
    still = [np.intersect1d(left, part).astype(np.int32) for part in of_parts]
    ends = [held(u, both.facet_tags, 1, (0, 0))]
    ends += [fem.dirichletbc(np.zeros(2), dofs, V) for dofs in still]
    slave, master = sides
    pair = ContactPair(u, both, slave=slave, master=master, law=law)
    ds = ufl.Measure("ds", both.mesh, subdomain_data=both.facet_tags)
    energy = MATERIAL.energy(u) * ufl.dx + 3 * u[1] * ds(4)
    return energy, u, pair, ends


def pressed(*args, **options):
    energy, u, pair, ends = parts(*args, **options)
    return ContactProblem(energy, u, [pair], bcs=ends)


@pytest.mark.parametrize(("law", "n"), [(Coulomb(0.4), 15), (Frictionless(), 30)])
def test_no_pressure_of_its_own(law, n):
    """The pressures at an end that is held are those of matching meshes.

    With a multiplier of its own the end had up to a hundred times the pressure beside it.
    """
    matching, other = (pressed(below, n, law).solve() for below in (n, n + 1))
    a, b = (r.tables["contact"] for r in (matching, other))
    assert a.letters[0] == b.letters[0] == "d"
    np.testing.assert_allclose(b.pressure[1:], a.pressure[1:], rtol=0.1)
    assert b.pressure.max() < 1.02 * a.pressure.max()
    energies = [r.energies["bulk"] for r in (matching, other)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-3)


def test_an_end_opposite_to_what_moves():
    """One body is held, the other not: their ends still push each other."""
    for hold, sides in (((2,), (3, 2)), ((1,), (3, 2)), ((1,), (2, 3))):
        table = pressed(16, 15, Coulomb(0.4), hold=hold, sides=sides).solve().tables["contact"]
        assert "d" not in table.status
