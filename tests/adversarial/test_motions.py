"""Assumption: mass, damping and Dirichlet data of a motion do not change.

Free bodies under uniform forces move like points, whatever their density, damping and mesh.
Supported bodies follow their data. Changes during a run that the method cannot follow raise an
error. Inconsistent masses and velocities give a warning with a number.
"""

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from support.bodies import block, floor, move
from support.checks import assert_close, assert_warned

import ufl
from dolfinx import fem

from dolfinx_contact import Coulomb, HalfSpace
from dolfinx_contact.evolution import NSCD

COMM = MPI.COMM_WORLD


@dataclass
class Flying:
    """A body without supports under a uniform force per volume, far above the floor."""

    u: fem.Function
    velocity: fem.Function
    problem: Any

    def run(self, times=(0.0, 1.0), density=1.0, mass="consistent", **options):
        motion = NSCD(self.problem, density, velocity=self.velocity, mass=mass, **options)
        return motion.run(list(times))

    def constant(self, value):
        return fem.Constant(self.u.function_space.mesh, value)

    def mean(self, f=None):
        """Mean of a vector field over the body, by default of the velocity."""
        f = self.velocity if f is None else f
        parts = [fem.assemble_scalar(fem.form(f[k] * ufl.dx)) for k in range(len(f))]
        return [COMM.allreduce(part) for part in parts]


def flying(force, cells=(2, 2), cell=None, young=1000.0, degree=1):
    body = block(cells, cell=cell, degree=degree)
    f = fem.Constant(body.domain, force)
    bulk = body.elastic(young, 0.2) - ufl.dot(f, body.u) * ufl.dx
    problem = body.problem(bulk=bulk, obstacle=floor(-100.0, len(cells)), bcs=[])
    return Flying(body.u, fem.Function(body.V), problem)


REFUSED = "the load at the time .* changes"


@pytest.mark.parametrize("later", [pytest.param(4.0, marks=pytest.mark.sample), 1.0])
def test_a_density_changed_by_the_load_is_refused(later):
    """The velocity would be the integral of force over density."""
    body = flying((0.0, 2.0))
    density = body.constant(1.0)

    def load(t):
        density.value = later if t > 0.5 else 1.0

    def run():
        body.run((0.0, 0.5, 1.0), density, dt=0.1, load=load)

    if later == 1.0:
        run()
        assert_close(body.mean(), [0.0, 2.0])
    else:
        with pytest.raises(ValueError, match=REFUSED):
            run()


def test_a_field_of_density_changed_between_runs_counts():
    body = flying((0.0, 1.0, 2.0), (2, 1, 1), "tet")
    density = fem.Function(fem.functionspace(body.u.function_space.mesh, ("DG", 0)))
    density.x.array[:] = 1.0
    motion = NSCD(body.problem, density, dt=0.25, velocity=body.velocity, mass="lumped")
    motion.run([0.0, 0.5])
    assert_close(body.mean(), [0.0, 0.5, 1.0])
    density.x.array[:] = 4.0
    motion.run([0.5, 1.0])
    assert_close(body.mean(), [0.0, 0.625, 1.25])


@pytest.mark.parametrize("later", [6.0, 2.0])
def test_a_damping_changed_by_the_load_is_refused(later):
    """Each component of the velocity decays by its own coefficient."""
    body = flying((0.0, 0.0))
    c = body.constant((1.0, 2.0))
    move(body.velocity, 1.0, 2.0)
    w = ufl.TestFunction(body.u.function_space)
    damping = sum(c[k] * body.velocity[k] * w[k] for k in range(2)) * ufl.dx

    def load(t):
        c.value[1] = later if t > 0.5 else 2.0

    def run():
        body.run((0.0, 0.5, 1.0), dt=0.05, load=load, damping=damping)

    if later == 2.0:
        run()
        assert_close(body.mean(), [np.exp(-1.0), 2 * np.exp(-2.0)], 5e-3)
    else:
        with pytest.raises(ValueError, match=REFUSED):
            run()


def test_rayleighs_damping_by_a_constant_is_refused():
    """Its factors are numbers, so a load cannot change them during a run."""
    body = flying((0.0, 0.0))
    damping = (body.constant(0.0), 0.0)
    with pytest.raises(ValueError, match="damping must be a form or a pair of numbers"):
        body.run((0.0, 0.5, 1.0), dt=0.05, load=lambda t: None, damping=damping)


