"""Small parts of continuation and evolution whose answers are known beforehand."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from textbook import Textbook, coulomb_system

from dolfinx_contact._factor import Factor
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.borders import reached
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.continuation.ray_finder import Kink, RayFinder
from dolfinx_contact.continuation.rays import _inverses, _kernel
from dolfinx_contact.continuation.row_update import RowUpdate
from dolfinx_contact.continuation.system import Events
from dolfinx_contact.evolution.arc_steps import _cubic, _end_reached
from dolfinx_contact.evolution.through_times import _aim, checked_times
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK, WHERE_OPEN
from dolfinx_contact.solvers.pivoting import _by_stick

COMM = MPI.COMM_WORLD

# -- pieces, their borders and their matrices ----------------------------------------------------


def events(*each):
    """Events of (distance, point, target)."""
    distance, point, target = zip(*each, strict=True)
    types = np.float64, np.int32, np.int8
    return Events(*(np.array(v, t) for v, t in zip((distance, point, target), types, strict=True)))


def test_where_borders_are_reached():
    """On the straight line between two distances; halfway where a border is in one state alone."""
    low = events((1.0, 0, STICK), (2.0, 1, OPEN), (0.0, 2, OPEN), (-0.1, 3, PLUS), (1.0, 4, PLUS))
    high = events(
        (-1.0, 0, STICK), (3.0, 1, OPEN), (-2.0, 2, OPEN), (-1.0, 3, PLUS), (-3.0, 4, PLUS)
    )
    np.testing.assert_allclose(reached(low, high), [0.5, np.inf, 0.0, 0.0, 0.25])
    np.testing.assert_allclose(reached(low, high, (3.0, 1.0)), [0.75, np.inf, 0.0, 0.0, 0.5])
    other = events((-1.0, 4, PLUS), (-1.0, 0, MINUS), (1.0, 7, PLUS), (-9.0, 0, STICK))
    np.testing.assert_allclose(reached(low, other), [0.5, 0.5, np.inf, 0.1])


def test_statuses_that_hold_a_state():
    """By Coulomb's law with F = 1/2; what a point alone says is what all of them say."""
    states = {
        (0.1, 0.2, 0.0, 0.0): {OPEN},
        (0.1, 0.0, 0.0, 0.0): {OPEN, PLUS},
        (0.0, 0.0, 0.0, 0.0): {OPEN, STICK, PLUS, MINUS},
        (0.0, 0.0, 0.1, 1.0): {STICK},
        (0.0, 0.0, -0.5, 1.0): {STICK, PLUS},
        (0.2, 0.0, -0.5, 1.0): {PLUS},
        (-0.2, 0.0, 0.5, 1.0): {MINUS},
        (0.2, 0.0, 0.5, 1.0): set(),
        (0.0, 0.0, 0.6, 1.0): set(),
        (0.0, -0.1, 0.0, 0.0): set(),
        (0.0, 0.1, 0.0, 1.0): set(),
    }
    w = np.array(list(states))
    m = len(w)
    system = coulomb_system(np.eye(2 * m), np.zeros(2 * m), np.zeros(2 * m), 0.5)
    held = system.statuses_at(w, 1e-12)
    for i, wanted in enumerate(states.values()):
        assert set(np.flatnonzero(held[i])) == wanted, w[i]
        np.testing.assert_array_equal(system.statuses_of(i, w[i], 1e-12), held[i])


def test_kernels_of_pieces():
    """The dimension of the solutions (z, rate) of A z = rate q, and the only one."""
    q = np.array([1.0, 2.0])
    for A, dimension, exact in (
        (np.array([[2.0, 0.0], [0.0, 4.0]]), 1, (0.5, 0.5, 1.0)),
        (np.array([[1.0, 1.0], [1.0, 1.0]]), 1, (1.0, -1.0, 0.0)),
        (np.array([[1.0, 1.0], [2.0, 2.0]]), 2, None),
        (np.diag([1.0, 1e-11]), -1, None),
    ):
        found, vector = _kernel(A, q)
        assert found == dimension
        assert (vector is None) is (exact is None)
        if vector is not None:
            z = np.append(*vector)
            assert abs(z @ exact) == pytest.approx(np.linalg.norm(exact), rel=1e-12)
    assert _kernel(np.ones((3, 3)), np.ones(3)) == (3, None)


