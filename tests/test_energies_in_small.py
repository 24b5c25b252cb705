"""Accounts of energy and steps of a history by their formulas, with what they need given."""

import math
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest
from blocks import block, box

import ufl
from dolfinx import fem

from dolfinx_contact.body.inertia import mass_matrix
from dolfinx_contact.body.moving import MovingBody
from dolfinx_contact.continuation.ending import Ending
from dolfinx_contact.evolution import nscd, through_times
from dolfinx_contact.evolution.energy import Energies, Forces, SurfaceForces, forces_at
from dolfinx_contact.evolution.motion import Method, MotionStepper
from dolfinx_contact.evolution.motion_energy import Motion, MotionEnergies, account, motion_at
from dolfinx_contact.evolution.through_times import ThroughTimes, _closes, _Ended, _rate
from dolfinx_contact.laws.status import OPEN, PLUS, STICK
from dolfinx_contact.solvers.history import ConvergenceError

ALONE = MPI.COMM_SELF
N, M, DIM = 4, 3, 2  # unknowns of the body, points, and their dimension


def numbers(seed):
    return np.random.default_rng(seed)


def forces(rng, energy=None, rest=(False, True)):
    """Random forces at a state, on a body, a rigid one and two surfaces."""
    surfaces = tuple(
        SurfaceForces(
            rng.normal(size=M),
            rng.normal(size=M),
            rng.normal(size=(M, DIM)),
            rng.normal(size=(M, DIM)),
            *rng.normal(size=(3, M)),
            at_rest=at_rest,
        )
        for at_rest in rest
    )
    eq = SimpleNamespace(comm=ALONE)
    body = rng.normal(size=(3, N))
    return Forces(
        eq, body[0], rng.normal(size=2), body[1], body[2], rng.normal(size=2), energy, surfaces
    )


@pytest.mark.parametrize("known", [True, False])
def test_the_account_of_a_step(known):
    """By the trapezoidal rule point by point; the energy of the body itself where it is known."""
    rng = numbers(1)
    a, b = (forces(rng, e if known else None) for e in (2.0, 5.0))
    before = Energies(1.0, 2.0, 3.0, 4.0)
    found = before.advanced(a, b, 0.5)
    external = sum((a.outer + b.outer) / 2 * (b.u - a.u)) - sum(
        (a.pushes + b.pushes) / 2 * (b.q - a.q)
    )
    stored = 3.0 if known else sum((a.inner + b.inner) / 2 * (b.u - a.u))
    damage = 0.0
    for p, q in zip(a.surfaces, b.surfaces, strict=True):
        for i in range(M):
            if not p.at_rest:
                moved = (p.n[i] + q.n[i]) / 2 @ (q.jump[i] - p.jump[i])
                external -= (p.force[i] + q.force[i]) / 2 * (q.un[i] - p.un[i] + moved)
            stored += q.bonds[i] - p.bonds[i]
            stored -= (p.springs[i] + q.springs[i]) / 2 * (q.un[i] - p.un[i])
            damage += q.spent[i]
    expected = 1 + external, 2 + stored, 3.5, 4 + damage
    row = found.row()
    assert list(row) == ["external", "stored", "dissipated", "damage", "residue"]
    np.testing.assert_allclose(list(row.values())[:4], expected, rtol=1e-12)
    residue = expected[0] - expected[1] - expected[2] - expected[3]
    assert row["residue"] == found.residue == pytest.approx(residue, rel=1e-11)
    one = Energies(1.0).advanced(a, forces(rng, 7.0 if not known else None), 0.0)
    assert one.stored != pytest.approx(3.0)


def test_accounts_begin_with_nothing():
    for account_of in (Energies, MotionEnergies):
        begun = account_of()
        assert set(vars(begun).values()) == {0.0}
        assert begun.residue == 0.0


