"""Renard's criterion: closed forms, an independent condensation, and its limits."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from scipy.optimize import root
from support.blocks import block as body
from support.leaning_bodies import block, in_plane, on_box, stiffness_of_points, swirl, to_the

from dolfinx import mesh

from dolfinx_contact import Coulomb
from dolfinx_contact.analysis import renard_criterion
from dolfinx_contact.analysis.renard import WeightedForm

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.verifies(
    "Renard's criterion",
    reference="closed form: 2 sqrt(kt^2 - k^2)/kt of one element, and known coefficients",
    aspects=("2D",),
)
def test_hilds_triangle_has_renards_coefficient(dense):
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
def test_renards_coefficient_is_sharp_for_the_form_in_3d(dense):
    """The form of the points is definite up to F_R, becoming indefinite beyond it."""
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
    """Directions are slips, or the shear of stuck points."""
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
def test_renards_criterion_skips_guided_points():
    """There is no friction along a clamped tangent: plane strain in 3D."""
    flat = mesh.create_rectangle(
        COMM, [[0.0, 0.0], [1.0, 0.5]], [4, 3], mesh.CellType.quadrilateral
    )
    box = [[0, 0, 0], [1, 0.2, 0.5]]
    domain = mesh.create_box(COMM, box, [4, 1, 3], mesh.CellType.hexahedron)
    slices = on_box(domain, sides=in_plane)
    plane = on_box(flat)
    expected = renard_criterion(plane, to_the(1)).factor
    assert renard_criterion(slices, to_the(1)).factor == pytest.approx(expected, rel=1e-9)


def form_of(S, slope):
    """S (m, d, m, d), the last component normal, and F xi (m, d - 1)."""
    m, d = S.shape[:2]
    G = np.zeros_like(S)
    G[:, :-1] = slope[:, :, None, None] * S[:, None, -1]
    groups = 2 * np.arange(m)[:, None] + (np.arange(d) == d - 1)
    return WeightedForm(S.reshape(m * d, -1), G.reshape(m * d, -1), groups.ravel())


@pytest.mark.verifies("Renard's criterion", reference="closed form: kt/k of one node", alone=True)
def test_one_point_has_its_weighted_coefficient():
    """Slip to one side: up to k_t/k, where non-uniqueness begins; to the other: for every F."""
    kt = 173.0
    kn = 150.0
    k = 91.0
    S = np.array([[kt, k], [k, kn]]).reshape(1, 2, 1, 2)
    for sign, expected in ((-1.0, kt / k), (1.0, 1000.0)):
        form = form_of(S, np.array([[sign]]))
        plain = form.interval(np.ones(2), 0.0)[1]
        assert plain == pytest.approx(2 * np.sqrt(kt * kn - k**2) / kn, rel=1e-9)
        found = form.largest()
        assert expected * (1 - 1e-3) < found <= expected * (1 + 1e-9)
    # The weights of the threshold, (F k_n - k)/k over 1, in closed form.
    F = 0.999 * kt / k
    low, high = form_of(S, np.array([[-1.0]])).interval(np.array([1.0, (F * kn - k) / k]), F)
    assert low < F < high <= kt / k * (1 + 1e-9)


@pytest.mark.parametrize(("n", "critical"), [(1, 1.9010989), (2, 1.73663256), (4, 1.68791278)])
@pytest.mark.verifies(
    "Renard's criterion",
    reference="itself: critical friction of the same triangle",
    aspects=("2D",),
)
def test_weights_raise_renards_coefficient(n, critical):
    """More than without weights, and never more than the coefficient of a second solution."""
    problem = linear_triangle(n, 0.4, lame=(100.0, 82.0)).problem
    plain = renard_criterion(problem, to_the(-1)).friction
    found = renard_criterion(problem, to_the(-1), weights=True).friction
    assert plain < 0.95 * critical
    assert 0.95 * critical < found < critical


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "Renard's criterion",
    reference="independent code: eigenvalues of the form, in numpy",
    aspects=("3D",),
)
def test_the_weighted_form_in_space_is_definite():
    """The sum is positive definite where it is said to be, with the weights that say so."""
    plain = renard_criterion(block(3, friction=0.25), swirl)
    found = renard_criterion(block(3, friction=0.25), swirl, weights=True)
    assert found.factor > 1.4 * plain.factor
    assert found.unique
    S, x = stiffness_of_points(block(3, comm=MPI.COMM_SELF))
    form = form_of(S, 0.25 * swirl(x)[:, :2])
    assert form.interval(np.ones(2 * len(x)), 0.0)[1] == pytest.approx(plain.factor, rel=1e-6)
    weights = np.exp(np.random.default_rng(1).uniform(-0.2, 0.2, 2 * len(x)))
    low, high = form.interval(weights, 0.0)
    for factor, sign in (
        (0.999 * low, 1),
        (1.001 * low, -1),
        (0.999 * high, 1),
        (1.001 * high, -1),
    ):
        M = weights[form.groups][:, None] * (form.S + factor * form.G)
        assert np.sign(np.linalg.eigvalsh(M + M.T)[0]) == sign


def solutions(S, p, F, random, starts=40):
    """Return jumps and forces (m, 6) of each solution found from random starts."""
    m = len(S)
    flat = S.reshape(3 * m, 3 * m)
    found = []
    A = np.linalg.inv(flat)
    rho = np.trace(flat) / len(flat)

    def state(r):
        return (A @ (r + p)).reshape(m, 3), r.reshape(m, 3)

    def residual(r):
        a, r = state(r)
        asked = r - rho * a
        normal = np.maximum(asked[:, 2], 0)
        length = np.linalg.norm(asked[:, :2], axis=1)
        shear = asked[:, :2] * np.minimum(1, F * normal / np.maximum(length, 1e-300))[:, None]
        return (r - np.column_stack([shear, normal])).ravel()

    for _ in range(starts):
        end = root(residual, random.standard_normal(3 * m) * np.abs(p).max() * 2)
        if np.abs(residual(end.x)).max() < 1e-9 * np.abs(p).max():
            new = np.column_stack(state(end.x))
            if all(np.abs(new - old).max() > 1e-6 * np.abs(new).max() for old in found):
                found.append(new)
    return found


def slope_of(solution, F):
    """F xi (m, 2)."""
    ut = solution[:, :2]
    rt = solution[:, 3:5]
    rn = solution[:, 5]
    length = np.linalg.norm(ut, axis=1)
    size = np.abs(solution).max()
    slips = length > 1e-7 * size
    presses = F * rn > 1e-7 * size
    along = ut / np.where(slips, length, 1)[:, None]
    against = -rt / np.where(presses, F * rn, 1)[:, None]
    xi = np.where(slips[:, None], along, np.where(presses[:, None], against, 0))
    return F * xi / np.maximum(np.linalg.norm(xi, axis=1), 1)[:, None]


@pytest.mark.verifies(
    "Renard's criterion",
    "uniqueness",
    reference="independent code: a hunt for second solutions",
    aspects=(
        "3D",
        "proofs",
    ),
    alone=True,
)
def test_no_second_solution_where_there_is_proof():
    """Random problems of two points; some have several solutions, and those are not proved."""
    random = np.random.default_rng(4)
    several = 0
    gained = 0
    for number in range(40):
        B = random.standard_normal((6, 6))
        S = (B @ B.T + 0.3 * np.eye(6)).reshape(2, 3, 2, 3)
        p = random.uniform(-1, -0.3, (2, 3))
        F = random.uniform(0.3, 3.0)
        if number % 2:
            # Pulled against the way in which pressure moves a point.
            for i in range(2):
                back = S[i, :2, i, 2] / np.linalg.norm(S[i, :2, i, 2])
                p[i, :2] = F * p[i, 2] * random.uniform(0.3, 1.1) * back
        p = p.ravel()
        found = solutions(S, p, F, random)
        several += len(found) > 1
        for solution in found:
            form = form_of(S, slope_of(solution, F))
            proved = form.largest(enough=1.0 + 1e-6) > 1.0
            gained += proved and form.interval(np.ones(4), 0.0)[1] < 1.0
            assert not (proved and len(found) > 1)
    assert several >= 3
    assert gained >= 5


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "uniqueness",
    "Renard's criterion",
    reference="theorem: Renard's criterion, weighted",
    aspects=(
        "3D",
        "proofs",
    ),
)
def test_weights_decide_where_the_plain_criterion_fails():
    """Weights reach a friction at which the criterion without them fails."""
    problem = body(n=4, cell="hex", law=Coulomb(1.5), top=(0.05, 0.0, -0.01))
    problem.solve()
    assert renard_criterion(problem).factor < 1
    assert renard_criterion(problem, weights=True).factor > 1
    assert problem.uniqueness().verdict == "proved"
