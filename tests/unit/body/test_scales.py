"""What is taken from the stiffness of a body, when that changes after its problem was made."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.blocks import CELLS, block, box, facets, same_tables

import basix.ufl
import ufl
from dolfinx import fem, mesh
from dolfinx.graph import adjacencylist

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, LevelSet, Sphere
from dolfinx_contact.body.rigid import extents, parts
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic, NeoHookean
from dolfinx_contact.meshing import join
from dolfinx_contact.solvers.history import FloatingBodyError

COMM = MPI.COMM_WORLD
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
def test_material_that_changes(cell, material, solver, factor):
    """As a problem that is made with the new material, iteration by iteration."""
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
def test_what_stays():
    """The meaning of vectors, and r that is given."""
    problem, E = soft_block(1.0, "tri")
    problem.solve()
    scale = problem.equations.stiffness_scale
    r = problem.surfaces[0].points.r.copy()
    x = problem.create_vector()
    problem.write(x)
    before = [f.x.array.copy() for f in problem.fields]
    E.value = 11.0
    problem.solve()
    assert problem.equations.stiffness_scale == pytest.approx(11.0 * scale, rel=1e-12)
    np.testing.assert_allclose(problem.surfaces[0].points.r, 11.0 * r, rtol=1e-12)
    problem.read(x)
    for f, values in zip(problem.fields, before, strict=True):
        np.testing.assert_allclose(f.x.array, values, rtol=1e-12)
    forced, E = soft_block(1.0, "tri", r=3.0)
    E.value = 1e3
    forced.solve()
    assert np.all(forced.surfaces[0].points.r == 3.0)
    assert forced.equations.stiffness_scale == pytest.approx(1e3 * scale, rel=1e-12)


@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.parametrize("ratio", [0.2, 0.45])
def test_the_integral_method_after_another_material(cell, ratio):
    """Its solutions contain r: they are those of a new problem, whatever was solved before."""
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


def test_material_that_vanishes():
    problem, E = soft_block(1.0, "tri")
    E.value = 0.0
    with pytest.raises(ValueError, match="need mu > 0 and 3 lambda"):
        problem.solve()
    E.value = 1e6
    assert problem.solve().counts["open"] >= 0


def test_an_energy_of_ones_own_that_vanishes():
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


@pytest.mark.long
def test_springs_that_come_and_go():
    """A block that springs hold, or nothing."""
    domain = box(COMM, 4, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    k = fem.Constant(domain, 0.0)
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=HalfSpace((0, -0.1), (0, 1)), law=Coulomb(0.3)
    )
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) + 0.5 * k * ufl.inner(u, u)
    lift = fem.Constant(domain, 1.0)
    problem = ContactProblem((energy - lift * u[1]) * ufl.dx, u, [surface])
    with pytest.raises(FloatingBodyError):
        problem.solve()
    k.value = 20.0
    problem.solve()
    lifted = np.broadcast_to([0.0, 1 / 20], (len(u.x.array) // 2, 2))
    np.testing.assert_allclose(u.x.array.reshape(-1, 2), lifted, rtol=0, atol=1e-12)
    k.value = 0.0
    with pytest.raises(FloatingBodyError):
        problem.solve()


@pytest.mark.parametrize(
    ("cell", "sides"), [("tri", (3, 1)), ("quad", (3, 1)), ("tet", (3, 1, 2)), ("hex", (3, 1, 2))]
)
@pytest.mark.parametrize("degree", [1, 2])
def test_the_size_of_a_box(cell, sides, degree):
    """Its diagonal, wherever it is, however it is turned and graded, and what else there is."""
    edges = [a * np.linspace(0.0, 1.0, n) ** 2 for a, n in zip(sides, (3, 5, 2), strict=False)]
    dim = len(sides)
    domain = create_grid(COMM, edges, CELLS[cell])
    far = create_grid(COMM, [2.0 * e + 50.0 for e in edges], CELLS[cell])
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7] if dim == 2 else [0.4, -0.3, 0.7]).as_matrix()
    domain.geometry.x[:] = domain.geometry.x @ turn.T + [100.0, -30.0, 7.0 * (dim - 2)]
    both = join([domain, far]).mesh
    V = fem.functionspace(both, ("Lagrange", degree, (dim,)))
    expected = np.linalg.norm(sides) * np.array([1.0, 2.0])
    np.testing.assert_allclose(np.sort(extents(V, parts(V))), expected, rtol=1e-11)


@pytest.mark.ranks(2, 3)
def test_the_size_of_a_body_with_ranks_that_have_no_cell():
    """A strip of cells on all ranks but the first."""
    n = 6
    x = np.array([[i, j] for i in range(n + 1) for j in (0, 1)], dtype=float)
    cells = np.array([[2 * i, 2 * i + 1, 2 * i + 2, 2 * i + 3] for i in range(n)])
    if COMM.rank > 0:
        x, cells = x[:0], cells[:0]

    def on_others(comm, _parts, _types, topology):
        mine = len(topology[0]) // 4
        ranks = 1 + np.arange(mine) % (comm.size - 1) if comm.size > 1 else np.zeros(mine)
        found = adjacencylist(ranks.astype(np.int32).reshape(-1, 1))
        return getattr(found, "_cpp_object", found)  # a wrapper since DOLFINx 0.10

    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    domain = mesh.create_mesh(COMM, cells, x=x, e=ufl.Mesh(element), partitioner=on_others)
    here = domain.topology.index_map(2).size_local
    assert COMM.size == 1 or (here == 0) == (COMM.rank == 0)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    np.testing.assert_allclose(extents(V, parts(V)), np.hypot(n, 1), rtol=1e-13)


def on_a_wavy_tool(angle=0.0, far=None, poisson=0.3, shift=0.0, other=0.3):
    """Contact forces by the integral method on a block that is turned by an angle with its tool.

    Both are shifted along the tool. Another body, of another Poisson ratio, may be far away.
    """
    n = 4
    domain = create_grid(COMM, [np.linspace(0.0, 1.0, n + 1)] * 2, CELLS["quad"])
    if far is not None:
        beside = create_grid(COMM, [np.array([far, far + 1.0])] * 2, CELLS["quad"])
        domain = join([domain, beside]).mesh
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    bottom, top = facets(domain, 1, 0.0), facets(domain, 1, 1.0)
    domain.geometry.x[:, :2] = domain.geometry.x[:, :2] @ turn.T + shift * turn[:, 0]
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    bcs = [fem.dirichletbc(turn @ [0.02, -0.05], fem.locate_dofs_topological(V, 1, top), V)]
    if far is not None:
        edge = fem.locate_dofs_geometrical(V, lambda x: c * x[0] + s * x[1] - shift > 0.5 * far)
        bcs.append(fem.dirichletbc(np.zeros(2), edge, V))

    def tool(x):
        return -s * x[0] + c * x[1] - 0.03 * ufl.cos(5.0 * (c * x[0] + s * x[1] - shift))

    surface = ContactSurface(
        u, bottom, obstacle=LevelSet(tool), law=Coulomb(0.4), method="integral"
    )
    ratio = fem.Function(fem.functionspace(domain, ("DG", 0)))
    ratio.interpolate(lambda x: np.where(c * x[0] + s * x[1] - shift < 2.0, poisson, other))
    energy = LinearElastic.from_young(1.0, ratio).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=bcs, petsc_options={"snes_rtol": 1e-12})
    problem.solve()
    table = problem.table(surface)
    return (table.force @ turn)[np.argsort(table.x @ turn[:, 0])]


@pytest.mark.parametrize(
    "given",
    [{"angle": 0.7}, {"far": 30.0}, {"far": 30.0, "other": 0.4999}],
    ids=["turned", "another body", "another nearly incompressible body"],
)
def test_the_integral_method_depends_on_no_axes(given):
    """Nor on other bodies: its solution depends on r, and that on the size of the body."""
    np.testing.assert_allclose(on_a_wavy_tool(**given), on_a_wavy_tool(), atol=1e-10)


def test_the_softness_of_a_body_far_from_the_origin():
    """Of a nearly incompressible one the integral method depends on it."""
    near, far = (on_a_wavy_tool(poisson=0.4999, shift=shift) for shift in (0.0, 1e6))
    np.testing.assert_allclose(far, near, atol=1e-7)
