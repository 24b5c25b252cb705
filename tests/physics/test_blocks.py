"""Solved problems against independent codes, closed forms, and themselves on other ranks."""

import csv
import json
from pathlib import Path

from mpi4py import MPI

import cases.block
import numpy as np
import pytest
from support.blocks import CELLS, KINDS, block, box, facets, same_tables
from support.own_laws import Orthotropic, SlipWeakening

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    LevelSet,
    Sphere,
    Tresca,
)
from dolfinx_contact.algorithms import InteriorPoint, Lemke, ProjectedGradient, Uzawa
from dolfinx_contact.materials import LinearElastic, NeoHookean

COMM = MPI.COMM_WORLD
ORACLE = json.loads((Path(__file__).parents[1] / "data" / "blocks.json").read_text())
CASES = [k for k in ORACLE if k != "source"]


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("case", CASES)
@pytest.mark.verifies(
    "Coulomb",
    "Newton's method",
    "planes",
    "nodal contact",
    reference="independent code: GetFEM, every nodal force",
    aspects=(
        "2D",
        "3D",
        "multigrid",
    ),
)
def test_block_has_the_forces_of_the_oracle(case, accuracy, folder):
    oracle = ORACLE[case]
    dim = oracle["dim"]
    options = {
        "dim": dim,
        "n": oracle["n"],
        "friction": oracle["F"],
        "young": oracle["E"],
        "poisson": oracle["nu"],
        "shift": oracle["top"][0],
        "press": -oracle["top"][-1],
        "output": folder,
    }
    summary = cases.block.main([f"--{k}={v}" for k, v in options.items()])
    with open(folder / "contact.csv") as file:
        rows = list(csv.DictReader(file))
    x = np.array(oracle["x"])
    order = np.lexsort(np.round(x, 9).T[::-1])
    rn = -np.array(oracle["ln"])[order]
    rt = np.array(oracle["lt"])[order]
    mine = np.array([[float(row[k]) for k in ("x", "y", "rn", "rt_x", "rt_y")] for row in rows])
    np.testing.assert_allclose(mine[:, : dim - 1], x[order], atol=1e-12)
    assert np.abs(mine[:, 2] - rn).max() < accuracy * rn.max()
    assert np.abs(mine[:, 3 : 2 + dim] - rt).max() < accuracy * rn.max()
    assert summary["kkt_violation"] < 1e-9
    assert summary["strategy"] == "full steps"
    assert summary["newton_iterations"] <= 9
    np.testing.assert_allclose(summary["sum_rn"], rn.sum(), rtol=0.1 * accuracy)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("dim", "cell"), KINDS)
