"""Contact problems as systems: the derivative by gamma, and branches with known folds."""

from mpi4py import MPI

import demo_friction_parameter
import demo_single_element
import numpy as np
import pytest
from _triangle import linear_triangle
from support.blocks import box, facets
from support.harness import varied

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    RigidBody,
    Sphere,
    Tresca,
)
from dolfinx_contact.continuation import Piece, StepControl, explore, find_solutions, follow
from dolfinx_contact.materials import LinearElastic, NeoHookean

COMM = MPI.COMM_WORLD


def driven_block(kind, cell="quad", n=4, material=None, comm=COMM):
    """A block whose parameter is of the given kind, with the starting value of gamma."""
    domain = box(comm, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    top = fem.Function(V)
    gamma = fem.Constant(domain, 0.5)
    x = ufl.SpatialCoordinate(domain)
    energy = (material or LinearElastic.from_young(1000.0, 0.3)).energy(u) * ufl.dx
    friction = 0.3
    point = fem.Constant(domain, (0.0,) * dim)
    driven = []
    move = ufl.as_vector([0.004, *[0.0] * (dim - 2), -0.01 - 0.001 * x[0]])
    if kind == "load":
        energy -= gamma**2 * ufl.dot(ufl.as_vector([3.0, *[0.0] * (dim - 2), -2.0]), u) * ufl.dx
    elif kind == "friction":
        friction = 0.2 * gamma
    elif kind == "obstacle":
        point = ufl.as_vector([*[0.0] * (dim - 1), 0.005 * gamma])
    elif kind == "dirichlet":
        move = ufl.sin(gamma) * move
        driven = [(top, move)]
    points = V.element.interpolation_points
    points = points() if callable(points) else points
    top.interpolate(fem.Expression(move, points))
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=HalfSpace(point, np.eye(dim)[-1]),
        law=Coulomb(friction),
    )
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(top, held)])
    return ParametricContact(problem, gamma, driven=driven)


