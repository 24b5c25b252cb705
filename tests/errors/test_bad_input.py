"""Bad input: the same clear error on every rank, no hang, nothing of the caller's lost."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import block, box, facets

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    ConvergenceError,
    Coulomb,
    Cylinder,
    Frictionless,
    HalfSpace,
    LevelSet,
    ParametricContact,
    Sphere,
    Tresca,
)
from dolfinx_contact.analysis import (
    critical_friction,
    prove_counts,
    renard_criterion,
    stability_at_rest,
)
from dolfinx_contact.body.rigid import parts
from dolfinx_contact.continuation import (
    Diagram,
    Edge,
    explore,
    find_solutions,
    follow,
    points_at,
)
from dolfinx_contact.evolution import NSCD, ArcLength, NoContinuation, QuasiStatic
from dolfinx_contact.materials import (
    Axisymmetric,
    CiarletGeymonat,
    LinearElastic,
    NeoHookean,
    StVenantKirchhoff,
    lame,
)
from dolfinx_contact.problem import discretise
from dolfinx_contact.records import journal_of
from dolfinx_contact.solvers.history import FloatingBodyError

#: What ranks do to each other is tested in all cases on two of them.
pytestmark = pytest.mark.ranks(2, every_case=True)

COMM = MPI.COMM_WORLD
FLOOR = HalfSpace((0.0, 0.0), (0.0, 1.0))
MATERIAL = LinearElastic.from_young(1000.0, 0.3)


def square(n=4, degree=1):
    domain = box(COMM, n, "tri")
    return domain, fem.Function(fem.functionspace(domain, ("Lagrange", degree, (2,))))


def discrete(u, **options):
    return discretise(surface(u, **options))


def surface(u, **options):
    where = options.pop("where", facets(u.function_space.mesh, 1, 0.0))
    return ContactSurface(u, where, **{"obstacle": FLOOR, "law": Coulomb(0.3), **options})


def clamp(u, axis, value, displacement=(0.0, 0.0)):
    V = u.function_space
    dofs = fem.locate_dofs_topological(V, 1, facets(V.mesh, axis, value))
    return fem.dirichletbc(np.array(displacement), dofs, V)


def same_on_every_rank(info):
    assert len(set(COMM.allgather(str(info.value)))) == 1


def test_no_facet_with_the_tag():
    domain, u = square()
    found = facets(domain, 1, 0.0)
    tags = mesh.meshtags(domain, 1, np.sort(found), np.full(len(found), 7, dtype=np.int32))
    with pytest.raises(
        ValueError, match=r"no facet has the tag 3; tags of the mesh: \[7\]"
    ) as info:
        discrete(u, where=tags, tag=3)
    same_on_every_rank(info)
    with pytest.raises(ValueError, match="need a tag"):
        discrete(u, where=tags)
    assert discrete(u, where=tags, tag=7).points.space.dofmap.index_map.size_global == 5


def test_no_facet_at_all():
    _, u = square()
    with pytest.raises(ValueError, match="no facet was given"):
        discrete(u, where=np.array([], dtype=np.int32))


def test_interior_facets():
    domain, u = square()
    inside = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))
    with pytest.raises(ValueError, match="4 facets lie inside the body") as info:
        discrete(u, where=inside)
    same_on_every_rank(info)


def test_facets_outside_the_mesh():
    _, u = square()
    with pytest.raises(ValueError, match="facet indices outside the mesh"):
        discrete(u, where=np.array([10**6], dtype=np.int32))


def test_contact_facets_fully_clamped():
    _, u = square()
    with pytest.raises(ValueError, match="clamp every contact node") as info:
        ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface(u)], bcs=[clamp(u, 1, 0.0)])
    same_on_every_rank(info)


@pytest.mark.parametrize("depth", [0.01, -0.01])
def test_clamped_node_inside_the_obstacle(depth):
    """The left side is clamped and moved down: its lowest node would be in the obstacle."""
    _, u = square()
    bcs = [clamp(u, 0, 0.0, (0.0, -depth))]
    problem = ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface(u)], bcs=bcs)
    if depth > 0:
        with pytest.raises(
            ValueError, match=r"push a contact node 0\.01 into the obstacle"
        ) as info:
            problem.solve()
        same_on_every_rank(info)
        assert np.all(u.x.array == 0.0)
    else:
        assert problem.solve().counts["clamped"] == 1


def test_oblique_constraint_under_friction():
    domain, u = square()
    V = u.function_space
    dofs = fem.locate_dofs_topological(V.sub(0), 1, facets(domain, 0, 0.0))
    sliding = fem.dirichletbc(0.0, dofs, V.sub(0))
    tilted = HalfSpace((0.0, 0.0), (0.1, 1.0))
    bcs = [sliding, clamp(u, 1, 1.0)]
    energy = MATERIAL.energy(u) * ufl.dx
    with pytest.raises(ValueError, match="neither normal nor tangential"):
        ContactProblem(energy, u, [surface(u, obstacle=tilted)], bcs=bcs)
    free = surface(u, obstacle=tilted, law=Frictionless())
    assert ContactProblem(energy, u, [free], bcs=bcs).solve().kkt_violation < 1e-9


@pytest.mark.parametrize("law", [Coulomb, Tresca])
@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_bad_friction_number(law, value):
    _, u = square()
    with pytest.raises(ValueError, match="must be finite and nonnegative"):
        discrete(u, law=law(value))


def test_bad_friction_field():
    problem = block()
    field = fem.Function(fem.functionspace(problem.V.mesh, ("Lagrange", 1)))
    field.interpolate(lambda x: 0.5 - x[0])
    with pytest.raises(ValueError, match="negative friction") as info:
        block(domain=problem.V.mesh, law=Coulomb(field)).solve()
    same_on_every_rank(info)
    field.interpolate(lambda x: np.where(x[0] > 0.9, np.nan, 0.3))
    with pytest.raises(ValueError, match="NaN in the friction"):
        block(domain=problem.V.mesh, law=Coulomb(field)).solve()
    problem.surfaces[0].law.friction.value = -1.0
    with pytest.raises(ValueError, match="negative friction"):
        problem.solve()
    with pytest.raises(ValueError, match="must be a nonnegative number"):
        block(domain=problem.V.mesh, law=Coulomb("0.3"))


def test_nan_in_a_load():
    domain, u = square()
    load = fem.Constant(domain, (0.0, np.nan))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    problem = ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])
    with pytest.raises(ValueError, match="not finite at the start: look at the Constant") as info:
        problem.solve()
    same_on_every_rank(info)
    assert np.all(u.x.array == 0.0)


def poisoned(f):
    """NaN at the last dof of the last rank alone."""
    if COMM.rank == COMM.size - 1:
        f.x.array[f.function_space.dofmap.index_map.size_local - 1] = np.nan
    return f


def test_which_of_the_data_is_not_finite():
    """A Function is named, as is the start; nothing of the caller's changes."""
    domain, u = square()
    load, other = (fem.Function(fem.functionspace(domain, ("DG", 0)), name=k) for k in "ab")
    energy = MATERIAL.energy(u) * ufl.dx - (poisoned(load) + other) * u[1] * ufl.dx
    problem = ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])
    with pytest.raises(ValueError, match="look at the Function 'a' in the form") as info:
        problem.solve()
    same_on_every_rank(info)
    load.x.array[:] = 0.0
    before = poisoned(u).x.array.copy()
    with pytest.raises(ValueError, match="the displacement at the start is not finite") as info:
        problem.solve()
    same_on_every_rank(info)
    np.testing.assert_array_equal(u.x.array, before)