@pytest.mark.verifies(
    "Signorini",
    "planes",
    reference="closed form: uniform pressure",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_a_uniform_pressure_on_a_distorted_mesh_is_exact(dim, cell, degree):
    """Uniform pressure E d / height for nu = 0, to round-off on a distorted mesh."""
    domain = box(COMM, 3, cell)
    x = domain.geometry.x
    inside = np.ones(len(x), dtype=bool)
    for axis in range(dim):
        inside &= (x[:, axis] > 1e-9) & (x[:, axis] < 1 - 1e-9)
    shift = 0.05 * np.sin(9 * x[inside][:, ::-1] + np.arange(3))
    x[inside, :dim] += shift[:, :dim]
    top = (*[0.0] * (dim - 1), -0.05)
    problem = block(
        domain=domain, law=Frictionless(), top=top, young=2e6, poisson=0.0, degree=degree
    )
    table = problem.solve().tables["contact"]
    np.testing.assert_allclose(table.pressure, 1e5, rtol=1e-12)
    np.testing.assert_allclose(table.rn.sum(), 1e5, rtol=1e-12)
    assert np.abs(table.un).max() < 1e-12 * 0.05


PROBLEMS = {
    "2D tri": dict(cell="tri", n=6),
    "2D quad, disc": dict(cell="quad", n=6, obstacle=Sphere((0.4, -3.0), 3.0)),
    "2D P2": dict(cell="tri", n=4, degree=2),
    "2D mixed": dict(cell="quad", n=6, method="mixed"),
    "3D mixed": dict(cell="tet", n=4, method="mixed"),
    "3D mixed, sphere": dict(
        cell="hex", n=4, method="mixed", obstacle=Sphere((0.5, 0.5, -5.0), 5.0), law=Coulomb(0.8)
    ),
    "3D, a law of one's own": dict(cell="hex", n=4, law=Orthotropic(0.1, 0.4, 0.7)),
    "2D, a law of one's own": dict(cell="tri", n=6, law=SlipWeakening(0.4, 0.2, 0.01)),
    "3D tet, tilted": dict(cell="tet", n=4, obstacle=HalfSpace((0, 0, 0), (0.02, 0.01, 1.0))),
    "3D hex": dict(cell="hex", n=4, law=Coulomb(1.0), top=(0.02, 0.005, -0.01)),
    "3D hex P2": dict(cell="hex", n=2, degree=2, top=(0.02, 0.005, -0.01)),
    "a rank without contact": dict(
        cell="hex",
        n=4,
        where=lambda d: mesh.locate_entities_boundary(
            d, 2, lambda x: np.isclose(x[2], 0.0) & (x[0] < 0.3) & (x[1] < 0.3)
        ),
    ),
}


@pytest.mark.ranks(2, 3)
@pytest.mark.skipif(COMM.size == 1, reason="one rank and all ranks are the same")
@pytest.mark.parametrize("ghosts", list(mesh.GhostMode)[:2], ids=str)
@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.verifies(
    "Coulomb",
    "Newton's method",
    reference="itself: the solve on one rank",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_block_does_not_depend_on_ranks_and_ghosts(name, ghosts):
    options = dict(PROBLEMS[name])
    domain = box(COMM, options["n"], options["cell"], ghost_mode=ghosts)
    result = block(**options, domain=domain).solve()
    alone = block(MPI.COMM_SELF, **options).solve()
    same_tables(result.tables["contact"], alone.tables["contact"])
    assert result.iterations == alone.iterations
    np.testing.assert_allclose(result.energies["bulk"], alone.energies["bulk"], rtol=1e-9)
    work = [r.energies["friction"] for r in (result, alone)]
    np.testing.assert_allclose(*work, rtol=1e-8, atol=1e-12 * alone.energies["bulk"])
    if options.get("degree", 1) == 1:
        assert result.kkt_violation < 1e-9


@pytest.mark.parametrize("units", [(1e3, 1e-6), (1e-3, 1e9)])
@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.verifies(
    "units",
    "Coulomb",
    reference="itself: other units",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_a_block_in_other_units_has_the_same_iterates(cell, units):
    length, stress = units
    dim = 2 if cell == "tri" else 3
    domain = box(COMM, 4, cell, size=length)
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    top = length * np.array((0.004, *[0.0] * (dim - 2), -0.01))
    held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[dim - 1], length))
    bottom = mesh.locate_entities_boundary(
        domain, dim - 1, lambda x: np.isclose(x[dim - 1], 0.0, atol=1e-9 * length)
    )
    surface = ContactSurface(
        u, bottom, obstacle=HalfSpace(np.zeros(dim), np.eye(dim)[-1]), law=Coulomb(0.3)
    )
    material = LinearElastic.from_young(1000.0 * stress, 0.3)
    bcs = [fem.dirichletbc(top, held, V)]
    scaled = ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=bcs).solve()
    plain = block(cell=cell, n=4).solve()
    a = scaled.tables["contact"]
    b = plain.tables["contact"]
    force = stress * length ** (dim - 1)
    assert np.abs(a.force / force - b.force).max() < 1e-9 * np.abs(b.force).max()
    assert np.abs(a.ut / length - b.ut).max() < 1e-9 * np.abs(b.ut).max()
    mine, other = ([s.measures.worst for s in r.history] for r in (scaled, plain))
    assert len(mine) == len(other)
    np.testing.assert_allclose(mine, other, atol=1e-8)


@pytest.mark.verifies(
    "Tresca",
    "Coulomb",
    reference="theorem: with the bound of Coulomb's solution Tresca's law has it as well",
    aspects=("2D",),
)
def test_tresca_with_the_bound_of_coulomb_has_its_solution():
    domain = box(COMM, 8, "quad")
    coulomb = block(domain=domain).solve().tables["contact"]
    bound = 0.3 * interpolated(domain, coulomb)
    tresca = block(domain=domain, law=Tresca(bound)).solve().tables["contact"]
    same_tables(tresca, coulomb)
    assert coulomb.count("k") > 0
    assert coulomb.count("+-") > 0


def interpolated(domain, table):
    """A field on the body whose trace is the pressure of ``table``."""
    f = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    f.interpolate(lambda x: np.interp(x[0], table.x[:, 0], table.pressure))
    return f