def surface_state(rng, *, compliant, bonded, slides=False, outline=None, turning=False):
    """A surface and its state, with what it answers of bonds."""
    n, t, bond = rng.normal(size=(3, M, DIM))
    stored, spent, gap, areas = rng.uniform(0.5, 1.5, size=(4, M))
    whole = 2.0 * areas if slides else areas
    jump, path_normal = rng.normal(size=(2, M, DIM))
    values = {"traction": bond, "stored": stored, "spent": spent}
    found = SimpleNamespace(
        traction=t,
        data=SimpleNamespace(n=n),
        kinematics=SimpleNamespace(
            gap=gap, operator=SimpleNamespace(areas=areas), path=(jump, path_normal)
        ),
        answers=SimpleNamespace(bond=values.__getitem__),
    )
    surface = SimpleNamespace(
        law=SimpleNamespace(compliant=compliant),
        law_at_points=SimpleNamespace(compiled=SimpleNamespace(bonded=bonded)),
        slides=slides,
        dim=DIM,
        points=SimpleNamespace(areas=whole, data=SimpleNamespace(gap=gap + 1.0)),
        obstacle=SimpleNamespace(outline=outline),
    )
    return surface, found


@pytest.mark.parametrize(("energy", "affine"), [(2.0, True), (None, False)])
def test_forces_at_a_state(energy, affine):
    """Of loads, supports, pressure and bonds, by the rows of a body without contact."""
    rng = numbers(2)
    kinds = (
        {"compliant": False, "bonded": False},
        {"compliant": True, "bonded": False},
        {"compliant": True, "bonded": True, "outline": "facets"},
        {"compliant": False, "bonded": True, "slides": True},
    )
    pairs = [surface_state(rng, **kind) for kind in kinds]
    K, load = rng.normal(size=(N, N)), rng.normal(size=N)
    u, q, reactions, pushes = (
        rng.normal(size=N),
        rng.normal(size=2),
        rng.normal(size=N),
        rng.normal(size=2),
    )
    fixed = np.array([True, False, True, False])
    rows = lambda v: K @ v - load  # noqa: E731
    body = SimpleNamespace(
        affine_residual=rows if affine else lambda v: None,
        residual_at=rows,
        energy_at=lambda v: energy,
    )
    eq = SimpleNamespace(
        comm=ALONE,
        owned_sizes=[N, *[M * DIM] * 4, 2],
        bulk=body,
        fixed=fixed,
        surfaces=[s for s, _ in pairs],
        rigid=SimpleNamespace(conjugate=lambda q, p: 10 * q + p),
    )
    state = SimpleNamespace(
        u=u, q=q, reactions=reactions, pushes=pushes, surfaces=[f for _, f in pairs]
    )
    found = forces_at(eq, state)
    np.testing.assert_allclose(found.outer, load + np.where(fixed, reactions, 0.0))
    np.testing.assert_allclose(found.inner, K @ u, rtol=1e-12)
    np.testing.assert_allclose(found.pushes, 10 * q + pushes)
    np.testing.assert_array_equal(found.u, u)
    if energy is None:
        assert found.energy is None
    else:
        assert found.energy == pytest.approx(energy + load @ u)
    for (s, at), kind, f in zip(pairs, kinds, found.surfaces, strict=True):
        areas = at.kinematics.operator.areas
        normal = lambda v, n=at.data.n: np.einsum("ni,ni->n", v, n)  # noqa: E731
        np.testing.assert_allclose(f.force, -areas * normal(at.traction))
        springs = f.force if kind["compliant"] else np.zeros(M)
        if kind["compliant"] and kind["bonded"]:
            springs = springs + areas * normal(at.answers.bond("traction"))
        np.testing.assert_allclose(f.springs, springs)
        for values, name in ((f.bonds, "stored"), (f.spent, "spent")):
            np.testing.assert_allclose(values, areas * at.answers.bond(name) * kind["bonded"])
        share = 0.5 if s.slides else 1.0
        np.testing.assert_allclose(f.jump, share * at.kinematics.path[0])
        np.testing.assert_allclose(f.n, at.kinematics.path[1])
        assert f.at_rest is ("slides" in kind or "outline" in kind)
    whole = [np.ones(N), *[np.ones(M * DIM)] * 3, np.full(M * DIM, 0.5), np.ones(2)]
    np.testing.assert_allclose(found.covered, np.concatenate(whole))
    eq.surfaces, state.surfaces, eq.owned_sizes = (
        eq.surfaces[:1],
        state.surfaces[:1],
        [N, M * DIM, 2],
    )
    assert forces_at(eq, state).covered is None


