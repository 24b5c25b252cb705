"""The first step from a body that touches nothing."""

import gc
import subprocess
import sys
import weakref
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import block, box

from dolfinx_contact import ConvergenceError

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


@pytest.mark.parametrize("linear_solver", ["direct", "amg"])
def test_what_the_solver_shows(linear_solver):
    """It is one object: before a solve how Newton's method is set, after it how it ended."""
    options = {"linear_solver": linear_solver, "snes_rtol": 1e-9, "snes_max_it": 30}
    problem = block(cell="tet", n=4, options=options)
    solver = problem.solver
    assert solver.getOptionsPrefix() == "contact_"
    assert solver.getTolerances() == (1e-9, 0.0, 0.0, 30)
    assert solver.getConvergedReason() == 0
    assert solver.getIterationNumber() == 0
    result = problem.solve()
    assert result.reason == "full steps"
    assert problem.solver is solver
    assert solver.getConvergedReason() == PETSc.SNES.ConvergedReason.CONVERGED_FNORM_RELATIVE
    assert solver.getIterationNumber() == result.iterations > 1
    assert solver.getFunctionNorm() < 1e-6
    assert solver.ksp.getConvergedReason() > 0
    assert solver.ksp.getIterationNumber() == result.history[-1].krylov
    assert solver.ksp.getType() == ("preonly" if linear_solver == "direct" else "fgmres")
    assert solver.ksp.pc.getType() == ("lu" if linear_solver == "direct" else "python")
    solver.setTolerances(rtol=0.5, max_it=1)  # changes no solve
    solver.setType("newtontr")
    problem.u.x.array[:] = 0.0
    problem.surfaces[0].multiplier.x.array[:] = 0.0
    again = problem.solve()
    assert again.iterations == result.iterations
    assert solver.getTolerances() == (1e-9, 0.0, 0.0, 30)
    assert solver.getType() == "newtonls"


def test_the_solver_shows_how_a_solve_failed():
    problem = block(options={"snes_max_it": 0})
    with pytest.raises(ConvergenceError):
        problem.solve()
    assert problem.solver.getConvergedReason() == PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT
    assert problem.solver.getIterationNumber() == 0
    problem.petsc_options["snes_max_it"] = 20
    result = problem.solve()
    assert problem.solver.getConvergedReason() > 0
    assert problem.solver.getTolerances()[3] == 20
    assert problem.solver.getIterationNumber() == result.iterations


def test_another_linear_solver_between_two_solves():
    """It is made anew when its options change, and kept while they do not."""
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
    assert problem.solver.ksp.getType() == "gmres"
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
def test_the_solver_keeps_no_factorisation():
    """What is looked at has neither matrices nor vectors, and does not keep the problem."""
    problem = block(n=4)
    problem.solve()
    solver = problem.solver
    assert not solver.getJacobian()[0]
    assert not solver.getSolution()
    equations = weakref.ref(problem.equations)
    del problem
    gc.collect()
    assert equations() is None
    assert solver.getConvergedReason() > 0


@pytest.mark.ranks(2)
def test_a_problem_goes_on_after_its_objects_were_freed():
    problem = block(n=4)
    problem.solve()
    solver = problem.solver
    problem.destroy()
    problem.solve()
    assert problem.solver is solver
    assert solver.getConvergedReason() > 0


@pytest.mark.skipif(COMM.size > 1, reason="starts a process of its own")
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