@pytest.mark.ranks(2)
def test_friction_may_be_number_constant_or_field():
    domain = box(COMM, 6, "tri")
    field = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
    field.x.array[:] = 0.3
    tables = [
        block(domain=domain, law=Coulomb(f)).solve().tables["contact"]
        for f in (0.3, fem.Constant(domain, 0.3), field)
    ]
    same_tables(tables[0], tables[1])
    same_tables(tables[0], tables[2])


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "level sets", "spheres", reference="itself: the obstacle in the other way", aspects=("3D",)
)
def test_a_level_set_has_the_solution_of_its_sphere():
    centre = (0.5, 0.5, -4.0)
    radius = 4.0
    level = LevelSet(lambda x: sum((x[i] - centre[i]) ** 2 for i in range(3)) ** 0.5 - radius)
    a = block(cell="hex", n=4, obstacle=Sphere(centre, radius)).solve()
    b = block(cell="hex", n=4, obstacle=level).solve()
    same_tables(a.tables["contact"], b.tables["contact"])
    assert 0 < a.counts["open"] < 25


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "several laws at once", reference="itself: each face has the shear of its law", aspects=("2D",)
)
def test_two_surfaces_have_their_own_friction():
    """A block between two plates, pulled through its middle: each face has its own friction."""
    domain = box(COMM, 8, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    held = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0], 0.0) & (abs(x[1] - 0.5) < 0.2))
    values = np.array([0.02, 0.0])
    lower = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=HalfSpace((0, 0.01), (0, 1)), law=Coulomb(0.5),
        name="lower",
    )  # fmt: skip
    upper = ContactSurface(
        u, facets(domain, 1, 1.0), obstacle=HalfSpace((0, 0.99), (0, -1)), law=Frictionless(),
        name="upper",
    )  # fmt: skip
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    bcs = [fem.dirichletbc(values, held, V)]
    result = ContactProblem(energy, u, [lower, upper], bcs=bcs).solve()
    assert result.kkt_violation < 1e-9
    assert result.tables["lower"].rn.sum() > 0
    assert result.tables["upper"].rn.sum() > 0
    assert np.abs(result.tables["upper"].rt).max() < 1e-12
    # Pulled to the right, held back to the left; t = (1, 0) below and (-1, 0) above.
    assert result.resultants["lower"][0] < -1e-3
    assert result.tables["upper"].along(result.tables["upper"].ut).min() < 0


@pytest.mark.verifies(
    "hyperelastic bodies",
    "planes",
    "Coulomb",
    reference="closed form: Coulomb's law at the displaced nodes",
    aspects=(
        "2D",
        "large sliding",
    ),
)
def test_large_displacement_on_a_plane_is_exact():
    """A neo-Hookean bar moves by its own size; gap and slip agree with the moved nodes."""
    shift = 1.7
    press = 0.2
    problem = block(
        cell="quad", n=4, material=NeoHookean(600.0, 400.0), law=Coulomb(0.2), top=(shift, -press)
    )
    result = problem.solve()
    table = result.tables["contact"]
    assert result.kkt_violation < 1e-8
    assert table.status == "+++++"
    # Sliding friction balances the shear; every node has moved by more than its own size.
    np.testing.assert_allclose(table.rt[:, 0], -0.2 * table.rn, rtol=1e-8)
    assert table.ut[:, 0].min() > 1.0


