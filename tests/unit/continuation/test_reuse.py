"""One factorisation for many matrices: solutions and determinants, and how many a step takes."""

import zlib
from types import SimpleNamespace

from mpi4py import MPI

import demo_ciarlet_geymonat
import numpy as np
import pytest
from _triangle import linear_triangle
from support.blocks import block as elastic_block
from support.blocks import box
from support.recorded_run import moved_block
from support.textbook import Textbook

from dolfinx import fem

from dolfinx_contact import _geometry
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.continuation import Follower, Observer, StepControl, follow, row_update
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.corrector import Corrector
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.laws.status import STICK

COMM = MPI.COMM_WORLD


class Matrices:
    """Bordered matrices of ten rows that are assembled one after the other."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)
        self.A = self.random.normal(size=(10, 10))
        self.c = self.random.normal(size=10)
        self.row = self.random.normal(size=11)
        system = Textbook(10, lambda x, g, s: x, lambda *_: self.A, lambda *_: self.c)
        self.bordered = Bordered(system, gamma_scale=1.0)
        self.solver = self.bordered.solver
        self.assemble()

    def vector(self, values):
        y = self.bordered.vector()
        x = self.bordered.system.create_vector()
        x.array[:] = values[:10][slice(*x.getOwnershipRange())]
        self.bordered.join(x, values[10], y)
        return y

    def assemble(self):
        self.J = np.block([[self.A, self.c[:, None]], [self.row[None]]])
        self.solver.assemble(self.vector(np.zeros(11)), self.vector(self.row), None)

    def check(self):
        """The solution and the sign of the determinant are those of numpy."""
        values = self.random.normal(size=11)
        out = self.bordered.vector()
        assert self.solver.solve(self.vector(values), out)
        found = np.concatenate(COMM.allgather(out.array_r))
        expected = np.linalg.solve(self.J, values)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
        sign = np.sign(np.linalg.det(self.J))
        assert self.solver.determinant_sign() == sign
        return sign


def test_columns_that_are_no_longer_kept(monkeypatch):
    """Those of rows that have their old values again make room for others, and come again."""
    monkeypatch.setattr(row_update, "_MOST_COLUMNS", 2)
    m = Matrices(5)
    m.check()
    first = m.A
    for k in (0, 3, 6, 0):
        m.A = first.copy()
        m.A[k : k + 2] += m.random.normal(size=(2, 10))
        m.assemble()
        m.check()
    assert m.solver.factorisations == 1
    m.bordered.destroy()


def test_rows_that_change():
    """Rows, the border row and gamma's column change in turn: one factorisation serves, exactly."""
    signs = set()
    for seed in range(20):
        m = Matrices(seed)
        m.check()
        for k in range(4):
            m.A = m.A.copy()
            m.A[[k, 9 - k]] += m.random.normal(size=(2, 10))
            if k > 0:
                m.row = m.random.normal(size=11)
            if k > 1:
                m.c = m.random.normal(size=10)
            m.assemble()
            signs.add(m.check())
            assert m.solver.factorisations == (1 if k < 3 else 2)  # nine rows are too many
        m.bordered.destroy()
    assert signs == {-1, 1}


@pytest.mark.ranks(2)
@pytest.mark.parametrize("reuse", [None, True])
def test_a_row_that_makes_it_singular(reuse):
    """Then it is factorised, and found to be singular; what is regular comes after it."""
    m = Matrices(3)
    m.solver.reuse = reuse
    m.check()
    regular = m.A, m.c
    m.A, m.c = (v.copy() for v in regular)
    m.A[2] = 0.0
    m.c[2] = 0.0
    m.assemble()
    assert not m.solver.solve(m.vector(np.ones(11)), m.bordered.vector())
    assert m.solver.determinant_sign() == 0
    m.A, m.c = regular
    m.assemble()
    m.check()
    m.bordered.destroy()


def test_entries_that_are_not_finite():
    """No solution, and no sign."""
    m = Matrices(4)
    m.check()
    m.A = m.A.copy()
    m.A[1, 1] = np.nan
    m.assemble()
    assert m.solver.determinant_sign() == 0
    assert not m.solver.solve(m.vector(np.ones(11)), m.bordered.vector())
    m.bordered.destroy()


