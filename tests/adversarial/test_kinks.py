"""Assumption: bulk, laws and loads are smooth in the displacement and in the parameter gamma.

Stiffnesses with kinks, jumping thresholds, and loads turning or setting in at some gamma have exact
answers here: columns with Poisson's ratio 0 are springs in a row.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from support.bodies import block, floor, normal_force, triangle, two_blocks
from support.checks import assert_close, results_at, solved_start, verdict

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    ConvergenceError,
    Coulomb,
    Frictionless,
    HalfSpace,
    LevelSet,
    ParametricContact,
    RigidBody,
    materials,
)
from dolfinx_contact.analysis import contact_family, count_solutions
from dolfinx_contact.continuation import (
    StepControl,
    explore,
    find_solutions,
    follow,
    points_at,
)
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.laws import FrictionLaw, Interface, Internal

E = 1000.0  # Young's modulus of most columns
D = 0.01  # displacement of most tops
C = 0.002  # displacement at which springs begin to act


def pressed(bulk, cells=(2, 2), depth=D, height=0.0, law=None, **kind):
    """A column whose top is lowered; ``bulk(body)`` is added to its elastic energy."""
    body = block(cells, **kind)
    dim = len(cells)
    body.move_top(*[0.0] * (dim - 1), -depth)
    return body, body.problem(law, body.elastic(E) + bulk(body), obstacle=floor(height, dim))


THRESHOLDS = {
    "absolute value": lambda u: abs(u[0]),
    "root of a square": lambda u: ufl.sqrt(u[0] ** 2),
    "maximum": lambda u: ufl.max_value(u[0], -u[0]),
    "positive parts": lambda u: ufl.max_value(u[0], 0) - ufl.min_value(u[0], 0),
}


@pytest.mark.parametrize("name", THRESHOLDS)
def test_friction_in_the_energy_is_not_solved_silently(name):
    """A face held by 20 |u_x| and pulled by 5 sticks, but Newton's method finds no root."""
    term = THRESHOLDS[name]
    with pytest.raises((ValueError, ConvergenceError), match=r"residual jumps|not finite"):
        pressed(lambda b: b.at_bottom() * (20 * term(b.u) - 5 * b.u[0]) * ufl.ds)[1].solve()


def test_a_sign_in_the_residual_is_not_solved_silently():
    body = block((2, 1, 1))
    body.move_top(0.0, 0.0, -D)
    push = body.at_bottom() * (20 * ufl.sign(body.u[0]) - 5.0)
    v = ufl.TestFunction(body.V)
    residual = ufl.derivative(body.elastic(), body.u, v) + push * v[0] * ufl.ds
    with pytest.raises((ValueError, ConvergenceError), match="residual jumps"):
        body.problem(bulk=residual).solve()


def lowest(factor):
    """Gap of a column hanging under a load ``factor(u)`` at its end, 0.1 above the floor."""
    body = block()
    body.move_top(0.0, -D)
    v = ufl.TestFunction(body.V)
    residual = ufl.derivative(body.elastic(), body.u, v)
    residual += body.at_bottom() * 4.0 * factor(body.u) * v[1] * ufl.ds
    return body.problem(bulk=residual, obstacle=floor(-0.1)).solve().tables["contact"].un


@pytest.mark.parametrize(
    "factor",
    [lambda u: ufl.conditional(ufl.lt(u[1], -0.002), 1.0, 0.0), lambda u: 1.0],
    ids=["late", "at once"],
)
def test_a_load_that_sets_in_on_the_way_is_right(factor):
    """The load begins at u_y = -0.002, before the solution d + 4 / E."""
    assert_close(lowest(factor), np.full(3, 0.1 - 0.014), 1e-8)


def test_a_sign_of_the_place_is_allowed_in_a_residual():
    body = block((2, 1, 1))
    body.move_top(0.0, 0.0, -D)
    v = ufl.TestFunction(body.V)
    push = body.at_bottom() * 2 * ufl.sign(ufl.SpatialCoordinate(body.domain)[0] - 0.5)
    residual = ufl.derivative(body.elastic(), body.u, v) + push * v[2] * ufl.ds
    assert_close(normal_force(body.problem(bulk=residual).solve()), 10.0)


