"""Assumption: data do not change after the problem is made.

Users change Constants, Functions and arrays, or set attributes, between two calls. New values of
Constants and Functions lead to the answer for the new data. Arrays and lists are copied. Any other
change raises an error.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, floor, friction_ratio, move, normal_force, two_blocks
from support.checks import assert_close, solved_start

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    HalfSpace,
    ParametricContact,
    RigidBody,
    Sphere,
    materials,
)
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.laws import FrictionLaw

COMM = MPI.COMM_WORLD


def lowered(law=None, *, aside=0.0, obstacle=None):
    """A block whose top is lowered by 0.01, and its surface."""
    body = block((2, 1))
    body.move_top(aside, -0.01)
    problem = body.problem(law, obstacle=obstacle)
    return body, problem, problem.surfaces[0]


def ratio_of(problem):
    return friction_ratio(problem.solve().tables["contact"])


class Searched:
    """A block under Constants, and all that is computed only on its contact points."""

    def __init__(self, young, friction, size):
        body = block((2, 1))
        self.young = fem.Constant(body.domain, young)
        self.size = fem.Constant(body.domain, size)
        gamma = fem.Constant(body.domain, 0.0)
        self.problem = body.problem(Coulomb(friction), body.elastic(self.young))
        way = self.size * gamma * ufl.as_vector((0.002, -0.01))
        self.system = ParametricContact(self.problem, gamma, driven=[(body.moved, way)])

    def answers(self):
        """Whether the search is complete, its contact forces, Lemke's forces, and S."""
        system = self.system
        found = find_solutions(system, [system.create_vector()], 1.0, proof_seconds=5.0)
        forces = [system.result_at(p).resultants["contact"] for p in found.points(system)]
        system.set_parameter(1.0)
        lemke = self.problem.solve(algorithm="lemke").resultants["contact"]
        return found.complete, forces, lemke, self.problem.reduced().S


@pytest.mark.sample
def test_searches_and_condensations_follow_the_data():
    changed = Searched(1000.0, 0.1, 1.0)
    for young, friction, size in ((1000.0, 0.1, 1.0), (400.0, 0.4, 1.0), (400.0, 0.1, 3.0)):
        changed.young.value = young
        changed.size.value = size
        changed.problem.surfaces[0].law.friction.value = friction
        complete, *found = changed.answers()
        expected = Searched(young, friction, size).answers()
        assert complete == expected[0]
        for one, other in zip(found, expected[1:], strict=True):
            assert_close(one, other)
        assert_close(found[1][1], young * 0.01 * size)


@pytest.mark.sample
def test_friction_that_is_changed_counts_in_the_next_solve():
    _, problem, contact = lowered(Coulomb(0.1), aside=0.05)
    for friction in (0.1, 0.3, 0.2):
        contact.law.friction.value = friction
        assert_close(ratio_of(problem), friction)


def test_a_field_of_friction_counts_by_its_values():
    """Contact of degree 2 in micrometres: Q is the sum of coefficient times force."""
    body = block((2, 1), (1e-6, 1e-6), degree=2)
    body.move_top(1e-7, -1e-8)
    field = fem.Function(fem.functionspace(body.domain, ("Lagrange", 1)))
    share = fem.Constant(body.domain, 1.0)
    problem = body.problem(Coulomb(field * share), body.elastic(2e11))
    for a, b, c in ((0.1, 0.0, 1.0), (0.1, 0.3, 1.0), (0.2, -0.1, 0.5)):
        field.interpolate(lambda x, a=a, b=b: a + b * x[0] * 1e6)
        share.value = c
        table = problem.solve().tables["contact"]
        friction = c * (a + b * table.x[:, 0] * 1e6)
        assert_close(np.sum(table.rt[:, 0]), -np.sum(friction * table.rn))
        assert np.all(table.letters == "+")


@dataclass(frozen=True)
class Graded(FrictionLaw):
    """Friction of two factors."""

    factor: Any
    other: Any

    def bound(self, a, p):
        return self.factor * self.other * p


