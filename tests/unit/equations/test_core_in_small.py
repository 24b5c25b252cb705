"""Small parts of the core whose answers are known beforehand."""

from dataclasses import FrozenInstanceError, dataclass, is_dataclass
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from scipy.linalg import block_diag, null_space
from scipy.optimize import brentq
from scipy.special import exp1
from support.blocks import block, box, facets, half_block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    BilinearCohesive,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    MaxwellLayer,
    NonlocalCoulomb,
    ParametricContact,
    Regularised,
    RigidBody,
    Sphere,
    Tresca,
    laws,
)
from dolfinx_contact.algorithms import load_points
from dolfinx_contact.equations.data import Constancy, Datum
from dolfinx_contact.equations.evaluation import _turning, differs
from dolfinx_contact.equations.jacobian import _Numbering
from dolfinx_contact.equations.measures import held_back, least_scales
from dolfinx_contact.equations.order import Gathered
from dolfinx_contact.equations.parametric import ParametricEquations
from dolfinx_contact.equations.rigid_bodies import RigidBodies
from dolfinx_contact.equations.scaling import automatic_augmentation, softness
from dolfinx_contact.equations.sliding import _Block
from dolfinx_contact.laws import Internal, LawAtPoints, PointData
from dolfinx_contact.laws.cones import _bounds, _plane
from dolfinx_contact.laws.coulomb import violation
from dolfinx_contact.laws.damage import _solved
from dolfinx_contact.laws.interface import Interface
from dolfinx_contact.laws.interface_state import Rates
from dolfinx_contact.laws.law import Border, StatusPiece, _as_key, checked_pieces
from dolfinx_contact.laws.spreading import KERNELS, whole
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK
from dolfinx_contact.laws.still import _Decided
from dolfinx_contact.materials import LinearElastic, NeoHookean
from dolfinx_contact.points.memory import Memory, with_memory
from dolfinx_contact.reduced import Reduction, scope
from dolfinx_contact.reduced.held_body import (
    HeldBody,
    HeldField,
    columns_of,
    is_positive_definite,
)
from dolfinx_contact.solvers.condensation import CondensedBlock
from dolfinx_contact.solvers.operator import ContactOperator
from dolfinx_contact.solvers.surface_block import SurfaceBlock, SurfaceSet, contact_dofs

COMM = MPI.COMM_WORLD


@dataclass(frozen=True)
class Oil(Interface):
    """A film that resists slip by its rate alone, pressed or not."""

    viscosity: Any
    needs_pressure = False
    needs_time = ("viscosity",)

    def dissipation(self, rates, state):
        return self.viscosity * rates.slip**2 / 2


def at_points(law, jump, traction, step=-1.0, **fields):
    """A law at points on a floor at y = 0 without a gap, a time after they were at rest."""
    at = LawAtPoints(law, jump.shape[1], len(jump), COMM)
    given = {name: np.full(len(jump), float(v)) for name, v in law.given.items()} | fields
    normal = np.tile(-np.eye(jump.shape[1])[-1], (len(jump), 1))
    data = PointData(normal, np.zeros(len(jump)), np.ones(len(jump)), given)
    rest = Memory(np.zeros_like(jump), step=step)
    return at(jump, traction, with_memory(at.compiled, rest, data))


