"""Integral contact between non-matching faces: Gauss points on their intersections."""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from support.mortars import (
    BASE,
    CASES,
    SIDES,
    SOLID_BASE,
    SOLID_CASES,
    TILT,
    largest_sum,
    pair_of,
    solids,
    solved_patch,
    stacked,
)
from support.pairs import MATERIAL, displacement, held

import basix
import basix.ufl
import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless
from dolfinx_contact.problem import discretise

COMM = MPI.COMM_WORLD
DEGREES = [(1, 1), (2, 1), (2, 2)]  # of displacement and multiplier


def integrals(points, a, b, degree):
    """Exact integrals from ``a`` to ``b`` of the basis on sorted points, by the place of nodes."""
    element = basix.create_element(
        basix.ElementFamily.P, basix.CellType.interval, degree, basix.LagrangeVariant.equispaced
    )
    at, weights = basix.make_quadrature(basix.CellType.interval, degree)
    found = {}
    for p, q in pairwise(points):
        c = max(p, a)
        d = max(min(q, b), max(p, a))
        values = element.tabulate(0, (c + (d - c) * at - p) / (q - p))[0, :, :, 0]
        for place, value in zip(element.points[:, 0], (d - c) * weights @ values, strict=True):
            key = round(p + (q - p) * place, 9)
            found[key] = found.get(key, 0.0) + value
    return found


@pytest.mark.parametrize(
    ("case", "sides", "degrees"),
    [
        (CASES[0], SIDES[0], (1, 1)),
        (CASES[1], SIDES[1], (2, 2)),
        (CASES[2], SIDES[0], (2, 1)),
        (CASES[2], SIDES[1], (2, 1)),
        (CASES[3], SIDES[1], (1, 1)),
    ],
)
def test_gauss_point_forces_are_exact_integrals_of_uniform_tractions(case, sides, degrees):
    """Forces on both faces are integrals over their intersection, node by node."""
    angle = 0.7
    both = stacked(*case, angle=angle)
    u = displacement(both.mesh, degrees[0])
    V = u.function_space
    t = np.array([1.0, -2.0])
    pair = discretise(pair_of(u, both, degrees, sides))
    assert not pair.obstacle.opposite.matching
    assert largest_sum(pair) < 1e-14
    n = V.dofmap.index_map.size_local
    force = pair.points.operator.transpose(np.tile(t, (pair.points.number, 1))).reshape(-1, 2)[:n]
    common = max(case[2][0], case[3][0]), min(case[2][1], case[3][1])
    assert COMM.allreduce(pair.points.areas.sum()) == pytest.approx(np.ptp(common), rel=1e-14)
    along = V.tabulate_dof_coordinates()[:n, :2] @ [np.cos(angle), np.sin(angle)]
    for tag, sign in zip(sides, (1.0, -1.0), strict=True):
        count, reach = (case[0], case[2]) if tag == 2 else (case[1], case[3])
        exact = integrals(np.linspace(*reach, count + 1), *common, degrees[0])
        nodes = fem.locate_dofs_topological(V, 1, both.facet_tags.find(tag))
        for i in nodes[nodes < n]:
            np.testing.assert_allclose(force[i], sign * exact[round(along[i], 9)] * t, atol=1e-14)
    x = V.tabulate_dof_coordinates()[:n, :2]
    moment = COMM.allreduce(float(np.sum(x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0])))
    assert abs(moment) < 1e-13


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize(
    ("case", "sides", "cell"),
    [(0, 0, "tri"), (0, 1, "quad"), (1, 0, "quad"), (1, 1, "tri")],
)
@pytest.mark.verifies(
    "points in common",
    "integral contact",
    reference="closed form: a linear displacement",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_a_linear_displacement_at_common_gauss_points_is_exact(case, sides, cell, degrees):
    c = np.cos(0.7)
    s = np.sin(0.7)
    both = stacked(*CASES[case], cell=cell, angle=0.7)
    solved_patch(both, np.array([[c, -s], [s, c]]), BASE, SIDES[sides], degrees, (4, 5, 6))


@pytest.mark.parametrize(
    ("case", "sides", "cells", "degrees"),
    [
        (0, 0, "tet", (1, 1)),
        (1, 1, "tet", (2, 1)),
        (0, 1, "tet", (2, 2)),
        (1, 0, "hex", (1, 1)),
        (1, 1, "hex", (2, 1)),
        (1, 0, "hex", (2, 2)),
    ],
)
@pytest.mark.verifies(
    "points in common",
    "integral contact",
    reference="closed form: a linear displacement",
    aspects=(
        "3D",
        "pairs",
    ),
)
def test_a_linear_displacement_at_common_gauss_points_in_space_is_exact(
    case, sides, cells, degrees
):
    both = solids(*SOLID_CASES[case], cells)
    solved_patch(both, TILT, SOLID_BASE, SIDES[sides], degrees, (4, 5, 6, 7, 8))


REACH = (0.0, 1.0)


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize(
    ("degrees", "method"),
    [
        ((1, 1), "nodal"),
        ((1, 1), "mixed"),
        ((2, 1), "mixed"),
        ((1, 1), "integral"),
        ((2, 2), "integral"),
    ],
)
@pytest.mark.verifies(
    "mortar",
    "points in common",
    "mixed contact",
    reference="closed form: a linear displacement",
    aspects=(
        "3D",
        "pairs",
    ),
)
def test_faces_with_the_same_nodes_and_other_diagonals_pass_the_patch_test(degrees, method, sides):
    """Below, squares of the common face are divided along the other diagonal.

    Where these faces counted as matching, pressures were off by up to 50 %.
    """
    both = solids(3, 3, REACH, REACH, "tet", turn=np.eye(3))
    x = both.mesh.geometry.x
    below = np.unique(both.mesh.geometry.dofmap[both.cell_tags.find(1)])
    x[below, 0] = 1 - x[below, 0]
    x[:] = x @ TILT.T
    solved_patch(both, TILT, SOLID_BASE, sides, degrees, (4, 5, 6, 7, 8), method=method)


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
    both = solids(*counts, REACH, REACH, cell)
    options = {"method": "nodal", "fixed": (1, *fixed)}
    aside = tuple({4, 5, 6, 7, 8} - set(fixed))
    table = solved_patch(both, TILT, SOLID_BASE, sides, (1, 1), aside, **options)
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
def test_clamped_end_has_the_pressure_of_matching_meshes(law, n):
    """The pressures at a clamped end agree with matching meshes.

    With its own multiplier the end had up to a hundred times the pressure of its neighbours.
    """
    matching, other = (pressed(below, n, law).solve() for below in (n, n + 1))
    a, b = (r.tables["contact"] for r in (matching, other))
    assert a.letters[0] == b.letters[0] == "d"
    np.testing.assert_allclose(b.pressure[1:], a.pressure[1:], rtol=0.1)
    assert b.pressure.max() < 1.02 * a.pressure.max()
    energies = [r.energies["bulk"] for r in (matching, other)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-3)


def test_an_end_opposite_to_a_moving_body_carries_pressure():
    """One body is held, the other not: their ends still push each other."""
    for hold, sides in (((2,), (3, 2)), ((1,), (3, 2)), ((1,), (2, 3))):
        table = pressed(16, 15, Coulomb(0.4), hold=hold, sides=sides).solve().tables["contact"]
        assert "d" not in table.status