def moving(rng, damped):
    """A body in motion with matrices, in a step of 0.5 with theta = 0.75."""
    mass, damping = (v @ v.T for v in rng.normal(size=(2, N, N)))
    body = MovingBody.__new__(MovingBody)
    vars(body).update(
        mass=mass,
        damping=damping if damped else None,
        step=SimpleNamespace(length=0.5, theta=0.75),
        body=SimpleNamespace(energy_at=lambda u: 3.0 if damped else None),
    )
    body.times = lambda A, v: A @ v[:N]
    body.load = lambda: np.arange(1.0, N + 1)
    body.forces = lambda u, v: 2 * u[:N] - v[:N]
    return body, mass, damping


@pytest.mark.parametrize("damped", [True, False])
def test_the_account_of_a_step_of_a_motion(damped):
    """Every term by its own formula, point by point."""
    rng = numbers(3)
    body, _mass, damping = moving(rng, damped)
    kinds = (
        {"compliant": False, "bonded": False},
        {"compliant": True, "bonded": True},
        {"compliant": False, "bonded": True},
    )
    pairs = [surface_state(rng, **kind) for kind in kinds]
    # Relative rates are A du - C dq at the points.
    A, C = rng.normal(size=(2, M * DIM, N))
    C = C[:, :2]
    for s, found in pairs:
        found.kinematics.operator.apply = lambda v: v.reshape(M, DIM)
        del s
    fixed = np.array([False, True, False, True])
    eq = SimpleNamespace(
        comm=ALONE,
        owned_sizes=[N, *[M * DIM] * 3, 2],
        bulk=body,
        fixed=fixed,
        surfaces=[s for s, _ in pairs],
        relative_rate=lambda s, u, q, du, dq: A @ du[:N] - C @ dq,
    )
    reactions = rng.normal(size=N)
    state = SimpleNamespace(u=None, q=None, reactions=reactions, surfaces=[f for _, f in pairs])

    def motion(inner):
        vectors = rng.normal(size=(4, N))
        points = [tuple(rng.normal(size=(3, M))) for _ in range(4)]
        return Motion(*vectors, inner, float(rng.uniform()), *points)

    a, b = (motion(e if damped else None) for e in (1.0, 4.0))
    turned = rng.normal(size=2)
    before = MotionEnergies(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
    found = account(before, eq, state, a, b, turned)
    h, theta = 0.5, 0.75
    v = (a.v + b.v) / 2
    du = b.u - a.u
    damping_lost = h * v @ damping @ (theta * b.v + (1 - theta) * a.v) if damped else 0.0
    external = ((a.load + b.load) / 2 + np.where(fixed, reactions, 0.0)) @ du
    rows = (a.rows + a.load + b.rows + b.load) / 2
    stored = 3.0 if damped else rows @ du - damping_lost
    contact = dissipated = damage = 0.0
    moved = (h * A @ v - C @ turned).reshape(M, DIM)
    dragged = (C @ turned).reshape(M, DIM)
    for k, ((s, at), kind) in enumerate(zip(pairs, kinds, strict=True)):
        W, n = at.kinematics.operator.areas, at.data.n
        for i in range(M):
            gap = b.gaps[k][i] - a.gaps[k][i]
            t = at.traction[i]
            external += W[i] * (t @ dragged[i] + t @ n[i] * gap)
            if kind["bonded"]:
                t = t - at.answers.bond("traction")[i]
                damage += W[i] * at.answers.bond("spent")[i]
                stored += b.bonds[k][i] - a.bonds[k][i]
            dissipated -= W[i] * (t @ moved[i] - (t @ n[i]) * (moved[i] @ n[i]))
            if s.law.compliant:
                stored -= (a.pressed[k][i] + b.pressed[k][i]) / 2 * (b.un[k][i] - a.un[k][i])
            else:
                contact -= W[i] * (t @ n[i]) * (moved[i] @ n[i] - gap)
    expected = MotionEnergies(
        1 + external,
        2 + stored,
        3 + dissipated,
        4 + damage,
        b.kinetic,
        6.0,
        7 + damping_lost,
        8 + contact,
    )
    for name, value in vars(expected).items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-10), name
    e = expected
    residue = (
        e.external
        - e.stored
        - e.dissipated
        - e.damage
        - (e.kinetic - e.at_start)
        - e.damping
        - e.contact
    )
    assert found.residue == pytest.approx(residue, rel=1e-9)