def test_a_squared_absolute_value_is_a_square():
    slips = []
    for square in (lambda u: abs(u[0]) ** 2, lambda u: u[0] ** 2):
        _, problem = pressed(
            lambda b, square=square: b.at_bottom() * (20 * square(b.u) - 5 * b.u[0]) * ufl.ds
        )
        slips.append(problem.solve().tables["contact"].ut[:, 0])
    assert np.abs(slips[1]).max() > 0
    assert_close(slips[0], slips[1], 1e-9)


@pytest.mark.parametrize(("compressed", "pulled"), [(1000.0, 400.0), (500.0, 500.0)])
def test_a_bimodular_column_is_pressed_and_hangs(compressed, pulled):
    body = block()
    eps = ufl.sym(ufl.grad(body.u))
    density = (compressed + pulled) / 2 * eps[0, 1] ** 2
    for i in range(2):
        density += compressed / 2 * ufl.min_value(eps[i, i], 0.0) ** 2
        density += pulled / 2 * ufl.max_value(eps[i, i], 0.0) ** 2
    q = fem.Constant(body.domain, 0.0)
    problem = body.problem(bulk=density * ufl.dx + q * body.u[1] * body.at_bottom() * ufl.ds)
    body.move_top(0.0, -D)
    assert_close(normal_force(problem.solve()), D * compressed)
    body.move_top(0.0, 0.1)
    q.value = 5.0
    assert_close(problem.solve().tables["contact"].un, np.full(3, 0.1 - 5.0 / pulled))


def one_sided(body):
    """Energy of a spring at the lower face acting beyond a way of 0.002."""
    return body.at_bottom() * 1500.0 * ufl.max_value(-body.u[1] - C, 0.0) ** 2 * ufl.ds


@pytest.mark.sample
def test_a_spring_begins_to_act_after_some_way():
    """E (d - b) = k (b - c), with b the way of the lower end."""
    _, problem = pressed(one_sided, height=-1.0, cell="tri")
    b = (E * D + 3000.0 * C) / (E + 3000.0)
    assert_close(1.0 - problem.solve().tables["contact"].un, np.full(3, b), 1e-7)


def test_a_spring_of_a_quadratic_body_shares_the_load_with_the_floor():
    _, problem = pressed(one_sided, (2, 1), height=-0.003, degree=2)
    assert_close(normal_force(problem.solve()), E * (D - 0.003) - 3000.0 * (0.003 - C))


@pytest.mark.parametrize("slack", [2e-9, 0.0])
def test_a_spring_begins_to_act_in_micrometres(slack):
    """SI units, a cube of 1 micrometre; lengths are compared in nanometres."""
    young, k, size, d = 2e11, 6e17, 1e-6, 1e-8
    body = block((1, 1, 1), (size,) * 3, "tet")
    body.move_top(0.0, 0.0, -d)
    x = ufl.SpatialCoordinate(body.domain)
    lower = ufl.conditional(ufl.lt(x[2], 1e-6 * size), 1.0, 0.0)
    way = ufl.max_value(-body.u[2] - slack, 0.0) if slack else body.u[2]
    bulk = body.elastic(young) + lower * k / 2 * way**2 * ufl.ds
    table = body.problem(bulk=bulk, obstacle=floor(-size, 3)).solve().tables["contact"]
    found = (1e-6 - table.un) / 1e-9
    expected = (young * d + k * slack * size) / (young + k * size) / 1e-9
    assert_close(found, np.full(len(found), expected), 1e-5)


def test_a_floor_by_penalty_and_a_floor_that_comes_up():
    """The energy sees the displaced place, max(-(z + u_z) - c, 0)^2."""
    k, c = 4000.0, 0.001
    body = block((1, 1, 2))
    body.move_top(0.0, 0.0, -D)
    depth = ufl.max_value(-(ufl.SpatialCoordinate(body.domain)[2] + body.u[2]) - c, 0.0)
    at = fem.Constant(body.domain, (0.0, 0.0, -1.0))
    problem = body.problem(
        Coulomb(0.3),
        body.elastic() + body.at_bottom() * k / 2 * depth**2 * ufl.ds,
        obstacle=HalfSpace(at, (0, 0, 1)),
    )
    b = (E * D + k * c) / (E + k)
    assert_close(1.0 - problem.solve().tables["contact"].un, np.full(4, b), 1e-7)
    at.value[2] = -0.002
    assert_close(normal_force(problem.solve()), E * (D - 0.002) - k * (0.002 - c))


