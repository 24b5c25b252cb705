# SPDX-License-Identifier: LGPL-3.0-or-later
"""The Hertz demo: closed forms in 2D and 3D, stick and slip with friction, any number of ranks."""

import csv
import json

from mpi4py import MPI

import cases.hertz
import numpy as np
import pytest

COMM = MPI.COMM_WORLD


def run(folder, *options):
    return cases.hertz.main([*map(str, options), "--output", str(folder)])


def column(summary, key):
    return np.array([level[key] for level in summary["levels"]])


def check_hertz(summary, tolerance=0.02):
    assert summary["converged"]
    assert summary["strategy"] == "full steps"
    assert summary["kkt_violation"] < 1e-10
    assert summary["peak_pressure_error"] < tolerance
    assert summary["radius_error"] < tolerance
    assert summary["peak_pressure"] == pytest.approx(
        summary["peak_pressure_closed_form"], rel=tolerance
    )
    assert summary["radius"] == pytest.approx(summary["radius_closed_form"], rel=tolerance)


@pytest.mark.verifies("Signorini", reference="closed form: Hertz, line contact", aspects=("2D",))
def test_line_contact_converges(folder):
    summary = run(folder, "--dim", 2, "--levels", 5, 10, 20)
    check_hertz(summary, 0.002)
    for key, factor in (("profile_error", 3), ("peak_pressure_error", 3), ("radius_error", 1.5)):
        errors = column(summary, key)
        assert (errors[1:] < errors[:-1] / factor).all(), key
    assert summary["load"] == pytest.approx(2 * summary["sum_rn"])
    assert summary["newton_iterations"] <= 8
    if COMM.rank == 0:
        assert json.loads((folder / "summary.json").read_text()) == summary
        with open(folder / "convergence.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert [int(row["cells_over_radius"]) for row in rows] == [5, 10, 20]
        names = ("contact.csv", "convergence.png", "pressure.png")
        assert all((folder / name).stat().st_size > 0 for name in names)


@pytest.mark.ranks(2)
def test_line_contact_agrees_with_hertz(folder):
    """The mesh is the same on any number of ranks, so the numbers are."""
    summary = run(folder, "--levels", 5, 10)
    assert summary["radius"] == pytest.approx(0.9847365469, rel=1e-6)
    assert summary["peak_pressure"] == pytest.approx(2285.463269, rel=1e-6)
    assert summary["load"] == pytest.approx(3529.868228, rel=1e-6)


@pytest.mark.long
@pytest.mark.verifies("Signorini", reference="closed form: Hertz, point contact", aspects=("3D",))
def test_point_contact_converges(folder):
    summary = run(folder, "--dim", 3, "--levels", 4, 6)
    check_hertz(summary, 0.015)
    for key in ("profile_error", "peak_pressure_error", "radius_error"):
        errors = column(summary, key)
        assert errors[1] < errors[0] / 1.5, key
    assert summary["load"] == pytest.approx(4 * summary["sum_rn"])


@pytest.mark.verifies(
    "Coulomb", reference="independent code: integral equations of the half-plane", aspects=("2D",)
)
def test_line_contact_with_friction_agrees_with_integral_equations(folder):
    """The half-plane with this static law, by its integral equations: c/a = 0.30, p0 + 6.4 %."""
    summary = run(folder, "--friction", 0.3, "--levels", 5, 20)
    assert summary["strategy"] == "full steps"
    assert summary["stick"] > 2
    assert summary["slip"] > 2
    assert summary["kkt_violation"] < 1e-10
    assert 0 < summary["sum_rt_x"] < 0.3 * summary["sum_rn"]  # against a slip inwards
    assert summary["stick_radius"] / summary["touching_radius"] == pytest.approx(0.30, abs=0.04)
    ratio = summary["peak_pressure"] / summary["peak_pressure_closed_form"]
    assert ratio == pytest.approx(1.064, abs=0.01)
    assert summary["sum_rt_x"] / summary["sum_rn"] == pytest.approx(0.222, rel=0.03)
    if COMM.rank == 0:
        with open(folder / "contact.csv", newline="") as file:
            status = "".join(row["status"] for row in csv.DictReader(file))
        assert status == "k" * summary["stick"] + "-" * summary["slip"] + "o" * summary["open"]
        assert (folder / "friction.png").stat().st_size > 0


@pytest.mark.long
def test_point_contact_with_friction_agrees_with_the_static_law(folder):
    summary = run(folder, "--dim", 3, "--friction", 0.3, "--levels", 4)
    assert summary["stick"] > 2
    assert summary["slip"] > 2
    assert summary["kkt_violation"] < 1e-7  # not piecewise linear: Newton's tolerance
    assert summary["sum_rt_x"] == pytest.approx(summary["sum_rt_y"], rel=1e-9)
    assert 0.3 < summary["stick_radius"] / summary["touching_radius"] < 0.8


@pytest.mark.ranks(2)
@pytest.mark.skipif(COMM.size == 1, reason="compares one rank with several")
@pytest.mark.parametrize("options", [["--friction", "0.3"], ["--dim", "3"]])
@pytest.mark.verifies(
    "Signorini",
    "Coulomb",
    reference="itself: the run on one rank",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_numbers_do_not_depend_on_ranks(options):
    args = cases.hertz.arguments([*options, "--levels", "3", "4"])
    results = [cases.hertz.solve(args, comm) for comm in (MPI.COMM_SELF, COMM)]
    (_, alone, alone_levels), (_, together, together_levels) = results
    for a, b in zip(alone_levels, together_levels, strict=True):
        assert a.pop("strategy") == b.pop("strategy")
        assert a == pytest.approx(b, rel=1e-9)
    one = alone.tables["contact"]
    many = together.tables["contact"]
    assert one.status == many.status
    assert many.x == pytest.approx(one.x, rel=1e-12)
    assert many.pressure == pytest.approx(one.pressure, rel=1e-9, abs=1e-9 * one.pressure.max())