@pytest.mark.each_value
@pytest.mark.parametrize("method", ["nodal", "mixed", "integral"])
@pytest.mark.parametrize(("cell", "levels"), [("quad", (3, 12, 24)), ("hex", (2, 6, 10))])
@pytest.mark.verifies(
    "nodal contact",
    "mixed contact",
    "integral contact",
    reference="itself: the other discretisations",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_methods_converge_to_one_another(method, cell, levels):
    """Resultants of the three discretisations agree better on finer meshes."""
    *coarse, fine = levels
    reference = block(cell=cell, n=fine).solve().tables["contact"].rn.sum()
    errors = [
        abs(block(cell=cell, n=n, method=method).solve().tables["contact"].rn.sum() - reference)
        for n in coarse
    ]
    assert errors[1] < 0.5 * errors[0] + 1e-12
    assert errors[1] < 0.01 * reference


@pytest.mark.ranks(2)
@pytest.mark.verifies("mixed contact", reference="closed form: uniform pressure", aspects=("3D",))
def test_mixed_contact_on_facets_that_are_no_parallelograms():
    """Averages reproduce constants, and the forces are uniform to round-off."""
    domain = box(COMM, 4, "hex")
    x = domain.geometry.x
    x[:, 0] += 0.1 * np.sin(2 * np.pi * x[:, 0]) * np.sin(np.pi * x[:, 1])
    x[:, 1] += 0.1 * np.sin(np.pi * x[:, 0]) * np.sin(2 * np.pi * x[:, 1])
    problem = block(
        domain=domain,
        cell="hex",
        law=Frictionless(),
        top=(0.0, 0.0, -0.05),
        young=2e6,
        poisson=0.0,
        method="mixed",
    )
    (s,) = problem.surfaces
    ones = np.ones((s.owned_nodes, s.dim))
    np.testing.assert_allclose(s.points.operator.apply(ones), 1.0, rtol=1e-13)
    table = problem.solve().tables["contact"]
    np.testing.assert_allclose(table.pressure, 1e5, rtol=1e-11)
    np.testing.assert_allclose(table.rn.sum(), 1e5, rtol=1e-12)


ALGORITHMS = (
    "newton",
    "lemke",
    "gauss-seidel",
    "sor",
    "interior-point",
    "projected-gradient",
    "tresca",
    "penalty",
)
#: Stiffness, size and strain of the load.
UNITS = (100.0, 1.0, 0.01), (1e11, 1e-3, 1e-6), (1e-9, 1e9, 1e-3), (1e9, 1e-9, 1.0)


def one_row(cell="tri", n=4, *, young=100.0, size=1.0, strain=0.01, law=None, push=None):
    """A row of cells, and the force expected at each of its lower nodes, shape (dim,)."""
    dim = 2 if cell in ("tri", "quad") else 3
    if dim == 2:
        domain = mesh.create_unit_square(COMM, n, 1, CELLS[cell])
    else:
        domain = mesh.create_unit_cube(COMM, n, n, 1, CELLS[cell])
    below, above = (facets(domain, dim - 1, at) for at in (0.0, 1.0))
    domain.geometry.x[:] *= size
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    push = (0.3, *[0.0] * (dim - 2), -1.0) if push is None else push
    load = fem.Constant(domain, strain * young / size * np.array(push))
    surface = ContactSurface(
        u,
        below,
        obstacle=HalfSpace(np.zeros(dim), np.eye(dim)[-1]),
        law=law or Coulomb(20.0),
    )
    energy = LinearElastic.from_young(young, 0.3).energy(u) - ufl.dot(load, u)
    held = fem.locate_dofs_topological(V, dim - 1, above)
    bcs = [fem.dirichletbc(np.zeros(dim), held, V)]
    return ContactProblem(energy * ufl.dx, u, [surface], bcs=bcs), -0.5 * load.value * size**dim


def check(problem, carried, algorithm):
    result = problem.solve(algorithm=algorithm)
    total = result.resultants["contact"]
    size = np.abs(carried).max()
    # Of nodes that are clamped beside none: half of the body's weight is on the lower ones.
    np.testing.assert_allclose(total, carried, rtol=0, atol=1e-6 * size)
    assert set(result.tables["contact"].status) == {"k"}
    assert result.kkt_violation < 1e-6
    assert result.imbalance < 1e-6
    return result


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.verifies(
    "Newton's method",
    "Lemke",
    "Gauss-Seidel",
    "SOR",
    "interior point",
    "projected gradient",
    "Tresca's fixed point",
    "penalty",
    "units",
    reference="closed form: contact forces are the loads on the lower nodes",
    aspects=("2D",),
)
def test_every_algorithm_solves_the_block(algorithm):
    for young, size, strain in UNITS:
        check(*one_row(young=young, size=size, strain=strain), algorithm)


@pytest.mark.parametrize("algorithm", ["newton", "lemke", "gauss-seidel", "interior-point"])
def test_one_free_node_carries_its_load(algorithm):
    """All nodes but two are clamped, which is one cell; and bounds that are given in advance."""
    check(*one_row("tri", 1), algorithm)
    check(*one_row("quad", 1, law=Coulomb(0.5)), algorithm)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_block_without_load_has_no_forces(algorithm):
    problem, _ = one_row(push=(0.0, 0.0))
    result = problem.solve(algorithm=algorithm)
    assert np.abs(problem.u.x.array).max(initial=0.0) == 0.0
    np.testing.assert_array_equal(result.tables["contact"].force, 0.0)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("algorithm", [Lemke(), InteriorPoint(), ProjectedGradient(), Uzawa()])
def test_algorithms_on_points_have_exact_forces(algorithm):
    """Forces are exact; the scale of lengths comes from the body without contact."""
    problem, carried = one_row()
    points = problem.reduced()
    outcome = algorithm.run(points)
    assert outcome.converged, outcome.reason
    np.testing.assert_allclose(outcome.r[:, -1].sum(), carried[-1], rtol=1e-6)
    assert np.abs(outcome.a).max() < 1e-8 * np.abs(points.free).max()