@pytest.mark.parametrize("damped", [True, False])
def test_the_state_of_a_motion(damped):
    rng = numbers(4)
    body, mass, _ = moving(rng, damped)
    pairs = [surface_state(rng, compliant=False, bonded=bonded) for bonded in (True, False)]
    eq = SimpleNamespace(comm=ALONE, owned_sizes=[N], bulk=body, surfaces=[s for s, _ in pairs])
    state = SimpleNamespace(surfaces=[f for _, f in pairs])
    u, v = rng.normal(size=(2, N + 2))
    found = motion_at(eq, state, u, v)
    load = np.arange(1.0, N + 1)
    assert found.kinetic == pytest.approx(v[:N] @ mass @ v[:N] / 2)
    assert found.inner == (pytest.approx(3.0 + load @ u[:N]) if damped else None)
    np.testing.assert_allclose(found.rows, 2 * u[:N] - v[:N])
    for k, (s, at) in enumerate(pairs):
        areas, n = at.kinematics.operator.areas, at.data.n
        t = at.traction - (at.answers.bond("traction") if k == 0 else 0.0)
        np.testing.assert_allclose(found.pressed[k], -areas * np.einsum("ni,ni->n", t, n))
        np.testing.assert_allclose(found.bonds[k], areas * at.answers.bond("stored") * (k == 0))
        np.testing.assert_allclose(found.gaps[k], s.points.data.gap)
        np.testing.assert_allclose(found.un[k], at.kinematics.gap)


# -- steps of a history ---------------------------------------------------------------------------


def step(before, after, **more):
    ends = (SimpleNamespace(time=t, **more) for t in (before, after))
    return SimpleNamespace(**dict(zip(("before", "after"), ends, strict=True)), result=None)


@pytest.mark.parametrize(
    ("error", "brief", "shortest", "part"),
    [(None, False, 0.01, 2), ("no", False, 0.01, 4), ("no", True, 0.01, 2), ("no", False, 0.25, 4)],
)
def test_steps_that_are_shortened(error, brief, shortest, part):
    """To a half where they are not wanted, or are known to be brief; else to a quarter."""
    run = SimpleNamespace(
        _accepted=SimpleNamespace(time=2.0),
        task=SimpleNamespace(shortest=shortest),
        _rejected=1,
        _stepper=SimpleNamespace(asks=False),
    )
    error = None if error is None else ConvergenceError(error)
    assert ThroughTimes._shorten(run, 3.0, error, brief=brief) is None
    assert (run._length, run._rejected) == (1.0 / part, 2)
    assert run._stepper.asks is True


def test_steps_that_cannot_be_shorter():
    """End the run, or jump over where nothing is found if they may; a jump is what is sudden."""
    error = ConvergenceError("why")
    taken = []

    def run(at_jump, beyond, sudden=None, times=math.inf):
        return SimpleNamespace(
            _accepted=SimpleNamespace(time=2.0),
            task=SimpleNamespace(shortest=0.3, at_jump=at_jump, sudden=times),
            _beyond=lambda goal: beyond,
            _sudden=lambda solved, times: taken.append(times) or sudden,
            _accept=lambda forked, jump: (forked.solved, jump),
            _rejected=0,
        )

    for at_jump, beyond in (("raise", "far"), ("jump", None)):
        with pytest.raises(_Ended, match=r"beyond the time 2, in a step of 1, .*: why") as ended:
            ThroughTimes._shorten(run(at_jump, beyond), 3.0, error)
        assert ended.value.ending is Ending.NOT_SOLVED
        assert ended.value.__cause__ is error
    assert ThroughTimes._shorten(run("jump", "far", "rates", 1.5), 3.0, error) == ("far", True)
    assert ThroughTimes._shorten(run("jump", "far", None), 3.0, error) == ("far", False)
    assert taken == [1.5, through_times._SUDDEN]


