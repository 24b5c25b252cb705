"""Paths by arc length whose memory is accepted at every point, against closed forms."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import element
from support.bonds import C, W, bar

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import Ending, StepControl
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.materials import LinearElastic

U0 = np.sqrt(W / C)
ENDS = (0.0, 8 * U0)


def broken_by_half(step):
    return "far enough" if step.result.tables["contact"].beta.min() < 0.4 else ""


def opening(step):
    t = step.result.tables["contact"]
    return t.un[t.letters != "d"] / U0


@pytest.mark.parametrize(
    ("k", "n"),
    [
        (1.0, 1),
        *(pytest.param(k, 8, marks=pytest.mark.long) for k in (0.3, 2.0)),
        *(pytest.param(k, 1, marks=pytest.mark.long) for k in np.linspace(0.3, 2.9, 14)),
    ],
)
@pytest.mark.verifies(
    "arc length paths",
    "RCCM adhesion",
    "energies of histories",
    reference="closed form: a bar in series with a bond, with both folds",
    aspects=("2D",),
)
def test_bar_in_series_snaps_back(k, n):
    """Snap-back: a nonsmooth fold where damage begins, a smooth one at 4/3 u0 (3/k)^(1/4)."""
    # Longer steps than by default where there are no more than two bonds, which break alike.
    control = StepControl(maximum=0.02) if n == 1 else None
    history = ArcLength(bar(k, n)).run(gamma_range=ENDS, control=control)
    assert history.complete
    kink, fold = history.folds
    assert (kink.event, fold.event) == ("nonsmooth fold", "smooth fold")
    assert (kink.before, kink.after) == ("oo", "aa")
    assert (fold.before, fold.after) == ("aa", "aa")
    assert kink.gamma / U0 == pytest.approx(1 + 1 / k, rel=1e-8)
    np.testing.assert_allclose(opening(kink), 1.0, rtol=1e-8)
    u = (3 / k) ** 0.25
    assert fold.gamma / U0 == pytest.approx(4 * u / 3, rel=1e-8)
    np.testing.assert_allclose(opening(fold), u, rtol=1e-6)
    pull = -fold.result.tables["contact"].pressure
    np.testing.assert_allclose(pull, k * C * u * U0 / 3, rtol=1e-6)
    assert history.kinks == []
    for step in history.steps:  # on the closed form all the way
        r, other = opening(step)
        assert r == pytest.approx(other, abs=1e-12)
        assert step.gamma / U0 == pytest.approx(r + min(r, r**-3) / k, rel=1e-9)
        assert step.energies.damage == pytest.approx(0.05 * W * (1 - min(1, r**-2)), abs=1e-10)
    rows = history.rows()
    assert [r["event"] for r in rows if r["event"]] == ["nonsmooth fold", "smooth fold"]
    gammas = [history.gamma, *(s.gamma for s in history.steps)]
    np.testing.assert_allclose([r["gamma"] for r in rows], gammas)


@pytest.mark.long
def test_the_energy_residue_of_a_path_falls_with_the_steps():
    residues = []
    for part in (1, 4):
        cosine = 1 - 0.1 / part**2
        control = StepControl(initial=0.02 / part, maximum=0.1 / part, cosine=cosine)
        path = ArcLength(bar(1.0, 1, comm=MPI.COMM_SELF))
        energies = path.run(gamma_range=ENDS, control=control, stop=broken_by_half).energies
        residues.append(abs(energies.residue))
        assert energies.damage > 0.5 * 0.05 * W
    assert residues[1] < 0.4 * residues[0] < 0.002 * 0.05 * W


@pytest.mark.long
@pytest.mark.verifies(
    "arc length paths", "RCCM adhesion", reference="closed form: the secant", aspects=("2D",)
)
def test_going_back_unloads():
    """Along the secant, to nothing and up again, where damage goes on from where it was."""
    path = ArcLength(bar(1.0, 2))
    k = 1.0
    there = path.run(gamma_range=ENDS, stop=broken_by_half)
    assert there.reason == "far enough"
    assert str(there).startswith(f"{len(there.steps)} points from gamma 0 to ")
    assert str(there).endswith(": far enough")
    assert there.ending is Ending.STOPPED
    assert not there.complete
    (r,) = set(np.round(opening(there.steps[-1]), 12))
    beta = there.steps[-1]
    back = path.run(gamma_range=ENDS, direction="back")
    assert back.complete
    assert back.steps[-1].gamma == pytest.approx(0.0, abs=1e-12)
    assert back.steps[-1].number == len(there.steps) + len(back.steps)
    for step in back.steps:
        np.testing.assert_allclose(opening(step) * (1 + r**-4 / k), step.gamma / U0, atol=1e-9)
        np.testing.assert_allclose(step.result.tables["contact"].beta, r**-2, rtol=1e-9)
    assert back.energies.damage == pytest.approx(beta.energies.damage, rel=1e-12)
    assert abs(back.energies.residue - there.energies.residue) < 1e-9 * W
    again = path.run(gamma_range=ENDS, direction="back")
    (kink,) = (s for s in again.steps if s.event)
    assert kink.event == "kink"
    np.testing.assert_allclose(opening(kink), r, rtol=1e-8)
    assert (kink.before, kink.after) == ("oo", "aa")


@pytest.mark.long
@pytest.mark.parametrize(("k", "n"), [(1.0, 2), pytest.param(2.0, 8, marks=pytest.mark.long)])
@pytest.mark.verifies(
    "arc length paths", reference="closed form: the stiffness of the pressed bar", aspects=("2D",)
)
def test_path_passes_the_state_without_forces(k, n):
    """Beyond the state without forces the bar is pressed, as hard as its stiffness says."""
    path = ArcLength(bar(k, n))
    ends = (-0.5 * U0, ENDS[1])
    path.run(gamma_range=ends, stop=broken_by_half)
    back = path.run(gamma_range=ends, direction="back")
    assert back.reason == "gamma reached the end of its range"
    (kink,) = (s for s in back.steps if s.event)
    assert (kink.event, kink.before) == ("kink", "oo")
    assert abs(kink.gamma) < 1e-10 * U0
    table = back.steps[-1].result.tables["contact"]
    np.testing.assert_allclose(table.un, 0.0, atol=1e-12)
    np.testing.assert_allclose(table.pressure, k * C * 0.5 * U0, rtol=1e-9)


@pytest.mark.verifies(
    "arc length paths",
    "Coulomb",
    reference="closed form: Klarbring's node, folds at g = 3 and 2",
    aspects=("2D",),
)
def test_arc_length_passes_klarbrings_end():
    """Where load control finds no continuation: back by slip to g = 2, and on without contact."""
    system = element((1.0, 1.0), 3.0, 1.0, (-2.0, 0.0), (0.0, -2.0))
    system.set_parameter(0.0)
    system.problem.solve()
    control = StepControl(maximum=0.02)  # there is only one point
    history = ArcLength(system).run(gamma_range=(0.0, 4.0), control=control)
    assert history.complete
    assert [(s.event, s.before[0], s.after[0]) for s in history.folds] == [
        ("nonsmooth fold", "k", "-"),
        ("nonsmooth fold", "-", "o"),
    ]
    np.testing.assert_allclose([s.gamma for s in history.folds], [3.0, 2.0], rtol=1e-9)
    # Slip dissipates: F rn times its way, rn = 1 + u and p + 2 u + F rn = 0 with u from 0 to -1.
    spent = history.folds[1].energies.dissipated
    assert spent == pytest.approx(history.steps[-1].energies.dissipated)


@pytest.mark.long
@pytest.mark.verifies(
    "arc length paths",
    "RCCM adhesion",
    reference="independent code: folds of another condensation",
    aspects=("2D",),
)
def test_two_bonds_break_in_turn():
    """A lid tilting as it rises breaks two bonds: folds of an independent condensation."""
    domain = mesh.create_unit_square(MPI.COMM_SELF, 1, 1, mesh.CellType.quadrilateral)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    lid = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    x = ufl.SpatialCoordinate(domain)
    low = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    top = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1))
    law = RCCM(100.0, 100.0, 1.0)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, low, obstacle=floor, law=law)
    aside = np.arange(0, 8, 2, dtype=np.int32)
    bcs = [
        fem.dirichletbc(lid, top),
        fem.dirichletbc(fem.Constant(domain, 0.0), aside, V.sub(0)),
    ]
    energy = LinearElastic.from_young(60.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    rise = ufl.as_vector((0 * x[0], gamma * (1 + 0.2 * x[0])))
    system = ParametricContact(problem, gamma, driven=[(lid, rise)])
    history = ArcLength(system).run(gamma_range=(0, 0.3))
    assert history.complete
    assert max(s.result.kkt_violation for s in history.steps) < 1e-8
    at = [(s.gamma, s.event) for s in history.steps if s.event]
    assert [event for _, event in at] == [
        *("nonsmooth fold", "smooth fold", "nonsmooth fold", "smooth fold"),
        "kink",
    ]
    np.testing.assert_allclose(at[0][0], 0.20047856846, rtol=1e-9)
    np.testing.assert_allclose([at[3][0], at[4][0]], [0.17855839, 0.249938], rtol=2e-6)