@pytest.mark.ranks(2, 3)
@pytest.mark.each_value
@pytest.mark.parametrize("kind", ["load", "friction", "obstacle", "dirichlet"])
@pytest.mark.parametrize("material", [None, NeoHookean(600.0, 400.0)])
@pytest.mark.verifies(
    "branches",
    "friction as parameter",
    "moving obstacles",
    reference="differences: central differences",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_derivative_by_gamma(kind, material):
    """dH/dgamma against central differences on a held piece, second order in the step."""
    system = driven_block(kind, material=material)
    problem = system.problem
    gamma = 0.7
    problem.solve()
    x, b, c, d = (system.create_vector() for _ in range(4))
    problem.write(x)
    if kind == "dirichlet":
        system.set_parameter(gamma)
        problem.u.x.array[:] = np.where(
            problem.equations.constraints.fixed.reshape(-1),
            problem.equations.constraints.values(fill=0.0).reshape(-1),
            problem.u.x.array,
        )
        problem.write(x)
    piece = system.piece_at(x, gamma)
    system.parameter_derivative(x, gamma, c, piece)
    assert c.norm() > 0
    errors = []
    for h in (1e-2, 5e-3):
        system.residual(x, gamma + h, b, piece)
        system.residual(x, gamma - h, d, piece)
        b.axpy(-1.0, d)
        b.scale(1 / (2 * h))
        b.axpy(-1.0, c)
        errors.append(b.norm() / c.norm())
    assert errors[1] < 1e-4
    assert errors[1] < 0.3 * errors[0] or errors[1] < 1e-9


@pytest.mark.ranks(2, 3)
@pytest.mark.verifies(
    "branches",
    "Coulomb",
    reference="closed form: folds of Hild's element",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_single_element(folder):
    """Hild's triangle along a load: folds where the closed form has them, and no bifurcation."""
    summary = demo_single_element.main(["--output", str(folder)])
    folds = [f["gamma"] for f in summary["folds"]]
    np.testing.assert_allclose(folds, [0.625, 346 / 182 / 4], atol=1e-10)
    assert [(f["before"], f["after"]) for f in summary["folds"]] == [("k", "-"), ("-", "o")]
    assert summary["bifurcations"] == 0
    np.testing.assert_allclose(summary["folds_closed_form"], folds, atol=1e-10)
    assert len(summary["solutions_at"]["solutions"]) == 3
    assert (folder / "branch.png").stat().st_size > 10_000


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "friction as parameter",
    reference="closed form: where stick and slip are born",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_friction_as_parameter(folder):
    """Stick and slip are born together where the closed form has it."""
    summary = demo_friction_parameter.main(["--output", str(folder)])
    (fold,) = summary["folds"]
    assert not fold["smooth"]
    assert abs(fold["gamma"] - 2.4) < 1e-10
    assert summary["slip_error"] < 1e-10
    assert summary["gamma_end"] == pytest.approx(5.0, abs=1e-12)
    assert (folder / "branch.png").stat().st_size > 10_000


@pytest.mark.parametrize("factor", [pytest.param(f, marks=pytest.mark.long) for f in (0.1, 10.0)])
def test_single_element_with_other_steps_and_units(factor, folder):
    options = ["--output", str(folder), "--route", "steps"]
    other = [
        "--lame",
        "100e9",
        "82e9",
        "--load-direction",
        "-4e9",
        "0",
        "--load-start",
        "0",
        "-1e9",
    ]
    for extra in ([], [*other, "--length", "1e3"]):
        with varied(step_factor=factor):
            summary = demo_single_element.main([*options, *extra])
        assert (summary["points"] > 30) == (factor < 1)
        folds = [f["gamma"] for f in summary["folds"]]
        np.testing.assert_allclose(folds, [0.625, 346 / 182 / 4], atol=1e-10)


@pytest.mark.long
@pytest.mark.parametrize("cell", ["quad", "tet"])
@pytest.mark.verifies(
    "branches",
    "Coulomb",
    reference="itself: the branch on one rank",
    aspects=(
        "2D",
        "3D",
        "branches",
    ),
)
def test_first_contact_and_slip_of_a_block(cell):
    """A block moved down by gamma until it touches: every event, and the solution at the end."""
    dim = 2 if cell == "quad" else 3
    branches = []
    for comm in [COMM, MPI.COMM_SELF] if COMM.size > 1 else [COMM]:
        domain = box(comm, 3, cell)
        V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
        u = fem.Function(V)
        top = fem.Function(V)
        gamma = fem.Constant(domain, 0.0)
        x = ufl.SpatialCoordinate(domain)
        tilt = 1.0 + 0.1 * x[0] + 0.037 * x[dim - 2]
        move = ufl.as_vector([0.004 * gamma, *[0.0] * (dim - 2), -0.01 * gamma * tilt])
        held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
        floor = HalfSpace((*[0.0] * (dim - 1), -0.002), np.eye(dim)[-1])
        surface = ContactSurface(u, facets(domain, dim - 1, 0.0), obstacle=floor, law=Coulomb(0.3))
        energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
        problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(top, held)])
        system = ParametricContact(problem, gamma, driven=[(top, move)])
        start = problem.create_vector()
        problem.solve()
        problem.write(start)
        branch = follow(system, start, 0.0, gamma_range=(-0.1, 1.0))
        branches.append((system, branch))
        assert branch.reason == "gamma reached the end of its range"
        # The same solution as a solve at the end of the range.
        end = branch.points[-1]
        whole = problem.solve()
        assert whole.iterations <= 1
        assert system.letters(end.piece) == whole.tables["contact"].status
    (system, branch), (other, alone) = branches[0], branches[-1]
    events = np.array([s.gamma for s in branch.special])
    assert len(events) >= 3
    np.testing.assert_allclose(events, [s.gamma for s in alone.special], atol=1e-10)
    gammas = [[p.gamma for p in b.points] for b in (branch, alone)]
    np.testing.assert_allclose(*gammas, atol=1e-8)
    for a, b in zip(branch.points, alone.points, strict=True):
        assert system.letters(a.piece) == other.letters(b.piece)


@pytest.mark.ranks(2)
def test_gamma_must_be_a_scalar_constant():
    system = driven_block("load")
    with pytest.raises(ValueError, match="scalar Constant"):
        ParametricContact(system.problem, 0.5)
    with pytest.raises(ValueError, match="scalar Constant"):
        ParametricContact(system.problem, fem.Constant(system.problem.V.mesh, (1.0, 2.0)))
    absent = ParametricContact(system.problem, fem.Constant(system.problem.V.mesh, 1.0))
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    with pytest.raises(ValueError, match="gamma does not appear in H"):
        follow(absent, x, 0.0, gamma_range=(0.0, 1.0), control=StepControl())
    assert isinstance(system.piece_at(x, 0.5), Piece)


