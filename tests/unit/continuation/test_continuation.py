"""The continuation on systems whose diagrams are known."""

import itertools

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.textbook import SymmetricGuess, Textbook, circle, one_node, smooth, start

from dolfinx_contact.continuation import (
    Ending,
    Events,
    Follower,
    Piece,
    StepControl,
    System,
    explore,
    find_solutions,
    follow,
)
from dolfinx_contact.continuation.corrector import Corrector


@pytest.fixture(params=["factorised", "krylov"], autouse=True)
def algebra(request, monkeypatch):
    """Every test with an assembled matrix and with a Krylov method."""
    if request.param == "krylov":
        monkeypatch.setattr(Textbook, "preconditioner", SymmetricGuess())
    return request.param


def values(system, point):
    """x and gamma of a point, on every rank."""
    y = point.y
    parts = system.comm.allgather(y.array_r.copy())
    whole = np.concatenate(parts)
    return whole[:-1], whole[-1]


@pytest.mark.verifies(
    "branches", reference="closed form: the fold of a circle", aspects=("branches",), alone=True
)
def test_a_circle_has_its_fold_and_other_half():
    """x^2 + g^2 = 1: the smooth fold at g = 1, located, and round to the other end."""
    system = circle()
    branch = follow(system, start(system, [1.0]), 0.0, gamma_range=(-0.5, 2.0))
    assert [s.kind for s in branch.special] == ["fold"]
    assert branch.special[0].smooth
    assert abs(branch.special[0].gamma - 1.0) < 1e-10
    x, g = values(system, branch.points[-1])
    assert g == pytest.approx(-0.5, abs=1e-12)
    assert x[0] == pytest.approx(-np.sqrt(0.75), abs=1e-10)
    assert branch.reason == "gamma reached the end of its range"
    assert branch.ending is Ending.REACHED


@pytest.mark.parametrize("unit", [1.0, 1e7])
def test_a_kink_is_passed_in_any_units_of_gamma(unit):
    """x = max(0, g - 1): only the column of gamma changes at the kink."""
    size = 1.0 / unit
    system = Textbook(
        2,
        lambda x, g, codes: [x[0] / size - codes[0] * (g / unit - 1.0), x[1] / size],
        lambda x, g, codes: np.eye(2) / size,
        lambda x, g, codes: [-codes[0] / unit, 0.0],
        distances=lambda x, g, codes: [[((1.0 - g / unit) * (1 - 2 * codes[0]), 1 - codes[0])]],
        codes=lambda x, g: [int(g > unit)],
        statuses=(0, 1),
    )
    x = start(system, [0.0, 0.0])
    branch = follow(system, x, 0.0, gamma_range=(0.0, 4.0 * unit), max_steps=50)
    assert branch.complete
    assert [s.gamma for s in branch.special] == pytest.approx([unit])
    x, g = values(system, branch.points[-1])
    assert (x[0] / size, g / unit) == pytest.approx((3.0, 4.0), rel=1e-9)


