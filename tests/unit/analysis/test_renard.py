"""Renard's criterion: closed forms, an independent condensation, and what it is not about."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.leaning_bodies import block, in_plane, on_box, stiffness_of_points, swirl, to_the

from dolfinx import mesh

from dolfinx_contact.analysis import renard_criterion

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.verifies(
    "Renard's criterion",
    reference="closed form: 2 sqrt(kt^2 - k^2)/kt of one element, and known coefficients",
    aspects=("2D",),
)
def test_renards_coefficient_of_hilds_triangle(dense):
    """Coefficients of the benchmark; of one element the closed form."""
    lmbda = 100.0
    mu = 82.0
    kt = (lmbda + 3 * mu) / 2
    k = (lmbda + mu) / 2
    expected = (2 * np.sqrt(kt**2 - k**2) / kt, 1.409557, 1.311326)
    for n, friction in zip((1, 2, 4), expected, strict=True):
        problem = linear_triangle(n, 0.4, lame=(lmbda, mu)).problem
        for sign in (1.0, -1.0):
            found = renard_criterion(problem, to_the(sign), dense=dense)
            assert found.friction == pytest.approx(friction, abs=1e-6 if n > 1 else 1e-12)
            assert found.factor == pytest.approx(friction / 0.4, abs=3e-6)
            assert found.unique


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.verifies(
    "Renard's criterion",
    reference="independent code: eigenvalues of the form, in numpy",
    aspects=("3D",),
)
def test_against_the_form_in_3d(dense):
    """At F_R the form of the points is about to become indefinite, and not before."""
    factor = renard_criterion(block(4, friction=0.25), swirl, dense=dense).factor
    S, x = stiffness_of_points(block(4, comm=MPI.COMM_SELF))
    m = len(x)
    xi = swirl(x)
    for part, sign in ((1 - 1e-7, 1.0), (1 + 1e-7, -1.0)):
        form = S.copy()
        form += 0.25 * factor * part * np.einsum("pa,pjb->pajb", xi, S[:, 2])
        form = form.reshape(3 * m, 3 * m)
        assert np.sign(np.linalg.eigvalsh(form + form.T)[0]) == sign


@pytest.mark.ranks(2, 3)
def test_renards_criterion_takes_the_directions_of_a_solution():
    """The directions are those of slips and of the shear of stuck points."""
    problem = linear_triangle(8, 0.5, load=(14.0, -20.0)).problem
    problem.solve()
    table = problem.table(problem.surfaces[0])
    assert {"k", "-"} <= set(table.status) or {"k", "+"} <= set(table.status)
    ut = table.along(table.ut)
    rt = table.along(table.rt)
    xi = np.where(np.abs(ut) > 1e-9, np.sign(ut), -rt / np.maximum(0.5 * table.rn, 1e-30))

    def of_table(x):
        where = np.array([np.argmin(np.abs(table.x[:, 0] - at)) for at in x[:, 0]], dtype=int)
        return np.outer(xi[where], [1.0, 0.0]).reshape(x.shape) if len(x) else 0.0 * x

    found = renard_criterion(problem)
    assert found.factor == pytest.approx(renard_criterion(problem, of_table).factor, rel=1e-9)
    assert found.unique
    assert found.friction == pytest.approx(0.5 * found.factor)


@pytest.mark.verifies(
    "Renard's criterion", reference="itself: the body in plane strain", aspects=("3D",)
)
def test_guided_points():
    """Where the support holds a tangent there is no friction along it: plane strain in 3D."""
    flat = mesh.create_rectangle(
        COMM, [[0.0, 0.0], [1.0, 0.5]], [4, 3], mesh.CellType.quadrilateral
    )
    box = [[0, 0, 0], [1, 0.2, 0.5]]
    domain = mesh.create_box(COMM, box, [4, 1, 3], mesh.CellType.hexahedron)
    slices = on_box(domain, sides=in_plane)
    plane = on_box(flat)
    expected = renard_criterion(plane, to_the(1)).factor
    assert renard_criterion(slices, to_the(1)).factor == pytest.approx(expected, rel=1e-9)
