"""Small parts of continuation and evolution whose answers are known beforehand."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.textbook import Textbook, coulomb_system

from dolfinx_contact._factor import Factor
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.row_update import RowUpdate
from dolfinx_contact.continuation.system import Events, fractions_to_borders
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
    np.testing.assert_allclose(fractions_to_borders(low, high), [0.5, np.inf, 0.0, 0.0, 0.25])
    np.testing.assert_allclose(
        fractions_to_borders(low, high, (3.0, 1.0)), [0.75, np.inf, 0.0, 0.0, 0.5]
    )
    other = events((-1.0, 4, PLUS), (-1.0, 0, MINUS), (1.0, 7, PLUS), (-9.0, 0, STICK))
    np.testing.assert_allclose(fractions_to_borders(low, other), [0.5, 0.5, np.inf, 0.1])
    at_border = events((0.0, 0, STICK), (0.0, 9, OPEN), (-0.0, 1, OPEN))  # inside still
    np.testing.assert_array_equal(fractions_to_borders(low, at_border), np.inf)


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
    # What Newton's method takes is one of them, if there is one.
    codes = system.classify(w)
    for i, wanted in enumerate(states.values()):
        assert codes[i] in (wanted or {OPEN, STICK, PLUS, MINUS})


def of_all_ranks(A):
    """A dense matrix as one of PETSc, its rows on all ranks, with all entries."""
    n = len(A)
    found = PETSc.Mat().createAIJ((n, n), nnz=n, comm=COMM)
    found.setUp()
    start, end = found.getOwnershipRange()
    found.setValues(range(start, end), range(n), A[start:end])
    found.assemble()
    return found


@pytest.mark.ranks(2)
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

    def put(J):
        now["J"] = J
        x = system.create_vector()
        x.array[:] = J[n, slice(*x.getOwnershipRange())]
        b.join(x, J[n, n], row)

    for changed, factorisations in (((), 1), ((3, 7), 1), ((n,), 1), (range(9), 2)):
        J = base.copy()
        J[list(changed)] = rng.normal(size=(len(changed), n + 1))
        put(J)
        b.solver.assemble(y, row, None)
        assert b.solver.solve(rhs, out)
        whole = np.concatenate(COMM.allgather(out.array_r))
        np.testing.assert_allclose(J @ whole, np.ones(n + 1), atol=1e-10)
        sign = b.solver.determinant_sign()
        assert sign == np.sign(np.linalg.det(J))
        assert b.solver.factorisations == factorisations
    # At states that change most rows the formula is tried once, and no more.
    tried = []
    take = b.solver._take
    b.solver._take = lambda: tried.append(0) or take()
    for number in (1.0, 2.0):
        y.array[:] = number
        J = rng.normal(size=(n + 1, n + 1))
        put(J)
        b.solver.assemble(y, row, None)
        assert b.solver.solve(rhs, out)
        assert len(tried) == 1
    assert b.solver.factorisations == 4
    # A sign is that of the matrix as it is, solved with or not.
    for _ in range(6):
        J = rng.normal(size=(n + 1, n + 1))
        put(J)
        b.solver.assemble(y, row, None)
        assert b.solver.determinant_sign() == np.sign(np.linalg.det(J))
    b.destroy()


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


# -- by pivots ------------------------------------------------------------------------------------
