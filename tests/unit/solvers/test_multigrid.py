"""The surface filter with multigrid against MUMPS, on every rank count, law and mesh."""

import gc
import logging
import resource
import weakref
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import block, box, same_tables

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    ConvergenceError,
    Coulomb,
    Frictionless,
    HalfSpace,
    Sphere,
    Tresca,
    solve_nested,
)
from dolfinx_contact._forcing import Forcing
from dolfinx_contact._petsc import has_package
from dolfinx_contact.body.bulk import Bulk
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.equations.scaling import softness
from dolfinx_contact.laws.status import OPEN
from dolfinx_contact.materials import LinearElastic, NeoHookean
from dolfinx_contact.solvers import choice, hierarchy, multigrid
from dolfinx_contact.solvers.hierarchy import PLAIN, SMOOTHED
from dolfinx_contact.solvers.multigrid import Multigrid

COMM = MPI.COMM_WORLD
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
def test_same_as_direct(name):
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


def test_contact_of_one_node():
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


@pytest.mark.parametrize("cell", ["quad", "tet", "hex"])
def test_products_with_half_of_a_symmetric_stiffness(cell):
    """Where it stays; in the cycle as well."""
    problem = block(cell=cell, n=8, options=AMG)
    problem.solve()
    bulk = problem.equations.bulk
    x, y = bulk.stiffness(problem.u.x.array).createVecs()
    x.setRandom()
    assert "sbaij" in bulk.for_products.getType()
    bulk.for_products.mult(x, y)
    size = y.norm()
    y.axpy(-1.0, bulk.stiffness(problem.u.x.array) * x)
    assert y.norm() < 1e-14 * size
    solver = problem.linear_solver
    cycle = solver.hierarchy.pc
    finest = cycle.getMGSmoother(cycle.getMGLevels() - 1).getOperators()[0]
    assert finest.getType() == "python"
    glued = bulk.stiffness(problem.u.x.array).copy()
    held = np.union1d(solver.operator.fixed, np.flatnonzero(solver._glued.held))
    held = (held + glued.getOwnershipRange()[0]).astype(np.int32)
    glued.zeroRowsColumns(held, diag=problem.equations.stiffness_scale)
    finest.mult(x, y)
    y.axpy(-1.0, glued * x)
    assert y.norm() < 1e-14 * size
    expected = glued.getDiagonal()
    expected.axpy(-1.0, finest.getDiagonal())
    assert expected.norm() == 0.0
    other = block(**PROBLEMS["neo-Hookean"])
    curved = other.equations.bulk
    assert curved.stiffness(other.u.x.array) == curved.for_products


@pytest.mark.ranks(2, 3)
def test_filter_leaves_nothing_on_the_surface():
    """After an application the residual vanishes on contact nodes and multipliers."""
    problem = block(cell="hex", n=4, options=AMG)
    problem.solve()
    solver = problem.linear_solver
    solver.update(problem.evaluate())
    r, z, rest = (problem.create_vector() for _ in range(3))
    r.setRandom()
    solver.filter.apply(None, r, z)
    solver.matrix.mult(z, rest)
    rest.aypx(-1.0, r)
    on_surface = np.abs(rest.array_r[solver.filter.surface.local]).max(initial=0.0)
    assert COMM.allreduce(on_surface, op=max) < 1e-10 * z.norm() * problem.equations.stiffness_scale
    assert rest.norm() < 10 * r.norm()


@pytest.mark.ranks(2)
def test_correction_solves_the_rows_of_the_surface():
    """With the status held and slips nearly straight, one correction leaves nothing there."""
    problem = block(cell="hex", n=4, options=AMG)
    problem.solve()
    solver = problem.linear_solver
    s = problem.linear_solver.filter.surface
    x, noise, b, d = (problem.create_vector() for _ in range(4))
    problem.write(x)
    noise.setRandom()
    x.axpy(1e-8, noise)
    state = problem.residual(x, b)
    before = COMM.allreduce(np.sum(b.array_r[s.local] ** 2))
    assert solver.correct(state, b, d)
    x.axpy(-1.0, d)
    state = problem.residual(x, b, state.statuses)
    assert COMM.allreduce(np.sum(b.array_r[s.local] ** 2)) < 1e-6 * before
    elsewhere = np.setdiff1d(np.arange(d.getLocalSize()), s.local)
    assert not d.array_r[elsewhere].any()
    assert not solver.correct(state, b, d)  # nothing is left to correct


