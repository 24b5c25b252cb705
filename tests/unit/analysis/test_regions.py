"""Regions of solutions between curves, against closed forms and enumeration."""

import itertools

from mpi4py import MPI

import cases.regions
import numpy as np
import pytest
from support.enumeration import events_by_enumeration as enumerated
from support.enumeration import holds, random_family

from dolfinx_contact.analysis import EventCurves, contact_family, solution_regions
from dolfinx_contact.analysis.curve_search import follow_events

COMM = MPI.COMM_WORLD


def regions_of(n, friction, size=3.0):
    system, other = cases.regions.loaded(n, friction, (1.0, 1.0), 1.0)
    curves, _ = cases.regions.curves_of(system, other, size)
    family = contact_family(system, other, mu_range=(-size, size))
    return curves, solution_regions(
        family, curves, mu_range=(-size, size), gamma_range=(-size, size)
    )


def of_one_node(F, F1, F2, kt=2.0, kn=2.0, k=1.0):
    """Statuses at a load, by the closed forms of every piece; p = (F1, F2) / 2."""
    pt = F1 / 2
    pn = F2 / 2
    found = {"o"} if kt * pn > k * pt else set()
    found |= {"k"} if pn < 0 and abs(pt) < F * abs(pn) else set()
    for letter, sense in (("+", 1), ("-", -1)):
        stiffness = kt + sense * F * k
        if stiffness != 0:
            ut = (pt + sense * F * pn) / stiffness
            found |= {letter} if sense * ut > 0 and k * ut > pn else set()
    return tuple(sorted(found))


@pytest.mark.ranks(2)
@pytest.mark.parametrize("F", [1.0, 2.0, 3.0])
@pytest.mark.verifies(
    "charts",
    "curves of folds",
    reference="paper: Hild (2002), Proposition 2 and figures 2 to 4",
    aspects=("2D",),
)
def test_regions_agree_with_hilds_figures(F):
    """Proposition 2 and figures 2 to 4 of Hild (2002), from curves, region by region."""
    curves, regions = regions_of(1, F)
    lines = {("k", "+"): -1 / F, ("k", "-"): 1 / F, ("o", "+"): 0.5, ("o", "-"): 0.5}
    for curve in curves.curves:
        slope = lines.pop(curve.segments[0].statuses)
        assert curve.span == pytest.approx((-3.0, 0.0) if curve.at(-1.0) < 1 else (0.0, 3.0))
        F1, F2 = curve.points().T
        np.testing.assert_allclose(F2, slope * F1, atol=1e-10)
    assert not lines
    assert len(curves.folds) == (2 if F == 3 else 0)
    assert regions.proved
    assert regions.explained
    places = np.linspace(-2.9719, 2.9531, 37)
    for F1, F2 in itertools.product(places, places + 0.0123):
        assert regions.at(F1, F2).solutions == of_one_node(F, F1, F2), (F1, F2)
    areas = {}
    for c in regions.cells:
        mus, low, high = c.outline(2)
        areas.setdefault(c.solutions, 0.0)
        areas[c.solutions] += float((mus[1] - mus[0]) * (high - low).sum() / 2)
    assert sum(areas.values()) == pytest.approx(36.0)
    # Of three solutions: between the lines of slopes 1/2 and 1/3.
    several = {s: area for s, area in areas.items() if len(s) > 1}
    assert several == ({("-", "k", "o"): pytest.approx(4.5 * (1 / 2 - 1 / 3))} if F == 3 else {})


def test_regions_of_more_elements_agree_with_solutions():
    """All changes are across curves, and the solutions hold for any multiple of the load."""
    curves, regions = regions_of(3, 3.0)
    assert regions.proved
    assert regions.explained
    for F1, F2 in ((-2.0, -0.57), (1.1, 0.9), (-0.4, -2.1)):
        assert regions.at(F1, F2).solutions == regions.at(F1 / 7, F2 / 7).solutions
    assert {c.count for c in regions.cells} == {1, 3}
    assert len(curves.folds) == 2


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "charts", reference="enumeration: all pieces of random problems", aspects=("2D",), alone=True
)
def test_regions_of_random_families_agree_with_enumeration(seed):
    """Against solving all pieces; a curve that is left out is missed."""
    family = random_family(seed)
    span = (0.2, 4.0)
    gammas = (-8.0, 8.0)
    starts = [
        (np.frombuffer(key, dtype=np.int8), mu)
        for mu in np.linspace(0.21, 3.99, 12)
        for key in enumerated(family, mu, gammas)
    ]
    curves = follow_events(family, starts, span, gammas, folds_only=False)
    regions = solution_regions(family, curves, mu_range=span, gamma_range=gammas)
    assert regions.proved
    assert regions.explained
    random = np.random.default_rng(seed)
    for mu, gamma in zip(random.uniform(*span, 60), random.uniform(*gammas, 60), strict=True):
        pieces = itertools.product(range(4), repeat=2)
        inside = [p for p in pieces if holds(family, np.array(p, dtype=np.int8), mu, gamma)]
        words = tuple(sorted("".join("ok+-"[c] for c in p) for p in inside))
        assert regions.at(mu, gamma).solutions == words
    less = EventCurves(curves.curves[1:], curves.meetings)
    assert not solution_regions(family, less, mu_range=span, gamma_range=gammas).explained


def test_the_regions_demo_finds_the_published_regions(folder):
    summary = cases.regions.main(["--over-critical", "1.5", f"--output={folder}"])
    (found,) = summary["regions"]
    assert found["friction"] == 3.0
    assert found["proved"]
    assert found["explained"]
    sets = sorted("".join(c["solutions"]) for c in found["cells"])
    assert sorted(set(sets)) == ["+", "-ko", "k", "o"]
    assert {(c["kind"], *c["statuses"]) for c in found["curves"]} == {
        *(("event", "k", "+"), ("event", "o", "+"), ("fold", "k", "-"), ("fold", "o", "-"))
    }
    if COMM.rank == 0:
        assert (folder / "regions_1.5.png").stat().st_size > 10_000
