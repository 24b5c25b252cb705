"""Regularised friction in histories: it resists the velocity of the slip, and creeps."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    NormalCompliance,
    Regularised,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD
F = 0.4
N = 30.0
EPS = 2e-3
Q = 0.9
#: Velocity over eps at which the shear is Q of its bound; a cubic's by its trigonometric root.
CREEP = {
    "tanh": np.arctanh(Q),
    "sqrt": Q / np.sqrt(1 - Q**2),
    "polynomial": 2 * np.sin(np.arcsin(Q) / 3),
    "linear": Q,
}


def loose(cell, law, *, n=2, comm=COMM, method=None):
    """A block that nothing holds but the floor, and the Constant of its weight and its load."""
    domain = box(comm, n, cell)
    dim = domain.geometry.dim
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (dim,))))
    force = fem.Constant(domain, -N * np.eye(dim)[-1])
    floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    below = facets(domain, dim - 1, 0.0)
    contact = ContactSurface(u, below, obstacle=floor, law=law, method=method)
    energy = LinearElastic.from_young(1e5, 0.3).energy(u)
    density = energy - ufl.dot(force, u)
    tight = {"snes_rtol": 1e-12}
    return ContactProblem(density * ufl.dx, u, [contact], petsc_options=tight), force


def means(history):
    """Mean slips over the areas (steps, dim)."""
    tables = [s.result.tables["contact"] for s in history.steps]
    return np.array([t.area @ t.ut / t.area.sum() for t in tables])


def dragged(problem, force, way, times, **given):
    """The history under a force of Q times the bound, from the weight only."""

    def load(t):
        force.value[: len(way)] = Q * F * N * (t > 0) * way

    load(0.0)
    problem.solve()
    return QuasiStatic(problem, load).run(times, **given)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("cell", "shape", "method"),
    [
        ("quad", "sqrt", None),
        ("tri", "polynomial", "mixed"),
        ("quad", "linear", "integral"),
        ("hex", "sqrt", None),
        ("tri", "tanh", None),
    ],
)
@pytest.mark.verifies(
    "regularised friction",
    "friction of speed and time",
    "quasi-static",
    reference="closed form: the velocity eps phi^-1(q)",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_regularised_friction_creeps_at_its_closed_form(cell, shape, method):
    """For ever at the velocity eps phi^-1(q), in steps of any length; Coulomb holds the block."""
    way = np.array([0.6, -0.8]) if cell == "hex" else np.array([1.0])
    times = np.array([0.0, 1.0, 3.0, 5.0, 10.0, 20.0, 30.0, 31.0])
    law = Regularised(Coulomb(F), width=1e-3, shape=shape, speed=EPS)
    for each, velocity in ((law, EPS * CREEP[shape]), (Coulomb(F), 0.0)):
        history = dragged(*loose(cell, each, method=method), way, times)
        rates = np.diff(means(history), axis=0)[:, : len(way)] / np.diff(times[1:])[:, None]
        np.testing.assert_allclose(rates[3:], np.tile(velocity * way, (3, 1)), atol=1e-8 * EPS)
        # All that the force does from there on goes into friction.
        before, after = (history.at(t).energies for t in (10.0, 31.0))
        spent = 21.0 * velocity * Q * F * N
        assert after.dissipated - before.dissipated == pytest.approx(spent, rel=1e-8, abs=1e-12)
        assert after.residue == pytest.approx(before.residue, abs=1e-8 * spent + 1e-12)


def test_increment_at_a_velocity_is_a_static_law():
    """A step of the length dt is the static law of the width eps dt, as `width` has it."""
    dt = 0.25
    tables = []
    for law, step in (
        (Regularised(Coulomb(F), speed=EPS), dt),
        (Regularised(Coulomb(F), width=EPS * dt), 0.0),
        (NormalCompliance(1e9, friction=Regularised(Coulomb(F), speed=EPS)), dt),
    ):
        problem = block(law=law, top=(2e-4, -0.01))
        (surface,) = problem.surfaces
        at_rest = np.zeros((surface.points.number, 2))
        problem = problem.with_memory([Memory(at_rest, step=step)])
        tables.append(problem.solve().tables["contact"])
    for other, tolerance in zip(tables[1:], (1e-8, 1e-3), strict=True):
        size = np.abs(tables[0].force).max()
        np.testing.assert_allclose(tables[0].force, other.force, rtol=0, atol=tolerance * size)
    assert tables[0].status == tables[1].status