@pytest.mark.long
def test_corrections_save_steps(monkeypatch):
    """Points at the edge of the contact settle their status without a step of the body for each."""
    options = dict(cell="tet", n=16, options={**AMG, "snes_rtol": 1e-8}, top=(0.004, 0.0, -0.02))
    ball = Sphere((0.5, 0.5, -10.0), 10.0)
    steps = []
    for _ in range(2):
        problems = block(**options), block(**options, obstacle=ball)
        steps.append(sum(problem.solve().iterations for problem in problems))
        monkeypatch.setattr(Multigrid, "correct", lambda *_: False)
    assert steps[0] < steps[1]


@pytest.mark.parametrize(("cell", "dim"), [("quad", 2), ("tet", 3)])
@pytest.mark.parametrize("poisson", [0.3, 0.499])
def test_softness_is_that_of_the_moduli(cell, dim, poisson):
    domain = box(COMM, 3, cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    energy = LinearElastic.from_young(7.0, poisson).energy(u) * ufl.dx
    lmbda = 2 * poisson / (1 - 2 * poisson)  # over mu
    expected = 2 / (2 + 2 * lmbda / (dim + 1))
    assert softness(Bulk(energy, u).stiffness(u.x.array), V) == pytest.approx(expected)


@pytest.mark.ranks(2)
def test_preconditioner_for_other_systems():
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


without_hypre = pytest.mark.skipif(not has_package("hypre"), reason="PETSc without hypre")


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "options",
    [
        {"surface_condensed": 0},
        pytest.param({"amg_pc_type": "hypre"}, marks=without_hypre),
    ],
    ids=str,
)
def test_options(options):
    database = PETSc.Options()
    for key, value in options.items():
        database[f"contact_{key}"] = value
    result = block(cell="tet", n=5, options=TIGHT).solve()
    direct = block(cell="tet", n=5).solve()
    same(result.tables["contact"], direct.tables["contact"], 1e-8)
    assert len(result.attempts) == 1


@pytest.mark.parametrize("options", [{}, AMG], ids=["direct", "amg"])
def test_prediction(caplog, options):
    """What a solve will take is said before it; the text alone is tested."""
    with caplog.at_level(logging.INFO):
        solver = block(cell="tet", n=5, options=options).linear_solver
    assert 0 < solver.predicted_seconds() < 60
    if COMM.rank == 0:
        assert f"linear solver {solver.name}: about" in caplog.text
        assert "s from a cold start" in caplog.text


@pytest.mark.ranks(2)
def test_choice():
    """By size, unless the user says which; options of a KSP mean the assembled Jacobian."""
    assert block(cell="tri", n=4).linear_solver.name == "direct"
    assert block(cell="tri", n=4, options=AMG).linear_solver.name == "amg"
    own = block(cell="tri", n=4, options={"ksp_type": "gmres", "pc_type": "lu"})
    assert own.linear_solver.name == "direct"
    assert len(own.solve().attempts) == 1
    with pytest.raises(ValueError, match="unknown linear solver 'magic'"):
        _ = block(cell="tri", n=4, options={"linear_solver": "magic"}).linear_solver
    PETSc.Options()["contact_linear_solver"] = "direct"
    assert block(cell="tri", n=4, options=AMG).linear_solver.name == "direct"


@pytest.mark.ranks(2)
def test_a_direct_solver_takes_over(monkeypatch, caplog):
    """Where multigrid stagnates and nobody asked for it; unless memory is short."""
    monkeypatch.setattr(choice, "_LARGEST_DIRECT", {3: 10})
    options = {"ksp_rtol": 1e-12, "ksp_max_it": 2}
    direct = block(cell="tet", n=4, options={"linear_solver": "direct"}).solve()
    problem = block(cell="tet", n=4, options=options)
    assert problem.linear_solver.name == "amg"
    result = problem.solve()
    assert problem.linear_solver.name == "direct"
    assert result.reason == "full steps"
    same(result.tables["contact"], direct.tables["contact"], 1e-8)
    assert COMM.rank > 0 or "the direct solver takes over" in caplog.text

    assert choice.available_gigabytes(COMM) > 0
    monkeypatch.setattr(choice, "available_gigabytes", lambda _: 0.0)
    problem = block(cell="tet", n=4, options={**options, "snes_max_it": 2})
    with pytest.raises(ConvergenceError, match="stagnated"):
        problem.solve()
    assert problem.linear_solver.name == "amg"