def test_a_spring_without_stiffness_at_rest_is_stretched_and_pressed():
    """Its force is k b |b|: E (d - b) = k b |b|."""
    k = 2e5
    body, problem = pressed(
        lambda b: b.at_bottom() * k / 3 * abs(b.u[1]) ** 3 * ufl.ds, height=-1.0
    )
    for d in (-0.01, 0.02):
        body.move_top(0.0, d)
        b = np.sign(d) * (-E + np.sqrt(E**2 + 4 * k * E * abs(d))) / (2 * k)
        assert_close(problem.solve().tables["contact"].un - 1.0, np.full(3, b))


def test_a_spring_beside_a_pair_begins_to_act_after_some_way():
    """E b = R on the lower block, E (d - b) + k (c - b) = R on the upper."""
    k = 3000.0
    both = two_blocks((2, 1), (2, 1), depth=1.0)
    both.top.interpolate(lambda x: np.stack([0 * x[0], -D + 0 * x[0]]))
    tags = mesh.meshtags(
        both.domain, 1, np.sort(both.slave), np.full(len(both.slave), 7, dtype=np.int32)
    )
    ds = ufl.Measure("ds", both.domain, subdomain_data=tags)
    energy = materials.LinearElastic.from_young(E, 0.0).energy(both.u) * ufl.dx
    energy += k / 2 * ufl.max_value(-both.u[1] - C, 0.0) ** 2 * ds(7)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Frictionless())
    problem = ContactProblem(energy, both.u, [pair], bcs=both.bcs)
    result = problem.solve()
    assert_close(normal_force(result), E * (E * D + k * C) / (2 * E + k))


@dataclass(frozen=True)
class Straps(Interface):
    """Straps remaining slack up to an opening."""

    stiffness: Any
    slack: Any
    damage: Any = 0.0
    internal = (Internal("damage", "grows", end=1.0),)

    def energy(self, state):
        pulled = ufl.max_value(state.opening - self.slack, 0.0)
        return (1 - state["damage"]) * self.stiffness / 2 * pulled**2

    def dissipation(self, rates, state):
        return 1e6 * rates["damage"]


@pytest.mark.parametrize(
    ("slack", "opening"), [(0.002, 16.0 / 4000.0), (0.02, 0.01), (0.0, 10.0 / 4000.0)]
)
def test_straps_of_an_interface_are_slack_up_to_an_opening(slack, opening):
    body = block()
    body.move_top(0.0, 0.01)
    found = body.problem(Straps(3000.0, slack)).solve().tables["contact"].un
    assert_close(found, np.full(3, opening), 1e-7)


@dataclass(frozen=True)
class Orowan(FrictionLaw):
    """Friction min(F p, cap)."""

    friction: Any
    cap: Any

    def bound(self, a, p):
        return ufl.min_value(self.friction * p, self.cap)


def sheared(law):
    """A strip that is pressed and sheared as gamma grows."""
    body = block((4, 2), (1.0, 0.5), "tri")
    gamma = fem.Constant(body.domain, 1.0)
    way = ufl.as_vector((0.02 * gamma, -0.005 * (1 + gamma)))
    problem = body.problem(law, body.elastic(E, 0.3))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    system.set_parameter(1.0)
    return system


def test_shear_of_capped_friction_is_within_the_bound_point_by_point():
    system = sheared(Orowan(0.5, 6.0))
    tables = [system.problem.solve().tables["contact"]]
    tables += [r.tables["contact"] for r in results_at(system, solved_start(system), 1.5)]
    for table in tables:
        shear = np.abs(table.rt[:, 0]) / table.area
        bound = np.minimum(0.5 * table.rn / table.area, 6.0)
        assert np.all(shear <= bound * (1 + 1e-6) + 1e-9)
        slips = np.isin(table.letters, ["+", "-"])
        assert slips.sum() > 2
        assert_close(shear[slips], bound[slips])