@pytest.mark.parametrize("sliding", ["small", "large"])
@pytest.mark.parametrize("part", ["centre", "radius"])
def test_a_curved_obstacle_that_is_not_finite(part, sliding):
    domain, u = square()
    given = {
        "centre": fem.Constant(domain, (0.5, -2.0)),
        "radius": fem.Constant(domain, 2.0),
    }
    options = {"obstacle": Sphere(**given), "law": Frictionless(), "sliding": sliding}
    energy = MATERIAL.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface(u, **options)], bcs=[clamp(u, 1, 1.0)])
    given[part].value = np.nan
    wanted = f"the obstacle is not finite: look at the {part} of Sphere of 'contact'"
    for attempt in (problem.solve, lambda: NSCD(problem, 1.0, dt=0.1).run([0.0, 1.0])):
        with pytest.raises(ValueError, match=wanted) as info:
            attempt()
        same_on_every_rank(info)


@pytest.mark.parametrize("what", ["displacement", "velocity"])
def test_a_motion_whose_start_is_not_finite(what):
    problem = block()
    velocity = fem.Function(problem.V)
    poisoned({"displacement": problem.u, "velocity": velocity}[what])
    with pytest.raises(ValueError, match=f"the {what} at the start is not finite") as info:
        NSCD(problem, 1.0, dt=0.1, velocity=velocity).run([0.0, 1.0])
    same_on_every_rank(info)


def test_a_tolerance_below_round_off():
    """In free flight, where no status changes: it is said, and nothing is called a cycle."""
    domain, u = square()
    domain.geometry.x[:, 1] += 1.0
    energy = MATERIAL.energy(u) * ufl.dx
    start = fem.Function(u.function_space)
    start.interpolate(lambda x: np.vstack([0.0 * x[0], 0.1 * x[0] - 1.0]))

    def motion(tolerance):
        above = surface(u, where=facets(domain, 1, 1.0))
        options = {"snes_rtol": tolerance}
        problem = ContactProblem(energy, u, [above], bcs=[], petsc_options=options)
        return NSCD(problem, 1.0, dt=0.01, velocity=start)

    said = "which is round-off: snes_rtol 1e-14 asks for less"
    with pytest.raises(NoContinuation, match=said) as info:
        motion(1e-14).run([0.0, 0.01], locate=0.01)
    assert "cycle" not in str(info.value)
    same_on_every_rank(info)
    assert motion(1e-10).run([0.0, 0.01]).complete


