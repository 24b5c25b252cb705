"""Steps over kinks, rays led by H and rounds of pivots; what surrounds each is given."""

from types import SimpleNamespace

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from textbook import Textbook

from dolfinx_contact.continuation import Piece
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import Change
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.solvers import pivoting

COMM = MPI.COMM_WORLD
CHANGE = (0.5, Change(0, 0, STICK, OPEN))


def vector(*numbers):
    return PETSc.Vec().createWithArray(np.array(numbers, dtype=float), comm=MPI.COMM_SELF)


# -- rays led by H --------------------------------------------------------------------------------


# -- factorisations -------------------------------------------------------------------------------


def test_a_factorisation_that_does_not_serve_is_made_anew():
    """Where GMRES does not converge in the iterations that it has, or in too many to go on."""
    rng = np.random.default_rng(3)
    n = 10
    now = {}
    system = Textbook(n, None, lambda *_: now["J"][:n, :n], lambda *_: now["J"][:n, n])
    b = Bordered(system, gamma_scale=1.0)
    b.solver.reuse = True
    calls = []
    solve = b.solver.factor.solve
    b.solver.factor.solve = lambda rhs, x: calls.append(0) or solve(rhs, x)
    y, row, rhs, out = (b.vector() for _ in range(4))
    rhs.set(1.0)

    def solved(J):
        now["J"] = J
        x = system.create_vector()
        x.array[:] = J[n, slice(*x.getOwnershipRange())]
        b.join(x, J[n, n], row)
        b.solver.assemble(y, row, None)
        assert b.solver.solve(rhs, out)
        whole = np.concatenate(COMM.allgather(out.array_r))
        np.testing.assert_allclose(J @ whole, 1.0, atol=1e-9)
        assert b.solver.solves == len(calls)
        return b.solver.factorisations

    base = rng.normal(size=(n + 1, n + 1)) + 4 * np.eye(n + 1)
    assert solved(base) == 1
    near = base * (1 + 1e-4 * rng.normal(size=base.shape))
    assert solved(near) == 1  # all rows differ, by a little
    assert not b.solver._worn
    other = rng.normal(size=base.shape) + 4 * np.eye(n + 1)
    b.solver._krylov.setTolerances(max_it=2)
    assert solved(other) == 2
    b.solver._krylov.setTolerances(max_it=40)
    b.solver._worn = True
    assert solved(other * (1 + 1e-4 * rng.normal(size=base.shape))) == 3
    b.destroy()


# -- rounds of pivots -----------------------------------------------------------------------------


class Rounds:
    """A solver whose states require statuses that are known beforehand."""

    def __init__(self, first, required, solved=True, gives_up=99):
        self.required = [np.array(first, dtype=np.int8)]
        self.required += [np.array(codes, dtype=np.int8) for codes in required]
        self.now = 0
        self.held = None
        self.rounds = []
        n = len(first)
        surface = SimpleNamespace(
            points=SimpleNamespace(number_everywhere=n, ids=np.zeros((n, 1), dtype=int)),
            positions=np.column_stack([np.arange(n), np.zeros(n)])[::-1],
        )
        contact = lambda x: SimpleNamespace(statuses=[self.required[self.now]])  # noqa: E731
        self.equations = SimpleNamespace(
            comm=MPI.COMM_SELF, surfaces=[surface], contact=contact, body_size=1.0
        )
        self.attempt = SimpleNamespace(
            gives_up=lambda: self.now >= gives_up,
            steps=[SimpleNamespace(measures=SimpleNamespace(worst=1.0))],
            reason="",
        )
        self.solved = solved

    def run(self, x, attempt):
        self.rounds.append(None if self.held is None else self.held[0].tolist())
        if self.held is not None:
            self.now = min(self.now + 1, len(self.required) - 1)
        return self.solved


def test_points_that_object_change_at_once():
    """Until none does: then H itself is solved."""
    rounds = Rounds([STICK] * 3, [[OPEN, STICK, PLUS], [OPEN, OPEN, PLUS], [OPEN, OPEN, PLUS]])
    assert pivoting.pivot(rounds, "x", rounds.attempt) is True
    assert rounds.rounds == [[1, 1, 1], [0, 1, 2], [0, 0, 2], None]
    assert rounds.held is None


def test_only_the_last_point_changes_after_some_rounds():
    """Those that go on objecting do so one by one, and slip turns by way of stick."""
    a, b = [PLUS, PLUS, STICK], [MINUS, MINUS, STICK]
    rounds = Rounds(a, [b, a] * 50)
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    # Two object at once, with no new minimum four times; then the last in order of coordinates.
    whole = rounds.rounds
    assert len(whole) == 20 + 4 * 3
    assert whole[:6] == [a, b, a, b, a, b]
    assert whole[6] == [STICK, MINUS, STICK]
    assert rounds.attempt.reason == "1 points keep objecting to their status"


def test_rounds_that_come_to_nothing():
    """Where it is given up, or a state is no number; a round that is not solved goes on else."""
    script = [[OPEN, STICK], [OPEN, OPEN], [OPEN, OPEN]]
    rounds = Rounds([STICK, STICK], script, gives_up=2)
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    assert (len(rounds.rounds), rounds.attempt.reason, rounds.held) == (2, "", None)
    rounds = Rounds([STICK, STICK], script, solved=False)
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    assert rounds.rounds == [[1, 1], [0, 1], [0, 0], None]
    rounds = Rounds([STICK, STICK], script, solved=False)
    rounds.attempt.steps[-1].measures.worst = np.inf
    assert pivoting.pivot(rounds, "x", rounds.attempt) is False
    assert rounds.rounds == [[1, 1]]


@pytest.mark.parametrize("rows", [(0,), (0, 4), (2, 3), ()])
def test_signs_of_quotients_of_determinants(rows):
    """Of two pieces that differ in some rows, the first among them, and in the border."""
    rng = np.random.default_rng(7)
    n = 5
    signs = set()
    for _ in range(6):
        first = rng.normal(size=(n + 1, n + 1))
        second = first.copy()
        second[list(rows)] = rng.normal(size=(len(rows), n + 1))
        second[n] = rng.normal(size=n + 1)
        by_code = {STICK: first, PLUS: second}
        system = Textbook(
            n,
            None,
            lambda x, g, c, J=by_code: J[int(c[0])][:n, :n],
            lambda x, g, c, J=by_code: J[int(c[0])][:n, n],
            lambda *_: [[]],
            lambda x, g: [STICK],
        )
        b = Bordered(system, gamma_scale=1.0)
        sides = []
        for code, J in by_code.items():
            x = system.create_vector()
            x.array[:] = J[n, slice(*x.getOwnershipRange())]
            last = COMM.rank == COMM.size - 1
            piece = Piece(np.full(1 if last else 0, code, dtype=np.int8))
            sides.append((b.joined(x, J[n, n]), piece))
        y, made = b.vector(), []
        vector = b.solver.layout.vector
        b.solver.layout.vector = lambda made=made, make=vector: made.append(make()) or made[-1]
        found = b.solver.determinant_quotient(y, *sides)
        assert found == np.sign(np.linalg.det(second) / np.linalg.det(first))
        assert made
        assert not any(made)  # all are freed
        signs.add(found)
        b.destroy()
    assert signs == {-1, 1}
