"""Numbers that equations of a law give, with functions of numpy in the place of compiled UFL."""

import numpy as np
import pytest

from dolfinx_contact.laws.roots import _cut, _inverse, _Root, _times


def root(n, system, sense=0, start=None, end=None):
    """Equations in numpy: columns are the parameter c, then n numbers, and n n of the inverse."""
    found = _Root.__new__(_Root)
    vars(found).update(_n=n, _first=1, _sense=sense, _ends=end is not None)

    def known(full):
        c = full[:, 0]
        columns = [np.broadcast_to(s(c), c.shape) for s in (start or [lambda c: 0.0 * c] * n)]
        if end is not None:
            columns.append(np.broadcast_to(end(c), c.shape))
        return np.stack(columns, axis=1)

    def at(full):
        F, J = system(full[:, 0], full[:, 1 : 1 + n])
        return np.concatenate([F, J.reshape(len(full), n * n)], axis=1)

    vars(found).update(_known=known, _system=at)
    return found


def solved(one, c):
    n = one._n
    full = np.zeros((len(c), 1 + n + n * n))
    full[:, 0] = c
    one(full)
    return full[:, 1 : 1 + n], full[:, 1 + n :].reshape(-1, n, n)


def test_a_number_without_a_sense():
    """z^3 + z = c, and the inverse of its derivative."""

    def system(c, z):
        return z**3 + z - c[:, None], (3 * z**2 + 1)[:, :, None]

    z = np.array([[-2.0], [0.0], [0.3], [40.0]])
    found, inverse = solved(root(1, system), (z**3 + z)[:, 0])
    np.testing.assert_allclose(found, z, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(inverse[:, :, 0], 1 / (3 * z**2 + 1), rtol=1e-8)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("end", [None, 2.0])
def test_a_number_that_goes_one_way(sense, end):
    """It stays at its start where it is driven back, and at its end where it is driven on."""

    def system(c, z):
        return z + 0.25 * z**3 - c[:, None], (1 + 0.75 * z**2)[:, :, None]

    wanted = sense * np.array([-1.0, 0.5, 1.0, 1.9, 3.0])
    c = wanted + 0.25 * wanted**3
    start = [lambda c: 0.25 * sense + 0.0 * c]
    one = root(1, system, sense, start, None if end is None else lambda c: sense * end + 0.0 * c)
    found, inverse = solved(one, c)
    exact = sense * np.clip(sense * wanted, 0.25, np.inf if end is None else end)
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-9)
    np.testing.assert_allclose(inverse[:, 0, 0], 1 / (1 + 0.75 * exact**2), rtol=1e-8)


@pytest.mark.parametrize("sense", [1, -1])
def test_two_numbers_of_which_one_goes_one_way(sense):
    """z_0 + z_1 = c and z_1 = z_0^2 / 4 + 1: the other is solved for wherever the first is held."""

    def system(c, z):
        a, b = z.T
        F = np.stack([a + sense * b - c, b - a**2 / 4 - 1], axis=1)
        one = np.ones_like(a)
        J = np.stack(
            [np.stack([one, sense * one], axis=1), np.stack([-a / 2, one], axis=1)], axis=1
        )
        return F, J

    first = sense * np.array([-0.5, 0.0, 0.7, 1.5, 4.0])
    c = first + sense * (first**2 / 4 + 1)
    one = root(2, system, sense, end=lambda c: sense * 2.0 + 0 * c)
    found, inverse = solved(one, c)
    exact = sense * np.clip(sense * first, 0.0, 2.0)
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], exact**2 / 4 + 1, rtol=1e-9)
    _, J = system(c, found)
    np.testing.assert_allclose(inverse, np.linalg.inv(J), rtol=1e-8)


@pytest.mark.parametrize("end", [None, 5.0])
def test_a_number_that_newtons_method_does_not_find(end):
    """Where the equation jumps from below to above zero: it is bisected."""

    def system(c, z):
        off = z - c[:, None]
        return off + np.where(off > 0, 1.0, -1.0), np.ones((len(c), 1, 1))

    c = np.array([-1.0, 0.3, 2.0, 4.0, 7.0])
    one = root(1, system, 1, end=None if end is None else lambda c: end + 0.0 * c)
    found, inverse = solved(one, c)
    exact = np.clip(c, 0.0, np.inf if end is None else end)
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-12)
    assert np.isfinite(inverse).all()


def test_a_number_that_has_no_bound_before_its_end():
    """1 / sqrt(1 - z) = c: however large c is it stays below its end."""

    def system(c, z):
        off = np.maximum(1 - z, 1e-300)
        return np.sqrt(1 / off) - c[:, None], (0.5 * off**-1.5)[:, :, None]

    c = np.array([0.5, 2.0, 1e3, 1e12])
    found, _ = solved(root(1, system, 1, end=lambda c: 1.0 + 0.0 * c), c)
    exact = np.maximum(1 - 1 / c**2, 0.0)
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-9)
    assert (found < 1.0).all()


def test_what_is_cut_of_steps():
    """They go nine tenths of the way to an end at most, either way."""
    z, start, end = np.full(5, 1.0), np.zeros(5), np.full(5, 3.0)
    step = np.array([1.0, 4.0, -0.5, -2.0, 0.0])
    np.testing.assert_allclose(_cut(z, step, start, end), [1.0, 0.45, 1.0, 0.45, 1.0])
    np.testing.assert_allclose(_cut(z, step, end, start), [1.0, 0.45, 1.0, 0.45, 1.0])
    np.testing.assert_allclose(_cut(z, step, start, np.full(5, np.inf)), [1.0, 1.0, 1.0, 0.45, 1.0])