def test_a_function_that_jumps_between_cells():
    """UFL asks for a side of it on interior facets."""
    domain, u = square()
    jumps = fem.Function(fem.functionspace(domain, ("DG", 1)))
    energy = MATERIAL.energy(u) * ufl.dx + jumps * ufl.avg(u[1]) * ufl.dS
    kind = ValueError if COMM.size == 1 else RuntimeError  # DOLFINx compiles on one rank
    with pytest.raises(kind, match="must be restricted") as info:
        ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])
    same_on_every_rank(info)


def test_nan_in_dirichlet_data():
    """Before a solve, a history or a motion."""
    problem = block(top=(np.nan, 0.0))
    with pytest.raises(ValueError, match="a Dirichlet value is not finite"):
        problem.solve()
    match = "a Dirichlet value is not finite at the start"
    with pytest.raises(ValueError, match=match):
        QuasiStatic(problem, lambda _: None).run([0.0, 1.0])
    with pytest.raises(ValueError, match=match):
        NSCD(problem, 1.0, dt=0.01).run([0.0, 0.01])


def test_nan_in_the_mesh():
    domain, u = square()
    if COMM.rank == COMM.size - 1:
        domain.geometry.x[0, 1] = np.nan
    with pytest.raises(ValueError, match="not finite") as info:
        ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface(u)], bcs=[])
    same_on_every_rank(info)


def test_complex_petsc(monkeypatch):
    monkeypatch.setattr(PETSc, "ScalarType", np.complex128)
    _, u = square()
    with pytest.raises(RuntimeError, match="real scalars"):
        ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface(u)])


def test_vectors_of_the_wrong_size():
    domain, u = square()
    for obstacle in (
        HalfSpace((0, 0, 0), (0, 1)),
        HalfSpace((0, 0), (0, 0, 1)),
        Sphere((0, 0, 0), 1.0),
        HalfSpace((0, np.nan), (0, 1)),
        HalfSpace(fem.Constant(domain, (0.0, 0.0, 0.0)), (0, 1)),
    ):
        with pytest.raises(ValueError, match="must have 2 "):
            discrete(u, obstacle=obstacle)
    with pytest.raises(ValueError, match="zero vector"):
        discrete(u, obstacle=HalfSpace((0, 0), (0, 0)))
    with pytest.raises(ValueError, match="radius must be positive"):
        discrete(u, obstacle=Sphere((0, -1), 0.0))
    with pytest.raises(ValueError, match="3D mesh"):
        discrete(u, obstacle=Cylinder((0, 0), (0, 1), 1.0))
    with pytest.raises(ValueError, match="scalar UFL"):
        discrete(u, obstacle=LevelSet(lambda x: x))


@pytest.mark.parametrize(
    ("element", "message"),
    [
        (("Lagrange", 3, (2,)), "degree of the displacement must be one of 1, 2"),
        (("DG", 1, (2,)), "continuous vector Lagrange"),
        (("Lagrange", 1), "continuous vector Lagrange"),
        (("Lagrange", 1, (3,)), "continuous vector Lagrange"),
        (("N1curl", 1), "continuous vector Lagrange"),
    ],
)
def test_unsupported_element(element, message):
    domain, _ = square()
    with pytest.raises(ValueError, match=message):
        discrete(fem.Function(fem.functionspace(domain, element)))


def test_unstable_pairs():
    _, u = square(degree=2)
    with pytest.raises(ValueError, match="not a stable pair of the nodal method"):
        discrete(u, method="nodal")
    _, u = square()
    with pytest.raises(ValueError, match="P1/P1, P2/P1, P2/P2"):
        discrete(u, method="integral", multiplier_degree=2)
    with pytest.raises(ValueError, match="method must be one of"):
        discrete(u, method="mortar")


@pytest.mark.chatty
def test_an_energy_of_the_wrong_sign():
    """What the strategies ran into is listed after the reason for it."""
    domain = box(MPI.COMM_WORLD, 2, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    down = fem.dirichletbc(np.array([0.001, -0.01]), top, V)
    load = fem.Constant(domain, (0.1, -1.0))
    energy = -LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy - ufl.inner(load, u) * ufl.dx, u, [surface], bcs=[down])
    with pytest.raises(ConvergenceError) as failure:
        problem.solve()
    assert "its energy falls with a strain" in str(failure.value).splitlines()[1]


