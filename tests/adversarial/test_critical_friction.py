"""Assumption: the smallest coefficient of friction of a continuum of solutions is the one found.

All coefficients F with S_tt v = F S_nt v, sorted by the signs of the slips v, are computed densely
in numpy: of leaning, bent, non-symmetric, stacked and three-dimensional bodies in several units.
"""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from support.bodies import block, two_blocks
from support.checks import assert_close, condensed, dense, nodes_of, tangent

import ufl
from dolfinx import fem, la

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, materials
from dolfinx_contact.analysis import critical_friction

COMM = MPI.COMM_WORLD

SELF = MPI.COMM_SELF


def leaning(offset, cells=(4, 4), unit=1.0, comm=COMM):
    """A block whose top is moved to the right in the mesh."""
    body = block(cells, (unit, unit), comm=comm)
    x = body.domain.geometry.x
    x[:, 0] += offset * x[:, 1]
    return body


def energy_of(body, unit=1.0):
    return materials.LinearElastic(unit, unit).energy(body.u) * ufl.dx


def dofs(nodes, dim=2):
    return (dim * nodes[:, None] + np.arange(dim)).ravel()


def sorted_by_slips(S_tt, S_nt):
    """Coefficients of slips of one sign, of both signs, and complex ones, each by size.

    F > 0 belongs to slip against the directions: S_tt v = rt = F rn = F S_nt v.
    """
    values, vectors = scipy.linalg.eig(S_tt, S_nt)
    lists = ([], [], [])
    scale = np.abs(S_tt).max() / np.abs(S_nt).max()
    for F, v in zip(values, vectors.T, strict=True):
        if not np.isfinite(F) or abs(F) > 1e8 * scale:
            continue
        if abs(F.imag) > 1e-7 * abs(F):
            lists[2].append(F)
            continue
        v = (v / v[np.argmax(np.abs(v))]).real
        lists[0 if v.min() > -1e-7 else 1].append(F.real)
    return [sorted(found, key=abs) for found in lists]


def expected(K, V):
    """All coefficients of a body of height 1, from its stiffness on one rank."""
    bottom = nodes_of(V, lambda y: np.isclose(y[:, 1], 0))
    top = nodes_of(V, lambda y: np.isclose(y[:, 1], 1))
    S = condensed(K, np.concatenate([2 * bottom, 2 * bottom + 1]), dofs(top))
    m = len(bottom)
    return sorted_by_slips(S[:m, :m], S[m:, :m])


def sizes(values):
    return sorted(abs(F) for F in values)


def assert_all_found(found, lists):
    """Assert that all coefficients are found, with a message saying so."""
    one, mixed, unreal = lists
    assert_close(sorted(found.one_signed), sorted(one))
    assert_close(sorted(found.mixed), sorted(mixed))
    assert_close(sizes(found.unreal), sizes(unreal))
    if one:
        assert_close(abs(found.friction), abs(one[0]))
        assert min(abs(F / found.friction - 1) for F in one) < 1e-6
        assert found.slips.min() >= 0
        assert np.isclose(found.slips.max(), 1)
    else:
        assert found.friction is None
        assert not len(found.slips)
    assert found.complete
    assert np.isinf(found.known_up_to)


@pytest.mark.parametrize("offset", [pytest.param(1.5, marks=pytest.mark.sample), -1.5, 0.0])
def test_all_coefficients_of_a_leaning_block_are_found(offset):
    body = leaning(offset)
    found = critical_friction(body.problem(Coulomb(0.3), energy_of(body)))
    own = leaning(offset, comm=SELF)
    assert_all_found(found, expected(dense(tangent(energy_of(own), own)), own.V))


@pytest.mark.parametrize(
    ("length", "stiffness"), [(1.0, 2.0), (1e-9, 1e9), (1e9, 1e-9), (1e-6, 1e11)]
)
def test_coefficients_do_not_depend_on_units(length, stiffness):
    own = leaning(1.0, (3, 3), comm=SELF)
    lists = expected(dense(tangent(energy_of(own), own)), own.V)
    body = leaning(1.0, (3, 3), length)
    problem = body.problem(Coulomb(0.3), energy_of(body, stiffness))
    assert_all_found(critical_friction(problem), lists)