class Work(Observer):
    """Assemblies of the stiffness and factorisations between the points of a branch."""

    def __init__(self, system, bordered):
        self.bulk = system.problem.equations.bulk
        self.bordered = bordered
        self.steps = {"plain": [], "event": []}
        self.before = None

    def step(self, step, state):
        now = np.array([self.bulk.assemblies, self.bordered.work[0]])
        kinds = [s.kind for s in step.special]
        if self.before is not None and kinds in ([], ["event"]):
            self.steps["event" if kinds else "plain"].append(tuple(now - self.before))
        self.before = now


def followed(system, gamma, end, *, chords=True):
    """A branch by steps, every event located, and the work of its steps."""
    system.set_parameter(gamma)
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    control = StepControl(kinks="exact")
    with Follower(system, control, gamma_scale=2.0) as follower:
        if not chords:
            follower.corrector = Corrector(follower.bordered, control, chords=False)
            follower._steps.corrector = follower.corrector
        work = Work(system, follower.bordered)
        direction = "increasing" if end > gamma else "decreasing"
        ends = sorted((gamma, end))
        start = follower.start(x, gamma, direction=direction)
        branch = follower.run(start, gamma_range=ends, observer=work)
    return branch, work.steps


@pytest.fixture(scope="module")
def block():
    return demo_ciarlet_geymonat.block(20, 40, 1.0)


@pytest.mark.ranks(2)
def test_work_of_a_nonlinear_body(block):
    """A plain step: two assemblies and factorisations; with an event: four."""
    branch, work = followed(block, 1.0, 0.2)
    assert branch.reason == "gamma reached the end of its range"
    assert len(work["plain"]) > 5
    assert work["event"]
    # The last step is corrected once more, to the end of the range.
    assert all(counts == (2, 2) for counts in work["plain"][1:-1])
    assert all(counts == (4, 4) for counts in work["event"])


def test_work_of_a_linear_body():
    """No assembly; one factorisation serves dozens of changes of status."""
    system = linear_triangle(16, 1.7, (26.0, 0.0), preload=(0.0, -7.5))
    _, work = followed(system, -1.0, 1.0)
    assert len(work["event"]) > 20
    assert sum(a for counts in work.values() for a, _ in counts) == 0
    total = sum(f for counts in work.values() for _, f in counts)
    assert total <= len(work["event"]) / 2


@pytest.mark.ranks(2)
def test_the_mesh_is_not_hashed_at_every_residual(block, monkeypatch):
    """Once a step, and where an observer may have moved it, which is refused at the next one."""
    count = [0]

    def crc32(*args):
        count[0] += 1
        return zlib.crc32(*args)

    monkeypatch.setattr(_geometry, "zlib", SimpleNamespace(crc32=crc32))
    seen = []

    class Count(Observer):
        def step(self, step, state):
            seen.append(count[0])

    x = block.create_vector()
    block.set_parameter(1.0)
    block.problem.solve()
    block.problem.write(x)
    given = dict(gamma_range=(0.2, 1.0), direction="decreasing", max_steps=4)
    follow(block, x, 1.0, control=StepControl(kinks="exact"), observer=Count(), **given)
    assert max(np.diff(seen)) <= 2
    nodes = block.equations.V.mesh.geometry.x
    before = nodes.copy()

    class Move(Observer):
        def step(self, step, state):
            nodes[:, 0] *= 1.1 if step.index == 2 and COMM.rank == COMM.size - 1 else 1.0

    with pytest.raises(ValueError, match="the mesh has moved"):
        follow(block, x, 1.0, control=StepControl(kinks="exact"), observer=Move(), **given)
    nodes[:] = before


def calls_of(monkeypatch, owner, name):
    """The number of calls of a method from now on, in a list of one entry."""
    count = [0]
    method = getattr(owner, name)

    def counted(*args):
        count[0] += 1
        return method(*args)

    monkeypatch.setattr(owner, name, counted)
    return count


