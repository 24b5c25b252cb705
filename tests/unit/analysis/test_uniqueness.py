"""What a result says of other solutions, against proofs of all, enumeration and theorems."""

import json
from pathlib import Path

from mpi4py import MPI

import demo_block
import demo_greco_block
import numpy as np
import pytest
from _triangle import linear_triangle
from support.blocks import block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    Coulomb,
    Frictionless,
    ParametricContact,
    Sphere,
    Tresca,
)
from dolfinx_contact.analysis import renard_criterion
from dolfinx_contact.analysis.theory import theory_of
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import LinearElastic, NeoHookean, lame

COMM = MPI.COMM_WORLD
ORACLE = json.loads((Path(__file__).parents[2] / "data" / "blocks.json").read_text())


def oracle_block(case):
    o = ORACLE[case]
    given = dict(dim=o["dim"], n=o["n"], friction=o["F"], young=o["E"], poisson=o["nu"])
    given |= dict(shift=o["top"][0], press=-o["top"][-1])
    return demo_block.problem(demo_block.arguments([f"--{k}={v}" for k, v in given.items()]), COMM)


def greco(n):
    return demo_greco_block.problem(demo_greco_block.arguments(["--n", str(n)]), COMM)


def all_solutions(problem):
    """All solutions, with a proof that there are no others."""
    system = ParametricContact(problem, fem.Constant(problem.V.mesh, 0.0))
    found = find_solutions(system, [system.create_vector()], 0.0)
    system.destroy()
    return found


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    "make",
    [lambda: oracle_block("b2d_n8"), lambda: oracle_block("b2d_n16"), lambda: greco(32)],
    ids=["block 8", "block 16", "greco"],
)
@pytest.mark.verifies(
    "uniqueness",
    "certificates",
    reference="itself: a proof of all solutions",
    aspects=(
        "2D",
        "proofs",
    ),
)
def test_the_only_solution(make):
    """The certificate of one point and the proof of all solutions say the same."""
    problem = make()
    problem.solve()
    x = problem.create_vector()
    problem.write(x)
    assert problem.uniqueness().verdict == "proved"
    found = all_solutions(problem)
    assert found.complete
    (one,) = found.found
    assert (one.x - x).norm() <= 1e-8 * x.norm()


@pytest.mark.ranks(2)
@pytest.mark.parametrize("case", ["b3d_n4", "b3d_n6"])
@pytest.mark.verifies(
    "uniqueness",
    "Renard's criterion",
    reference="theorem: Renard's criterion",
    aspects=(
        "3D",
        "proofs",
    ),
)
def test_the_only_solution_in_space(case):
    """The certificate of one point, which is proved with round-off, and the criterion agree."""
    problem = oracle_block(case)
    problem.solve()
    found = problem.uniqueness()
    assert (found.verdict, found.reason) == ("proved", "the certificate of one point")
    assert 3 < renard_criterion(problem).factor < 4


def test_a_proof_in_space_beyond_the_criterion():
    """All points slip; the criterion holds up to F = 0.9, the certificate has bounds as well."""
    problem = block(n=4, cell="hex", law=Coulomb(1.5), top=(0.05, 0.0, -0.01))
    problem.solve()
    assert renard_criterion(problem).factor < 1
    found = problem.uniqueness()
    assert (found.verdict, found.reason) == ("proved", "the certificate of one point")
    assert all_solutions(problem).complete


def test_no_proof_in_space_of_a_body_that_gives_way():
    """On an anti-elastic bedding, where the criterion means nothing."""
    held = block(n=2, cell="hex")
    energy = LinearElastic.from_young(1000.0, 0.3).energy(held.u) - 500 * ufl.dot(held.u, held.u)
    problem = ContactProblem(energy * ufl.dx, held.u, held.contacts, bcs=held.bcs)
    problem.solve()
    found = problem.uniqueness()
    assert found.verdict == "not proved"
    assert "positive definite" in found.reason


@pytest.mark.ranks(2)
def test_summary_with_and_without_a_verdict():
    problem = block(n=4)
    result = problem.solve()
    assert "unique" not in result.summary()
    assert result.summary(problem.uniqueness())["unique"] == "proved"


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("kind", "law", "exists", "unique", "words"),
    [
        ({}, Frictionless(), True, True, "least energy"),
        ({}, Tresca(2.0), True, True, "least energy"),
        ({}, Coulomb(0.0), True, True, "least energy"),
        ({"cell": "hex", "n": 2}, Tresca(2.0), True, True, "least energy"),
        ({"cell": "hex", "n": 2}, Coulomb(3.0), True, False, "every coefficient"),
        ({"method": "mixed"}, Coulomb(3.0), True, False, "every coefficient"),
        ({"method": "integral"}, Frictionless(), False, False, "node by node"),
        ({"material": NeoHookean(*lame(1e3, 0.3))}, Frictionless(), False, False, "not linear"),
    ],
)
@pytest.mark.verifies(
    "uniqueness",
    "Tresca",
    "Signorini",
    reference="theorem: a strictly convex energy has one least point",
    aspects=(
        "2D",
        "3D",
        "proofs",
    ),
)
def test_theory(kind, law, exists, unique, words):
    theory = block(law=law, **kind).theory()
    assert (theory.exists, theory.unique) == (exists, unique)
    assert words in theory.reason


