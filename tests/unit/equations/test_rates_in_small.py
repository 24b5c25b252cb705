"""Data of contact problems and their rates, states of surfaces, and what arguments must fit."""

import logging
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import block, box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.body.rigid import parts
from dolfinx_contact.equations import (
    constraints,
    sliding,
    substitute,
)
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.data import data_in
from dolfinx_contact.equations.evaluation import ContactState, Evaluation, differs
from dolfinx_contact.equations.jacobian import _Numbering
from dolfinx_contact.equations.parametric import ParametricEquations
from dolfinx_contact.equations.scaling import LooseMotions, _direction, require_hoop_stiffness
from dolfinx_contact.equations.sliding import SlidingTerms, _Block, _pattern, _Pieces
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK, WHERE_OPEN
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
ALONE = MPI.COMM_SELF


# -- data ------------------------------------------------------------------------------------------


def test_places_of_data_in_words():
    """Constants are counted where there are several; what is a place by itself has its name."""
    domain = box(COMM, 1, "tri")
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)), name="heat")
    one, two = fem.Constant(domain, 1.0), fem.Constant(domain, 2.0)
    for e in (one * f, one * f * ufl.dx(domain)):
        assert [(d.place, d.value) for d in data_in(e, "here")] == [
            ("the Function 'heat' in here", f),
            ("the Constant in here", one),
        ]
    found = [(d.place, d.value) for d in data_in(one + two, "here")]
    assert found == [("the Constant 1 in here", one), ("the Constant 2 in here", two)]
    assert [(d.place, d.value) for d in data_in(one, "here")] == [("here", one)]
    assert [(d.place, d.value) for d in data_in(f, "here")] == [("here", f)]
    assert list(data_in(ufl.as_ufl(3.0), "here")) == []