def test_what_a_history_knows_of_its_way():
    run = SimpleNamespace(
        task=SimpleNamespace(times=(1.0, 2.0, 5.0)),
        start=SimpleNamespace(accepted=SimpleNamespace(time=1.0)),
    )
    there = SimpleNamespace(time=2.5, start=2.25, number=7)
    assert ThroughTimes.part(run, there) == pytest.approx(0.375)
    assert ThroughTimes.where(run, there) == "time 2.5 of 5  step 7, of 0.25"
    ended = []
    run.end = lambda ending, words: ended.append(ending)
    for time, number in ((4.9, 0), (5.0, 1), (5.1, 2)):
        ThroughTimes._end_if_reached(run, step(2.0, time))
        assert len(ended) == number
    made = ThroughTimes._step(
        SimpleNamespace(_number=7, _rejected=2), step(2.0, 2.5, energies="e"), True, 3
    )
    assert (made.number, made.start, made.time, made.rejected, made.jump) == (8, 2.0, 2.5, 2, True)


def test_points_that_close_in_a_step():
    """On any surface; not those that open, or slide on."""
    for before, after, closes in (
        ([OPEN, STICK], [OPEN, PLUS], False),
        ([OPEN, STICK], [STICK, STICK], True),
        ([PLUS, STICK], [OPEN, STICK], False),
        ([STICK, OPEN], [OPEN, STICK], True),
    ):
        ends = (SimpleNamespace(shown=[np.array([OPEN]), np.array(c)]) for c in (before, after))
        solved = SimpleNamespace(**dict(zip(("before", "after"), ends, strict=True)))
        assert _closes(ALONE, solved) is closes


def test_the_rates_of_a_step(monkeypatch):
    """Of what changes, and of the farthest that a point goes, by the time of the step."""
    monkeypatch.setattr(through_times, "changes", lambda *_: np.array([1.0, 2.0]))
    monkeypatch.setattr(through_times, "largest_at_points", lambda *_: (np.array([3.0]), None))
    np.testing.assert_allclose(_rate(ALONE, step(2.0, 2.5)), [2.0, 4.0, 6.0])


def test_rates_that_are_sudden(monkeypatch):
    """Many times those of the step before, of points at least of the body; bonds that break."""
    rates = {}
    shares = {"now": np.zeros(1)}
    monkeypatch.setattr(through_times, "_rate", lambda comm, solved: np.array(rates["now"]))
    monkeypatch.setattr(through_times, "largest_at_points", lambda *_: (None, shares["now"]))
    problem = SimpleNamespace(comm=ALONE, surfaces=["one"])
    slip = through_times._SLIPS

    def sudden(before, now, times=10.0):
        rates["now"] = now
        run = SimpleNamespace(
            _rate=None if before is None else np.array(before),
            _stepper=SimpleNamespace(problem=problem),
        )
        return ThroughTimes._sudden(run, SimpleNamespace(before=None, after=None), times)

    # Rates: of the body, of rigid bodies, of the mean of the surface, of its bonds, of a point.
    before = [1.0, 2.0, 0.5, 0.1, 0.25]
    slow = [math.inf, 20.0, max(5.0, slip), 0.0]
    assert sudden(before, [99.0, 19.0, slow[2] - 0.1, 50.0, max(2.5, slip) - 0.1]) is None
    for now, known in (
        ([0.0, 21.0, 0.0, 0.0, 0.0], slow),
        ([0.0, 0.0, slow[2] + 0.1, 0.0, 0.0], slow),
        ([0.0, 0.0, 0.0, 0.0, max(2.5, slip) + 0.1], [math.inf, 0.0, 0.0, 0.0]),
    ):
        np.testing.assert_allclose(sudden(before, now), known)
    shares["now"] = np.array([through_times._BREAKS + 0.01])
    np.testing.assert_allclose(sudden(before, [0.0] * 5), [math.inf, 0.0, 0.0, 0.0])
    shares["now"] = np.array([through_times._BREAKS - 0.01])
    assert sudden(before, [0.0] * 5) is None
    assert sudden(None, [5.0, 0.0, 0.0, 0.0, 0.0]) is None
    np.testing.assert_allclose(sudden(None, [5.0, 0.1, 0.0, 0.0, 0.0]), [math.inf, 0.0, 0.0, 0.0])


