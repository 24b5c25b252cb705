"""Properties of all solutions of random contact problems, and how they are drawn and checked."""

import tempfile
from contextlib import suppress
from dataclasses import replace
from functools import wraps
from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st

from dolfinx_contact import ParametricContact
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.records import EvolutionRecord
from support.random_bodies import STIFFNESS, Case, Model, Place

COMM = MPI.COMM_WORLD


#: Of forces and of lengths, over the largest.
TOLERANCE = 1e-7


#: Kinds of problems of a short run, each of which is compiled once.
FEW = [
    ("tri", "Coulomb", "plane"),
    ("quad", "Tresca", "sphere"),
    ("quad", "own", "wave"),
    ("tet", "Coulomb", "sphere"),
    ("hex", "compliance", "plane"),
]


LAWS = ("frictionless", "Coulomb", "Tresca", "compliance", "own")


OBSTACLES = ("plane", "wave", "sphere")


CELLS = ("tri", "quad", "tet", "hex")


def hundredths(low, high):
    return st.integers(low, high).map(lambda k: k / 100)


@st.composite
def cases(draw, kinds, most=(4, 3, 2), **given):
    """Cases of kinds (cell, law, obstacle)."""
    cell, law, obstacle = draw(st.sampled_from(kinds))
    dim = 2 if cell in ("tri", "quad") else 3
    number = st.tuples(st.integers(1, most[0] if dim == 2 else most[1]))
    if dim == 3:
        number = st.tuples(st.integers(1, most[1]), st.integers(1, most[2]))
    along = st.tuples(*[hundredths(-5, 5)] * (dim - 1))
    drawn = dict(
        cells=(*draw(number), draw(st.integers(1, 2))),
        slant=draw(hundredths(-30, 30)),
        bend=draw(hundredths(-15, 15)),
        poisson=draw(st.sampled_from([0.0, 0.3, 0.4])),
        friction=draw(st.tuples(hundredths(5, 30), hundredths(5, 30))),
        tilt=draw(st.tuples(*[hundredths(-20, 20)] * (dim - 1))),
        lift=draw(hundredths(0, 3)),
        push=draw(hundredths(-1, 6)),
        drag=draw(along),
        load=draw(st.tuples(*[hundredths(-2, 2)] * dim)),
    )
    return Case(cell=cell, law=law, obstacle=obstacle, **(drawn | given))


@st.composite
def places(draw, case):
    """Ways to put a case."""
    angles = st.tuples(*[st.integers(-180, 180)] * (1 if case.dim == 2 else 3))
    return Place(
        turn=draw(angles),
        mirrored=draw(st.booleans()),
        moved=draw(st.integers(-3, 3)),
        length=10.0 ** draw(st.integers(-6, 6)),
        stress=10.0 ** draw(st.integers(-6, 9)),
        order=draw(st.integers(0, 5)),
        parts=draw(st.integers(1, 2)),
    )


def kinds(long, laws=LAWS, obstacles=OBSTACLES):
    """All kinds of problems of some laws and obstacles, or few of them."""
    every = [(c, law, o) for c in CELLS for law in laws for o in obstacles]
    return every if long else [k for k in FEW if k in every]


def same(a, b, tolerance=TOLERANCE):
    """Whether two solutions are the same, point by point."""
    np.testing.assert_allclose(a.x, b.x, atol=1e-8)
    np.testing.assert_allclose(a.area, b.area, rtol=1e-9)
    np.testing.assert_allclose(a.n, b.n, atol=1e-9)
    force = max(np.abs(a.force).max(), np.abs(b.force).max(), 1e-4)
    np.testing.assert_allclose(a.force, b.force, rtol=0, atol=tolerance * force)
    np.testing.assert_allclose(a.un, b.un, rtol=0, atol=0.1 * tolerance)
    np.testing.assert_allclose(a.ut, b.ut, rtol=0, atol=0.1 * tolerance)


def the_only(model, found):
    """Return whether a solution is unique: by a proof, or by assumption for laws without proofs.

    The laws without proofs have little friction; no case with several solutions was found.
    """
    return model.case.law in ("compliance", "own") or model.problem.uniqueness().verdict == "proved"