def complementary(M, q, d, unit):
    """min(x, M x + q + g d) = 0, with g in units of ``unit`` and x in units of its inverse."""
    size = 1.0 / unit

    def driven(x, g):
        return M @ x / size + q + d * g / unit

    def sides(x, g, codes):
        return np.where(codes == 0, 1.0, -1.0) * (driven(x, g) - x / size)

    return Textbook(
        2,
        lambda x, g, codes: np.where(codes == 0, x / size, driven(x, g)),
        lambda x, g, codes: np.where(codes[:, None] == 0, np.eye(2), M) / size,
        lambda x, g, codes: np.where(codes == 0, 0.0, d) / unit,
        distances=lambda x, g, codes: [
            [(d, 1 - c)] for d, c in zip(sides(x, g, codes), codes, strict=True)
        ],
        codes=lambda x, g: driven(x, g) < x / size,
        statuses=(0, 1),
    )


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_the_solution_zero_is_found_once(unit):
    """The other solution is (0, q_2/3)."""
    M = np.array([[0.0, 2.0], [3.0, -3.0]])
    q = np.array([2.55, 2.82])
    system = complementary(M, q, np.ones(2), unit)
    random = np.random.default_rng(0)
    guesses = [start(system, random.uniform(-1.0, 3.0, 2) / unit) for _ in range(2)]
    found = find_solutions(system, guesses, 0.0, deflation=True).found
    states = sorted((solution.x.array_r * unit for solution in found), key=sum)
    np.testing.assert_allclose(states, [(0.0, 0.0), (0.0, 0.94)], atol=1e-10)


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_rays_are_distinguished_in_any_units_of_gamma(unit):
    """There are two solutions for g < 0, one of them at rest, and two for g > 0."""
    M = np.array([[2.0, 2.0], [1.5, -2.0]])
    system = complementary(M, np.zeros(2), np.array([-1.0, -0.07]), unit)
    at_rest = start(system, [0.0, 0.0])
    diagram = explore(system, [(at_rest, -unit)], gamma_range=(-2.0 * unit, 2.0 * unit))
    assert [len(node.rays) for node in diagram.nodes] == [4]


@pytest.mark.parametrize("slope", [-1.0, 2.0])
def test_a_branch_continues_after_a_step_that_ends_at_a_kink(slope):
    """x = g, or slope g for g < 0: steps of 1/4 and 1/2 lead from g = 3/4 to the kink at 0."""
    slopes = np.array([1.0, slope])
    system = Textbook(
        1,
        lambda x, g, codes: [x[0] - slopes[codes[0]] * g],
        lambda x, g, codes: [[1.0]],
        lambda x, g, codes: [-slopes[codes[0]]],
        distances=lambda x, g, codes: [[(g * (1 - 2 * codes[0]), 1 - codes[0])]],
        codes=lambda x, g: [int(g < 0)],
        statuses=(0, 1),
    )
    control = StepControl(initial=0.125, maximum=1.0, increase=2.0)
    ways = dict(gamma_range=(-1.0, 1.0), direction="decreasing", control=control)
    branch = follow(system, start(system, [0.75]), 0.75, **ways)
    assert [p.gamma for p in branch.points][:3] == pytest.approx([0.75, 0.5, 0.0], abs=1e-15)
    assert [s.gamma for s in branch.special] == pytest.approx([0.0], abs=1e-15)
    x, g = values(system, branch.points[-1])
    assert (x[0], g) == pytest.approx((-slope, -1.0))


@pytest.fixture
def options():
    """Database of PETSc's options without changes after the test."""
    database = PETSc.Options()
    before = database.getAll()
    yield database
    for name in set(database.getAll()) - set(before):
        database.delValue(name)


def test_snes_monitor_prints_the_corrections(options, capfd):
    options["continuation_snes_monitor"] = ""
    system = circle()
    branch = follow(system, start(system, [1.0]), 0.0, gamma_range=(-0.5, 0.5))
    corrections = sum(point.corrections for point in branch.points)
    assert capfd.readouterr().out.count("SNES Function norm") > corrections > 0


def test_snes_max_it_limits_the_corrections_and_the_converged_reason_names_it(options, capfd):
    options["continuation_snes_max_it"] = 1
    options["continuation_snes_converged_reason"] = ""
    system = circle()
    with pytest.raises(ValueError, match="no solution near"):
        follow(system, start(system, [1.1]), 0.0, gamma_range=(-0.5, 0.5))
    assert "did not converge due to DIVERGED_MAX_IT" in capfd.readouterr().out