def test_solutions_further_off():
    """Taken at times further and further ahead, then come back to where they are wanted."""
    calls = []

    def stepper(solved):
        def take(start, time, likely=None, guess=None):
            calls.append((round(time, 9), guess is not None))
            if not solved(time, guess):
                raise ConvergenceError("no")
            return SimpleNamespace(after=SimpleNamespace(time=time, statuses="codes"))

        return SimpleNamespace(take=take)

    further = through_times._FURTHER

    def beyond(solved, last=100.0):
        calls.clear()
        run = SimpleNamespace(
            _stepper=stepper(solved),
            _accepted=SimpleNamespace(time=1.0),
            task=SimpleNamespace(times=(0.0, last)),
        )
        return ThroughTimes._beyond(run, 1.5)

    found = beyond(lambda time, guess: time > 1.6 or guess is not None)
    assert found.after.time == 1.5
    first = 1.0 + 0.5 * further
    assert calls == [(first, False), (1.5, True)]
    # Not near it at once, but from a solution between.
    found = beyond(
        lambda time, guess: (
            (guess is None and time > 1.0 + 0.5 * further**2 - 1e-9)
            or (guess is not None and (time > 1.5 or guess.time < 1.0 + 0.6 * further))
        )
    )
    assert found.after.time == 1.5
    assert [c[0] for c in calls[-3:]] == [1.5, first, 1.5] or calls[-1] == (1.5, True)
    assert beyond(lambda time, guess: False, last=3.0) is None
    assert calls[-1] == (3.0, False)
    assert all(time < 3.0 for time, _ in calls[:-1])
    assert beyond(lambda time, guess: guess is None and time > 1.6, last=3.0) is None


# -- steps of a motion ----------------------------------------------------------------------------


def test_methods_that_work():
    """Their settings, and what does not go together."""
    found = nscd._method("theta", 0.5, "velocity", "lumped", 0.25)
    assert found == Method("theta", 0.5, "velocity", 0.25, False)
    assert nscd._method("theta", 1, "position", "redistributed", 0).massless
    for wrong, words in (
        (("euler", 0.5, "position", "lumped", 0.0), "scheme is 'euler'"),
        (("theta", 0.5, "speed", "lumped", 0.0), "level is 'speed'"),
        (("theta", 0.5, "position", "none", 0.0), "mass is 'none'"),
        (("theta", 0.49, "position", "lumped", 0.0), "theta must be between 0.5 and 1"),
        (("theta", 1.01, "position", "lumped", 0.0), "theta must be between 0.5 and 1"),
        (("theta", 0.5, "velocity", "lumped", -0.1), "restitution must be between 0 and 1"),
        (("theta", 0.5, "velocity", "lumped", 1.1), "restitution must be between 0 and 1"),
        (("theta", 0.5, "position", "lumped", 0.1), "restitution is about velocities"),
        (("theta", 0.5, "velocity", "redistributed", 0.0), "a node needs mass"),
    ):
        with pytest.raises(ValueError, match=words):
            nscd._method(*wrong)
    assert nscd._method("theta", 1.0, "velocity", "lumped", 1.0).restitution == 1.0


def test_what_a_motion_cannot_have():
    """A rigid body that is free, and laws of positions at the level of velocities."""

    def problem(fixed=(True,), **kinds):
        law = SimpleNamespace(compliant=kinds.get("compliant", False))
        compiled = SimpleNamespace(bonded=kinds.get("bonded", False))
        s = SimpleNamespace(
            name="floor",
            law=law,
            law_at_points=SimpleNamespace(compiled=compiled),
            displaced=kinds.get("displaced"),
            slides=kinds.get("slides", False),
        )
        rigid = SimpleNamespace(fixed=np.array(fixed))
        return SimpleNamespace(equations=SimpleNamespace(rigid=rigid), surfaces=[s])

    for level in ("position", "velocity"):
        nscd._check_problem(problem(), level)
        with pytest.raises(ValueError, match="has no mass here"):
            nscd._check_problem(problem((True, False)), level)
    for kinds, words in (
        ({"compliant": True}, "a compliant law"),
        ({"bonded": True}, "adhesion"),
        ({"displaced": "curved"}, "on a curved obstacle"),
        ({"slides": True}, "between bodies"),
    ):
        nscd._check_problem(problem(**kinds), "position")
        with pytest.raises(ValueError, match=f"floor: .*{words}"):
            nscd._check_problem(problem(**kinds), "velocity")


