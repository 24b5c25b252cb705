"""Adhesion that damage weakens (RCCM), against closed forms."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, randomise, remainders
from support.bonds import U0, C, W, along, bonded, put

import ufl

from dolfinx_contact import RCCM
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.laws.status import DAMAGING
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD


def weakest(table, before):
    """Intensity at the jumps of a table without viscosity, from that before."""
    energy = C * (np.maximum(table.un, 0.0) ** 2 + np.sum(table.ut**2, axis=1))
    return np.minimum(before, W / np.maximum(energy, 1e-30))


@pytest.mark.parametrize(
    ("cell", "given"),
    [
        ("tri", {}),
        ("quad", {"method": "mixed"}),
        ("quad", {"method": "integral", "degree": 2}),
        ("quad", {"pair": True, "n": 1}),
        ("hex", {}),
        pytest.param("quad", {"pair": True}, marks=pytest.mark.long),
        pytest.param("tet", {"method": "integral"}, marks=pytest.mark.long),
        pytest.param("tet", {"pair": True, "n": 1}, marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "RCCM adhesion",
    "quasi-static",
    reference="closed form: intensity, adhesion and friction from the jumps so far",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
@pytest.mark.verifies(
    "integral contact",
    reference="closed form: intensity and adhesion from the jumps so far",
    aspects=(
        "2D",
        "3D",
    ),
)
@pytest.mark.verifies(
    "mixed contact",
    reference="closed form: intensity, adhesion and friction from the jumps so far",
    aspects=("2D",),
)
def test_rccm_follows_its_closed_form_at_every_point(cell, given):
    """Pressed, dragged, lifted and let down: intensity, adhesion and friction from the jumps."""
    problem, top = bonded(cell, law=RCCM(C, C, W, 0.4), **given)
    aside = [0.0] if cell in ("hex", "tet") else []
    corners = (0.0, *aside, -0.02), (0.2, *aside, -0.02), (0.1, *aside, 0.3), (0.1, *aside, -0.01)
    evolution = QuasiStatic(problem, along(top, *corners))
    # The bonds of some of these bodies snap on the way; jumps are located in one of them.
    jumps = {"locate_jumps": True, "at_jump": "jump"} if cell == "tri" else {"halve_steps": True}
    history = evolution.run(np.linspace(0.0, 4.0, 33), **jumps)
    before = 1.0
    seen = set()
    for step in history.steps:
        t = step.result.tables["contact"]
        assert step.result.kkt_violation < 1e-8 or given.get("method") == "integral"
        np.testing.assert_allclose(t.beta, weakest(t, before), rtol=1e-8)
        # What damages goes on to; what does not keeps its strength bit by bit.
        np.testing.assert_array_equal((t.beta != before) & (t.bond != "w"), False)
        opening = np.maximum(t.un, 0.0)
        pull = (t.beta**2 * C * t.area)[:, None] * (opening[:, None] * t.n - t.ut)
        np.testing.assert_allclose(t.adhesion, pull, rtol=0, atol=1e-8 * np.abs(pull).max() + 1e-9)
        seen |= {*t.bond, *t.status}
        before = t.beta
        if given.get("method") == "integral":
            continue
        bound = 0.4 * (1 - t.beta) * np.maximum(t.rn, 0.0)
        friction = np.linalg.norm(t.friction, axis=1)
        size = 1e-7 * (np.abs(t.force).max() + C * U0)
        assert (friction <= bound + size).all()
        slips = np.isin(t.letters, list("+-s"))
        np.testing.assert_allclose(friction[slips], bound[slips], rtol=0, atol=size)
        assert (np.sum(t.friction * t.increment, axis=1)[slips] <= 1e-12).all()
    assert {"i", "w", "o"} < seen
    assert seen & set("+s")
    assert before.max() < 0.5


@pytest.mark.parametrize(
    ("cell", "pair"),
    [*(pytest.param(c, False, marks=pytest.mark.long) for c in ("quad", "hex")), ("tri", True)],
)
@pytest.mark.verifies(
    "RCCM adhesion",
    "energies of histories",
    reference="closed form: R = C u up to u0, then w^2/(C u^3), and its work",
    aspects=(
        "2D",
        "3D",
        "pairs",
    ),
)
def test_rccm_opening_follows_its_closed_form(cell, pair):
    """R = C u, peak at u0, then w^2/(C u^3); the secant back; work up to 6 u0."""
    problem, top = bonded(cell, law=RCCM(C, C, W), young=1e4, pair=pair)
    aside = [0.0] * (1 if cell != "hex" else 2)
    load = along(top, (*aside, 6.1 * U0), (*aside, 3 * U0), (*aside, -0.01))
    history = QuasiStatic(problem, load).run([*np.linspace(0.0, 1.0, 25), 1.5, 2.0, 3.0])
    way = []
    peak = 0.0
    for step in history.steps:
        t = step.result.tables["contact"]
        u = t.un.mean() / U0
        pull = -t.pressure / np.sqrt(W * C)
        np.testing.assert_allclose(t.un / U0, u, atol=1e-9)
        if step.time <= 1.0:
            assert abs(step.energies.residue) < 0.05 * W
            np.testing.assert_allclose(pull, min(u, u**-3), rtol=1e-8)
            bonds = step.energies.stored - step.result.energies["bulk"]
            work = u**2 / 2 if u <= 1 else 1 - 1 / (2 * u**2)
            assert bonds + step.energies.damage == pytest.approx(W * work, rel=1e-8)
            assert step.energies.damage == pytest.approx(W * (1 - t.beta[0]), rel=1e-8, abs=1e-12)
            end = u
            peak = max(peak, pull.max())
        elif t.un.max() > 1e-9:
            np.testing.assert_allclose(pull, u * end**-4, rtol=1e-8)
        way.append(u)
    assert 6 < end < 6.2
    assert 0.9 < peak <= 1
    # Pressed, a bond does nothing, however strong it is.
    np.testing.assert_allclose(t.adhesion, 0.0, atol=1e-9)
    assert t.rn.min() > 0


@pytest.mark.ranks(2)
@pytest.mark.parametrize("m", [pytest.param(2.0, marks=pytest.mark.long), 1.0])
@pytest.mark.verifies(
    "RCCM adhesion",
    reference="closed form: R_T = w^2/(C u^3) + mu P (1 - w/(C u^2))",
    aspects=("2D",),
)
def test_rccm_shear_under_pressure_follows_its_closed_form(m):
    """R_T = w^2/(C u^3) + mu P (1 - w/(C u^2)); it softens after the peak if mu P < 1.5 sqrt(w C).

    The minimum is then m - 4 m^3/27 at 3/(2 m) u0.
    """
    young = 1e7
    mu = 0.1
    problem, top = bonded("quad", 1, law=RCCM(C, C, W, mu), young=young, comm=MPI.COMM_SELF)
    press = -m * np.sqrt(W * C) / mu / young
    r = np.concatenate([[0.0], np.arange(1, 9) / 8, 1 + np.arange(1, 41) / 8])
    history = QuasiStatic(problem, lambda t: put(top, (U0 * t, press * min(1.0, 100 * t)))).run(r)
    force = []
    for step in history.steps:
        t = step.result.tables["contact"]
        u = t.along(t.ut) / U0
        np.testing.assert_allclose(u, step.time, rtol=1e-4)  # the block hardly gives way
        pushed = mu * t.rn.sum() / np.sqrt(W * C)
        assert pushed == pytest.approx(m, rel=1e-6)
        beta = np.minimum(1.0, u**-2.0)
        wanted = t.area * beta**2 * u + mu * t.rn * (1 - beta) / np.sqrt(W * C)
        np.testing.assert_allclose(-t.along(t.rt) / np.sqrt(W * C), wanted, rtol=1e-7)
        force.append(-t.along(t.rt).sum() / np.sqrt(W * C))
    r = r[1:]
    force = np.array(force)
    slope = np.diff(force[r >= 1])
    assert force[r == 1] == pytest.approx(1.0, rel=1e-3)
    if m < 1.5:
        least = np.argmin(force[r >= 1])
        assert r[r >= 1][least] == 1.5 / m
        assert force[r >= 1][least] == pytest.approx(m - 4 * m**3 / 27, rel=1e-6)
        assert (slope[:least] < 0).all()
        assert (slope[least:] > 0).all()
    else:
        assert (slope > 0).all()
    assert force[-1] == pytest.approx(6.0**-3 + m * (1 - 1 / 36), rel=1e-5)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("cell", "method"), [("quad", None), ("tet", None), ("tri", "integral")])
@pytest.mark.parametrize("viscosity", [0.0, 0.3])
@pytest.mark.verifies(
    "RCCM adhesion",
    reference="differences: Taylor remainders of second order",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_the_jacobian_of_bonds_passes_taylors_test(cell, method, viscosity):
    """With a memory, friction, and points of all statuses, which are held."""
    problem = block(n=2, cell=cell, method=method, law=RCCM(3e4, 2e4, 0.4, 0.3, viscosity))
    x = randomise(problem, 1, 0.01, 10.0)
    (surface,) = problem.surfaces
    rng = np.random.default_rng(COMM.rank)
    n = surface.points.number
    memory = Memory(rng.normal(0, 0.002, (n, surface.dim)), {"beta": rng.uniform(0.3, 1, n)}, 0.1)
    problem = problem.with_memory([memory])
    sizes = remainders(problem, x, 2)
    codes = np.concatenate(COMM.allgather(problem.equations.evaluate_contact(x).statuses[0]))
    assert (codes >= DAMAGING).any()
    assert sizes[0] > 1e-9
    np.testing.assert_allclose(np.log2(sizes[:-1] / sizes[1:]), 2.0, atol=0.35)


@pytest.mark.ranks(2)
def test_field_of_bonds_holds_the_right_half():
    """Bonded only on the right half; a static solve begins with that."""
    domain = box(COMM, 4, "quad")
    x = ufl.SpatialCoordinate(domain)
    beta = ufl.conditional(ufl.gt(x[0], 0.4), 0.8, 0.0)
    t = block(domain=domain, law=RCCM(C, C, W, beta=beta), top=(0.0, 0.01)).solve()
    t = t.tables["contact"]
    np.testing.assert_allclose(t.beta, np.where(t.x[:, 0] > 0.4, 0.8, 0.0), atol=1e-14)
    np.testing.assert_allclose(t.pressure, -C * t.beta**2 * t.un, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize(
    ("n", "times"),
    [
        (1, (0.0, 0.4, 1.0)),
        pytest.param(1, (0.0, 1.0), marks=pytest.mark.long),
        pytest.param(2, (0.0, 0.58, 1.0), marks=pytest.mark.long),
        pytest.param(2, (0.0, 0.2, 0.4, 0.6, 0.8, 1.0), marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "jumps",
    "RCCM adhesion",
    reference="closed form: a spring in series with the bond",
    aspects=("2D",),
)
def test_bond_in_series_with_a_spring_breaks_at_once(n, times):
    """A spring E = 50 in series with a bond: the bond loses all its strength when it yields.

    Beyond the jump R = w^2/(C u^3), and u + R/E is the prescribed displacement. The jump is a third
    of the longest steps.
    """
    young = 50.0
    problem, top = bonded(law=RCCM(C, C, W, 0.2), young=young, n=n)
    evolution = QuasiStatic(problem, along(top, (0.0, 0.5)))
    history = evolution.run(times, shortest=2e-3, locate_jumps=True, at_jump="jump")
    assert history.complete
    (jump,) = [step for step in history.steps if step.jump]
    assert 0.596 < jump.start <= 0.6 + 1e-9 < jump.time < 0.606
    u = history.steps[-1].result.tables["contact"].un
    np.testing.assert_allclose(u + W**2 / (C * u**3) / young, 0.5, rtol=1e-9)
    force = history.steps[-1].result.resultants["contact"]
    np.testing.assert_allclose(force, [0.0, -(W**2) / (C * u[0] ** 3)], atol=1e-9)