def test_other_types_of_snes_are_refused_for_corrections(options):
    options["continuation_snes_type"] = "newtonls"
    system = circle()
    with pytest.raises(ValueError, match="-continuation_snes_type cannot be used"):
        follow(system, start(system, [1.0]), 0.0, gamma_range=(-0.5, 0.5))


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize("route", ["auto", "steps"])
@pytest.mark.parametrize("gamma", [-1.0, 1.0, 1.0 - 1e-15])
def test_a_start_at_an_end_of_the_range_has_one_direction(route, gamma):
    """There is no branch outwards; `explore` follows the inner one to the other end."""
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    x = start(system, [gamma / 2, 0, gamma, 1.0])
    ways = dict(gamma_range=(-1.0, 1.0), route=route)
    inwards, outwards = "decreasing", "increasing"
    if gamma < 0:
        inwards, outwards = outwards, inwards
    with pytest.raises(ValueError, match=r"leaves its range \[-1, 1\] immediately"):
        follow(system, x, gamma, direction=outwards, **ways)
    branch = follow(system, x, gamma, direction=inwards, **ways)
    diagram = explore(system, [(x, gamma)], **ways)
    for followed in (branch, *diagram.branches):
        assert [followed.points[k].gamma for k in (0, -1)] == [gamma, -np.sign(gamma)]
    assert len(diagram.branches) == 1
    assert diagram.complete


@pytest.mark.ranks(2, 3)
@pytest.mark.verifies(
    "branches",
    reference="closed form: one node, folds at 3 and 2",
    aspects=("branches",),
    alone=True,
)
def test_the_node_has_two_nonsmooth_folds():
    """The one-node S: kt = kn = 2, k = 1, F = 3, p = (-g, -1); folds at 3 and 2."""
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    branch = follow(system, start(system, [0, 0, 0, 1.0]), 0.0, gamma_range=(-1.0, 5.0))
    assert [s.kind for s in branch.special] == ["fold", "fold"]
    np.testing.assert_allclose([s.gamma for s in branch.special], [3.0, 2.0], atol=1e-10)
    for s, change in zip(branch.special, [(1, 3), (3, 0)], strict=True):
        assert not s.smooth
        assert [(c.before, c.after) for c in s.changes] == [change]
        assert s.parity == 1  # neither fold is a bifurcation
        assert s.others == ()
    x, g = values(system, branch.points[-1])
    assert g == pytest.approx(5.0, abs=1e-12)
    # Separated: S u = p.
    np.testing.assert_allclose(x[:2], np.linalg.solve([[2, 1], [1, 2]], [-5, -1]), atol=1e-9)


@pytest.mark.each_value
@pytest.mark.parametrize("factor", [0.1, 10.0])
@pytest.mark.parametrize("units", [1.0, 1e9, 1e-6])
def test_the_path_does_not_depend_on_steps_and_units(factor, units, algebra):
    if algebra == "krylov" and units != 1:
        pytest.skip("the preconditioner of these tests knows no units")
    control = StepControl(initial=0.02 * factor, maximum=0.1 * factor)
    system = one_node(2 * units, 2 * units, units, 3.0, (0.0, -units), (-units, 0.0))
    residual = system.residual
    system.residual = lambda *args: residual(*args) / units
    x = start(system, [0, 0, 0, units])
    branch = follow(system, x, 0.0, gamma_range=(-1.0, 5.0), control=control)
    np.testing.assert_allclose([s.gamma for s in branch.special], [3.0, 2.0], atol=1e-10)


@pytest.mark.ranks(2)
def test_below_the_critical_friction_slip_goes_on_without_a_fold():
    """Below the critical coefficient: stick, then slip to the left, no fold."""
    system = one_node(2.0, 2.0, 1.0, 1.0, (0.0, -1.0), (-1.0, 0.0))
    branch = follow(system, start(system, [0, 0, 0, 1.0]), 0.0, gamma_range=(-1.0, 5.0))
    assert [s.kind for s in branch.special] == ["event", "event"]
    np.testing.assert_allclose([s.gamma for s in branch.special], [1.0, 2.0], atol=1e-10)