@pytest.mark.chatty
def test_missing_dirichlet_data():
    """Pressed on the floor by a load and held by nothing: friction 0 leaves it free to slide."""
    domain, u = square(2)
    load = fem.Constant(domain, (0.0, -1.0))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    with pytest.raises(FloatingBodyError, match=r"free \(translation x\)") as info:
        ContactProblem(energy, u, [surface(u, law=Coulomb(0.0))]).solve()
    same_on_every_rank(info)
    assert np.all(u.x.array == 0.0)
    lifted = HalfSpace((0.0, -0.1), (0.0, 1.0))
    with pytest.raises(FloatingBodyError, match=r"translation x, translation y, rotation"):
        ContactProblem(energy, u, [surface(u, obstacle=lifted)]).solve()


def test_held_by_contact_alone():
    """The same body under friction rests on the floor: no Dirichlet data are needed."""
    domain, u = square()
    load = fem.Constant(domain, (0.1, -1.0))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    result = ContactProblem(energy, u, [surface(u)]).solve()
    np.testing.assert_allclose(result.resultants["contact"], (-0.1, 1.0), atol=1e-9)
    assert result.kkt_violation < 1e-8


@pytest.mark.parametrize("method", ["nodal", "integral"])
@pytest.mark.parametrize("height", [1e-8, 1e-4])
def test_a_body_that_rests_on_a_bump(height, method):
    """It touches the floor at one node alone, and what presses it lays it flat."""
    domain, u = square()
    below = facets(domain, 1, 0.0)
    x = domain.geometry.x
    x[(x[:, 1] < 1e-9) & (np.abs(x[:, 0] - 0.5) > 0.1), 1] = height
    load = fem.Constant(domain, (0.1, -1.0))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    result = ContactProblem(energy, u, [surface(u, where=below, method=method)]).solve()
    np.testing.assert_allclose(result.resultants["contact"], (-0.1, 1.0), atol=2 * height)
    assert "o" not in result.tables["contact"].status
    assert result.imbalance < 1e-8


def test_a_solve_that_cannot_converge():
    """No Newton step is too few: an error that says what was tried; u and lambda as before."""
    problem = block(options={"snes_max_it": 0})
    (s,) = problem.surfaces
    problem.u.interpolate(lambda x: 1e-3 * np.vstack([x[0], x[1]]))
    s.multiplier.interpolate(lambda x: np.vstack([x[0], 1.0 + x[0]]))
    before = problem.u.x.array.copy(), s.multiplier.x.array.copy()
    with pytest.raises(ConvergenceError) as info:
        problem.solve(increments=2)
    for part in ("full steps: no convergence in 0 iterations", "pivoting", "line search", "load"):
        assert part in str(info.value)
    same_on_every_rank(info)
    assert info.value.attempts[0].strategy == "full steps"
    np.testing.assert_array_equal(problem.u.x.array, before[0])
    np.testing.assert_array_equal(s.multiplier.x.array, before[1])


@pytest.mark.chatty
def test_a_part_of_the_mesh_that_nothing_holds():
    """Two squares in one mesh, one of them without support: named, not solved into nonsense."""
    n = 3
    grid = [(i, j) for j in range(n + 1) for i in range(n + 1)]
    x = np.array([(i / n + shift, j / n) for shift in (0.0, 2.0) for i, j in grid])
    at = {ij: k for k, ij in enumerate(grid)}
    one = [
        t
        for j in range(n)
        for i in range(n)
        for t in (
            [at[i, j], at[i + 1, j], at[i, j + 1]],
            [at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]],
        )
    ]
    cells = np.array(one + [[k + len(grid) for k in t] for t in one], dtype=np.int64)
    if COMM.rank > 0:
        x = x[:0]
        cells = cells[:0]
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    domain = mesh.create_mesh(COMM, cells=cells, x=x, e=ufl.Mesh(element))
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    assert COMM.allreduce(int(parts(V).max(initial=0)), op=max) == 1

    def problem(touching, friction):
        u = fem.Function(V)
        where = mesh.locate_entities_boundary(
            domain, 1, lambda x: np.isclose(x[1], 0.0) & (x[0] < (4.0 if touching else 1.5))
        )
        top = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1.0) & (x[0] < 1.5))
        bcs = [fem.dirichletbc(np.array([0.004, -0.01]), top, V)]
        energy = MATERIAL.energy(u) * ufl.dx + 1.0 * u[1] * ufl.dx
        contact = surface(u, where=where, law=Coulomb(friction))
        return ContactProblem(energy, u, [contact], bcs=bcs)

    with pytest.raises(FloatingBodyError, match="translation x of part 2 of 2") as info:
        problem(touching=False, friction=0.3).solve()
    same_on_every_rank(info)
    # Resting on the floor with friction the second square is held, and both are solved.
    result = problem(touching=True, friction=0.3).solve()
    table = result.tables["contact"]
    second = table.x[:, 0] > 1.5
    np.testing.assert_allclose(table.rn[second].sum(), 1.0, rtol=1e-9)
    assert table.rn[~second].sum() > 5.0
    assert result.kkt_violation < 1e-9


