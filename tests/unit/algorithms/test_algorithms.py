"""Classical algorithms on reduced problems: random problems, closed forms, and reports."""

import numpy as np
import pytest

from dolfinx_contact.algorithms import (
    ALGORITHMS,
    GaussSeidel,
    InteriorPoint,
    Lemke,
    Penalty,
    PointProblem,
    ProjectedGradient,
    TrescaFixedPoint,
    Uzawa,
)

EVERY = [
    TrescaFixedPoint(),
    TrescaFixedPoint(aitken=True),
    TrescaFixedPoint(relaxation=0.7),
    Uzawa(),
    Uzawa(augmented=True),
    GaussSeidel(),
    GaussSeidel(relaxation=1.3),
    ProjectedGradient(),
    InteriorPoint(),
]


def random_contact(rng, dim, m=None, *, friction=0.4, bound=0.0):
    """Friction so small that there is one solution."""
    m = int(rng.integers(1, 7)) if m is None else m
    G = rng.standard_normal((dim * m, dim * m))
    S = G @ G.T / (dim * m) + np.eye(dim * m)
    F = rng.uniform(0, friction, m) * (rng.random(m) < 0.9)
    return PointProblem(S, rng.standard_normal(dim * m), F, rng.uniform(0, bound, m))


def violation(contact, a, r):
    """Return the violation of equilibrium, Signorini's conditions and friction, independently."""
    force = max(np.abs(r).max(), contact.force)
    length = max(np.abs(a).max(), contact.length)
    un = a[:, -1]
    rn = r[:, -1]
    ut = a[:, :-1]
    rt = r[:, :-1]
    radius = contact.friction * rn + contact.bound
    slip = np.linalg.norm(ut, axis=1)
    return max(
        np.abs(contact.S @ a.reshape(-1) - contact.p - r.reshape(-1)).max() / force,
        (-un).max() / length,
        (-rn).max() / force,
        np.abs(un * rn).max() / (length * force),
        (np.linalg.norm(rt, axis=1) - radius).max() / force,
        np.abs(rt * slip[:, None] + radius[:, None] * ut).max() / (length * force),
    )


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("algorithm", EVERY, ids=lambda a: a.described())
@pytest.mark.verifies(
    "Tresca's fixed point",
    "Uzawa",
    "Gauss-Seidel",
    "projected gradient",
    "interior point",
    reference="independent code: the violation of the law, in numpy",
    aspects=(
        "2D",
        "3D",
    ),
    alone=True,
)
def test_every_algorithm_solves_random_problems(algorithm, dim):
    """Each ends in the solution, on its own."""
    rng = np.random.default_rng(dim)
    for bound in (0.0, 0.0, 0.5):
        contact = random_contact(rng, dim, bound=bound)
        outcome = algorithm.run(contact)
        assert outcome.converged, outcome.reason
        assert violation(contact, outcome.a, outcome.r) < 1e-8
        assert outcome.residuals[-1] <= 1e-10


def solutions_of_one_node(kt, k, kn, pt, pn, F):
    """Closed form (Klarbring 1990, Hild 2002): (ut, un, rt, rn) of every status that holds."""
    u = np.linalg.solve([[kt, k], [k, kn]], [pt, pn])
    found = [(*u, 0.0, 0.0)] if u[1] >= 0 else []
    if pn <= 0 and abs(pt) <= -F * pn:
        found.append((0.0, 0.0, -pt, -pn))
    for sign in (1, -1):
        ut = (pt + sign * F * pn) / (kt + sign * F * k)
        rn = k * ut - pn
        if sign * ut > 0 and rn >= 0:
            found.append((ut, 0.0, -sign * F * rn, rn))
    return found


NODE = np.array([[2.0, 1.0], [1.0, 2.0]])


@pytest.mark.parametrize("algorithm", [*EVERY, Lemke()], ids=lambda a: a.described())
@pytest.mark.verifies(
    "Lemke",
    "Gauss-Seidel",
    "interior point",
    "projected gradient",
    reference="closed form: the solutions of one node",
    aspects=("2D",),
    alone=True,
)
def test_algorithms_find_the_solution_of_one_node(algorithm):
    for pt, pn in ((-0.4, -1.0), (-1.5, -1.0), (0.8, -1.0), (0.3, 0.5)):
        contact = PointProblem(NODE, np.array([pt, pn]), np.array([0.5]))
        ((ut, un, rt, rn),) = solutions_of_one_node(2.0, 1.0, 2.0, pt, pn, 0.5)
        outcome = algorithm.run(contact)
        np.testing.assert_allclose(outcome.a[0], [ut, un], atol=1e-9)
        np.testing.assert_allclose(outcome.r[0], [rt, rn], atol=1e-9)


@pytest.mark.parametrize("algorithm", [*EVERY, Lemke()], ids=lambda a: a.described())
def test_beyond_the_critical_friction_algorithms_find_one_of_the_solutions(algorithm):
    """With F = 3 there are up to three."""
    for g in (2.2, 2.5, 2.9, 4.0):
        contact = PointProblem(NODE, np.array([-g, -1.0]), np.array([3.0]))
        known = solutions_of_one_node(2.0, 1.0, 2.0, -g, -1.0, 3.0)
        outcome = algorithm.run(contact)
        assert outcome.converged, outcome.reason
        state = np.concatenate([outcome.a[0], outcome.r[0]])
        assert min(np.abs(state - np.array(w)).max() for w in known) < 1e-8


def test_tresca_leaves_a_steep_fixed_point():
    """S(g) = F (g - 1 + ...) has a slope beyond 1 at the slip: the fixed point leaves it."""
    contact = PointProblem(NODE, np.array([-2.5, -1.0]), np.array([3.0]))
    assert TrescaFixedPoint().run(contact).converged
    slip = solutions_of_one_node(2.0, 1.0, 2.0, -2.5, -1.0, 3.0)[-1]
    near = np.array([[slip[2], slip[3] * (1 + 1e-6)]])
    away = TrescaFixedPoint().run(contact, start=near)
    assert away.converged
    assert np.abs(away.r[0] - slip[2:]).max() > 0.1


# -- parts ---------------------------------------------------------------------------------------


def test_options_are_checked():
    for kind, bad in (
        (GaussSeidel, {"relaxation": 2.0}),
        (TrescaFixedPoint, {"relaxation": 2.0}),
        (Uzawa, {"step": 0.0}),
        (Penalty, {"accuracy": 2.0}),
        (Lemke, {"facets": 2}),
        (InteriorPoint, {"max_iterations": 0}),
    ):
        with pytest.raises(ValueError, match=next(iter(bad))):
            kind(**bad)
    assert all(
        ALGORITHMS[name].described().startswith(ALGORITHMS[name].name) for name in ALGORITHMS
    )
