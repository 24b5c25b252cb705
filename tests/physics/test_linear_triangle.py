"""All branches of a triangle on a floor, against independent codes.

The references are GetFEM and an enumeration of all statuses in numpy, on the same mesh.
"""

from mpi4py import MPI

import cases.linear_triangle as demo
import numpy as np
import pytest
from support.checks import solved_start
from support.harness import varied

from dolfinx_contact.continuation import explore, follow

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "Coulomb", "Newton's method", reference="independent code: GetFEM, and numpy", aspects=("2D",)
)
def test_linear_triangle_starts_with_one_solution():
    """n = 64, F = 1.7, gamma = -1: one solution, known from two codes (GetFEM and numpy)."""
    system = demo.linear_triangle(64, 1.7)
    table = system.problem.solve().tables["contact"]
    assert table.status == 13 * "o" + 18 * "+" + 33 * "k" + "d"
    np.testing.assert_allclose(table.ut[0, 0], 0.0357436, atol=1e-7)
    np.testing.assert_allclose(table.un[0], 0.0198213, atol=1e-7)
    # The clamped node belongs to the support.
    np.testing.assert_allclose(table.rn[:-1].sum(), 3.319526, atol=1e-6)
    np.testing.assert_allclose(table.rt[:-1, 0].sum(), -3.956634, atol=1e-6)


@pytest.mark.parametrize("route", [pytest.param("steps", marks=pytest.mark.long), "pivoting"])
@pytest.mark.verifies(
    "rays out of a kink",
    "pivoting",
    reference="independent code: GetFEM, and an enumeration in numpy",
    aspects=(
        "2D",
        "branches",
        "proofs",
    ),
)
def test_three_rays_leave_the_degenerate_point(route):
    """n = 64, F = 1.7: one ray comes to (0, 0), where all nodes are at a kink, three leave it."""
    system = demo.linear_triangle(64, 1.7)
    branch = follow(system, solved_start(system), -1.0, gamma_range=(-1.0, 1.0), route=route)
    (point,) = branch.special
    assert point.kind == "bifurcation"
    assert point.gamma == pytest.approx(0.0, abs=1e-10)
    assert point.complete  # of 4^64 pieces
    assert "unfoldings of 64 points, a proof of" in point.method
    found = {system.letters(branch.points[-1].piece)}
    found |= {system.letters(ray.piece) for ray in point.others}
    assert found == {64 * "o" + "d", "k" + 63 * "o" + "d", "-" + 63 * "o" + "d"}


def run(folder, *arguments):
    return demo.main([*arguments, "--output", str(folder)])


@pytest.mark.verifies(
    "all solutions",
    "branches",
    "pivoting",
    reference="independent code: GetFEM, and an enumeration in numpy",
    aspects=(
        "2D",
        "branches",
        "proofs",
    ),
)
def test_the_demo_finds_four_solutions_of_the_triangle(folder):
    """The default: 3 + 1 solutions with the numbers of the oracle, and the pictures."""
    summary = run(folder)
    assert summary["converged"]
    (left,) = summary["solutions"]["-1"]
    assert left["sum_rt"] == pytest.approx(-3.956634, abs=1e-6)
    slip, stick, free = summary["solutions"]["1"]
    assert slip["status"] == "-" + 63 * "o"
    assert slip["ut_A"] == pytest.approx(-0.0397846, abs=1e-7)
    assert slip["sum_rn"] == pytest.approx(0.4752384, abs=1e-7)
    assert stick["status"] == "k" + 63 * "o"
    assert stick["sum_rn"] == pytest.approx(1.3878265, abs=1e-7)
    assert stick["sum_rt"] == pytest.approx(2.3021273, abs=1e-7)
    assert free["status"] == 64 * "o"
    assert free["ut_A"] == pytest.approx(-0.0617672, abs=1e-7)
    assert free["un_A"] == pytest.approx(0.00077225, abs=1e-8)
    assert summary["complete"] is True
    assert "a proof of 1 step" in summary["proofs"]
    for name in ("states.png", "diagram.png"):
        assert (folder / name).stat().st_size > 10_000