def corner(sign):
    """|x| = sign g + ...: H = |x| - g has a nonsmooth fold at the origin, x = |g| a kink."""
    if sign > 0:  # x - |g|... a kink of x over g
        H = lambda x, g, s: np.array([x[0] - (g if s[0] else -g)])  # noqa: E731
        J = lambda x, g, s: [[1.0]]  # noqa: E731
        c = lambda x, g, s: [-1.0 if s[0] else 1.0]  # noqa: E731
        distances = lambda x, g, s: [[(g if s[0] else -g, 1 - s[0])]]  # noqa: E731
        codes = lambda x, g: [int(g > 0)]  # noqa: E731
    else:
        H = lambda x, g, s: np.array([(x[0] if s[0] else -x[0]) - g])  # noqa: E731
        J = lambda x, g, s: [[1.0 if s[0] else -1.0]]  # noqa: E731
        c = lambda x, g, s: [-1.0]  # noqa: E731
        distances = lambda x, g, s: [[(x[0] if s[0] else -x[0], 1 - s[0])]]  # noqa: E731
        codes = lambda x, g: [int(x[0] > 0)]  # noqa: E731
    return Textbook(1, H, J, c, distances, codes, (0, 1))


@pytest.mark.parametrize(
    ("sign", "gamma", "direction", "kind"),
    [(1, -1.0, "increasing", "event"), (-1, 1.0, "decreasing", "fold")],
)
def test_branch_passes_a_corner_over_gamma_or_turns_back(sign, gamma, direction, kind):
    system = corner(sign)
    x = start(system, [1.0])
    branch = follow(system, x, gamma, gamma_range=(-1.0, 2.0), direction=direction)
    assert [s.kind for s in branch.special] == [kind]
    assert abs(branch.special[0].gamma) < 1e-12
    x, _ = values(system, branch.points[-1])
    assert x[0] == pytest.approx(2.0 * sign, abs=1e-10)


@pytest.mark.ranks(2)
def test_correctors_agree():
    """Moore-Penrose, pseudo-arclength and natural end on the same curve."""
    system = smooth(
        1, lambda x, g: x**3 - x + g, lambda x, g: [[3 * x[0] ** 2 - 1]], lambda x, g: [1.0]
    )
    with Follower(system, StepControl(), gamma_scale=1.0) as follower:
        point = follower.start(start(system, [1.3]), -0.8)
        b = follower.bordered
        corrector = follower.corrector
        y = point.y.copy()
        t = point.tangent.copy()
        y.axpy(0.05, point.tangent)
        by_chords = y.copy()
        assert corrector.moore_penrose(by_chords, t.copy(), point.piece) is not None
        newton = Corrector(b, StepControl(), chords=False)
        assert newton.moore_penrose(y, t, point.piece) is not None
        by_chords.axpy(-1.0, y)
        assert by_chords.norm() < 1e-10
        z = point.y.copy()
        z.axpy(0.05, point.tangent)
        assert corrector.pseudo_arclength(z, point.y, point.tangent, 0.05, point.piece)
        w = point.y.copy()
        assert corrector.natural(w, b.gamma(y), point.piece)
        w.axpy(-1.0, y)
        assert w.norm() < 1e-9
        z.axpy(-1.0, y)
        assert z.norm() < 1e-3


