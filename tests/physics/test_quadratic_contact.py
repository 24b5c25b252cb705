"""Quadratic displacements: the law holds at the vertices to round-off, whatever r is."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block
from support.mortars import (
    BASE,
    CASES,
    SIDES,
    SOLID_BASE,
    SOLID_CASES,
    TILT,
    pressed,
    solids,
    solved_patch,
    stacked,
)

from dolfinx_contact import Coulomb, Frictionless, Sphere
from dolfinx_contact.materials import NeoHookean

COMM = MPI.COMM_WORLD
TIGHT = {"snes_rtol": 1e-13}
#: Curved obstacle below the block, and a motion that presses it down and aside.
BALL = {2: Sphere((0.5, -5.0), 5.0), 3: Sphere((0.4, 0.5, -5.0), 5.0)}


@pytest.mark.parametrize(
    ("cell", "n", "curved"),
    [("tri", 6, False), ("quad", 6, True), ("tet", 3, True), ("hex", 3, False)],
)
@pytest.mark.verifies(
    "mixed contact", "Coulomb", reference="theorem: the contact law", aspects=("2D", "3D")
)
def test_quadratic_contact_satisfies_the_law_at_vertices(cell, n, curved):
    """Complementarity and friction to round-off by default; the solution is independent of r."""
    dim = 2 if cell in ("tri", "quad") else 3
    given = dict(
        n=n,
        cell=cell,
        degree=2,
        options=TIGHT,
        obstacle=BALL[dim] if curved else None,
    )
    results = [block(r=r, **given).solve() for r in (None, 100.0, 1e5)]
    for result in results:
        assert result.kkt_violation < 1e-11
        assert result.counts["stick"] > 0
        assert result.imbalance < 1e-10
        table, first = result.tables["contact"], results[0].tables["contact"]
        size = np.abs(first.force).max()
        np.testing.assert_allclose(table.force, first.force, atol=1e-9 * size)
        assert table.pressure.min() > -1e-13 * table.pressure.max()
        assert table.un.min() > -1e-13


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.verifies(
    "mixed contact", reference="itself: every rank alone", aspects=("2D", "3D", "pairs")
)
def test_quadratic_pairs_of_different_meshes_satisfy_the_law(dim):
    """Bodies pressing on each other and sliding, on any number of ranks."""
    tables = []
    for comm in [COMM, MPI.COMM_SELF] if COMM.size > 1 else [COMM]:
        problem = pressed(comm, dim, (2, 1), law=Coulomb(0.2), method=None)
        assert problem.surfaces[0].method == "mixed"
        problem.petsc_options["snes_rtol"] = 1e-13
        result = problem.solve()
        assert result.kkt_violation < 1e-11
        assert result.imbalance < 1e-10
        assert result.counts["open"] > 0
        tables.append(result.tables["contact"])
    size = np.abs(tables[0].force).max()
    for table in tables[1:]:
        np.testing.assert_allclose(table.force, tables[0].force, atol=1e-9 * size)


@pytest.mark.parametrize(("sides", "cell"), [(0, "tri"), (1, "quad")])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.verifies(
    "mixed contact", reference="closed form: a linear displacement", aspects=("2D", "pairs")
)
def test_quadratic_contact_passes_the_patch_test(sides, cell, degree):
    c, s = np.cos(0.7), np.sin(0.7)
    both = stacked(*CASES[0], cell=cell, angle=0.7)
    frame = np.array([[c, -s], [s, c]])
    solved_patch(both, frame, BASE, SIDES[sides], (degree, 1), (4, 5, 6), method="mixed")


@pytest.mark.parametrize(
    ("case", "sides", "cells", "degree"), [(0, 0, "tet", 1), (1, 1, "tet", 2), (1, 0, "hex", 2)]
)
@pytest.mark.verifies(
    "mixed contact", reference="closed form: a linear displacement", aspects=("3D", "pairs")
)
def test_quadratic_contact_passes_the_patch_test_in_space(case, sides, cells, degree):
    both = solids(*SOLID_CASES[case], cells)
    solved_patch(both, TILT, SOLID_BASE, SIDES[sides], (degree, 1), (4, 5, 6, 7, 8), method="mixed")


def test_quadratic_contact_chooses_its_default_method():
    """Gauss points only where gap and normal of a curved obstacle follow the displacement."""
    rubber = NeoHookean(400.0, 600.0)
    for material, obstacle, sliding, method in (
        (None, BALL[2], None, "mixed"),
        (None, BALL[2], "large", "integral"),
        (rubber, None, None, "mixed"),
        (rubber, BALL[2], None, "integral"),
        (rubber, BALL[2], "small", "mixed"),
    ):
        problem = block(
            degree=2, material=material, obstacle=obstacle, sliding=sliding, law=Frictionless()
        )
        assert problem.surfaces[0].method == method


@pytest.mark.verifies("mixed contact", "Coulomb", reference="independent code: Lemke's method")
def test_quadratic_contact_has_a_reduced_problem():
    """Proofs and algorithms on contact points apply to quadratic displacements."""
    problem = block(n=3, cell="tri", degree=2, law=Coulomb(0.3), options=TIGHT)
    force = problem.solve().tables["contact"].force
    assert problem.uniqueness().verdict == "proved"
    problem.u.x.array[:] = 0.0
    again = problem.solve(algorithm="lemke").tables["contact"].force
    np.testing.assert_allclose(again, force, atol=1e-11 * np.abs(force).max())
