"""Curves of folds and events in two parameters, against closed forms, branches and enumeration."""

import itertools

from mpi4py import MPI

import cases.chart
import cases.followed_mesh
import numpy as np
import pytest
from cases._triangle import element
from support.checks import solved_start
from support.enumeration import events_by_enumeration as enumerated
from support.enumeration import holds, random_family

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ParametricContact, materials
from dolfinx_contact.analysis import count_solutions, critical_friction, event_curves
from dolfinx_contact.analysis.curve_search import follow_events
from dolfinx_contact.analysis.two_parameters import contact_family
from dolfinx_contact.continuation import follow
from dolfinx_contact.records import journal_of

COMM = MPI.COMM_WORLD


def branch_of(system, gamma_range=(0.0, 1.0)):
    x = solved_start(system, gamma_range[0])
    return follow(system, x, gamma_range[0], gamma_range=gamma_range)


def friction_of(system):
    (surface,) = system.problem.surfaces
    return surface.law.friction


@pytest.mark.ranks(2)
@pytest.mark.parametrize("unit", [1.0, 1e11])
@pytest.mark.verifies(
    "curves of folds",
    "friction as parameter",
    reference="closed form: folds of Hild's element",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_stick_and_separation_of_one_element_end_on_their_curves(unit):
    """Stick ends at gamma = F, separation at gamma = kt / k, and they cross at F = kt / k."""
    system = element((unit, unit), 3.0, 1.0, (-2.0 * unit, 0.0), (0.0, -2.0 * unit))
    branch = branch_of(system, (0.0, 10.0))
    F = friction_of(system)
    curves = event_curves(system, F, [(3.0, branch)], mu_range=(1.0, 4.0), gamma_range=(0.1, 10.0))
    assert float(F.value) == 3.0
    opened, stuck = curves.folds
    assert opened.statuses_at(3.0) == ("o", "-")
    assert stuck.statuses_at(3.0) == ("k", "-")
    for mu in (2.1, 2.7, 3.9):
        assert opened.at(mu) == pytest.approx(2.0, abs=1e-10)
        assert stuck.at(mu) == pytest.approx(mu, abs=1e-10)
        np.testing.assert_allclose(curves.folds_at(mu), [mu, 2.0], atol=1e-10)
    (cusp,) = curves.cusps
    np.testing.assert_allclose(cusp, (2.0, 2.0), atol=1e-10)
    assert np.isnan(stuck.at(1.5))

    both = event_curves(
        system, F, [(3.0, branch)], mu_range=(1.0, 4.0), gamma_range=(0.1, 10.0), folds_only=False
    )
    events = [c for c in both.curves if c.kind == "event"]
    assert sorted(c.at(1.5) for c in events) == pytest.approx([1.5, 2.0], abs=1e-10)
    assert len(both.folds) == 2


@pytest.mark.verifies(
    "curves of folds",
    reference="closed form: folds of Hild's element under two loads",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_one_element_folds_at_its_closed_forms():
    """One element under (-gamma, -mu): folds at gamma = F mu and gamma = kt / k mu."""
    body = element((1.0, 1.0), 3.0, 1.0, (-2.0, 0.0), (0.0, 0.0)).problem
    domain = body.V.mesh
    friction = body.surfaces[0].law.friction
    gamma = fem.Constant(domain, 0.0)
    mu = fem.Constant(domain, 1.0)
    side = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0], 0))
    tags = mesh.meshtags(domain, 1, np.sort(side), np.ones(len(side), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    energy = materials.LinearElastic(1.0, 1.0).energy(body.u) * ufl.dx
    energy += 2 * ufl.dot(ufl.as_vector([gamma, mu]), body.u) * ds
    problem = ContactProblem(energy, body.u, body.contacts, bcs=body.bcs)
    system = ParametricContact(problem, gamma)
    branches = [(1.0, branch_of(system, (0.0, 10.0)))]
    curves = event_curves(system, mu, branches, mu_range=(0.5, 2.0), gamma_range=(0.1, 10.0))
    for at in (0.6, 1.0, 1.9):
        np.testing.assert_allclose(curves.folds_at(at), [3 * at, 2 * at], atol=1e-10)
    assert curves.cusps == ()
    assert [c.span for c in curves.folds] == [(0.5, 2.0)] * 2

    # The starts are those of the branch: what it was followed under counts, not what is set now.
    mu.value = 0.7
    ends = dict(mu_range=(0.5, 2.0), gamma_range=(0.1, 10.0))
    same = event_curves(system, mu, branches, **ends)
    assert mu.value == 0.7
    np.testing.assert_array_equal(same.folds_at(1.9), curves.folds_at(1.9))
    with pytest.raises(ValueError, match="not a solution of the problem as it is now: residual"):
        event_curves(system, mu, [(1.5, branches[0][1])], **ends)
    friction.value = 2.9
    with pytest.raises(ValueError, match="not a solution of the problem as it is now: residual"):
        event_curves(system, mu, branches, **ends)
    friction.value = 3.0
    domain.geometry.x[:] *= 2.0
    with pytest.raises(ValueError, match="the mesh has moved"):
        event_curves(system, mu, branches, **ends)
    with pytest.raises(ValueError, match="the mesh has moved"):
        system.check_parameter([1.0])
    with pytest.raises(ValueError, match="the mesh has moved"):
        critical_friction(problem)
    with pytest.raises(ValueError, match="the mesh has moved"):
        journal_of(system, [branches[0][1]])
    domain.geometry.x[:] /= 2.0
    mu.value = 1.0
    assert len(journal_of(system, [branches[0][1]]).branches) == 1


@pytest.fixture(scope="module")
def vee():
    args = cases.followed_mesh.arguments(["--size", "0.1"])
    return cases.followed_mesh.system(args, COMM)


@pytest.mark.verifies(
    "curves of folds",
    reference="itself: folds of branches at other coefficients",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_curves_of_the_vee_pass_through_the_folds_of_branches(vee):
    """Folds of branches at other coefficients lie on the curves, with the same statuses."""
    F = friction_of(vee)
    F.value = 1.5
    curves = event_curves(
        vee, F, [(1.5, branch_of(vee))], mu_range=(1.0, 1.6), gamma_range=(0.0, 1.0)
    )
    (cusp,) = curves.cusps
    assert 1.1 < cusp[0] < 1.2
    for mu in (cusp[0] + 1e-7, cusp[0] + 1e-3, 1.3, 1.57):
        F.value = mu
        branch = branch_of(vee)
        gammas = [s.gamma for s in branch.folds]
        assert len(gammas) == 2
        np.testing.assert_allclose(curves.folds_at(mu), sorted(gammas, reverse=True), atol=1e-10)
        of_curves = {c.at(mu): set(c.statuses_at(mu)) for c in curves.folds}
        for s in branch.folds:
            pieces = (branch.points[k].piece for k in (s.index - 1, s.index))
            nearest = min(of_curves, key=lambda gamma, s=s: abs(gamma - s.gamma))
            assert of_curves[nearest] == {vee.letters(p) for p in pieces}
    F.value = cusp[0] - 1e-3
    assert branch_of(vee).folds == []


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.verifies(
    "curves of folds", reference="enumeration: borders of all pieces", aspects=("2D",), alone=True
)
def test_curves_of_random_families_pass_all_borders(seed):
    """At any coefficient the curves pass through all borders that enumeration finds.

    Curves are followed from all borders at three coefficients; those that never pass these are not
    looked for.
    """
    family = random_family(seed)
    span = (0.2, 4.0)
    gammas = (-20.0, 20.0)
    starts = [
        (np.frombuffer(key, dtype=np.int8), mu)
        for mu in (0.5, 1.5, 3.5)
        for key in enumerated(family, mu, gammas)
    ]
    curves = follow_events(family, starts, span, gammas, folds_only=False)
    assert all(m.complete for m in curves.meetings)
    for mu in (0.31, 1.07, 2.61, 3.93):
        there = enumerated(family, mu, gammas)
        passed = [s for c in curves.curves for s in c.segments if s.low <= mu <= s.high]
        assert {s.frame.codes.tobytes() for s in passed} == set(there)
        kinds = {s.frame.codes.tobytes(): s.kind for s in passed}
        for key, frame in there.items():
            # Solutions on either side of the border, by solving the pieces beside it.
            gamma = frame.gamma(mu)
            h = 1e-7
            sides = [
                {sense for sense in (-1, 1) if holds(family, frame.piece(k), mu, gamma + sense * h)}
                for k in (0, 1)
            ]
            assert kinds[key] == ("fold" if sides[0] == sides[1] else "event")


@pytest.mark.parametrize("seed", [4, 8])
@pytest.mark.verifies(
    "charts",
    reference="enumeration: all pieces of random problems",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_chart_counts_solutions_of_all_pieces(seed):
    """Numbers of solutions as by solving all pieces; the chart is fine where they change."""
    family = random_family(seed)
    span = (0.2, 4.0)
    gammas = (-8.0, 8.0)
    chart = count_solutions(family, mu_range=span, gamma_range=gammas, cells=(4, 4), depth=2)
    assert chart.proved
    assert {c.count for c in chart.cells} == {1, 3}
    areas = [np.ptp(c.mu) * np.ptp(c.gamma) for c in chart.cells]
    assert sum(areas) == pytest.approx(np.ptp(span) * np.ptp(gammas))
    for cell in chart.cells:
        pieces = itertools.product(range(4), repeat=2)
        inside = [p for p in pieces if holds(family, np.array(p, dtype=np.int8), *cell.middle)]
        assert cell.solutions == tuple(sorted("".join("ok+-"[c] for c in p) for p in inside))
    size = min(areas)
    for a, b in itertools.combinations(chart.cells, 2):
        touch = a.mu[0] <= b.mu[1] and b.mu[0] <= a.mu[1]
        touch = touch and a.gamma[0] <= b.gamma[1] and b.gamma[0] <= a.gamma[1]
        if touch and a.count != b.count:
            assert min(np.ptp(a.mu) * np.ptp(a.gamma), np.ptp(b.mu) * np.ptp(b.gamma)) < 1.01 * size


def test_chart_of_one_element_has_crossing_lines(folder):
    """Three solutions between gamma = 2 and gamma = F, else one; the two lines cross at F = 2."""
    summary = cases.chart.main(["--at", "3", "2.5", "--cells=4", "--depth=1", f"--output={folder}"])
    assert summary["folds_at"]["3"] == pytest.approx([3.0, 2.0], abs=1e-10)
    assert summary["folds_at"]["2.5"] == pytest.approx([2.5, 2.0], abs=1e-10)
    np.testing.assert_allclose(summary["cusps"], [[2.0, 2.0]], atol=1e-10)
    for curve in summary["curves"]:
        F, gamma = np.array(curve["points"]).T
        line = F if gamma[-1] > 3 else 2.0
        np.testing.assert_allclose(gamma, line, atol=1e-10)
        assert curve["kind"] == "fold"
    assert summary["proved"]
    for F, gamma, count, _ in summary["cells"]:
        assert count == (3 if 2 < gamma < F else 1)
    assert (folder / "chart.png").stat().st_size > 10_000


@pytest.mark.ranks(2)
def test_charts_refuse_ranges_and_families(vee):
    F = friction_of(vee)
    with pytest.raises(ValueError, match="must differ from gamma"):
        contact_family(vee, vee.constant, mu_range=(0.0, 1.0))
    with pytest.raises(ValueError, match="scalar Constant"):
        contact_family(vee, 1.5, mu_range=(0.0, 1.0))
    with pytest.raises(ValueError, match="does not appear"):
        contact_family(vee, fem.Constant(vee.problem.V.mesh, 1.0), mu_range=(0.0, 1.0))
    with pytest.raises(ValueError, match="second parameter is -1"):
        contact_family(vee, F, mu_range=(-1.0, 1.0))
    with pytest.raises(ValueError, match="range"):
        event_curves(vee, F, [(4.0, branch_of(vee))], mu_range=(5.0, 6.0), gamma_range=(0.0, 1.0))
    with pytest.raises(ValueError, match="pairs"):
        event_curves(vee, F, [(1.5, None)], mu_range=(1.0, 2.0), gamma_range=(0.0, 1.0))


def test_crossing_curves_of_folds_agree_with_enumeration():
    """Where they do two borders of all that enumeration finds have one gamma."""
    family = random_family(20)
    span = (3.0, 4.0)
    gammas = (-20.0, 20.0)
    starts = [(np.frombuffer(key, np.int8), 3.9) for key in enumerated(family, 3.9, gammas)]
    curves = follow_events(family, starts, span, gammas)
    ((mu, gamma),) = curves.crossings
    there = enumerated(family, mu, gammas).values()
    folds = [f for f in there if f.kind(mu) == "fold" and abs(f.gamma(mu) - gamma) < 1e-10]
    assert len(folds) == 2
    before, after = (np.subtract(*(f.gamma(mu + h) for f in folds)) for h in (-1e-3, 1e-3))
    assert before * after < 0
