"""The surface filter with multigrid against MUMPS, on every rank count, law and mesh."""

import gc
import weakref

from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import block, same_tables

from dolfinx import mesh

from dolfinx_contact import (
    ConvergenceError,
    Coulomb,
    Frictionless,
    HalfSpace,
    Sphere,
    Tresca,
)
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.materials import NeoHookean

HYPRE = PETSc.Sys.hasExternalPackage("hypre")

#: With levels on these small meshes too, whose unknowns a factorisation would take else.
AMG = {"linear_solver": "amg", "amg_pc_gamg_coarse_eq_limit": 50}
TIGHT = {**AMG, "snes_rtol": 1e-11, "ksp_rtol": 1e-11}


def corner(domain):
    return mesh.locate_entities_boundary(
        domain, 2, lambda x: np.isclose(x[2], 0.0) & (x[0] < 0.3) & (x[1] < 0.3)
    )


PROBLEMS = {
    "2D": dict(cell="tri", n=8),
    "2D quad, disc": dict(cell="quad", n=8, obstacle=Sphere((0.4, -3.0), 3.0)),
    "tet": dict(cell="tet", n=5),
    "hex": dict(cell="hex", n=5),
    "frictionless": dict(cell="hex", n=4, law=Frictionless()),
    "Tresca": dict(cell="tet", n=4, law=Tresca(3.0)),
    "strong friction": dict(cell="tet", n=4, law=Coulomb(2.0), top=(0.02, 0.005, -0.01)),
    "partial contact": dict(cell="hex", n=6, obstacle=Sphere((0.5, 0.5, -4.0), 4.0)),
    "tilted": dict(cell="tet", n=4, obstacle=HalfSpace((0, 0, 0), (0.02, 0.01, 1.0))),
    "sliding": dict(cell="hex", n=4, law=Coulomb(0.05), top=(0.2, 0.0, -0.01)),
    "no contact": dict(cell="tet", n=4, obstacle=HalfSpace((0, 0, -1.0), (0, 0, 1.0))),
    "one node": dict(
        cell="hex", n=4, obstacle=Sphere((0.5, 0.5, -0.1), 0.1), top=(0.001, 0.0, -0.01)
    ),
    "a rank without contact": dict(cell="hex", n=4, where=corner),
    "P2": dict(cell="tri", n=4, degree=2),
    "P2/P2": dict(cell="quad", n=4, degree=2, multiplier_degree=2),
    "P2 in 3D": dict(cell="tet", n=2, degree=2, top=(0.02, 0.005, -0.01)),
    "mixed": dict(cell="quad", n=6, method="mixed"),
    "neo-Hookean": dict(cell="quad", n=6, material=NeoHookean(600.0, 400.0), top=(0.1, -0.1)),
    "r forced": dict(cell="tet", n=4, r=1e5),
}


CHATTY = (
    *("2D quad, disc", "frictionless", "Tresca", "tilted", "sliding", "no contact"),
    *("P2/P2", "P2 in 3D", "r forced"),
)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.chatty) if n in CHATTY else n for n in PROBLEMS]
)
@pytest.mark.verifies(
    "multigrid",
    reference="independent code: MUMPS for the linear systems",
    aspects=(
        "2D",
        "3D",
        "multigrid",
    ),
)
@pytest.mark.verifies(
    "Coulomb",
    "integral contact",
    reference="itself: factorised",
    aspects=(
        "2D",
        "3D",
        "multigrid",
    ),
)
@pytest.mark.verifies(
    "Tresca",
    "Signorini",
    reference="itself: factorised",
    aspects=(
        "3D",
        "multigrid",
    ),
)
@pytest.mark.verifies(
    "mixed contact",
    "hyperelastic bodies",
    reference="itself: factorised",
    aspects=(
        "2D",
        "multigrid",
    ),
)
def test_multigrid_has_the_solution_of_mumps(name):
    """Tight tolerances give the answer of MUMPS to 1e-8, the defaults to 1e-6."""
    options = PROBLEMS[name]
    direct = block(**options, options={"snes_rtol": 1e-11}).solve()
    for tolerances, accuracy in ((TIGHT, 1e-8), (AMG, 1e-6)):
        problem = block(**options, options=tolerances)
        result = problem.solve()
        assert problem.linear_solver.name == "amg"
        same(result.tables["contact"], direct.tables["contact"], accuracy)
        assert sum(a.krylov_iterations for a in result.attempts) > 0
        problem.destroy()


