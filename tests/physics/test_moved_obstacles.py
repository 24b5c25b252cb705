"""Obstacles starting in the body, and obstacles that are moved by Constants."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets
from support.checks import warnings_of

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    RigidSurface,
    Sphere,
)
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
SHAPES = {
    "plane": lambda height: HalfSpace((0.0, height), (0, 1)),
    "disc": lambda height: Sphere((0.5, height - 2.0), 2.0),
    "facets": lambda height: RigidSurface([[-3.0, height], [3.0, height]], [[1, 0]]),
}


def block(obstacle, law=None, top=(0.0, 0.0), domain=None, **given):
    """A unit block whose top is held at a displacement, in contact at its bottom."""
    domain = box(COMM, 4, "quad") if domain is None else domain
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    face = facets(domain, 1, 0.0)
    surface = ContactSurface(u, face, obstacle=obstacle, law=law or Frictionless(), **given)
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(np.array(top), held, V)])


@pytest.mark.ranks(2)
@pytest.mark.parametrize("shape", SHAPES)
def test_a_start_in_an_obstacle_is_reported(shape):
    """The indicator is the depth over the smallest extent of the body, for all obstacles."""
    result = block(SHAPES[shape](0.1)).solve()
    assert result.indicators.surfaces["contact"].overlap == pytest.approx(0.1, rel=1e-9)
    assert "starts in the obstacle, by 0.1 of its" in result.warnings["overlap of 'contact'"]
    for given in (
        {"obstacle": SHAPES[shape](0.1), "interference": True},
        {"obstacle": SHAPES[shape](0.1), "interference": 0.11},
        {"obstacle": SHAPES[shape](0.1), "top": (0.0, 0.2)},  # moved out of the obstacle
        {"obstacle": SHAPES[shape](0.04)},
    ):
        assert "overlap of 'contact'" not in block(**given).solve().warnings
    at_the_threshold = block(SHAPES[shape](0.05)).solve()
    assert "overlap of 'contact'" not in at_the_threshold.warnings
    with pytest.raises(ValueError, match=r"overlap by 0\.1; interference=True for a press fit"):
        block(SHAPES[shape](0.1), interference=False)


@pytest.mark.ranks(2)
def test_a_press_by_a_moved_obstacle_is_not_a_start_in_it():
    domain = box(COMM, 4, "quad")
    at = fem.Constant(domain, (0.0, 0.0))
    problem = block(HalfSpace(at, (0, 1)), domain=domain)
    for height in (0.05, 0.1, 0.2):
        at.value[1] = height
        assert problem.solve().indicators.surfaces["contact"].overlap == 0.0


@pytest.mark.ranks(2)
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_an_obstacle_moved_along_itself_drags_nothing(friction, caplog):
    """There is one warning with friction, and none for a motion along the normal."""
    domain = box(COMM, 4, "quad")
    at = fem.Constant(domain, (0.0, 0.0))
    law = Coulomb(friction) if friction else None
    problem = block(HalfSpace(at, (0, 1)), law, (0.0, -0.05), domain)

    def load(t):
        at.value[:] = 0.1 * max(t - 1.0, 0.0), 0.01 * min(t, 1.0)

    history = QuasiStatic(problem, load).run([0.0, 0.5, 1.0])
    assert not [w for w in warnings_of(caplog) if "drags nothing" in w]
    result = QuasiStatic(problem, load).run([1.0, 1.5, 2.0], start=history.steps[-1].state)
    assert result.steps[-1].result.resultants["contact"][0] == pytest.approx(
        history.steps[-1].result.resultants["contact"][0], abs=1e-9
    )
    told = [w for w in warnings_of(caplog) if "drags nothing" in w]
    assert len(told) == (1 if friction else 0)


def test_an_obstacle_pressed_and_dragged_at_once_is_reported(caplog):
    domain = box(COMM, 4, "quad")
    at = fem.Constant(domain, (0.5, -2.0))
    problem = block(Sphere(at, 2.0), Coulomb(0.3), domain=domain)

    def load(t):
        at.value[:] = 0.5 + 0.01 * t, -2.0 + 0.01 * t

    QuasiStatic(problem, load).run([0.0, 0.5, 1.0])
    assert any("drags nothing" in w for w in warnings_of(caplog))