@pytest.mark.parametrize(("offset", "count"), [(0.0, 1), (1.0, 1), (-2.0, 3), (1.0, 13)])
def test_the_known_part_of_some_coefficients_is_true(offset, count):
    """Few are computed; every one below ``known_up_to`` must be among them."""
    body = leaning(offset, (12, 2))
    problem = body.problem(Coulomb(0.3), energy_of(body))
    found = critical_friction(problem, dense=False, count=count)
    own = leaning(offset, (12, 2), comm=SELF)
    lists = expected(dense(tangent(energy_of(own), own)), own.V)
    assert found.known_up_to > 0
    below = found.known_up_to * (1 - 1e-6)
    given = (found.one_signed, found.mixed, found.unreal)
    for those, truth in zip(given, lists, strict=True):
        one, all_of = np.array(sizes(those)), np.array(sizes(truth))
        assert_close(one[one < below], all_of[all_of < below])
        for size in one:
            assert np.min(np.abs(all_of / size - 1)) < 1e-6
    least = abs(lists[0][0]) if lists[0] else np.inf
    if found.friction is None:
        assert least >= below
    elif abs(found.friction) < below:  # of two of the same size either may be given
        assert_close(abs(found.friction), least)
        assert min(abs(F / found.friction - 1) for F in lists[0]) < 1e-6
    got, number = (sum(len(part) for part in parts) for parts in (given, lists))
    assert not found.complete or got == number
    assert np.isfinite(found.known_up_to) or got == number


@pytest.mark.parametrize(("shear", "press"), [(0.0, 0.0), (1.0, 0.1), (-0.7, 0.15)])
def test_coefficients_of_rubber_belong_to_its_displacement(shear, press):
    rubber = materials.StVenantKirchhoff(1.0, 1.0)
    body = leaning(0.5, (3, 3))
    own = leaning(0.5, (3, 3), comm=SELF)
    problem = body.problem(Coulomb(0.3), rubber.energy(body.u) * ufl.dx)
    form = tangent(rubber.energy(own.u) * ufl.dx, own)
    for part in (1.0, 0.0):  # the bottom stays on the floor
        for u in (body.u, own.u):
            u.interpolate(
                lambda x, p=part: (
                    p * np.stack([shear * x[1] + 0 * x[0], -press * x[1] * (1 + 0.5 * x[0])])
                )
            )
        assert_all_found(critical_friction(problem), expected(dense(form), own.V))


@pytest.mark.parametrize("offset", [0.5, -0.5])
def test_coefficients_of_a_load_that_follows_are_not_those_of_the_transpose(offset):
    """Its stiffness is not symmetric, so that S_nt is not the transpose of S_tn."""

    def residual(body, trial):
        test = ufl.TestFunction(body.V)
        E = ufl.sym(ufl.grad(trial))
        stress = ufl.tr(E) * ufl.Identity(2) + 2 * E
        turned = ufl.as_vector((-2.0 * trial[1], 0.5 * trial[0].dx(1)))
        inner = ufl.inner(stress, ufl.sym(ufl.grad(test)))
        return (inner - ufl.dot(turned, test)) * ufl.dx

    body = leaning(offset, (3, 3))
    own = leaning(offset, (3, 3), comm=SELF)
    K = dense(residual(own, ufl.TrialFunction(own.V)))
    assert np.abs(K - K.T).max() > 1e-3
    problem = body.problem(Coulomb(0.3), residual(body, body.u))
    assert_all_found(critical_friction(problem), expected(K, own.V))