def same(a, b, accuracy):
    if np.abs(b.force).max() > 0:
        same_tables(a, b, accuracy)
    else:
        assert a.status == b.status
        assert np.abs(a.force).max() < 1e-20  # round-off of nothing, at a stiffness of 1000
        np.testing.assert_allclose(a.un, b.un, rtol=accuracy)


def test_multigrid_solves_contact_of_one_node():
    table = block(**PROBLEMS["one node"], options=AMG).solve().tables["contact"]
    assert table.count("ks") == 1


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name", ["tet", "P2", "neo-Hookean"])
def test_product_is_that_of_the_assembled_jacobian(name):
    problem = block(**PROBLEMS[name], options=AMG)
    problem.solve()
    x, y, z = (problem.create_vector() for _ in range(3))
    x.setRandom()
    state = problem.evaluate()
    assembled = Jacobian(problem.equations)
    problem.linear_solver.update(state)
    problem.linear_solver.matrix.mult(x, y)
    assembled.update(state)
    assembled.matrix.mult(x, z)
    size = z.norm()
    z.axpy(-1.0, y)
    assert z.norm() < 1e-13 * size


@pytest.mark.ranks(2)
def test_multigrid_preconditions_bordered_systems():
    """A bordered system, say, may use operator and preconditioner of H_x as blocks of its own."""
    problem = block(cell="tet", n=5, options=AMG)
    problem.solve()
    solver = problem.linear_solver
    solver.update(problem.evaluate())
    r, z, v = (problem.create_vector() for _ in range(3))
    r.setRandom()
    size = r.norm()
    for _ in range(60):  # a Richardson iteration contracts
        solver.apply(r, z)
        solver.matrix.mult(z, v)
        r.axpy(-1.0, v)
    assert r.norm() < 1e-3 * size


without_hypre = pytest.mark.skipif(not HYPRE, reason="PETSc without hypre")


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "options",
    [
        {"surface_condensed": 0},
        pytest.param({"amg_pc_type": "hypre"}, marks=without_hypre),
    ],
    ids=str,
)
def test_multigrid_takes_options(options):
    database = PETSc.Options()
    for key, value in options.items():
        database[f"contact_{key}"] = value
    result = block(cell="tet", n=5, options=TIGHT).solve()
    direct = block(cell="tet", n=5).solve()
    same(result.tables["contact"], direct.tables["contact"], 1e-8)
    assert len(result.attempts) == 1


@pytest.mark.ranks(2)
def test_solver_is_chosen_by_size():
    """The size decides unless the user chooses; options of a KSP select the assembled Jacobian."""
    assert block(cell="tri", n=4).linear_solver.name == "direct"
    assert block(cell="tri", n=4, options=AMG).linear_solver.name == "amg"
    own = block(cell="tri", n=4, options={"ksp_type": "gmres", "pc_type": "lu"})
    assert own.linear_solver.name == "direct"
    assert len(own.solve().attempts) == 1
    with pytest.raises(ValueError, match="unknown linear solver 'magic'"):
        _ = block(cell="tri", n=4, options={"linear_solver": "magic"}).linear_solver
    PETSc.Options()["contact_linear_solver"] = "direct"
    assert block(cell="tri", n=4, options=AMG).linear_solver.name == "direct"


def test_stagnation_says_what_to_try():
    options = {**AMG, "ksp_rtol": 1e-12, "ksp_max_it": 1, "snes_max_it": 3}
    PETSc.Options()["continuation_ksp_max_it"] = 1  # load following would help
    problem = block(cell="tet", n=4, options=options)
    with pytest.raises(ConvergenceError, match="stagnated after"):
        problem.solve(increments=1)
    assert np.abs(problem.u.x.array).max(initial=0.0) == 0.0


@pytest.mark.ranks(2)
@pytest.mark.parametrize("solver", ["amg", "direct"])
def test_a_problem_is_freed_with_its_last_reference(solver):
    """Also matrices of type python, whose contexts Python's garbage collector does not see."""
    problem = block(n=4, cell="tet", options={"linear_solver": solver})
    problem.solve()
    assert problem.linear_solver.name == solver
    parts = problem.equations, problem.linear_solver, problem.equations.bulk
    left = [weakref.ref(part) for part in parts]
    del problem, parts
    gc.collect()
    assert [r() for r in left] == [None] * 3