def stays_under_places(case, place):
    """A problem that is put otherwise has the solution that is put so."""
    plain = Model(case, Place(parts=1))
    other = Model(case, place)
    a = plain.solve()
    b = other.solve()
    if the_only(plain, a):
        same(a, b)
    is_a_solution(other, b)


def is_a_solution(model, found):
    """Assert equilibrium, gap, cone and slip direction from displacements, without the package.

    On several ranks gaps and slips come from the package, and only equilibrium is independent.
    """
    case = model.case
    if model.comm.size == 1:
        _fits_the_body(model, found)
    force = max(np.abs(found.force).max(), 1e-4)
    little = 1e-8 * force
    if case.law == "compliance":
        pressing = STIFFNESS * found.area * np.maximum(-found.un, 0.0)
        np.testing.assert_allclose(found.rn, pressing, atol=little)
    else:
        assert found.rn.min() >= -little
        assert found.un.min() >= -1e-9
        assert np.minimum(found.rn, force * found.un).max() <= little
    most = found.area * case.bound(found.x, found.rn / found.area)
    shear = np.linalg.norm(found.rt, axis=1)
    assert (shear - most).max() <= little
    np.testing.assert_allclose(found.area * found.pressure, found.rn, atol=little)
    np.testing.assert_allclose(found.area[:, None] * found.shear, found.rt, atol=little)
    np.testing.assert_allclose(found.bound, most, atol=little)
    # The most dissipation: the whole bound against the slip.
    slip = np.linalg.norm(found.ut, axis=1)
    work = -np.sum(found.rt * found.ut, axis=1)
    np.testing.assert_allclose(work, most * slip, atol=1e-8 * max(force * slip.max(), 1e-6))


def _fits_the_body(model, found):
    """Assert gaps of the moved nodes and equilibrium of contact forces with the body."""
    case = model.case
    nodes = np.argmin(((found.x[:, None] - case.points[None]) ** 2).sum(axis=-1), axis=1)
    moved = model.displacement()
    u = moved[nodes]
    gap, n = case.gap(case.points[nodes])
    across = np.sum(u * n, axis=1)
    np.testing.assert_allclose(found.n, n, atol=1e-9)
    np.testing.assert_allclose(found.un, gap - across, atol=1e-9)
    np.testing.assert_allclose(found.ut, u - across[:, None] * n, atol=1e-9)
    np.testing.assert_allclose(found.area, case.areas(nodes, model.place.parts), rtol=1e-9)
    rows = model.forces()
    contact = np.zeros_like(rows)
    contact[nodes] = found.force
    held = np.isclose(case.grid[:, -1], 1.0)
    size = np.abs(contact).max() + np.abs(rows).max() + 1e-6
    np.testing.assert_allclose(rows[~held], contact[~held], rtol=0, atol=1e-9 * size)
    prescribed = np.tile([*case.drag, -case.push], (held.sum(), 1))
    np.testing.assert_allclose(moved[held], prescribed, atol=1e-14)


def balances(case):
    """Resultants and energies agree with forces and displacements at the nodes."""
    model = Model(case, Place(parts=0))
    found = model.solve()
    is_a_solution(model, found)
    rows = model.forces()
    size = np.abs(found.force).max() + np.abs(rows).max() + 1e-6
    # The rows of the body are contact forces where it may touch, and reactions above.
    held = np.isclose(case.grid[:, -1], 1.0)
    result = found.result
    np.testing.assert_allclose(result.support, rows[held].sum(axis=0), atol=1e-9 * size)
    np.testing.assert_allclose(
        sum(result.resultants.values()), rows[~held].sum(axis=0), atol=1e-9 * size
    )
    loads = model.volume() * np.array(case.load)
    np.testing.assert_allclose(result.external, loads, atol=1e-9 * size)
    # The energy of the body is half the work of all forces on it.
    u = model.displacement()
    work = np.sum(rows * u)
    potential = model.potential()
    assert result.energies["bulk"] == pytest.approx((work - potential) / 2, abs=1e-9 * size)
    friction = -np.sum(found.rt * found.ut)
    assert result.energies["friction"] == pytest.approx(friction, abs=1e-12 * size)