@pytest.mark.refuses("branches", "Coulomb", aspects=("2D", "branches"))
def test_clamped_nodes_that_are_pushed_into_the_obstacle():
    """By values that have changed since the solve, or that the parameter drives."""
    square = box(COMM, 4, "tri")
    V = fem.functionspace(square, ("Lagrange", 1, (2,)))
    u, moved = fem.Function(V), fem.Function(V)
    gamma = fem.Constant(square, 0.0)
    bcs = [fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, facets(square, 0, 1.0)))]
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx + gamma * u[0] * ufl.dx
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, facets(square, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    problem.solve()
    down = ParametricContact(problem, gamma, driven=[(moved, gamma * ufl.as_vector((0, -0.01)))])
    x = down.create_vector()
    problem.write(x)
    with pytest.raises(ValueError, match=r"at gamma = 0.0625: Dirichlet data push a contact node"):
        follow(down, x, 0.0, gamma_range=(-1.0, 1.0))
    np.testing.assert_array_equal(moved.x.array, 0.0)
    moved.x.array[1::2] = -0.01
    with pytest.raises(ValueError, match=r"push a contact node 0.01 into the obstacle"):
        follow(ParametricContact(problem, gamma), x, 0.0, gamma_range=(-1.0, 1.0))


@pytest.mark.parametrize("kinks", [pytest.param("exact", marks=pytest.mark.long), "batched"])
@pytest.mark.verifies(
    "branches",
    "Coulomb",
    reference="theorem: the load, not what it is counted from",
    aspects=("2D", "branches"),
)
def test_a_parameter_that_is_counted_from_elsewhere(kinks):
    """Steps are as long as its digits allow, not shorter than these."""

    def found(origin):
        square = box(COMM, 8, "tri")
        V = fem.functionspace(square, ("Lagrange", 1, (2,)))
        u = fem.Function(V)
        gamma = fem.Constant(square, origin - 1.0)
        held = [fem.locate_dofs_topological(V, 1, facets(square, k, 1.0)) for k in (0, 1)]
        bcs = [fem.dirichletbc(np.zeros(2), dofs, V) for dofs in held]
        load = ufl.as_vector((-26.0 * (gamma - origin), -4.0))
        energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx - ufl.inner(load, u) * ufl.dx
        floor = HalfSpace((0, 0), (0, 1))
        surface = ContactSurface(u, facets(square, 1, 0.0), obstacle=floor, law=Coulomb(0.5))
        problem = ContactProblem(energy, u, [surface], bcs=bcs)
        problem.solve()
        system = ParametricContact(problem, gamma)
        x = system.create_vector()
        problem.write(x)
        ends = (origin - 1.0, origin + 1.0)
        control = StepControl(kinks=kinks)
        branch = follow(system, x, ends[0], gamma_range=ends, route="steps", control=control)
        assert branch.reason == "gamma reached the end of its range"
        return np.array([s.gamma - origin for s in branch.special])

    near, far = found(0.0), found(1e6)
    assert len(near) > 20
    np.testing.assert_allclose(far, near, rtol=0, atol=1e-7)


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize("route", ["pivoting", "steps"])
@pytest.mark.parametrize("moved", ["half-space", "rigid body"])
@pytest.mark.refuses("branches", "planes", "rigid bodies", aspects=("2D", "branches"))
def test_an_obstacle_that_is_moved_into_clamped_nodes(moved, route):
    """By the parameter, before the branch comes there."""
    square = box(COMM, 4, "tri")
    V = fem.functionspace(square, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gamma = fem.Constant(square, -1.0)
    bcs = [
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, facets(square, 0, 1.0)), V)
    ]
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx + 2.0 * u[1] * ufl.dx
    if moved == "half-space":
        floor = HalfSpace(ufl.as_vector((0.0, 0.03 * gamma)), (0, 1))
    else:
        motion = {"y": 0.03 * gamma}
        floor = RigidBody(HalfSpace((0, 0), (0, 1)), about=(0, 0), motion=motion, held=["x", "rz"])
    surface = ContactSurface(u, facets(square, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, u, [surface], bcs=bcs)
    problem.solve()
    system = ParametricContact(problem, gamma)
    x = system.create_vector()
    problem.write(x)
    gamma.value = 1.0
    words = r"at gamma = 0.0625: Dirichlet data push a contact node 0.00187 into the obstacle"
    with pytest.raises(ValueError, match=words):
        follow(system, x, -1.0, gamma_range=(-1.0, 1.0), route=route)
    assert gamma.value == 1.0
    branch = follow(system, x, -1.0, gamma_range=(-1.0, 0.0), route="steps")
    assert branch.points[-1].gamma == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("cell", ["tri", pytest.param("tet", marks=pytest.mark.long)])
@pytest.mark.verifies(
    "Tresca",
    "spheres",
    "branches",
    reference="itself: solves at points of the branch",
    aspects=(
        "2D",
        "3D",
        "branches",
    ),
)
def test_a_friction_bound_acts_on_open_points_along_a_branch(cell):
    """Tresca's law over a ball: every point of the branch is a solution of the whole problem."""
    dim = 2 if cell == "tri" else 3
    domain = box(COMM, 6 if dim == 2 else 3, cell)
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    moved = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    centre = np.array([*[0.5] * (dim - 1), -3.0])
    surface = ContactSurface(
        u, facets(domain, dim - 1, 0.0), obstacle=Sphere(centre, 2.999), law=Tresca(5.0)
    )
    held = fem.dirichletbc(
        moved, fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    )
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[held])
    way = ufl.as_vector([0.02 * gamma, *[0.0 * gamma] * (dim - 2), -0.02 * gamma])
    system = ParametricContact(problem, gamma, driven=[(moved, way)])
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
    assert branch.points[-1].gamma == 1.0
    seen = set()
    for point in branch.points[1::4]:
        seen |= set(system.letters(point.piece))
        assert system.piece_of(system.letters(point.piece)).codes.tolist() == (
            point.piece.codes.tolist()
        )
        followed = system.result_at(point).tables["contact"]
        solved = problem.solve().tables["contact"]
        np.testing.assert_allclose(
            followed.force, solved.force, atol=1e-7 * np.abs(solved.force).max()
        )
    assert seen & set("KPMS")
    assert seen & set("k+-s")


