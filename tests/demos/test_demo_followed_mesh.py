"""The followed mesh: folds, events and solutions that do not depend on how they are found."""

from mpi4py import MPI

import cases.followed_mesh as demo
import numpy as np
import pytest
from support.checks import solved_start
from support.harness import varied

from dolfinx_contact.continuation import Follower, StepControl

COMM = MPI.COMM_WORLD
COARSE = ["--size", "0.1", "--solutions-at", "0.7"]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    folder = COMM.bcast(tmp_path_factory.mktemp("vee") if COMM.rank == 0 else None)
    return demo.main([*COARSE, "--output", str(folder)]), folder


def test_vee_turns_back_and_lifts_off(reference):
    summary, folder = reference
    assert summary["reason"] == "gamma reached the end of its range"
    assert len(summary["folds"]) == 2
    first, second = summary["folds"]
    assert first["gamma"] > 0.7 > second["gamma"]
    assert {f["kind"] for f in summary["folds"]} == {"nonsmooth"}
    assert summary["bifurcations"] == []
    assert set(summary["end"]["status"]) == {"o"}
    assert summary["end"]["sum_rn"] == pytest.approx(0.0, abs=1e-12)
    found = summary["solutions_at"]["solutions"]
    assert len(found) == 3
    assert len({s["status"] for s in found}) == 3
    assert (folder / "branch.png").stat().st_size > 10_000


def test_every_solution_satisfies_the_contact_law():
    """Newton on the nonsmooth problem has nothing to do at the three solutions."""
    args = demo.arguments(COARSE)
    followed = demo.system(args, COMM)
    problem = followed.problem
    x = solved_start(followed)
    with Follower(followed, StepControl(), gamma_scale=1.0) as follower:
        branch = follower.run(follower.start(x, 0.0), gamma_range=(0.0, 1.0))
        there = follower.at(branch, 0.7)
        assert len(there) == 3
        for point in there:
            assert point.gamma == pytest.approx(0.7, abs=1e-12)
            followed.result_at(point)  # puts the state into the problem
            result = problem.solve()
            assert result.iterations == 0
            assert result.kkt_violation < 1e-9
            assert result.tables["contact"].status == followed.letters(point.piece)


@pytest.mark.parametrize("factor", [pytest.param(f, marks=pytest.mark.long) for f in (0.1, 10.0)])
def test_steps_do_not_matter(reference, folder, factor):
    summary, _ = reference
    with varied(step_factor=factor):
        other = demo.main([*COARSE, "--route", "steps", "--output", str(folder)])
    assert other["points"] > 100 if factor < 1 else other["points"] < 30  # 41 by default
    gammas = [[f["gamma"] for f in s["folds"]] for s in (summary, other)]
    np.testing.assert_allclose(*gammas, atol=1e-10)
    assert other["events"] == summary["events"]
    for a, b in zip(
        summary["solutions_at"]["solutions"], other["solutions_at"]["solutions"], strict=True
    ):
        assert a["status"] == b["status"]
        np.testing.assert_allclose(a["ut_left"], b["ut_left"], atol=1e-9)


def test_hyperelastic_vee_reaches_its_driven_end(folder):
    """Large displacements, a smooth curve: the driven end is reached and the law holds there."""
    options = ["--size=0.12", "--law=neo-hookean", "--friction=0.8", f"--output={folder}"]
    summary = demo.main([*options, "--drive-top", "0.4", "-0.05"])
    assert summary["gamma_end"] == pytest.approx(1.0, abs=1e-12)
    assert set(summary["end"]["status"]) == {"o", "+"}
    assert summary["end"]["ut_left"] > 0.2
    assert summary["end"]["sum_rn"] > 0
    assert abs(summary["end"]["sum_rt"]) <= 0.8 * summary["end"]["sum_rn"] * (1 + 1e-9)


@pytest.mark.long
def test_a_budget_that_ends_early_is_resumed_from_the_record(reference, folder):
    """Same summary from the record, resumed half-way, as from memory."""
    summary, _ = reference
    options = [*COARSE, f"--record={folder / 'record'}", f"--output={folder / 'out'}"]
    first = demo.main([*options, "--max-steps", "15"])
    assert first["points"] == 16
    other = demo.main([*options, "--resume"])
    for key in ("reason", "points", "events", "newton_iterations", "dofs", "bifurcations"):
        assert other[key] == summary[key]
    for a, b in zip(summary["folds"], other["folds"], strict=True):
        assert (a["kind"], a["before"], a["after"]) == (b["kind"], b["before"], b["after"])
        assert abs(a["gamma"] - b["gamma"]) < 1e-8
    for a, b in zip(
        summary["solutions_at"]["solutions"], other["solutions_at"]["solutions"], strict=True
    ):
        assert a["status"] == b["status"]
        assert abs(a["ut_left"] - b["ut_left"]) < 1e-8
    assert (folder / "out/branch.png").stat().st_size > 20_000
    assert {p.name for p in (folder / "out").glob("branch_0000_*")} == {
        "branch_0000_body.bp",
        "branch_0000_contact.bp",
    }