@pytest.mark.skipif(COMM.size > 1, reason="one point")
def test_viscous_friction_at_a_point():
    """Shears by c |u_t|/dt against the slip, and sticks where nothing drags."""
    u = np.array([0.0, 0.2, -0.2])
    jump = np.column_stack([u, np.zeros(3)])
    traction = np.column_stack([-4.0 * np.sign(u), np.ones(3)])
    found = at_points(Oil(3.0), jump, traction, step=0.5)
    np.testing.assert_array_equal(found.required, [STICK, PLUS, MINUS])
    shear = found.traction(found.required)[:, 0]
    np.testing.assert_allclose(shear, -3.0 * u / 0.5, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(found.bound, np.abs(shear), rtol=1e-13, atol=1e-15)


@pytest.mark.skipif(COMM.size > 1, reason="one point")
def test_a_layer_with_friction_at_some_points():
    """Where its coefficient is 0 a point that is pressed slips, as with `Coulomb(0)`."""
    jump = np.zeros((2, 2))
    traction = np.tile([0.0, 1.0], (2, 1))
    law = MaxwellLayer(3.0, 2.0, 1.0, friction=0.5)
    found = at_points(law, jump, traction, friction=np.array([0.0, 0.5]))
    np.testing.assert_array_equal(found.required, [PLUS, STICK])


@pytest.mark.skipif(COMM.size > 1, reason="one point")
def test_an_open_point_closes_against_its_displacement():
    """By one of two borders, at a distance of its gap."""
    jump = np.array([[0.1, 0.05], [-0.1, 0.02]])
    found = at_points(Coulomb(0.5), jump, np.zeros((2, 2)))
    borders = found.borders(np.full(2, OPEN, dtype=np.int8))
    for k, (code, gap) in enumerate([(PLUS, 0.05), (MINUS, 0.02)]):
        there = np.isfinite(borders.distance[k])
        assert borders.target[k, there].tolist() == [code]
        np.testing.assert_allclose(borders.distance[k, there], gap, rtol=1e-14)


@pytest.mark.skipif(COMM.size > 1, reason="five points")
def test_an_open_point_closes_to_one_status():
    """Under friction that is linear up to a slip: creeping below it, slipping beyond."""
    u = np.array([-0.2, -0.12, 0.05, 0.12, 0.2])
    law = Regularised(Coulomb(0.5), 0.1)
    found = at_points(law, np.column_stack([u, np.full(5, 0.03)]), np.zeros((5, 2)))
    borders = found.borders(np.full(5, OPEN, dtype=np.int8))
    for k, code in enumerate([MINUS, MINUS, STICK, PLUS, PLUS]):
        there = np.isfinite(borders.distance[k])
        assert borders.target[k, there].tolist() == [code]


@pytest.mark.skipif(COMM.size > 1, reason="three points")
def test_what_a_status_holds_misses_nothing():
    """However far inside it a point is."""
    jump = np.array([[0.0, 0.5], [0.0, 0.0], [0.3, 0.0]])
    traction = np.array([[0.0, 0.0], [0.1, 1.0], [-0.5, 1.0]])
    found = at_points(Coulomb(0.5), jump, traction)
    np.testing.assert_array_equal(found.required, [OPEN, STICK, PLUS])
    np.testing.assert_array_equal(found.missed, 0.0)


def test_what_is_given_to_a_law_does_not_change():
    with pytest.raises(FrozenInstanceError):
        Rates(1.0, {}).slip = 2.0


def test_laws_do_not_change():
    """So that they may be shared, and known by what they are."""
    with_fields = [k for k in (getattr(laws, name) for name in laws.__all__) if is_dataclass(k)]
    assert {Coulomb, BilinearCohesive} <= set(with_fields)
    assert all(law.__dataclass_params__.frozen for law in with_fields)


def test_settings_of_laws_that_are_equal_numbers_differ():
    """By what they print; what has no hash is known by that as well."""
    for a, b in ((0.0, -0.0), (1, True), (1, 1.0)):
        assert a == b
        assert _as_key(a) != _as_key(b)
    for method in (len, property(len)):
        assert _as_key(method) is method

    class NoHash:
        __hash__ = None

        def __call__(self):
            pass

    one = NoHash()
    assert _as_key(one) == repr(one)


def test_violations_of_the_law_in_the_plane():
    """In units of the largest force, if that is above 1."""
    for (ut, un, rt, rn), expected in (
        ((0.0, 0.0, 0.0, 0.5), 0.0),
        ((0.0, -0.1, 0.0, 0.0), 0.1),
        ((0.0, 0.0, 0.0, -4.0), 1.0),
        ((0.0, 0.2, 0.0, 0.1), 0.1),
        ((0.0, 0.3, 0.0, 5.0), 0.3),
        ((0.0, 0.0, 3.0, 4.0), 0.25),
        ((0.1, 0.0, -2.0, 4.0), 0.0),
        ((0.1, 0.0, 2.0, 4.0), 0.1),
        ((2.0, 0.0, 2.0, 4.0), 1.0),
    ):
        state = (np.array([v, w]) for v, w in zip((ut, un, rt, rn), (0, 0, 0, 0), strict=True))
        found = violation(*state, np.full(2, 0.5), np.zeros(2))
        assert found == pytest.approx(expected, rel=1e-14, abs=1e-300)


def test_conditions_that_a_step_decides():
    """Of no length; what depends on more is not decided, unless the rest does that."""
    domain = box(COMM, 1, "tri")
    step, more = (ufl.variable(fem.Constant(domain, 1.0)) for _ in range(2))
    yes, no, other = ufl.gt(step, -1.0), ufl.gt(step, 1.0), ufl.gt(more, 0.0)
    decided = _Decided(step, 0.0)
    for condition, expected in (
        (yes, True),
        (no, False),
        (other, None),
        (ufl.Not(no), True),
        (ufl.Not(other), None),
        (ufl.And(yes, yes), True),
        (ufl.And(yes, no), False),
        (ufl.And(other, no), False),
        (ufl.And(other, yes), None),
        (ufl.Or(no, no), False),
        (ufl.Or(other, yes), True),
        (ufl.Or(other, no), None),
    ):
        assert decided._answer(condition) is expected


@pytest.mark.parametrize("place", ["exists", "where"])
def test_conditions_of_pieces_that_are_none(place):
    """Numbers, truths and UFL that is no condition, in the second of two pieces."""
    zero = ufl.as_ufl(0.0) * ufl.as_vector([1.0, 1.0])
    for bad in (True, 1.0, ufl.as_ufl(1.0)):
        exists, where = (bad, None) if place == "exists" else (None, bad)
        borders = [Border(ufl.as_ufl(1.0), OPEN), Border(ufl.as_ufl(1.0), OPEN, where)]
        pieces = {OPEN: StatusPiece(zero, []), PLUS: StatusPiece(zero, borders, exists)}
        with pytest.raises(ValueError, match="status 2: exists and where must be a Condition"):
            checked_pieces(pieces, 2)


def test_senses_of_variables():
    """By which they change is known of those that only fall or grow."""
    senses = {kind: Internal("x", kind).sense for kind in ("any", "falls", "grows")}
    assert senses == {"any": 0, "falls": -1, "grows": 1}


def test_kernels_in_closed_form():
    """Their integrals over line and plane, and nothing from the radius on."""
    expected = {
        ("biweight", 2): 16 / 15,
        ("biweight", 3): np.pi / 3,
        ("mollifier", 2): 0.44399381616807943782 * np.e,
        ("mollifier", 3): np.pi * (1 - np.e * exp1(1.0)),
    }
    for (kernel, dim), integral in expected.items():
        assert whole(kernel, dim) == pytest.approx(integral, rel=1e-9)
        np.testing.assert_array_equal(KERNELS[kernel](np.array([0.0, 1.0, 1.5])), [1.0, 0.0, 0.0])


def test_inequalities_that_others_imply():
    """Of x >= 0, y >= 0 and x + 2 y >= 0 the last is left out, in any units of each."""
    rows = np.array([[[1.0, 0.0], [0.0, 1.0], [1.0, 2.0]]])
    expected = np.zeros((1, 3, 4))
    expected[0, 0, 1] = expected[0, 1, 3] = 1.0
    there = np.ones((1, 3), dtype=bool)
    for units in ([1.0, 1.0, 1.0], [1.0, 1e-12, 1.0], [1e-12, 1.0, 1e12]):
        slopes = rows * np.array(units)[:, None]
        np.testing.assert_allclose(_bounds(slopes, [1, 3], there), expected, atol=1e-15)
    kept = _bounds(rows, [1, 3], np.array([[True, False, True]]))
    np.testing.assert_allclose(kept[0, :2, [1, 3]].T, [[1.0, 0.0], [0.5, 1.0]], atol=1e-15)


def test_planes_of_statuses_are_well_conditioned():
    """By Cramer's rule no coordinate is larger than 1 where the largest minor is inverted."""
    rng = np.random.default_rng(2)
    for sizes in ([1.0, 1e-3, 1.0, 1e-6], [1e-6, 1.0, 1e-3, 1.0], [1.0, 1.0, 1e-6, 1e-6]):
        rows = rng.normal(size=(1, 2, 4)) * sizes
        B, free = _plane(rows, np.ones(1, dtype=bool))
        np.testing.assert_allclose(rows @ B, 0.0, atol=1e-15)
        np.testing.assert_array_equal(B[0, free], np.eye(2))
        assert np.abs(B).max() <= 1.0 + 1e-9


@pytest.mark.parametrize("p", [0.25, 1.0, 5.0])
def test_a_step_of_damage_in_closed_form(p):
    """The y of y + k y^p = 1 for k of any size, from 1e-13 to 1e13."""
    for log in np.linspace(-30.0, 30.0, 31):
        y = _solved(ufl.as_ufl(float(log)), p)(())
        x = brentq(lambda x, k=log: np.logaddexp(-x, k - p * x), -1.0, 200.0, xtol=1e-15)
        assert y == pytest.approx(np.exp(-x), rel=2e-11)


def test_the_pattern_of_blocks_has_every_entry_once():
    """Of nodes that several blocks have, one of which is fixed along its second axis."""
    two = np.arange(2)
    rows = np.array([[0, 1], [1, 3]])[:, :, None] * 2 + two
    rows[rows == 3] = -1
    columns = np.array([[0, 2, 4], [4, 1, -1]])[:, :, None] * 2 + two
    columns[1, 2] = -1
    rows_found, columns_found = _Block(rows, columns).pattern()
    nodes = {(0, 0), (0, 2), (0, 4), (1, 0), (1, 2), (1, 4), (1, 1), (3, 4), (3, 1)}
    places = {0: (0, 1), 1: (2, -1), 3: (6, 7)}
    expected = {(row, 2 * j + k) for i, j in nodes for row in places[i] for k in two}
    found = list(zip(rows_found.tolist(), columns_found.tolist(), strict=True))
    assert set(found) == expected
    assert len(found) == len(expected)


@pytest.mark.ranks(2, 3)
def test_places_of_columns_that_other_ranks_have():
    """In any order, as of each dof by itself."""
    eq = block(n=4).equations
    numbering = _Numbering(eq)
    nodes = eq.V.dofmap.index_map
    columns = np.random.default_rng(COMM.rank).permutation(2 * nodes.size_global)
    first, end = nodes.local_range
    found = numbering.column_places(columns, (2 * first, 2 * end))
    np.testing.assert_array_equal(found, numbering.dof_places(0, columns))
    fixed = COMM.allreduce(int(eq.fixed[: 2 * nodes.size_local].sum()))
    assert (found < 0).sum() == fixed > 0


@pytest.mark.ranks(2, 3)
def test_points_of_all_ranks_in_one_order():
    """By x, then y, then what distinguishes them, however they are numbered and rounded off."""
    x = np.array([[0.0, 0.0], [0.0, 1.0], [0.5, -1.0], [0.5, 2.0], [0.5, 2.0], [1.0, 0.0]])
    ids = np.array([[0, 3], [0, 2], [0, 9], [1, 7], [2, 5], [0, 1]])
    n = len(x)
    order = np.random.default_rng(COMM.rank).permutation(n)
    aside = np.array([10.0, 0.0])
    shifted = x + COMM.rank * aside
    noise = 1e-13 * (-1.0) ** np.arange(2 * n).reshape(n, 2)
    known = Gathered(COMM, (shifted + noise)[order], ids[order])
    everywhere = np.concatenate([x + rank * aside for rank in range(COMM.size)])
    assert len(known) == n * COMM.size
    np.testing.assert_allclose(known.positions, everywhere, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(known.mine, n * COMM.rank + order)
    np.testing.assert_array_equal(known(ids[order, 1]), np.tile(ids[:, 1], COMM.size))
    orders = COMM.allgather(order)
    for i in range(len(known)):
        rank, place = known.owner(i)
        assert (rank, orders[rank][place]) == divmod(i, n)


def on_this_rank(A):
    """A dense matrix as one of PETSc, of this rank alone."""
    found = PETSc.Mat().createDense(A.shape, array=np.ascontiguousarray(A), comm=MPI.COMM_SELF)
    found.setUp()
    found.assemble()
    return found.convert("aij", PETSc.Mat())


@pytest.mark.parametrize("symmetric", [True, False])
def test_a_held_body_in_numpy(symmetric):
    """Displacements, forces, answers to many loads, residuals, signs of what may move."""
    rng = np.random.default_rng(7)
    n = 7
    K = rng.normal(size=(n, n))
    K = K + K.T + np.diag(np.linspace(-4.0, 6.0, n))
    A = rng.normal(size=(3, n))
    C = A if symmetric else rng.normal(size=(3, n))
    free = np.ones(n)
    if not symmetric:
        free[2] = 0.0  # no force acts there
    unit = 2.5
    blocks = [[on_this_rank(part) for part in (B[:1], B[1:])] for B in (A, C)]
    without = None if symmetric else np.array([2])
    forces = None if symmetric else blocks[1]
    field = HeldField(on_this_rank(K), blocks[0], forces, without)
    body = HeldBody(MPI.COMM_SELF, [field], unit, counted=symmetric)
    whole = np.block([[K, (C * free).T], [A, np.zeros((3, 3))]])
    b, c = rng.normal(size=n), rng.normal(size=3)
    exact = np.linalg.solve(whole, np.concatenate([b, c]))
    found = body.solve(b, c[:1], c[1:])
    assert [len(part) for part in found] == body.sizes == [n, 1, 2]
    np.testing.assert_allclose(np.concatenate(found), exact, rtol=1e-11)
    left = body.left()
    assert 0 < left < 1e-11
    assert left > np.linalg.norm(whole @ np.concatenate(found) - np.concatenate([b, c]))
    np.testing.assert_allclose(body.solve(b)[0], np.linalg.solve(whole, [*b, 0, 0, 0])[:n])
    loads = rng.normal(size=(n, 4)) * (rng.uniform(size=(n, 4)) < 0.5)
    seen = rng.normal(size=(2, n))
    motions, held = body.respond(columns_of(on_this_rank(loads.T)), on_this_rank(seen))
    every = np.linalg.solve(whole, np.vstack([loads, np.zeros((3, 4))]))
    np.testing.assert_allclose(motions, seen @ every[:n], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(held, every[n : n + 1], rtol=1e-10, atol=1e-12)
    if symmetric:
        left = null_space(A)
        negative = int((np.linalg.eigvalsh(left.T @ K @ left) < 0).sum())
        assert 0 < negative < n - 3
        assert body.signs == (negative, 0)
    body.destroy()


def test_a_body_is_positive_definite_by_both():
    """Where it is symmetric, and has no pivot that is not positive."""
    for A, definite in (
        ([[2.0, 1.0], [1.0, 2.0]], True),
        ([[1.0, 2.0], [2.0, 1.0]], False),
        ([[2.0, 1.0], [0.0, 2.0]], False),
    ):
        body = HeldBody(MPI.COMM_SELF, [HeldField(on_this_rank(np.array(A)), [])], 1.0)
        assert body.definite is definite
        body.destroy()


def on_two_sides(number, beyond=-1.0, n=2):
    """A square in a corner, held on its top; on the wall there is contact above a height."""
    domain = box(COMM, n, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    wall = HalfSpace((0.0, 0.0), (1.0, 0.0))
    side = mesh.locate_entities_boundary(
        domain, 1, lambda x: np.isclose(x[0], 0.0) & (x[1] > beyond)
    )
    sides = [("floor", facets(domain, 1, 0.0), floor), ("wall", side, wall)]
    surfaces = [
        ContactSurface(u, side, name=name, obstacle=o, law=Coulomb(0.3)) for name, side, o in sides
    ]
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    bcs = [fem.dirichletbc(np.zeros(2), top, V)]
    return ContactProblem(energy, u, surfaces[:number], bcs=bcs)


NO_POINT_PROBLEMS = {
    "contact at the nodes": lambda: block(n=2, method="integral", degree=2),
    "the law of Coulomb or Tresca": lambda: block(n=2, law=Regularised(Coulomb(0.3), 1e-3)),
    "a body that is linear": lambda: block(n=2, material=NeoHookean(400.0, 600.0)),
    "contact nodes that Dirichlet data do not hold in part": lambda: half_block(
        n=2, method="mixed"
    ),
    "surfaces without common nodes": lambda: on_two_sides(2),
}


@pytest.mark.parametrize("what", NO_POINT_PROBLEMS)
def test_what_is_no_problem_of_its_points(what):
    with pytest.raises(ValueError, match=f"the reduced problem needs {what}"):
        Reduction.of(NO_POINT_PROBLEMS[what]().equations)


def test_what_is_a_problem_of_its_points():
    """Points on an axis of symmetry are guided, and have no friction; the others do."""
    problems = half_block(n=2, method="nodal"), on_two_sides(1), block(n=2)
    for problem, guided in zip(problems, (True, False, False), strict=True):
        with Reduction.of(problem.equations) as reduction:
            assert reduction.always_solvable
            assert reduction.guided is guided
            friction = problem.equations.surfaces[0].law.given["friction"]
            expected = np.full(3, float(friction))
            expected[0] *= not guided
            np.testing.assert_array_equal(reduction.points.friction, expected)
            np.testing.assert_array_equal(reduction.points.bound, 0.0)
            np.testing.assert_array_equal(reduction.points.reach, np.inf)
            points = reduction.problem(0.5)
            for error, of in ((points.S_error, points.S), (points.p_error, points.p)):
                assert 0 <= error.max() <= 1e-10 * np.abs(of).max()


def test_what_is_saved_is_at_a_parameter(tmp_path):
    """At 0 unless it is said."""
    file = COMM.bcast(tmp_path) / "points.npz"
    with Reduction.of(block(n=2).equations) as reduction:
        reduction.rate = np.ones_like(reduction.load)
        for given, gamma in (((), 0.0), ((2.0,), 2.0)):
            reduction.save(file, *given)
            COMM.barrier()
            np.testing.assert_array_equal(load_points(file).p, reduction.problem(gamma).p)
            COMM.barrier()
        assert (reduction.problem(0.0).p != reduction.problem(2.0).p).all()


@pytest.mark.ranks(2)
def test_the_stiffness_of_points_of_two_surfaces():
    """That of the body on the nodes of both, as numpy condenses it, in the frames of the points."""
    eq = on_two_sides(2, beyond=0.4, n=4).equations
    K = eq.bulk.stiffness(eq.bulk.displacement.x.array.copy())
    n = K.getLocalSize()[0]
    rows = K.getValues(range(*K.getOwnershipRange()), range(K.size[1]))
    X = eq.V.tabulate_dof_coordinates()[: n // 2, :2]
    rows, X, fixed = (np.concatenate(COMM.allgather(v)) for v in (rows, X, eq.fixed[:n]))
    with Reduction.of(eq) as reduction:
        points = reduction.problem()
        normals = reduction.points.frames[:, :, 1]
    distance = np.linalg.norm(points.positions[:, None] - X, axis=2)
    np.testing.assert_allclose(distance.min(axis=1), 0.0, atol=1e-12)
    on_wall = points.positions[:, 0] == 0.0
    on_wall &= points.positions[:, 1] > 0.0
    assert on_wall.tolist() == [False, True, True, False, False, False, False]
    np.testing.assert_allclose(np.abs(normals), np.where(on_wall[:, None], [1, 0], [0, 1]))
    mine = (2 * distance.argmin(axis=1)[:, None] + [0, 1]).reshape(-1)
    rest = np.setdiff1d(np.flatnonzero(~fixed.astype(bool)), mine)
    schur = rows[np.ix_(mine, mine)]
    inner = rows[np.ix_(rest, rest)]
    schur = schur - rows[np.ix_(mine, rest)] @ np.linalg.solve(inner, rows[np.ix_(rest, mine)])
    T = block_diag(*points.frames)
    np.testing.assert_allclose(points.S, T.T @ schur @ T, rtol=0, atol=1e-11 * np.abs(schur).max())


IN_SPACE = {
    "": lambda: block(n=1, cell="tet"),
    "the problem is not one in 3D": lambda: block(n=1),
    "the body, its loads or its motions are not linear": lambda: block(
        n=1, cell="tet", material=NeoHookean(400.0, 600.0)
    ),
    "contact is not at nodes": lambda: block(n=1, cell="tet", method="integral"),
    "there are more than 3 contact points": lambda: block(n=1, cell="tet"),
}


@pytest.mark.parametrize("what", IN_SPACE)
def test_what_is_no_problem_of_its_points_in_space(what, monkeypatch):
    """Nothing of a cube of one cell, whose 4 points may be too many."""
    monkeypatch.setattr(scope, "_MOST_POINTS", 3 if "more than" in what else 4)
    problem = IN_SPACE[what]()
    system = ParametricContact(problem, fem.Constant(problem.V.mesh, 0.0))
    assert scope.obstacle_in_space(system) == what


@pytest.mark.parametrize(
    ("slope", "law", "axes", "what"),
    [
        (0.0, Frictionless(), (0,), ""),
        (0.1, Frictionless(), (0,), "hold a component of contact nodes that is not a tangential"),
        (
            0.0,
            Coulomb(0.3),
            (0,),
            "hold one tangential displacement of contact nodes with friction",
        ),
        (0.0, Coulomb(0.3), (0, 1), ""),
    ],
)
def test_points_in_space_that_are_held_along_their_floor(slope, law, axes, what):
    """On one side of a cube: nothing against it where that is no part of distance or friction."""
    domain = box(COMM, 1, "tet")
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V)
    floor = HalfSpace((0.0, 0.0, 0.0), (slope, 0.0, 1.0))
    side, top = facets(domain, 0, 0.0), facets(domain, 2, 1.0)
    bcs = [
        fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(i), 2, side), V.sub(i)) for i in axes
    ]
    bcs.append(fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(V, 2, top), V))
    surface = ContactSurface(u, facets(domain, 2, 0.0), obstacle=floor, law=law)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    found = scope.obstacle_in_space(ParametricContact(problem, fem.Constant(domain, 0.0)))
    assert what in found if what else found == ""


def test_how_far_points_slide_on_a_sphere():
    """Half of what points have on the average; Tresca's bounds are forces of points."""
    sphere = Sphere((0.5, -5.0), 5.0)
    problem = block(n=4, law=Tresca(3.0), obstacle=sphere, sliding="small")
    with Reduction.of(problem.equations) as reduction:
        np.testing.assert_allclose(reduction.points.reach, 0.5 / 5, rtol=1e-12)
        width = np.array([0.125, 0.25, 0.25, 0.25, 0.125])
        np.testing.assert_allclose(reduction.points.bound, 3.0 * width, rtol=1e-12)
        np.testing.assert_array_equal(reduction.points.friction, 0.0)
        x = np.linspace(0.0, 1.0, 5)
        away = np.column_stack([x - 0.5, np.full(5, 5.0)])
        distance = np.linalg.norm(away, axis=1)
        np.testing.assert_allclose(reduction.points.gap, distance - 5.0, atol=1e-12)
        frames = reduction.points.frames
        np.testing.assert_allclose(frames[:, :, 1], away / distance[:, None], rtol=1e-12)
        np.testing.assert_allclose(frames[:, :, 0], frames[:, ::-1, 1] * [1, -1], rtol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_law_turns_with_its_normal(dim):
    """Of a rotation w = n x dn it is w x v, by the matrix of dn."""
    n, v, dn = np.random.default_rng(5).normal(size=(3, 4, dim))
    n /= np.linalg.norm(n, axis=1)[:, None]
    in_space = [np.pad(a, ((0, 0), (0, 3 - dim))) for a in (n, v, dn)]
    crossed = np.cross(np.cross(in_space[0], in_space[2]), in_space[1])[:, :dim]
    np.testing.assert_allclose(np.einsum("nij,nj->ni", _turning(n, v), dn), crossed, atol=1e-13)


@pytest.mark.ranks(2)
def test_lengths_of_states_in_closed_form():
    """Root mean squares over the size of the body; motions of rigid bodies over it as well."""
    domain = box(COMM, 3, "tri", size=2.0)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    lid = HalfSpace((0.0, 2.0), (0.0, -1.0))
    punch = RigidBody(lid, about=(1.0, 2.0), load={"x": 0.1, "y": -1.0}, held=["rz"])
    surface = ContactSurface(u, facets(domain, 1, 2.0), obstacle=punch, law=Coulomb(0.3))
    low = fem.locate_dofs_topological(V, 1, facets(domain, 1, 0.0))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(np.zeros(2), low, V)])
    system = ParametricContact(problem, fem.Constant(domain, 0.0))
    x, Mx = system.create_vector(), system.create_vector()
    X = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    size = 2.0 * np.sqrt(2.0)
    rigid = problem.equations.rigid.size
    fields = {
        "translation": (np.column_stack([3.0 + 0.0 * X[:, 0], 4.0 + 0.0 * X[:, 0]]), 0.0, 25.0),
        "stretch": (np.column_stack([X[:, 0], 0.0 * X[:, 0]]), 0.0, 4.0 / 3.0),
        "motion": (0.0 * X[:, :2], 0.5, 0.25 * rigid),
    }
    for values, motion, square in fields.values():
        tractions = [np.ones(n) for n in problem.equations.owned_sizes[1:-1]]
        problem.equations.put([values.reshape(-1), *tractions], np.full(rigid, motion), x)
        system.metric(x, Mx)
        assert x.dot(Mx) == pytest.approx(square / size**2, rel=1e-12)


