"""Ratios in the benchmarks: warm runs take turns, and the elastic solve is the yardstick."""

import json
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import elastic_solve
import elasticity_ratio
import kept
import local_problem
import motion_step
import public_problems
import timing

from dolfinx_contact.algorithms import PointProblem, save_points

COMM = MPI.COMM_WORLD
SICONOS = Path(__file__).parents[1] / "data" / "siconos"


@pytest.mark.long
def test_runs_take_turns_after_one_that_does_not_count():
    order = []
    left = {"a": [9.0, 3.0, 1.0, 2.0], "b": [9.0, 5.0, 6.0, 4.0]}

    def run(name):
        order.append(name)
        return {"seconds": left[name].pop(0), "x_seconds": len(left[name]), "run": len(order)}

    found = timing.in_turns(COMM, {n: lambda n=n: run(n) for n in "ab"}, 3)
    assert "".join(order) == "abababab"
    assert (found["a"]["seconds"], found["b"]["seconds"]) == (2.0, 5.0)
    assert found["a"]["run"] == 7  # the rest of the record is that of the same run
    assert found["a"]["runs"] == [3.0, 1.0, 2.0]
    assert found["a"]["x_seconds"] == 1
    assert found["a"]["warm_up_seconds"] == 9.0


def test_a_run_that_fails_is_no_median():
    calls = []

    def fails():
        calls.append(0)
        return {"seconds": 0.0, "converged": False}

    found = timing.in_turns(COMM, {"fails": fails}, 3)
    assert not found["fails"]["converged"]
    assert len(calls) == 1
    runs = [{"seconds": s, "converged": s > 1.0} for s in (3.0, 1.0, 2.0)]
    assert timing.median(runs)["seconds"] == 1.0
    assert elasticity_ratio.by_seconds([*runs, found["fails"]]) == [runs[2], runs[0]]


@pytest.mark.ranks(2)
def test_benchmarks_select_settings_by_name():
    names = [s.name for s in elastic_solve.SETTINGS]
    assert len(set(names)) == len(names)
    assert elastic_solve.chosen(["all"]) == elastic_solve.SETTINGS
    assert [s.name for s in elastic_solve.chosen(["few"])] == [
        n for n in names if n in elastic_solve.FEW
    ]
    assert len(elastic_solve.chosen(["few"])) == len(elastic_solve.FEW)
    assert [s.name for s in elastic_solve.chosen(["hypre-ln", "*sor2*"])] == [
        *("gamg0-sor2-half", "gamg1-sor2-half", "hypre-ln")
    ]
    with pytest.raises(ValueError, match="sor3 is no setting; there are: all, few, gamg0"):
        elastic_solve.chosen(["few", "sor3"])


def test_benchmark_of_a_motion_has_its_ratios(folder):
    file = folder / "motion.json"
    motion_step.main(["--n", "6", "--steps", "6", "--output", str(file)])
    COMM.barrier()
    record = json.loads(file.read_text())
    for case in motion_step.CASES:
        found = record[case]
        assert len(found["steps"]) == 6
        assert abs(found["residue"]) < 1e-7
        assert found["contact_steps"] == 6 - motion_step.WARM_UP
        for kind, seconds in found["elastic_seconds"].items():
            assert found[f"contact_over_{kind}_ratio"] == found["contact_seconds"] / seconds
    assert record["thrown"]["changes_steps"] > 0
    assert record["sliding"]["no_change_steps"] == 6 - motion_step.WARM_UP
    assert all(s["closed"] == record["sliding"]["points"] for s in record["sliding"]["steps"])


def test_what_has_grown_over_commits_is_told(tmp_path, capsys):
    """A growing count, and a ratio growing by more than the noise."""
    values = {"ratio": [2.0, 2.1, 2.0, 2.15, 2.6], "count newton": [5.0, 5.0, 5.0, 6.0, 5.0]}
    case = kept.Case(("none.py",), dict.fromkeys(values, ""))
    path = tmp_path / "kept.csv"

    def measure(name, case, commit):
        return [
            {
                "commit": commit,
                "case": name,
                "name": words,
                "kind": words.partition(" ")[0],
                "value": str(found.pop(0)),
                "noise": "0.04",
            }
            for words, found in values.items()
        ]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kept, "CASES", {"solve": case})
        patch.setattr(kept, "commit_here", lambda: "abc")
        states = [kept.main(["--file", str(path)], measure) for _ in range(5)]
    assert states == [0, 0, 0, 1, 1]
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("grown")]
    assert told == [
        "grown: solve, count newton: 6, 5 before",
        "grown: solve, ratio: 2.6, 2.05 before",
    ]
    assert len(kept.read(path)) == 10


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("FrictionContactProblem00031", "2D, 11 | 0.9 | 22 of 22 | lemke, 13"),
        ("FrictionContactProblem00394", "2D, 6 | 0.9 | 12 of 12 | lemke, 14"),
        ("FC3D_Example1_SBM", "3D, 3 | 0.1 | 9 of 9 | gauss-seidel, 10"),
        ("Rover4396", "3D, 2 | 0.7 | 6 of 6 | gauss-seidel, 10"),
    ],
)
@pytest.mark.verifies(
    "point problems in files",
    "all solutions",
    reference="independent code: problems of Siconos",
    aspects=("2D", "3D", "proofs"),
)
def test_a_problem_of_siconos_has_one_proved_solution(name, begins):
    problem = local_problem.read(SICONOS / f"{name}.dat")
    line = public_problems.row(name, problem, 3000, 30.0)
    assert line.startswith(f"| {name} | {begins} |")
    assert "1 solution, proved" in line
    r, _ = problem.by_sweeps(3000)
    assert problem.violation(r) < 1e-10


@pytest.mark.parametrize("dim", [2, 3])
def test_a_problem_written_for_fclib_is_read(dim, tmp_path):
    pytest.importorskip("h5py")
    rng = np.random.default_rng(3)
    B = rng.normal(size=(4 * dim, 4 * dim))
    problem = PointProblem(B @ B.T + 10 * np.eye(len(B)), rng.normal(size=len(B)), np.full(4, 0.4))
    save_points(tmp_path / "points.hdf5", problem)
    points = local_problem.read(tmp_path / "points.hdf5").points()
    np.testing.assert_allclose(points.S, problem.S, rtol=1e-12, atol=1e-12 * problem.S.max())
    np.testing.assert_allclose(points.p, problem.p, rtol=1e-12, atol=1e-12)


def test_a_rigid_block_on_two_points_has_a_free_self_stress_at_rest_and_none_in_sliding():
    """Its velocities (x, y, rotation) move a point with J; the compliance J J^T has the rank 3."""
    J = np.array([[1, 0, 0], [0, 1, -1], [1, 0, 0], [0, 1, 1]], dtype=float)
    for friction, velocity, force, freedom in (
        (0.5, [0.0, -1.0, 0.0], [0.0, 0.5], 1),
        (0.3, [1.0, -1.0, 0.0], [-0.15, 0.5], 0),
        (0.0, [0.0, -1.0, 0.0], [0.0, 0.5], 0),
    ):
        problem = local_problem.LocalProblem(J @ J.T, J @ velocity, np.full(2, friction))
        assert problem.rank == 3
        for r, _ in (problem.by_sweeps(1000), problem.by_lemke()):
            assert problem.violation(r) < 1e-10
            np.testing.assert_allclose(r[:, 1], force[1], atol=1e-9)
            if freedom == 0:
                np.testing.assert_allclose(r, [force] * 2, atol=1e-9)
            assert problem.reaction_freedom(r) == freedom