@pytest.mark.parametrize(
    ("sliding", "unique", "words"),
    [("small", True, "least energy"), ("large", False, "follow the displacement")],
)
def test_theory_on_a_curved_obstacle(sliding, unique, words):
    """In large sliding the displacements without penetration are no convex set."""
    disc = Sphere((0.5, -3.0), 3.0)
    problem = block(law=Frictionless(), obstacle=disc, sliding=sliding)
    theory = problem.theory()
    assert (theory.exists, theory.unique) == (unique, unique)
    assert words in theory.reason
    problem.solve()
    assert (problem.uniqueness().verdict == "proved") == unique


@pytest.mark.parametrize("law", [Frictionless(), Tresca(2.0)])
@pytest.mark.verifies(
    "uniqueness",
    "Tresca",
    "Signorini",
    reference="theorem: a strictly convex energy has one least point",
    aspects=(
        "3D",
        "proofs",
    ),
)
def test_theory_proves_in_space(law):
    """No certificate, but a strictly convex energy."""
    problem = block(n=2, cell="hex", law=law)
    problem.solve()
    found = problem.uniqueness()
    assert found.verdict == "proved"
    assert "least energy" in found.reason


@pytest.mark.parametrize(("soft", "unique"), [(0.0, True), (2e4, False)])
def test_theory_looks_at_the_stiffness(soft, unique):
    """On an anti-elastic bedding the energy is not convex any more."""
    held = block(law=Frictionless())
    u = held.u
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) - soft * ufl.dot(u, u)
    problem = ContactProblem(energy * ufl.dx, u, held.contacts, bcs=held.bcs)
    theory = theory_of(problem.equations)
    assert theory.unique == unique
    assert unique or "positive definite" in theory.reason


@pytest.mark.ranks(2)
def test_of_a_point_of_a_branch():
    system = linear_triangle(4, 1.7)
    found = find_solutions(system, [system.create_vector()], 1.0)
    system.set_parameter(1.0)
    before = [f.x.array.copy() for f in system.problem.fields]
    for point in found.points(system):
        state = system.state_at(point)
        assert state.gamma == 1.0
        verdict = system.problem.uniqueness(state=state).verdict
        assert (verdict == "proved") == (len(found.found) == 1)
    for f, values in zip(system.problem.fields, before, strict=True):
        np.testing.assert_array_equal(f.x.array, values)


@pytest.mark.parametrize("value", [np.nan, -1.0])
def test_nothing_is_proved_of_bad_friction(value):
    friction = []

    def law(domain):
        friction.append(fem.Constant(domain, 0.3))
        return Coulomb(friction[0])

    problem = linear_triangle(2, 0.3, law=law).problem
    problem.solve()
    friction[0].value = value
    for ask in (problem.theory, problem.uniqueness):
        with pytest.raises(ValueError, match="friction"):
            ask()


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "uniqueness",
    reference="itself: a proof of all solutions",
    aspects=("2D", "proofs"),
)
def test_other_friction_under_open_points():
    """Where nothing touches, the state solves the problem of any friction; the answer is for it."""
    friction = []

    def law(domain):
        friction.append(fem.Constant(domain, 2.5))
        return Coulomb(friction[0])

    system = linear_triangle(8, 2.5, law=law)
    found = find_solutions(system, [system.create_vector()], 1.0)
    assert found.complete
    assert len(found.found) == 3
    (apart,) = [s for s in found.found if not set(system.letters(s.piece)) & set("k+-")]
    system.set_parameter(1.0)
    system.problem.read(apart.x)
    result = system.problem.solve()
    assert result.counts["stick"] == result.counts["slip"] == 0
    assert system.problem.uniqueness().verdict == "others exist"
    friction[0].value = 0.1
    assert system.problem.uniqueness().verdict == "proved"


@pytest.mark.ranks(2)
def test_seconds_that_are_none():
    problem = block(n=2)
    problem.solve()
    assert problem.uniqueness(proof_seconds=1.0).verdict == "proved"
    ranks = [1.0 + COMM.rank] if COMM.size > 1 else []
    for seconds in (np.nan, -1.0, True, "a", None, *ranks):
        with pytest.raises(ValueError, match="seconds"):
            problem.uniqueness(proof_seconds=seconds)


@pytest.mark.each_value
@pytest.mark.parametrize("start", [0.0, 0.01, 100.0])
@pytest.mark.parametrize("cell", ["tri", "hex"])
def test_nothing_but_round_off(cell, start, caplog):
    """Without load a state is zero, wherever the solve begins: no data have changed."""
    dim = 2 if cell == "tri" else 3
    problem = block(cell=cell, top=[0.0] * dim)
    for f, size in zip(problem.fields, (start, 1000.0 * start), strict=True):
        f.x.array[:] = size * np.sin(np.arange(1, len(f.x.array) + 1))
        f.x.scatter_forward()
    result = problem.solve()
    assert result.kkt_violation <= 1e-9
    assert result.imbalance <= 1e-9
    assert not caplog.records
    found = problem.uniqueness(proof_seconds=1.0)
    if cell == "hex":
        assert found.verdict == "proved"
    if start == 0.01:
        QuasiStatic(problem, lambda t: None).run([0.0, 1.0])
    assert not [r for r in caplog.records if "is no solution under the load" in r.message]
