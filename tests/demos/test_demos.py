"""The numbers of the demos."""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import cases.greco_block
import cases.hild_triangle
import cases.sliding_solution
import cases.which_solution
import numpy as np
import pytest
from cases._triangle import element

HILD = json.loads((Path(__file__).parents[1] / "data" / "hild_triangle.json").read_text())[
    "records"
]


@pytest.mark.verifies(
    "Coulomb",
    "Newton's method",
    reference="independent code: Code_Aster, SSNV128",
    aspects=(
        "2D",
        "multigrid",
    ),
)
def test_greco_block_agrees_with_code_aster(accuracy, folder):
    """Code_Aster SSNV128: QUAD8 values to 0.3 %, and the known status of the 32 x 32 mesh."""
    summary = cases.greco_block.main(["--output", str(folder)])
    assert summary["status"] == "ooo" + 21 * "+" + 8 * "k" + "d"
    for point in "ABCD":
        expected = cases.greco_block.CODE_ASTER[point]
        assert abs(summary[f"ux_{point}"] / expected - 1) < 3e-3
    assert summary["kkt_violation"] < 0.1 * accuracy


STATES = {"open": "o", "stick": "k", "slip+": "+", "slip-": "-"}


@pytest.mark.parametrize("friction", sorted({r["F"] for r in HILD}))
@pytest.mark.verifies(
    "all solutions",
    "Coulomb",
    reference="enumeration: all statuses, confirmed with GetFEM",
    aspects=("2D",),
)
def test_hild_triangle_has_the_enumerated_solutions(friction):
    """Every record of an independent enumeration: the same solutions, and no others."""
    for record in (r for r in HILD if r["F"] == friction):
        load = record["F1"], record["F2"]
        system = element((100.0, 82.0), friction, 1.0, load)
        found = cases.hild_triangle.solutions(system)
        expected = sorted(record["solutions"], key=lambda s: "ok+-".index(STATES[s["state"]]))
        assert [s["status"] for s in found] == [STATES[s["state"]] for s in expected], record
        for mine, other in zip(found, expected, strict=True):
            for key in ("ut", "un", "rt", "rn"):
                assert abs(mine[key] - other[key]) < 1e-10


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "all solutions", reference="closed form: three solutions of Hild's element", aspects=("2D",)
)
def test_hild_triangle_has_three_closed_form_solutions(folder):
    """lambda = mu = l = 1, F = 3, load (-2.4, -1): three solutions in closed form."""
    summary = cases.hild_triangle.main(["--output", str(folder)])
    found = summary["solutions"]
    assert [s["status"] for s in found] == ["o", "k", "-"]
    np.testing.assert_allclose([found[0]["ut"], found[0]["un"]], [-19 / 30, 1 / 15], atol=1e-12)
    np.testing.assert_allclose([found[1]["rt"], found[1]["rn"]], [1.2, 0.5], atol=1e-12)
    np.testing.assert_allclose(
        [found[2][k] for k in ("ut", "rt", "rn")], [-0.3, 0.6, 0.2], atol=1e-12
    )
    assert json.loads((folder / "summary.json").read_text())["solutions"] == found
    assert (folder / "states.png").stat().st_size > 10_000


def test_hild_triangle_passes_a_continuum_of_solutions(folder):
    """At the critical coefficient: from stick, along slipping states, to separation."""
    options = ["--friction=2", "--load", "-2", "-1", f"--output={folder}"]
    (continuum,) = cases.hild_triangle.main(options)["solutions"]
    assert continuum["continuum"] is True
    assert [s["status"] for s in (continuum, *continuum["ends"])] == ["-", "-", "-"]
    values = [[s[k] for k in ("ut", "un", "rt", "rn")] for s in continuum["ends"]]
    np.testing.assert_allclose(values, [[0, 0, 1, 0.5], [-0.5, 0, 0, 0]], atol=1e-12)


@pytest.mark.long
@pytest.mark.verifies(
    "all solutions", "charts", reference="paper: Hild (2002), Proposition 2", aspects=("2D",)
)
def test_hild_triangle_diagram_agrees_with_proposition_2(folder):
    """Proposition 2 of Hild (2002), cell by cell, and the lines carrying sets of their own."""
    summary = cases.hild_triangle.main(["--diagram", "--grid=24", "--output", str(folder)])
    critical = 2.0
    for name, found in summary["diagram"].items():
        assert (folder / f"regions_{name}_critical.png").stat().st_size > 10_000
        F = found["friction"]
        axis, cells, _ = cases.hild_triangle.diagram((1.0, 1.0), F, 1.0, 24)
        for i, f1 in enumerate(axis[0]):
            for j, f2 in enumerate(axis[1]):
                assert cells[i, j] == proposition_2(F, critical, f1, f2), (F, f1, f2)
        lines = {tuple(np.round(line["load"], 12)): line["solutions"] for line in found["lines"]}
        if name == "at":
            assert lines[(-2.0, -1.0)] == "-~"
        if name == "above":
            assert lines[(-3.0, -1.0)] == "ok"  # separation and stick
            assert lines[(-2.0, -1.0)] == "ok"  # stick, and left slip that just separates


