"""Balls of the checker contain the exact results, which rational arithmetic gives."""

from fractions import Fraction
from operator import add, mul, sub, truediv

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.proofs.check_proof import Ball, hypot

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, one process")


def ball(rng, shape, size):
    """Numbers of all magnitudes up to a size, with errors up to a part of them, or none."""
    value = size * rng.normal(size=shape) * 10.0 ** rng.integers(-12, 1, shape)
    part = rng.choice([0.0, 1e-17, 1e-3, 0.5], shape)
    return Ball(value, np.abs(value) * part * rng.random(shape))


def ends(x, i):
    """Exact ends of an entry."""
    value, radius = Fraction(float(x.value[i])), Fraction(float(x.radius[i]))
    return value - radius, value + radius


def holds(x, i, exact):
    return abs(exact - Fraction(float(x.value[i]))) <= Fraction(float(x.radius[i]))


@pytest.mark.parametrize("size", [1.0, 1e-140, 1e140])
@pytest.mark.parametrize("operation", [add, sub, mul, truediv])
def test_an_operation_contains_the_exact_results(operation, size):
    rng = np.random.default_rng(3)
    a, b = ball(rng, 200, size), ball(rng, 200, size)
    with np.errstate(all="ignore"):
        found = operation(a, b)
    for i in range(200):
        for x in ends(a, i):
            for y in ends(b, i):
                if operation is truediv and np.isinf(found.radius[i]):
                    continue
                assert holds(found, i, operation(x, y))


@pytest.mark.parametrize("size", [1.0, 1e-140, 1e140])
def test_a_product_of_matrices_contains_the_exact_results(size):
    rng = np.random.default_rng(4)
    for _ in range(20):
        A, b = ball(rng, (3, 7), size), ball(rng, 7, size)
        found = A @ b
        for signs in rng.choice([-1, 1], (20, 2, 7)):
            for i in range(3):
                exact = sum(
                    ends(A, (i, j))[int(s > 0)] * ends(b, j)[int(t > 0)]
                    for j, (s, t) in enumerate(zip(*signs, strict=True))
                )
                assert holds(found, i, exact)


def test_exact_numbers_are_balls_on_either_side():
    x = Ball(np.array([1.0, 2.0]), np.array([0.5, 0.0]))
    eye = np.eye(2)
    for found, value in (
        (1 - x, [0, -1]),
        (2.0 * x, [2, 4]),
        (eye @ x, [1, 2]),
        (x + np.ones(2), [2, 3]),
        (-x, [-1, -2]),
    ):
        assert found.value.tolist() == value
        assert found.radius[0] >= 0.5


def test_a_denominator_that_may_be_zero_gives_no_bound():
    one = Ball.of(np.ones(3))
    found = one / Ball(np.array([1.0, 0.5, -0.5]), np.array([1.0, 0.5, 0.6]))
    assert np.isinf(found.radius).all()


def test_lengths_contain_the_lengths_of_all_points():
    rng = np.random.default_rng(5)
    x, y = ball(rng, 200, 1.0), ball(rng, 200, 1.0)
    found = hypot(x, y)
    for i in range(200):
        low, high = (Fraction(float(v[i])) for v in (found.low, found.high))
        for a in ends(x, i):
            for b in ends(y, i):
                square = a * a + b * b
                assert square <= high * high
                assert low <= 0 or low * low <= square