def solves_again(case, other):
    """A problem whose data change has the solution of a new problem, and then the first again."""
    model = Model(case)
    first = model.solve()
    model.set(other)
    second = model.solve()
    new = Model(other)
    expected = new.solve()
    if the_only(new, expected):
        same(second, expected)
    is_a_solution(model, second)
    model.set(case)
    again = model.solve()
    if the_only(model, first):
        same(again, first)
    is_a_solution(model, again)


def stays_on_ranks(case):
    """A solve on all ranks agrees with a solve on one rank."""
    alone = Model(case).solve()
    together = Model(case, comm=COMM).solve()
    same(together, alone)
    assert together.result.imbalance < 1e-9


def is_among_all(case):
    """The solution of a solve is among all solutions, and each satisfies the law."""
    model = Model(case)
    solved = model.solve()
    system = ParametricContact(model.problem)
    solutions = find_solutions(system, [system.create_vector()], 0.0)
    near = []
    for point in solutions.points(system):
        found = model.found(system.result_at(point))
        is_a_solution(model, found)
        near.append(np.abs(found.ut - solved.ut).max() + np.abs(found.un - solved.un).max())
    assert min(near) < 1e-8
    if the_only(model, solved):
        assert len(near) == 1
    system.destroy()


def growing(case):
    """A model, and its evolution under loads that grow from nothing."""
    model = Model(case)
    return model, QuasiStatic(model.problem, lambda t: model.set(case, t))


def history(case, times, **options):
    """A run in which the loads grow from nothing, and its model."""
    model, evolution = growing(case)
    return model, evolution.run(times, progress=False, **options)


def is_a_history_of_one_step(case):
    """One step from rest is a solve."""
    static = Model(case)
    solved = static.solve()
    model, run = history(case, [0.0, 1.0], shortest=1.0)
    if the_only(static, solved):
        same(model.found(run.steps[-1].result), solved)
    assert len(run.steps) == 1


def accounts_for_energies(case):
    """Dissipation and energy residue of a history agree with forces and slips of its steps.

    The body is linear, so that the trapezoidal rule of its work is exact. The residue of a step is
    the contact work by this rule minus friction at the end of the step.
    """
    seen = []
    _, run = history(
        case, [0.0, 0.5, 1.0], observer=lambda step: seen.append(step.result.tables["part 0"])
    )
    start = replace(seen[0], force=0.0 * seen[0].force, ut=0.0 * seen[0].ut)
    start = replace(start, un=case.gap(start.x)[0])
    dissipated = left = 0.0
    for before, after in pairwise([start, *seen]):
        slip = after.ut - before.ut
        opened = (after.un - before.un)[:, None] * after.n
        friction = -np.sum(after.rt * slip)
        dissipated += friction
        mean = (before.force + after.force) / 2
        springs = np.sum(mean * opened) if case.law == "compliance" else 0.0
        left += np.sum(mean * (opened - slip)) - springs - friction
    found = run.energies
    little = 1e-9 * (abs(found.external) + abs(found.stored) + 1e-6)
    assert len(run.steps) == len(seen)
    assert found.dissipated == pytest.approx(dissipated, abs=little)
    assert found.residue == pytest.approx(left, abs=little)
    assert dissipated >= -little


def resumes(case):
    """A run that is interrupted, and resumed from its record, is the run that is not."""
    times = [0.0, 0.4, 0.7, 1.0]
    whole, run = history(case, times)
    expected = whole.found(run.steps[-1].result)
    with tempfile.TemporaryDirectory() as folder:

        def interrupt(step):
            if step.number == 1:
                raise InterruptedError

        _, evolution = growing(case)
        with suppress(InterruptedError), EvolutionRecord(folder, evolution) as record:
            evolution.run(times, observer=interrupt, record=record, progress=False)
        later, evolution = growing(case)
        with EvolutionRecord(folder, evolution, resume=True) as record:
            rest = record.go_on()
        same(later.found(rest.steps[-1].result), expected, 1e-9)
        assert rest.energies.row() == pytest.approx(run.energies.row(), abs=1e-12)


