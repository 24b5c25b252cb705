"""The first step from a body touching nothing."""

import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets, same_tables
from support.checks import solved_start
from support.recorded_run import moved_block

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    Sphere,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.materials import LinearElastic, NeoHookean

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("linear_solver", ["direct", "amg"])
@pytest.mark.parametrize("cell", ["tri", "tet"])
def test_gaps_of_round_off_are_no_contact(cell, linear_solver):
    """The first step is as on a face whose gaps are zero, not held by the few below it."""
    n = 12 if cell == "tri" else 5
    dim = 2 if cell == "tri" else 3
    motion = np.array([0.02, *[0.0] * (dim - 2), -0.1])
    found = []
    for height in (0.0, 1e-16):
        domain = box(COMM, n, cell)
        x = domain.geometry.x
        face = np.abs(x[:, dim - 1]) < 1e-9
        up = np.where(np.sin(60 * x[face, 0] + 7 * x[face, 1]) > -0.7, 1.0, -1.0)
        x[face, dim - 1] = height * up
        problem = block(COMM, domain=domain, top=motion, options={"linear_solver": linear_solver})
        if height:
            (s,) = problem.surfaces
            gaps = s.points.data.gap
            below = COMM.allreduce(int((gaps < 0).sum()))
            assert 0 < below < 0.5 * COMM.allreduce(len(gaps))
        found.append(problem.solve())
    exact, near = found
    assert [s.flips for s in near.history[2:]] == [s.flips for s in exact.history[2:]]
    assert near.history[1].measures.worst < 2 * exact.history[1].measures.worst


def test_another_linear_solver_between_two_solves():
    """The solver is made anew only if its options change."""
    problem = block(n=4, options={"linear_solver": "direct"})
    forces = [problem.solve().tables["contact"].force]
    first = problem.linear_solver
    assert problem.linear_solver is first
    for name, value, kind in (
        ("linear_solver", "amg", "amg"),
        ("amg_pc_gamg_threshold", 0.05, "amg"),
        ("linear_solver", "direct", "direct"),
        ("ksp_type", "gmres", "direct"),
    ):
        before = problem.linear_solver
        problem.petsc_options[name] = value
        for f in problem.fields:
            f.x.array[:] = 0.0
        forces.append(problem.solve().tables["contact"].force)
        assert problem.linear_solver is not before
        assert problem.linear_solver.name == kind
    kept = problem.linear_solver
    problem.petsc_options["snes_rtol"] = 1e-10
    assert problem.linear_solver is kept
    scale = np.abs(forces[0]).max()
    for force in forces[1:]:
        np.testing.assert_allclose(force, forces[0], atol=1e-7 * scale)
    problem.petsc_options["linear_solver"] = "wrong"
    with pytest.raises(ValueError, match="unknown linear solver 'wrong'"):
        problem.solve()


@pytest.mark.ranks(2)
def test_a_problem_goes_on_after_its_objects_were_freed():
    problem = block(n=4)
    problem.solve()
    problem.destroy()
    assert problem.solve().converged


@pytest.mark.ranks(2)
@pytest.mark.parametrize(("solver", "other"), [("direct", "amg"), ("amg", "direct")])
def test_a_branch_keeps_its_linear_solver_until_it_ends(solver, other):
    """An observer changes the options; the previous solver is freed when the branch has ended."""
    system, _ = moved_block(COMM)
    problem = system.problem
    problem.petsc_options["linear_solver"] = solver
    x = solved_start(system)
    matrices = []

    def change(step):
        if step.index == 1:
            matrices.append(problem.linear_solver.matrix)
            problem.petsc_options["linear_solver"] = other
            assert problem.linear_solver.name == other
        if step.index == 2:
            assert matrices[0].handle

    follow(system, x, 0.0, gamma_range=(0.0, 1.0), max_steps=2, observer=change)
    assert not matrices[0].handle
    assert problem.linear_solver.name == other


