"""Data of problems that a solve refuses, with the same error on every rank."""

import re

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block, box, facets
from support.checks import assert_warned, solved_start, warnings_of

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    ConvergenceError,
    Coulomb,
    Frictionless,
    HalfSpace,
    NormalCompliance,
    ParametricContact,
    Sphere,
)
from dolfinx_contact.analysis import (
    critical_friction,
    renard_criterion,
    stability_at_rest,
)
from dolfinx_contact.body.rigid import parts
from dolfinx_contact.continuation import (
    explore,
    find_solutions,
    follow,
)
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import (
    CiarletGeymonat,
    LinearElastic,
    NeoHookean,
    StVenantKirchhoff,
    lame,
)
from dolfinx_contact.problem import discretise
from dolfinx_contact.solvers.attempts import FloatingBodyError

# Every case runs on two ranks, because the errors must be the same on both.
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


def test_surface_refuses_a_tag_without_facets():
    domain, u = square()
    found = facets(domain, 1, 0.0)
    tags = mesh.meshtags(domain, 1, np.sort(found), np.full(len(found), 7, dtype=np.int32))
    with pytest.raises(
        ValueError, match=r"no facet has the tag 3; tags of the mesh: \[7\]"
    ) as info:
        surface(u, where=tags, tag=3)
    same_on_every_rank(info)
    with pytest.raises(ValueError, match="need a tag"):
        surface(u, where=tags)
    assert discrete(u, where=tags, tag=7).points.space.dofmap.index_map.size_global == 5


def test_surface_refuses_an_empty_list_of_facets():
    _, u = square()
    with pytest.raises(ValueError, match="no facet was given"):
        surface(u, where=np.array([], dtype=np.int32))


def test_surface_refuses_interior_facets():
    domain, u = square()
    inside = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))
    with pytest.raises(ValueError, match="4 facets lie inside the body") as info:
        surface(u, where=inside)
    same_on_every_rank(info)


def test_problem_refuses_clamped_contact_facets():
    _, u = square()
    with pytest.raises(ValueError, match="clamp every contact node") as info:
        ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface(u)], bcs=[clamp(u, 1, 0.0)])
    same_on_every_rank(info)


@pytest.mark.parametrize("depth", [0.01, -0.01])
def test_solve_refuses_a_clamped_node_inside_the_obstacle(depth):
    """The clamped left side is moved down, pushing its lowest node into the obstacle."""
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


def test_friction_refuses_oblique_constraints():
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


def test_solve_refuses_negative_and_nan_friction():
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


def test_solve_names_a_constant_that_is_nan():
    domain, u = square()
    load = fem.Constant(domain, (0.0, np.nan))
    load.name = "load"
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    problem = ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])
    with pytest.raises(ValueError, match="look at the Constant 'load' in the form") as info:
        problem.solve()
    same_on_every_rank(info)
    assert np.all(u.x.array == 0.0)


def poisoned(f):
    """Set the last owned dof of the last rank to NaN."""
    if COMM.rank == COMM.size - 1:
        f.x.array[f.function_space.dofmap.index_map.size_local - 1] = np.nan
    return f


def test_solve_names_a_function_that_is_nan():
    """The message also names the displacement at the start; the Functions stay unchanged."""
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
def test_solve_names_the_nan_of_a_curved_obstacle(part, sliding):
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


def test_all_evolutions_refuse_nan_in_dirichlet_data():
    problem = block(top=(np.nan, 0.0))
    with pytest.raises(ValueError, match="a Dirichlet value is not finite"):
        problem.solve()
    match = "at the start: a Dirichlet value is not finite"
    with pytest.raises(ValueError, match=match):
        QuasiStatic(problem, lambda _: None).run([0.0, 1.0])
    with pytest.raises(ValueError, match=match):
        NSCD(problem, 1.0, dt=0.01).run([0.0, 0.01])


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
def test_surface_refuses_elements(element, message):
    domain, _ = square()
    with pytest.raises(ValueError, match=message):
        discrete(fem.Function(fem.functionspace(domain, element)))


@pytest.mark.chatty
def test_failed_solve_names_an_energy_of_the_wrong_sign():
    domain, u = square(2)
    load = fem.Constant(domain, (0.1, -1.0))
    energy = -MATERIAL.energy(u) * ufl.dx - ufl.inner(load, u) * ufl.dx
    problem = ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0, (0.001, -0.01))])
    with pytest.raises(ConvergenceError) as failure:
        problem.solve()
    assert "its energy falls with a strain" in str(failure.value).splitlines()[1]