def proposition_2(F, critical, f1, f2):
    """Statuses of the solutions at a load inside a region (lambda = mu, signs of this package)."""
    separation = f2 > f1 / critical
    stick = f2 < 0 and abs(f1) < F * abs(f2)
    right = f2 < f1 / critical and F * f2 + f1 > 0
    if critical > F:
        left = f2 < f1 / critical and F * f2 - f1 > 0
    else:
        left = f2 < 0 and -F * abs(f2) < f1 < -critical * abs(f2)
        if critical == F:
            left = False
    return "".join(
        letter
        for letter, holds in zip("ok+-", (separation, stick, right, left), strict=True)
        if holds
    )


DEMOS = Path(__file__).parents[2] / "demos"


@pytest.mark.parametrize("demo", sorted(DEMOS.glob("*.py")), ids=lambda path: path.stem)
def test_a_demo_is_one_narrated_file(demo):
    """Users copy demos: no local modules, private names or options; a fifth is narration."""
    text = demo.read_text()
    assert not re.search(r"^\s*(import|from) (demo_|_)", text, re.MULTILINE)
    assert not re.search(r"argparse|sys\.argv|def main|destroy\(\)", text)
    assert "# This demo illustrates how to:" in text
    assert not re.search(r"[a-z)]\._[a-z]", text)
    lines = [line for line in text.splitlines() if line.strip()]
    narration = [line for line in lines if line.startswith("#")]
    assert 0.2 * len(lines) < len(narration)
    assert "plot." in text


def test_every_algorithm_returns_a_solution_or_names_its_failure(folder):
    """Every algorithm returns one of the three solutions of the element or names its failure.

    The free body is a solution, so a start there stays. Starts at the corners of the grid lead to
    at least two solutions. Lemke's method leads to the same one from every start.
    """
    words = ["--n=2", "--friction=1.7", "--grid=3"]
    summary = cases.which_solution.main([*words, f"--output={folder}"])
    element = summary["problems"]["element"]
    assert set(element["solution"].values()) <= set("ok-")
    assert all(element["converged"].values())
    assert element["solution"]["newton"] == "o"
    basins = element["basins"]
    assert set(basins) == set(cases.which_solution.ALGORITHMS)
    assert all(len(b) == 9 for b in basins.values())
    assert len(set(basins["lemke"])) == 1
    assert all(set(b) <= set("ok-cdn") for b in basins.values())
    assert {word for b in basins.values() for word in b} >= {"o", "k"}
    assert (folder / "basins_element.png").exists()


@pytest.mark.long
def test_newton_alone_reaches_the_sliding_solution(folder):
    """Beyond F = 3 Newton's method alone reaches the sliding solution, from starts around it."""
    summary = cases.sliding_solution.main(["--n=2", "--grid=2", f"--output={folder}"])
    element = summary["problems"]["element"]
    assert element["critical"] == pytest.approx(3.0, rel=1e-12)
    starts = np.array([0.275, 0.825])
    beyond = {
        "newton": ("--", "--"),
        **dict.fromkeys(("tresca", "uzawa", "cg"), ("ok", "ok")),
        **dict.fromkeys(("penalty", "gauss-seidel", "lemke"), ("oo", "oo")),
        "interior-point": ("kk", "kk"),
    }
    for name, words in element["words"].items():
        pressures = np.array(element["pressures"][name])
        assert words[:2] == ["--", "--"]
        np.testing.assert_allclose(pressures[:2], 0.5, atol=1e-5 if name == "penalty" else 1e-8)
        if name in ("newton", "tresca", "uzawa", "gauss-seidel"):  # no solution is left
            np.testing.assert_allclose(pressures[2], starts, atol=1e-9)
        assert np.all((pressures[2] > -1e-9) & (pressures[2] < 1 + 1e-9))
        assert tuple(words[3:]) == beyond[name]
    corner = cases.sliding_solution.corner(cases.sliding_solution.triangle(1.7, 64))
    assert max(corner[:2]) == pytest.approx(1.6588005832, abs=1e-9)
    assert (folder / "triangle.png").exists()


ROOT = Path(__file__).parents[2]
CASES = sorted((ROOT / "benchmarks" / "cases").glob("[a-z]*.py"))
LIMIT = 300.0  # seconds
TIMES = Path(os.environ.get("OUTPUT") or ROOT / "output") / "cases_at_defaults.json"


def keep(name, seconds):
    """Add the time of a case to the table."""
    TIMES.parent.mkdir(parents=True, exist_ok=True)
    times = json.loads(TIMES.read_text()) if TIMES.exists() else {}
    times[name] = round(seconds, 1)
    # Two workers may write; the file is replaced as a whole.
    new = TIMES.with_suffix(f".{os.getpid()}.new")
    new.write_text(json.dumps(dict(sorted(times.items())), indent=1) + "\n")
    new.replace(TIMES)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=lambda path: path.stem)
def test_case_runs_at_its_defaults(case, tmp_path):
    # The process must not count as a rank of the tests.
    foreign = ("OMPI_", "PMIX_", "PRTE_", "PMI_")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(foreign)}
    wanted = {k: v for k, v in os.environ.items() if k.startswith(("OMPI_MCA_btl", "OMPI_ALLOW"))}
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, str(case), "--output", str(tmp_path)],
        env=kept | wanted,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    seconds = time.monotonic() - start
    keep(case.stem, seconds)
    print(f"{case.stem}: {seconds:.0f} s")
    assert done.returncode == 0, done.stderr[-3000:]