def test_log_view_on_the_command_line_of_a_script(tmp_path):
    """PETSc has been initialised by then."""
    script = (
        "import sys, argparse; sys.path.insert(0, sys.argv.pop(1))\n"
        "from support.blocks import block\n"
        "from dolfinx_contact import parse_arguments\n"
        "parse_arguments(argparse.ArgumentParser())\n"
        "block().solve()\n"
    )
    log = tmp_path / "log.txt"
    done = subprocess.run(
        [sys.executable, "-c", script, str(Path(__file__).parents[2]), "-log_view", f":{log}"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "ERROR" not in done.stderr
    assert "ContactSolve" in log.read_text()


SHEARED = {2: (0.03, -0.01), 3: (0.03, 0.0, -0.01)}


def soft_block(stiffness, cell="hex", material=LinearElastic, **given):
    """A sheared block whose moduli are in proportion to a Constant, and that Constant."""
    domain = box(COMM, 4, cell)
    E = fem.Constant(domain, float(stiffness))
    top = SHEARED[domain.geometry.dim]
    law = Coulomb(1.0)
    body = material(0.6 * E, 0.4 * E)
    return block(domain=domain, cell=cell, material=body, top=top, law=law, **given), E


def from_zero(problem):
    for f in problem.fields:
        f.x.array[:] = 0.0
    return problem.solve()


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize(
    ("cell", "material", "solver"),
    [
        ("tri", NeoHookean, "direct"),
        ("tri", LinearElastic, "amg"),
        ("hex", LinearElastic, "direct"),
    ],
)
@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_another_material_takes_the_iterations_of_a_new_problem(cell, material, solver, factor):
    """Iterations agree with a new problem of the new material."""
    options = {"linear_solver": solver, "snes_rtol": 1e-11}
    problem, E = soft_block(1.0, cell, material, options=options)
    problem.solve()
    E.value *= factor
    result = from_zero(problem)
    new, _ = soft_block(factor, cell, material, options=options)
    expected = new.solve()
    assert [a.strategy for a in result.attempts] == ["full steps"]
    assert result.iterations == expected.iterations
    tables = [p.table(p.surfaces[0]) for p in (problem, new)]
    same_tables(*tables)
    assert result.kkt_violation < 1e-9


@pytest.mark.ranks(2, 3)
def test_vectors_and_given_augmentation_stay_with_another_material():
    """The meaning of vectors, and r that is given."""
    problem, E = soft_block(1.0, "tri")
    problem.solve()
    scale = problem.equations.scaling.stiffness
    r = problem.surfaces[0].points.r.copy()
    x = problem.create_vector()
    problem.write(x)
    before = [f.x.array.copy() for f in problem.fields]
    E.value = 11.0
    problem.solve()
    assert problem.equations.scaling.stiffness == pytest.approx(11.0 * scale, rel=1e-12)
    np.testing.assert_allclose(problem.surfaces[0].points.r, 11.0 * r, rtol=1e-12)
    problem.read(x)
    for f, values in zip(problem.fields, before, strict=True):
        np.testing.assert_allclose(f.x.array, values, rtol=1e-12)
    forced, E = soft_block(1.0, "tri", r=3.0)
    E.value = 1e3
    forced.solve()
    assert np.all(forced.surfaces[0].points.r == 3.0)
    assert forced.equations.scaling.stiffness == pytest.approx(1e3 * scale, rel=1e-12)


@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.parametrize("ratio", [0.2, 0.45])
def test_integral_method_follows_another_material(cell, ratio):
    """Its solutions contain r and agree with those of a new problem."""
    domain = box(COMM, 4, cell)
    poisson = fem.Constant(domain, 0.3)
    dim = domain.geometry.dim
    ball = Sphere(np.append(np.full(dim - 1, 0.45), -2.0), 2.0)
    given = {
        "domain": domain,
        "cell": cell,
        "method": "integral",
        "obstacle": ball,
        "law": Coulomb(0.4),
        "material": LinearElastic.from_young(1.0, poisson),
        "top": SHEARED[dim],
    }
    problem = block(**given)
    problem.solve()
    poisson.value = ratio
    from_zero(problem)
    new = block(**given)
    new.solve()
    same_tables(*(p.table(p.surfaces[0]) for p in (problem, new)))


def test_vanishing_own_energy_is_refused():
    """Its moduli are not known to the package, its stiffness is seen."""
    domain = box(COMM, 4, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    E = fem.Constant(domain, 1.0)
    strain = ufl.sym(ufl.grad(u))
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(E * ufl.inner(strain, strain) * ufl.dx, u, [surface])
    E.value = 0.0
    with pytest.raises(ValueError, match="the stiffness of the bulk is zero"):
        problem.solve()
