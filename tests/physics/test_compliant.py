"""Compliant surfaces and regularised friction, against closed forms and the true law."""

from mpi4py import MPI

import cases.only_solution
import cases.regularised
import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from support.blocks import KINDS, block, box, facets, same_tables
from support.checks import solved_start
from support.histories import rollers, sheared_block
from support.mortars import sheared
from support.pairs import displacement, held, stacked

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    NormalCompliance,
    ParametricContact,
    Regularised,
    Tresca,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD

PHI = {
    "tanh": np.tanh,
    "sqrt": lambda x: x / np.sqrt(1 + x**2),
    "polynomial": lambda x: np.where(x < 1, (3 * x - x**3) / 2, 1.0),
    "linear": lambda x: np.minimum(x, 1.0),
}
MODULUS = 1000.0 * 0.7 / (1.3 * 0.4)  # of uniaxial strain


@pytest.mark.ranks(2)
@pytest.mark.parametrize("exponent", [1, 1.5])
@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "normal compliance",
    reference="closed form: a column on springs",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_compliant_compression_has_its_closed_form(dim, cell, exponent):
    """MODULUS (d - penetration) = C penetration^m, nodal and integral."""
    stiffness = 4000.0
    pressed = 0.1
    depth = brentq(lambda d: stiffness * d**exponent - MODULUS * (pressed - d), 0, pressed,
                   xtol=1e-16)  # fmt: skip
    for degree in (1, 2) if cell in ("tri", "hex") else (1,):
        domain = box(COMM, 2, cell)
        u = displacement(domain, degree)
        floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
        law = NormalCompliance(stiffness, exponent)
        surface = ContactSurface(u, facets(domain, dim - 1, 0.0), obstacle=floor, law=law)
        aside = [(i, x) for i in range(dim - 1) for x in (0.0, 1.0)]
        top = np.zeros(dim)
        top[-1] = -pressed
        dofs = fem.locate_dofs_topological(u.function_space, dim - 1, facets(domain, dim - 1, 1.0))
        ends = [fem.dirichletbc(top, dofs, u.function_space), *rollers(u, *aside)]
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
        result = ContactProblem(energy, u, [surface], bcs=ends,
                                petsc_options={"snes_rtol": 1e-13}).solve()  # fmt: skip
        table = result.tables["contact"]
        np.testing.assert_allclose(-table.un, depth, rtol=1e-10)
        np.testing.assert_allclose(table.pressure, MODULUS * (pressed - depth), rtol=1e-10)
        penetration = result.indicators.surfaces["contact"].penetration
        assert penetration == pytest.approx(depth, rel=1e-10)
        assert result.summary()["contact_penetration"] == penetration


