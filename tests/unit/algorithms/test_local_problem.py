"""Problems u = W r + q of FCLib and Siconos, with a regular or a singular compliance."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from dolfinx_contact.algorithms import (
    GaussSeidel,
    LocalProblem,
    PointProblem,
    load_local,
    load_points,
    save_points,
)
from dolfinx_contact.proofs import ReducedProblem, prove_solutions

SICONOS = Path(__file__).parents[2] / "data" / "siconos"


def rigid_block(velocity, friction):
    """A rigid block of unit mass and inertia on points at x = -1 and 1, with a given velocity.

    Its velocities (x, y, rotation) move a point with J; the compliance J J^T has the rank 3.
    """
    J = np.array([[1, 0, 0], [0, 1, -1], [1, 0, 0], [0, 1, 1]], dtype=float)
    return LocalProblem(J @ J.T, J @ velocity, np.full(2, friction))


def random_problem(dim, points=4, seed=3):
    rng = np.random.default_rng(seed)
    n = dim * points
    B = rng.normal(size=(n, n))
    return PointProblem(B @ B.T + n * np.eye(n), rng.normal(size=n), np.full(points, 0.4))


def as_text(problem, storage):
    """The text of Siconos, with the normal first and numbers by columns."""
    d, n = problem.dim, len(problem.p)
    order = np.roll(np.arange(n).reshape(-1, d), 1, axis=1).reshape(-1)
    W, q = problem.A[np.ix_(order, order)], problem.free.reshape(-1)[order]
    m = problem.number

    def words(values):
        return " ".join(f"{v:.17g}" for v in np.ravel(values)) + "\n"

    if storage == 0:
        text = f"{n} {n}\n" + words(W.T)
    elif storage == 1:
        ends = words(np.arange(d, n + 1, d))
        text = f"{m * m}\n{m}\n{m}\n{ends}{ends}{m + 1}\n{m * m}\n"
        text += words(np.arange(0, m * m + 1, m)) + words(np.tile(np.arange(m), m))
        for number in range(m * m):
            i, j = divmod(number, m)
            text += f"{number}\n" + words(W[d * i : d * i + d, d * j : d * j + d].T)
    else:
        text = "2\nCSparse Version 3.1.9\n"
        text += f"{n}-by-{n}, nzmax: {n * n} nnz: {n * n}, 1-norm: 1\n"
        for j in range(n):
            text += f"    col {j} : locations {n * j} to {n * j + n - 1}\n"
            text += "".join(f"      {i} : {W[i, j]:.17g}\n" for i in range(n))
    return f"{d}\n{m}\n{storage}\n{n}\n{n}\n" + text + words(q) + words(problem.friction)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["dense", "blocks", "sparse", "fclib"])
@pytest.mark.verifies(
    "point problems in files",
    reference="itself: the problem that was written",
    aspects=("2D", "3D"),
)
def test_a_problem_read_back_is_the_same(dim, kind, tmp_path):
    problem = random_problem(dim)
    if kind == "fclib":
        pytest.importorskip("h5py")
        file = tmp_path / "points.hdf5"
        save_points(file, problem)
    else:
        file = tmp_path / "points.dat"
        file.write_text(as_text(problem, ("dense", "blocks", "sparse").index(kind)))
    read = load_points(file)
    np.testing.assert_allclose(read.S, problem.S, rtol=1e-12, atol=1e-12 * problem.S.max())
    np.testing.assert_allclose(read.p, problem.p, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(read.friction, problem.friction)


@pytest.mark.parametrize("storage", [0, 1, 2])
def test_truncated_text_is_refused(storage, tmp_path):
    text = as_text(random_problem(2), storage)
    file = tmp_path / "points.dat"
    for size in np.linspace(1, len(text) * 0.97, 25).astype(int):
        file.write_text(text[:size])
        with pytest.raises(ValueError, match=r"points\.dat: "):
            load_local(file)


def test_an_unknown_storage_and_a_missing_file_are_named(tmp_path):
    file = tmp_path / "points.dat"
    with pytest.raises(FileNotFoundError, match="there is no file"):
        load_local(file)
    file.write_text("2 1 7 2 2 1 0 0 1 0 0 0.3")
    with pytest.raises(ValueError, match="unknown storage 7"):
        load_local(file)


@pytest.mark.parametrize(
    ("name", "points"),
    [("FrictionContactProblem00394", 6), ("FrictionContactProblem00031", 11)],
)
@pytest.mark.verifies(
    "point problems in files",
    "all solutions",
    reference="independent code: problems of Siconos",
    aspects=("2D", "proofs"),
)
def test_a_plane_problem_of_siconos_has_one_proved_solution(name, points):
    problem = load_local(SICONOS / f"{name}.dat")
    assert problem.number == points
    found = [problem.solve(algorithm) for algorithm in ("lemke", "gauss-seidel")]
    for solution in found:
        assert solution.violation < 1e-10
    size = np.abs(found[0].r).max()
    np.testing.assert_allclose(found[0].r, found[1].r, rtol=0, atol=1e-8 * size)
    regular = problem.points()
    proved = prove_solutions(ReducedProblem(regular.S, regular.p, regular.friction))
    assert proved.verdict == "complete"
    assert len(proved.solutions) == 1


@pytest.mark.parametrize("name", ["FC3D_Example1_SBM", "Rover4396"])
def test_siconos_problem_in_space_is_solved(name):
    problem = load_local(SICONOS / f"{name}.dat")
    solution = problem.solve()
    assert solution.violation < 1e-10
    points = problem.points()
    again = GaussSeidel().run(points, tolerance=1e-12)
    np.testing.assert_allclose(again.r, solution.r, atol=1e-8 * np.abs(solution.r).max())


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "lemke"])
def test_a_rigid_block_at_rest_has_one_free_self_stress(algorithm):
    """It presses each point with half the momentum; opposite shears do not move the block."""
    problem = rigid_block([0.0, -1.0, 0.0], 0.5)
    assert problem.rank == 3
    solution = problem.solve(algorithm)
    assert solution.violation < 1e-10
    np.testing.assert_allclose(solution.r[:, 1], 0.5, atol=1e-9)
    np.testing.assert_allclose(solution.u, 0.0, atol=1e-9)
    assert problem.reaction_freedom(solution) == 1
    with pytest.raises(ValueError, match=r"singular \(rank 3 of 4\)"):
        problem.points()


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "lemke"])
def test_a_rigid_block_that_slides_has_unique_forces(algorithm):
    problem = rigid_block([1.0, -1.0, 0.0], 0.3)
    solution = problem.solve(algorithm)
    np.testing.assert_allclose(solution.r, [[-0.15, 0.5]] * 2, atol=1e-9)
    np.testing.assert_allclose(solution.u[:, 0], 0.7, atol=1e-9)
    assert problem.reaction_freedom(solution) == 0


@pytest.mark.skipif(importlib.util.find_spec("h5py") is None, reason="needs h5py")
def test_a_global_problem_is_condensed(tmp_path):
    """W = H^T M^-1 H and q = H^T M^-1 f + w."""
    import h5py

    rng = np.random.default_rng(1)
    H = rng.normal(size=(5, 6))
    M = np.diag(rng.uniform(1, 2, 5))
    f, w = rng.normal(size=5), rng.normal(size=6)
    with h5py.File(tmp_path / "global.hdf5", "w") as data:
        group = data.create_group("fclib_global")
        group["spacedim"] = np.array([3])
        for name, values in (("vectors/f", f), ("vectors/w", w), ("vectors/mu", [0.3, 0.4])):
            group[name] = values
        for name, matrix in (("H", H), ("M", M)):
            rows, columns = np.nonzero(matrix)
            numbers = {"m": matrix.shape[0], "n": matrix.shape[1], "nz": len(rows)}
            for key, value in (numbers | {"nzmax": len(rows)}).items():
                group[f"{name}/{key}"] = np.array([value])
            for key, values in (("i", rows), ("p", columns), ("x", matrix[rows, columns])):
                group[f"{name}/{key}"] = values
    problem = load_local(tmp_path / "global.hdf5")
    W, q = H.T @ np.linalg.inv(M) @ H, H.T @ np.linalg.inv(M) @ f + w
    order = [1, 2, 0, 4, 5, 3]
    np.testing.assert_allclose(problem.W, W[np.ix_(order, order)], atol=1e-12)
    np.testing.assert_allclose(problem.q, q[order], atol=1e-12)
    assert problem.rank == 5


def test_points_without_friction_have_no_free_shears():
    solution = rigid_block([0.0, -1.0, 0.0], 0.0).solve()
    assert rigid_block([0.0, -1.0, 0.0], 0.0).reaction_freedom(solution) == 0


@pytest.mark.parametrize(
    ("W", "message"),
    [
        ([[2.0, 1.0], [0.0, 2.0]], "not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "negative eigenvalue"),
        ([[0.0, 0.0], [0.0, 1.0]], "compliance of a point"),
    ],
)
def test_compliances_that_are_none_are_refused(W, message):
    with pytest.raises(ValueError, match=message):
        LocalProblem(np.array(W), np.ones(2), np.array([0.3]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2 1 0 2 2 7 9 1 0 0 1 1 1 0.3", "two sizes of W differ"),
        ("2 1 0 3 3 3 3 1 0 0 0 1 0 0 0 1 1 1 1 0.3", r"W has the shape \(3, 3\)"),
        ("2 1 0 2 2 2 2 1 0 0 1 1 1 0.3 xyz", "could not convert"),
        ("2 1 0 2 2 2 2 1 0 0 1 1 1 0.3 1 1", "text after the friction coefficients"),
        ("2 1 2 2 2 2\nx\nnnz: 1 \n 0 : 1\n 1 1 0.3", "before its first column"),
    ],
)
def test_malformed_text_is_refused(text, message, tmp_path):
    (tmp_path / "points.dat").write_text(text)
    with pytest.raises(ValueError, match=message):
        load_local(tmp_path / "points.dat")
