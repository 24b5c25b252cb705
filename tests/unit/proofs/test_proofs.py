"""Proofs about bodies: all solutions at one gamma, and whether a solution is the only one."""

import time
from dataclasses import replace
from functools import partial

from mpi4py import MPI

import cases.ciarlet_geymonat
import cases.followed_mesh
import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import block, facets
from support.own_laws import SlipWeakening
from support.textbook import coulomb_system

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    ParametricContact,
    Tresca,
)
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.continuation.cone_rays import outgoing
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame
from dolfinx_contact.proofs import ReducedProblem, check
from dolfinx_contact.proofs.rays import apex_problem, prove_rays

COMM = MPI.COMM_WORLD


def found_at(system, gamma, **how):
    return find_solutions(system, [system.create_vector()], gamma, **how)


def words(system, solutions):
    return sorted(system.letters(s.piece) for s in solutions.found)


@pytest.mark.parametrize(("gamma", "count"), [(1.0, 3), (-1.0, 1), (0.0, 1)])
@pytest.mark.verifies(
    "all solutions",
    "certificates",
    reference="itself: the checker of proofs",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_all_solutions_of_a_triangle_are_proved(gamma, count):
    """16 nodes, F = 1.9: three solutions, one under the opposite load, and none but rest."""
    system = linear_triangle(16, 1.9)
    solutions = found_at(system, gamma)
    assert solutions.complete
    assert "a proof of" in solutions.method
    assert len(solutions.found) == count
    if gamma == 1:
        rest = 15 * "o" + "d"
        assert words(system, solutions) == ["-" + rest, "k" + rest, "o" + rest]
    b = system.create_vector()
    for s in solutions.found:
        assert system.residual(s.x, gamma, b, s.piece) < 1e-12
        assert system.residual(s.x, gamma, b, None) < 1e-12
    if COMM.rank == 0:
        assert check(solutions.proof.certificate).verdict == "complete"
    system.destroy()


def square(kind, cells):
    """A body on a floor whose load (26, 4) or friction coefficient 3 is a function of gamma."""
    dim = 2 if cells == "triangles" else 3
    if dim == 2:
        domain = mesh.create_unit_square(COMM, 8, 8)
    else:
        domain = mesh.create_unit_cube(COMM, 2, 2, 2)
    held = lambda x: np.isclose(x[0], 1) | np.isclose(x[dim - 1], 1)  # noqa: E731
    sides = mesh.locate_entities_boundary(domain, dim - 1, held)
    bottom = mesh.locate_entities_boundary(domain, dim - 1, lambda x: np.isclose(x[dim - 1], 0))
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    bcs = [fem.dirichletbc(np.zeros(dim), fem.locate_dofs_topological(V, dim - 1, sides), V)]
    gamma = fem.Constant(domain, 1.0)
    factor = {"load": gamma, "squared load": gamma**2, "friction": 1.0}[kind]
    load = factor * ufl.as_vector((-26.0, *([0.0] * (dim - 2)), -4.0))
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    law = Coulomb(3.0 * gamma if kind == "friction" else 3.0)
    floor = HalfSpace((0,) * dim, (0,) * (dim - 1) + (1,))
    contact = ContactSurface(u, bottom, obstacle=floor, law=law)
    return ParametricContact(ContactProblem(energy, u, [contact], bcs=bcs), gamma)


@pytest.mark.parametrize("cells", ["triangles", "tetrahedra"])
@pytest.mark.parametrize("kind", ["squared load", "friction"])
@pytest.mark.verifies(
    "all solutions",
    reference="itself: the load proportional to gamma",
    aspects=("2D", "3D", "proofs"),
)
def test_a_proof_is_of_one_gamma_however_it_enters(kind, cells):
    """At gamma = 1 the problem is that with a load proportional to gamma, and gamma stays."""
    expected = square("load", cells)
    system = square(kind, cells)
    found, all_of_them = found_at(system, 1.0), found_at(expected, 1.0)
    assert found.complete
    assert words(system, found) == words(expected, all_of_them)
    half = found_at(system, 0.5)
    assert half.complete
    b = system.create_vector()
    for solutions, gamma in ((found, 1.0), (half, 0.5)):
        for solution in solutions.found:
            assert system.residual(solution.x, gamma, b, solution.piece) < 1e-12
    for s in (system, expected):
        s.destroy()


@pytest.mark.parametrize(
    ("n", "friction"),
    [(32, 1.8), *(pytest.param(n, 1.7, marks=pytest.mark.long) for n in (64, 128))],
)
def test_the_seed_example_is_complete(n, friction):
    """The three solutions of the linear triangle are all there are."""
    system = linear_triangle(n, friction)
    solutions = found_at(system, 1.0, proof_seconds=600)
    assert solutions.complete
    rest = (n - 1) * "o" + "d"
    assert words(system, solutions) == ["-" + rest, "k" + rest, "o" + rest]


def test_all_solutions_of_a_vee_are_proved():
    """13 nodes at a gamma between the folds."""
    args = cases.followed_mesh.arguments(["--size", "0.03"])
    system = cases.followed_mesh.system(args, COMM)
    solutions = found_at(system, 0.7)
    assert solutions.complete
    assert len(solutions.found) == 3


#: The outline of the V-shaped body of Ligursky and Renard (Appl. Math. Comput. 2014): a vertical
#: arm and one at 45 degrees, both 0.3 wide.
ARMS = [(0, 0), (0.15 + 0.15 * 2**0.5, 0)]
ARMS += [(0.15 + 0.8 / 2**0.5, 0.65 / 2**0.5), (0.15 + 0.5 / 2**0.5, 0.95 / 2**0.5)]
ARMS += [(0.3, 0.15 + 0.15 * 2**0.5), (0.3, 0.8), (0, 0.8)]


@pytest.mark.parametrize(("gamma", "count"), [(0.38, 1), (0.4, 3)])
@pytest.mark.verifies(
    "all solutions",
    "certificates",
    reference="paper: Ligurský and Renard (2014), the V-shaped body",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_vee_of_the_literature_has_its_solutions(gamma, count, monkeypatch):
    """Their data, F = 1.8, in 1 s; the mesh decides from which load on there are three."""
    monkeypatch.setattr(cases.followed_mesh, "VEE", ARMS)
    force = ("--body-force", "-5", "1", "-5", "-8")
    args = cases.followed_mesh.arguments(["--size", "0.03", "--friction", "1.8", *force])
    system = cases.followed_mesh.system(args, COMM)
    start = time.process_time()
    solutions = found_at(system, gamma)
    assert time.process_time() - start < 1
    assert solutions.complete
    found = words(system, solutions)
    rest = (len(found[0]) - 1) * "o"
    assert found == ["-" + rest, "k" + rest, "o" + rest][-count:]


def test_missing_proof_is_reported():
    system = linear_triangle(10, 1.9)
    solutions = found_at(system, 1.0, proof_seconds=0)
    assert not solutions.complete
    assert solutions.proof is None
    with pytest.raises(ValueError, match="must be a nonnegative number"):
        found_at(system, 1.0, proof_seconds=-1)


def plate(left, right, *, gap=0.0, push=(0.01, -0.02), n=10):
    """A block on two floors, one under each half, the right one lower by a gap."""
    domain = mesh.create_unit_square(COMM, n, n)
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    V = u.function_space
    bottom = facets(domain, 1, 0.0)
    middle = mesh.compute_midpoints(domain, 1, bottom)[:, 0] if len(bottom) else np.zeros(0)
    bcs = [
        fem.dirichletbc(
            np.array(push), fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0)), V
        )
    ]
    floors = [HalfSpace((0.0, height), (0.0, 1.0)) for height in (0.0, -gap)]
    surfaces = [
        ContactSurface(u, bottom[side], obstacle=floor, law=law, name=name)
        for side, floor, law, name in (
            (middle < 0.45, floors[0], left, "left"),
            (middle > 0.55, floors[1], right, "right"),
        )
    ]
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, surfaces, bcs=bcs)


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("left", "right", "gap"),
    [
        (Coulomb(0.3), Coulomb(0.5), 0.0),
        (Coulomb(0.3), Frictionless(), 0.004),
        (Frictionless(), Frictionless(), 0.0),
    ],
)
@pytest.mark.verifies(
    "several laws at once",
    "uniqueness",
    "Signorini",
    reference="itself: a proof of all solutions",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_several_surfaces_have_a_proved_solution(left, right, gap):
    """Different coefficients, gaps, none: the solution is the only one, and both proofs say so."""
    problem = plate(left, right, gap=gap)
    problem.solve()
    assert problem.uniqueness().verdict == "proved"
    system = ParametricContact(problem)
    solutions = found_at(system, 0.0)
    assert solutions.complete
    (one,) = solutions.found
    x = system.create_vector()
    problem.write(x)
    assert (one.x - x).norm() <= 1e-8 * x.norm()


@pytest.mark.parametrize("right", [pytest.param(Tresca(2.0), marks=pytest.mark.long), Coulomb(0.4)])
@pytest.mark.verifies(
    "uniqueness",
    "Tresca",
    "certificates",
    reference="itself: a proof of all solutions",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_solutions_of_trescas_law_are_proved(right):
    """Tresca's law on one floor, and another or the same on the other, with open points."""
    problem = plate(Tresca(3.0), right, gap=0.004)
    result = problem.solve()
    assert problem.uniqueness().verdict == "proved"
    assert "k" in result.tables["left"].status
    system = ParametricContact(problem)
    solutions = found_at(system, 0.0)
    assert solutions.complete
    assert solutions.proof.verdict == "complete"
    (one,) = solutions.found
    x = system.create_vector()
    problem.write(x)
    assert (one.x - x).norm() <= 1e-8 * x.norm()
    assert system.letters(one.piece) == "".join(t.status for t in result.tables.values())
    given_up = found_at(system, 0.0, proof_seconds=1e-9, lengths=[0.5], max_iterations=1)
    assert not given_up.complete
    assert given_up.proof.verdict == "open"
    assert "deflation" in given_up.method
    assert words(system, given_up) in ([], words(system, solutions))


def triangle(n, friction, gamma):
    system = linear_triangle(n, friction)
    system.set_parameter(gamma)
    return system.problem


def test_one_point_has_its_certificate_of_uniqueness():
    problem = triangle(16, 1.7, -1.0)
    problem.solve()
    found = problem.uniqueness()
    assert found.verdict == "proved"
    assert found.reason == "the certificate of one point"
    assert found.other is None


@pytest.mark.verifies(
    "uniqueness",
    reference="itself: the other solution, from which a solve ends at once",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_another_solution_comes_with_a_solution_in_the_plane(caplog):
    """One of three solutions: another one comes with it, and a warning."""
    problem = triangle(16, 1.9, 1.0)
    result = problem.solve()
    mine = result.tables["contact"].status
    found = problem.uniqueness()
    assert found.verdict == "others exist"
    assert COMM.rank > 0 or "is not the only one" in caplog.text
    problem.restore(found.other)
    again = problem.solve()
    assert again.iterations <= 1
    assert again.tables["contact"].status != mine
    assert again.tables["contact"].status in found.reason + "d"


@pytest.mark.ranks(2)
def test_open_triangle_is_proved_by_search():
    """F = 1.7: lifted off, with no other solution; that takes more than one point."""
    problem = triangle(16, 1.7, 1.0)
    problem.solve()
    shorter = problem.uniqueness()
    assert shorter.verdict == "not proved"
    assert "proof_seconds=60 searches for a proof" in shorter.reason
    longer = problem.uniqueness(proof_seconds=60)
    assert longer.verdict == "proved"
    assert "a proof of" in longer.reason


@pytest.mark.ranks(2)
def test_uniqueness_refuses_a_state_under_another_load():
    system = linear_triangle(8, 1.7)
    system.problem.solve()
    system.set_parameter(1.0)
    words = r"not a solution of the problem as it is now: residual [\d.e+-]+ \(allowed 1e-06\)"
    with pytest.raises(ValueError, match=words + r"; solve again if .* `step.uniqueness\(\)`"):
        system.problem.uniqueness()


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (partial(block, material=NeoHookean(*lame(1000.0, 0.3))), "linear bodies"),
        (
            partial(block, law=SlipWeakening(0.6, 0.3, 0.01)),
            "laws of Coulomb and Tresca",
        ),
        (partial(block, method="integral"), "nodal or mixed contact"),
    ],
)
def test_problems_without_certificates_are_reported(make, reason):
    problem = make()
    problem.solve()
    found = problem.uniqueness()
    assert found.verdict == "not proved"
    assert reason in found.reason


OPEN = 0
STICK = 1
SLIP = 2


def decided(system, codes):
    """The cone of a state in which some points are inside the borders of a status."""
    allowed = system.allowed.copy()
    inequalities = system.inequalities.copy()
    for i, code in codes.items():
        allowed[i] = np.arange(4) == code
        inequalities[i] = 0.0
    return replace(system, allowed=allowed, inequalities=inequalities)


def random_cone(rng, m, codes, friction):
    G = rng.standard_normal((2 * m, 2 * m))
    S = G @ G.T / m + 0.1 * np.eye(2 * m)
    q = rng.standard_normal(2 * m)
    S = (S + S.T) / 2
    system = coulomb_system(S, np.zeros(2 * m), q, friction)
    whole = ReducedProblem(S, q, np.full(m, friction))
    return whole, system, decided(system, codes)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.verifies(
    "rays out of a kink",
    "certificates",
    reference="enumeration: the rays of all pieces",
    aspects=(
        "2D",
        "proofs",
    ),
    alone=True,
)
def test_rays_at_the_apex_agree_with_enumeration(seed):
    """Three points at their apex, one open and one stuck: the rays of 4^3 pieces."""
    rng = np.random.default_rng(seed)
    friction = rng.uniform(0.2, 4.0)
    whole, system, cone = random_cone(rng, 5, {1: OPEN, 3: STICK}, friction)
    known = outgoing(cone)
    assert known.complete
    assert all(ray.rate != 0 for ray in known.rays)
    found = prove_rays(apex_problem(whole, system, cone), [], proof_seconds=30)
    assert found.verdict == "complete"
    mine = sorted((rate, codes.tolist()) for codes, rate in found.rays)
    assert mine == sorted((ray.rate, ray.codes.tolist()) for ray in known.rays)


def test_cones_without_proof_have_a_reason():
    """A slipping point does work along a ray, of any sign."""
    rng = np.random.default_rng(4)
    whole, system, cone = random_cone(rng, 3, {1: SLIP}, 1.0)
    assert "1 points slip" in apex_problem(whole, system, cone)
    whole, system, cone = random_cone(rng, 2, {0: OPEN, 1: STICK}, 1.0)
    assert "no point is at its apex" in apex_problem(whole, system, cone)


def rays_at(system, gamma):
    """Rays out of the unloaded state, with a proof."""
    x = system.create_vector()
    condensed = system.condensed(x, gamma)
    cone = condensed.system.tangent_cone(condensed.contract(x), 1e-9)
    return outgoing(cone, prove=partial(system.prove_rays, condensed))


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "rays out of a kink",
    "hyperelastic bodies",
    reference="itself: three rays to either side",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_hyperelastic_block_has_its_proved_rays():
    """The 20 x 40 block of the seed: 21 points at their apex, three rays to either side."""
    found = rays_at(cases.ciarlet_geymonat.block(20, 40, 1.0), 0.0)
    assert found.complete
    assert found.method.count("a proof of") == 2
    assert sorted(ray.rate for ray in found.rays) == 3 * [-1.0] + 3 * [1.0]


def test_proof_without_time_is_open():
    system = linear_triangle(16, 1.9)
    assert rays_at(system, 0.0).complete
    system.proof_seconds = 0.0
    found = rays_at(system, 0.0)
    assert not found.complete
    assert "proof" not in found.method
    system.proof_seconds = 1e-9
    found = rays_at(system, 0.0)
    assert not found.complete
    assert "a proof was tried" in found.method
    ranks = [1.0 + COMM.rank] if COMM.size > 1 else []
    for bad in (-1.0, np.nan, "1", True, *ranks):
        system.proof_seconds = bad
        with pytest.raises(ValueError, match="seconds"):
            rays_at(system, 0.0)
