"""Six branches of a hyperelastic block, against GetFEM on the same 10 x 20 mesh."""

import cases.ciarlet_geymonat as demo
import numpy as np
import pytest
from support.harness import varied

COARSE = ("--nx", "10", "--ny", "20")

# Statuses and corners (ut_left, un_left, ut_right, un_right, sum_rt, sum_rn) at the far ends, by an
# independent code; for gamma = -1 they are the mirror images.
GETFEM = {
    "oooooooo--o": (
        -3.4003139529,
        0.1377951548,
        -3.3204451241,
        0.0278632599,
        11.3700817966,
        11.3700817966,
    ),
    "k-ooooooooo": (0.0, 0.0, -0.2352358985, 0.8851073757, 83.0793681867, 95.8840034288),
    "--ooooooooo": (-1.1657459653, 0.0, -1.3689733220, 0.5185836857, 58.4385467124, 58.4385467124),
}
KEYS = ("ut_left", "un_left", "ut_right", "un_right", "sum_rt", "sum_rn")


def mirrored(end):
    flip = str.maketrans("+-", "-+")
    return {
        "gamma": -end["gamma"],
        "status": end["status"][::-1].translate(flip),
        "ut_left": -end["ut_right"],
        "un_left": end["un_right"],
        "ut_right": -end["ut_left"],
        "un_right": end["un_left"],
        "sum_rt": -end["sum_rt"],
        "sum_rn": end["sum_rn"],
    }


def check(summary, length=1.0, force=1.0):
    assert summary["converged"], summary["reason"]
    assert summary["complete"], summary["methods"]
    assert len(summary["bifurcation_gamma"]) == 1
    assert abs(summary["bifurcation_gamma"][0]) < 1e-8
    ends = [b if b["gamma"] > 0 else mirrored(b) for b in summary["branches"]]
    assert sorted(b["gamma"] for b in summary["branches"]) == [-1, -1, -1, 1, 1, 1]
    for status, values in GETFEM.items():
        pair = [b for b in ends if b["status"] == status]
        assert len(pair) == 2
        scales = (length,) * 4 + (force,) * 2
        for end in pair:
            for key, value, scale in zip(KEYS, values, scales, strict=True):
                assert end[key] / scale == pytest.approx(value, rel=1e-7, abs=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("r", [None, 0.3, 300.0])
@pytest.mark.verifies(
    "hyperelastic bodies",
    "all solutions",
    "branches",
    reference="independent code: GetFEM on the same mesh",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_ciarlet_geymonat_block_has_six_branches(folder, r):
    """With the automatic augmentation parameter (about E / L, 4) and 10 and 100 times off."""
    with varied(r=r):
        summary = demo.main([*COARSE, "--output", str(folder)])
    check(summary)
    assert r is None or summary["augmentation"] == pytest.approx(r)
    for name in ("states.png", "diagram.png"):
        assert (folder / name).stat().st_size > 10_000


@pytest.mark.long
@pytest.mark.verifies(
    "units",
    "hyperelastic bodies",
    "branches",
    reference="itself: other units and steps",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_ciarlet_geymonat_branches_do_not_depend_on_steps_and_units(folder):
    """Ten times longer and shorter steps; lengths times 1e3, stresses times 1e6: the same points.

    A length of 1 mm is 1e3 units of a micrometre, 1 MPa is 1e6 Pa; the force per width scales with
    their product.
    """
    reference = demo.main([*COARSE, "--output", str(folder / "a")])
    with varied(mm=1e3, MPa=1e6):
        scaled = demo.main([*COARSE, "--output", str(folder / "b")])
    check(scaled, 1e3, 1e9)
    assert scaled["points"] == reference["points"]
    for a, b in zip(scaled["gammas"], reference["gammas"], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-8)
    for factor in (0.1, 10.0):
        with varied(step_factor=factor):
            other = demo.main([*COARSE, "--output", str(folder / f"{factor:g}")])
        check(other)
        more = sum(other["points"]) > sum(reference["points"])
        assert more == (factor < 1)