def test_data_that_are_to_stay():
    """What has changed is said with its place, and put back; nothing is where there are none."""
    domain = box(COMM, 1, "tri")
    number = fem.Constant(domain, 2.0)
    stays = Constancy(COMM, [Datum("of the law", number)])
    none = Constancy(COMM, [])
    for value, changed in ((2.0, ""), (2.0 + 1e-9, ""), (3.0, "of the law (2.0 before, 3.0 now)")):
        number.value = value
        assert stays.changed() == changed
        assert none.changed() == ""
    stays.restore()
    assert number.value == 2.0


@pytest.mark.parametrize(("cell", "parts"), [("tri", 3), ("quad", 3), ("tet", 4), ("hex", 4)])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_the_softness_of_an_isotropic_body(cell, parts, poisson):
    """Of 2 mu among 2 mu and 3 lambda + 2 mu (2 lambda + 2 mu in the plane) it is closed."""
    problem = block(n=1, cell=cell, poisson=poisson)
    found = softness(problem.equations.bulk.for_products, problem.V)
    mu, lame = 1 / (2 * (1 + poisson)), poisson / ((1 + poisson) * (1 - 2 * poisson))
    assert found == pytest.approx(parts * mu / (parts * mu + lame), rel=1e-10)


@pytest.mark.parametrize(
    ("gap", "rate", "distance"),
    [
        ((0.5, 0.8), (0.25, 1.0), 0.8),
        ((0.5, 0.8), (0.25, -1.0), 2.0),
        ((0.0, 0.8), (0.25, 1.0), 0.0),
        ((0.5, 0.8), (-0.25, -1.0), 0.0),
    ],
)
def test_how_far_a_body_may_go(gap, rate, distance):
    """Until it touches first; nowhere where it does, or never will."""
    surface = SimpleNamespace(rigid_body="punch")
    bodies = SimpleNamespace(
        comm=COMM, size=1, bodies=["punch"], slices=[slice(0, 1)], surfaces=[surface]
    )
    found = RigidBodies.free_distances(bodies, [np.array(gap)], [np.array(rate)])
    assert found.tolist() == [distance]


