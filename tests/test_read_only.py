"""What may be changed after surfaces and problems were made, and what says that it may not."""

from dataclasses import dataclass
from itertools import product
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Cylinder,
    HalfSpace,
    NormalCompliance,
    ParametricContact,
    RigidBody,
    Sphere,
    Tresca,
)
from dolfinx_contact.evolution import NSCD, ArcLength, QuasiStatic
from dolfinx_contact.laws import FrictionLaw
from dolfinx_contact.materials import LinearElastic, NeoHookean
from dolfinx_contact.obstacles import Obstacle

COMM = MPI.COMM_WORLD


class Study:
    """A block pressed on a floor and pushed aside, with all that a study varies as Constants."""

    def __init__(self, friction=0.1, young=1000.0, push=1.0, height=0.0, law=None, obstacle=None):
        domain = box(COMM, 4, "tri")
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        self.u = u = fem.Function(V)
        self.young = fem.Constant(domain, young)
        self.push = fem.Constant(domain, push)
        self.at = fem.Constant(domain, (0.0, height))
        self.way = fem.Constant(domain, np.array([0.0, -0.01]))
        steel = LinearElastic.from_young(self.young, 0.3)
        load = ufl.dot(ufl.as_vector([self.push, 0.0]), u) * ufl.dx
        top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        self.bc = fem.dirichletbc(self.way, top, V)
        self.surface = ContactSurface(
            u,
            facets(domain, 1, 0.0),
            obstacle=obstacle or HalfSpace(self.at, (0.0, 1.0)),
            law=law or Coulomb(friction),
        )
        self.bcs = [self.bc]
        self.surfaces = [self.surface]
        self.problem = ContactProblem(
            steel.energy(u) * ufl.dx - load, u, self.contacts, bcs=self.bcs
        )

    def force(self):
        self.u.x.array[:] = 0.0
        self.surface.multiplier.x.array[:] = 0.0
        return self.problem.solve().resultants["contact"]


@pytest.mark.long
def test_a_study_of_friction_load_material_and_place():
    """One problem, whose Constants change, answers as problems that are made anew."""
    study = Study()
    seen = []
    cases = list(product((0.05, 0.2), (500.0, 1000.0), (0.5, 2.0), (0.0, 0.002)))
    for friction, young, push, height in cases:
        study.surface.law.friction.value = friction
        study.young.value = young
        study.push.value = push
        study.at.value[1] = height
        force = study.force()
        anew = Study(friction, young, push, height).force()
        np.testing.assert_allclose(force, anew, rtol=0, atol=1e-9 * np.abs(anew).max())
        seen.append(tuple(np.round(force, 6)))
    assert len(set(seen)) == len(cases)


def test_a_function_in_the_place_of_a_method_can_be_taken_away_again():
    """As pytest does; what is data cannot be."""
    problem = Study().problem
    problem.solve = lambda: "another"
    assert problem.solve() == "another"
    del problem.solve
    assert problem.solve().kkt_violation < 1e-9
    with pytest.raises(AttributeError, match="surfaces"):
        del problem.surfaces


def test_the_natural_loops_are_refused():
    """They gave one answer three times."""
    study = Study()
    surface = study.surface
    problem = study.problem
    before = study.force()
    with pytest.raises(AttributeError, match=r"law of ContactSurface .*surface\.law\.friction\.va"):
        surface.law = Coulomb(0.5)
    with pytest.raises(AttributeError, match=r"surface\.law\.friction\.value = 0\.5"):
        surface.law.friction = 0.5
    with pytest.raises(AttributeError, match=r"no friction: surface\.law\.friction\.value = 0\.5"):
        surface.friction = 0.5
    with pytest.raises(AttributeError, match=r"obstacle of ContactSurface .*Constants"):
        surface.obstacle = HalfSpace((0.0, 0.1), (0.0, 1.0))
    with pytest.raises(AttributeError, match=r"fem\.Constant"):
        surface.obstacle.point = (0.0, 0.1)
    with pytest.raises(AttributeError, match=r"method of ContactSurface .*another surface"):
        surface.method = "mixed"
    with pytest.raises(AttributeError, match="values of Dirichlet conditions"):
        problem.bcs = []
    for change in (
        lambda: problem.bcs.append(study.bc),
        problem.bcs.clear,
        lambda: problem.bcs.__setitem__(0, study.bc),
        lambda: problem.bcs.__iadd__([study.bc]),
    ):
        with pytest.raises(AttributeError, match=r"Dirichlet conditions of a problem .*Functions"):
            change()
    with pytest.raises(AttributeError, match="surfaces of a problem"):
        problem.surfaces[0] = surface
    with pytest.raises(AttributeError, match="energy of ContactProblem"):
        problem.energy = study.u[0] * ufl.dx
    with pytest.raises(AttributeError, match="has no lawn"):
        del surface.lawn
    # Lists of the user are copied.
    study.bcs.clear()
    study.surfaces.clear()
    np.testing.assert_allclose(study.force(), before, rtol=1e-12)
    assert problem.bcs == [study.bc]
    assert len(problem.bcs + [study.bc]) == 2  # noqa: RUF005