@pytest.mark.parametrize("stiffness", [2.0, 1e6])
def test_the_compliances_of_two_bodies_add(stiffness):
    """S = (S_1^-1 + S_2^-1)^-1 for the slip of matching nodes."""
    upper, lower = materials.LinearElastic(1.0, 1.0), materials.LinearElastic(stiffness, stiffness)

    def lean(domain):
        x = domain.geometry.x
        x[:, 0] += 1.2 * np.maximum(x[:, 1], 0)

    def of_one(material, cells, bottom, top, held):
        body = block(cells, (1.0, top - bottom), comm=SELF)
        body.domain.geometry.x[:, 1] += bottom
        lean(body.domain)
        K = dense(tangent(material.energy(body.u) * ufl.dx, body))
        face = nodes_of(body.V, lambda y: np.isclose(y[:, 1], 0))
        hold = nodes_of(body.V, lambda y: np.isclose(y[:, 1], held))
        return condensed(K, np.concatenate([2 * face, 2 * face + 1]), dofs(hold))

    both = two_blocks((3, 3), (3, 2))
    lean(both.domain)
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    energy = upper.energy(both.u) * dx(1) + lower.energy(both.u) * dx(2)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(0.3))
    found = critical_friction(ContactProblem(energy, both.u, [pair], bcs=both.bcs))
    parts = (of_one(upper, (3, 3), 0.0, 1.0, 1.0), of_one(lower, (3, 2), -0.5, 0.0, -0.5))
    S = np.linalg.inv(sum(np.linalg.inv(part) for part in parts))
    m = len(S) // 2
    assert_all_found(found, sorted_by_slips(S[:m, :m], S[m:, :m]))


@pytest.mark.parametrize(
    ("offset", "direction"), [(1.0, None), (1.0, (-7.0, 3.0)), (-1.0, (0.2, -5.0))]
)
def test_the_displacement_of_the_answer_slides_at_the_limit_of_friction(offset, direction):
    """Forces assembled here satisfy rt = F rn against the direction at each point."""
    body = leaning(offset)
    found = critical_friction(body.problem(Coulomb(0.3), energy_of(body)), direction)
    assert found.friction is not None
    sign = 1.0 if direction is None else np.sign(direction[0])
    body.u.x.array[:] = found.displacement.x.array
    forces = fem.assemble_vector(fem.form(ufl.derivative(energy_of(body), body.u)))
    forces.scatter_reverse(la.InsertMode.add)
    forces.scatter_forward()
    nodes = fem.locate_dofs_topological(body.V, 1, body.bottom)
    nodes = nodes[nodes < body.V.dofmap.index_map.size_local]
    parts = COMM.allgather([f.reshape(-1, 2)[nodes] for f in (forces.array, body.u.x.array)])
    r, a = (np.concatenate([p[i] for p in parts]) for i in range(2))
    assert_close(a[:, 1], np.zeros(len(a)), 1e-9)
    assert (sign * a[:, 0]).min() > -1e-9
    assert_close(sign * r[:, 0], found.friction * r[:, 1])


def test_open_and_stuck_points_take_no_part_in_the_slips_of_a_solution():
    """``direction="solution"``: open points are condensed, stuck ones held."""
    kinds = set()
    for shear, turn in ((0.08, 0.1), (0.02, 0.0), (-0.05, 0.12)):
        body = leaning(0.5, (6, 3))
        body.moved.interpolate(
            lambda x, s=shear, t=turn: np.stack([s + 0 * x[0], -0.02 - t * (0.8 - x[0])])
        )
        problem = body.problem(Coulomb(0.3), energy_of(body))
        letters = np.array(list(problem.solve().tables["contact"].status))
        kinds |= set(letters)
        sliding = np.isin(letters, ["+", "-"])
        if not sliding.any():
            continue
        found = critical_friction(problem, "solution")
        own = leaning(0.5, (6, 3), comm=SELF)
        K = dense(tangent(energy_of(own), own))
        bottom = nodes_of(own.V, lambda y: np.isclose(y[:, 1], 0))
        top = nodes_of(own.V, lambda y: np.isclose(y[:, 1], 1))
        slips = bottom[sliding]
        sign = np.where(letters[sliding] == "+", 1.0, -1.0)
        gone = np.concatenate([dofs(top), dofs(bottom[letters == "k"])])
        S = condensed(K, np.concatenate([2 * slips, 2 * slips + 1]), gone)
        m = len(slips)
        assert_all_found(found, sorted_by_slips(sign[:, None] * S[:m, :m] * sign, S[m:, :m] * sign))
        assert_close(found.positions[:, 0], own.V.tabulate_dof_coordinates()[slips, 0])
    assert len(kinds) >= 3