def test_an_obstacle_that_moves_between_solves():
    """The clamped node is checked against where the floor is now, not where it was."""
    domain, u = square()
    point = fem.Constant(domain, (0.0, 0.0))
    floor = HalfSpace(point, (0.0, 1.0))
    problem = ContactProblem(
        MATERIAL.energy(u) * ufl.dx, u, [surface(u, obstacle=floor)], bcs=[clamp(u, 0, 0.0)]
    )
    problem.solve()
    point.value[:] = (0.0, 0.05)
    with pytest.raises(ValueError, match=r"push a contact node 0\.05 into the obstacle"):
        problem.solve()
    point.value[:] = (0.0, -0.05)
    assert problem.solve().tables["contact"].un.min() == pytest.approx(0.05)
    normal = fem.Constant(domain, (0.0, 1.0))
    turning = surface(u, obstacle=HalfSpace((0.0, -1.0), normal))
    problem = ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [turning], bcs=[clamp(u, 0, 0.0)])
    problem.solve()
    normal.value[:] = (0.6, 0.8)
    with pytest.raises(ValueError, match="has turned at a contact node"):
        problem.solve()


@pytest.mark.parametrize(
    ("degree", "multiplier", "quadrature"), [(1, 1, 1), (2, 1, 2), (2, 2, 3), (1, 1, 0), (1, 1, -1)]
)
def test_quadrature_too_coarse_for_stability(degree, multiplier, quadrature):
    _, u = square(degree=degree)
    with pytest.raises(
        ValueError, match=r"quadrature degree of P. with P. must be a whole number >="
    ):
        discrete(u, method="integral", multiplier_degree=multiplier, quadrature_degree=quadrature)


def test_surfaces_that_meet(caplog):
    domain, u = square()
    floor = surface(u, name="floor")
    again = surface(u, name="again")
    energy = MATERIAL.energy(u) * ufl.dx
    with pytest.raises(ValueError, match="floor and again have common facets"):
        ContactProblem(energy, u, [floor, again], bcs=[clamp(u, 1, 1.0)])
    wall = surface(
        u, where=facets(domain, 0, 1.0), obstacle=HalfSpace((1.5, 0), (-1, 0)), name="wall"
    )
    ContactProblem(energy, u, [floor, wall], bcs=[clamp(u, 1, 1.0)])
    warned = any("floor and wall share nodes" in r.getMessage() for r in caplog.records)
    assert warned == (COMM.rank == 0)


