"""Data of motions that give an error or a warning."""

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
from dolfinx_contact.evolution import NSCD, NoContinuation

COMM = MPI.COMM_WORLD


def body(n=2, cell="tri", *, held=True, height=1.0, young=1000.0, law=None):
    """Return a square above a floor, its prescribed top displacement, and its Young's modulus."""
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
    """Return the log of rank 0 on every rank."""
    return COMM.bcast(caplog.text if COMM.rank == 0 else None)


@pytest.mark.parametrize("scheme", ["theta", "theta-euler", "modified-theta"])
def test_motion_refuses_an_initial_velocity_of_clamped_nodes(scheme):
    problem, _, _ = body()
    v = at_speed(problem, 0.3, 0.0)
    motion = NSCD(problem, 1.0, dt=0.05, velocity=v, scheme=scheme)
    said = r"x at the node \(0, 1\) is 0.3 instead of the prescribed value 0; the velocity would"
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
def test_motion_refuses_a_start_that_violates_dirichlet_data():
    problem, top, _ = body()
    top.x.array[1::2] = -0.01
    with pytest.raises(
        ValueError, match=r"y at the node \(0, 1\) is 0 instead of the prescribed value -0.01"
    ):
        NSCD(problem, 1.0, dt=0.1).run([0.0, 0.2])
    top.interpolate(lambda x: np.vstack([0.0 * x[0], -0.01 - 0.01 * x[0]]))
    with pytest.raises(
        ValueError, match=r"y at the node \(1, 1\) is 0 instead of the prescribed value -0.02"
    ):
        NSCD(problem, 1.0, dt=0.1).run([0.0, 0.2])
    problem.solve()
    assert NSCD(problem, 1.0, dt=0.1).run([0.0, 0.2], progress=False).complete


def test_uniqueness_refuses_the_state_of_a_motion():
    """The message says that the static problem lacks the inertia forces."""
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
def test_alternating_contact_forces_give_a_warning(method, alternates, caplog):
    """They alternate with the trapezoidal rule at the position level and mass at contact nodes."""
    caplog.set_level(logging.WARNING, "dolfinx_contact")
    NSCD(body(n=20)[0], 1.0, dt=0.1, **{"mass": "lumped"} | method)
    assert ("contact forces alternate" in warnings_of(caplog)) == alternates


@pytest.mark.ranks(2)
def test_motion_refuses_a_density_that_is_negative_within_a_cell():
    problem, _, _ = body(n=1)
    x = ufl.SpatialCoordinate(problem.V.mesh)
    with pytest.raises(ValueError, match="the density must be positive everywhere"):
        NSCD(problem, x[0] - 0.2, dt=0.1, mass="lumped")
    NSCD(problem, x[0] + 0.01, dt=0.1, mass="lumped")


def test_the_first_halved_step_of_a_motion_gives_a_warning(caplog):
    """Without a Newton step nothing is solved: steps of 1/4 to 1/1024 of dt are tried."""
    problem, _, _ = body(held=False, height=0.1, law=Coulomb(0.3))
    problem.petsc_options["snes_max_it"] = 0
    velocity = fem.Function(problem.V)
    velocity.x.array[1::2] = -1.0
    motion = NSCD(problem, 1.0, dt=0.04, velocity=velocity)
    with caplog.at_level(logging.WARNING), pytest.raises(NoContinuation):
        motion.run([0.0, 0.2], progress=False)
    (text,) = (r.getMessage() for r in caplog.records if "shorter steps" in r.getMessage())
    assert text.startswith("step 1 of the evolution, from the time 0 and of length 0.04, was")
    assert "down to 3.91e-05" in text