def test_places_of_the_unknowns_of_two_surfaces():
    """One field after the other; none of what is fixed or removed."""
    removed = np.array([False, True, True, False, False, True, False, False])
    eq = SimpleNamespace(
        comm=ALONE,
        dim=2,
        owned_sizes=[4, 2, 6, 3],
        fixed=np.array([True, False, False, False, True]),
        constraints=SimpleNamespace(removed_multipliers=lambda: removed),
        rigid=SimpleNamespace(size=3),
    )
    numbering = _Numbering(eq)
    assert numbering.first == 0
    for field, places in ((0, [-1, 1, 2, 3]), (1, [4, -1]), (2, [-1, 7, 8, -1, 10, 11])):
        dofs = np.arange(len(places))
        np.testing.assert_array_equal(numbering.dof_places(field, dofs), places)
        nodes = np.arange(len(places) // 2)
        found = numbering.places(field, nodes)
        np.testing.assert_array_equal(found, np.reshape(places, (-1, 2)))
    np.testing.assert_array_equal(numbering.rigid(), [12, 13, 14])


# -- a problem with a parameter -------------------------------------------------------------------


def equations(**known):
    """Equations with a parameter, of which nothing is known but what is given."""
    made = ParametricEquations.__new__(ParametricEquations)
    vars(made).update({"comm": ALONE, "_driven": [], "_driven_at": None, "_alone": False} | known)
    return made


def test_which_other_parameters_shift_loads_evenly():
    domain = box(COMM, 1, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    v = ufl.TestFunction(V)
    gamma, other, third = (fem.Constant(domain, c) for c in (3.0, 5.0, 7.0))

    def asked(
        residual=0.0, jacobian=(), gap=0.0, normal=(0.0, 1.0), field=0.3, motion=0.0, drives=()
    ):
        given = SimpleNamespace(
            normal=ufl.as_vector([ufl.as_ufl(c) for c in normal]),
            gap=gap,
            fields={"friction": field},
        )
        form = ufl.inner(ufl.as_vector([third + residual, third]), v) * ufl.dx
        bulk = SimpleNamespace(residual=form, jacobian_constants=list(jacobian))
        body = SimpleNamespace(expressions=[motion])
        eq = SimpleNamespace(
            bulk=bulk, surfaces=[SimpleNamespace(given=given)], rigid=SimpleNamespace(bodies=[body])
        )
        driven = [SimpleNamespace(expression=e) for e in drives]
        return equations(equations=eq, constant=gamma, _driven=driven)._not_affine_in(other)

    assert asked() == ""
    assert asked(residual=other) == ""
    assert asked(residual=gamma + other) == ""
    assert asked(gap=2.0 * other, field=other, motion=other, drives=(other + gamma,)) == ""
    assert asked(jacobian=[third, other]) == "the stiffness depends on it"
    words = "a rate by the first depends on it"
    assert asked(residual=gamma * other) == words
    assert asked(motion=gamma * other) == words
    assert asked(drives=(gamma * other,)) == words
    assert asked(gap=gamma * other) == ""
    assert asked(normal=(other, 1.0)) == "a normal depends on it"
    for known in ("residual", "gap", "field", "motion"):
        assert asked(**{known: other**2})
    assert asked(drives=(other**2,))


def test_what_gamma_drives_follows_it():
    """Functions are set again unless nobody else may have changed them; put back at will."""
    sets = []
    f = SimpleNamespace(x=SimpleNamespace(array=np.array([1.0])))
    d = SimpleNamespace(function=f, set=lambda: sets.append(float(constant.value)))
    constant = SimpleNamespace(value=np.array(2.0))
    meshes = []
    eq = SimpleNamespace(require_same_mesh=lambda: meshes.append(1))
    one = equations(_driven=[d], constant=constant, equations=eq)
    for gamma in (3.0, 3.0):
        one._set(gamma)
    assert sets == [3.0, 3.0]
    assert one._driven_at is None
    sets.clear()
    with one.undisturbed():
        for gamma in (3.0, 3.0, 4.0, 4.0, 3.0):
            one._set(gamma)
        assert sets == [3.0, 4.0, 3.0]
        assert one._driven_at == 3.0
    assert meshes == [1]
    assert (one._driven_at, one._alone) == (None, False)
    for always, fails, back in ((False, False, False), (True, False, True), (False, True, True)):
        constant.value, f.x.array[0], one._driven_at = np.array(2.0), 1.0, 2.0
        try:
            with one.restored(always=always):
                constant.value, f.x.array[0] = np.array(9.0), 8.0
                if fails:
                    raise KeyError
        except KeyError:
            pass
        assert (float(constant.value), f.x.array[0]) == ((2.0, 1.0) if back else (9.0, 8.0))
        assert one._driven_at == (None if back else 2.0)


def test_what_is_asked_of_the_solver():
    """The matrix is to stay the same; rows are solved where the solver does."""
    updated = []
    linear = SimpleNamespace(
        matrix="A",
        corrects=False,
        update=updated.append,
        correct=lambda *given: given,
        preconditioner="pc",
        is_followed_with=False,
    )
    given = [linear]
    one = equations(_linear=lambda: given[0], _solver=None)
    one.contact = lambda x, gamma, piece: ("state", x, gamma, piece)
    one.jacobian("x", 0.5, "piece")
    assert updated == [("state", "x", 0.5, "piece")]
    assert (one.preconditioner, one.matrix) == ("pc", "A")
    assert linear.is_followed_with
    given[0] = SimpleNamespace(matrix="other", preconditioner="its own")  # under other options
    assert one.matrix == "A"
    assert one.correct("x", 0.5, "r", "c", "piece") is False
    linear.corrects = True
    assert one.correct("x", 0.5, "r", "c", "piece") == (("state", "x", 0.5, "piece"), "r", "c")
    linear.update = lambda state: setattr(linear, "matrix", "B")
    with pytest.raises(ValueError, match="others than those for which the Jacobian has"):
        one.jacobian("x", 0.5, "piece")
    for text, words in (("", ""), ("|u|", "the bulk has kinks in u: |u|")):
        one.equations = SimpleNamespace(bulk=SimpleNamespace(kinks=text))
        assert one.kinks == words


@dataclass
class Borders:
    distance: Any
    target: Any


def test_events_of_a_state():
    """Of points that are not clamped, as lengths, where there are borders."""
    inf = np.inf

    def surface(distance, target, r):
        borders = Borders(np.array(distance), np.array(target))
        state = SimpleNamespace(
            answers=SimpleNamespace(borders=lambda codes: borders), statuses="codes"
        )
        return SimpleNamespace(points=SimpleNamespace(mean_augmentation=r)), state

    a = surface([[2.0, inf], [4.0, -6.0]], [[PLUS, OPEN], [STICK, MINUS]], 2.0)
    b = surface([[3.0], [9.0]], [[OPEN], [PLUS]], 3.0)
    eq = SimpleNamespace(surfaces=[a[0], b[0]])
    one = equations(
        equations=eq,
        _offsets=np.array([0, 2, 4]),
        clamped=np.array([False, False, True, False]),
    )
    one.contact = lambda *_: SimpleNamespace(surfaces=[a[1], b[1]])
    found = one.events("x", 0.5, "piece")
    np.testing.assert_array_equal(found.distance, [1.0, 2.0, -3.0, 3.0])
    np.testing.assert_array_equal(found.point, [0, 1, 1, 3])
    np.testing.assert_array_equal(found.target, [PLUS, STICK, MINUS, PLUS])
    assert found.point.dtype == np.int32
    piece = one.piece([np.array([PLUS, STICK]), np.array([STICK, MINUS])])
    assert piece.codes.tolist() == [PLUS, STICK, OPEN, MINUS]
    assert [c.tolist() for c in one.statuses_of(piece)] == [[PLUS, STICK], [OPEN, MINUS]]
    assert one.statuses_of(None) is None
    for s, codes in zip(eq.surfaces, ((3, 1), (2, 0)), strict=True):
        s.law_at_points = SimpleNamespace(codes=codes)
    assert [one.statuses(i) for i in range(4)] == [[1, 3], [1, 3], [0, 2], [0, 2]]


@pytest.mark.skipif(COMM.size > 1, reason="one order")
def test_states_to_probe_with():
    """By their places in units of the body, so that numbering does not matter."""
    problem = block(n=2)
    system = ParametricContact(problem, fem.Constant(problem.V.mesh, 0.0))
    eq = system.equations
    for seed in (1, 2):
        x = system.probe(seed)
        values = eq.blocks(x)
        for V, mine in zip((eq.V, eq.surfaces[0].points.Q), values[:2], strict=True):
            places = V.tabulate_dof_coordinates() / np.sqrt(2.0)
            phase = places[:, 0] * 12.9898 + places[:, 1] * 78.233 + seed
            expected = np.stack([np.sin(43.7585 * (phase + k)) for k in (0, 1)], axis=1)
            np.testing.assert_allclose(mine.reshape(-1, 2), expected, atol=1e-9)
        x.destroy()
    x, out = system.create_vector(), system.create_vector()
    n = eq.owned_sizes[0]
    x.array[:n] = np.tile([3.0, 4.0], n // 2)
    system.metric(x, out)
    # Of a motion of the whole body its length over the size of the body.
    assert x.dot(out) == pytest.approx(25.0 / 2.0)
    assert not out.array_r[n:].any()
    system.destroy()
    assert system._metric is None


# -- states of surfaces ---------------------------------------------------------------------------


def surface_state(share=None, absent=None, spreading=None, turned=None):
    """Random answers at three points in the plane, by one status."""
    rng = np.random.default_rng(3)
    names = ("traction", "by_jump", "by_traction")
    values = {n: rng.normal(size=(3, 2, 2)) for n in names[1:]} | {
        "traction": rng.normal(size=(3, 2))
    }
    answers = SimpleNamespace(
        **{n: (lambda codes, v=values[n]: v) for n in names},
        by_around=lambda codes: np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
        spreading=spreading,
    )
    operator = SimpleNamespace(
        share=share,
        absent=absent,
        mean_around=lambda t: 0.5 * t,
        rate=lambda v: 2.0 * v,
        normal_rate=lambda v: turned,
    )
    data = SimpleNamespace(n=np.tile([0.6, 0.8], (3, 1)))
    kinematics = SimpleNamespace(operator=operator, jump="jump", data=data)
    state = ContactState(kinematics, rng.normal(size=(3, 2)), np.array([STICK] * 3), answers)
    return state, values


def test_tractions_that_are_off():
    """By the part that has something opposite, else from what is around; absent ones are free."""
    state, values = surface_state()
    np.testing.assert_allclose(state.off, state.traction - values["traction"])
    share = np.array([1.0, 0.25, 0.0])
    absent = np.array([False, False, True])
    state, values = surface_state(share, absent)
    answer = np.where(absent[:, None], 0.0, values["traction"])
    np.testing.assert_array_equal(state.answer, answer)
    np.testing.assert_array_equal(state.by_jump[2], 0.0)
    np.testing.assert_array_equal(state.by_jump[:2], values["by_jump"][:2])
    off = state.traction - answer
    expected = share[:, None] * off + (1 - share[:, None]) * 0.5 * state.traction
    expected[2] = state.traction[2]
    np.testing.assert_allclose(state.off, expected)
    assert state.jump == "jump"
    both = Evaluation(None, None, [state, state])
    assert [c.tolist() for c in both.statuses] == [[STICK] * 3] * 2
    assert [d.tolist() for d in differs([np.array([1, 2])], [np.array([1, 3])])] == [[False, True]]


def test_changes_of_answers_along_steps():
    """By the jump, by what the points around spread, and by normals that turn."""
    v = np.array([[1.0, 2.0], [3.0, -1.0], [0.5, 0.0]])
    state, values = surface_state()
    rate = np.array([a @ b for a, b in zip(values["by_jump"], v, strict=True)])
    np.testing.assert_allclose(state.along(v), rate)
    np.testing.assert_allclose(state.change(v), 2 * rate)
    slopes = np.array([[1.0, 0.0], [0.0, 2.0], [3.0, 1.0]])
    spread = SimpleNamespace(by_jump=slopes, by_traction=-slopes)

    class Spreading(SimpleNamespace):
        def __call__(self, given):
            return 10.0 * given

    state, values = surface_state(spreading=Spreading(**vars(spread)))
    around = 10.0 * np.sum(slopes * v, axis=1)
    expected = rate + np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]) * around[:, None]
    np.testing.assert_allclose(state.along(v), expected)
    np.testing.assert_array_equal(state.spread_by[1], -slopes)
    turned = np.array([[0.8, -0.6]] * 3) * np.array([[1.0], [-2.0], [0.5]])
    share = np.array([1.0, 0.5, 0.25])
    state, values = surface_state(share, turned=turned)
    n = state.data.n
    # A rotation w of all turns the answer, and the traction by which it is taken back.
    w = n[:, 0] * turned[:, 1] - n[:, 1] * turned[:, 0]
    turn = lambda u: w[:, None] * np.column_stack([-u[:, 1], u[:, 0]])  # noqa: E731
    back = np.array(
        [a @ b for a, b in zip(values["by_traction"], turn(state.traction), strict=True)]
    )
    change = 2 * rate + turn(values["traction"]) - back
    np.testing.assert_allclose(state.change(v), share[:, None] * change)


@pytest.mark.parametrize("turns", [True, False])
def test_changes_of_answers_with_bodies_that_turn(turns):
    v = np.ones((3, 2))
    state, values = surface_state()
    crossed = lambda spin, t: spin[:, None] * t  # noqa: E731
    spin = np.array([1.0, 2.0, 3.0])
    asked = []
    s = SimpleNamespace(rigid_body=SimpleNamespace(crossed=crossed))
    eq = ContactEquations.__new__(ContactEquations)
    vars(eq).update(
        owned_sizes=[6],
        dim=2,
        rigid=SimpleNamespace(
            relative_rate=lambda s, at, q, step, dq: (
                asked.append((at.shape, step.shape, q, dq)) or v
            ),
            spin=lambda s, q, dq: spin if turns else None,
        ),
    )
    found = eq._change(s, state, np.zeros(8), "q", np.ones(8), "dq")
    assert asked == [((3, 2), (3, 2), "q", "dq")]
    expected = state.change(v)
    if turns:
        back = np.einsum("nij,nj->ni", values["by_traction"], spin[:, None] * state.traction)
        expected = expected + spin[:, None] * values["traction"] - back
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize("method", ["mixed", "nodal"])
@pytest.mark.parametrize("slides", [True, False])
def test_gaps_without_averages(method, slides):
    """Of a mixed method those at its nodes, from what is opposite; else as the law has them."""
    eq = ContactEquations.__new__(ContactEquations)
    u = np.arange(8.0)
    vars(eq).update(dim=2, rigid=SimpleNamespace(relative=lambda s, nodes, q: nodes + q))
    points = SimpleNamespace(
        trace_dofs=np.array([3, 0, 1]),
        number=2,
        gaps=np.array([10.0, 20.0]),
        data=SimpleNamespace(n=np.array([[0.0, -1.0], [0.6, 0.8]])),
    )
    s = SimpleNamespace(
        method=method, slides=slides, points=points, opposite=lambda nodes: 0.5 * nodes
    )
    eq.surfaces = [None, s]
    at = [None, SimpleNamespace(kinematics=SimpleNamespace(gap="gap"))]
    found = eq.gaps(s, SimpleNamespace(u=u, q=1.0, surfaces=at))
    if method == "nodal" or slides:
        assert found == "gap"
        return
    np.testing.assert_allclose(found, [10.0 + 4.0, 20.0 - 0.3 - 0.8])


# -- data that are asked for ---------------------------------------------------------------------


def test_points_of_several_surfaces_are_distinguished():
    """By the surface first; and scales are those that residuals have."""
    surfaces = [
        SimpleNamespace(points=SimpleNamespace(ids=np.array(i), positions=np.array(x)))
        for i, x in (([[5, 6], [7, 8]], [[0.0, 1.0], [2.0, 3.0]]), ([[9, 4]], [[4.0, 5.0]]))
    ]
    scales = SimpleNamespace(force=1.0, length=2.0)
    one = equations(equations=SimpleNamespace(surfaces=surfaces), _scales=scales)
    np.testing.assert_array_equal(one._ids, [[0, 5, 6], [0, 7, 8], [1, 9, 4]])
    np.testing.assert_array_equal(one.positions, [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]])
    assert one.scales == (1.0, 2.0)
    one.scales = (3.0, 4.0)
    assert (scales.force, scales.length) == (3.0, 4.0)


