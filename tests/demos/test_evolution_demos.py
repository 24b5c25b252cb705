"""The demos of evolutions, against closed forms."""

from mpi4py import MPI

import cases.adhesion
import cases.bar
import cases.indenter
import cases.mindlin
import cases.pile
import cases.steel_concrete
import cases.two_blocks
import numpy as np
import pytest
from support.demo_numbers import run

from dolfinx_contact import Coulomb, Regularised

NAMES = ("slip_length", "end_displacement", "dissipation")


def bar(folder, n, thin, steps):
    """Errors of the bar over its closed forms."""
    words = [f"--n={n}", f"--thin={thin}", f"--steps={steps}", f"--output={folder}"]
    summary = cases.bar.main(words)
    curve = np.array(summary["curve"])
    closed = np.array(summary["closed_form"])
    np.testing.assert_array_equal(curve[:, 1], closed[:, 1])
    np.testing.assert_allclose(
        curve[:, 0], closed[:, 0], rtol=0, atol=2 / thin * closed[:, 0].max()
    )
    # The loop closes: what was loaded first is remembered.
    assert curve[-1, 0] == pytest.approx(curve[steps, 0], rel=1e-3)
    return [abs(summary[name] / summary[f"{name}_closed_form"] - 1) for name in NAMES]


@pytest.mark.long
@pytest.mark.verifies(
    "quasi-static",
    "Coulomb",
    "energies of histories",
    reference="closed form: slip length, end and dissipation of a bar",
    aspects=("2D",),
)
def test_bar_on_a_floor_agrees_to_first_order(folder):
    """To first order in the thickness over the slip length."""
    coarse, fine = (bar(folder / str(n), n, n // 2, 2) for n in (40, 80))
    for a, b in zip(coarse[:2], fine[:2], strict=True):
        assert b < 0.6 * a
    assert max(coarse) < 0.05
    assert (folder / "80" / "steps.csv").read_text().count("\n") == 12


@pytest.mark.long
def test_bar_on_a_floor_converges_to_one_percent(folder):
    assert max(bar(folder, 200, 100, 10)) < 0.01


@pytest.mark.long
def test_the_two_blocks_demo_costs_little_friction(folder, no_pictures):
    """Other nodes on the lower block change the cost of friction by a few percent only."""
    spent = []
    for ratio in (1, 2):
        words = ["--n=4", f"--ratio={ratio}", f"--output={folder}"]
        steps = cases.two_blocks.main(words)["steps"]
        assert len(steps) == 37
        assert steps[-1]["status"] == "ooooo"
        spent.append(steps[-1]["dissipation"])
    assert spent[1] == pytest.approx(spent[0], rel=0.05)
    rows = (folder / "steps.csv").read_text().splitlines()
    assert len(rows) == 39
    assert rows[0].startswith("step,time,length,open,stick,slip")
    assert len(list(folder.glob("evolution_contact*"))) == 1


def mindlin(folder, n, steps):
    """Errors of the shear over mu p0, after checks of the stick radius."""
    summary = cases.mindlin.main([f"--n={n}", f"--steps={steps}", f"--output={folder}"])
    found = [summary[way] for way in ("loading", "unloading")]
    for way in found:
        cell = 0.68 / n
        assert way["stick_radius"] == pytest.approx(way["stick_radius_closed_form"], abs=cell)
        assert way["worst_error"] < 0.02
    return [way["l2_error"] for way in found]


@pytest.mark.long
@pytest.mark.verifies(
    "quasi-static",
    "Coulomb",
    reference="closed form: Cattaneo and Mindlin, there and back",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_mindlin_demo_agrees_with_cattaneo_and_mindlin(folder):
    """Cattaneo and Mindlin, there and back, to 2 % of mu p0."""
    assert max(mindlin(folder, 20, 2)) < 0.02


@pytest.mark.long
def test_mindlin_converges(folder):
    coarse = mindlin(folder / "10", 10, 4)
    fine = mindlin(folder / "20", 20, 8)
    assert max(fine) < 0.5 * max(coarse)


@pytest.mark.long
@pytest.mark.verifies(
    "RCCM adhesion", reference="closed form: a bond that opens, and its snap-back", aspects=("2D",)
)
def test_adhesion_case_has_the_folds_of_its_snap_back(folder):
    """A bond opened to 6 u0, without viscosity and with; the folds of its snap-back."""
    words = ["--steps=2", f"--output={folder}"]
    summary = cases.adhesion.main([*words, "--spring=1"])
    for ratio, beta in summary["beta_at"].items():
        assert beta == pytest.approx(float(ratio) ** -2, rel=1e-8)
    assert summary["work"] == pytest.approx(71 / 72, rel=1e-8)
    assert (summary["peak"], summary["peak_at"]) == pytest.approx((1.0, 1.0), rel=1e-8)
    kink, smooth = summary["folds"]
    assert (kink["u_tot"], kink["u"]) == pytest.approx((2.0, 1.0), rel=1e-6)
    u = 3**0.25
    assert (smooth["u_tot"], smooth["u"]) == pytest.approx((4 * u / 3, u), rel=1e-6)
    assert (kink["kind"], smooth["kind"]) == ("nonsmooth", "smooth")
    slow = cases.adhesion.main(["--steps=8", f"--output={folder}", "--viscosity=1"])
    assert slow["beta_at"]["2"] == pytest.approx(0.4048318120, rel=0.02)
    assert slow["peak"] == pytest.approx(1.107952, rel=0.03)
    words = ["--steps=8", "--order=2", "--viscosity=1", f"--output={folder}"]
    better = cases.adhesion.main(words)
    wanted = {"1.5": 0.7811538113, "2": 0.4048318120, "3": 0.1218560409}
    for ratio, beta in wanted.items():
        assert better["beta_at"][ratio] == pytest.approx(beta, abs=1e-3)
    assert better["peak"] == pytest.approx(1.107952, rel=5e-3)  # it is between two steps
    assert (folder / "pull.png").exists()


@pytest.mark.verifies(
    "jumps",
    "RCCM adhesion",
    "bodies of revolution",
    reference="closed form: a bar in a rigid matrix",
    aspects=(
        "2D",
        "pairs",
    ),
)
@pytest.mark.long
def test_a_fibre_is_pulled_out(folder, no_pictures):
    """Against a bar in a rigid matrix; after the jump only friction is holding it."""
    names = run("pull_out", folder)
    force, bar, foot, mouth, u0 = (names[k] for k in ("force", "bar", "foot", "mouth", "u0"))
    steps = names["history"].steps
    assert names["pressure"] == pytest.approx(names["lame_pressure"], rel=0.02)
    still = names["at_rest"]
    debonds = still & (mouth > u0)
    assert debonds.sum() > 4
    np.testing.assert_allclose(force[debonds], bar[debonds], rtol=0.015)
    np.testing.assert_allclose(force[still], bar[still], rtol=0.03)
    external = np.array([step.energies.external for step in steps])
    residue = np.array([step.energies.residue for step in steps])
    assert (np.abs(residue) < 0.03 * external)[still].all()
    # The fibre releases energy from the peak to the plateau, which only the jump accounts for.
    # Before it the last of the bond may break node by node.
    jumps = [step.time for step in steps if step.jump]
    assert 1 <= len(jumps) <= 3
    assert min(jumps) > 0.9 * max(jumps)
    slips = foot > u0
    plateau = names["plateau"]
    assert force.max() > 2.5 * force[-1]
    assert force[-1] == pytest.approx(plateau, rel=0.015)
    u = (foot + mouth)[slips] / 2 / u0
    bond = np.sqrt(names["fracture_energy"] * names["bond"]) / u**3  # remaining traction
    closed = plateau * (1 - u**-2.0) + 2 * np.pi * 0.25 * 5.0 * bond
    np.testing.assert_allclose(force[slips], closed, rtol=0.02)
    assert residue[slips][0] > 0.02 * external[slips][0]
    assert (folder / "output" / "pull_out" / "force.png").stat().st_size > 10_000


@pytest.mark.long
def test_fibre_residue_falls_with_the_steps(folder, no_pictures):
    """The energy residue before the jump decreases as fast as the steps."""
    shares = []
    for steps in (4, 8):
        names = run("pull_out", folder, steps=steps, end=0.02)
        energies = names["history"].energies
        assert min(energies.damage, energies.dissipated, energies.stored) > 0
        shares.append(abs(energies.residue) / energies.external)
    assert shares[1] < 0.55 * shares[0] < 0.02


def peeling(folder, **parameters):
    """A strip is peeled: conditions holding on every mesh."""
    names = run("peeling", folder, **parameters)
    # A machine that opens the crack and returns does the work of fracture, up to the steps.
    assert names["work_ratio"] == pytest.approx(1.0, abs=0.003)
    folds = [step.row() for step in names["out"].folds]
    kinds = [fold["event"] for fold in folds]
    assert kinds[0] == "nonsmooth fold"
    assert set(kinds) == {"smooth fold", "nonsmooth fold"}
    for fold in folds:
        assert (fold["before"] == fold["after"]) == (fold["event"] == "smooth fold")
    # Where a node has broken, P^2 D is that of a beam.
    np.testing.assert_allclose(names["constant"], 1.0, atol=0.02)
    return names


@pytest.mark.long
def test_peeling_has_its_benchmark_numbers(folder):
    names = peeling(folder)
    assert 3 < names["area"][-1] < 3.5
    assert (folder / "output" / "peeling" / "peeling.png").exists()


@pytest.mark.long
@pytest.mark.verifies(
    "arc length paths",
    "RCCM adhesion",
    reference="closed form: a beam that is peeled",
    aspects=("2D",),
)
def test_peeling_agrees_with_beam_theory(folder):
    """The load reaches its maximum within 1 % of beam theory on meshes of two and four elements."""
    for n in (2, 4):
        names = peeling(folder, n=n, peeled_length=6.0)
        late = names["at_fold"]
        crack = names["turning_crack"]
        turn = names["D_a2"] * crack**2 + names["P_a"] / crack / names["machine"]
        assert names["load"][late].min() / turn == pytest.approx(1.0, abs=0.01)
        # The crack grows as much as is peeled.
        cracks = np.sqrt(names["D"] / names["D_a2"])
        growth = np.ptp(cracks[late]) / np.ptp(names["area"][late])
        assert growth == pytest.approx(1.0, abs=0.05)


@pytest.mark.long
@pytest.mark.verifies(
    "regularised friction",
    "friction of speed and time",
    reference="closed form: the velocity of the creep",
    aspects=("2D",),
)
def test_refrigerator_creeps_at_the_closed_form_velocity(folder):
    """Creeps at the velocity of the closed form; Coulomb's friction holds it for a year."""
    names = run("regularised", folder, cells=(2, 6))
    year, share, creep = (names[k] for k in ("year", "share", "metres_in_a_year"))
    assert abs(names["held"]) < 1e-6
    for shape, speed in (("tanh", np.arctanh(share)), ("sqrt", share / np.sqrt(1 - share**2))):
        for eps in np.logspace(-9, -5, 5):
            law = Regularised(Coulomb(0.3), width=1e-4, shape=shape, speed=eps)
            metres, history = creep(law)
            assert metres == pytest.approx(year * eps * speed, rel=1e-8)
            # The initial spreading under the weight is relieved as well.
            dissipated = history.energies.dissipated
            assert dissipated == pytest.approx(5.0 * metres, rel=1e-3, abs=2e-4)
    assert metres > 6


@pytest.mark.long
@pytest.mark.verifies(
    "interfaces of one's own",
    "energies of histories",
    reference="closed form: a long bar on a ductile glue",
    aspects=("2D",),
)
def test_own_interface_peels_with_the_force_of_a_long_bar(folder, no_pictures):
    """A sheet is drawn off a ductile glue with the force of a long bar; errors fall by four."""
    off = []
    for n in (60, 120):
        names = run("own_interface", folder, n=n)
        off.append(names["worst"])
        # The glue has cost the area under its traction wherever it is broken.
        energies = names["history"].energies
        assert abs(energies.residue) < 2e-3 * energies.external
        assert names["force"][-1] == pytest.approx(40.0, rel=0.003)
    assert off[1] < 1e-3
    assert off[1] < 0.3 * off[0]


@pytest.mark.long
@pytest.mark.verifies(
    "RCCM adhesion",
    "energies of histories",
    reference="closed form: uniform slip of the bond",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_steel_bond_breaks_and_leaves_friction(folder, no_pictures):
    """The bond breaks and leaves friction; of the work nothing is lost but by the steps."""
    left = []
    for steps in (4, 8):
        words = ["--n=8", f"--steps={steps}", f"--output={folder}"]
        summary = cases.steel_concrete.main(words)
        slip, force, uniform = (summary[k] for k in ("slip", "force", "uniform"))
        assert summary["normal"] == pytest.approx(400.0, rel=1e-8)
        assert summary["plateau"] == pytest.approx(summary["plateau_closed_form"], rel=1e-3)
        assert summary["plateau"] == pytest.approx(summary["friction_limit"], rel=0.01)
        # Away from the peak, where the slip is uniform, all of the curve.
        away = (slip < 0.05) | (slip > 0.2)
        np.testing.assert_allclose(force[away], uniform[away], rtol=0.02)
        assert 0.8 < summary["peak"] / uniform.max() < 0.95
        broken = 1 - (0.1 / slip[-1]) ** 2
        assert summary["damage"] == pytest.approx(broken * summary["work_of_bond"], rel=2e-3)
        spent = (summary[k] for k in ("stored", "dissipated", "damage", "residue"))
        assert sum(spent) == pytest.approx(summary["external"])
        left.append(abs(summary["residue"]) / summary["external"])
    assert left[1] < 0.6 * left[0] < 0.012
    assert (folder / "pull_out.png").exists()
    assert (folder / "steps.csv").read_text().count("\n") == 3 * 8 + 4 * 8 + 1


def indenter(folder, *words):
    """Return pull-off forces of an indenter relative to Johnson, Kendall and Roberts."""
    summary = cases.indenter.main([*words, f"--output={folder}"])
    bare = summary["without_recovery"]
    sticky = summary["with_recovery"]
    # Nothing sticks without recovery, and nothing is lost.
    assert abs(bare["pull_off"]) < 1e-9 * bare["most"]
    assert bare["damage"] == 0
    assert sticky["most"] == pytest.approx(bare["most"], rel=5e-3)
    # Up to where it comes off the energies balance; half of the work is then in the polymer.
    assert abs(sticky["residue"]) < 0.01 * sticky["external"]
    assert sticky["damage"] > 0.8 * 2 * cases.indenter.WORK * 0.5
    assert (folder / "force.png").exists()
    return sticky["pull_off"] / summary["johnson_kendall_roberts"]


@pytest.mark.long
def test_indenter_needs_more_than_the_inviscid_force(folder):
    """Above the force without viscosity, which a coarse mesh adds to (in 96 steps: 1.44)."""
    assert 1.35 < indenter(folder, "--n=12", "--steps=24", "--rest=0.1") < 1.45


@pytest.mark.long
def test_indenter_converges(folder):
    first, second, third = (indenter(folder, f"--n={n}") for n in (16, 24, 32))
    assert 1.1 < third < second < first < 1.3
    assert second - third < 0.6 * (first - second)


def at_rest(problem):
    """Tables of the shaft, and the remaining displacement under balanced stresses."""
    result = problem.solve()
    left = np.linalg.norm(problem.u.x.array, ord=np.inf)
    return result.tables["contact"], problem.u.function_space.mesh.comm.allreduce(left, op=MPI.MAX)


def gives(*words):
    """Return the settlement of a stiff pile slipping along its length in cylinders of soil."""
    args = cases.pile.arguments(list(words))
    problem, drawn = cases.pile.pile_in_soil(args, MPI.COMM_WORLD)
    problem.solve()
    drawn.value = 1e-4
    table = problem.solve().tables["contact"]
    slip = table.area @ table.ut[:, 1] / table.area.sum()
    return (1e-4 - slip) / -table.force[:, 1].sum() / cases.pile.closed_form(args, slip)[2]


@pytest.mark.verifies(
    "bodies of revolution",
    "Coulomb",
    reference="closed form: the earth pressure at rest, K0 g z",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_earth_pressure_at_rest_displaces_nothing():
    """Stresses, weight and the pressure from below leave nothing displaced: K0 g z on the shaft."""
    args = cases.pile.arguments(["--n=8"])
    table, left = at_rest(cases.pile.pile_in_soil(args, MPI.COMM_WORLD)[0])
    assert left < 1e-12
    z = -table.x[:, 1]
    h = args.depth / args.n
    exact = 5.0 * z
    np.testing.assert_allclose(table.pressure[1:-1], exact[1:-1], rtol=1e-8)
    # The force on a node at an end is that of half a cell, whose pressure is not that of its end.
    np.testing.assert_allclose(table.pressure[[0, -1]], [5.0 * (10 - h / 3), 5.0 * h / 3])
    assert table.rn.sum() == pytest.approx(np.pi * 0.3 * 5.0 * 10**2, rel=1e-8)
    np.testing.assert_allclose(table.shear, 0.0, atol=1e-8)


@pytest.mark.long
@pytest.mark.verifies(
    "RCCM adhesion",
    "bodies of revolution",
    "energies of histories",
    reference="closed form: one slip all along the shaft",
    aspects=(
        "2D",
        "pairs",
    ),
)
def test_a_pile_is_drawn(folder, no_pictures):
    """The load follows one slip all along the shaft, from the bond to the friction left."""
    summary = cases.pile.main(["--n=8", "--steps=6", f"--output={folder}"])
    head, force, closed = (np.array(summary[k]) for k in ("head", "force", "closed_form"))
    assert summary["at_rest"] == pytest.approx(summary["friction_limit"], rel=1e-8)
    assert summary["friction_limit"] == pytest.approx(np.pi * 0.3 * 0.5 * 0.5 * 10.0 * 10**2)
    assert summary["peak"] == pytest.approx(summary["peak_closed_form"], rel=0.03)
    assert summary["plateau"] == pytest.approx(summary["friction_limit"], rel=0.015)
    np.testing.assert_allclose(force[-3:], closed[-3:], rtol=0.015)
    # Soil with free ends gives way by a tenth more, of a fifth of the whole.
    assert summary["gives"] / summary["gives_closed_form"] == pytest.approx(1.1, abs=0.04)
    # No bond is left, and nothing is lost but by the steps.
    bond = 2 * np.pi * 0.3 * 10 * cases.pile.BOND * cases.pile.U0**2
    slip = head[-1] - force[-1] * summary["gives"]
    broken = 1 - (cases.pile.U0 / slip) ** 2
    assert summary["damage"] == pytest.approx(broken * bond, rel=2e-3)
    assert summary["external"] == pytest.approx(summary["work_of_pull"], rel=1e-4)
    assert abs(summary["residue"]) < 0.03 * summary["external"]
    assert all((folder / name).exists() for name in ("load.png", "shear.png"))