@pytest.mark.ranks(2)
def test_without_hypre(monkeypatch):
    """It is not proposed, and who asks for it is told."""
    for module in (hierarchy, multigrid):
        monkeypatch.setattr(module, "has_package", lambda name: name != "hypre")
    options = {**AMG, "ksp_rtol": 1e-12, "ksp_max_it": 1, "snes_max_it": 3}
    PETSc.Options()["continuation_ksp_max_it"] = 1
    with pytest.raises(ConvergenceError, match="try -contact_ksp_max_it"):
        block(cell="tet", n=4, options=options).solve(increments=1)
    PETSc.Options()["contact_amg_pc_type"] = "hypre"
    said = "built without hypre: -contact_amg_pc_type gamg, the default"
    with pytest.raises(ValueError, match=said):
        block(cell="tet", n=4, options=AMG).solve()


def test_stagnation_says_what_to_try():
    options = {**AMG, "ksp_rtol": 1e-12, "ksp_max_it": 1, "snes_max_it": 3}
    PETSc.Options()["continuation_ksp_max_it"] = 1  # load following would help
    problem = block(cell="tet", n=4, options=options)
    with pytest.raises(ConvergenceError, match="stagnated after"):
        problem.solve(increments=1)
    assert np.abs(problem.u.x.array).max(initial=0.0) == 0.0


