"""What the checker says of two solutions, asked of pairs of states that obey the law.

A state a of a point obeys the law, b has the equations of a status, whether it obeys the
inequalities or not, and is known up to an error. Whatever problem both may solve, with d = a - b
and e = r_a - r_b every inequality of which uniqueness is made has to hold, those with the bounds
that a attains as equations where they are sharp; and b is not refused where it obeys the law.
"""

import itertools
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from dolfinx_contact.analysis import check_proof as cp
from dolfinx_contact.analysis.check_proof import Ball, PieceSolution

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="numpy alone, one process")
#: Friction and bound of a point, and the statuses that it can have.
KINDS = {"Coulomb": (0.75, 0.0, range(4)), "given": (0.0, 0.5, range(1, 7)), "free": (0, 0, (0, 2))}
NUMBERS = np.array([0.25, 0.5, 1.0, 2.0])


def state_of(code, F, g, rng, obeys):
    """(ut, un, rt, rn) with the equations of a status, and its inequalities if it obeys the law."""
    ut, un, rn = rng.choice(NUMBERS, 3) * (1 if obeys else rng.choice([-1, 1, 1], 3))
    share = rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0]) * (1 if obeys else rng.choice([1, 1, 3]))
    if cp.IS_OPEN[code]:
        rn = 0.0
    else:
        un = 0.0
    limit = F * rn + g
    sense = int(cp.SENSE[code])
    if not cp.IS_FREE[code]:
        return np.array([0.0, un, share * limit, rn])
    if (F == 0 and g == 0) or sense == 0:
        return np.array([ut * rng.choice([-1, 1]), un, 0.0, rn])
    return np.array([sense * ut, un, -sense * limit, rn])


def slots(a, F, g):
    ut, un, rt, rn = a
    limit = F * rn + g
    return np.array([max(ut, 0), max(-ut, 0), un, limit + rt, limit - rt, rn])


def known(code, F, g, b, off):
    """The solution of a piece with the values b, known up to errors."""
    problem = SimpleNamespace(friction=np.array([F]), g=np.array([g]))
    parts = [Ball(np.array([v]), np.array([e])) for v, e in zip(b, off, strict=True)]
    return PieceSolution(problem, np.array([code], dtype=np.int8), *parts)


def sets_of(codes):
    """Sets of up to three statuses, and of all, as masks."""
    for k in {1, 2, min(3, len(codes)), len(codes)}:
        for found in itertools.combinations(codes, k):
            yield sum(1 << s for s in found)


def sides(row, d, e, F, x):
    """Left sides of the inequality of a row, for the theta that it takes; x is that of b."""
    v, w = row.unknown, row.unknown ^ 1
    f = e[v] + x * e[w]
    if row.equal:
        return [abs(f)]
    tilts = np.array([0.0, 0.5, -0.5, 1.0, -1.0]) / F if row.theta else [0.0]
    more = row.k1 * d[v] ** 2 + row.k2 * f**2
    return [d[v] * (f + t * e[w]) + (1 - F * abs(t)) * more for t in tilts]