def test_numbers_of_a_law_of_ones_own_change_by_their_values():
    _, problem, contact = lowered(Graded(0.2, 1.0), aside=0.05)
    assert_close(ratio_of(problem), 0.2)
    contact.law.other.value = 1.5
    assert_close(ratio_of(problem), 0.3)
    contact.law.factor.value = 0.1
    assert_close(ratio_of(problem), 0.15)


def test_a_floor_follows_its_constant():
    body = block((2, 1))
    body.move_top(0.0, -0.01)
    at = fem.Constant(body.domain, (0.0, 0.0))
    problem = body.problem(obstacle=HalfSpace(point=at, normal=(0.0, 1.0)))
    for height in (0.0, 0.02, -0.005, -0.02, 0.01):
        at.value[1] = height
        assert_close(normal_force(problem.solve()), max(0.0, 1000.0 * (0.01 + height)))


def test_an_array_given_to_an_obstacle_is_copied():
    at = np.zeros(2)
    _, problem, _ = lowered(obstacle=HalfSpace(point=at, normal=(0.0, 1.0)))
    assert_close(normal_force(problem.solve()), 10.0)
    at[1] = 0.02
    assert_close(normal_force(problem.solve()), 10.0)


def pair_with_a_gap():
    """Blocks of heights 1 and 1/2, springs in a row: the force is E (d - gap) / 1.5."""
    both = two_blocks((2, 1), (2, 1))
    gap = fem.Constant(both.domain, 0.0)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(0.1), gap=gap)
    move(both.top, 0.0, -0.01)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    return gap, pair, ContactProblem(steel.energy(both.u) * ufl.dx, both.u, [pair], bcs=both.bcs)


def test_the_gap_of_a_pair_follows_its_constant():
    gap, _, problem = pair_with_a_gap()
    for size in (0.0, 0.004, 0.02, 0.006):
        gap.value = size
        assert_close(normal_force(problem.solve()), 1000.0 / 1.5 * max(0.0, 0.01 - size))


def plate(load):
    return RigidBody(
        HalfSpace(point=(0.5, 0.0), normal=(0.0, 1.0)),
        about=(0.5, 0.0),
        load=load,
        held=["x", "rz"],
        name="plate",
    )


def test_the_load_of_a_rigid_plate_follows_its_constant():
    body = block((2, 1))
    load = fem.Constant(body.domain, 5.0)
    problem = body.problem(obstacle=plate({"y": 2.0 * load}))
    for force in (5.0, 1.0, 8.0):
        load.value = force
        result = problem.solve()
        assert_close(normal_force(result), 2 * force)
        assert_close(result.rigid_bodies["plate"].displacement[1], 2 * force / 1000.0)


def test_a_dictionary_of_loads_is_copied():
    given = {"y": 5.0}
    problem = block((2, 1)).problem(obstacle=plate(given))
    given["y"] = 7.0
    assert_close(normal_force(problem.solve()), 5.0)


def test_a_list_of_driven_data_is_copied():
    body, problem, _ = lowered()
    gamma = fem.Constant(body.domain, 0.0)
    driven = [(body.moved, ufl.as_vector((0.0, -0.01 - 0.01 * gamma)))]
    system = ParametricContact(problem, gamma, driven=driven)
    x = solved_start(system)
    driven[0] = (body.moved, ufl.as_vector((0.0, -0.01 - 0.04 * gamma)))
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
    assert_close(normal_force(system.result_at(branch.points[-1])), 20.0)


def test_a_condition_added_to_a_problem_is_refused():
    body = block()
    left = mesh.locate_entities_boundary(body.domain, 1, lambda x: np.isclose(x[0], 0.0))
    side = fem.dirichletbc(0.0, body.dofs_of(0, left), body.V.sub(0))
    problem = body.problem(Coulomb(0.1))
    with pytest.raises((ValueError, AttributeError)):
        problem.bcs.append(side)
    with pytest.raises((ValueError, AttributeError)):
        problem.surfaces.append(problem.surfaces[0])


