"""Laws of the user's own, against closed forms and the law written independently in numpy."""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from scipy.optimize import minimize_scalar
from support.blocks import block, same_tables
from support.checks import solved_start
from support.demo_numbers import run
from support.own_laws import Orthotropic, SlipWeakening

import ufl
from dolfinx import mesh

from dolfinx_contact import Coulomb, HalfSpace, Tresca
from dolfinx_contact.continuation import Follower, StepControl
from dolfinx_contact.laws import FrictionLaw

COMM = MPI.COMM_WORLD


def dragged(law, **options):
    return block(n=4, cell="hex", law=law, top=(0.02, 0.004, -0.02), **options)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.verifies(
    "orthotropic friction",
    "laws of one's own",
    reference="closed form: the shear of the most dissipation",
    aspects=("3D",),
)
def test_orthotropic_friction_dissipates_the_most(angle):
    """Every slipping point dissipates the most: rt = -rn A (A ut)/|A ut|, axes of the grain."""
    along = 0.1
    across = 0.4
    result = dragged(Orthotropic(along, across, angle)).solve()
    t = result.tables["contact"]
    assert result.kkt_violation < 1e-9
    assert t.count("s") > 0
    grain = np.array([np.cos(angle), np.sin(angle), 0.0])
    axes = np.stack([grain, np.cross(t.n[0], grain)])
    A = axes.T @ np.diag([along, across]) @ axes
    moved = t.ut @ A
    size = np.linalg.norm(moved, axis=1)
    slips = t.letters == "s"
    expected = -t.rn[:, None] * (moved @ A) / size[:, None]
    np.testing.assert_allclose(t.rt[slips], expected[slips], atol=1e-9 * t.rn.max())
    # The shear of points that stick is inside the ellipse.
    stuck = t.letters == "k"
    q = t.rt @ axes.T / (along, across)
    assert (np.linalg.norm(q, axis=1)[stuck] <= t.rn[stuck] * (1 + 1e-9)).all()
    # Not along the motion, unless that is along an axis of the grain.
    if angle:
        across_motion = np.abs(np.cross(t.rt[slips], t.ut[slips])[:, 2])
        assert across_motion.max() > 1e-3 * (t.rn * np.linalg.norm(t.ut, axis=1)).max()


@pytest.mark.verifies("orthotropic friction", reference="itself: Coulomb's law", aspects=("3D",))
def test_with_equal_coefficients_it_is_coulombs():
    same_tables(
        dragged(Orthotropic(0.3, 0.3, 0.4)).solve().tables["contact"],
        dragged(Coulomb(0.3)).solve().tables["contact"],
        1e-8,
    )


