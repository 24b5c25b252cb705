"""The demos of motion, against closed forms; the benchmark of impacts."""

import cases.bouncing_bar
import cases.sliding_block
import cases.thrown_body
import cases.two_bars
import numpy as np
import pytest
from support.demo_numbers import run

pytestmark = pytest.mark.usefixtures("no_pictures")


@pytest.mark.long
@pytest.mark.verifies(
    "NSCD motion",
    "energies of motions",
    reference="closed form: two impacts of a bar",
    aspects=("2D",),
)
def test_bouncing_bar_agrees_with_the_closed_form(folder):
    found = cases.bouncing_bar.main(["--elements=12", f"--output={folder}"])
    exact = ((1.0, 5 / 3, 800 / 3), (11 / 3, 13 / 3, 800 / 3))
    np.testing.assert_allclose(found["impacts"], exact, rtol=0.04)
    assert found["energy_end"] == pytest.approx(1.0, abs=0.04)
    assert found["energy_residue"] < 1e-10
    assert found["force_error_averaged"] < found["force_error"] < 0.25
    rows = (folder / "contact_force.csv").read_text().splitlines()
    assert rows[0] == "t,force"
    assert len(rows) == found["steps"] + 1
    assert (folder / "force.png").exists()


@pytest.mark.long
def test_bouncing_bar_converges_to_one_percent(folder):
    """400 elements, dt = h/c."""
    found = cases.bouncing_bar.main(["--elements=400", f"--output={folder}"])
    impacts = np.array(found["impacts"])
    np.testing.assert_allclose(impacts[:, 2], 800 / 3, rtol=0.01)
    exact = ((1.0, 5 / 3), (11 / 3, 13 / 3))
    np.testing.assert_allclose(impacts[:, :2], exact, rtol=0, atol=0.01)
    assert found["force_error_averaged"] < 0.01
    assert found["energy_end"] == pytest.approx(1.0, abs=0.01)


def two_bars(folder, *words):
    found = cases.two_bars.main([*words, f"--output={folder}"])
    assert sum(found["velocities"]) == pytest.approx(20.0, rel=1e-10)
    assert found["energy_end"] == pytest.approx(1.0, abs=1e-9)
    return [found["velocities"][1] / 20, found["duration"] * 1.5, found["pressure"]]


@pytest.mark.verifies(
    "NSCD motion",
    reference="closed form: bars that exchange their velocities",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_two_bars_exchange_their_velocities(folder):
    """Velocities are exchanged, after 2 L/c under rho c V/2."""
    np.testing.assert_allclose(two_bars(folder, "--elements=16"), 1.0, rtol=0, atol=0.07)


@pytest.mark.long
def test_two_bars_converge_to_one_percent(folder):
    np.testing.assert_allclose(two_bars(folder, "--elements=400"), 1.0, rtol=0, atol=0.01)


@pytest.mark.long
@pytest.mark.verifies(
    "NSCD motion", "Coulomb", reference="closed form: time and way to the stop", aspects=("2D",)
)
def test_sliding_block_stops_at_the_closed_form(folder):
    """Time and way to the stop, to 1 %; friction has taken nearly all of the energy."""
    words = ["--elements=4", "--width=1", "--dt=0.01"]
    found = cases.sliding_block.main([*words, f"--output={folder}"])
    for name in ("stop_time", "distance"):
        assert found[name] == pytest.approx(found[f"{name}_closed_form"], rel=0.01)
    assert 0.99 < found["dissipated"] < 1.0
    assert found["energy_residue"] < 1e-10


@pytest.mark.long
def test_sliding_block_at_its_defaults_stops_at_the_closed_form(folder):
    found = cases.sliding_block.main([f"--output={folder}"])
    for name in ("stop_time", "distance"):
        assert found[name] == pytest.approx(found[f"{name}_closed_form"], rel=0.01)


@pytest.mark.long
@pytest.mark.verifies(
    "NSCD motion",
    "hyperelastic bodies",
    reference="theorem: momentum and angular momentum are what forces give",
    aspects=("3D",),
)
def test_thrown_body_has_the_impulse_of_its_forces(folder):
    """Momentum is the impulse, angular momentum the moment to first order in the step."""
    words = ["--n=2", "--dt=0.004", "--end=0.12", f"--output={folder}"]
    found = cases.thrown_body.main(words)
    assert found["momentum_error"] < 1e-9
    assert found["moment_error"] < 0.02
    assert abs(found["spins"][0][1]) > 0.1
    assert found["dissipated"] > 0.1
    assert found["energy_error"] < 1e-3
    assert (folder / "steps.csv").read_text().count("\n") == 32


@pytest.mark.long
@pytest.mark.verifies(
    "NSCD motion",
    "hyperelastic bodies",
    reference="theorem: momentum is kept, equal bodies get the same spin",
    aspects=(
        "3D",
        "pairs",
    ),
)
def test_two_thrown_bodies_exchange_normal_velocities(folder):
    """Equal bodies receive the same spin and exchange part of their normal velocities."""
    found = cases.thrown_body.main(["--n=2", "--two", f"--output={folder}"])
    assert found["momentum_error"] < 1e-9
    first, second = found["momenta"]
    spins = found["spins"]
    np.testing.assert_allclose(np.add(first, second), (2.0, 0.5, -3.0), rtol=0, atol=1e-9)
    np.testing.assert_allclose(spins[0], spins[1], rtol=0, atol=1e-6)
    assert found["energy_error"] < 1e-3


@pytest.mark.long
@pytest.mark.verifies(
    "NSCD motion", reference="closed form: an oscillator of one degree of freedom", aspects=("2D",)
)
def test_stick_slip_agrees_with_the_oscillator(folder):
    """Sticking phases and amplitude agree with the oscillator of one degree of freedom."""
    names = run("stick_slip", folder, n=1, periods=1.6)
    sticks(names)
    assert names["amplitude"] == pytest.approx(0.1 / names["omega"], rel=0.02)
    energies = [step.energies for step in names["belt_history"].steps]
    assert max(abs(e.residue) for e in energies) < 1e-9 * energies[-1].external


@pytest.mark.long
def test_stick_slip_repeats_its_cycle(folder):
    names = run("stick_slip", folder)
    sticks(names)
    omega = names["omega"]
    assert names["amplitude"] == pytest.approx(0.1 / omega, rel=0.01)
    # Mean time between upward passages through the mean displacement.
    t, swing = names["belt_times"], np.where(names["later"], names["u"] - names["m"], 0.0)
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0) & names["later"][:-1])
    passages = t[up] - swing[up] * np.diff(t)[up] / np.diff(swing)[up]
    assert np.diff(passages).mean() == pytest.approx(2 * np.pi / omega, rel=0.01)


def sticks(names):
    t = names["belt_times"]
    ends = t[names["first"]], t[names["last"]]
    exact = names["caught"], names["released"]
    np.testing.assert_allclose(ends, exact, rtol=0, atol=0.01)