@pytest.mark.each_value
@pytest.mark.parametrize("error", [0.0, 0.03125])
@pytest.mark.parametrize("kind", KINDS)
def test_rows_hold_for_all_pairs(kind, error):
    F, g, codes = KINDS[kind]
    rng = np.random.default_rng(11)
    nearest = {}
    tries = (True, True, False) * (1 if kind == "given" else 4)
    for code, allowed, obeys in itertools.product(codes, sets_of(codes), tries):
        for other in (s for s in codes if allowed >> s & 1):
            b = state_of(code, F, g, rng, obeys)
            a = state_of(other, F, g, rng, True)
            off = error * rng.choice([0.0, 0.5, 1.0], 4) * (b != 0)
            piece = known(code, F, g, b + off * rng.choice([-1, 1], 4), off)
            ub = slots(a, F, g)
            if F > 0:
                ub[5] = 8.0  # the slacks bound the pressure
            rows = cp._rows_of(piece, 0, allowed, ub)
            if rows is None:
                # At the border of the friction bound round-off decides.
                inside = cp.IS_FREE[code] or abs(b[2]) < F * b[3] + g
                assert error or not (obeys and inside and allowed >> code & 1)
                continue
            d, e = (a - b)[:2], (a - b)[2:]
            assert not d[[v for v in (0, 1) if v not in {r.unknown for r in rows}]].any()
            for row in rows:
                x = row.x
                if F > 0 and code == 1 and row.unknown == 0 and x not in (-F, F):
                    x = -b[2] / b[3]
                assert abs(x - row.x) <= row.x_off * (1 + 1e-12)
                found = sides(row, d, e, F, x)
                assert max(found) <= 1e-8, (code, allowed, other, row, a, b)
                f = e[row.unknown] + x * e[row.unknown ^ 1]
                if row.k1 * d[row.unknown] ** 2 + row.k2 * f**2 > 0.01:
                    key = code, allowed, row.unknown
                    nearest[key] = max(nearest.get(key, -np.inf), found[0])
    # A point that sticks has neither slip nor more than the slack that bounds it.
    assert error or nearest
    sharp = [v for (_, allowed, _), v in nearest.items() if allowed & 0b10010 and not error]
    assert min(sharp, default=0.0) > -1e-7


# -- in space --------------------------------------------------------------------------------------

OPEN, STICK, SLIP, CLOSED = range(4)
#: Friction, bound, statuses of b and the kind of cell of each.
IN_SPACE = {
    "Coulomb": (0.75, 0.0, {0: OPEN, 1: STICK, 2: SLIP}),
    "given": (0.0, 0.5, {1: CLOSED, 2: CLOSED, 4: OPEN, 5: OPEN}),
    "free": (0.0, 0.0, {0: OPEN, 2: CLOSED}),
}
#: Of every law statuses of b and families (`FAMILIES`) that some pairs satisfy as equations.
SHARP = {
    "Coulomb": {(0, 0), (0, 1), (1, 0), (1, 1)} | {(2, family) for family in (0, 1, 2, 4, 6, 7, 8)},
    "given": {(1, 1), (2, 0), (2, 1), (4, 1), (5, 0), (5, 1)},
    "free": {(0, 1), (2, 1)},
}


def unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def quantity_bounds(kind, a, s):
    """The bounds of a cell that a attains, and any of the others."""
    most = np.full((cp.MOST, 1), 0.375)
    most[[cp.OF_S, cp.OF_RN], 0] = -0.25
    ut, un, rn = a[:2], a[2], a[5]
    if kind in (OPEN, CLOSED):
        most[:4, 0] = [-ut[0], ut[0], -ut[1], ut[1]]
    if kind == OPEN:
        most[cp.OF_UN] = un
    if kind == SLIP:
        most[cp.OF_S : cp.OF_S + 2, 0] = -s, s
    if kind in (SLIP, CLOSED):
        most[cp.OF_RN : cp.OF_RN + 2, 0] = -rn, rn
    if kind == STICK:
        most[cp.OF_RK] = rn
    return most


def in_a_cell(kind, F, g, angle, rng):
    """(ut, un, rt, rn) that obeys the law, of a kind and of a direction, and its slip."""
    s, un, rn = rng.choice(NUMBERS, 3)
    along = unit(angle)
    if kind in (OPEN, CLOSED):
        normal = (un, 0.0) if kind == OPEN else (0.0, rn)
        if g > 0 and rng.random() < 0.5:
            return np.array([0, 0, normal[0], *(g * rng.choice([0.5, 1.0]) * along), normal[1]]), 0
        return np.array([*(s * along), normal[0], *(-g * along), normal[1]]), s
    if kind == STICK:
        share = rng.choice([0.0, 0.5, 1.0])
        return np.array([0, 0, 0, *(-F * rn * share * along), rn]), 0.0
    return np.array([*(s * along), 0.0, *(-F * rn * along), rn]), s