def test_when_a_body_counts_as_at_rest():
    """Below a share of its energy, between none and all, within a positive time."""
    motion = SimpleNamespace(_time=1.0, _dt=0.1, _accepted=None, _record=None)

    def settle(max_time=1.0, rest=1e-6):
        given = SimpleNamespace(
            self=motion, max_time=max_time, rest=rest, observer=None, progress=None
        )
        nscd._check_settle(given)
        return given.max_time

    assert settle(2) == 2.0
    settle(rest=0.999)
    for wrong in (0, 1, -0.1, 1.1, "x", None):
        with pytest.raises(ValueError, match="rest must be between 0 and 1"):
            settle(rest=wrong)
    for wrong in (0, -1.0, np.inf, "x"):
        with pytest.raises(ValueError, match="max_time must be a positive time"):
            settle(max_time=wrong)


def test_factors_of_damping():
    domain = box(MPI.COMM_WORLD, 1, "tri")
    a, vector = fem.Constant(domain, 0.5), fem.Constant(domain, np.ones(2))
    assert nscd._rayleigh((a, 2)) == (0.5, 2.0)
    assert nscd._rayleigh((0, 0.0)) == (0.0, 0.0)
    assert nscd._described((a, 2), None) == "(0.5, 2)"
    assert nscd._described(None, None) == "None"
    for wrong in (3.0, (1.0,), (1.0, "x"), (vector, 1.0), (1.0, 2.0, 3.0)):
        with pytest.raises(ValueError, match="a form or a pair"):
            nscd._rayleigh(wrong)
    for wrong in ((-1.0, 0.0), (0.0, -1.0), (np.inf, 0.0), (0.0, np.nan)):
        with pytest.raises(ValueError, match="must not be negative"):
            nscd._rayleigh(wrong)


def test_rayleighs_damping():
    """A times the mass and b times the stiffness; a wind is what acts at no velocity."""
    problem = block(n=1)
    velocity = fem.Function(problem.V)
    K = problem.equations.bulk.stiffness(problem.u.x.array.copy()).copy()
    n = K.getLocalSize()[0]
    M = mass_matrix(problem.V, 3.0, "consistent", np.zeros(n, dtype=bool))
    C, wind = nscd._damping(problem, velocity, 3.0, (0.5, 2.0))
    assert wind is None
    off = C.copy()
    off.axpy(-0.5, M)
    off.axpy(-2.0, K)
    assert off.norm() < 1e-13 * C.norm()
    assert nscd._damping(problem, velocity, 3.0, None) == (None, None)
    v = ufl.TestFunction(problem.V)
    drag = ufl.inner(velocity - ufl.as_vector([1.0, 0.0]), v) * ufl.dx
    C, wind = nscd._damping(problem, velocity, 3.0, drag)
    M = mass_matrix(problem.V, 1.0, "consistent", np.zeros(n, dtype=bool))
    C.axpy(-1.0, M)
    assert C.norm() < 1e-13 * M.norm()
    force = fem.assemble_vector(fem.form(wind))
    assert MPI.COMM_WORLD.allreduce(force.array.sum()) == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("scheme", "theta", "before", "off", "times"),
    [
        ("theta", 0.5, 1.0, -1.0, 3),
        ("theta", 0.5, 1.0, -1.05, 3),
        ("theta", 0.5, 1.0, -1.2, 0),
        ("theta", 0.5, 1.0, 1.0, 0),
        ("theta", 0.6, 1.0, -1.0, 0),
        ("theta-euler", 0.5, 1.0, -1.0, 0),
        ("modified-theta", 0.505, 1.0, -1.0, 3),
        ("theta", 0.5, 0.005, -0.005, 0),
        ("theta", 0.5, None, -1.0, 0),
    ],
)
def test_velocities_that_turn_from_step_to_step(scheme, theta, before, off, times, caplog):
    """About those of the data: what lasts has the other sign, and matters; it is said once."""
    held = np.array([True, False, True])
    turns = None if before is None else (np.array([before, 0.0, 0.0]), 2)
    state = SimpleNamespace(motion=SimpleNamespace(u=np.zeros(3)), turns=turns)
    stepper = SimpleNamespace(
        _held=lambda: held,
        problem=SimpleNamespace(equations=SimpleNamespace(comm=ALONE)),
        _warned=False,
        _worst=lambda *_: "words",
    )
    mean = 2.0 if before != 0.005 else 1.0
    b = SimpleNamespace(u=0.5 * mean * np.ones(3), v=mean + np.array([off, 7.0, 0.0]))
    taken = SimpleNamespace(length=0.5, scheme=scheme, theta=theta)
    found, number = MotionStepper._turns(stepper, state, b, taken)
    np.testing.assert_allclose(found, [off, 0.0, 0.0])
    assert number == times
    said = [r.message for r in caplog.records if "change from step to step" in r.message]
    assert len(said) == (times == 3)
    assert stepper._warned is (times == 3)
    MotionStepper._turns(stepper, state, b, taken)
    assert len([r for r in caplog.records if "change from step" in r.message]) == len(said)


