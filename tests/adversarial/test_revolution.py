"""Assumption: users of bodies of revolution think per volume and per area, near the axis.

Rings with Poisson's ratio 0 carry E times the strain times their area; far from the axis, of two
materials, graded, on each other, and of rubber, in several units.
"""

import numpy as np
import pytest
from support.bodies import block, move, normal_force, two_blocks
from support.checks import assert_close, results_at, solved_start

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless, ParametricContact, materials
from dolfinx_contact.materials import Axisymmetric, LinearElastic

STEEL = LinearElastic.from_young(1000.0, 0.0)
AREA = np.pi * (2.0**2 - 1.0**2)


def ring(inner=1.0, unit=1.0, press=0.01, **kind):
    """A ring of width and height ``unit`` that is pressed."""
    body = block(size=(unit, unit), **kind)
    body.domain.geometry.x[:, 0] += inner * unit
    body.move_top(0.0, -press * unit)
    return body


def force(body, bulk, axisymmetric=True):
    return normal_force(body.problem(bulk=bulk, axisymmetric=axisymmetric).solve())


@pytest.mark.sample
def test_a_ring_has_the_force_of_its_whole_area():
    body = ring()
    assert_close(force(body, Axisymmetric(STEEL).energy(body.u) * ufl.dx), 10.0 * AREA)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_a_ring_far_from_the_axis_has_the_force_of_its_whole_area(unit):
    """100 < r < 101, where r hardly varies."""
    body = ring(100.0, unit)
    found = force(body, Axisymmetric(STEEL).energy(body.u) * ufl.dx) / unit**2
    assert_close(found, 10.0 * np.pi * (101.0**2 - 100.0**2))


def test_a_hoop_strain_of_ones_own_is_the_packages():
    body = ring()
    x = ufl.SpatialCoordinate(body.domain)
    eps = ufl.sym(ufl.grad(body.u))
    bulk = 500.0 * (ufl.inner(eps, eps) + (body.u[0] / x[0]) ** 2) * ufl.dx
    assert_close(force(body, bulk), 10.0 * AREA)


@pytest.mark.parametrize(
    ("material", "axisymmetric", "words"),
    [
        (Axisymmetric(STEEL), False, r"surfaces are plane, .* that of a body of revolution"),
        (STEEL, True, r"surfaces are axisymmetric, .* that of a plane body"),
    ],
)
def test_plane_and_axisymmetric_parts_do_not_mix(material, axisymmetric, words):
    body = ring()
    with pytest.raises(ValueError, match=words):
        force(body, material.energy(body.u) * ufl.dx, axisymmetric)


def test_a_plane_body_beside_the_axis_stays_plane():
    body = ring()
    assert_close(force(body, STEEL.energy(body.u) * ufl.dx, False), 10.0)


@pytest.mark.parametrize("power", [-1, 1])
def test_a_graded_modulus_is_not_taken_for_a_weight(power):
    body = ring(cells=(4, 1))
    young = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    young.interpolate(lambda x: x[0] ** power)
    edges = np.linspace(1.0, 2.0, 5)
    middles = (edges[1:] + edges[:-1]) / 2
    right = 10.0 * np.pi * np.sum(np.diff(edges**2) * middles**power)
    assert_close(force(body, young * Axisymmetric(STEEL).energy(body.u) * ufl.dx), right)


@pytest.mark.parametrize("tagged", [True, False])
def test_two_materials_split_the_force_by_their_areas(tagged):
    body = ring()
    psi = Axisymmetric(STEEL).energy(body.u)
    if tagged:
        cells = np.arange(body.domain.topology.index_map(2).size_local, dtype=np.int32)
        outer = mesh.compute_midpoints(body.domain, 2, cells)[:, 0] > 1.5
        tags = mesh.meshtags(body.domain, 2, cells, np.where(outer, 2, 1).astype(np.int32))
        dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
        bulk = psi * dx(1) + 2 * psi * dx(2)
    else:
        r = ufl.SpatialCoordinate(body.domain)[0]
        bulk = ufl.conditional(ufl.lt(r, 1.5), 1.0, 2.0) * psi * ufl.dx
    right = 10.0 * np.pi * ((1.5**2 - 1) + 2 * (2**2 - 1.5**2))
    assert_close(force(body, bulk), right)


@pytest.mark.parametrize("tagged", [True, False])
def test_a_traction_that_sets_in_after_construction_acts_on_the_whole_area(tagged):
    """Its Constant is zero until then."""
    body = ring()
    q = fem.Constant(body.domain, (0.0, 0.0))
    pushed = ufl.dot(q, body.u)
    if tagged:
        numbers = np.full(len(body.bottom), 3, dtype=np.int32)
        tags = mesh.meshtags(body.domain, 1, np.sort(body.bottom), numbers)
        pushed = pushed * ufl.ds(3, domain=body.domain, subdomain_data=tags)
    else:
        pushed = pushed * body.at_bottom() * ufl.ds
    bulk = Axisymmetric(STEEL).energy(body.u) * ufl.dx + pushed
    problem = body.problem(bulk=bulk, axisymmetric=True)
    problem.solve()
    q.value[1] = 4.0
    assert_close(normal_force(problem.solve()), 14.0 * AREA)


def test_quadratic_rubber_is_linear_for_a_small_press():
    body = ring(press=1e-4, cells=(2, 1), cell="tri", degree=2)
    rubber = Axisymmetric(materials.NeoHookean(*materials.lame(1000.0, 0.0)))
    bulk = rubber.energy(body.u) * ufl.dx(metadata={"quadrature_degree": 3})
    assert_close(force(body, bulk), 0.1 * AREA, 0.01)


def test_two_rings_on_each_other_share_a_load_of_gamma():
    """A load of 2 per volume on the upper ring: each of its ends carries half."""
    both = two_blocks((2, 1), (2, 1), depth=1.0)
    both.domain.geometry.x[:, 0] += 1.0
    move(both.top, 0.0, -0.01)
    gamma = fem.Constant(both.domain, 0.0)
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    energy = Axisymmetric(STEEL).energy(both.u) * dx + 2.0 * gamma * both.u[1] * dx(1)
    pair = ContactPair(
        both.u, both.slave, master_facets=both.master, law=Frictionless(), axisymmetric=True
    )
    system = ParametricContact(ContactProblem(energy, both.u, [pair], bcs=both.bcs), gamma)
    found = results_at(system, solved_start(system), 1.0)
    assert_close([normal_force(r) for r in found], [AREA * (1000.0 * 0.01 + 2.0 / 2) / 2])
