"""Branches followed with a Krylov method, beside those with an assembled matrix."""

from mpi4py import MPI
from petsc4py import PETSc

import cases.branch_3d
import cases.followed_mesh
import numpy as np
import pytest
from support.checks import solved_start
from support.textbook import SymmetricGuess, Textbook

from dolfinx_contact.continuation import Follower, StepControl
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.krylov import Krylov

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "Krylov branches", reference="independent code: determinants of numpy", aspects=("branches",)
)
def test_krylov_sign_agrees_with_the_determinant(monkeypatch):
    """The sign and the solution agree with numpy for sixty random matrices of ten rows.

    With a known tangent the preconditioner is not applied to the column of gamma. With a wrong one
    it is.
    """
    monkeypatch.setattr(Textbook, "preconditioner", SymmetricGuess())
    generator = np.random.default_rng(7)
    n = 10
    seen = []
    for number in range(60):
        A = generator.normal(size=(n, n))
        c = generator.normal(size=n)
        row = generator.normal(size=n)
        corner = generator.normal()
        system = Textbook(n, lambda x, g, s: x, lambda x, g, s, A=A: A, lambda x, g, s, c=c: c)
        b = Bordered(system, gamma_scale=1.0)
        assert isinstance(b.solver, Krylov)
        y, last, rhs, out = (b.vector() for _ in range(4))
        y.set(0.0)
        x = system.create_vector()
        x.array[:] = row[slice(*x.getOwnershipRange())]
        b.join(x, corner, last)
        tangent = np.append(np.linalg.solve(A, -c), 1.0) * generator.normal()
        wrong = np.append(np.linalg.solve(A, c), 1.0)
        given = (None, tangent * (1 + 1e-3 * generator.normal()), wrong)[number % 3]
        along = None
        if given is not None:
            along = b.vector()
            x_along = system.create_vector()
            x_along.array[:] = given[:n][slice(*x.getOwnershipRange())]
            b.join(x_along, given[n], along)
        b.solver.assemble(y, last, None, along=along)
        assert b.solver.solves == int(given is None or given is wrong)
        J = np.block([[A, c[:, None]], [row[None, :], np.array([[corner]])]])
        sign = np.sign(np.linalg.det(J))
        assert b.solver.determinant_sign() == sign
        seen.append(sign)
        values = generator.normal(size=n + 1)
        x.array[:] = values[:n][slice(*x.getOwnershipRange())]
        b.join(x, values[n], rhs)
        assert b.solver.solve(rhs, out)
        whole = np.concatenate(COMM.allgather(out.array_r))
        np.testing.assert_allclose(J @ whole, values, atol=1e-6)
        b.destroy()
    assert set(seen) == {-1, 1}


def follow_vee(solver, kinks, *options):
    PETSc.Options()["contact_linear_solver"] = solver
    args = cases.followed_mesh.arguments(["--size", "0.1", *options])
    body = cases.followed_mesh.system(args, COMM)
    x = solved_start(body)
    with Follower(body, StepControl(kinks=kinks), gamma_scale=1.0) as follower:
        assert (type(follower.bordered.solver) is Krylov) == (solver == "amg")
        branch = follower.run(follower.start(x, 0.0), gamma_range=(0.0, 1.0))
        signs = []
        for point in branch.points[::5]:
            t = follower.corrector.tangent(point.y, point.tangent, point.piece, factorise=True)
            sense = np.sign(follower.bordered.gamma(point.tangent))
            signs.append(follower.bordered.orientation(t) * sense)
    letters = [body.letters(p.piece) for p in branch.points]
    return branch, letters, signs


@pytest.mark.parametrize(
    "kinks", [pytest.param(k, marks=pytest.mark.long) for k in ("exact", "batched")]
)
@pytest.mark.verifies(
    "Krylov branches",
    reference="independent code: MUMPS for the linear systems",
    aspects=(
        "2D",
        "multigrid",
        "branches",
    ),
)
def test_the_vee_by_krylov_has_the_folds_of_mumps(kinks):
    """Two nonsmooth folds, between which the determinant of H_x has the other sign."""
    branch, letters, signs = follow_vee("amg", kinks)
    direct, same, _ = follow_vee("direct", "exact")
    assert branch.reason == direct.reason
    assert branch.bifurcations == []
    np.testing.assert_allclose(
        [s.gamma for s in branch.folds], [s.gamma for s in direct.folds], atol=1e-9
    )
    assert len(branch.folds) == 2
    if kinks == "exact":
        assert letters[-1] == same[-1]
        events = [[s.gamma for s in b.special] for b in (branch, direct)]
        np.testing.assert_allclose(*events, atol=1e-9)
        assert [s.parity for s in branch.special] == [s.parity for s in direct.special]
    # Before the first fold, between the two, and after the second.
    turns = np.flatnonzero(np.diff(signs))
    assert len(turns) == 2
    assert signs[0] == signs[-1]


@pytest.mark.long
@pytest.mark.verifies(
    "Krylov branches",
    reference="independent code: MUMPS for the linear systems",
    aspects=(
        "2D",
        "multigrid",
        "branches",
    ),
)
@pytest.mark.verifies(
    "hyperelastic bodies",
    reference="itself: factorised",
    aspects=(
        "2D",
        "multigrid",
        "branches",
    ),
)
def test_a_hyperelastic_branch_by_krylov_is_that_of_mumps():
    """A hyperelastic body with its support moved: its stiffness changes all along."""
    options = ("--law", "neo-hookean", "--friction", "0.3", "--drive-top", "0.2", "-0.3")
    branch, letters, _ = follow_vee("amg", "exact", *options)
    direct, same, _ = follow_vee("direct", "exact", *options)
    assert branch.reason == direct.reason
    assert [s.kind for s in branch.special] == [s.kind for s in direct.special] == ["event"] * 4
    assert letters[0] != letters[-1]
    assert letters[-1] == same[-1]
    ends = [b.points[-1].y for b in (branch, direct)]
    size = ends[0].norm()
    ends[0].axpy(-1.0, ends[1])
    assert ends[0].norm() < 1e-8 * size
