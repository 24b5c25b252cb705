"""The numbers of the demos of large sliding."""

import cases.double_arc
import cases.flattened_ring
import cases.half_spheres
import cases.rolling_wheel
import cases.twisting_hemisphere
import pytest


@pytest.mark.long
@pytest.mark.verifies(
    "sliding pairs",
    "Coulomb",
    reference="closed form: Carter's creepage of a rolling wheel",
    aspects=("2D", "pairs", "large sliding"),
)
def test_rolling_wheel_creeps_like_carter(folder, no_pictures):
    """A driven and a braked wheel creep as Carter says, with ten cells on the width."""
    found = cases.rolling_wheel.main(["--n=10", "--way=1", f"--output={folder}"])
    runs = found["runs"]
    assert all(run["facets_rolled"] == 10 for run in runs.values())
    assert abs(runs["held"]["traction"]) < 0.01
    for name, sign in (("driven", 1), ("braked", -1)):
        run = runs[name]
        assert 0.6 < sign * run["traction"] < 0.7  # Q/(mu P)
        assert run["half_width"] == pytest.approx(0.025, rel=0.02)
        assert run["closed"] in (9, 10)
    assert found["creepage_ratio"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.long
def test_rolling_wheel_converges_to_carter(folder, no_pictures):
    """Forty cells on the width that touches: creepages to five per cent, one by one."""
    found = cases.rolling_wheel.main(["--n=40", f"--output={folder}"])
    for name in ("driven", "braked"):
        assert found[f"creepage_{name}_ratio"] == pytest.approx(1.0, abs=0.05)
        assert found["runs"][name]["closed"] >= 38
        assert abs(found["runs"][name]["change_over_last_width"]) < 0.02


@pytest.mark.long
@pytest.mark.verifies(
    "sliding pairs",
    "hyperelastic bodies",
    reference="paper: Sauer, De Lorenzis (2015), beside FEBio: force and torque to 180 degrees",
    aspects=("3D", "pairs", "large sliding"),
)
def test_twisting_hemisphere_has_the_published_torque(folder, no_pictures):
    """Torque and force of pressing a half-sphere into a block and turning it, on 1000 cells."""
    found = cases.twisting_hemisphere.main([f"--output={folder}"])
    papers = cases.twisting_hemisphere.PUBLISHED
    torque = found["torque_at"]
    assert abs(torque["0"]) < 1e-10
    for angle, off in ((20, 0.01), (40, 0.01), (80, 0.03), (180, 0.045)):
        one = papers["Sauer, De Lorenzis"]["torque"][angle]
        other = papers["FEBio"]["torque"][angle]
        assert (1 - off) * min(one, other) < torque[str(angle)] < (1 + off) * max(one, other)
    for angle, published in papers["Sauer, De Lorenzis"]["force"].items():
        assert found["force_at"][str(angle)] == pytest.approx(published, rel=0.02)
    assert found["failed_steps"] == 0
    assert found["newton_mean"] < 6


@pytest.mark.long
@pytest.mark.verifies(
    "self contact",
    "hyperelastic bodies",
    reference="differences: half of the body on a plane",
    aspects=("2D", "large sliding"),
)
def test_flattened_ring_has_the_force_of_its_half(folder, no_pictures):
    """A ring pressed into itself has the force of its half on a plane."""
    found = cases.flattened_ring.main(["--n=64", "--press=1.65", f"--output={folder}"])
    assert found["inside_force"] > 0.5 * found["plate_force"]  # it is pressed into itself
    assert found["inside_half_ratio"] == pytest.approx(1.0, abs=0.01)
    assert found["plate_half_ratio"] == pytest.approx(1.0, abs=0.01)
    assert found["imbalance"] < 1e-12
    assert found["failed_steps"] == 0


@pytest.mark.long
@pytest.mark.verifies(
    "sliding pairs",
    "hyperelastic bodies",
    reference="paper: Puso, Laursen (2004), and three other published curves of the force",
    aspects=("3D", "pairs", "large sliding"),
)
def test_half_spheres_have_the_published_force(folder, no_pictures):
    """Two shells pressed by a plane: the published force, and the same one on the way back."""
    words = ["--n=3", "--step=0.625", "--until=2.5", "--back=1", f"--output={folder}"]
    found = cases.half_spheres.main(words)
    published = [curve["2.5"] for curve in found["published"].values()]
    assert 0.9 * min(published) < found["force_at"]["2.5"] < 1.1 * max(published)
    ((down, back),) = found["down_and_back"].values()
    assert back == pytest.approx(down, rel=1e-8)
    assert found["fall"] is None


@pytest.mark.verifies(
    "sliding pairs",
    "hyperelastic bodies",
    reference="closed form: stiffness of a clamped arc of two layers",
    aspects=("2D", "pairs", "large sliding"),
)
def test_double_arc_begins_with_its_bending_stiffness(folder, no_pictures):
    """Two arcs begin on a block with their stiffness in bending, if cells are small."""
    words = ["--n=120", "--until=1.5", f"--output={folder}"]
    found = cases.double_arc.main(words)
    assert found["arc_stiffness_ratio"] == pytest.approx(1.0, abs=0.01)
    assert found["lowest"] == pytest.approx(-0.684, abs=0.005)


@pytest.mark.long
def test_double_arc_parts_from_the_block_and_buckles(folder, no_pictures):
    """The middle sinks half as far as the published one, parts from the block and buckles."""
    found = cases.double_arc.main([f"--output={folder}"])
    assert found["lowest"] == pytest.approx(-3.04, abs=0.05)
    assert found["highest"] == pytest.approx(61.3, abs=0.3)
    peak, valley = found["peak_and_valley"]
    assert valley < 0.4 * peak
    assert found["failed_steps"] == 0
    assert found["published"]["19.5"] < 1.8 * found["middle_at"]["19.5"]