@pytest.mark.ranks(2, 3)
def test_bad_numbers_on_one_rank_only():
    """What one rank objects to every rank raises."""
    _, u = square()
    last = COMM.rank == COMM.size - 1
    alone = COMM.size == 1
    for options, message in (
        ({"law": Coulomb(-1.0 if last else 0.3)}, "finite and nonnegative"),
        (
            {"obstacle": Sphere((0.5, -1.0), -1.0 if last else 1.0)},
            "radius must be positive" if alone else "obstacle differs between ranks",
        ),
        (
            {"obstacle": HalfSpace((0.0, 0.0), (0.0, np.nan if last else 1.0))},
            "finite components" if alone else "obstacle differs between ranks",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            discrete(u, **options)


def test_arguments_of_the_wrong_kind():
    domain, u = square()
    for options, message in (
        ({"law": 0.3}, "the law must be"),
        ({"obstacle": "floor"}, "the obstacle must be"),
        ({"where": np.ones(4, dtype=bool)}, "integer indices"),
        ({"where": np.array([0.5, 1.5])}, "integer indices"),
    ):
        with pytest.raises(ValueError, match=message):
            discrete(u, **options)
    other = box(COMM, 3, "tri")
    with pytest.raises(ValueError, match="Function of another mesh"):
        discrete(u, law=Coulomb(fem.Function(fem.functionspace(other, ("Lagrange", 1)))))
    energy = MATERIAL.energy(u) * ufl.dx
    bc = clamp(u, 1, 1.0)
    with pytest.raises(ValueError, match="must be lists"):
        ContactProblem(energy, u, surface(u), bcs=[bc])
    with pytest.raises(ValueError, match="must be lists"):
        ContactProblem(energy, u, [surface(u)], bcs=bc)
    single = mesh.create_unit_square(COMM, 3, 3, dtype=np.float32)
    with pytest.raises(ValueError, match="double precision"):
        discrete(fem.Function(fem.functionspace(single, ("Lagrange", 1, (2,))), dtype=np.float32))
    assert domain.topology.dim == 2


def test_no_force_at_all_is_no_violation():
    """A rigid slide over the floor: every force is round-off, and so is the violation."""
    result = block(n=4, cell="quad", top=(0.01, 0.0)).solve()
    assert result.kkt_violation < 1e-9
    assert np.abs(result.tables["contact"].force).max() < 1e-9


def test_bulk_that_does_not_fit():
    domain, u = square()
    other = fem.Function(u.function_space)
    v = ufl.TestFunction(fem.functionspace(domain, ("Lagrange", 2, (2,))))
    for bulk, message in (
        (MATERIAL.energy(other) * ufl.dx, "does not contain"),
        (ufl.inner(u, v) * ufl.dx, "one test function of the space"),
        (MATERIAL.energy(u), "must be a UFL form"),
    ):
        with pytest.raises(ValueError, match=message):
            ContactProblem(bulk, u, [surface(u)])
    energy = MATERIAL.energy(u) * ufl.dx
    with pytest.raises(ValueError, match="at least one contact surface"):
        ContactProblem(energy, u, [])
    with pytest.raises(ValueError, match="made with the displacement"):
        ContactProblem(energy, u, [surface(other)])
    with pytest.raises(ValueError, match="different names"):
        ContactProblem(energy, u, [surface(u), surface(u)])
    with pytest.raises(ValueError, match="must be positive"):
        ContactProblem(energy, u, [surface(u)], r=-1.0)
    with pytest.raises(ValueError, match="not on the space of u"):
        ContactProblem(energy, u, [surface(u)], bcs=[clamp(other_space(domain), 1, 1.0)])


def other_space(domain):
    return fem.Function(fem.functionspace(domain, ("Lagrange", 2, (2,))))


def test_materials_refuse_bad_numbers():
    with pytest.raises(ValueError, match="mu > 0 and 3 lambda"):
        LinearElastic(-100.0, -100.0)
    with pytest.raises(ValueError, match="a must lie between 0 and mu/2"):
        CiarletGeymonat(100.0, 82.0, 41.0)
    with pytest.raises(ValueError, match="Young's modulus"):
        lame(-1.0, 0.3)
    with pytest.raises(ValueError, match="Poisson's ratio"):
        lame(1.0, 0.5)
    domain = mesh.create_unit_square(COMM, 2, 2)
    young, poisson = fem.Constant(domain, -1.0), fem.Constant(domain, 0.5)
    with pytest.raises(ValueError, match="Young's modulus must be positive, got -2"):
        LinearElastic.from_young(2 * young, 0.3)
    with pytest.raises(ValueError, match=r"Poisson's ratio must lie in \(-1, 1/2\), got 0.5"):
        LinearElastic.from_young(1.0, poisson)
    with pytest.raises(ValueError, match="mu > 0 and 3 lambda"):
        LinearElastic(1.0, young)
    with pytest.raises(ValueError, match="a must lie between 0 and mu/2"):
        CiarletGeymonat(1.0, 1.0, poisson)


def test_moduli_that_are_functions_of_constants():
    """UFL of Constants is looked at, whatever functions it takes."""
    domain = mesh.create_unit_square(COMM, 2, 2)
    T = fem.Constant(domain, 0.5)
    pair = fem.Constant(domain, (2.0, 3.0))
    found = [ufl.exp(T), ufl.sqrt(T), ufl.cos(T), ufl.sinh(T), ufl.tanh(T), ufl.erf(T)]
    for value in (*found, ufl.max_value(T, 1), T**0.5, pair[1], ufl.atan2(T, 1)):
        LinearElastic.from_young(1000 * value, 0.3)
        with pytest.raises(ValueError, match="Young's modulus must be positive, got -"):
            LinearElastic.from_young(-value, 0.3)
    for value in (ufl.sqrt(-T), ufl.ln(-T), (-T) ** 0.5, 1 / (T - 0.5), ufl.exp(10000 * T)):
        with pytest.raises(ValueError, match=r"Young's modulus must be positive, got (nan|inf)"):
            LinearElastic.from_young(value, 0.3)


@pytest.mark.parametrize("value", [True, np.True_])
def test_moduli_are_no_truth_values(value):
    with pytest.raises(ValueError, match="Young's modulus must be positive, got"):
        lame(value, 0.3)
    with pytest.raises(ValueError, match="Lame coefficients, numbers or UFL scalars"):
        NeoHookean(1.0, value)


def of_young(kind):
    return lambda E, nu: kind(*lame(E, nu))


@pytest.mark.parametrize(
    "material",
    [LinearElastic.from_young, of_young(NeoHookean), of_young(StVenantKirchhoff)],
)
@pytest.mark.parametrize("as_residual", [False, True])
def test_moduli_that_become_bad(material, as_residual):
    """They are looked at in every solve, and nothing of the user's is touched."""
    domain, u = square(n=2)
    young, poisson = fem.Constant(domain, 1000.0), fem.Constant(domain, 0.3)
    energy = material(young, poisson).energy(u) * ufl.dx
    v = ufl.TestFunction(u.function_space)
    bulk = ufl.derivative(energy, u, v) if as_residual else energy
    problem = ContactProblem(bulk, u, [surface(u)], bcs=[clamp(u, 1, 1.0, (0.0, -0.01))])
    problem.solve()
    before = u.x.array.copy()
    for E, nu, words in (
        (1000.0, 0.6, r"Poisson's ratio must lie in \(-1, 1/2\), got 0.6"),
        (1000.0, 0.5, r"Poisson's ratio must lie in \(-1, 1/2\), got 0.5"),
        (1000.0, -1.5, r"Poisson's ratio must lie in \(-1, 1/2\), got -1.5"),
        (-1000.0, 0.3, "Young's modulus must be positive, got -1000"),
        (np.nan, 0.3, "Young's modulus must be positive, got nan"),
    ):
        young.value, poisson.value = E, nu
        with pytest.raises(ValueError, match=words) as info:
            problem.solve()
        same_on_every_rank(info)
    np.testing.assert_array_equal(u.x.array, before)
    young.value, poisson.value = 1000.0, 0.3
    assert problem.solve().converged


def test_coefficients_that_become_bad():
    """Those of parts, of bodies of revolution, and of a residual that is made of the stress."""
    domain, u = square(n=2)
    mu, a = fem.Constant(domain, 300.0), fem.Constant(domain, 50.0)
    v = ufl.TestFunction(u.function_space)
    elastic = LinearElastic(500.0, mu)
    residual = ufl.inner(elastic.stress(u), ufl.sym(ufl.grad(v))) * ufl.dx
    for bulk, options, words in (
        (NeoHookean(500.0, mu).energy(u) * ufl.dx(metadata={"quadrature_degree": 2}), {}, "mu > 0"),
        (residual, {}, "mu > 0"),
        (
            Axisymmetric(elastic).energy(u) * ufl.dx,
            {"axisymmetric": True},
            "mu > 0",
        ),
        (CiarletGeymonat(500.0, mu, a).energy(u) * ufl.dx, {}, "mu > 0"),
    ):
        mu.value = 300.0
        floor = surface(u, **options)
        problem = ContactProblem(bulk, u, [floor], bcs=[clamp(u, 1, 1.0)])
        problem.solve()
        mu.value = -1.0
        with pytest.raises(ValueError, match=words):
            problem.solve()
    mu.value, a.value = 300.0, 150.0
    with pytest.raises(ValueError, match="a must lie between 0 and mu/2"):
        problem.solve()


@pytest.mark.parametrize("kind", ["Constant", "Function"])
def test_friction_that_becomes_negative(kind):
    """Whatever finds, follows, proves or analyses solutions refuses it, as a solve does."""
    domain, u = square(n=2)
    if kind == "Constant":
        friction = fem.Constant(domain, 0.4)
        values = friction.value
    else:
        friction = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
        values = friction.x.array
    values[...] = 0.4
    gamma = fem.Constant(domain, 1.0)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) - gamma * (20.0 * u[0] - 5.0 * u[1])
    floor = surface(u, law=Coulomb(friction))
    problem = ContactProblem(energy * ufl.dx, u, [floor], bcs=[clamp(u, 1, 1.0)])
    system = ParametricContact(problem, gamma)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    values[...] = -0.2
    for attempt in (
        lambda: find_solutions(system, [x], 1.0),
        lambda: follow(system, x, 1.0, gamma_range=(0.0, 2.0)),
        lambda: explore(system, [(x, 1.0)], gamma_range=(0.0, 2.0)),
        lambda: critical_friction(problem),
        lambda: renard_criterion(problem),
        lambda: stability_at_rest(problem, density=1.0),
    ):
        with pytest.raises(ValueError, match="negative friction") as info:
            attempt()
        same_on_every_rank(info)


def test_data_that_are_inadmissible_within_the_range():
    """Friction is admissible at both ends of the range of gamma, and negative between."""
    domain, u = square(n=2)
    gamma = fem.Constant(domain, 0.9)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) - gamma * (20.0 * u[0] - 5.0 * u[1])
    floor = surface(u, law=Coulomb((gamma - 1.25) ** 2 - 0.04))
    problem = ContactProblem(energy * ufl.dx, u, [floor], bcs=[clamp(u, 1, 1.0)])
    system = ParametricContact(problem, gamma)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    for attempt in (
        lambda: follow(system, x, 0.9, gamma_range=(0.9, 1.6)),
        lambda: explore(system, [(x, 0.9)], gamma_range=(0.9, 1.6)),
        lambda: ArcLength(system).run(gamma_range=(0.9, 1.6)),
    ):
        with pytest.raises(ValueError, match="negative friction of Coulomb at gamma") as info:
            attempt()
        same_on_every_rank(info)