def piece_in_space(code, F, g, angle, off, obeys, rng):
    """A solution of a status, known up to a radius, and its true (ut, un, rt, rn)."""
    problem = SimpleNamespace(friction=np.array([F]), g=np.array([g]), points=1)
    first, normal = rng.choice(NUMBERS, 2) * (1 if obeys else rng.choice([-1, 1], 2))
    slips = code in (2, 5) and F + g > 0
    if slips:
        z = np.array([first, angle, normal])
    elif code in (1, 4):
        limit = abs(F * normal) + g
        share = rng.choice([0.0, 0.5, 0.75] if obeys else [0.5, 1.5])
        z = np.array([*(-share * limit * unit(angle)), normal])
    else:
        z = np.array([*(first * unit(angle)), normal])
    codes = np.array([code], dtype=np.int8)
    directions = unit(z[1])[None] if slips else np.zeros((1, 2))
    state = cp.space_state(problem, codes, z[None], directions).value[0]
    radius = off * rng.choice([0.0, 0.5, 1.0], 3)
    near = z + radius * rng.choice([-1, 1], 3)
    directions = unit(near[1])[None] if slips else directions
    return cp.SpacePiece(
        problem, codes, near[None], directions, np.eye(3), np.zeros(3), radius[None]
    ), state


def arcs_around(q, left, right):
    """Arcs of 1/16 that end at q, as many on either side, or one."""
    starts = q + np.arange(-left, max(right, 1 - left)) / 16
    return np.stack([starts, starts + 1 / 16], axis=1)


def cells_of(kinds, arcs):
    rows = [(k, *ends) for k in kinds for ends in (arcs if k == SLIP else [(0.0, 0.0)])]
    table = np.array(rows)
    kind = table[:, 0].astype(np.int64)
    return cp.Cells(np.zeros_like(kind), kind, table[:, 1:])


@pytest.mark.parametrize("off", [0.0, 2.0**-7])
@pytest.mark.parametrize("law", IN_SPACE)
def test_forms_hold_for_all_pairs(law, off):
    F, g, codes = IN_SPACE[law]
    rng = np.random.default_rng(12)
    nearest = {}
    possible = sorted(set(codes.values()))
    subsets = [s for k in (1, 2, 3) for s in itertools.combinations(possible, k)]
    tries = range(16 if law == "Coulomb" else 8)
    for code, kinds, t in itertools.product(codes, subsets, tries):
        for other in kinds:
            obeys = t % 2 > 0
            # Some slips of b are along an axis, all of a at ends of arcs.
            angle = rng.choice([0.0, np.pi / 2, *rng.uniform(-np.pi, np.pi, 2)])
            piece, b = piece_in_space(code, F, g, angle, off, obeys, rng)
            q = rng.integers(0, 64) / 16
            turned = np.arctan2(*cp.rays(q)[::-1])
            a, s = in_a_cell(other, F, g, turned, rng)
            most = quantity_bounds(other, a, s)
            arcs = arcs_around(q, *rng.integers(0, 12, 2))
            found = cp.space_differences(piece, cells_of(kinds, arcs), most)
            if found is None:
                assert not (obeys and codes[code] in kinds and off == 0)
                continue
            v = a - b
            gone = np.setdiff1d(np.arange(3), found.unknown)
            assert not v[gone].any()
            assert not v[3:][found.vanishing].any()
            for family in np.flatnonzero(found.has[:, 0]):
                value = v @ found.forms[family, 0] @ v
                slack = np.abs(v) @ found.errors[family, 0] @ np.abs(v)
                assert value <= slack + 1e-9, (code, kinds, other, family, value, a, b)
                size = np.abs(v) @ found.sizes[family, 0] @ np.abs(v)
                if size > 0.01:
                    key = code, int(family)
                    nearest[key] = max(nearest.get(key, -np.inf), value / size)
    sharp = {key for key, value in nearest.items() if value > -1e-6}
    assert off or sharp >= SHARP[law]


