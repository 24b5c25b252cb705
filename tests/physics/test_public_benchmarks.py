"""Benchmarks that other codes published: `benchmarks/public`."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks" / "public"))

import curved_beams
import fractures
import half_space
import slope
import spence
import third_medium


@pytest.mark.verifies(
    "cracks", reference="closed form: GEOS, single fracture in compression", aspects=("2D", "pairs")
)
def test_single_fracture_slips_as_in_the_closed_form_of_geos():
    record = fractures.single(0.02, 30.0, 0.05)
    assert record["slip_mm"] == pytest.approx(3.80784979, abs=1e-8)
    assert record["pressure_MPa"] == pytest.approx(11.6977778, abs=1e-7)
    assert abs(record["slip_error"]) < 0.02
    assert abs(record["pressure_error"]) < 2e-3


@pytest.mark.long
@pytest.mark.verifies(
    "cracks that cross",
    reference="independent code: boundary elements, Phan et al. (2003)",
    aspects=("2D", "pairs"),
)
def test_intersecting_fractures_agree_with_the_boundary_elements():
    record = fractures.intersection(0.01, 30.0, 0.025)
    assert record["pressure_rms"] < 0.004
    assert record["slip_rms"] < 0.01
    assert record["aperture_rms"] < 0.01


@pytest.mark.verifies(
    "sliding pairs",
    "hyperelastic bodies",
    reference="paper: Neto et al. (2016), digitised by solids4foam",
    aspects=("2D", "pairs", "large sliding"),
)
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_curved_beams_react_as_those_of_neto(friction):
    """Differences relative to the published peaks, before the beams yield."""
    record = curved_beams.compare(friction, 4, 0.1, 2.0)
    for name, allowed in (("x", 0.024 * 17.3), ("y", 0.012 * 39.0)):
        assert len(record[name]) == 3
        for row in record[name]:
            assert abs(row["here"] - row["reference"]) < allowed


@pytest.mark.verifies(
    "bodies of revolution", "quasi-static", reference="independent code: CONTACT, spence35"
)
def test_stick_zone_under_growing_pressure_is_that_of_contact():
    record = spence.run(0.05, 400.0)
    assert abs(record["ratio_error"]) < 0.02
    assert abs(record["pressure_error"]) < 0.01
    assert abs(record["force_error"]) < 0.015


@pytest.mark.long
@pytest.mark.parametrize("name", ["cattaneo", "carter2d", "bentall, driven"])
@pytest.mark.verifies("Newton's method", reference="independent code: CONTACT")
def test_half_spaces_agree_with_contact(name):
    for ours, theirs in half_space.CASES[name]().values():
        assert ours == pytest.approx(theirs, rel=0.02)


@pytest.mark.verifies("NSCD motion", reference="closed form: rigid block", aspects=("2D",))
def test_block_on_a_slope_rests_or_slides():
    at_rest, _ = slope.run(0.5, duration=0.1, steps=20)
    assert abs(at_rest) < 1e-10
    moved, rigid = slope.run(0.49)
    assert moved == pytest.approx(rigid, rel=0.02)
    assert np.sign(moved) == 1


@pytest.mark.verifies(
    "sliding pairs",
    "hyperelastic bodies",
    reference="independent code: third medium of FElupe",
    aspects=("2D", "pairs", "large sliding"),
)
def test_a_closing_c_carries_the_forces_of_a_third_medium():
    """The medium pulls before contact and yields afterwards, by some per cent."""
    rows = third_medium.forces(1, np.linspace(0.0, 0.5, 26))
    forces = {round(time, 6): force for time, force, _, _ in rows}
    for time, medium in ((0.2, 1.498e-4), (0.3, 2.352e-4), (0.42, 4.485e-4), (0.5, 6.718e-4)):
        assert -forces[time] == pytest.approx(medium, rel=0.08)
    assert min(gap for _, _, gap, _ in rows) > -1e-12