def test_inverses_with_singular_ones_among_them():
    A = np.random.default_rng(3).normal(size=(7, 3, 3))
    A[[2, 5]] = 1.0
    A[2, 0] = A[5, 2] = 0.0
    inverses = _inverses(A)
    for i in range(7):
        if i in (2, 5):
            assert not np.isfinite(inverses[i]).any()
        else:
            np.testing.assert_allclose(inverses[i] @ A[i], np.eye(3), atol=1e-12)


def of_all_ranks(A):
    """A dense matrix as one of PETSc, its rows on all ranks, with all entries."""
    n = len(A)
    found = PETSc.Mat().createAIJ((n, n), nnz=n, comm=COMM)
    found.setUp()
    start, end = found.getOwnershipRange()
    found.setValues(range(start, end), range(n), A[start:end])
    found.assemble()
    return found


def test_matrices_that_differ_in_rows_and_a_column():
    """Solutions and signs of determinants as of numpy; what does not serve is not taken."""
    rng = np.random.default_rng(11)
    n = 6
    base = rng.normal(size=(n, n))
    matrix = of_all_ranks(base)
    factor = Factor(COMM, "rows_", determinant=True)
    assert factor.factorise(matrix)
    update = RowUpdate(factor)
    update.begin(matrix)
    b, x = matrix.createVecs()
    b.array[:] = 1.0

    def solves(A):
        assert update.solve(b, x)
        parts = np.concatenate(COMM.allgather(x.array_r))
        np.testing.assert_allclose(A @ parts, np.ones(n), atol=1e-9)
        assert update.determinant_sign == np.sign(np.linalg.det(A))

    for rows, border in (((1,), False), ((0, 4), True), ((), True), ((), False), ((2, 5), False)):
        for _ in range(3):
            new = base.copy()
            new[list(rows)] = rng.normal(size=(len(rows), n))
            if border:
                new[:, -1] = rng.normal(size=n)
                new[[0, 4]] = base[[0, 4]] if not rows else new[[0, 4]]
            changed = of_all_ranks(new)
            assert update.take(changed, 2)
            assert update.changed == len(rows)
            solves(new)
    singular = base.copy()
    singular[3] = singular[2]
    assert not update.take(of_all_ranks(singular), 2)
    solves(base)
    three = base + np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    assert not update.take(of_all_ranks(three), 2)
    assert update.changed == 3
    solves(base)
    noise = base * (1 + 1e-14 * rng.normal(size=(n, n)))
    assert update.take(of_all_ranks(noise), 0)
    update.destroy()


def test_a_factorisation_serves_matrices_that_differ_in_a_few_rows():
    """Solutions, signs and their quotients are numpy's; with more rows it is factorised anew."""
    rng = np.random.default_rng(5)
    n = 12
    base = rng.normal(size=(n + 1, n + 1))
    now = {}
    system = Textbook(n, lambda x, g, s: x, lambda *_: now["J"][:n, :n], lambda *_: now["J"][:n, n])
    b = Bordered(system, gamma_scale=1.0)
    y, row, rhs, out = (b.vector() for _ in range(4))
    rhs.array[:] = 1.0

    def take(J):
        now["J"] = J
        x = system.create_vector()
        x.array[:] = J[n, slice(*x.getOwnershipRange())]
        b.join(x, J[n, n], row)
        return row.copy()

    for changed, factorisations in (((), 1), ((3, 7), 1), ((n,), 1), (range(9), 2)):
        J = base.copy()
        J[list(changed)] = rng.normal(size=(len(changed), n + 1))
        take(J)
        b.solver.assemble(y, row, None)
        assert b.solver.solve(rhs, out)
        whole = np.concatenate(COMM.allgather(out.array_r))
        np.testing.assert_allclose(J @ whole, np.ones(n + 1), atol=1e-10)
        sign = b.solver.determinant_sign()
        assert sign == np.sign(np.linalg.det(J))
        assert b.solver.factorisations == factorisations
    b.destroy()