@pytest.mark.parametrize(
    ("H", "J", "c", "other"),
    [
        (
            lambda x, g: g * x - x**3,
            lambda x, g: [[g - 3 * x[0] ** 2]],
            lambda x, g: [x[0]],
            lambda x, g: g - x**2,
        ),
        (
            lambda x, g: g * x - x**2,
            lambda x, g: [[g - 2 * x[0]]],
            lambda x, g: [x[0]],
            lambda x, g: g - x,
        ),
    ],
    ids=["pitchfork", "transcritical"],
)
@pytest.mark.verifies(
    "branches",
    reference="closed form: pitchfork and transcritical bifurcation",
    aspects=("branches",),
    alone=True,
)
def test_smooth_bifurcations_are_located(H, J, c, other):
    """From the trivial branch: found, located to 1e-8, and branched off both ways."""
    system = smooth(1, H, J, c)
    with Follower(system, StepControl(), gamma_scale=2.0) as follower:
        begin = follower.start(start(system, [0.0]), -1.0)
        branch = follower.run(begin, gamma_range=(-1.0, 1.013))
        (special,) = branch.special
        assert special.kind == "bifurcation"
        assert special.smooth
        assert abs(special.gamma) < 1e-8
        ends = []
        for ray in special.others:
            point = follower.branch_off(special, ray)
            away = follower.run(point, gamma_range=(-0.5, 0.5))
            x, g = values(system, away.points[-1])
            assert abs(x[0]) > 0.1
            assert abs(other(x[0], g)) < 1e-9
            ends.append(np.sign(x[0]))
        assert sorted(ends) == [-1, 1]


@pytest.mark.verifies(
    "branches",
    reference="closed form: Bratu's fold at 3.513830719",
    aspects=("branches",),
    alone=True,
)
def test_bratu_has_its_fold():
    """-u'' = g exp(u) on (0, 1): the fold at 3.513830719, and no bifurcation."""
    system = bratu(200)
    x = system.create_vector()
    x.set(0.0)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 4.0), max_steps=200)
    (fold,) = branch.special
    assert fold.kind == "fold"
    assert fold.smooth
    assert abs(fold.gamma - 3.513830719) < 1e-8
    assert branch.points[-1].gamma < 3


class bratu(System):
    """The Bratu problem in 1D with P4 elements."""

    def __init__(self, n):
        import ufl
        from dolfinx import fem, la, mesh
        from dolfinx.fem.petsc import assemble_matrix

        self.comm = MPI.COMM_WORLD
        domain = mesh.create_unit_interval(self.comm, n)
        V = fem.functionspace(domain, ("Lagrange", 4))
        self._u = fem.Function(V)
        v = ufl.TestFunction(V)
        self._g = fem.Constant(domain, 0.0)
        source = ufl.exp(self._u) * v * ufl.dx
        R = self._u.dx(0) * v.dx(0) * ufl.dx - self._g * source
        self._R = fem.form(R)
        self._c = fem.form(-source)
        self._J = fem.form(ufl.derivative(R, self._u, ufl.TrialFunction(V)))
        ends = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0] * (1 - x[0]), 0))
        self._bc = fem.dirichletbc(0.0, ends, V)
        self._n = V.dofmap.index_map.size_local
        self._ends = ends[ends < self._n]
        self._assemble_matrix = assemble_matrix
        self._add = la.InsertMode.add
        self._fem = fem
        self._scratch = la.vector(V.dofmap.index_map, 1)
        self._places = V.tabulate_dof_coordinates()[: self._n, 0]
        self.matrix = assemble_matrix(self._J, bcs=[self._bc])
        self.matrix.assemble()

    def create_vector(self):
        return self.matrix.createVecRight()

    def _put(self, x, gamma):
        self._u.x.array[: self._n] = x.array_r
        self._u.x.scatter_forward()
        self._g.value = gamma

    def _vector(self, form, at_ends, out):
        b = self._scratch
        b.array[:] = 0.0
        self._fem.assemble_vector(b.array, form)
        b.scatter_reverse(self._add)
        out.array[:] = b.array[: self._n]
        out.array[self._ends] = at_ends

    def residual(self, x, gamma, b, _piece):
        self._put(x, gamma)
        self._vector(self._R, self._u.x.array[self._ends], b)
        return 1e-2 * b.norm()

    def jacobian(self, x, gamma, _piece):
        self._put(x, gamma)
        self.matrix.zeroEntries()
        self._assemble_matrix(self.matrix, self._J, bcs=[self._bc])
        self.matrix.assemble()

    def parameter_derivative(self, x, gamma, c, _piece):
        self._put(x, gamma)
        self._vector(self._c, 0.0, c)

    def metric(self, x, out):
        x.copy(out)

    def probe(self, seed):
        x = self.create_vector()
        x.array[:] = np.sin(seed + 9 * self._places)
        return x

    def piece_at(self, _x, _gamma):
        return Piece(np.zeros(0, dtype=np.int8))

    def events(self, _x, _gamma, _piece):
        return Events(np.zeros(0), np.zeros(0, np.int32), np.zeros(0, np.int8))

    def statuses(self, _point):
        return ()