def made():
    """Objects of each kind that is compiled, an attribute of each, and what is said."""
    study = Study()
    yield study.surface, "multiplier", "another surface"
    yield study.problem, "u", "another problem"
    yield ParametricContact(study.problem, study.push), "constant", "another ParametricContact"
    yield QuasiStatic(study.problem, lambda t: None), "problem", "another evolution"
    yield NSCD(study.problem, 1.0, dt=0.1), "velocity", "values of Constants"
    bond = RCCM(100.0, 100.0, 1.0)
    bonded = Study(law=bond)
    yield ArcLength(ParametricContact(bonded.problem, bonded.push)), "parametric", "another Arc"
    for law, name in (
        (Coulomb(0.3), "friction"),
        (Tresca(0.3), "threshold"),
        (NormalCompliance(1e3), "stiffness"),
        (bond, "work"),
    ):
        yield law, name, f"surface.law.{name}.value"
    for obstacle, name in (
        (HalfSpace((0, 0), (0, 1)), "normal"),
        (Sphere((0, 0), 1.0), "radius"),
        (Cylinder((0, 0, 0), (0, 0, 1), 1.0), "axis"),
    ):
        yield obstacle, name, "a Constant of the mesh"
    for material in (LinearElastic(1.0, 1.0), NeoHookean(1.0, 1.0)):
        yield material, "mu", "a Constant of the mesh"
    body = RigidBody(
        HalfSpace((0, 0), (0, 1)), about=(0, 0), load={"y": 1.0}, held=["x", "rz"], name="punch"
    )
    yield body, "about", "are Constants"


def test_what_is_compiled_is_read_only():
    kinds = set()
    for thing, name, way in made():
        kinds.add(type(thing).__name__)
        value = getattr(thing, name)
        with pytest.raises(AttributeError, match=f"{name} of .* cannot be set .*{way}"):
            setattr(thing, name, value)
        with pytest.raises(AttributeError, match="has no misspelt"):
            thing.misspelt = 1.0
    assert len(kinds) == 16


def test_loads_of_a_rigid_body():
    body = RigidBody(HalfSpace((0, 0), (0, 1)), about=(0, 0), load={"y": 1.0}, held=["x", "rz"])
    with pytest.raises(AttributeError, match=r"loads and motions of rigid body .*Constants"):
        body.given["y"] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        body.about[0] = 1.0


def test_arrays_are_copied():
    """What is changed in place afterwards is not what was given."""
    point = np.array([0.0, 0.0])
    floor = HalfSpace(point, [0.0, 1.0])
    study = Study(obstacle=floor)
    before = study.force()
    point[1] = -0.005
    np.testing.assert_array_equal(floor.point, 0.0)
    np.testing.assert_allclose(study.force(), before, rtol=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        floor.point[1] = 0.1
    assert floor.normal == (0.0, 1.0)


@pytest.mark.parametrize("kind", ["array", "tuple", "radius"])
def test_what_an_obstacle_is_made_of_moves_it(kind):
    """Constants in an array as in a tuple, and a radius that is a Function."""
    domain = box(COMM, 2, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    height = fem.Constant(domain, 0.0)
    size = fem.Function(fem.functionspace(domain, ("DG", 0)))
    size.x.array[:] = 5.0
    obstacle = {
        "array": lambda: HalfSpace(np.array([0.0, height]), (0.0, 1.0)),
        "tuple": lambda: HalfSpace((0.0, height), (0.0, 1.0)),
        "radius": lambda: Sphere((0.5, -5.0), size),
    }[kind]()
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=obstacle, law=Coulomb(0.0), sliding="small"
    )
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    bcs = [fem.dirichletbc(np.array([0.0, -0.01]), top, V)]
    energy = LinearElastic.from_young(1000.0, 0.0).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    before = problem.solve().resultants["contact"][1]
    height.value = 0.01
    size.x.array[:] = 5.01
    after = problem.solve().resultants["contact"][1]
    if kind == "radius":
        assert after > 1.5 * before > 0
    else:
        np.testing.assert_allclose([before, after], [10.0, 20.0])


def test_numbers_that_are_copied_are_no_constants():
    """The reference point of a rigid body: a float of a Constant would stay where it is."""
    domain = box(COMM, 1, "tri")
    aside = fem.Constant(domain, 0.0)
    for about in ((aside, 0.0), np.array([aside, 0.0]), fem.Constant(domain, (0.0, 0.0))):
        with pytest.raises(ValueError, match="reference point is copied, and must be numbers"):
            RigidBody(HalfSpace((0, 0), (0, 1)), about=about, held=["x", "y", "rz"])


def test_what_may_be_set():
    study = Study()
    study.force()
    study.problem.petsc_options["snes_rtol"] = 1e-10
    evolution = QuasiStatic(study.problem, lambda t: None)
    evolution.load = lambda t: None
    system = ParametricContact(study.problem, study.push)
    system.proof_seconds = 1.0
    system.scales = system.scales


@dataclass
class Weakening(FrictionLaw):
    """A law of one's own, which should be frozen and is not."""

    static: Any
    fade: float = 0.0

    def bound(self, a, p):
        return self.static * p


class Floor(Obstacle):
    """An obstacle of one's own."""

    def __init__(self):
        self.height = 0.0

    def at(self, domain, x):
        return x[1] - self.height, ufl.as_vector((0.0, -1.0))


def test_laws_and_obstacles_of_ones_own():
    """They are read-only from the surface on that is made with them."""
    law = Weakening(0.3)
    floor = Floor()
    law.static = 0.1
    floor.height = -0.001
    study = Study(law=law, obstacle=floor)
    force = study.force()
    np.testing.assert_allclose(force, Study(0.1, height=-0.001).force(), rtol=1e-9)
    with pytest.raises(AttributeError, match=r"static of Weakening .*surface\.law\.static\.value"):
        law.static = 0.5
    with pytest.raises(AttributeError, match="static of Weakening"):
        study.surface.law.static = 0.5
    with pytest.raises(AttributeError, match=r"height of Floor .*Constant"):
        floor.height = 0.0