ALGORITHMS = ("newton", "lemke", "gauss-seidel", "uzawa", "tresca", "interior-point")


@pytest.mark.parametrize("kinked", [True, False])
def test_classical_algorithms_are_right_or_refuse_a_spring(kinked):
    """E (d - g) = k (g - c) + R on a floor at -g; they need a linear body, Newton does not."""
    k, g = 1000.0, 0.003
    c = C if kinked else 0.0

    def spring(body):
        way = ufl.max_value(-body.u[1] - c, 0.0) if kinked else body.u[1]
        return body.at_bottom() * k / 2 * way**2 * ufl.ds

    body, problem = pressed(spring, height=-g, law=Coulomb(0.2))
    found = []
    for name in ALGORITHMS:
        body.u.x.array[:] = 0.0
        try:
            found.append(normal_force(problem.solve(algorithm=name)))
        except ValueError:
            assert kinked
        except ConvergenceError:
            pass
    assert len(found) > (0 if kinked else 3)
    assert_close(found, np.full(len(found), E * (D - g) - k * (g - c)), 1e-5)


def test_a_modulus_switched_by_a_field_is_read_in_each_solve():
    body = block()
    body.move_top(0.0, -D)
    heat = fem.Function(fem.functionspace(body.domain, ("Lagrange", 1)))
    young = ufl.conditional(ufl.gt(heat, 0.0), 1000.0, 500.0)
    problem = body.problem(bulk=body.elastic(young))
    for value, modulus in ((1.0, 1000.0), (-1.0, 500.0), (1e-12, 1000.0)):
        heat.x.array[:] = value
        assert_close(normal_force(problem.solve()), D * modulus)


def test_a_modulus_switched_by_the_place_leaves_the_solution_proved():
    body = block()
    body.move_top(0.0, -D)
    left = ufl.lt(ufl.SpatialCoordinate(body.domain)[0], 0.5)
    problem = body.problem(bulk=body.elastic(ufl.conditional(left, 1000.0, 500.0)))
    result = problem.solve()
    assert_close(normal_force(result), 7.5, 0.02)
    assert verdict(problem) == "proved"


def softening(k):
    """A hanging column, pulled by 1; its end softens by ``k`` beyond a way of 0.002."""
    body = block((2, 1))
    gamma = fem.Constant(body.domain, 1.0)
    energy = body.elastic() + gamma * body.u[1] * body.at_bottom() * ufl.ds
    if k:
        soft = ufl.max_value(-body.u[1] - 0.002, 0.0) ** 2
        energy -= k / 2 * soft * body.at_bottom() * ufl.ds
    problem = body.problem(bulk=energy, obstacle=floor(-0.05))
    result = problem.solve()
    assert_close(0.05 - result.tables["contact"].un, np.full(3, 0.001))
    system = ParametricContact(problem, gamma)
    start = system.create_vector()
    problem.write(start)
    found = find_solutions(system, [start], 1.0, lengths=(0.5,), max_iterations=20)
    return verdict(problem), found


def test_the_second_state_behind_a_kink_is_not_denied():
    """b = q / E, and b = (k c - q) / (k - E) beyond the kink."""
    unique, found = softening(2000.0)
    assert unique != "proved"
    assert not found.complete or len(found.found) >= 2


def test_the_only_state_without_a_kink_is_proved():
    unique, found = softening(0.0)
    assert unique == "proved"
    assert found.complete
    assert len(found.found) == 1


# --- data with kinks and jumps in gamma ---

SHAPES = {  # in UFL and in numbers
    "affine": (lambda g: g, lambda g: g),
    "held": (lambda g: ufl.min_value(g, 1.0), lambda g: min(g, 1.0)),
    "turning": (lambda g: 1 - abs(g - 1), lambda g: 1 - abs(g - 1)),
    "late": (lambda g: ufl.max_value(g - 1, 0.0), lambda g: max(g - 1, 0.0)),
    "jump": (
        lambda g: g + ufl.conditional(ufl.ge(g, 1.0), 0.4, 0.0),
        lambda g: g + 0.4 * (g >= 1.0),
    ),
}