def test_a_gap_that_becomes_no_number():
    """As in a solve, nothing is followed or analysed with it."""
    domain, u = square(n=2)
    gamma = fem.Constant(domain, 1.0)
    height = fem.Constant(domain, 0.0)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) - gamma * (20.0 * u[0] - 5.0 * u[1])
    place = ufl.as_vector([0.0, height])
    floor = surface(u, obstacle=HalfSpace(place, (0.0, 1.0)))
    problem = ContactProblem(energy * ufl.dx, u, [floor], bcs=[clamp(u, 1, 1.0)])
    system = ParametricContact(problem, gamma)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    height.value = np.nan
    for attempt in (
        lambda: follow(system, x, 1.0, gamma_range=(0.0, 2.0), route="steps"),
        lambda: explore(system, [(x, 1.0)], gamma_range=(0.0, 2.0), route="steps"),
        lambda: stability_at_rest(problem, density=1.0),
    ):
        with pytest.raises(ValueError, match="the gap or normal of the obstacle is not finite"):
            attempt()


@pytest.mark.parametrize("route", ["pivoting", "steps"])
def test_points_of_a_branch_of_other_data(route):
    """Whoever changes friction has no points of the branch that was followed before."""
    domain, u = square(n=2)
    gamma = fem.Constant(domain, 1.0)
    friction = fem.Constant(domain, 0.4)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) - gamma * (20.0 * u[0] - 5.0 * u[1])
    floor = surface(u, law=Coulomb(friction))
    problem = ContactProblem(energy * ufl.dx, u, [floor], bcs=[clamp(u, 1, 1.0)])
    system = ParametricContact(problem, gamma)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    given = dict(gamma_range=(1.0, 2.0), route=route)
    branch = follow(system, x, 1.0, **given)
    assert len(points_at(system, branch, 1.5, **given)) == 1
    friction.value = 0.1
    for attempt in (
        lambda: points_at(system, branch, 1.5, **given),
        lambda: journal_of(system, [branch]),
    ):
        with pytest.raises(ValueError, match="not a solution of the problem as it is now"):
            attempt()
    counts = prove_counts(system, Diagram([Edge(branch, None, None)]))
    assert any(count.unfound for count in counts.counts)
    friction.value = 0.4
    assert len(points_at(system, branch, 1.5, **given)) == 1