def loaded_block(friction):
    """A block held at its top under a load that gamma scales, with its friction as a Constant."""
    domain = box(COMM, 4, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    friction = fem.Constant(domain, friction)
    surface = ContactSurface(
        u,
        facets(domain, 1, 0.0),
        obstacle=HalfSpace((0.0, 0.0), (0.0, 1.0)),
        law=Coulomb(friction),
    )
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    force = ufl.dot(ufl.as_vector([3 * gamma, -5 * gamma]), u) * ufl.ds
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx - force
    bc = fem.dirichletbc(np.zeros(2), held, V)
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=[bc]), gamma), friction


@pytest.mark.ranks(2)
def test_data_that_change_between_branches():
    """Each branch is that of the data as they are, also where the body was condensed before."""
    system, friction = loaded_block(0.3)
    x = system.create_vector()
    for value in (0.3, 0.05, 1.0):
        friction.value = value
        x.set(0.0)
        branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
        followed = system.result_at(branch.points[-1])
        assert followed.summary()["converged"]
        solved = system.problem.solve()
        force = solved.tables["contact"].force
        np.testing.assert_allclose(
            followed.tables["contact"].force, force, atol=1e-10 * np.abs(force).max()
        )
        x.set(0.0)
        found = find_solutions(system, [x], 1.0)
        assert (len(found.found), found.complete) == (1, True)
        system.problem.read(found.found[0].x)
        known = system.problem.solve().tables["contact"].force
        np.testing.assert_allclose(known, force, atol=1e-10 * np.abs(force).max())


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kind", ["Constant", "Function"])
def test_what_drives_changes_between_branches(kind):
    """The condensed body is that of the expression of gamma as it is, which no form holds."""
    domain = box(COMM, 4, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, top = fem.Function(V), fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    if kind == "Constant":
        way = fem.Constant(domain, 0.05)
    else:
        way = fem.Function(fem.functionspace(domain, ("Lagrange", 1)))
        way.x.array[:] = 0.05
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.5))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(top, held)])
    driven = [(top, ufl.as_vector((way * gamma, -0.02)))]
    system = ParametricContact(problem, gamma, driven=driven)
    x = system.create_vector()
    for value in (0.05, 0.01, 0.05):
        if kind == "Constant":
            way.value = value
        else:
            way.x.array[:] = value
        system.set_parameter(0.0)
        problem.solve()
        problem.write(x)
        branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
        force = system.result_at(branch.points[-1]).tables["contact"].force
        known = problem.solve().tables["contact"].force
        np.testing.assert_allclose(force, known, atol=1e-10 * np.abs(known).max())
        solved = u.x.array.copy()
        (found,) = find_solutions(system, [x], 1.0).found
        problem.read(found.x)
        np.testing.assert_allclose(u.x.array, solved, rtol=0, atol=1e-12)