def falls_under_refinement(case):
    """The minimum of the energy falls under refinement, because finer spaces contain coarser ones.

    Solutions are minima without friction and with a given bound.
    """
    energies = []
    for factor in (1, 2, 4):
        fine = replace(case, cells=tuple(factor * n for n in case.cells))
        found = Model(fine, Place(parts=0)).solve().result.energies
        energies.append(found["bulk"] + found["friction"])
    first, second = -np.diff(energies)
    # A body that slides with its top has no energy but what round-off leaves of its cells'.
    moved = max(np.abs([*case.drag, case.push]))
    little = 1e-10 * max(np.abs(energies)) + 1e-13 * moved**2
    assert first >= -little
    assert second >= -little


EXAMPLES = 200  # of every property with --long


def script(check, data):
    """A script that checks a property of data by itself."""
    lines = [
        "# docker/run env PYTHONPATH=tests python3 THIS_FILE",
        "from support.random_bodies import Case, Place",
        f"from support.properties import {check.__name__}",
        "",
        f"{check.__name__}({', '.join(map(repr, data))})",
    ]
    return "\n".join(lines)


def holds(check, drawn, *, examples, random=False):
    """Check a property of drawn data; a failure is reduced and printed as a script. Collective.

    Args:
        check: function raising an exception where the property does not hold.
        drawn: strategy of its arguments.
        examples: number of examples.
        random: whether examples differ in every run; otherwise they are equal on all ranks.
    """

    @settings(
        max_examples=examples,
        derandomize=not random,
        database=None,
        deadline=None,
        print_blob=random,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    @given(drawn)
    def property_(data):
        note(script(check, data))
        check(*data)

    property_()


def placed(long):
    return cases(kinds(long)).flatmap(lambda c: st.tuples(st.just(c), places(c)))


def alone(long, laws=LAWS, obstacles=OBSTACLES, **given):
    return st.tuples(cases(kinds(long, laws, obstacles), **given))


def changed(long):
    """A case, and another one of the same body, law and kind of obstacle."""

    def others(case):
        body = ("cells", "slant", "bend")
        kind = [(case.cell, case.law, case.obstacle)]
        return cases(kind, **{name: getattr(case, name) for name in body})

    return cases(kinds(long)).flatmap(lambda c: st.tuples(st.just(c), others(c)))


def all_found(long):
    laws = ("frictionless", "Coulomb", "Tresca")
    return alone(long, laws, most=(3, 1, 1), friction=(0.3, 0.1))


def refined(long):
    """Without friction, or with the same bound everywhere, and cells that are affine."""
    every = [(c, law, "plane") for c in CELLS for law in ("frictionless", "Tresca")]
    some = every if long else [("tri", "Tresca", "plane"), ("hex", "Tresca", "plane")]
    return st.tuples(cases(some, most=(3, 2, 1), bend=0.0, friction=(0.2, 0.2)))


#: Checks, what they are of, and how many are tried in a short run.
PROPERTIES = {
    stays_under_places: (placed, 12),
    balances: (alone, 10),
    solves_again: (changed, 10),
    is_among_all: (all_found, 8),
    is_a_history_of_one_step: (alone, 6),
    accounts_for_energies: (alone, 6),
    resumes: (alone, 4),
    falls_under_refinement: (refined, 6),
}


def examine(check, request):
    """Check a property of few cases, or with --long of many."""
    drawn, few = PROPERTIES[check]
    long = request.config.getoption("--long")
    holds(check, drawn(long), examples=EXAMPLES if long else few, random=long)


def on_every_rank(check):
    """The check, which fails on all ranks if it fails on one, so that all shrink alike."""

    @wraps(check)
    def checked(*data):
        why = None
        try:
            check(*data)
        except AssertionError as error:
            why = str(error)
        failed = [w for w in COMM.allgather(why) if w is not None]
        assert not failed, failed[0]

    return checked
