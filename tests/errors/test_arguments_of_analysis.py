"""Arguments that analyses and proofs refuse: one table for each function."""

from dataclasses import replace

from mpi4py import MPI

import cases.proofs_3d
import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.enumeration import random_family
from support.leaning_bodies import block, leaning, on_box, pad, swirl
from support.own_laws import SlipWeakening

import ufl
from dolfinx import mesh

from dolfinx_contact import plot
from dolfinx_contact.analysis import (
    SteadySliding,
    critical_friction,
    renard_criterion,
    solution_regions,
    stability_at_rest,
    wedging_friction,
)
from dolfinx_contact.analysis.curve_search import follow_events
from dolfinx_contact.proofs import ReducedProblem, prove_solutions

COMM = MPI.COMM_WORLD
BODIES = {
    "leaning": lambda: leaning(2),
    "triangle": lambda: linear_triangle(1, 1.0).problem,
    "3D": lambda: block(1),
    "none": lambda: None,
    "on a box": lambda: on_box(mesh.create_unit_square(COMM, 2, 2)),
    **{
        name: lambda options=options: on_box(mesh.create_unit_square(COMM, 2, 2), **options)
        for name, options in {
            "free": {"clamped": False},
            "integral": {"method": "integral"},
            "mixed": {"method": "mixed"},
            "slip weakening": {"law": SlipWeakening(0.4, 0.2, 0.1)},
        }.items()
    },
}


@pytest.fixture(scope="module")
def bodies():
    """Problems by their names, made once."""
    problems = {}

    def body(name):
        if name not in problems:
            problems[name] = BODIES[name]()
        return problems[name]

    return body


def vectors_of_length_two(x):
    return 2.0 * np.ones_like(x)


TABLES = {
    critical_friction: [
        ("leaning", {"direction": (0.0, 1.0)}, "normal to the contact surface"),
        ("leaning", {"direction": (1.0, 0.0, 0.0)}, "a direction of slip is a vector"),
        ("leaning", {"direction": "right"}, "a direction of slip is a vector"),
        ("leaning", {"count": 0}, "count must be a whole number >= 1"),
        ("leaning", {"solver": "lu"}, "solver must be one of auto, direct, amg; got 'lu'"),
        ("3D", {}, "in 3D a direction"),
        ("free", {}, "without resistance"),
        ("integral", {}, "nodal or mixed"),
        ("mixed", {"solver": "amg"}, "points that are nodes: use solver='direct'"),
    ],
    renard_criterion: [
        ("slip weakening", {}, "requires Coulomb's law"),
        ("integral", {}, "nodal or mixed"),
        ("on a box", {"directions": vectors_of_length_two}, "vectors of length 1 at most"),
        (
            "3D",
            {"directions": swirl, "dense": False, "weights": True},
            "weights require the dense eigenproblem",
        ),
    ],
    stability_at_rest: [
        ("leaning", {"density": -1.0}, "density must be a positive number"),
        ("integral", {"density": 1.0}, "nodal or mixed"),
    ],
    wedging_friction: [
        ("triangle", {"seconds": -1}, "must be"),
        ("triangle", {"seconds": "a"}, "must be"),
        ("triangle", {"sides": 3}, "must be"),
        ("triangle", {"sides": 4.5}, "must be"),
        ("none", {}, "ContactProblem"),
    ],
}


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("analysis", "body", "arguments", "message"),
    [(analysis, *row) for analysis, rows in TABLES.items() for row in rows],
)
def test_analyses_refuse_bodies_and_arguments(bodies, analysis, body, arguments, message):
    with pytest.raises(ValueError, match=message):
        analysis(bodies(body), **arguments)


@pytest.fixture(scope="module")
def two_parameters():
    """Arguments of `solution_regions` for a small problem with two parameters."""
    family = replace(random_family(0), comm=COMM)
    return family, follow_events(family, [], (1.0, 2.0), (-1.0, 1.0))


RANGES = {"mu_range": (1.0, 2.0), "gamma_range": (-1.0, 1.0)}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"proof_seconds": 0.0}, "seconds"),
        ({"proof_seconds": -1.0}, "seconds"),
        ({"proof_seconds": np.nan}, "seconds"),
        ({"mu_range": (2.0, 1.0)}, "range"),
    ],
)
def test_solution_regions_refuses_arguments(two_parameters, arguments, message):
    with pytest.raises(ValueError, match=message):
        solution_regions(*two_parameters, **(RANGES | arguments))


def test_regions_refuse_points_outside_and_charts_without_names(two_parameters, tmp_path):
    regions = solution_regions(*two_parameters, **RANGES)
    with pytest.raises(ValueError, match="outside"):
        regions.at(0.0, 0.0)
    with pytest.raises(ValueError, match="no names"):
        plot.draw_chart(tmp_path / "a.png", regions, two_parameters[1], {})


def no_damping_form(problem):
    return ufl.inner(problem.u, problem.u) * ufl.dx


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"density": 0.0}, "density must be a positive number"),
        ({"damping": -0.1}, "a time >= 0 or a form"),
        ({"damping": no_damping_form}, "trial and a test"),
        ({"count": 0}, "count must be a whole number >= 1"),
    ],
)
def test_steady_sliding_refuses_arguments(arguments, message):
    problem = pad(2)
    values = {name: v(problem) if callable(v) else v for name, v in arguments.items()}
    with pytest.raises(ValueError, match=message):
        SteadySliding(problem, (-1.0, 0.0), **({"density": 1.0} | values))


@pytest.mark.ranks(2)
def test_steady_sliding_refuses_negative_friction():
    sliding = SteadySliding(pad(2), (-1.0, 0.0), density=1.0)
    with pytest.raises(ValueError, match="friction must be a nonnegative number"):
        sliding.modes(-0.1)
    with pytest.raises(ValueError, match="max_friction must be a positive number"):
        sliding.onset(0.0)


REDUCED = {"S": np.eye(2), "p": np.zeros(2), "friction": np.array([0.3])}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"p": np.zeros(3)}, "shape"),
        ({"p": np.array([np.nan, 0.0])}, "not finite"),
        ({"friction": np.array([-0.3])}, "negative"),
        ({"bound": np.array([1.0])}, "either a coefficient"),
        ({"S": -np.eye(2)}, "positive definite"),
        ({"S_error": np.full((2, 2), 0.6)}, "positive definite"),
    ],
)
def test_reduced_problem_refuses_arguments(arguments, message):
    with pytest.raises(ValueError, match=message):
        ReducedProblem(**(REDUCED | arguments))


def test_prove_solutions_refuses_statuses_of_other_points():
    with pytest.raises(ValueError, match="statuses of 1 points"):
        prove_solutions(ReducedProblem(**REDUCED), known=[np.array([0, 0])])


def test_all_solutions_refuses_two_numbers_of_cells_for_a_block(capsys):
    with pytest.raises(SystemExit):
        cases.proofs_3d.arguments(["--shape", "block", "--cells", "2", "2"])
    assert "two numbers for an extruded triangle, three for a block" in capsys.readouterr().err