@pytest.mark.ranks(2)
def test_looking_for_solutions_leaves_no_trace():
    system, _ = loaded_block(0.3)
    system.set_parameter(0.25)
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    before = [f.x.array.copy() for f in system.problem.fields]
    find_solutions(system, [x], 0.75)
    # At gamma = 0 every point is at a kink; what was computed at 0.75 leaves no round-off in that.
    x.set(0.0)
    diagram = explore(system, [(x, 0.0)], gamma_range=(-1.0, 1.0))
    assert float(system.constant.value) == 0.25
    for f, values in zip(system.problem.fields, before, strict=True):
        np.testing.assert_array_equal(f.x.array, values)
    other, _ = loaded_block(0.3)
    afresh = explore(other, [(x, 0.0)], gamma_range=(-1.0, 1.0))
    # One solution on each side, by enumeration of all pieces: one branch to each end.
    for found in (diagram, afresh):
        assert sorted(b.points[-1].gamma for b in found.branches) == [-1.0, 1.0]
    for gamma in (-1.0, 1.0):
        assert len(find_solutions(other, [x], gamma).found) == 1


def test_friction_that_gamma_makes_negative():
    domain_system, _ = loaded_block(0.3)
    domain = domain_system.problem.V.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 0.5)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    held = facets(domain, 1, 1.0)
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3 * gamma))
    moved = np.array([0.01, -0.01])
    bc = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, held), V)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    system = ParametricContact(ContactProblem(energy, u, [surface], bcs=[bc]), gamma)
    x = system.create_vector()
    with pytest.raises(ValueError, match="negative friction of Coulomb at gamma = -1"):
        follow(system, x, 0.5, gamma_range=(-1.0, 1.0))
    assert float(gamma.value) == 0.5


def test_moduli_that_gamma_makes_bad():
    domain = loaded_block(0.3)[0].problem.V.mesh
    u = fem.Function(fem.functionspace(domain, ("Lagrange", 1, (2,))))
    gamma = fem.Constant(domain, 1.0)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3))
    held = fem.locate_dofs_topological(u.function_space, 1, facets(domain, 1, 1.0))
    bc = fem.dirichletbc(np.array([0.01, -0.01]), held, u.function_space)
    energy = LinearElastic.from_young(1000.0 * gamma, 0.3).energy(u) * ufl.dx
    system = ParametricContact(ContactProblem(energy, u, [surface], bcs=[bc]), gamma)
    x = system.create_vector()
    words = "Young's modulus must be positive, got -1000.0 at gamma = -1"
    with pytest.raises(ValueError, match=words):
        follow(system, x, 1.0, gamma_range=(-1.0, 1.0))
    assert float(gamma.value) == 1.0


def test_a_singular_piece_and_a_continuum():
    """Hild's element at the critical friction: more solutions than the two that are found."""
    system = linear_triangle(1, 2.0, (4.0, 2.0), (1.0, 1.0), comm=MPI.COMM_SELF)
    x = system.create_vector()
    found = find_solutions(system, [x], 1.0)
    assert len(found.found) == 2
    assert not found.complete
    assert "continua" in found.method
    (continuum,) = found.continua
    assert system.letters(continuum.piece) == "-d"
    assert {id(s) for s in continuum.ends} == {id(s) for s in found.found}
    # Every state between the ends solves the problem on that piece, and H itself.
    a, b = (s.x for s in continuum.ends)
    for part in (0.0, 0.3, 1.0):
        a.copy(x)
        x.axpby(part, 1 - part, b)
        residual = system.create_vector()
        assert system.residual(x, 1.0, residual, None) < 1e-10


@pytest.mark.ranks(2)
def test_evaluating_writes_no_function():
    """The user's Functions and statuses change where a branch ends, and nowhere before."""
    system = driven_block("load")
    problem = system.problem
    problem.solve()
    x = system.create_vector()
    b = system.create_vector()
    problem.write(x)
    known = [f.x.array.copy() for f in problem.fields]
    statuses = problem.statuses
    noise = system.probe(1)
    x.axpy(1e-3, noise)
    piece = system.piece_at(x, 0.4)
    error = system.residual(x, 0.5, b, None)
    assert error == system.residual(x, 0.5, b, None) > 0  # nothing is remembered
    system.jacobian(x, 0.5, piece)
    system.events(x, 0.5, piece)
    system.parameter_derivative(x, 0.5, b, piece)
    for f, values in zip(problem.fields, known, strict=True):
        np.testing.assert_array_equal(f.x.array, values)
    for now, codes in zip(problem.statuses, statuses, strict=True):
        np.testing.assert_array_equal(now, codes)
    system.put(x, 0.5, piece)
    assert any((f.x.array != v).any() for f, v in zip(problem.fields, known, strict=True))