@pytest.mark.chatty
def test_floating_body_is_refused_with_its_free_motions():
    """A load presses the body on a floor without friction, and nothing prevents sliding."""
    domain, u = square(2)
    load = fem.Constant(domain, (0.0, -1.0))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    with pytest.raises(FloatingBodyError, match=r"free \(translation x\): bcs is empty") as info:
        ContactProblem(energy, u, [surface(u, law=Coulomb(0.0))]).solve()
    same_on_every_rank(info)
    assert np.all(u.x.array == 0.0)
    lifted = HalfSpace((0.0, -0.1), (0.0, 1.0))
    with pytest.raises(FloatingBodyError, match=r"translation x, translation y, rotation"):
        ContactProblem(energy, u, [surface(u, obstacle=lifted)]).solve()


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("load", "warning"),
    [
        (lambda domain: ufl.ds(7), r"ds\(7\) is 0: its measure has no subdomain_data"),
        (
            lambda domain: ufl.ds(subdomain_data=tagged(domain))(7),
            r"ds\(7\) is 0: no cell or facet has this tag",
        ),
        (
            lambda domain: ufl.ds(subdomain_data=tagged(domain, at_side))((3, 7)),
            r"ds\(7\) is 0: no cell or facet has this tag",
        ),
        (
            lambda domain: ufl.ds(subdomain_data=tagged(domain, between_cells))(3),
            r"ds\(3\) is 0: all facets with this tag are between cells",
        ),
        (
            lambda domain: ufl.ds(subdomain_data=tagged(domain))(3),
            r"ds\(3\) has no effect: Dirichlet conditions hold all displacements of its facets",
        ),
        (lambda domain: ufl.ds(subdomain_data=tagged(domain, at_side))(3), None),
    ],
)
def test_load_without_effect_gives_a_warning(load, warning, caplog):
    domain, u = square(2)
    energy = MATERIAL.energy(u) * ufl.dx - u[0] * load(domain)
    problem = ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])
    if warning is None:
        assert not warnings_of(caplog)
        return
    logged = assert_warned(caplog, warning)
    caplog.clear()
    ((name, text),) = problem.solve().warnings.items()
    assert logged == f"{name}: {text}"
    assert not warnings_of(caplog)  # logged once


def at_side(domain):
    return facets(domain, 0, 1.0)


def between_cells(domain):
    return mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))


def tagged(domain, located=lambda domain: facets(domain, 1, 1.0)):
    return mesh.meshtags(domain, 1, np.sort(located(domain)), 3)


@pytest.mark.ranks(2)
def test_cells_without_an_integral_give_a_warning(caplog):
    domain, u = square(4)
    right = mesh.locate_entities(domain, 2, lambda x: x[0] > 0.5 - 1e-9)
    cells = domain.topology.index_map(2)
    tags = np.ones(cells.size_local + cells.num_ghosts, dtype=np.int32)
    tags[right] = 2
    every = np.arange(len(tags), dtype=np.int32)
    dx = ufl.dx(subdomain_data=mesh.meshtags(domain, 2, every, tags))
    ContactProblem(MATERIAL.energy(u) * dx(1), u, [surface(u)], bcs=[clamp(u, 1, 1.0)])
    assert_warned(caplog, "16 cells have no integral over dx, and no stiffness; their tags: 2$")


@pytest.mark.ranks(2)
def test_contradicting_conditions_give_a_warning_while_they_do(caplog):
    """The corners belong to the top and to the side; the later condition wins."""
    domain, u = square(2)
    V = u.function_space
    aside = fem.Constant(domain, (0.05, 0.0))
    dofs = fem.locate_dofs_topological(V, 1, facets(domain, 0, 1.0))
    bcs = [clamp(u, 1, 1.0), fem.dirichletbc(aside, dofs, V)]
    problem = ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface(u)], bcs=bcs)
    warning = r"1 of the degrees of freedom several values: 0, and 0.05 by bcs\[1\], at \(1, 1\)"
    assert re.search(warning, problem.solve().warnings["bcs"])
    assert_warned(caplog, warning)
    corner = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[:2], 1.0).all(axis=0))
    assert np.all(u.x.array.reshape(-1, 2)[corner, 0] == 0.05)
    caplog.clear()
    problem.solve()
    assert not warnings_of(caplog)  # logged once
    aside.value[:] = 0.0
    assert not problem.solve().warnings