@pytest.mark.ranks(2, 3)
@pytest.mark.verifies(
    "branches",
    reference="independent code: the sign of the determinant by MUMPS",
    aspects=("branches",),
)
def test_parity_is_the_sign_of_a_quotient_of_determinants():
    """For every pair of statuses, compared with dense matrices."""
    from dolfinx_contact.continuation.branch import Ray
    from dolfinx_contact.continuation.ray_finder import parity

    for F in (0.5, 3.0):
        system = one_node(2.0, 2.0, 1.0, F, (0.0, -1.0), (-1.0, 0.3))
        with Follower(system, StepControl(), gamma_scale=1.0) as follower:
            point = follower.start(start(system, [0, 0, 0, 1.0]), 0.0)
            b = follower.bordered
            signs = []
            rays = []
            for code in range(4):
                codes = np.full(len(point.piece.codes), code, dtype=np.int8)
                piece = type(point.piece)(codes)
                t = follower.corrector.tangent(point.y, point.tangent, piece)
                rays.append(Ray(piece, t))
                row = np.concatenate(system.comm.allgather(b.dual(t).array_r))
                state = np.zeros(4), 0.0, [code]
                J = np.column_stack([system._J(*state), system._c(*state)])
                signs.append(np.sign(np.linalg.det(np.vstack([J, row]))))
            for before, after in itertools.product(range(4), repeat=2):
                t = rays[before].tangent
                sign = parity(follower.corrector, point.y, rays[before].piece, t, rays[after])
                assert sign == signs[before] * signs[after], (F, before, after)


@pytest.mark.ranks(2)
def test_an_exhausted_budget_keeps_what_was_found():
    system = one_node(2.0, 2.0, 1.0, 3.0, (0.0, -1.0), (-1.0, 0.0))
    x = start(system, [0, 0, 0, 1.0])
    branch = follow(system, x, 0.0, gamma_range=(-1.0, 5.0), max_steps=3)
    assert len(branch.points) == 4
    assert branch.reason == "the budget of 3 steps is exhausted"
    assert branch.ending is Ending.BUDGET


@pytest.mark.ranks(2)
def test_a_branch_without_continuation_says_so_and_is_kept(algebra):
    """x - g = 0 for g < 0, and twelve more rows that have no solution beyond: said, and kept."""
    if algebra == "krylov":
        pytest.skip("the matrix is singular, with the right-hand side in its range")
    n = 12
    system = Textbook(
        n,
        lambda x, g, s: np.where(s, x**2 + g, x - g),
        lambda x, g, s: np.diag(np.where(s, 2 * x, 1.0)),
        lambda x, g, s: np.where(s, 1.0, -1.0),
        lambda x, g, s: [[(g if c else -g, 1 - c)] for c in s],
        lambda x, g: np.full(n, int(g > 0)),
        (0, 1),
    )
    branch = follow(system, start(system, -np.ones(n)), -1.0, gamma_range=(-1.0, 1.0))
    assert "12 points are at a kink at once (too many pieces to try)" in branch.reason
    assert branch.ending is Ending.NOT_FOUND
    assert branch.points[-1].gamma == pytest.approx(0.0, abs=1e-9)