def loaded(kind, way):
    """A column under data of gamma, and the offset and slope of its contact force in ``way``."""
    body = block((1, 1), cell="tri")
    gamma = fem.Constant(body.domain, 0.5)
    way = way(gamma)
    energy, obstacle, bcs, driven, force = body.elastic(), None, body.bcs, [], (0.0, 10.0)
    if kind == "top":
        driven = [(body.moved, ufl.as_vector((0.0, -0.01 * way)))]
    elif kind == "floor":
        obstacle = RigidBody(floor(), about=(0.5, 0.0), held=["x", "rz"], motion={"y": 0.01 * way})
    elif kind == "plate":
        obstacle = RigidBody(floor(), about=(0.5, 0.0), held=["x", "rz"], load={"y": 5.0 * way})
        force = (0.0, 5.0)
    elif kind == "load":
        body.move_top(0.0, -D)
        energy += 5.0 * way * body.at_bottom() * body.u[1] * ufl.ds
        force = (10.0, 5.0)
    else:  # thermal strain between rigid sides
        body.move_top(0.0, -0.001)
        eps = ufl.sym(ufl.grad(body.u)) - 0.01 * way * ufl.Identity(2)
        energy = 500.0 * ufl.inner(eps, eps) * ufl.dx
        across, _ = body.V.sub(0).collapse()
        all_dofs = fem.locate_dofs_geometrical((body.V.sub(0), across), lambda x: x[0] > -1.0)
        bcs = [*bcs, fem.dirichletbc(fem.Function(across), all_dofs, body.V.sub(0))]
        force = (1.0, 10.0)
    problem = body.problem(bulk=energy, obstacle=obstacle, bcs=bcs)
    return ParametricContact(problem, gamma, driven=driven), force


KINDS = [
    ("top", "affine"),
    ("top", "held"),
    ("floor", "affine"),
    ("floor", "turning"),
    ("plate", "held"),
    ("load", "affine"),
    ("load", "turning"),
    ("strain", "affine"),
    ("strain", "late"),
]


@pytest.mark.parametrize(("kind", "shape"), KINDS)
def test_solutions_behind_a_kink_in_gamma_are_right(kind, shape):
    way, number = SHAPES[shape]
    system, (offset, slope) = loaded(kind, way)
    start = solved_start(system, 0.5)
    for at in (0.5, 1.7):
        forces = [normal_force(r) for r in results_at(system, start, at)]
        assert_close(forces, [offset + slope * number(at)])


@pytest.mark.parametrize(("kind", "shape"), KINDS)
def test_a_branch_leads_over_a_kink_in_gamma(kind, shape):
    way, number = SHAPES[shape]
    system, (offset, slope) = loaded(kind, way)
    start = solved_start(system, 0.5)
    control = StepControl(minimum=1e-6, corrections=4)
    options = dict(gamma_range=(0.5, 1.8), control=control)
    if shape == "late":  # gamma changes nothing at the start
        with pytest.raises(ValueError, match="gamma does not appear in H"):
            follow(system, start, 0.5, **options)
        return
    branch = follow(system, start, 0.5, **options)
    assert_close(branch.points[-1].gamma, 1.8)
    assert_close(normal_force(system.result_at(branch.points[-1])), offset + slope * number(1.8))
    for at in (0.75, 1.5):
        points = points_at(system, branch, at, gamma_range=(0.5, 1.8))
        forces = [normal_force(system.result_at(p)) for p in points]
        assert_close(forces, [offset + slope * number(at)])


@pytest.mark.parametrize("kind", ["top", "floor", "load"])
@pytest.mark.parametrize("shape", ["affine", "jump"])
def test_points_of_a_branch_up_to_a_jump_are_solutions(kind, shape):
    """No branch leads over a jump of the data: points beyond are solutions, or there are none."""
    way, number = SHAPES[shape]
    system, (offset, slope) = loaded(kind, way)
    start = solved_start(system, 0.5)
    control = StepControl(minimum=0.02, corrections=4)
    branch = follow(system, start, 0.5, gamma_range=(0.5, 1.6), control=control)
    assert branch.points[-1].gamma > 0.9
    for point in branch.points:
        force = normal_force(system.result_at(point))
        assert_close(force, offset + slope * number(point.gamma))


