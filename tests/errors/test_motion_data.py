"""Motions whose data are not what they are taken for: refused, or said."""

import logging

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.body.rigid import largest_turn, parts
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD


def body(n=2, cell="tri", *, held=True, height=1.0, young=1000.0, law=None):
    """A square above a floor, held on its top or free, its modulus, and what is prescribed."""
    domain = box(COMM, n, cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Function(V)
    E = fem.Constant(domain, young)
    floor = HalfSpace((0.0, -height), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=law or Frictionless())
    eps = ufl.sym(ufl.grad(u))
    high = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    bcs = [fem.dirichletbc(top, high)] if held else []
    energy = (0.5 * E * ufl.inner(eps, eps) + u[1]) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=bcs), top, E


def at_speed(problem, x, y):
    v = fem.Function(problem.V)
    v.x.array[:] = np.tile([x, y], len(v.x.array) // 2)
    return v


def warnings_of(caplog):
    """What was said by the first rank."""
    return COMM.bcast(caplog.text if COMM.rank == 0 else None)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("what", ["density", "form", "Function", "stiffness"])
def test_what_changes_in_mass_and_damping_is_refused(what):
    """Within a run; between two runs they may change, and are assembled again."""
    problem, _, E = body()
    domain = problem.V.mesh
    heavy, drag = (fem.Constant(domain, value) for value in (2.0, 0.1))
    slow = fem.Function(fem.functionspace(domain, ("DG", 0)), name="slow")
    slow.x.array[:] = 0.1
    v = fem.Function(problem.V)
    forms = {
        "density": None,
        "form": drag * ufl.inner(v, ufl.TestFunction(problem.V)) * ufl.dx,
        "Function": slow * ufl.inner(v, ufl.TestFunction(problem.V)) * ufl.dx,
        "stiffness": (0.0, 1e-3),
    }
    values, message = {
        "density": (heavy._cpp_object.value, r"the density \(2.0 before, 3.0 now\)"),
        "form": (drag._cpp_object.value, r"the Constant in the damping \(0.1 before, 1.1 now\)"),
        "Function": (slow.x.array, "the Function 'slow' in the damping"),
        "stiffness": (E._cpp_object.value, "the form of the body, whose stiffness is in the damp"),
    }[what]
    before = np.array(values)

    def load(t):
        values[...] = before + (t > 0.15)

    how = dict(dt=0.1, velocity=v, damping=forms[what])
    motion = NSCD(problem, heavy, load=load, **how)
    with pytest.raises(ValueError, match=f"the load at the time 0.2 changes .*{message}") as info:
        motion.run([0.0, 0.3], progress=False)
    assert len(set(COMM.allgather(str(info.value)))) == 1
    np.testing.assert_array_equal(values, before)
    assert motion.run([0.1, 0.15], progress=False).complete
    motion.load = lambda t: None
    values[...] = before + 1.0
    assert motion.run([0.15, 0.2], progress=False).complete


@pytest.mark.parametrize("scheme", ["theta", "theta-euler", "modified-theta"])
def test_a_velocity_against_what_is_held(scheme):
    """A clamp does not move; where it is set to stay the motion is as before, and no end turns."""
    problem, _, _ = body()
    v = at_speed(problem, 0.3, 0.0)
    motion = NSCD(problem, 1.0, dt=0.05, velocity=v, scheme=scheme)
    said = r"component x at the node \(0, 1\) is 0.3, prescribed is 0; it would change"
    with pytest.raises(ValueError, match=said) as info:
        motion.run([0.0, 0.2], progress=False)
    assert len(set(COMM.allgather(str(info.value)))) == 1
    held = problem.equations.fixed
    np.testing.assert_array_equal(v.x.array, np.tile([0.3, 0.0], len(v.x.array) // 2))
    v.x.array[held] = 1e-12
    motion = NSCD(problem, 1.0, dt=0.05, velocity=v, scheme=scheme)
    motion.run([0.0, 0.2], start=problem.snapshot(), progress=False)
    assert np.abs(v.x.array[held]).max(initial=0.0) < 1e-11


@pytest.mark.ranks(2)
def test_a_start_off_what_is_prescribed():
    problem, top, _ = body()
    top.x.array[1::2] = -0.01
    with pytest.raises(ValueError, match=r"y at the node \(0, 1\) is 0, prescribed is -0.01"):
        NSCD(problem, 1.0, dt=0.1).run([0.0, 0.2])
    problem.solve()
    assert NSCD(problem, 1.0, dt=0.1).run([0.0, 0.2], progress=False).complete


@pytest.mark.parametrize(
    ("way", "speed", "turns"),
    [
        (lambda t: 0.1 * t, 0.0, True),
        (lambda t: 0.1 * min(t, 0.2), 0.1, True),
        (lambda t: 0.1 * t, 0.1, False),
        (lambda t: 0.1 * (1 - np.cos(3 * t)), 0.0, False),
    ],
    ids=["from rest", "kink", "at speed", "smooth"],
)
def test_velocities_that_turn_are_said(way, speed, turns, caplog):
    """Data that begin with another velocity than the body, or change theirs at once."""
    caplog.set_level(logging.WARNING, "dolfinx_contact")
    problem, top, _ = body()

    def load(t):
        top.x.array[0::2] = way(t)

    v = at_speed(problem, speed, 0.0)
    NSCD(problem, 1.0, dt=0.05, load=load, velocity=v).run([0.0, 0.6], progress=False)
    assert ("change from step to step" in warnings_of(caplog)) == turns
    caplog.clear()
    problem.u.x.array[:] = 0.0
    v.x.array[:] = np.tile([speed, 0.0], len(v.x.array) // 2)
    load(0.0)
    again = NSCD(problem, 1.0, dt=0.05, load=load, velocity=v, theta=0.7)
    again.run([0.0, 0.6], start=problem.snapshot(), progress=False)
    assert "change from step to step" not in warnings_of(caplog)


def test_a_mass_that_lies_elsewhere(caplog):
    """A free body turns under its weight by what the warning says, or no warning is given."""
    caplog.set_level(logging.WARNING, "dolfinx_contact")
    problem, _, _ = body(n=2, held=False, young=1e7)
    end = 0.1
    motion = NSCD(problem, 1.0, dt=end / 20)
    said = warnings_of(caplog)
    assert "wrong centre and wrong moments" in said
    motion.run([0.0, end], progress=False)
    fall = problem.u.x.array[1::2]
    off = COMM.allreduce(np.abs(fall + end**2 / 2).max(initial=0.0), op=MPI.MAX) / (end**2 / 2)
    figure = float(said.split(" % along y")[0].split()[-1]) / 100
    assert off > 0.25
    assert figure == pytest.approx(off, rel=0.15)  # of a rigid body, which this nearly is
    for n, how, held in (
        (2, {"mass": "lumped", "theta": 1.0}, False),
        (20, {}, False),
        (2, {}, True),
    ):
        caplog.clear()
        NSCD(body(n=n, held=held)[0], 1.0, dt=0.1, **how)
        assert "wrong centre and wrong moments" not in warnings_of(caplog)


def test_uniqueness_of_a_state_in_motion():
    """The static problem lacks the inertia forces, as the message says."""
    problem, _, _ = body(law=Coulomb(0.3), held=False, height=0.0)
    motion = NSCD(problem, 1.0, dt=0.05, velocity=at_speed(problem, 1.0, -0.2))
    state = motion.run([0.0, 0.1], progress=False).steps[-1].state
    with pytest.raises(ValueError, match=r"not a solution .* belongs to a motion"):
        problem.uniqueness(state=state)


@pytest.mark.parametrize(
    ("method", "alternates"),
    [
        ({}, True),
        ({"scheme": "theta-euler"}, False),
        ({"theta": 0.75}, False),
        ({"level": "velocity"}, False),
        ({"mass": "redistributed"}, False),
    ],
)
def test_alternating_forces_are_reported(method, alternates, caplog):
    """Those of the trapezoidal rule at the position level with mass at the contact nodes."""
    caplog.set_level(logging.WARNING, "dolfinx_contact")
    NSCD(body(n=20)[0], 1.0, dt=0.1, **{"mass": "lumped"} | method)
    assert ("contact forces alternate" in warnings_of(caplog)) == alternates


@pytest.mark.ranks(2)
def test_a_density_that_is_negative_within_a_cell():
    problem, _, _ = body(n=1)
    x = ufl.SpatialCoordinate(problem.V.mesh)
    with pytest.raises(ValueError, match="the density must be positive everywhere"):
        NSCD(problem, x[0] - 0.2, dt=0.1, mass="lumped")
    NSCD(problem, x[0] + 0.01, dt=0.1, mass="lumped")


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("speed", "said"), [(3.0, True), (1.0, False)])
def test_a_linear_body_that_turns_is_said(dim, speed, said, caplog):
    """By the angle, as if it were small, wherever it is."""
    domain = box(COMM, 2, "tri" if dim == 2 else "tet")
    domain.geometry.x[:] += 5.0
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(u, facets(domain, dim - 1, 5.0), obstacle=floor, law=Frictionless())
    energy = LinearElastic.from_young(1.0, 0.0).energy(u) * ufl.dx
    velocity = fem.Function(V)
    turn = speed * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])[:dim]
    velocity.interpolate(lambda x: turn @ (x - 5.5))
    motion = NSCD(ContactProblem(energy, u, [surface]), 1.0, dt=0.05, velocity=velocity)
    motion.run([0.0, 0.15])
    found = largest_turn(V, V.tabulate_dof_coordinates()[:, :dim], u.x.array, parts(V))
    assert found == pytest.approx(0.15 * speed, rel=1e-9)
    assert ("a linear body has rotated by 17.2 degrees" in warnings_of(caplog)) == said