@pytest.mark.ranks(2)
def test_hierarchy_is_kept():
    """Other data, the same hierarchy; another stiffness, another hierarchy."""
    domain = box(COMM, 5, "tet")
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V)
    young = fem.Constant(domain, 1000.0)
    motion = fem.Constant(domain, np.array([0.004, 0.0, -0.01]))
    held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[2], 1.0))
    bottom = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(0.3))
    energy = young * LinearElastic.from_young(1.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(
        energy, u, [surface], bcs=[fem.dirichletbc(motion, held, V)], petsc_options=AMG
    )
    assert problem.equations.bulk.linear
    first = problem.solve().resultants["contact"]
    motion.value[:] *= 1.1
    np.testing.assert_allclose(problem.solve().resultants["contact"], 1.1 * first, rtol=1e-6)
    assert problem.linear_solver.builds == 1
    assert problem.equations.bulk.assemblies == 1
    young.value *= 2.0
    np.testing.assert_allclose(problem.solve().resultants["contact"], 2.2 * first, rtol=1e-6)
    assert problem.linear_solver.builds == 2
    assert problem.equations.bulk.assemblies == 2


@pytest.mark.ranks(2)
def test_an_aged_hierarchy_is_rebuilt():
    """Once it has cost more than another one, and only where that would be another one."""
    PETSc.Options()["contact_amg_pc_gamg_agg_nsmooths"] = 0
    problem = block(cell="tet", n=5, options=AMG)
    first = problem.solve().history[0]
    solver = problem.linear_solver
    before = solver.builds
    state = problem.evaluate()
    solver.build(state)
    solver.age(7, 2.0)  # when it is new
    solver.age(1000, 2.0)
    solver.update(state)
    assert solver.builds == before + 1  # the same nodes are closed
    x = problem.create_vector()
    problem.write(x)
    half = state.statuses[0].copy()
    half[: len(half) // 2] = OPEN
    solver.age(1, 2.0)  # it has aged before
    ksp = PETSc.KSP().create(COMM)
    many = replace(first, iteration=1, flips=solver._points, krylov=1)
    solver.prepare(ksp, many, 1e-10, state, warm=False)
    ksp.destroy()
    solver.update(problem.equations.contact(x, [half]))
    assert solver.builds == before + 1  # many points change
    solver.update(problem.equations.contact(x, [half]))
    assert solver.builds == before + 2
    solver.age(10, 2.0)
    solver.update(state)
    assert solver.builds == before + 2  # not yet worth it
    solver.build(problem.equations.contact(x, [half]))
    for _ in range(9):
        solver.age(100, 2.0)
        solver.update(state)
    assert solver.builds == before + 3  # a new one takes as many


@pytest.mark.parametrize("given", [False, True])
def test_aggregates_are_smoothed_once_plain_ones_have_cost_more(given):
    """By the sum over solves, though the same nodes are closed; the user's option stays."""
    if given:
        PETSc.Options()["contact_amg_pc_gamg_agg_nsmooths"] = 0
    problem = block(cell="tet", n=5, options=AMG)
    problem.solve()
    solver = problem.linear_solver
    assert solver.hierarchy.interpolation is PLAIN
    state = problem.evaluate()
    solver.build(state)
    for _ in range(3):
        solver.age(25, 2.0)
        solver.update(state)
    before = solver.builds
    solver.age(25, 2.0)
    solver.update(state)
    smoothed = solver.hierarchy.interpolation is SMOOTHED
    assert smoothed == (not given)
    assert solver.builds == before + smoothed
    solver.age(1000, 2.0)
    solver.update(state)
    assert solver.builds == before + smoothed


def test_w_cycles_hardly_grow_with_the_mesh():
    """Iterations of conjugate gradients with plain aggregates, from 8 to 16 cells an edge."""

    def iterations(n, cycle):
        problem = block(cell="tet", n=n, options={**AMG, "amg_pc_mg_cycle_type": cycle})
        problem.solve()
        pc = problem.linear_solver.hierarchy.pc
        A, P = pc.getOperators()
        x, b = A.createVecs()
        b.array[:] = np.random.default_rng(A.comm.rank).standard_normal(b.getLocalSize())
        ksp = PETSc.KSP().create(A.comm)
        ksp.setType("cg")
        ksp.setOperators(A, P)
        ksp.setPC(pc)
        ksp.setTolerances(rtol=1e-8, max_it=100)
        ksp.solve(b, x)
        taken = ksp.getIterationNumber()
        for thing in (x, b, ksp):
            thing.destroy()
        return taken

    assert PLAIN.options["pc_mg_cycle_type"] == "w"
    grown = {cycle: iterations(16, cycle) - iterations(8, cycle) for cycle in "vw"}
    assert grown["w"] < grown["v"], grown


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "options",
    [
        {"mg_levels_ksp_type": "richardson", "mg_levels_pc_type": "sor"},
        {"mg_levels_pc_type": "pbjacobi"},
        {"mg_levels_pc_type": "bjacobi"},
        {"pc_mg_type": "full"},
        {"mg_levels_ksp_max_it": 1, "pc_use_amat": False},
    ],
    ids=lambda options: "-".join(map(str, options.values())),
)
def test_smoothers_of_the_user(options):
    """Some need the matrix of the finest level, which those of ours do not keep."""
    reference = block(cell="hex", n=7).solve()
    given = {f"amg_{name}": value for name, value in options.items()}
    problem = block(cell="hex", n=7, options={**AMG, **given})
    result = problem.solve()
    assert problem.linear_solver.name == "amg"
    assert [a.strategy for a in result.attempts] == ["full steps"]
    same_tables(result.tables["contact"], reference.tables["contact"])


@pytest.mark.parametrize(
    ("dim", "poisson", "kind"), [(2, 0.3, "SMOOTHED"), (3, 0.3, "PLAIN"), (3, 0.49, "SMOOTHED")]
)
def test_which_aggregates(dim, poisson, kind):
    """In the plane they are cheap to smooth; a body that hardly changes its volume needs it."""
    cell = "tri" if dim == 2 else "tet"
    problem = block(cell=cell, n=4, poisson=poisson, options=AMG)
    expected = {"PLAIN": PLAIN, "SMOOTHED": SMOOTHED}[kind]
    assert problem.linear_solver.hierarchy.interpolation is expected


def test_log():
    """What -log_view shows: the parts of a solve by name, in a stage of its own."""
    PETSc.Log.begin()
    problem = block(cell="tet", n=5, options=AMG)
    problem.solve()
    stages = {PETSc.Log.Stage(name).id for name in ("ContactSetUp", "ContactSolve")}
    assert len(stages) == 2
    for part in ("Residual", "Jacobian", "Status", "SurfaceLU", "Surface", "AMGSetUp", "Krylov"):
        stage = PETSc.Log.Stage("ContactSolve").id
        assert PETSc.Log.Event(f"Contact{part}").getPerfInfo(stage)["count"] > 0, part


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name", ["tet", "P2", "P2/P2", "mixed", "neo-Hookean"])
@pytest.mark.verifies(
    "nested iteration",
    reference="itself: the fine mesh alone",
    aspects=(
        "2D",
        "3D",
        "multigrid",
    ),
)
@pytest.mark.verifies(
    "mixed contact",
    "hyperelastic bodies",
    reference="itself: the fine mesh alone",
    aspects=(
        "2D",
        "multigrid",
    ),
)
def test_nested_iteration(name):
    """From the solution on a coarser mesh, not nested: the same solution in no more steps."""
    options = dict(PROBLEMS[name])
    n = options.pop("n")
    levels = [block(**options, n=k, options=AMG) for k in (n, n + 3)]
    coarse, fine = solve_nested(levels)
    alone = block(**options, n=n + 3).solve()
    same(fine.tables["contact"], alone.tables["contact"], 1e-6)
    assert fine.iterations <= alone.iterations
    assert coarse.dofs < fine.dofs


@pytest.mark.ranks(2)
def test_nested_problems_must_agree():
    levels = block(cell="quad", n=4), block(cell="quad", n=4, method="mixed")
    with pytest.raises(ValueError, match="the same surfaces"):
        solve_nested(levels)


@pytest.mark.ranks(2)
def test_forcing():
    forcing = Forcing()
    forcing.restart(warm=False)
    assert forcing.tolerance(1.0, 1e-10, 1.0) == forcing.first
    assert forcing.tolerance(0.5, 1e-10, 0.5) == forcing.largest  # statuses change
    assert forcing.tolerance(5e-3, 1e-10, 0.0) == pytest.approx(0.9e-4)
    assert forcing.tolerance(5e-10, 1e-10, 0.0) == pytest.approx(0.06)  # no further than needed
    assert forcing.tighten()
    assert forcing.tolerance(0.5, 1e-10, 1.0) < forcing.largest / 10
    forcing.restart(warm=True)
    assert forcing.tolerance(1.0, 1e-10, 1.0) == forcing.warm


def test_a_solve_ends_where_its_model_does():
    """A linear residual below what the linear model misses is not worth reducing."""
    forcing = Forcing(looks=0.3)
    forcing.restart(warm=False)
    assert not forcing.is_due(1e-9)  # a tolerance of the user's own holds
    forcing.tolerance(1.0, 1e-10, 1.0)
    assert [forcing.is_due(r) for r in (0.31, 0.29)] == [False, True]
    assert not forcing.suffices(0.29, 1e-2)
    assert [forcing.is_due(r) for r in (1.1e-2, 0.9e-2)] == [False, True]
    assert forcing.suffices(0.9e-2, 1e-2)
    assert not forcing.suffices(0.1, 0.09)
    assert [forcing.is_due(r) for r in (0.05, 0.03)] == [False, True]  # not at once again
    assert forcing.tighten()
    forcing.tolerance(0.5, 1e-10, 1.0)
    assert not forcing.is_due(1e-9)  # statuses cycled, perhaps since solves ended too early
    forcing.restart(warm=True)
    forcing.tolerance(1.0, 1e-10, 1.0)
    assert forcing.is_due(0.1)


@pytest.mark.ranks(2)
def test_contact_rows_are_those_of_the_residual():
    """What a model misses is looked up in the rows of the multipliers, without the body."""
    problem = block(cell="tet", n=4)
    eq = problem.equations
    x, b = eq.create_vector(), eq.create_vector()
    problem.solve()
    problem.write(x)
    free = np.concatenate([~eq.fixed[: eq.owned_sizes[0]], np.ones(sum(eq.owned_sizes[1:]), bool)])
    x.array[free] += 1e-3 * np.random.default_rng(3).standard_normal(int(free.sum()))
    eq.residual(x, b)
    rows = b.array_r[eq.owned_sizes[0] :]
    here = int(np.abs(rows).max(initial=0.0) > 0)
    assert eq.comm.allreduce(here)
    found = eq.contact_rows(x)
    assert len(found) == len(rows)
    np.testing.assert_allclose(found, rows, rtol=0, atol=1e-14 * eq.stiffness_scale)


def test_a_start_far_off_is_no_divergence(monkeypatch):
    """An application may be 1e5 too large: the solve that begins with it goes on from there."""
    apply = multigrid.SurfaceFilter.apply

    def too_large(self, pc, r, z):
        apply(self, pc, r, z)
        z.scale(1e5)

    monkeypatch.setattr(multigrid.SurfaceFilter, "apply", too_large)
    problem = block(cell="tet", n=4, options=AMG)
    assert problem.solve().reason == "full steps"
    assert problem.linear_solver.name == "amg"


def test_solves_that_end_with_their_model_save_iterations():
    """The same solution in fewer iterations, where the statuses of many points change."""
    found = []
    for looks in (0.0, Forcing().looks):
        problem = block(cell="tet", n=8, options=AMG)
        problem.linear_solver.forcing = Forcing(looks=looks)
        found.append(problem.solve())
    before, after = found
    same(before.tables["contact"], after.tables["contact"], 1e-6)
    krylov = [sum(a.krylov_iterations for a in r.attempts) for r in found]
    assert krylov[1] < krylov[0], krylov
    assert after.iterations <= before.iterations + 1


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


@pytest.mark.long
def test_many_problems_on_one_mesh():
    """Matrices of problems that are gone are freed on every rank, without `destroy`."""
    domain = box(COMM, 6, "tet")
    sizes = []
    for _ in range(12):
        block(domain=domain, cell="tet", options=AMG).solve()
        gc.collect()
        sizes.append(int(Path("/proc/self/statm").read_text().split()[1]))
    matrix = 3 * 8 * 7**3 * 15 * 3 / resource.getpagesize()  # of the stiffness, in pages, or less
    grown = COMM.allreduce(sizes[-1] - sizes[5])
    assert grown < 6 * matrix