def test_solutions_behind_a_step_of_the_load_are_right():
    """The load is a Constant, changed after construction, times 1 up to gamma = 1, then 3."""
    body = block((2, 1), cell="tri")
    body.move_top(0.0, -D)
    gamma = fem.Constant(body.domain, 0.0)
    force = fem.Constant(body.domain, (0.0, 7.0))
    step = ufl.conditional(ufl.lt(gamma, 1.0), 1.0, 3.0)
    load = step * ufl.dot(force, body.u) * body.at_bottom() * ufl.ds
    system = ParametricContact(body.problem(bulk=body.elastic() + load), gamma)
    force.value[1] = 1.0
    start = solved_start(system)
    for at, expected in ((0.5, 11.0), (2.0, 13.0)):
        assert_close([normal_force(r) for r in results_at(system, start, at)], [expected])
    system.set_parameter(0.0)
    with pytest.raises(ValueError, match="gamma does not appear in H"):
        explore(system, [(start, 0.0)], gamma_range=(0.0, 2.0))


def test_loads_that_are_not_affine_are_right_by_every_route():
    """A load exp(gamma) and a top coming down with gamma^3: E d gamma^3 + exp(gamma)."""
    body = block()
    gamma = fem.Constant(body.domain, 0.0)
    energy = body.elastic() + ufl.exp(gamma) * body.u[1] * body.at_bottom() * ufl.ds
    way = ufl.as_vector((0.0 * gamma, -0.01 * gamma**3))
    problem = body.problem(Coulomb(0.2), energy)
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    start = solved_start(system, 0.5)
    right = 10 * 1.5**3 + np.exp(1.5)
    assert_close([normal_force(r) for r in results_at(system, start, 1.5)], [right])
    for route in ("auto", "steps"):
        system.set_parameter(0.5)
        branch = follow(system, start, 0.5, gamma_range=(0.5, 1.5), route=route)
        assert_close(normal_force(system.result_at(branch.points[-1])), right)
    system.set_parameter(0.5)
    with pytest.raises(ValueError, match="affine"):
        follow(system, start, 0.5, gamma_range=(0.5, 1.5), route="pivoting")


def test_kinks_of_floor_and_friction_in_gamma_are_passed():
    """All slips: Q/P is the friction max(0.1, 20 gamma); the floor is at 0.01 - |gamma - 0.01|."""
    body = block((2, 1), cell="tri")
    body.move_top(0.5, 0.0)
    gamma = fem.Constant(body.domain, 0.005)
    rising = LevelSet(lambda x: x[1] - (0.01 - abs(gamma - 0.01)))
    problem = body.problem(Coulomb(ufl.max_value(0.1, 20 * gamma)), obstacle=rising)
    system = ParametricContact(problem, gamma)
    start = solved_start(system)
    for result in results_at(system, start, 0.012):
        x, y = result.resultants["contact"]
        assert_close(-x / y, 0.24)
    last = follow(system, start, 0.005, gamma_range=(0.002, 0.015)).points[-1]
    assert_close(last.gamma, 0.015)
    end = system.result_at(last).resultants["contact"]
    system.set_parameter(0.015)
    assert_close(end, problem.solve().resultants["contact"])
    assert_close(-end[0] / end[1], 0.3)