def test_starts_that_are_refused():
    """Within an obstacle, off what is prescribed, or with a velocity where nothing moves."""
    surface = SimpleNamespace(name="floor", law=SimpleNamespace(compliant=False))
    eq = SimpleNamespace(
        comm=ALONE,
        surfaces=[surface],
        body_size=2.0,
        prescribed=SimpleNamespace(values=lambda: np.array([[0.5, 0.0], [0.0, 0.0]])),
    )
    told = []

    def worst(off, tolerance, found, wanted):
        told.append((off.copy(), tolerance))
        return "there" if off.max() > tolerance else ""

    u = np.array([0.5, 0.0, 3.0, 4.0])
    stepper = SimpleNamespace(
        problem=SimpleNamespace(equations=eq, u=SimpleNamespace(x=SimpleNamespace(array=u))),
        _held=lambda: np.array([True, True, False, False]),
        _worst=worst,
    )
    for gap, good in ((-1.9e-9, True), (-2.1e-9, False)):
        state = SimpleNamespace(
            surfaces=[SimpleNamespace(kinematics=SimpleNamespace(gap=np.array([1.0, gap])))]
        )
        surface.law.compliant = False
        if good:
            MotionStepper._require_no_penetration(stepper, state)
        else:
            with pytest.raises(ValueError, match=r"floor: at the start .* by up to 2.1e-09"):
                MotionStepper._require_no_penetration(stepper, state)
        surface.law.compliant = True
        MotionStepper._require_no_penetration(stepper, state)
    MotionStepper._require_held(stepper)
    np.testing.assert_allclose(told[-1][0], 0.0)
    assert told[-1][1] == pytest.approx(4e-6 + 2e-9)
    u[1] = 1e-3
    with pytest.raises(ValueError, match="is not what Dirichlet data prescribe: there"):
        MotionStepper._require_held(stepper)
    np.testing.assert_allclose(told[-1][0], [0.0, 1e-3, 0.0, 0.0])
    a = SimpleNamespace(u=np.array([0.4, 1.9e-9, 0.0, 0.0]), v=np.array([1.0, 1e-7, 9.0, -10.0]))
    MotionStepper._require_speed(stepper, a)
    np.testing.assert_allclose(told[-1][0], [0.0, 1e-7, 0.0, 0.0])
    assert told[-1][1] == pytest.approx(1e-5)
    a.v[1] = 1e-3
    with pytest.raises(ValueError, match="the velocity at the start is against Dirichlet data"):
        MotionStepper._require_speed(stepper, a)
    a.u[1] = 2.1e-9  # it moves there
    MotionStepper._require_speed(stepper, a)
