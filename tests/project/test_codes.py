"""`benchmarks/codes/judge.py`, which compares codes, finds each kind of wrong answer."""

import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks" / "codes"))

import judge
import problems
import with_ours

SMALL = {
    "greco": lambda: problems.greco(8),
    "dragged": lambda: problems.dragged(5),
    "three": lambda: problems.three(4),
    "cyclic": lambda: problems.cyclic(6, 5),
    "wedge": lambda: problems.wedge(6),
}


def figures(problem, u, forces=None):
    arrays = {f.name: getattr(problem, f.name) for f in fields(problem)}
    return judge.judged(arrays, u, forces)


def answer(problem):
    u, forces, record = with_ours.solve(problem, {"petsc_options": {"snes_rtol": 1e-12}})
    assert record["converged"]
    return u, forces


def found(problem, u, forces=None):
    """Names of the figures above 1e-3; none lies between that and 1e-8."""
    values = {name: figures(problem, u, forces)[name] for name in judge.FIGURES}
    assert not [v for v in values.values() if 1e-8 < v < 1e-3], values
    return {name for name, v in values.items() if v >= 1e-3}


@pytest.mark.verifies(
    "Coulomb", reference="independent code: the judge of benchmarks/codes", aspects=("2D", "3D")
)
@pytest.mark.parametrize("name", list(SMALL))
def test_the_judge_passes_correct_answers(name):
    problem = SMALL[name]()
    u, forces = answer(problem)
    for given in (None, forces):
        report = figures(problem, u, given)
        assert max(report[f] for f in judge.FIGURES) < 1e-8
    if name == "wedge":
        assert report["statuses"] == {"open": 0, "stick": 0, "slip": len(problem.contact)}
        assert abs(report["closed"]) < 1e-10
    elif name != "three":
        assert report["statuses"]["stick"] > 0


def test_the_judge_finds_an_obstacle_elsewhere():
    problem = problems.cyclic(6, 1)
    lower, higher = (replace(problem, point=np.array([0.0, y])) for y in (-1e-3, 1e-3))
    assert found(problem, answer(lower)[0]) == {"penetration"}
    assert found(problem, answer(higher)[0]) == {"complementarity"}


def test_the_judge_finds_too_much_friction():
    problem = problems.greco(8)
    u, _ = answer(replace(problem, mu=2.0))
    assert {"cone"} <= found(problem, u) <= {"cone", "slip"}


def test_the_judge_finds_friction_along_the_slip():
    # Each step by itself, from the state at rest: the second slips back, and friction with it.
    whole = problems.cyclic(6, 2)
    values = np.stack([whole.values[0], whole.values[0]])
    along = whole.held % 2 == 0
    values[0, along], values[1, along] = 0.02, 0.012
    problem = replace(whole, values=values)
    steps = []
    for v in values:
        alone = replace(
            problem, values=v[None], loads=problem.loads[:1], tractions=problem.tractions[:1]
        )
        steps.append(answer(alone)[0])
    assert found(problem, np.concatenate(steps)) == {"slip"}
    assert not found(problem, answer(problem)[0])


def test_the_judge_finds_forces_out_of_balance():
    problem = problems.dragged(7)
    u, forces = answer(problem)
    assert found(problem, u, 0.9 * forces) == {"equilibrium"}
    inside = np.setdiff1d(np.arange(len(problem.x)), [*problem.contact, *problem.held // 3])
    u[0, inside[0]] += 0.1 * np.abs(u).max()
    assert found(problem, u, forces) == {"equilibrium"}


@pytest.mark.long
@pytest.mark.verifies(
    "NSCD motion", reference="closed form: the path of a bar that bounces", aspects=("2D",)
)
def test_the_judged_path_of_a_bouncing_bar_converges():
    """Errors against the closed form fall under refinement; penetration is found."""
    errors = []
    for n in (5, 10):
        problem = problems.bar(n)
        u, _, record = with_ours.solve(problem, {})
        assert record["converged"]
        errors.append(figures(problem, u))
    coarse, fine = errors
    assert max(coarse["penetration"], fine["penetration"]) < 1e-10
    assert fine["path"] < 0.75 * coarse["path"] < 0.15
    through = figures(problem, u - np.array([0.0, 0.1]))
    assert through["penetration"] > 1e-3


def test_the_judge_refuses_answers_of_another_shape():
    problem = problems.wedge(6)
    u, forces = answer(problem)
    for wrong in (np.full_like(u, np.nan), u[:, :-1], np.concatenate([u, u])):
        with pytest.raises(ValueError, match=r"displacements of shape .* do not fit"):
            figures(problem, wrong)
    for wrong in (np.full_like(forces, np.nan), forces[:, :1], np.concatenate([forces, forces])):
        with pytest.raises(ValueError, match=r"forces of shape .* do not fit"):
            figures(problem, u, wrong)
    with pytest.raises(ValueError, match="nothing moves"):
        figures(problems.cyclic(6, 1), np.zeros((1, 28, 2)))
    # A figure that is no number compares with nothing.
    with pytest.raises(ValueError, match="no number: slip"):
        judge.worse(dict.fromkeys(judge.FIGURES, 0.0), {"slip": np.nan})


@pytest.mark.verifies(
    "mortar", reference="closed form: Hertz' half width and peak", aspects=("2D", "pairs")
)
def test_the_judged_roller_agrees_with_hertz():
    """NAFEMS CB-1, coarser than in the table: the peak is within 3 %, the half width within 2 %."""
    problem = problems.roller(1.2)
    assert problem.hertz == pytest.approx([6.21, 3585.37], rel=1e-3)
    u, forces = answer(problem)
    report = figures(problem, u, forces)
    assert report["force"] == pytest.approx([0, 35e3], abs=1e-4)
    assert report["equilibrium"] < 1e-8
    assert abs(report["peak"]) < 0.03
    assert abs(report["half_width"]) < 0.02
    softer = replace(problem, times=0.5 * problem.times)
    assert figures(softer, u, forces)["equilibrium"] > 0.1


@pytest.fixture(scope="module")
def pressed():
    """Return the pressed die of the ironing problem on a coarse mesh at t = 0.4."""
    problem = replace(problems.ironing(0.4, until=0.4), window=np.array([7]))
    u, forces, record = with_ours.solve(problem, {})
    assert record["converged"]
    assert record["steps"] == problem.steps == 8
    return problem, u, forces


@pytest.mark.verifies(
    "sliding pairs", reference="independent code: the judge of benchmarks/codes", aspects=("2D",)
)
def test_the_judged_die_is_in_equilibrium(pressed):
    """It also fulfils its law; stresses are computed by the judge."""
    problem, u, forces = pressed
    report = figures(problem, u)
    assert report["held"] < 1e-12
    assert report["equilibrium"] < 1e-8
    assert report["pressed"][::-1] == pytest.approx(forces[-1].sum(axis=0) * [1, -1], rel=1e-8)
    assert 20 < report["pressed"][0] < 80
    # The law is that of weighted gaps: at nodes it holds up to the size of a facet.
    assert max(report[f] for f in ("penetration", "cone", "complementarity")) < 0.2
    assert report["statuses"]["open"] > 20