@pytest.mark.ranks(2)
def test_friction_in_percent_gives_a_warning(caplog):
    """30 in place of 0.30, also within a law of compliance, until it is changed."""
    _, u = square(2)
    for law in (Coulomb(30.0), NormalCompliance(1e6, friction=Coulomb(30.0))):
        contact = surface(u, law=law)
        problem = ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [contact], bcs=[clamp(u, 1, 1.0)])
        assert list(problem.solve().warnings) == ["friction of 'contact'"]
        assert_warned(caplog, "the friction coefficient is 30: if it is in percent, divide it")
        caplog.clear()
        coefficient = (
            contact.law.friction if law.name == "Coulomb" else contact.law.friction.friction
        )
        coefficient.value = 0.3
        assert not problem.solve().warnings


@pytest.mark.ranks(2)
def test_condition_without_dofs_gives_a_warning(caplog):
    _, u = square(2)
    V = u.function_space
    nowhere = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 7.0))
    bcs = [clamp(u, 1, 1.0), fem.dirichletbc(np.zeros(2), nowhere, V)]
    ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [surface(u)], bcs=bcs)
    assert_warned(caplog, r"bcs\[1\] holds nothing")


def test_elements_that_lock_give_a_warning(caplog):
    """As with Young's modulus and Poisson's ratio in place of the Lame coefficients."""
    domain = box(COMM, 2, "quad")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))

    def made(energy):
        caplog.clear()
        ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])

    incompressible = LinearElastic.from_young(1000.0, 0.499)
    made(MATERIAL.energy(u) * ufl.dx)
    assert not warnings_of(caplog)
    made(incompressible.mean_dilatation_energy(u, ufl.dx))
    assert not warnings_of(caplog)
    made(incompressible.energy(u) * ufl.dx)
    assert_warned(caplog, "lock at Poisson's ratio 0.499")
    made(LinearElastic(1000.0, 0.3).energy(u) * ufl.dx)
    assert_warned(caplog, "LinearElastic.from_young")


def test_too_few_quadrature_points_give_a_warning(caplog):
    """One point leaves a bilinear quadrilateral with displacements without energy."""
    domain = box(COMM, 2, "quad")
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))

    def integrated(degree):
        energy = MATERIAL.energy(u) * ufl.dx(metadata={"quadrature_degree": degree})
        ContactProblem(energy, u, [surface(u)], bcs=[clamp(u, 1, 1.0)])

    integrated(2)
    assert not warnings_of(caplog)
    integrated(1)
    assert_warned(caplog, "quadrature degree 1 of dx is below 2")


def test_body_pulled_off_its_floor_is_refused():
    """A body that rests on the floor at the start, with friction; no load increment holds it."""
    domain, u = square(2)
    energy = MATERIAL.energy(u) * ufl.dx - fem.Constant(domain, 1.0) * u[1] * ufl.dx
    with pytest.raises(FloatingBodyError, match=r"translation x, translation y, rotation") as info:
        ContactProblem(energy, u, [surface(u)]).solve()
    same_on_every_rank(info)


def test_friction_supports_a_body_without_dirichlet_data():
    domain, u = square()
    load = fem.Constant(domain, (0.1, -1.0))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    result = ContactProblem(energy, u, [surface(u)]).solve()
    np.testing.assert_allclose(result.resultants["contact"], (-0.1, 1.0), atol=1e-9)
    assert result.kkt_violation < 1e-8


def test_failed_solve_lists_its_attempts_and_restores_the_functions():
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
def test_floating_part_of_a_mesh_is_refused():
    """The mesh consists of two squares, and one of them has no support."""
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

    with pytest.raises(FloatingBodyError, match=r"x of part 2 of 2.*: neither Dirich") as info:
        problem(touching=False, friction=0.3).solve()
    same_on_every_rank(info)
    # Resting on the floor with friction the second square is held, and both are solved.
    result = problem(touching=True, friction=0.3).solve()
    table = result.tables["contact"]
    second = table.x[:, 0] > 1.5
    np.testing.assert_allclose(table.rn[second].sum(), 1.0, rtol=1e-9)
    assert table.rn[~second].sum() > 5.0
    assert result.kkt_violation < 1e-9


def test_common_facets_are_refused_and_common_nodes_give_a_warning(caplog):
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