def test_statuses_without_a_derivative():
    """Where the shear grows as the length of a vector, no two changes add up."""

    def H(x, _g, codes):
        return x + np.array([np.hypot(x[0], x[1]) if codes[0] == PLUS else 2 * x[1], 0.0, 0.0])

    system = Textbook(3, H, None, None, codes=lambda x, g: [OPEN])
    corrector = Corrector(Bordered(system, gamma_scale=1.0), StepControl())
    kink = Kink(COMM.size - 1, 0, OPEN, STICK, (OPEN, STICK, PLUS))
    y = corrector.bordered.vector()
    finder = RayFinder(corrector, y, bool, PETSc.Vec.norm)
    piece = system.piece_at(system.create_vector(), 0.0)
    assert finder.rough_statuses(piece, [kink]) == {PLUS}
    y.array[:] = 1.0  # away from its kink it has one
    assert finder.rough_statuses(piece, [kink]) == set()


def test_slip_turns_by_way_of_stick():
    """Where it is to reverse, at open points too; all else changes at once."""
    pairs = {
        (PLUS, MINUS): STICK,
        (MINUS, PLUS): STICK,
        (PLUS, OPEN): OPEN,
        (STICK, MINUS): MINUS,
        (OPEN, PLUS): PLUS,
        (PLUS, PLUS): PLUS,
        (PLUS + WHERE_OPEN, MINUS): STICK + WHERE_OPEN,
    }
    held, required = np.array(list(pairs), dtype=np.int8).T
    np.testing.assert_array_equal(_by_stick(required, held), list(pairs.values()))


# -- steps ----------------------------------------------------------------------------------------


def test_a_cubic_through_two_ends():
    """It is found again from its values and rates at the ends, inside them."""
    p = np.polynomial.Polynomial([1.0, -2.0, 3.0, -4.0])
    ends = np.array([0.0, 2.5])
    inside = np.linspace(*ends, 17)[1:-1]
    value, slope = _cubic(p(ends), p.deriv()(ends), 2.5)
    np.testing.assert_allclose(value[:, 0], p(inside), rtol=1e-12)
    np.testing.assert_allclose(slope[:, 0], p.deriv()(inside), rtol=1e-12)


def test_ends_of_a_range_that_are_reached():
    """Beyond them, and near them unless the step began there."""
    for before, gamma, end in (
        (0.0, 0.5, None),
        (0.5, 1.5, 1.0),
        (0.0, -2.5, -2.0),
        (0.5, 1.0 - 1e-10, 1.0),
        (0.5, 1.0 - 1e-9, None),
        (-1.0, -2.0, -2.0),
        (1.0, 1.0 - 1e-11, None),
        (-2.0, -2.0 + 1e-11, None),
        (-2.0, 1.0, 1.0),
    ):
        assert _end_reached(before, gamma, (-2.0, 1.0)) == end


def test_equal_steps_to_a_time():
    """As few as are no longer than asked for, but for round-off."""
    for end, length, number in ((1.0, 0.1, 10), (0.3, 0.1, 3), (1.0, 0.4, 3), (1.0, 2.0, 1)):
        times = [0.0]
        while times[-1] < end:
            times.append(_aim(times[-1], end, length))
        np.testing.assert_allclose(times, np.linspace(0.0, end, number + 1), rtol=1e-12)
        assert times[-1] == end


def test_times_begin_where_the_evolution_is():
    """But for the round-off of sums, which is that of the whole time."""
    now = SimpleNamespace(time=0.1 + 0.2)
    assert checked_times([0.3, 5.0], now) == (now.time, 5.0)
    assert checked_times([0.3 + 1e-9, 5.0], now) == (now.time, 5.0)
    for wrong in (0.3 + 1e-8, 0.3 - 1e-8):
        with pytest.raises(ValueError, match="the evolution is at the time"):
            checked_times([wrong, 5.0], now)