@pytest.mark.parametrize("off", [0.0, 2.0**-7])
def test_columns_hold_for_all_slips(off):
    """S D a - D r of two slips is M x with a matrix in M, and x = (ds, w, dr), w = 2 sin(phi/2)."""
    F = 0.75
    S = np.array([[2.0, 0.25, -0.5], [0.25, 3.0, 1.0], [-0.5, 1.0, 4.0]])
    dS = off * np.array([[1.0, 0.5, 0.0], [0.5, 0.25, 2.0], [0.0, 2.0, 1.0]])
    rng = np.random.default_rng(13)
    for t in range(60):
        angle, q = rng.uniform(-np.pi, np.pi), rng.integers(0, 64) / 16
        piece, b = piece_in_space(2, F, 0.0, angle, off, t % 2 == 0, rng)
        turned = np.arctan2(*cp.rays(q)[::-1])
        a, s = in_a_cell(SLIP, F, 0.0, turned, rng)
        most = quantity_bounds(SLIP, a, s)
        piece.problem.stiffness, piece.problem.p = Ball(S, dS), np.zeros(3)
        cells = cells_of([SLIP], arcs_around(q, *rng.integers(0, 9, 2)))
        found = cp._columns_of_slip(piece, cells, most, 0)
        phi = (turned - angle + np.pi) % (2 * np.pi) - np.pi
        if found is None:
            continue
        slid = b[:2] @ unit(angle)
        mean = np.cos(phi / 2) * unit(angle + phi / 2)
        across = unit(angle + phi / 2 + np.pi / 2)
        true = np.zeros((3, 3))
        true[:, 0] = (S + dS * rng.choice([-1, 1]))[:, :2] @ mean
        true[:, 1] = (s + slid) / 2 * (S[:, :2] @ across)
        true[:2, 1] += F * (a[5] + b[5]) / 2 * across
        true[:2, 2] = F * mean
        middle, width = summed(found)
        assert (np.abs(true - middle) <= width + 1e-12).all()


def summed(terms):
    """Middle and width of the columns of M (3, 3)."""
    middle, width = np.zeros((2, 3, 3))
    for term in terms:
        middle[:, term.column] += term.middle * term.vector.value
        largest = (abs(term.middle) + term.width) * (np.abs(term.vector.value) + term.vector.radius)
        width[:, term.column] += largest - abs(term.middle) * np.abs(term.vector.value)
    return middle, width


def test_columns_are_those_of_a_point_where_arcs_are_narrow():
    """As wide as the arc, with s and rn the means of both solutions."""
    F, arc = 0.75, 2.0**-12
    S = np.array([[2.0, 0.25, -0.5], [0.25, 3.0, 1.0], [-0.5, 1.0, 4.0]])
    for q in np.arange(0.125, 4, 0.25):
        angle = np.arctan2(*cp.rays(q)[::-1])
        rng = np.random.default_rng(14)
        piece, b = piece_in_space(2, F, 0.0, angle, 0.0, True, rng)
        piece.problem.stiffness, piece.problem.p = Ball.of(S), np.zeros(3)
        a, s = in_a_cell(SLIP, F, 0.0, angle, rng)
        cells = cells_of([SLIP], [(q, q + arc)])
        middle, width = summed(cp._columns_of_slip(piece, cells, quantity_bounds(SLIP, a, s), 0))
        along, across = unit(angle), unit(angle + np.pi / 2)
        turning = (s + b[:2] @ along) / 2 * S[:, :2] @ across
        turning[:2] += F * (a[5] + b[5]) / 2 * across
        true = np.stack([S[:, :2] @ along, turning, [*(F * along), 0.0]], axis=1)
        assert (np.abs(true - middle) < 6 * arc).all()
        assert width.max() < 12 * arc
