"""What analyses refuse: the call and its message."""

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

from dolfinx_contact import (
    plot,
)
from dolfinx_contact.analysis import (
    SteadySliding,
    critical_friction,
    renard_criterion,
    solution_regions,
    stability_at_rest,
    wedging_friction,
)
from dolfinx_contact.analysis.curve_search import follow_events
from dolfinx_contact.proofs import (
    ReducedProblem,
    prove_solutions,
)

COMM = MPI.COMM_WORLD


@pytest.mark.ranks(2)
def test_critical_friction_refuses_directions_and_solvers():
    problem = leaning(2)
    for direction, words in (
        ((0.0, 1.0), "normal to the contact surface"),
        ((1.0, 0.0, 0.0), "a direction of slip is a vector"),
        ("right", "a direction of slip is a vector"),
    ):
        with pytest.raises(ValueError, match=words):
            critical_friction(problem, direction)
    with pytest.raises(ValueError, match="number of eigenvalues"):
        critical_friction(problem, count=0)
    with pytest.raises(ValueError, match="in 3D a direction"):
        critical_friction(block(1))
    with pytest.raises(ValueError, match="without resistance"):
        critical_friction(on_box(mesh.create_unit_square(COMM, 2, 2), clamped=False))
    domain = mesh.create_unit_square(COMM, 2, 2)
    with pytest.raises(ValueError, match="nodal or mixed"):
        critical_friction(on_box(domain, method="integral"))
    with pytest.raises(ValueError, match="unknown solver of the body 'lu'; known: auto"):
        critical_friction(problem, solver="lu")
    with pytest.raises(ValueError, match="points that are nodes: take solver='direct'"):
        critical_friction(on_box(domain, method="mixed"), solver="amg")


def test_solution_regions_refuses_ranges(tmp_path):
    family = replace(random_family(0), comm=COMM)
    curves = follow_events(family, [], (1.0, 2.0), (-1.0, 1.0))
    ranks = [1.0 + COMM.rank] if COMM.size > 1 else []
    for seconds in (0.0, -1.0, np.nan, *ranks):
        with pytest.raises(ValueError, match="seconds"):
            solution_regions(
                family, curves, mu_range=(1.0, 2.0), gamma_range=(-1.0, 1.0), proof_seconds=seconds
            )
    with pytest.raises(ValueError, match="range"):
        solution_regions(family, curves, mu_range=(2.0, 1.0), gamma_range=(-1.0, 1.0))
    regions = solution_regions(family, curves, mu_range=(1.0, 2.0), gamma_range=(-1.0, 1.0))
    with pytest.raises(ValueError, match="outside"):
        regions.at(0.0, 0.0)
    with pytest.raises(ValueError, match="no names"):
        plot.draw_chart(tmp_path / "a.png", regions, curves, {})


@pytest.mark.ranks(2)
def test_renard_criterion_refuses_laws_and_directions():
    domain = mesh.create_unit_square(COMM, 2, 2)
    with pytest.raises(ValueError, match="about Coulomb's law"):
        renard_criterion(on_box(domain, law=SlipWeakening(0.4, 0.2, 0.1)))
    problem = on_box(domain)
    with pytest.raises(ValueError, match="vectors of length 1 at most"):
        renard_criterion(problem, lambda x: 2.0 * np.ones_like(x))
    with pytest.raises(ValueError, match="nodal or mixed"):
        renard_criterion(on_box(domain, method="integral"))


def test_renard_criterion_refuses_weights_of_the_sparse_problem():
    with pytest.raises(ValueError, match="weights need the dense eigenproblem"):
        renard_criterion(block(2), swirl, dense=False, weights=True)


@pytest.mark.ranks(2)
def test_stability_at_rest_refuses_densities_and_methods():
    problem = leaning(2)
    with pytest.raises(ValueError, match="density must be positive"):
        stability_at_rest(problem, density=-1.0)
    with pytest.raises(ValueError, match="eigenproblems must be 1 or more"):
        stability_at_rest(problem, density=1.0, max_count=0)
    domain = mesh.create_unit_square(COMM, 2, 2)
    with pytest.raises(ValueError, match="nodal or mixed"):
        stability_at_rest(on_box(domain, method="integral"), density=1.0)


@pytest.mark.ranks(2)
def test_steady_sliding_refuses_damping_and_densities():
    problem = pad(2)
    for given, words in (
        (dict(density=0.0), "density must be positive"),
        (dict(density=1.0, damping=-0.1), "a time >= 0 or a form"),
        (dict(density=1.0, damping=ufl.inner(problem.u, problem.u) * ufl.dx), "trial and a test"),
        (dict(density=1.0, count=0), "number of eigenvalues"),
    ):
        with pytest.raises(ValueError, match=words):
            SteadySliding(problem, (-1.0, 0.0), **given)
    sliding = SteadySliding(problem, (-1.0, 0.0), density=1.0)
    with pytest.raises(ValueError, match="number >= 0"):
        sliding.modes(-0.1)
    with pytest.raises(ValueError, match="largest friction must be positive"):
        sliding.onset(0.0)


@pytest.mark.ranks(2)
def test_wedging_friction_refuses_sides_and_seconds():
    problem = linear_triangle(1, 1.0).problem
    for wrong in (dict(seconds=-1), dict(seconds="a"), dict(sides=3), dict(sides=4.5)):
        with pytest.raises(ValueError, match="must be"):
            wedging_friction(problem, **wrong)
    with pytest.raises(ValueError, match="ContactProblem"):
        wedging_friction(None)


@pytest.mark.ranks(2)
def test_reduced_problem_refuses_shapes_and_signs():
    S = np.eye(2)
    p = np.zeros(2)
    F = np.array([0.3])
    for bad, what in (
        ((S, np.zeros(3), F), "shape"),
        ((S, np.array([np.nan, 0.0]), F), "not finite"),
        ((S, p, -F), "negative"),
        ((S, p, F, np.array([1.0])), "either a coefficient"),
        ((-S, p, F), "positive definite"),
        ((S, p, F, None, np.full((2, 2), 0.6)), "positive definite"),
    ):
        with pytest.raises(ValueError, match=what):
            ReducedProblem(*bad)
    with pytest.raises(ValueError, match="statuses of 1 points"):
        prove_solutions(ReducedProblem(S, p, F), known=[np.array([0, 0])])


@pytest.mark.ranks(2)
def test_all_solutions_refuses_words():
    with pytest.raises(SystemExit):
        cases.proofs_3d.arguments(["--shape", "block", "--cells", "2", "2"])