@pytest.mark.sample
def test_a_wind_that_turns_is_a_load():
    """v' = (c / rho) (w - v) by implicit Euler's rule."""
    body = flying((0.0, 0.0))
    V = body.u.function_space
    wind = fem.Function(V)
    damping = 2.0 * ufl.dot(body.velocity - wind, ufl.TestFunction(V)) * ufl.dx

    def load(t):
        move(wind, 1.0 if t < 0.5 + 1e-9 else -3.0, 0.0)

    history = body.run((0.0, 0.5, 1.0), dt=0.1, load=load, damping=damping, theta=1.0)
    end = 0.0
    for towards in [1.0] * 5 + [-3.0] * 5:
        end = (end + 0.2 * towards) / 1.2
    assert_close(body.mean(), [end, 0.0])
    assert_close(history.energies.kinetic, end**2 / 2)


def softened(later, b, start=None, velocity=None, at=0.0):
    """A motion whose modulus falls from 900 to ``later`` at t = 0.04; its displacement, velocity.

    Args:
        later: modulus after t = 0.04.
        b: factor of Rayleigh's damping of the stiffness.
        start: displacement at the beginning.
        velocity: velocity at the beginning.
        at: time of the beginning: 0, or 0.04 for a motion of the modulus 300.
    """
    body = block()
    young = fem.Constant(body.domain, 300.0 if at else 900.0)
    force = fem.Constant(body.domain, (20.0, 0.0))
    energy = body.elastic(young, 0.2) - ufl.dot(force, body.u) * ufl.dx
    problem = body.problem(bulk=energy, obstacle=floor(-1.0))
    v = fem.Function(body.V)
    if start is not None:
        body.u.x.array[:] = start
        v.x.array[:] = velocity

    def load(t):
        young.value = later if t > 0.04 + 1e-9 else (300.0 if at else 900.0)

    options = dict(load=load, velocity=v, theta=1.0, mass="lumped", damping=(0.0, b))
    return NSCD(problem, 1.0, dt=0.01, **options), body.u, v


def test_a_stiffness_that_falls_is_followed():
    """The right answer is a motion in two pieces."""
    motion, u, v = softened(300.0, 0.0)
    motion.run([0.0, 0.04, 0.08])
    first, u1, v1 = softened(900.0, 0.0)
    first.run([0.0, 0.04])
    second, u2, v2 = softened(300.0, 0.0, u1.x.array, v1.x.array, 0.04)
    second.run([0.04, 0.08])
    assert np.abs(u.x.array).max() > 0
    assert_close(u.x.array, u2.x.array)
    assert_close(v.x.array, v2.x.array)


def test_a_stiffness_that_falls_and_damps_is_refused():
    motion, _, _ = softened(300.0, 0.01)
    with pytest.raises(ValueError, match=REFUSED):
        motion.run([0.0, 0.04, 0.08])


# --- masses ---


def turn_of(body):
    """Difference of the vertical displacements of the right and the left side."""
    x = body.u.function_space.tabulate_dof_coordinates()
    u = body.u.x.array.reshape(-1, 2)
    sides = [COMM.allgather(u[np.isclose(x[:, 0], at), 1]) for at in (0.0, 1.0)]
    return np.mean(np.concatenate(sides[1])) - np.mean(np.concatenate(sides[0]))


def test_a_consistent_mass_lets_a_coarse_body_fall_without_turning():
    body = flying((0.0, -2.0), (1, 1), "tri", young=1e5)
    body.run(dt=0.1)
    assert_close(body.mean(body.u), [0.0, -1.0], 0.01)
    assert_close(turn_of(body), 0.0, 0.01)


def test_the_default_mass_of_a_coarse_body_is_warned_of(caplog):
    """The body rotates although it should only fall."""
    body = flying((0.0, -2.0), (1, 1), "tri", young=1e5)
    body.run(dt=0.1, mass="redistributed")
    assert_warned(caplog, "mass.*[0-9] ?%")


@pytest.mark.parametrize("mass", ["lumped", "redistributed"])
def test_masses_of_quadratic_triangles_fall_as_points(mass):
    """Row sums are zero at their corners."""
    body = flying((0.0, -2.0), cell="tri", degree=2)
    history = body.run((0.0, 0.5), dt=0.1, mass=mass)
    assert_close(body.mean(body.u)[1], -0.25, 0.01)
    assert_close(history.energies.kinetic, 0.5, 0.02)


# --- Dirichlet data and obstacles ---


def test_a_static_solution_stays_at_rest():
    body = block()
    body.move_top(0.0, -0.01)
    problem = body.problem(bulk=body.elastic(1000.0, 0.2))
    problem.solve()
    history = NSCD(problem, 1.0, dt=0.01).run([0.0, 0.03])
    assert_close([step.energies.kinetic for step in history.steps], np.zeros(3), 1e-12)


