"""Oblique fibres: beyond the friction that a half-plane holds, meshes do not agree any more."""

from mpi4py import MPI

import cases.anisotropic as demo
import numpy as np
import pytest
from cases.block import arguments
from cases.block import problem as block
from support.checks import solved_start

from dolfinx_contact import ParametricContact, records
from dolfinx_contact.analysis import critical_friction
from dolfinx_contact.continuation import follow

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize(("fibres", "degrees"), [(0.0, 0.0), (20.0, 0.0), (20.0, 90.0)])
def test_a_material_that_is_symmetric_holds_any_friction(fibres, degrees):
    assert demo.threshold(demo.elasticity(fibres, degrees)) == np.inf


@pytest.mark.ranks(2)
def test_mirrored_fibres_hold_slip_to_the_left():
    assert demo.threshold(demo.elasticity(20.0, -45.0)) == np.inf


@pytest.mark.verifies(
    "anisotropic bodies",
    reference="independent code: waves on a thick layer, by finite elements in depth",
    aspects=("2D",),
    alone=True,
)
def test_anisotropic_threshold_agrees_with_a_thick_layer():
    """Against waves on a thick layer: minus the ratio of its compliances, by Fourier in x."""
    C = demo.elasticity(20.0, 45.0)
    Q = C[:, 0, :, 0]
    R = C[:, 0, :, 1]
    T = C[:, 1, :, 1]
    n = 4000  # linear elements in y, k = 1
    height = 12.0  # half a wave is 3.1
    h = height / n
    mass = h / 6 * np.array([[2, 1], [1, 2]])
    slope = np.array([[1, -1], [-1, 1]]) / h
    mixed = np.array([[-0.5, 0.5], [-0.5, 0.5]])  # N_a N_b'
    # Of u exp(i x): strains i u in x, u' in y.
    cell = np.kron(mass, Q) + np.kron(slope, T) - 1j * np.kron(mixed, R)
    cell = cell + 1j * np.kron(mixed.T, R.T)
    after = np.zeros((2, 2), complex)  # stiffness of what lies above, held on top: infinite
    after[:] = np.diag([1e12, 1e12])
    for _ in range(n):
        A = cell[:2, :2]
        B = cell[:2, 2:]
        D = cell[2:, 2:] + after
        after = A - B @ np.linalg.solve(D, cell[2:, :2])
    compliance = np.linalg.inv(after).real
    found = demo.threshold(C)
    assert found == pytest.approx(-compliance[1, 1] / compliance[1, 0], rel=1e-4)


@pytest.mark.verifies(
    "critical friction",
    "anisotropic bodies",
    reference="closed form: the threshold of the half-plane, halving the distance",
    aspects=("2D",),
)
def test_critical_coefficients_converge_to_the_anisotropic_threshold():
    """Slips of both signs: without end beyond F*, and none below."""
    found = []
    for n in (8, 16, 32):
        others = critical_friction(demo.body(n, 1.0, 20.0, 45.0)).others
        found.append(min(z.real for z in others if abs(z.imag) < 1e-9 and z.real > 0))
    limit = demo.threshold(demo.elasticity(20.0, 45.0))
    assert found[0] > found[1] > found[2] > limit
    # The distance is about halved by every refinement.
    assert found[2] - limit < 0.6 * (found[1] - limit) < 0.36 * (found[0] - limit)


def rows(folder, *more):
    summary = demo.main(["--output", str(folder), *more])
    return summary["rows"]


@pytest.mark.long
def test_finer_meshes_have_more_solutions(folder):
    below, beyond = rows(folder)
    assert below["negative"] == [1, 1, 1]
    assert below["solutions"] == [[3, True], [3, True]]
    first, second, third = beyond["negative"]
    assert third >= 2 * second >= 4 * first
    assert beyond["solutions"] == [[3, True], [5, True]]
    assert "--------" in beyond["statuses"][1]
    assert (folder / "states.png").stat().st_size > 10_000


def test_isotropic_bodies_keep_their_number_of_solutions_on_finer_meshes(folder):
    cells = ("4", "5") if COMM.size == 1 else ("4",)
    (row,) = rows(folder, "--fibres", "0", "--frictions", "5", "--n", *cells, "--fine", "8", "16")
    assert row["negative"] == [1, 1]
    assert row["solutions"] == [[3, True]] * len(cells)


def body(friction):
    """A block on a floor, pressed by 0.01 and pushed to the right by 0.03."""
    given = dict(n=6, press=0.01, shift=0.03, friction=friction)
    return block(arguments([f"--{k}={v}" for k, v in given.items()]), COMM)


def end_of_branch(start, end):
    """The system at F = end, on the branch from the solution at F = start, and its rows."""
    problem = body(start)
    system = ParametricContact(problem, problem.surfaces[0].law.friction)
    x = solved_start(system)
    span = (min(start, end), max(start, end))
    direction = "increasing" if end > start else "decreasing"
    branch = follow(system, x, start, gamma_range=span, direction=direction)
    last = branch.points[-1]
    assert last.gamma == end
    x.array[:] = last.y.array_r[: x.getLocalSize()]
    system.put(x, last.gamma, last.piece)
    return problem, records.journal_of(system, [branch], {}).rows()


def test_frictionless_anisotropic_body_has_its_statuses():
    problem, rows = end_of_branch(0.5, 1e-8)
    assert {row["status"] for row in rows} == {"o++++++", "+++++++"}
    smooth = body(0.0)
    smooth.solve()
    np.testing.assert_allclose(problem.u.x.array, smooth.u.x.array, atol=1e-9)


@pytest.mark.ranks(2)
def test_infinite_friction_stops_slip_but_not_opening():
    """Nothing slips in the end, and then nothing changes; but the body still lifts off."""
    problem, rows = end_of_branch(0.5, 20.0)
    assert rows[-1]["status"] == "ookkkkk"
    there = problem.u.x.array.copy()
    problem.surfaces[0].law.friction.value = 1e6
    problem.solve()
    np.testing.assert_allclose(problem.u.x.array, there, atol=1e-10)
    table = problem.table(problem.surfaces[0])
    assert table.status == "ookkkkk"
    assert table.un[0] > table.un[1] > 1e-4