# -- what statuses hold ---------------------------------------------------------------------------


def test_directions_of_shears():
    """Unit vectors along the surface; none where there is no shear but round-off."""
    n = np.tile([0.0, 0.0, -1.0], (4, 1))
    t = np.array([[3.0, 4.0, 9.0], [0.0, 0.0, 9.0], [1e-14, 0.0, 9.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        _direction(t, n), [[0.6, 0.8, 0.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]], atol=1e-15
    )


def loose(dim, jumps, normals, codes, creeps=False, traction=None, bodies=0):
    """Which of motions with these jumps at points are not held, by their first letters."""
    number = len(jumps)
    of_body = number - bodies
    domain = box(ALONE, 1, "tri" if dim == 2 else "tet")
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    known = LooseMotions.__new__(LooseMotions)
    s = SimpleNamespace(
        dim=dim,
        points=SimpleNamespace(data=SimpleNamespace(n=np.array(normals))),
        law=SimpleNamespace(creeps=creeps),
    )
    motions = np.zeros((of_body, V.dofmap.index_map.size_local, dim))
    for i in range(of_body):
        motions[i, :, i] = 1.0
    vars(known).update(
        _V=V,
        _part=parts(V),
        _surfaces=[s],
        _axisymmetric=False,
        of_body=motions,
        _free=np.arange(bodies),
        _bodies=SimpleNamespace(size=bodies, names=lambda rest: f"{len(rest)} of bodies"),
        _jumps=[np.array(jumps, dtype=float)],
    )
    state = None
    if traction is not None:
        data = SimpleNamespace(n=np.array(normals))
        state = SimpleNamespace(surfaces=[SimpleNamespace(data=data, traction=np.array(traction))])
    return known.not_held([np.array(codes, dtype=np.int8)], state)


def test_motions_that_statuses_hold():
    """What is closed holds along its normal, what sticks or creeps every way."""
    x, y = [[[1.0, 0.0]], [[0.0, 1.0]]]
    floor = [[0.0, -1.0]]
    both = loose(2, [x, y], floor, [OPEN])
    one = loose(2, [x, y], floor, [PLUS])
    assert both
    assert one
    assert one != both
    assert loose(2, [x, y], floor, [STICK]) == ""
    assert loose(2, [x, y], floor, [PLUS], creeps=True) == ""
    assert loose(2, [x, y], floor, [OPEN], creeps=True) == both
    # Friction under a given bound holds an open point along the surface alone.
    assert loose(2, [x, y], floor, [STICK + WHERE_OPEN]) not in ("", one, both)
    assert loose(2, [x], floor, [PLUS], bodies=1) == "1 of bodies"
    assert loose(2, [x], floor, [STICK], bodies=1) == ""
    # What hardly takes part in a motion is not named: a body that follows, or one that leads.
    led, leads = (
        loose(2, [[[1.0, v]], [[w, 1.0]]], floor, [PLUS], bodies=1)
        for v, w in ((1e-9, 0.0), (0.0, 1e-9))
    )
    assert led
    assert "of bodies" not in led
    assert led == leads
    both = loose(2, [[[1.0, 0.5]], [[0.0, 1.0]]], floor, [PLUS], bodies=1)
    assert both.endswith(", 1 of bodies")
    alone = loose(2, [[[1e-9, 1.0]], [[1.0, 0.0]]], floor, [PLUS], bodies=1)
    assert alone == "1 of bodies"
    assert loose(2, np.zeros((0, 1, 2)), floor, [OPEN]) == ""
    # In space a slip holds across its direction.
    axes = [[e] for e in np.eye(3).tolist()]
    under = [[0.0, 0.0, -1.0]]
    slides = loose(3, axes, under, [PLUS])
    along_x = loose(3, axes, under, [PLUS], traction=[[2.0, 0.0, 5.0]])
    along_y = loose(3, axes, under, [PLUS], traction=[[0.0, -2.0, 5.0]])
    assert len({slides, along_x, along_y, ""}) == 4
    assert loose(3, axes, under, [PLUS], traction=[[0.0, 0.0, 5.0]]) == slides
    assert loose(3, axes, under, [STICK], traction=[[2.0, 0.0, 5.0]]) == ""
    assert loose(3, axes, under, [OPEN], traction=[[2.0, 0.0, 5.0]]) not in ("", along_x, slides)
    two = [[e, e] for e in np.eye(3).tolist()]
    cross = [[2.0, 0.0, 5.0], [0.0, 1.0, 5.0]]
    assert loose(3, two, under * 2, [PLUS, PLUS], traction=cross) == ""


@pytest.mark.parametrize(("entry", "plane"), [(0.0, True), (1e-14, True), (1.0, False)])
def test_bodies_that_resist_no_hoop(entry, plane):
    K = PETSc.Mat().createDense((4, 4), comm=ALONE)
    K.setUp()
    A = np.array([[1.0, 0, -1, 0], [0, 2.0, 0, -2], [-1, 0, 1, 0], [0, -2, 0, 2]])
    A[0, 0] += entry
    K.setValues(range(4), range(4), A)
    K.assemble()
    if plane:
        with pytest.raises(ValueError, match="the bulk is that of a plane body"):
            require_hoop_stiffness(K)
    else:
        require_hoop_stiffness(K)


# -- arguments ------------------------------------------------------------------------------------


def test_what_answers_instead_of_a_law(monkeypatch):
    """Bounds that are given, bonds that are held, and contact that yields."""
    monkeypatch.setattr(ContactEquations, "_contact", lambda self, x, u, q, statuses: self.states)

    @dataclass(frozen=True)
    class Data:
        fields: Any

    codes = np.array([OPEN, STICK, MINUS], dtype=np.int8)
    law = lambda jump, traction, data: SimpleNamespace(  # noqa: E731
        required="required", given=(jump, traction, data), _law=None, _values=None
    )
    weak = SimpleNamespace(name="beta")
    surfaces = [SimpleNamespace(law_at_points=law, law=SimpleNamespace(weakening=weak))]
    state = SimpleNamespace(
        kinematics="kinematics",
        traction="traction",
        jump="jump",
        data=Data({"beta": 1.0, "k": 2.0}),
        answers="own",
    )
    eq = SimpleNamespace(states=[state], surfaces=surfaces)
    yields = substitute.YieldingContact(eq, ["held"])
    (found,) = yields._contact("x", "u", "q", None)
    assert found.answers.given == ("jump", "held", state.data)
    assert (found.statuses, found.traction, found.kinematics) == (
        "required",
        "traction",
        "kinematics",
    )
    (found,) = yields._contact("x", "u", "q", ["mine"])
    assert found.statuses == "mine"
    vars(found)["by_jump"] = np.ones((2, 2))
    np.testing.assert_array_equal(found.by_traction, np.zeros((2, 2)))
    vars(found)["answers"] = SimpleNamespace(
        spreading=SimpleNamespace(by_jump="by jump", by_traction=np.ones(3))
    )
    by_jump, by_traction = found.spread_by
    assert by_jump == "by jump"
    np.testing.assert_array_equal(by_traction, np.zeros(3))
    monkeypatch.setattr(substitute, "HeldAnswers", lambda answers: ("held", answers.given))
    held = substitute.HeldBonds(eq, [0.25])
    answers = held._answers(0, state)
    assert answers == ("held", ("jump", "traction", Data({"beta": 0.25, "k": 2.0})))
    assert substitute.HeldBonds(eq, [None])._answers(0, state) == "own"
    given = substitute.GivenBounds.__new__(substitute.GivenBounds)
    (possible,) = given.as_possible([codes])
    assert possible.tolist() == [PLUS + WHERE_OPEN, STICK, MINUS]
    assert possible.dtype == np.int8
    assert ContactEquations.as_possible(None, "statuses") == "statuses"


# -- what Dirichlet data hold ---------------------------------------------------------------------


def removed(fixed, normals, friction=True, follows=None):
    s = SimpleNamespace(
        name="floor",
        comm=ALONE,
        dim=2,
        degrees=(1, 1),
        displaced=follows,
        points=SimpleNamespace(
            trace_dofs=np.arange(len(fixed)), vertex_normals=np.array(normals, dtype=float)
        ),
        law_at_points=SimpleNamespace(codes=(OPEN, STICK, PLUS) if friction else (OPEN, PLUS)),
    )
    return constraints._removed(s, np.array(fixed)).tolist()


# -- terms of sliding faces -----------------------------------------------------------------------


def test_blocks_are_added_to_a_matrix(monkeypatch):
    """Entries of nodes that several blocks have add up; negative places count for nothing."""
    A = PETSc.Mat().createDense((4, 6), comm=ALONE)
    A.setUp()
    rows = np.array([[[0, 1]], [[2, -1]]])
    columns = np.array([[[0, 1], [4, 5]], [[0, 1], [-1, 3]]])
    values = np.random.default_rng(0).normal(size=(2, 1, 2, 2, 2))
    for _ in range(2):
        _Block(rows, columns).add(values, A)
    A.assemble()
    expected = np.zeros((4, 6))
    for b in range(2):
        for i in range(2):
            for c in range(2):
                for j in range(2):
                    place = rows[b, 0, i], columns[b, c, j]
                    if min(place) >= 0:
                        expected[place] += 2 * values[b, 0, i, c, j]
    np.testing.assert_allclose(A.getDenseArray(), expected)
    sparse = PETSc.Mat().createAIJ((2, 3), comm=ALONE)
    sparse.setUp()
    for i, j in ((0, 1), (1, 0), (1, 2)):
        sparse.setValue(i, j, 7.0)
    sparse.assemble()
    monkeypatch.setattr(sliding, "Entries", lambda i, j: SimpleNamespace(rows=i, columns=j))
    found = _pattern(sparse)
    assert (found.rows.tolist(), found.columns.tolist()) == ([0, 1, 1], [1, 0, 2])


@pytest.mark.parametrize("mirrored", [True, False])
def test_values_of_the_blocks_of_sliding_faces(mirrored):
    """Derivatives by nodes of both faces, and by normals; images take their signs."""
    rng = np.random.default_rng(1)
    p, a, b, d = 3, 2, 2, 2
    c = 2 * a + b
    mirrors = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]) if mirrored else np.ones((p, d))
    at = _Pieces(
        np.array([0, 1, 0]),
        np.zeros((p, b), dtype=int),
        mirrors,
        rng.normal(size=(p, a + b, a)),
        rng.normal(size=(p, b, d, c, d)),
        rng.normal(size=(p, a, d, c, d)),
        rng.normal(size=(p, a, a)),
    )
    corners = np.array([[0, 1], [1, 2]])
    kept = rng.normal(size=(3, d))
    terms = SimpleNamespace(
        _slave=np.zeros((2, a, d)),
        _dim=d,
        _unit=5.0,
        _faces=SimpleNamespace(kept=kept, corners=corners),
    )
    of_traction, of_normal = rng.normal(size=(2, 4, 1, d, 1, d))
    by_unknowns, by_vectors = SlidingTerms._values(terms, at, of_traction, of_normal)
    coupling, on_master, of_law, held, means = by_unknowns
    master_turned, law_turned, normal = by_vectors
    np.testing.assert_allclose(held, 5.0 * of_traction)
    np.testing.assert_allclose(normal, of_normal)
    for i in range(p):
        S = np.concatenate([np.ones((a, d)), np.tile(mirrors[i], (b, 1))])
        for x in range(a + b):
            for y in range(a):
                expected = 5.0 * at.coupling[i, x, y] * np.diag(S[x])
                np.testing.assert_allclose(coupling[i, x, :, y], expected)
        for x in range(a):
            for y in range(a):
                expected = 5.0 * at.means[i, x, y] * np.diag(kept[corners[at.facet[i], x]])
                np.testing.assert_allclose(means[i, x, :, y], expected)
        for x in range(b):
            for k, z in enumerate([0, 1, 4, 5]):
                expected = np.diag(mirrors[i]) @ at.on_master[i, x, :, z] @ np.diag(S[k])
                np.testing.assert_allclose(on_master[i, x, :, k], expected)
            for k, z in enumerate([2, 3]):
                expected = np.diag(mirrors[i]) @ at.on_master[i, x, :, z]
                np.testing.assert_allclose(master_turned[i, x, :, k], expected)
        for x in range(a):
            for k, z in enumerate([0, 1, 4, 5]):
                expected = at.of_law[i, x, :, z] @ np.diag(S[k])
                np.testing.assert_allclose(of_law[i, x, :, k], expected)
            for k, z in enumerate([2, 3]):
                np.testing.assert_allclose(law_turned[i, x, :, k], at.of_law[i, x, :, z])


def test_problems_that_say_what_is_not_affine(caplog):
    """On one rank, in the log, of loads that are squares of the parameter."""
    domain = box(COMM, 1, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 2.0)
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    for power, linear in ((1, True), (2, False)):
        energy = LinearElastic(1.0, 1.0).energy(u) * ufl.dx - gamma**power * u[1] * ufl.dx
        surface = ContactSurface(
            u,
            facets(domain, 1, 0.0),
            obstacle=HalfSpace((0.0, 0.0), (0.0, 1.0)),
            law=Coulomb(0.3),
        )
        problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(np.zeros(2), top, V)])
        caplog.clear()
        with caplog.at_level(logging.INFO):
            system = ParametricContact(problem, gamma)
        said = [r for r in caplog.records if "the data are not affine in gamma" in r.message]
        assert len(said) == (not linear and COMM.rank == 0)
        assert system.is_linear is linear
        assert system.kinks_in_gamma == ""
