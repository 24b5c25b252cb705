"""Steps over kinks, rays led by H and rounds of pivots; what surrounds each is given."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.textbook import Textbook

from dolfinx_contact.continuation import Piece
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import Change
from dolfinx_contact.laws.status import OPEN, PLUS, STICK

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