@pytest.mark.verifies(
    "all solutions",
    reference="independent code: GetFEM, and an enumeration in numpy",
    aspects=(
        "2D",
        "branches",
        "proofs",
    ),
)
def test_coarse_triangle_has_the_enumerated_solutions(folder):
    """n = 4, F = 1.8: enumeration of the 256 pieces proves that there are 3 + 1 solutions."""
    summary = run(folder, "--n", "4", "--friction", "1.8", "--load", "26", "9.05")
    assert summary["complete"] is True
    assert summary["methods"] == ["enumeration of 256 pieces"]
    assert [s["status"] for s in summary["solutions"]["-1"]] == ["o++k"]
    assert [s["status"] for s in summary["solutions"]["1"]] == ["-ooo", "kooo", "oooo"]
    free = summary["solutions"]["1"][2]
    assert free["ut_A"] == pytest.approx(-0.06609747034018448, rel=1e-9)
    assert free["un_A"] == pytest.approx(0.0013871244868142803, rel=1e-9)


@pytest.mark.long
def test_friction_decides_on_the_number_of_solutions():
    """On the 64-node mesh three solutions exist for gamma > 0 iff F >= 1.6588005832."""
    for friction, count in ((1.6588, 1), (1.6589, 3)):
        system = demo.linear_triangle(64, friction)
        system.proof_seconds = 0.0
        diagram = explore(system, [(solved_start(system), -1.0)], gamma_range=(-1.0, 1.0))
        ends = [b for b in diagram.branches if b.points[-1].gamma == 1.0]
        assert len(ends) == count


@pytest.mark.long
@pytest.mark.parametrize("route", ["pivoting", "steps"])
@pytest.mark.verifies(
    "units",
    "branches",
    reference="itself: other units, numbering and augmentation",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_linear_triangle_does_not_depend_on_units_and_numbering(folder, route):
    """Lengths times 1e3, stiffness and load times 1e9, another numbering, r times 0.1 to 100.

    The points of all branches have the same gamma to 1e-8; statuses are the same.
    """
    plain = ("--n", "16", "--friction", "1.8", "--route", route)
    reference = run(folder / "a", *plain)
    others = {
        "units": ("--length", "1e3", "--lame", "100e9", "82e9", "--load", "26e9", "7.5e9"),
        "numbering": (),
    }
    for name, more in others.items():
        with varied(seed=7 if name == "numbering" else None):
            other = run(folder / name, *plain, *more)
        assert other["points"] == reference["points"], name
        for a, b in zip(other["gammas"], reference["gammas"], strict=True):
            np.testing.assert_allclose(a, b, atol=1e-8)
    for r in (20.0, 2000.0, 20000.0):  # E / L is about 200
        with varied(r=r):
            other = run(folder / f"{r:g}", *plain)
        assert other["augmentation"] == pytest.approx(r)
        for end in ("-1", "1"):
            statuses = [s["status"] for s in other["solutions"][end]]
            assert statuses == [s["status"] for s in reference["solutions"][end]]


@pytest.mark.long
@pytest.mark.verifies(
    "pivoting",
    "branches",
    reference="itself: the branches by steps",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_steps_and_pivoting_find_the_same(folder):
    """Both routes, steps ten times longer and shorter: the same solutions."""
    plain = ("--n", "16", "--friction", "1.8")
    reference = run(folder / "a", *plain, "--route", "pivoting")
    points = []
    for factor in (0.1, 1.0, 10.0):
        with varied(step_factor=factor):
            other = run(folder / f"{factor:g}", *plain, "--route", "steps")
        points.append(sum(other["points"]))
        for end in ("-1", "1"):
            pairs = zip(other["solutions"][end], reference["solutions"][end], strict=True)
            for a, b in pairs:
                assert a["status"] == b["status"]
                assert a["ut_A"] == pytest.approx(b["ut_A"], abs=1e-9)
    assert points == sorted(points, reverse=True)
    assert points[0] > 2 * points[-1]


@pytest.mark.ranks(2)
def test_the_triangle_demo_refuses_a_mesh_without_cells(capsys):
    with pytest.raises(SystemExit):
        demo.main(["--n", "0"])
    assert COMM.rank > 0 or "must be positive" in capsys.readouterr().err
