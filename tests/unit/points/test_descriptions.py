# SPDX-License-Identifier: LGPL-3.0-or-later
"""Descriptions of contact: refused arguments, and separate discretisations of problems."""

from dataclasses import FrozenInstanceError

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    NonlocalCoulomb,
    RigidBody,
    SelfContact,
    Sphere,
)
from dolfinx_contact.materials import NeoHookean

COMM = MPI.COMM_WORLD


def displacement(dim=2, degree=1):
    domain = box(COMM, 2, "tri" if dim == 2 else "tet")
    return fem.Function(fem.functionspace(domain, ("Lagrange", degree, (dim,))))


def test_one_description_serves_a_linear_and_a_nonlinear_body():
    """On a curved obstacle, sliding is small for the first and large for the second by default."""
    problem = block(obstacle=Sphere((0.3, -2.0), 2.0), law=Coulomb(0.2), top=(0.02, -0.05))
    u = problem.u
    energy = NeoHookean(400.0, 600.0).energy(u) * ufl.dx
    nonlinear = ContactProblem(energy, u, problem.contacts, bcs=problem.bcs)
    found = []
    for p in (problem, nonlinear, problem, nonlinear):
        u.x.array[:] = 0.0
        for s in p.surfaces:
            s.multiplier.x.array[:] = 0.0
        p.solve()
        found.append(u.x.array.copy())
    np.testing.assert_allclose(found[2], found[0], atol=1e-12)
    np.testing.assert_allclose(found[3], found[1], atol=1e-12)
    assert nonlinear.surfaces[0].displaced is not None
    assert problem.surfaces[0].displaced is None


def test_a_description_is_frozen_and_its_law_has_constants():
    u = displacement()
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(
        u, facets(u.function_space.mesh, 1, 0.0), obstacle=floor, law=Coulomb(0.3)
    )
    surface.law.friction.value = 0.5
    assert isinstance(surface.law.friction, fem.Constant)
    with pytest.raises(FrozenInstanceError):
        surface.law = Coulomb(0.1)
    assert repr(surface) == "<ContactSurface 'contact', law Coulomb, obstacle HalfSpace>"


def test_a_problem_finds_its_surfaces_by_description():
    problem = block()
    (contact,) = problem.contacts
    assert problem.discrete(contact) is problem.surfaces[0]
    problem.solve()
    assert problem.table(contact).rn.sum() == problem.table(problem.surfaces[0]).rn.sum()
    assert problem.discrete(contact.name) is problem.surfaces[0]
    assert problem.table(contact.name).rn.sum() == problem.table(contact).rn.sum()
    (other,) = block().contacts
    with pytest.raises(ValueError, match="a surface of this problem is needed, one of"):
        problem.table(other)
    with pytest.raises(ValueError, match="a surface of this problem is needed, one of"):
        problem.table("no such surface")


PAIR = {"slave": 3, "master": 2}
BODY = RigidBody(Sphere((0.0, 0.0), 1.0), about=(0.0, 0.0), held=["x", "y", "rz"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(
            ({"normal": n}, "normal must be 2 finite numbers")
            for n in ((0, 0), (1,), "x", (np.nan, 1))
        ),
        ({"gap": np.nan}, "the gap must be a finite number"),
        *(({"gap": gap}, "the gap must be a finite number or a UFL") for gap in (True, "x", [0.0])),
        ({"master_facets": np.zeros(1, np.int32)}, "by their indices have no tags"),
        (
            {"slave": None, "master": None, "facets": np.zeros(1, np.int32)},
            "by their indices need master_facets",
        ),
        ({"surface": BODY}, "the surface must be a HalfSpace"),
        ({"surface": Sphere((0, 0), 1.0), "gap": 0.1}, "has a gap and a normal of its own"),
        ({"search_distance": 0.1}, "only sliding='large' supports search_distance"),
        ({"sliding": "large", "gap": 0.1}, "sliding='large' does not support gap"),
        ({"sliding": "large", "search_distance": -1.0}, "search distance must be positive"),
        ({"remove_overlap": 0.1, "gap": 0.1}, "there is no overlap to remove"),
        ({"axisymmetric": 1}, "axisymmetric must be True or False"),
        ({"law": 0.3}, "the law must be a Law, such as Frictionless"),
        ({"name": ""}, "the name of a contact surface must be a word"),
        ({"name": "support_0"}, "the name of a contact surface must not be 'support_0'"),
    ],
)
def test_pair_refuses_arguments_out_of_range(arguments, message):
    given = {"facets": None, "law": Coulomb(0.3), **PAIR, **arguments}
    with pytest.raises(ValueError, match=message):
        ContactPair(displacement(), **given)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(
            ({"direction": d}, "the direction must be 2 finite numbers")
            for d in ((0, 0), (1,), "x")
        ),
        ({"symmetry": {0: 0.0}, "direction": (1, 0)}, "parallel to the planes of symmetry"),
        ({"search_distance": 0.0}, "search distance must be positive"),
        ({"u": displacement(degree=2)}, "displacements of degree 1"),
    ],
)
def test_self_contact_refuses_arguments_out_of_range(arguments, message):
    given = {"u": displacement(), "law": Coulomb(0.3), **arguments}
    with pytest.raises(ValueError, match=message):
        SelfContact(given.pop("u"), np.zeros(1, dtype=np.int32), **given)