@pytest.mark.parametrize("shape", ["affine", "turning"])
def test_a_path_under_a_load_that_turns_ends_at_the_kink(shape):
    """Friction remembers; the right answer is a history whose load knows of no gamma."""
    symbolic, number = SHAPES[shape]

    def dragged():
        body = block((3, 2), (1.0, 0.5))
        return body, body.problem(Coulomb(0.3))

    body, problem = dragged()
    body.move_top(0.0, -D)
    problem.solve()
    history = QuasiStatic(problem, lambda t: body.move_top(0.02 * number(t), -D)).run(
        [0.0, 0.4, 0.8, 1.0, 1.2, 1.4, 1.6]
    )
    expected = history.steps[-1].result.resultants["contact"]
    body, problem = dragged()
    gamma = fem.Constant(body.domain, 0.0)
    way = ufl.as_vector((0.02 * symbolic(gamma), -D + 0 * gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    solved_start(system, 0.0)
    control = StepControl(initial=0.05, maximum=0.2, minimum=1e-4)
    path = ArcLength(system).run(gamma_range=(0.0, 1.6), control=control, max_steps=200)
    if shape == "turning":
        assert not path.complete
        assert "kinks or jumps in gamma" in path.reason
    else:
        assert_close(path.steps[-1].result.resultants["contact"], expected, 1e-5)


def counts(load, at):
    """Numbers of solutions of Hild's triangle in small cells of a chart about (m, gamma = 1)."""
    domain = triangle()
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    below = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    gamma = fem.Constant(domain, 1.0)
    m = fem.Constant(domain, 0.0)
    force = 6 * ufl.as_vector((-load(gamma, m), -1.0 + 0 * m))  # a body force f: f / 6 at the node
    energy = materials.LinearElastic(1.0, 1.0).energy(u) * ufl.dx - ufl.dot(force, u) * ufl.dx
    contact = ContactSurface(u, below, obstacle=floor(), law=Coulomb(3.0))
    system = ParametricContact(ContactProblem(energy, u, [contact], bcs=[held]), gamma)
    family = contact_family(system, m, mu_range=(0.0, 1.0))
    numbers = []
    for value in at:
        chart = count_solutions(
            family,
            mu_range=(value - 1e-3, value + 1e-3),
            gamma_range=(1.0 - 1e-3, 1.0 + 1e-3),
            cells=(1, 1),
            depth=0,
        )
        numbers.append([len(c.solutions) for c in chart.cells])
    return numbers


def test_a_chart_of_a_load_that_vanishes_at_all_samples_is_refused():
    """p = 1.5 gamma + 20 m (m - 1/2) (1 - m) has one solution at m = 0.2, three at 0.8."""
    with pytest.raises(ValueError, match="affine in the second parameter"):
        counts(lambda g, m: 1.5 * g + 20 * m * (m - 0.5) * (1 - m), (0.2, 0.8))


def test_a_chart_of_an_affine_load_counts_one_and_three():
    assert counts(lambda g, m: 1.5 * g + m, (0.2, 0.8)) == [[1], [3]]


# --- damping with kinks ---


def kinetic(form, *, density=lambda u: 2.0, speed=1.0, dt=0.05, steps=4):
    """Kinetic energy of a body sliding freely under a damping form after some steps."""
    body = block()
    problem = body.problem(obstacle=floor(-1.0), bcs=[])
    velocity = fem.Function(body.V)
    velocity.interpolate(lambda x: np.stack([speed + 0 * x[0], 0 * x[0]]))
    drag = form(velocity, ufl.TestFunction(body.V)) * ufl.dx
    motion = NSCD(
        problem, density(body.u), dt=dt, velocity=velocity, damping=drag, mass="consistent"
    )
    return motion.run([0.0, steps * dt]).energies.kinetic


DRY = {
    "sign": lambda v, w: ufl.sign(v[0]) * w[0],
    "root": lambda v, w: v[0] / ufl.sqrt(v[0] ** 2) * w[0],
    "condition": lambda v, w: ufl.conditional(ufl.gt(v[0], 0), 1.0, -1.0) * w[0],
}


@pytest.mark.parametrize("name", DRY)
def test_dry_damping_is_refused(name):
    with pytest.raises(ValueError, match="damping"):
        kinetic(DRY[name])


def test_a_density_of_the_displacement_is_refused():
    with pytest.raises(ValueError, match="density"):
        kinetic(lambda v, w: 1e-6 * v[0] * w[0], density=lambda u: 2.0 * (1 + u[0] ** 2))


@pytest.mark.parametrize(("wind", "start"), [(1.5, 0.0), (0.0, 1.5)])
def test_wind_carries_a_body_along(wind, start):
    """rho v' = -c (v - w) by the midpoint rule: v += (w - v) c dt / (rho + c dt / 2)."""
    w = ufl.as_vector((wind, 0.0))
    expected = start
    for _ in range(4):
        expected += (wind - expected) * 0.3 / (2.0 + 0.15)
    found = kinetic(lambda v, test: 3.0 * ufl.dot(v - w, test), speed=start, dt=0.1)
    assert_close(found, expected**2)