@pytest.mark.parametrize("distance", [0.5, 0.05])
@pytest.mark.verifies(
    "friction of the slip",
    "laws of one's own",
    reference="closed form: the load as a function of the slip, and its extrema",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_static_and_kinetic_friction_of_one_element(distance):
    """Folds of the branch where the weakening outruns the stiffness, against the closed form.

    At a slip to the left kt ut = pt + F(|ut|) rn and rn = k ut - pn, so that the load is known as a
    function of ut; its extrema are the folds.
    """
    static = 0.9
    kinetic = 0.3
    law = SlipWeakening(static, kinetic, distance)
    system = linear_triangle(
        1,
        None,
        (4.0, 0.0),
        (1.0, 1.0),
        preload=(0.0, -1.0),
        law=lambda _: law,
        comm=MPI.COMM_SELF,
    )
    kt = 2.0
    k = 1.0
    pn = -0.5
    rate = -2.0

    def load(ut):
        friction = kinetic + (static - kinetic) * np.exp(ut / distance)
        return (kt * ut - friction * (k * ut - pn)) / rate

    x = solved_start(system, 0.0)
    with Follower(system, StepControl(), gamma_scale=1.0) as follower:
        branch = follower.run(follower.start(x, 0.0), gamma_range=(0.0, 0.4))
    assert branch.points[-1].gamma == pytest.approx(0.4)
    starts = static * 0.5 / 2.0  # where the shear reaches the static bound
    slips = np.linspace(-0.4, 0.0, 40_001)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(load(slips)))))
    expected = []
    for i in turns:
        a, b, c = (load(slips[i + k]) for k in range(3))
        sense = np.sign(a + c - 2 * b)
        near = slips[[i, i + 2]]
        turn = minimize_scalar(lambda u, s=sense: s * load(u), bounds=near, method="bounded",
                               options={"xatol": 1e-12})  # fmt: skip
        expected.append(load(turn.x))
    found = [s.gamma for s in branch.folds]
    if distance == 0.05:
        expected.append(starts)  # the kink from stick to slip is one as well
    assert len(found) == len(expected)
    np.testing.assert_allclose(sorted(found), sorted(expected), atol=1e-7)
    for point in branch.points[:: max(len(branch.points) // 10, 1)]:
        t = system.result_at(point).tables["contact"]
        if t.letters[0] == "-":
            assert point.gamma == pytest.approx(load(t.along(t.ut)[0]), abs=1e-8)


@pytest.mark.long
def test_the_demo_of_an_own_law_runs(folder):
    names = run("own_law", folder, n=4)
    results = names["results"]
    for name in ("orthotropic", "weakening"):
        assert results[name].kkt_violation < 1e-9
        picture = folder / "output" / "own_law" / f"{name}.png"
        assert picture.stat().st_size > 5_000
    sideways = {name: result.resultants["contact"][1] for name, result in results.items()}
    assert sideways["orthotropic"] > 0  # the grain leads it aside
    assert abs(sideways["weakening"]) < 1e-9 * results["weakening"].resultants["contact"][2]


@dataclass(frozen=True)
class Offset(FrictionLaw):
    """Friction beginning at a pressure."""

    friction: Any
    onset: Any

    def bound(self, a, p):
        return self.friction * ufl.max_value(p - self.onset, 0.0)


@pytest.mark.parametrize("units", [1.0, 1e-3, 1e6])
@pytest.mark.parametrize("cell", ["quad", "hex"])
@pytest.mark.verifies(
    "laws of one's own",
    "units",
    reference="closed form: the bound at the pressure",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_friction_beginning_at_a_pressure_has_its_bound(cell, units):
    """In any units of force; slipping points have the bound of their pressure, against the slip."""
    top = (0.01, *[0.0] * (cell == "hex"), -0.01)
    onset = 5.0 * units
    result = block(n=3, cell=cell, law=Offset(0.3, onset), top=top, young=1000.0 * units).solve()
    t = result.tables["contact"]
    assert result.kkt_violation < 1e-9
    bound = 0.3 * np.maximum(t.pressure - onset, 0.0)
    size = np.linalg.norm(t.shear, axis=1)
    slips = np.isin(t.letters, list("+-s"))
    assert slips.any()
    np.testing.assert_allclose(size[slips], bound[slips], atol=1e-9 * t.pressure.max())
    assert (np.sum(t.shear * t.ut, axis=1) <= 1e-12 * units).all()


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("method", "n", "law", "floor", "top"),
    [
        ("mixed", (6, 3), SlipWeakening(0.6, 0.2, 0.003), ((0.5, -0.002), (0.02, 1.0)),
         (0.008, -0.012)),
        ("mixed", (3, 2), Tresca(6.446434103729212), ((0.5, -0.004), (-0.01219654426083814, 1.0)),
         (-0.005194738194399702, -0.010923131958544973)),
    ],
    ids=["weakening", "tresca"],
)  # fmt: skip
def test_friction_never_pushes_along(method, n, law, floor, top):
    """Solutions satisfy the law for steep weakening and for bounds that act on open points."""
    domain = mesh.create_unit_square(COMM, *n)
    result = block(
        domain=domain, law=law, obstacle=HalfSpace(*floor), method=method, top=top
    ).solve()
    t = result.tables["contact"]
    rt = t.along(t.rt)
    ut = t.along(t.ut)
    assert result.kkt_violation < 1e-8
    assert (rt * ut <= 1e-12 * np.abs(rt).max() * np.abs(ut).max()).all()
    assert (np.abs(rt) <= t.bound * (1 + 1e-8) + 1e-9 * t.rn.max()).all()


@pytest.mark.ranks(2)
def test_fields_may_be_negative_where_the_law_allows_it():
    result = dragged(Orthotropic(0.1, 0.4, -0.5)).solve()
    assert result.kkt_violation < 1e-9
    with pytest.raises(ValueError, match="friction of Coulomb must be finite and nonnegative"):
        dragged(Coulomb(-0.5))
