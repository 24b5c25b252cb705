"""Contact problems solved by the classical algorithms, by name, beside Newton's method."""

import json
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import cases.greco_block
import numpy as np
import pytest
from support.blocks import block, half_block

from dolfinx_contact import (
    ConvergenceError,
    Coulomb,
    Frictionless,
    HalfSpace,
    Tresca,
)
from dolfinx_contact.algorithms import (
    GaussSeidel,
    Lemke,
    Penalty,
    TrescaFixedPoint,
    Uzawa,
)

COMM = MPI.COMM_WORLD
STORED = json.loads((Path(__file__).parents[2] / "data" / "blocks.json").read_text())
ALL = [
    "sor",
    "gauss-seidel",
    "projected-gradient",
    "lemke",
    "interior-point",
    "tresca",
    TrescaFixedPoint(aitken=True),
    Uzawa(augmented=True),
]


def named(algorithm):
    return algorithm if isinstance(algorithm, str) else algorithm.described()


def greco(n):
    return cases.greco_block.problem(cases.greco_block.arguments(["--n", str(n)]), COMM)


def check(problem, algorithm, accuracy=1e-8):
    """From zero the algorithm ends in Newton's solution; its result."""
    x = problem.create_vector()
    problem.read(x)
    known = {k: t for k, t in problem.solve().tables.items()}
    problem.read(x)
    found = problem.solve(algorithm=algorithm)
    for name, table in found.tables.items():
        other = known[name]
        force = np.abs(other.force).max()
        length = max(np.abs(other.ut).max(), np.abs(other.un).max())
        np.testing.assert_allclose(table.force, other.force, rtol=0, atol=accuracy * force)
        np.testing.assert_allclose(table.ut, other.ut, rtol=0, atol=accuracy * max(length, 1e-3))
        assert table.status == other.status
    assert found.converged
    assert found.imbalance < accuracy
    assert len(found.attempts) == 1
    return found


def check_stored(case, algorithm, accuracy=1e-8):
    """Like `check`, with forces and statuses of an independent code."""
    data = STORED[case]
    dim = data["dim"]
    friction = data["F"]
    problem = block(
        n=data["n"],
        cell="quad" if dim == 2 else "hex",
        law=Coulomb(friction),
        top=data["top"],
        young=data["E"],
        poisson=data["nu"],
    )
    found = check(problem, algorithm, accuracy)
    table = found.tables["contact"]
    order = np.lexsort(np.round(data["x"], 9).T[::-1])
    rn = -np.array(data["ln"])[order]
    rt = np.array(data["lt"])[order]
    np.testing.assert_allclose(table.rn, rn, rtol=0, atol=accuracy * rn.max())
    np.testing.assert_allclose(table.rt[:, : dim - 1], rt, rtol=0, atol=accuracy * rn.max())
    sticks = np.linalg.norm(rt, axis=1) < (1 - 1e-6) * friction * rn
    slips = np.where(rt[:, 0] < 0, "+", "-") if dim == 2 else "s"
    assert "".join(table.status) == "".join(np.where(sticks, "k", slips))
    return found


@pytest.mark.ranks(2)
@pytest.mark.parametrize("algorithm", ALL, ids=named)
@pytest.mark.verifies(
    "Tresca's fixed point",
    "Uzawa",
    "SOR",
    "Gauss-Seidel",
    "projected gradient",
    "Lemke",
    "interior point",
    reference="independent code: GetFEM, every nodal force",
    aspects=("2D",),
)
def test_classical_algorithms_agree_in_the_plane(algorithm):
    check_stored("b2d_n8", algorithm)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    "algorithm",
    [algorithm for algorithm in ALL if algorithm not in ("projected-gradient", "lemke")],
    ids=named,
)
@pytest.mark.verifies(
    "Gauss-Seidel",
    "SOR",
    "interior point",
    "Tresca's fixed point",
    "Uzawa",
    reference="independent code: GetFEM, every nodal force",
    aspects=("3D",),
)
def test_classical_algorithms_solve_in_space(algorithm):
    check_stored("b3d_n4", algorithm)