def test_problem_refuses_forms_surfaces_and_conditions():
    domain, u = square()
    other = fem.Function(u.function_space)
    v = ufl.TestFunction(fem.functionspace(domain, ("Lagrange", 2, (2,))))
    for bulk, message in (
        (MATERIAL.energy(other) * ufl.dx, "does not contain"),
        (ufl.inner(u, v) * ufl.dx, "one test function of the space"),
        (ufl.div(ufl.TrialFunction(u.function_space)) ** 2 * ufl.dx, "contains a TrialFunction"),
        (MATERIAL.energy(u), "must be a UFL form"),
        (MATERIAL.energy(u) * ufl.dx(degree=3.5), "quadrature degree must be a whole .*, got 3.5"),
        (MATERIAL.energy(u) * ufl.dx(degree="2"), "quadrature degree must be a whole .*, got '2'"),
        (MATERIAL.energy(u) * ufl.dS, "ufl.dS is over the facets between cells"),
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
    with pytest.raises(ValueError, match="not on the space of u"):
        ContactProblem(energy, u, [surface(u)], bcs=[clamp(other_space(domain), 1, 1.0)])


def other_space(domain):
    return fem.Function(fem.functionspace(domain, ("Lagrange", 2, (2,))))


def test_materials_refuse_moduli_out_of_range():
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


def of_young(kind):
    return lambda E, nu: kind(*lame(E, nu))


@pytest.mark.parametrize(
    "material",
    [LinearElastic.from_young, of_young(NeoHookean), of_young(StVenantKirchhoff)],
)
@pytest.mark.parametrize("as_residual", [False, True])
def test_solve_refuses_moduli_that_leave_their_range(material, as_residual):
    """Every solve reads the moduli, and a refused solve leaves the displacement unchanged."""
    domain, u = square(n=2)
    young, poisson = fem.Constant(domain, 1000.0), fem.Constant(domain, 0.3)
    energy = material(young, poisson).energy(u) * ufl.dx
    v = ufl.TestFunction(u.function_space)
    bulk = ufl.derivative(energy, u, v) if as_residual else energy
    problem = ContactProblem(bulk, u, [surface(u)], bcs=[clamp(u, 1, 1.0, (0.0, -0.01))])
    problem.solve()
    before = u.x.array.copy()
    words = r"Lame coefficients, .* \(Young's modulus > 0, Poisson's ratio in \(-1, 1/2\)\), got "
    for E, nu in ((1e3, 0.6), (1e3, 0.5), (1e3, -1.5), (-1e3, 0.3), (0.0, 0.3), (np.nan, 0.3)):
        young.value, poisson.value = E, nu
        with pytest.raises(ValueError, match=words) as info:
            problem.solve()
        same_on_every_rank(info)
    np.testing.assert_array_equal(u.x.array, before)
    young.value, poisson.value = 1000.0, 0.3
    assert problem.solve().converged


@pytest.mark.parametrize("kind", ["Constant", "Function", "gap"])
def test_every_entry_point_refuses_friction_and_gaps_that_become_inadmissible(kind):
    """Friction becomes negative, the height of the floor NaN."""
    domain, u = square(n=2)
    height = fem.Constant(domain, 0.0)
    if kind == "Function":
        friction = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
        values = friction.x.array
    else:
        friction = fem.Constant(domain, 0.4)
        values = friction.value
    values[...] = 0.4
    gamma = fem.Constant(domain, 1.0)
    energy = MATERIAL.energy(u) - gamma * (20.0 * u[0] - 5.0 * u[1])
    rising = HalfSpace(ufl.as_vector([0.0, height]), (0.0, 1.0))
    floor = surface(u, law=Coulomb(friction), obstacle=rising)
    problem = ContactProblem(energy * ufl.dx, u, [floor], bcs=[clamp(u, 1, 1.0)])
    system = ParametricContact(problem, gamma)
    x = solved_start(system)
    message = "negative friction"
    if kind == "gap":
        height.value = np.nan
        message = "the gap or normal of the obstacle is not finite"
    else:
        values[...] = -0.2
    for attempt in (
        lambda: find_solutions(system, [x], 1.0),
        lambda: follow(system, x, 1.0, gamma_range=(0.0, 2.0)),
        lambda: explore(system, [(x, 1.0)], gamma_range=(0.0, 2.0)),
        lambda: critical_friction(problem),
        lambda: renard_criterion(problem),
        lambda: stability_at_rest(problem, density=1.0),
    ):
        with pytest.raises(ValueError, match=message) as info:
            attempt()
        same_on_every_rank(info)


@pytest.mark.ranks(2, 3)
def test_solve_works_on_ranks_without_cells():
    result = block(n=1, cell="quad").solve()
    assert len(result.tables["contact"].x) == 2
    assert result.kkt_violation < 1e-9


@pytest.mark.parametrize(
    "options", [{"increments": 0}, {"increments": -1}, {"increments": "8"}, {"progress": "yes"}]
)
def test_solve_refuses_increments_and_progress(options):
    problem = block(n=2)
    with pytest.raises(ValueError, match=r"number of increments|progress must") as info:
        problem.solve(**options)
    same_on_every_rank(info)
