"""The demos of contact between two bodies, against closed forms."""

from argparse import Namespace
from dataclasses import replace

from mpi4py import MPI

import cases.crack
import cases.press_fit
import cases.two_cylinders
import numpy as np
import pytest
from support.demo_numbers import run

COMM = MPI.COMM_WORLD


def pressed(problem, hertz, size, *, ratio=1.0, friction=0.0):
    """Comparison of a mesh with Hertz, and the table."""
    given = Namespace(ratio=ratio, friction=friction)
    result = problem(size, given, COMM).solve()
    assert result.kkt_violation < 1e-10
    table = result.tables["contact"]
    return hertz.compare(table), table


@pytest.mark.verifies(
    "bodies of revolution",
    "mortar",
    reference="independent code: Code_Aster, SSNV104, and Hertz",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_two_spheres_agree_with_code_aster(folder):
    """Code_Aster SSNV104 as it converges: 660.7 kN, 2912 MPa; Hertz at the force within 1 %."""
    words = ["--case=spheres", "--levels", "1", "0.5", f"--output={folder}"]
    summary = cases.two_cylinders.main(words)
    for level in summary["levels"]:
        assert level["force"] == pytest.approx(660.7e3, rel=5e-3)
        assert level["peak"] == pytest.approx(2912, rel=2e-3)
        assert level["peak"] == pytest.approx(level["hertz_peak"], rel=3e-3)
        assert level["radius"] == pytest.approx(level["hertz_radius"], abs=level["size"])
    assert summary["force_imbalance"] < 1e-10
    names = ("body.png", "pressure.png", "convergence.csv", "contact.csv")
    assert all((folder / name).stat().st_size > 0 for name in names)
    case = cases.two_cylinders
    found, table = pressed(case.spheres, case.SPHERES, 0.5, ratio=0.8, friction=0.3)
    # Of a mortar areas are those seen along the axis; those of the cones between the points:
    x = table.x[:, 0]
    length = np.linalg.norm(np.diff(table.x, axis=0), axis=1)
    inner = (2 * x[:-1] + x[1:]) * length
    outer = (x[:-1] + 2 * x[1:]) * length
    area = np.pi / 3 * (np.append(inner, 0.0) + np.append(0.0, outer))
    found = case.SPHERES.compare(replace(table, area=area, pressure=table.rn / area))
    assert found["peak_pressure"] == pytest.approx(summary["peak"], rel=1e-3)
    assert found["load"] == pytest.approx(summary["force"], rel=1e-3)
    assert table.count("s+-") == 0  # by symmetry, but for the meshes


@pytest.mark.parametrize("friction", [pytest.param(0.0, marks=pytest.mark.long), 0.1])
@pytest.mark.verifies(
    "matching meshes",
    "mortar",
    "Coulomb",
    reference="paper: NAFEMS, benchmark CB-1",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_cylinder_on_a_block_agrees_with_nafems(friction):
    """NAFEMS CB-1: the same nodes and others agree better than either does with Hertz."""
    peaks = []
    for ratio in (1.0, 0.8, 1.25):
        case = cases.two_cylinders
        found, table = pressed(case.problem, case.HERTZ, 0.5, ratio=ratio, friction=friction)
        assert found["load"] == pytest.approx(35e3, rel=1e-9)
        assert found["peak_pressure"] == pytest.approx(3585.37, rel=0.02)
        assert found["touching_radius"] == pytest.approx(6.21, abs=0.02 * 6.21)
        assert friction == 0 or min(table.count("k"), table.count("+-")) > 1
        peaks.append(found["peak_pressure"])
    assert max(peaks) - min(peaks) < 0.2 * abs(peaks[0] - 3585.37)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("words", [["--dip=60", "--shear=0"], ["--dip=0", "--shear=-0.5"]])
@pytest.mark.verifies(
    "cracks",
    reference="closed form: the slip of a crack in a plane",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_plane_crack_has_the_slip_of_a_long_crack(folder, words, no_pictures):
    """The slip of a long crack by two meshes, and the pressure on it, to 2 %, whatever its dip."""
    words = ["--dim=2", *words, f"--output={folder}"]
    summary = cases.crack.main([*words, "--levels", "0.1", "0.05"])
    errors = [abs(level["error"]) for level in summary["levels"]]
    assert errors[1] < 0.65 * errors[0] < 0.1
    assert summary["extrapolated_error"] == pytest.approx(0.0, abs=0.02)
    assert summary["pressure"] == pytest.approx(summary["pressure_closed_form"], rel=5e-3)
    assert summary["slip"] > 10
    assert summary["open"] == summary["stick"] == 0


@pytest.mark.long
@pytest.mark.verifies(
    "cracks",
    reference="closed form: the slip of a disc in space",
    aspects=(
        "3D",
        "pairs",
    ),
)
def test_disc_crack_has_the_closed_form_slip(folder):
    """A disc slips as the closed form says, where its front is fine enough."""
    words = ["--levels", "0.2", "0.14", "--friction=0.2", f"--output={folder}"]
    summary = cases.crack.main(words)
    assert summary["extrapolated_error"] == pytest.approx(0.0, abs=0.06)
    assert summary["pressure"] == pytest.approx(summary["pressure_closed_form"], rel=0.03)
    assert summary["slip"] > 5 * summary["stick"]
    assert (folder / "crack.png").stat().st_size > 20_000


def test_crack_case_refuses_data_without_slip(capsys):
    for words in (["--friction=2"], ["--shear=3", "--dip=60"], ["--levels", "0.2"]):
        with pytest.raises(SystemExit):
            cases.crack.main(words)
        assert "a crack that is pressed and slips" in capsys.readouterr().err


@pytest.mark.ranks(2)
@pytest.mark.parametrize("ratio", [1.0, 1.5])
@pytest.mark.verifies(
    "press fits",
    "matching meshes",
    "mortar",
    reference="closed form: Lame's pressure, and the torque",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_the_press_fit_demo_has_lames_pressure_and_torque(folder, ratio, no_pictures):
    """Lame's pressure and the corresponding torque, with errors decreasing quadratically."""
    summary = cases.press_fit.main(["--n=8", f"--ratio={ratio}", f"--output={folder}"])
    off = [summary[k] / summary[f"{k}_closed_form"] - 1 for k in ("pressure", "torque")]
    assert abs(off[0]) < 0.01
    assert off[1] == pytest.approx(off[0], abs=2e-3)
    assert summary["stick"] == summary["open"] == 0
    given = Namespace(n=16, ratio=ratio, overlap=0.02, friction=0.2, drawn=False)
    table = cases.press_fit.problem(given, 0.0, COMM).solve().tables["contact"]
    found = table.rn.sum() / table.area.sum()
    assert found == pytest.approx(summary["pressure_closed_form"], rel=0.3 * abs(off[0]))
    np.testing.assert_allclose(table.pressure, found, rtol=5e-3)


def test_drawn_press_fit_has_the_overlap_of_its_drawing():
    """Matching nodes overlap as drawn; chords of different meshes do so by half of it or less."""
    given = dict(n=12, overlap=0.02, friction=0.2, drawn=True)
    exact = cases.press_fit.lame(0.02)
    for ratio in (1.0, 1.5):
        bodies = cases.press_fit.problem(Namespace(ratio=ratio, **given), 0.0, COMM)
        table = bodies.solve().tables["contact"]
        pressure = table.rn.sum() / table.area.sum()
        if ratio == 1:
            assert pressure == pytest.approx(exact, rel=2e-3)
        else:
            assert pressure < 0.5 * exact


@pytest.mark.long
def test_stiff_base_approaches_the_rigid_floor(folder):
    """The stiffer the base, the nearer the forces are to those on a rigid floor, in proportion."""
    off = []
    for young in (1e4, 1e5):
        names = run(
            "dragged_body",
            folder,
            size_on_floor=0.2,
            size_on_base=0.2,
            young_of_base=young,
        )
        assert names["result_on_base"].pairs["contact"].imbalance < 1e-10
        off.append(np.linalg.norm(names["on_rocker"] - names["force"]))
    assert off[0] == pytest.approx(10 * off[1], rel=0.05)
    assert 0 < off[1] < 1e-3 * np.linalg.norm(names["force"])