def test_directions_and_normals_are_scaled_to_unit_length():
    """Also where the square of their length underflows or overflows."""
    u = displacement()
    some = np.zeros(1, dtype=np.int32)
    for given in ([3e-200, 4e-200], [3e200, 4e200], (3, 4)):
        pair = ContactPair(u, some, master_facets=some, law=Coulomb(0.3), normal=given)
        face = SelfContact(u, some, law=Coulomb(0.3), direction=given)
        np.testing.assert_allclose(pair.normal, [0.6, 0.8])
        np.testing.assert_allclose(face.direction, [0.6, 0.8])
    np.testing.assert_array_equal(SelfContact(u, some, law=Coulomb(0.3)).direction, [0.0, 1.0])


def surface(u, **given):
    bottom = facets(u.function_space.mesh, 1, 0.0)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    return ContactSurface(u, bottom, **{"obstacle": floor, "law": Coulomb(0.0), **given})


@pytest.mark.parametrize(
    ("degrees", "axisymmetric", "default", "least"),
    [
        ((1, 1), False, 2, 2),
        ((1, 1), True, 3, 3),
        ((2, 1), False, 4, 3),
        ((2, 1), True, 5, 4),
        ((2, 2), False, 4, 4),
    ],
)
def test_quadrature_integrates_multiplier_times_displacement(degrees, axisymmetric, default, least):
    """The default is twice the degree of the displacement; 2 pi r takes one degree more."""
    u = displacement(degree=degrees[0])
    given = {"method": "integral", "multiplier_degree": degrees[1], "axisymmetric": axisymmetric}
    assert surface(u, **given).quadrature_degree == default
    assert surface(u, quadrature_degree=least, **given).quadrature_degree == least
    for bad in (least - 1, float(least), "4"):
        with pytest.raises(ValueError, match=f"of P{degrees[0]} with .* a whole number >= {least}"):
            surface(u, quadrature_degree=bad, **given)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("method", ["nodal", "mixed", "integral"])
def test_only_stable_pairs_of_elements_are_accepted(method, degree):
    u = displacement(degree=degree)
    stable = {"nodal": {(1, 1)}, "mixed": {(1, 1), (2, 1)}, "integral": {(1, 1), (2, 1), (2, 2)}}
    for multiplier in (1, 2):
        if (degree, multiplier) in stable[method]:
            surface(u, method=method, multiplier_degree=multiplier)
            continue
        words = f"P{degree} with multiplier P{multiplier} .* of the {method} method; stable: P1/P1"
        with pytest.raises(ValueError, match=words):
            surface(u, method=method, multiplier_degree=multiplier)
    for bad in (0, True, 1.0, "1"):
        with pytest.raises(ValueError, match="multiplier_degree must be a whole number"):
            surface(u, method=method, multiplier_degree=bad)
    for bad in ("Nodal", 1):
        with pytest.raises(ValueError, match="method must be one of"):
            surface(u, method=bad)


def punch(**given):
    return RigidBody(HalfSpace((0.0, 0.0), (0.0, 1.0)), about=(0.0, 0.0), **given)


def test_a_rigid_body_of_revolution_moves_along_the_axis_only():
    u = displacement()
    for good in (
        punch(motion={"y": -1.0}, held=["x", "rz"]),
        punch(free=["y"], held=["x", "rz"]),
    ):
        surface(u, axisymmetric=True, obstacle=good)
    for bad in (
        punch(motion={"x": 1.0}, held=["y", "rz"]),
        punch(motion={"rz": 1.0}, held=["y", "x"]),
        punch(free=["x"], held=["y", "rz"]),
        punch(free=["rz"], held=["y", "x"]),
    ):
        with pytest.raises(ValueError, match="moves only along the axis of revolution"):
            surface(u, axisymmetric=True, obstacle=bad)
        surface(u, obstacle=bad)
    with pytest.raises(ValueError, match="no nonlocal friction"):
        surface(u, axisymmetric=True, law=NonlocalCoulomb(0.3, 1.0))
    surface(u, axisymmetric=np.False_, law=NonlocalCoulomb(0.3, 1.0))