@pytest.mark.parametrize(
    ("dim", "cell", "shape"),
    [
        *((2, "tri", shape) for shape in PHI),
        *(pytest.param(3, "hex", s, marks=[] if s == "tanh" else pytest.mark.long) for s in PHI),
    ],
)
@pytest.mark.verifies(
    "regularised friction",
    reference="closed form: a block in simple shear",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_compliant_shear_has_its_closed_form(dim, cell, shape):
    """A block of height 1 and shear modulus 500, drawn by s: 500 (s - u) = b phi(u/eps)."""
    s = 0.03
    eps = 0.004
    pressed = 0.05
    for law, bound in ((Tresca(5.0), 5.0), (Coulomb(0.2), 0.2 * 1000.0 * pressed)):
        slid = brentq(
            lambda u, b=bound: 500.0 * (s - u) - b * PHI[shape](u / eps), 0, s, xtol=1e-16
        )
        shear = bound * PHI[shape](slid / eps)
        law = Regularised(law, eps, shape)
        result = sheared_block(law, dim, cell, s, pressed, shear).solve()
        table = result.tables["contact"]
        np.testing.assert_allclose(table.ut[:, 0], slid, rtol=1e-10)
        np.testing.assert_allclose(-table.shear[:, 0], shear, rtol=1e-10)
        assert set(table.status) == {("s" if dim == 3 else "+") if slid > eps else "k"}


@pytest.mark.verifies(
    "normal compliance",
    "regularised friction",
    reference="theorem: rates at which forces tend to those of the true law",
    aspects=("2D",),
)
def test_compliant_and_regularised_forces_converge_to_the_exact_law():
    """Forces converge to the exact law at the theoretical rate as C grows and eps falls."""
    options = {"snes_rtol": 1e-12}
    true = block(n=6, cell="quad", top=(0.02, -0.03), options=options).solve().tables["contact"]
    assert 0 < true.count("k") < 7

    def order(law, sizes):
        found = []
        for size in sizes:
            t = block(n=6, cell="quad", top=(0.02, -0.03), law=law(size), options=options).solve()
            t = t.tables["contact"]
            found.append(np.abs(t.force - true.force).max() / np.abs(true.force).max())
        return np.diff(np.log(found)) / np.diff(np.log(sizes))

    def spring(C):
        return NormalCompliance(C, 1.0, Coulomb(0.3))

    def square(C):
        return NormalCompliance(C, 2.0, Coulomb(0.3))

    np.testing.assert_allclose(order(spring, (1e6, 1e7, 1e8)), -1.0, atol=0.05)
    np.testing.assert_allclose(order(square, (1e10, 1e12, 1e14)), -0.5, atol=0.05)
    np.testing.assert_allclose(
        order(lambda e: Regularised(Coulomb(0.3), e, "linear"), (1e-7, 1e-9)), 1.0, atol=0.05
    )
    np.testing.assert_allclose(
        order(lambda e: Regularised(Coulomb(0.3), e, "polynomial"), (1e-4, 1e-5)), 1.0, atol=0.05
    )


@pytest.mark.ranks(2)
@pytest.mark.parametrize("solver", ["direct", "amg"])
@pytest.mark.verifies(
    "normal compliance",
    "regularised friction",
    reference="closed form: two columns with a spring between them",
    aspects=(
        "3D",
        "pairs",
        "multigrid",
    ),
)
def test_a_compliant_interface_is_a_spring_between_two_bodies(solver):
    """Two blocks of height 1 in a row with a spring of the interface, and friction as it is."""
    both = stacked(3, "tet", 2)
    u = displacement(both.mesh)
    pressed = 0.1
    depth = brentq(lambda d: 4000.0 * d**2 - MODULUS * (pressed - d) / 2, 0, pressed, xtol=1e-16)
    law = NormalCompliance(4000.0, 2.0, Regularised(Coulomb(0.3), 0.01))
    pair = ContactPair(u, both, slave=3, master=2, law=law)
    ends = [held(u, both.facet_tags, 1, np.zeros(3)), held(u, both.facet_tags, 4, (0, 0, -pressed))]
    aside = rollers(u, *[(i, x) for i in (0, 1) for x in (0.0, 1.0)])
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    options = {"snes_rtol": 1e-13, "linear_solver": solver}
    problem = ContactProblem(energy, u, [pair], bcs=[*ends, *aside], petsc_options=options)
    table = problem.solve().tables["contact"]
    np.testing.assert_allclose(-table.un, depth, rtol=1e-9)
    np.testing.assert_allclose(table.pressure, 4000.0 * depth**2, rtol=1e-9)


@pytest.mark.verifies(
    "regularised friction",
    "normal compliance",
    reference="itself: a solve at the end of the branch",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_branches_in_width_and_stiffness_end_in_solutions():
    """Branches in eps and in C end in the solutions there."""
    for law in (
        lambda g: Regularised(Coulomb(0.3), 0.01 * 10 ** (-3 * g), "tanh"),
        lambda g: NormalCompliance(1e3 * 10 ** (4 * g), 1.5, Coulomb(0.3)),
    ):
        options = dict(n=4, cell="quad", top=(0.02, -0.03))
        domain = box(COMM, 4, "quad")
        gamma = fem.Constant(domain, 0.0)
        problem = block(**options, domain=domain, law=law(gamma))
        system = ParametricContact(problem, gamma)
        x = solved_start(system)
        branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
        assert branch.reason == "gamma reached the end of its range"
        found = system.result_at(branch.points[-1]).tables["contact"]
        same_tables(found, block(**options, law=law(1.0)).solve().tables["contact"], 1e-6)


@pytest.mark.verifies(
    "pivoting",
    "normal compliance",
    reference="itself: the branch by steps",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_compliant_branch_by_pivoting_has_the_events_of_steps():
    """Both are piecewise linear in 2D; pivoting finds the events of steps."""
    law = NormalCompliance(3e4, 1.0, Coulomb(0.15))
    events = []
    for route in ("pivoting", "steps"):
        system, x = sheared(law=law)
        branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0), route=route)
        assert branch.reason == "gamma reached the end of its range"
        events.append([s.gamma for s in branch.special if s.changes])
    assert len(events[0]) > 3
    np.testing.assert_allclose(*events, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("shape", ["tanh", "sqrt", "polynomial"])
@pytest.mark.verifies(
    "regularised friction",
    "all solutions",
    reference="closed form: the fold where a corner alone touches",
    aspects=("2D",),
)
def test_regularised_friction_has_the_folds_of_its_formula(folder, shape):
    """Only the corner A touches: its forces are linear in its slip, and the fold has a formula."""
    words = ["--n", "8", "--friction", "2.5", "--shape", shape, "--output", folder]
    summary = cases.regularised.main([*map(str, words)])
    slides, sticks = (
        next(r for r in summary["true"] if r["status"][0] == letter) for letter in "-k"
    )
    inverse = {
        "tanh": np.arctanh,
        "sqrt": lambda q: q / np.sqrt(1 - q**2),
        "polynomial": lambda q: 2 * np.sin(np.arcsin(q) / 3),  # of (3 x - x^3)/2 = q
    }[shape]

    def width(share):
        rt, rn = ((1 - share) * sticks[k] + share * slides[k] for k in ("sum_rt", "sum_rn"))
        return -share * abs(slides["ut_A"]) / inverse(abs(rt) / (2.5 * rn))

    most = minimize_scalar(width, bounds=(0.01, 0.99), method="bounded", options={"xatol": 1e-12})
    assert summary["lost_at"] == pytest.approx(-most.fun, rel=1e-6)
    assert summary["end_slip"] == pytest.approx(slides["ut_A"], rel=1e-5)
    # Who comes from a large eps arrives at the solution on which friction does not act.
    opens = next(r for r in summary["true"] if r["status"][0] == "o")
    assert summary["reached"]["status"].strip("d") == opens["status"]
    assert summary["reached"]["ut_A"] == pytest.approx(opens["ut_A"], rel=1e-8)


@pytest.mark.long
@pytest.mark.verifies(
    "regularised friction",
    reference="theorem: the bound for one solution, eps^2/log h",
    aspects=("2D",),
)
def test_critical_friction_exceeds_the_bound_of_the_regularised_theorem(folder):
    """The bound of the theorem, eps^2/|log h|, falls by a hundred between these widths."""
    words = ["--n", "8", "--friction", "2.5", "--output", folder]
    summary = cases.only_solution.main([*map(str, words)])
    friction = summary["critical_friction"]
    assert friction["n = 8, eps = 0.0001"] == pytest.approx(
        friction["n = 8, eps = 0.001"], rel=0.05
    )
    assert all(1e5 * summary["bound"][case] < F for case, F in friction.items())