def test_a_stiffness_that_is_not_finite():
    """Poisson's ratio of 1/2 in a field, where a factorisation would end the process."""
    domain, u = square(n=2)
    nu = fem.Function(fem.functionspace(domain, ("DG", 0)))
    nu.x.array[:] = 0.3
    gamma = fem.Constant(domain, 1.0)
    energy = LinearElastic.from_young(1000.0, nu).energy(u) - gamma * 20.0 * u[0]
    problem = ContactProblem(energy * ufl.dx, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])
    system = ParametricContact(problem, gamma)
    nu.x.array[:] = 0.5
    with pytest.raises(ValueError, match="not finite"):
        find_solutions(system, [system.create_vector()], 1.0)


def test_an_energy_of_ones_own_may_have_any_constant():
    """It is not looked at, though it says the same as one of a material, or shares a Constant."""
    domain, u = square(n=2)
    young = fem.Constant(domain, 1000.0)
    steel = LinearElastic.from_young(young, 0.3)
    steel.energy(u)
    strain = ufl.sym(ufl.grad(u))
    own = (young**2 * ufl.inner(strain, strain) / 2) * ufl.dx
    problem = ContactProblem(own, u, [surface(u)], bcs=[clamp(u, 1, 1.0, (0.0, -0.01))])
    young.value = -1000.0
    assert problem.solve().converged


def test_young_of_constants_and_functions():
    """The energy follows their values, as if the material had been made with these numbers."""
    domain = mesh.create_unit_square(COMM, 2, 2)
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: np.array([0.3 * x[0] + 0.1 * x[1], -0.2 * x[1]]))
    young, poisson = fem.Constant(domain, 1.0), fem.Constant(domain, 0.0)
    modulus = fem.Function(fem.functionspace(domain, ("DG", 0)))

    def energy(*moduli, **options):
        form = fem.form(LinearElastic.from_young(*moduli, **options).energy(u) * ufl.dx)
        return form, lambda: COMM.allreduce(fem.assemble_scalar(form))

    for options in ({}, {"plane_stress": True}):
        _, of_constants = energy(young, poisson, **options)
        _, of_function = energy(modulus, 2 * poisson / 2, **options)
        for E, nu in ((3.0, 0.2), (7.0, -0.4)):
            young.value, poisson.value, modulus.x.array[:] = E, nu, E
            _, of_numbers = energy(E, nu, **options)
            np.testing.assert_allclose(of_constants(), of_numbers())
            np.testing.assert_allclose(of_function(), of_numbers())


@pytest.mark.ranks(2, 3)
def test_a_rank_without_any_cell():
    """One cell: on several ranks all but one have nothing."""
    result = block(n=1, cell="quad").solve()
    assert len(result.tables["contact"].x) == 2
    assert result.kkt_violation < 1e-9


@pytest.mark.parametrize(
    "options", [{"increments": 0}, {"increments": -1}, {"increments": "8"}, {"progress": "yes"}]
)
def test_bad_arguments_of_a_solve(options):
    problem = block(n=2)
    with pytest.raises(ValueError, match=r"number of increments|progress must") as info:
        problem.solve(**options)
    same_on_every_rank(info)