def test_inverses_of_many_matrices():
    """NaN where there is none, or what is given is no number."""
    rng = np.random.default_rng(0)
    for n in (1, 2):
        J = rng.normal(size=(5, n, n))
        J[1] = 0.0
        J[2, 0, 0] = np.nan
        found = _inverse(J)
        assert np.isnan(found[[1, 2]]).all()
        for i in (0, 3, 4):
            np.testing.assert_allclose(found[i] @ J[i], np.eye(n), atol=1e-12)
        v = rng.normal(size=(5, n))
        np.testing.assert_allclose(_times(J, v)[3], J[3] @ v[3])


def counted(one):
    """How often the equations are evaluated."""
    calls = []
    system = one._system
    one._system = lambda full: calls.append(len(full)) or system(full)
    return calls


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("size", [1e-3, 0.5, 5.0, 1e3])
def test_a_linear_number_needs_no_correction(sense, size):
    """Its search begins at the step of Newton's method from its start, in any units."""

    def system(c, z):
        return 3.0 * (z - c[:, None]), np.full((len(c), 1, 1), 3.0)

    one = root(1, system, sense, [lambda c: 0.0 * c + sense * size])
    calls = counted(one)
    found, inverse = solved(one, np.array([2.0 * sense * size]))
    np.testing.assert_allclose(found, 2.0 * sense * size, rtol=1e-15)
    np.testing.assert_allclose(inverse, 1 / 3)
    # Whether it moves; value and slope at the start; where it is; and the slope there.
    assert len(calls) == 5


@pytest.mark.parametrize("sense", [1, -1])
def test_a_number_without_a_slope_at_its_start(sense):
    """It leaves in its sense, though the other root of the square is as near."""

    def system(c, z):
        away = z - 2.0
        return sense * (away**2 - c[:, None]), (2.0 * sense * away)[:, :, None]

    c = np.array([0.25, 1.0, 9.0])
    found, _ = solved(root(1, system, sense, [lambda c: 2.0 + 0.0 * c]), c)
    np.testing.assert_allclose(found[:, 0], 2.0 + sense * np.sqrt(c), rtol=1e-9)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("end", [None, 8.0])
def test_a_number_whose_bracket_has_to_grow(sense, end):
    """Where the equation jumps over zero beyond the step of Newton's method."""
    slope = 1.2

    def system(c, z):
        off = sense * z - c[:, None]
        return sense * (off + np.where(off > 0, 0.5, -0.5)), np.full((len(c), 1, 1), slope)

    c = np.array([0.3, 4.0, 6.0])
    one = root(1, system, sense, end=None if end is None else lambda c: sense * end + 0.0 * c)
    found, _ = solved(one, c)
    np.testing.assert_allclose(found[:, 0], sense * c, rtol=1e-12)


@pytest.mark.parametrize("end", [None, 8.0])
def test_two_numbers_that_newtons_method_does_not_find(end):
    """The first is bisected by its own equation, with the other solved for."""

    def system(c, z):
        a, b = z.T
        off = a + b - c
        F = np.stack([off + np.where(off > 0, 1.0, -1.0), b - 0.5 * a - 1.0], axis=1)
        one = np.ones_like(a)
        J = np.stack([np.stack([one, one], axis=1), np.stack([-0.5 * one, one], axis=1)], axis=1)
        return F, J

    a = np.array([-1.0, 0.3, 2.0, 5.0])
    one = root(2, system, 1, end=None if end is None else lambda c: end + 0.0 * c)
    found, _ = solved(one, a + 0.5 * a + 1.0)
    exact = np.maximum(a, 0.0)
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found[:, 1], 0.5 * exact + 1.0, rtol=1e-12)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("end", [None, 2.0])
def test_a_number_at_rest_to_the_last_digit(sense, end):
    """Where nothing drives it at its start it is its start; the same at its end."""
    start = sense * 0.3

    def system(c, z):
        return z + 0.25 * z**3 - c[:, None], (1 + 0.75 * z**2)[:, :, None]

    at = [start] if end is None else [start, sense * end]
    c = np.array([system(np.zeros(1), np.full((1, 1), z))[0][0, 0] for z in at])
    one = root(
        1,
        system,
        sense,
        [lambda c: start + 0.0 * c],
        None if end is None else lambda c: sense * end + 0.0 * c,
    )
    found, _ = solved(one, c)
    assert found[0, 0] == start
    if end is not None:
        assert found[1, 0] == sense * end


def test_steps_are_cut_by_the_first_number_alone():
    """Where another one starts is no bound of it: a few corrections suffice."""

    def system(c, z):
        a, b = z.T
        F = np.stack([a**3 + a - c, b - a], axis=1)
        zero, one = np.zeros_like(a), np.ones_like(a)
        J = np.stack(
            [np.stack([3 * a**2 + 1, zero], axis=1), np.stack([-one, one], axis=1)], axis=1
        )
        return F, J

    a = np.array([0.2, 0.7, 1.6])
    starts = [lambda c: 0.0 * c, lambda c: 0.3 + 0.0 * c]
    one = root(2, system, 1, starts, lambda c: 2.0 + 0.0 * c)
    calls = counted(one)
    found, _ = solved(one, a**3 + a)
    np.testing.assert_allclose(found, np.column_stack([a, a]), rtol=1e-9)
    assert len(calls) < 25