@pytest.mark.ranks(2)
def test_plain_uzawa_converges_at_first_order():
    PETSc.Options()["contact_snes_rtol"] = 1e-5
    result = check(block(n=2, cell="quad"), "uzawa", 1e-3)
    assert 50 < result.iterations < 1000


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.verifies(
    "penalty",
    reference="itself: Newton's method",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_penalty_extrapolates_to_its_accuracy(dim):
    """Extrapolated to 1e-4 and better, at first order."""
    found = check(block(n=3, cell="quad" if dim == 2 else "hex"), Penalty(), 1e-4)
    assert abs(found.attempts[0].series["order"][-1] - 1) < 0.1


@pytest.mark.parametrize(
    "law", [Frictionless(), Tresca(2.0), Coulomb(0.8)], ids=lambda law: type(law).__name__
)
@pytest.mark.parametrize("algorithm", ["tresca", "interior-point", "gauss-seidel"])
@pytest.mark.verifies(
    "Tresca's fixed point",
    "interior point",
    "Gauss-Seidel",
    "Signorini",
    "Tresca",
    "Coulomb",
    reference="itself: Newton's method",
    aspects=("2D",),
)
def test_classical_algorithms_solve_other_laws(law, algorithm):
    check(block(n=3, cell="tri", law=law), algorithm)


@pytest.mark.ranks(2)
def test_classical_algorithms_keep_a_node_on_its_symmetry_plane():
    """A contact node whose tangential displacement is prescribed."""
    for algorithm in ("gauss-seidel", "interior-point", "lemke", "tresca"):
        check(half_block(), algorithm)


@pytest.mark.verifies(
    "mixed contact",
    "SOR",
    "Tresca's fixed point",
    "Uzawa",
    reference="itself: Newton's method",
    aspects=("2D",),
)
def test_classical_algorithms_solve_mixed_contact_on_a_tilted_plane():
    tilted = HalfSpace((0.5, 0.0), (0.03, 1))
    problem = block(n=4, cell="tri", obstacle=tilted, method="mixed")
    for algorithm in ("sor", "tresca", Uzawa(augmented=True)):
        assert check(problem, algorithm).counts["open"] > 0


@pytest.mark.ranks(2)
def test_what_fails_is_told_and_leaves_the_functions():
    """Too few sweeps, and a cycle of the fixed point at large friction, each as it is."""
    problem = greco(8)
    problem.u.x.array[:] = 1e-6
    before = problem.u.x.array.copy()
    with pytest.raises(ConvergenceError, match="no convergence in 3 iterations") as caught:
        problem.solve(algorithm=GaussSeidel(max_iterations=3))
    (attempt,) = caught.value.attempts
    assert attempt.iterations == 3
    assert len(attempt.steps) == 4
    assert not attempt.converged
    np.testing.assert_array_equal(problem.u.x.array, before)
    problem.surfaces[0].law.friction.value = 20.0
    with pytest.raises(ConvergenceError, match=r"cycle|diverge|no convergence|not solved"):
        problem.solve(algorithm=TrescaFixedPoint(max_iterations=60))
    np.testing.assert_array_equal(problem.u.x.array, before)


@pytest.mark.long
@pytest.mark.parametrize(
    "algorithm",
    [*ALL, "uzawa", Penalty()],
    ids=named,
)
@pytest.mark.parametrize("case", ["greco 32", *(k for k in STORED if k != "source")])
@pytest.mark.verifies(
    "penalty",
    "Uzawa",
    "projected gradient",
    "Gauss-Seidel",
    "SOR",
    "interior point",
    "Tresca's fixed point",
    reference="independent code: GetFEM, every nodal force",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_algorithms_meet_stored_forces(algorithm, case):
    """Stored forces and Newton's solution to 1e-8 from zero, extrapolated penalties to 1e-4."""
    plane_only = isinstance(algorithm, Lemke) or algorithm == "lemke"
    if plane_only and case.startswith("b3d"):
        pytest.skip("for the plane")
    PETSc.Options()["contact_snes_rtol"] = 1e-11
    accuracy = 1e-4 if isinstance(algorithm, Penalty) else 1e-8
    if case in STORED:
        found = check_stored(case, algorithm, accuracy)
    else:
        found = check(greco(32), algorithm, accuracy)
    if isinstance(algorithm, Penalty):
        assert abs(found.attempts[0].series["order"][-1] - 1) < 0.1