def error_of_the_top(way, speed):
    """Largest error of the velocity of a driven top at the ends of steps."""
    body = block(cell="tri")
    problem = body.problem(Coulomb(0.3), body.elastic(1000.0, 0.2))
    velocity = fem.Function(body.V)
    dofs = fem.locate_dofs_topological(body.V, 1, body.top)
    off = []

    def look(step):
        top = velocity.x.array.reshape(-1, 2)[dofs, 0]
        off.append(np.max(np.abs(top - speed(step.time)), initial=0.0))

    def load(t):
        body.move_top(way(t), -0.1 * way(t))

    motion = NSCD(problem, 1.0, dt=0.01, load=load, velocity=velocity)
    motion.run([0.0, 0.05], observer=look)
    return max(part for parts in COMM.allgather(off) for part in parts)


def test_a_drive_that_begins_smoothly_has_its_velocity_at_the_ends_of_steps():
    assert_close(error_of_the_top(lambda t: t**2, lambda t: 2 * t), 0.0, 1e-9)


def test_a_drive_from_rest_with_a_kink_is_warned_of(caplog):
    """The velocity of the top oscillates about the prescribed velocity."""
    error_of_the_top(lambda t: 0.2 * t, lambda t: 0.2)
    assert_warned(caplog, "velocities.*[0-9]")


def test_a_body_thrown_along_rollers_keeps_its_velocity():
    body = block((1, 1), degree=2)
    dofs = body.dofs_of(1, body.top)
    roller = fem.dirichletbc(fem.Constant(body.domain, 0.0), dofs, body.V.sub(1))
    problem = body.problem(obstacle=floor(-5.0), bcs=[roller])
    velocity = fem.Function(body.V)
    move(velocity, 1.0, 0.0)
    NSCD(problem, 1.0, dt=0.01, velocity=velocity, mass="consistent").run([0.0, 0.04])
    along, across = velocity.x.array.reshape(-1, 2).T
    assert_close(along, np.ones_like(along))
    assert_close(across, np.zeros_like(across), 1e-9)


@pytest.mark.parametrize("whole", [True, False], ids=["vector Constant", "Constant in an array"])
def test_a_floor_that_rises_pushes_a_body_at_rest(whole):
    body = block()
    at = fem.Constant(body.domain, (0.0, 0.0) if whole else 0.0)
    point = at if whole else np.array([0.0, at])
    obstacle = HalfSpace(point=point, normal=(0.0, 1.0))
    problem = body.problem(bulk=body.elastic(1000.0, 0.2), obstacle=obstacle, bcs=[])

    def load(t):
        if whole:
            at.value[1] = 0.5 * t
        else:
            at.value = 0.5 * t

    lowest = []

    def look(step):
        x = body.V.tabulate_dof_coordinates()[:, 1]
        lowest.append(np.min(x + body.u.x.array[1::2] - 0.5 * step.time, initial=1.0))

    motion = NSCD(problem, 1.0, dt=0.01, load=load, mass="redistributed")
    history = motion.run([0.0, 0.05], observer=look)
    assert min(min(parts) for parts in COMM.allgather(lowest)) > -1e-8
    assert sum(0.01 * s.result.resultants["contact"][1] for s in history.steps) > 0.01


def meet(length, mass):
    """A block meeting a floor, in units of length and mass; results in those units."""
    body = block((2, 2), (length, length))
    # Of unit thickness: density is mass / length^2, modulus mass, force mass / length.
    force = fem.Constant(body.domain, (0.0, -10.0 * mass / length))
    energy = body.elastic(1000.0 * mass, 0.2) - ufl.dot(force, body.u) * ufl.dx
    problem = body.problem(Coulomb(0.3), energy, obstacle=floor(-0.002 * length), bcs=[])
    velocity = fem.Function(body.V)
    move(velocity, 0.1 * length, -0.3 * length)
    motion = NSCD(problem, mass / length**2, dt=0.005, velocity=velocity, damping=(1.0, 1e-4))
    last = motion.run([0.0, 0.04]).steps[-1]
    table = last.result.tables["contact"]
    forces = np.column_stack([table.rn, table.rt]) / mass / length
    return forces, body.u.x.array / length, last.energies.kinetic / mass / length**2


@pytest.mark.sample
def test_an_impact_does_not_depend_on_units():
    expected = meet(1.0, 1.0)
    assert np.max(expected[0]) > 0
    for one, other in zip(meet(1e9, 1e12), expected, strict=True):
        assert_close(one, other)