def test_how_far_contact_holds_nodes_back():
    """The traction over the stiffness of a node; between nodes over the largest of all."""
    found = SimpleNamespace(traction=np.array([[3.0, 4.0], [0.0, 2.0], [9.0, 0.0]]))
    stiffness = np.array([10.0, 1.0, 0.0, 20.0])
    for E, expected in ((None, 2.0), ("operator", 9.0 / 20.0)):
        surface = SimpleNamespace(points=SimpleNamespace(E=E))
        assert held_back(surface, found, stiffness) == pytest.approx(expected, rel=1e-14)
        assert held_back(surface, SimpleNamespace(traction=np.zeros((0, 2))), np.zeros(0)) == 0.0


@pytest.mark.parametrize("value", [0.0, np.inf, np.nan])
def test_a_body_without_a_stiffness_is_refused(value):
    problem = block(n=1)
    K = problem.equations.bulk.stiffness(problem.u.x.array.copy()).copy()
    K.zeroEntries()
    diagonal = K.createVecLeft()
    diagonal.set(value)
    K.setDiagonal(diagonal)
    extents = np.ones(len(problem.u.x.array) // 2)
    with pytest.raises(ValueError, match="the stiffness of the bulk is zero or not finite"):
        automatic_augmentation(K, 0.5, problem.V, problem.surfaces, extents)


def test_what_a_system_has_made_is_freed():
    freed = []
    things = [SimpleNamespace(destroy=lambda i=i: freed.append(i)) for i in range(3)]
    names = "_metric", "_mass_in", "_mass_out"
    system = SimpleNamespace(**dict(zip(names, things, strict=True)))
    for _ in range(2):
        ParametricEquations.destroy(system)
        assert freed == [0, 1, 2]


def test_where_statuses_differ():
    a, b = (np.array(codes, dtype=np.int8) for codes in ([0, 1, 2, 3], [0, 2, 1, 3]))
    both = differs([a, b], [b, b])
    assert [d.tolist() for d in both] == [[False, True, True, False], [False] * 4]


def test_what_counts_as_no_displacement():
    """Less than 1e-12 of the body, and a force that moves a node by no more."""
    eq = block(n=2, domain=box(COMM, 2, "tri", size=3.0)).equations
    none = 3e-12 * np.sqrt(2.0)
    for length in (0.0, 0.9 * none):
        force, size = least_scales(eq, length)
        assert size == pytest.approx(none, rel=1e-12)
        assert force == pytest.approx(none * eq.stiffness_scale, rel=1e-12)
    assert least_scales(eq, 1.1 * none) == (0.0, 0.0)


@pytest.mark.parametrize(("beyond", "times"), [(-1.0, 1), (0.4, 0)])
def test_common_nodes_of_surfaces_are_said(beyond, times, caplog):
    """Of floor and wall that have the corner in common, and not where a facet is left out."""
    on_two_sides(2, beyond)
    said = sum("surfaces floor and wall share nodes" in r.message for r in caplog.records)
    assert said == (times if COMM.rank == 0 else 0)


def test_which_stiffness_is_positive_definite():
    """The elastic one is; not its negative, one without a node, one that is not symmetric."""
    eq = block(n=2).equations
    K = eq.bulk.stiffness(eq.bulk.displacement.x.array.copy()).copy()
    free = np.flatnonzero(~eq.fixed[: eq.owned_sizes[0]])[:1] + K.getOwnershipRange()[0]
    assert is_positive_definite(eq, K)
    loose = K.copy()
    loose.zeroRowsColumns(free.astype(PETSc.IntType), diag=0.0)
    assert not is_positive_definite(eq, loose)
    K.scale(-1.0)
    assert not is_positive_definite(eq, K)
    K.scale(-1.0)
    K.zeroRows(free.astype(PETSc.IntType), diag=eq.stiffness_scale)
    assert not is_positive_definite(eq, K)


@pytest.mark.ranks(2)
def test_the_block_of_a_surface_is_inverted():
    """As it stands and condensed, which multipliers at nodes are, removed ones too."""
    eq = half_block(n=2, method="nodal").equations
    operator = ContactOperator(eq)
    s = SurfaceSet(operator)
    rng = np.random.default_rng(COMM.rank)
    x, y = eq.create_vector(), eq.create_vector()
    blocks = []
    for _ in range(2):
        x.array[:] = rng.normal(size=x.local_size)
        operator.update(eq.contact(x))
        if not blocks:
            blocks = [of(operator, s, "block_") for of in (SurfaceBlock, CondensedBlock)]
            assert blocks[1].applies
        square = operator.stiffness.createSubMatrix(s.of_body, s.of_body)
        for inverse in blocks:
            inverse.set_stiffness(square)
            inverse.update()
            b = rng.normal(size=len(s.local))
            x.set(0.0)
            x.array[s.local] = inverse.solve(b)
            operator.matrix.mult(x, y)
            np.testing.assert_allclose(y.array[s.local], b, atol=1e-10)
    for thing in (*blocks, s, operator):
        thing.release()
    known = [v for v in vars(blocks[1]).values() if isinstance(v, PETSc.Object)]
    assert known
    assert not any(known)  # all are destroyed


@pytest.mark.ranks(2)
@pytest.mark.parametrize("cell", ["tri", "tet"])
def test_dofs_of_what_is_in_contact(cell):
    """Those of the nodes of its facets and no others; of nodes, too, whose facets others own."""
    domain = box(COMM, 3, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    x = V.tabulate_dof_coordinates()
    domain.topology.create_connectivity(dim - 1, dim)
    every = mesh.exterior_facet_indices(domain.topology)
    every = every[every < domain.topology.index_map(dim - 1).size_local]
    compared = []
    for rank in range(COMM.size):
        mine = every if rank == COMM.rank else every[:0]
        side = SimpleNamespace(opposite=None)
        s = SimpleNamespace(submesh=SimpleNamespace(parent_facets=mine), obstacle=side)
        there = x[np.unique(fem.locate_dofs_topological(V, dim - 1, mine, remote=False))]
        there = np.concatenate(COMM.allgather(there))
        off = np.linalg.norm(x[:, None] - there, axis=2).min(axis=1)
        nodes = np.flatnonzero(off[: V.dofmap.index_map.size_local] < 1e-9)
        expected = (dim * nodes[:, None] + np.arange(dim)).reshape(-1)
        found = contact_dofs(SimpleNamespace(V=V, surfaces=[s]))
        whole = COMM.allreduce(len(found)), dim * len(np.unique(there.round(9), axis=0))
        compared.append((found, expected, whole))
    for found, expected, whole in compared:  # by then no rank waits for another
        np.testing.assert_array_equal(found, expected)
        assert whole[0] == whole[1]


def test_a_multiplier_that_several_dofs_answer_is_not_condensed():
    """As of contact at points between the nodes; nothing of it is left."""
    eq = block(n=2, method="integral").equations
    operator = ContactOperator(eq)
    s = SurfaceSet(operator)
    operator.update(eq.contact(eq.create_vector()))
    condensed = CondensedBlock(operator, s, "block_")
    assert not condensed.applies
    assert condensed._T.getInfo()["nz_used"] == 0
    for thing in (condensed, s, operator):
        thing.release()


def has_pieces(problem, **how):
    """Whether a problem has affine pieces at its contact points."""
    system = ParametricContact(problem, fem.Constant(problem.V.mesh, 0.0))
    return scope.can_condense(system, **how)


def test_which_laws_have_affine_pieces():
    """Coulomb's, whose pieces are cones, and Tresca's; not another with a bound of its own kind."""
    for law, cones, pieces in (
        (Coulomb(0.3), True, True),
        (Tresca(0.3), False, True),
        (NonlocalCoulomb(0.3, 0.5), False, False),
        (Regularised(Coulomb(0.3), 1e-3), False, False),
    ):
        problem = block(n=2, law=law, method="nodal")
        assert has_pieces(problem) is cones
        assert has_pieces(problem, bounded=True) is pieces


def test_so_many_points_have_affine_pieces(monkeypatch):
    """As many as are allowed, of which the 3 of this block."""
    monkeypatch.setattr(scope, "_MOST_POINTS", 3)
    assert has_pieces(block(n=2))
    monkeypatch.setattr(scope, "_MOST_POINTS", 2)
    assert not has_pieces(block(n=2))


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_points_that_are_held_along_their_floor(slope):
    """Without friction: affine pieces where what is held is no part of the distance."""
    domain = box(COMM, 2, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    floor = HalfSpace((0.0, 0.0), (slope, 1.0))
    side, top = facets(domain, 0, 0.0), facets(domain, 1, 1.0)
    bcs = [
        fem.dirichletbc(0.0, fem.locate_dofs_topological(V.sub(0), 1, side), V.sub(0)),
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, top), V),
    ]
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Frictionless())
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    assert not has_pieces(problem)
    assert has_pieces(problem, partly=True) is (slope == 0.0)


def test_what_is_along_a_surface_that_turns():
    """The rate of the part of a jump along it, by differences; normals keep their length."""
    rng = np.random.default_rng(2)
    jump, n, rate = rng.normal(size=(3, 5, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    rate -= np.sum(rate * n, axis=1)[:, None] * n
    memory = Memory(jump)
    h = 1e-6
    differences = (memory.reference(n + h * rate) - memory.reference(n - h * rate)) / (2 * h)
    np.testing.assert_allclose(memory.reference_rate(n, rate), differences, atol=1e-8)


@pytest.mark.parametrize(
    ("S", "exact", "solvable"),
    [
        ([[1.0, 0.0], [0.0, 1e-9]], True, True),
        ([[1.0, 0.0], [0.0, 1e-11]], True, False),
        ([[1.0, 0.0], [0.0, -0.1]], True, False),
        ([[1.0, 9.0], [-9.0, 1.0]], True, True),
        ([[1.0, 0.0], [0.0, 1.0]], False, False),
    ],
)
def test_where_there_is_a_solution_at_every_parameter(S, exact, solvable):
    """By the symmetric part of an exact stiffness."""
    known = SimpleNamespace(S=np.array(S), exact=exact)
    assert Reduction.always_solvable.func(known) is solvable