def test_the_residual_of_a_solution_is_not_evaluated_again(monkeypatch):
    """By Newton's method alone, which begins where the data were checked; its state is the last."""
    count = calls_of(monkeypatch, ContactEquations, "residual")
    system, _ = moved_block(COMM, n=3)
    system.set_parameter(0.3)
    result, state = system.problem.solve_step(progress=False)
    assert count[0] == sum(a.evaluations for a in result.attempts)
    assert all(a.state is None for a in result.attempts)
    again = system.problem.evaluate()
    for found, expected in zip((*state.rows, state.u), (*again.rows, again.u), strict=True):
        size = np.abs(expected).max(initial=1.0)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)
    for codes, expected in zip(state.statuses, again.statuses, strict=True):
        np.testing.assert_array_equal(codes, expected)


def test_chords_change_nothing(block):
    """The branch with chords is that of Newton's method: points, statuses, corrections, events."""
    with_chords, newton = (followed(block, 1.0, 0.2, chords=c)[0] for c in (True, False))
    for name in ("gamma", "step"):
        values = [[getattr(p, name) for p in b.points] for b in (with_chords, newton)]
        np.testing.assert_allclose(*values, rtol=0, atol=1e-10)
    assert [p.corrections for p in with_chords.points] == [p.corrections for p in newton.points]
    letters = [[block.letters(p.piece) for p in b.points] for b in (with_chords, newton)]
    assert letters[0] == letters[1]
    events = [[(s.kind, s.parity, s.changes) for s in b.special] for b in (with_chords, newton)]
    assert events[0] == events[1]
    away = with_chords.points[-1].y - newton.points[-1].y
    assert away.norm() < 1e-9 * newton.points[-1].y.norm()


@pytest.mark.ranks(2)
def test_what_follows_from_a_state_is_made_of_one_evaluation(block, monkeypatch):
    """Matrix, rate by gamma, events and pieces, where nobody else changes data; and it is right."""
    eq = block.equations
    block.set_parameter(1.0)
    block.problem.solve()
    x = block.create_vector()
    block.problem.write(x)
    other = x.copy()
    other.scale(1.1)
    b, c = x.duplicate(), x.duplicate()
    count = calls_of(monkeypatch, ContactEquations, "kinematics")

    def evaluations(y, gamma):
        """How often a surface was looked at for all that a step wants at a state."""
        count[0] = 0
        block.residual(y, gamma, b, None)
        piece = block.piece_at(y, gamma)
        block.jacobian(y, gamma, piece)
        block.parameter_derivative(y, gamma, c, piece)
        stuck = block.piece([np.full(len(codes), STICK) for codes in eq.contact(y).statuses])
        events = block.events(y, gamma, stuck)
        return count[0] - 1, c.array_r.copy(), (events.distance, events.point, events.target)

    alone = {}
    with block.restored(always=True), block.undisturbed():
        for name, y, gamma in (("x", x, 1.0), ("gamma", x, 0.9), ("other", other, 0.9)):
            alone[name] = evaluations(y, gamma)
            assert alone[name][0] == 1, name
    with block.restored(always=True):
        for name, y, gamma in (("x", x, 1.0), ("gamma", x, 0.9), ("other", other, 0.9)):
            number, rate, events = evaluations(y, gamma)
            assert number == 5
            np.testing.assert_array_equal(rate, alone[name][1])
            for found, expected in zip(events, alone[name][2], strict=True):
                np.testing.assert_array_equal(found, expected)
    for v in (x, other, b, c):
        v.destroy()


@pytest.mark.ranks(2)
def test_a_product_is_not_made_twice(monkeypatch):
    """K u at one displacement, for the residual, the energy and the balance, until K is another."""
    count = calls_of(monkeypatch, Bulk, "times")
    domain = box(COMM, 3, "quad")
    young = fem.Constant(domain, 1000.0)
    body = elastic_block(domain=domain, young=young).equations.bulk
    u = np.sin(np.arange(len(body.displacement.x.array)) + 1.0)
    K = body.stiffness(u)
    before = count[0]
    rows = body.affine_residual(u)
    np.testing.assert_array_equal(body.affine_residual(u.copy()), rows)
    assert body.energy_at(u) is not None
    assert count[0] == before + 1
    body.affine_residual(2.0 * u)
    assert count[0] == before + 2
    young.value *= 2.0
    assert body.affine_residual(u) is None
    assert body.stiffness(u) == K
    np.testing.assert_allclose(body.affine_residual(u), 2.0 * rows, rtol=1e-12)