def attributes():
    """Natural assignments: object, name, value."""
    body, problem, contact = lowered(Coulomb(0.1))
    _, pair, _ = pair_with_a_gap()
    ball = Sphere((0.0, -3.0), 3.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    body_motion, _, _, motion = falling()
    system = ParametricContact(problem)
    return [
        (contact, "law", Coulomb(0.2)),
        (contact, "obstacle", floor(0.02)),
        (contact, "method", "mixed"),
        (contact, "sliding", "large"),
        (contact.description, "law", Coulomb(0.2)),
        (contact.description, "facets", body.top),
        (contact.law, "friction", 0.4),
        (pair, "gap", 0.008),
        (floor(), "point", np.array((0.0, 0.02))),
        (floor(), "normal", (0.3, 1.0)),
        (plate({"y": 5.0}), "load", {"y": 10.0}),
        (ball, "radius", 2.0),
        (steel, "mu", 1.0),
        (problem, "bcs", []),
        (problem, "u", body.moved),
        (problem, "surfaces", []),
        (problem, "r", 1e3),
        (system, "driven", []),
        (system, "gamma", fem.Constant(body_motion.domain, 1.0)),
        (motion, "dt", 0.005),
        (motion, "theta", 1.0),
        (motion, "damping", (1.0, 0.0)),
        (motion, "density", 2.0),
    ]


@pytest.mark.sample
def test_attributes_that_would_be_ignored_cannot_be_set():
    for thing, name, value in attributes():
        with pytest.raises((ValueError, AttributeError)):
            setattr(thing, name, value)


def test_the_load_of_a_history_may_be_set_between_runs():
    """Q/P is +-F where all slips; P is E times the way of the top."""
    body, problem, contact = lowered(Coulomb(0.2))
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: body.move_top(0.05 * t, -0.01))
    step = evolution.run([0.0, 0.5, 1.0]).steps[-1]
    assert_close(friction_ratio(step.result.tables["contact"]), 0.2)
    evolution.load = lambda t: body.move_top(0.05 * (2.0 - t), -0.01)
    step = evolution.run([1.0, 1.5, 2.0]).steps[-1]
    assert_close(friction_ratio(step.result.tables["contact"]), -0.2)
    evolution.load = lambda t: body.move_top(0.05 * (2.0 - t), -0.01 * (t - 1.0))
    contact.law.friction.value = 0.4
    step = evolution.run([2.0, 2.5, 3.0]).steps[-1]
    assert_close(friction_ratio(step.result.tables["contact"]), -0.4)
    assert_close(np.sum(step.result.tables["contact"].rn), 20.0)


def falling():
    """A block falling freely: after the time t its mean velocity is -g t, g = 10."""
    body = block((2, 1))
    weight = fem.Constant(body.domain, (0.0, -10.0))
    bulk = body.elastic() - ufl.dot(weight, body.u) * ufl.dx
    problem = body.problem(bulk=bulk, obstacle=floor(-5.0), bcs=[])
    density = fem.Constant(body.domain, 1.0)
    return body, weight, density, NSCD(problem, density, dt=0.01, mass="lumped")


def speed(motion):
    return COMM.allreduce(fem.assemble_scalar(fem.form(motion.velocity[1] * ufl.dx)))


def test_a_weight_changed_between_runs_counts_in_the_next():
    _, weight, _, motion = falling()
    motion.run([0.0, 0.02])
    assert_close(speed(motion), -0.2)
    weight.value[1] = -20.0
    history = motion.run([0.02, 0.04])
    assert_close(speed(motion), -0.6)
    assert_close(np.diff([0.02] + [s.time for s in history.steps]), [0.01] * 2)


def test_a_density_changed_between_runs_counts_in_the_next():
    """The velocity is kept, not the momentum."""
    _, _, density, motion = falling()
    motion.run([0.0, 0.02])
    density.value = 2.0
    motion.run([0.02, 0.04])
    assert_close(speed(motion), -0.3)
