"""Rigid bodies with unknowns of their own, as contact partners."""

import itertools

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
from support.blocks import box, facets, same_tables
from support.checks import solved_start
from support.histories import punch
from support.histories import punched_block as block

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact import (
    ConvergenceError,
    Coulomb,
    Frictionless,
    HalfSpace,
    ParametricContact,
    RigidBody,
    Sphere,
)
from dolfinx_contact.algorithms.classical import start_by_lemke
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.obstacles import Obstacle
from dolfinx_contact.solvers.attempts import Attempt, FloatingBodyError

COMM = MPI.COMM_WORLD

METHODS = [(None, 1), ("integral", 1), ("mixed", 1), ("integral", 2), ("mixed", 2)]


def table(problem):
    return problem.table(problem.surfaces[0])


def others(dim, *free):
    names = ("x", "y", "rz") if dim == 2 else ("x", "y", "z", "rx", "ry", "rz")
    return [c for c in names if c not in free]


def prescribed(body, shape=None):
    """The same body with the motion that was found."""
    motion = dict(zip(body.components, body.values, strict=True))
    return RigidBody(shape or body.shape, about=body.about, motion=motion, name=body.name)


def resultant(t, about):
    """Force, and moment about a point, of a table of contact points."""
    arm = t.x - about
    moment = np.cross(
        np.pad(arm, ((0, 0), (0, 3 - t.dim))), np.pad(t.force, ((0, 0), (0, 3 - t.dim)))
    )
    return np.concatenate([t.force.sum(axis=0), moment.sum(axis=0)[2 if t.dim == 2 else 0 :]])


# -- forces and motions --------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.each_value
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("method", "degree"), METHODS)
@pytest.mark.verifies(
    "rigid bodies",
    reference="closed form: the force that presses",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_punch_carries_the_prescribed_force(dim, method, degree):
    """The resultant is the force; the field agrees with that of the resulting motion."""
    up = "xyz"[dim - 1]
    n = 3 if dim == 3 or degree == 2 else 5
    options = {"snes_rtol": 1e-13}  # as exact as the comparison
    kind = {"method": method, "degree": degree, "n": n, "options": options}
    body = punch(dim, load={up: -10.0}, held=others(dim, up))
    problem = block(body, dim, **kind)
    result = problem.solve()
    assert abs(result.resultants["top 0"][-1] + 10.0) < 1e-11
    found = result.rigid_bodies["punch"]
    assert abs(found.force[-1] - 10.0) < 1e-11
    np.testing.assert_allclose(found.contact + found.load + found.support, 0, atol=1e-11)
    np.testing.assert_array_equal(found.motion, body.values)
    assert np.count_nonzero(found.motion) == 1
    again = block(prescribed(body), dim, **kind)
    same_tables(table(problem), again.solve().tables["top 0"], 1e-9)
    np.testing.assert_allclose(problem.u.x.array, again.u.x.array, atol=1e-9 * 0.01)


def integral(problem, about):
    """Force and moment of the tractions on the top in 2D, by integrals of UFL or vertex sums."""
    s = problem.surfaces[0]
    if s.method == "nodal":
        return resultant(problem.table(s), about)[1:]
    x = ufl.SpatialCoordinate(s.submesh.mesh)
    t = s.multiplier
    moment = (x[0] - about[0]) * t[1] - (x[1] - about[1]) * t[0]
    parts = [fem.assemble_scalar(fem.form(e * ufl.dx)) for e in (t[1], moment)]
    return [COMM.allreduce(v) for v in parts]


class Tilted(Obstacle):
    """The half-space above the line y = 1, moved and turned by a small motion q, by hand."""

    def __init__(self, q):
        self.q = q

    def on(self, domain):
        x = ufl.SpatialCoordinate(domain)
        gap = 1.0 - x[1] + self.q[1] + self.q[2] * (x[0] - 0.5)
        return gap, ufl.as_vector([0.0 * x[0], 1.0 + 0.0 * x[0]])


@pytest.mark.parametrize("method", ["nodal", "integral", "mixed"])
def test_tilting_punch_balances_its_moments(method):
    """A punch under a force aside: moments balance, and an obstacle moved by hand is the same."""
    body = punch(load={"y": -10.0, "rz": 2.5}, held=["x"])
    problem = block(body, law=Frictionless(), method=method)
    result = problem.solve()
    t = result.tables["top 0"]
    assert 0 < t.count("o") < len(t.letters)
    np.testing.assert_allclose(result.rigid_bodies["punch"].contact[1:], [10.0, -2.5], atol=1e-10)
    np.testing.assert_allclose(integral(problem, body.about), [-10.0, 2.5], atol=1e-10)
    if method != "mixed":  # whose points have averages around them
        np.testing.assert_allclose(resultant(t, body.about)[1:], [-10.0, 2.5], atol=1e-10)
    fixed = block(Tilted(body.values), law=Frictionless(), method=method).solve()
    same_tables(t, fixed.tables["top 0"], 1e-9)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("method", ["nodal", "integral"])
def test_free_punch_in_space_balances_its_moments(method):
    """Free in all components, under a force and moments about all axes, with friction."""
    given = {"x": 1.0, "y": -0.5, "z": -20.0, "rx": -2.0, "ry": 3.0, "rz": 0.2}
    body = punch(3, load=given)
    problem = block(body, 3, 3, Coulomb(0.5), method=method)
    result = problem.solve()
    load = np.array([given[c] for c in body.components])
    t = result.tables["top 0"]
    assert {"k", "s"} <= set(t.letters)
    np.testing.assert_allclose(resultant(t, body.about), load, atol=1e-9)
    np.testing.assert_allclose(result.rigid_bodies["punch"].contact, -load, atol=1e-9)
    again = block(prescribed(body), 3, 3, Coulomb(0.5), method=method).solve()
    np.testing.assert_allclose(resultant(again.tables["top 0"], body.about), load, atol=1e-7)


@pytest.mark.each_value
@pytest.mark.parametrize(("method", "degree"), METHODS)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.verifies(
    "rigid bodies",
    "spheres",
    reference="itself: the approach prescribed",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_sphere_under_a_force_has_the_prescribed_approach(dim, method, degree):
    """Pressed by a force it goes where the same approach, prescribed, has that force."""
    up = "xyz"[dim - 1]
    n = 3 if dim == 3 else 8 // degree
    middle = np.append(0.55 * np.ones(dim - 1), 1.6)
    body = RigidBody(Sphere(middle, 0.6), about=middle, load={up: -20.0}, held=others(dim, up))
    kind = {"method": method, "degree": degree, "n": n}
    problem = block(body, dim, **kind)
    result = problem.solve()
    assert result.reason == "full steps"
    assert abs(result.resultants["top 0"][-1] + 20.0) < 1e-10
    down = 0.5 * body.values[dim - 1]  # prescribed in two steps
    again = block(prescribed(body), dim, **kind)
    assert down < 0
    same_tables(result.tables["top 0"], again.solve().tables["top 0"], 1e-8)


# -- friction ------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_a_dragged_punch_sticks_up_to_the_friction_bound(dim):
    """Below F P the punch sticks; above it the error names the free motion."""
    up = "xyz"[dim - 1]
    free = ("x", "xyz"[dim - 1])
    body = punch(dim, load={up: -10.0, "x": 2.5}, held=others(dim, *free))
    problem = block(body, dim, 3)
    result = problem.solve()
    found = result.rigid_bodies["punch"]
    np.testing.assert_allclose(found.force[[0, -1]], [-2.5, 10.0], atol=1e-10)
    body = punch(dim, load={up: -10.0, "x": 3.1}, held=others(dim, *free))
    with pytest.raises(ConvergenceError, match="translation x of punch"):
        block(body, dim, 3).solve()
    np.testing.assert_array_equal(body.values, 0)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("method", ["nodal", "integral"])
def test_floating_rigid_bodies_are_refused_with_their_motion(method):
    """A load pulling away, or a motion that no contact resists."""
    away = punch(load={"y": 10.0}, held=["x", "rz"])
    with pytest.raises(FloatingBodyError, match="translation y of punch"):
        block(away, method=method).solve()
    c = (0.5, 1.5)
    rolling = RigidBody(Sphere(c, 0.5), about=c, load={"y": -10.0}, free=["rz"], held=["x"])
    with pytest.raises(FloatingBodyError, match="rotation about z of rigid body"):
        block(rolling, law=Frictionless(), method=method).solve()


# -- equations -----------------------------------------------------------------------------------


def small():
    """A square of four triangles: nodes of the top, stiffness with its bottom held, serially."""
    domain = box(MPI.COMM_SELF, 2, "tri")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = ufl.TrialFunction(V)
    v = ufl.TestFunction(V)
    mu = 1000.0 / 2.6
    lam = 1000.0 * 0.3 / (1.3 * 0.4)
    strain = ufl.sym(ufl.grad(u))
    stress = 2 * mu * strain + lam * ufl.tr(strain) * ufl.Identity(2)
    K = dolfinx.fem.petsc.assemble_matrix(fem.form(ufl.inner(stress, ufl.grad(v)) * ufl.dx))
    K.assemble()
    dense = K.convert("dense", PETSc.Mat()).getDenseArray().copy()
    x = V.tabulate_dof_coordinates()
    top = np.flatnonzero(np.isclose(x[:, 1], 1.0))
    top = top[np.argsort(x[top, 0])]
    free = np.flatnonzero(np.repeat(~np.isclose(x[:, 1], 0.0), 2))
    return dense, x[:, :2], top, free


@pytest.mark.verifies(
    "rigid bodies",
    "Signorini",
    reference="enumeration: all active sets, with matrices of numpy",
    aspects=("2D",),
    alone=True,
)
def test_free_punch_agrees_with_all_active_sets():
    """Frictionless, free to sink and to tilt: all active sets tried with matrices of numpy."""
    K, x, top, free = small()
    load = np.array([-10.0, 3.2])  # force, moment about (0.5, 1)
    found = []
    for active in itertools.product([False, True], repeat=len(top)):
        nodes = top[np.array(active)]
        n = len(free)
        k = len(nodes)
        A = np.zeros((n + 2 + k, n + 2 + k))
        b = np.zeros(n + 2 + k)
        A[:n, :n] = K[np.ix_(free, free)]
        b[n : n + 2] = -load
        for i, node in enumerate(nodes):
            row = n + 2 + i
            dof = int(np.flatnonzero(free == 2 * node + 1)[0])
            arm = x[node, 0] - 0.5
            A[row, [dof, n, n + 1]] = 1.0, -1.0, -arm  # u_y = q_y + q_r arm
            A[[dof, n, n + 1], row] = 1.0, 1.0, arm  # r downwards on the block, upwards on the body
        if np.linalg.matrix_rank(A) < len(A):
            continue
        y = np.linalg.solve(A, b)
        u = np.zeros(len(K))
        u[free] = y[:n]
        gaps = y[n] + y[n + 1] * (x[top, 0] - 0.5) - u[2 * top + 1]
        r = y[n + 2 :]
        if (gaps > -1e-12).all() and (r > -1e-12).all():
            found.append((u, y[n : n + 2], r, active))
    assert len(found) == 1
    u, q, r, active = found[0]
    assert 0 < sum(active) < len(top)
    body = punch(load={"y": load[0], "rz": load[1]}, held=["x"])
    problem = block(body, n=2, law=Frictionless(), comm=MPI.COMM_SELF)
    t = problem.solve().tables["top 0"]
    np.testing.assert_allclose(body.values[1:], q, rtol=1e-10)
    np.testing.assert_allclose(problem.u.x.array, u, atol=1e-12)
    np.testing.assert_allclose(t.rn[np.array(active)], r, rtol=1e-10)


@pytest.mark.verifies(
    "rigid bodies",
    reference="independent code: one linear system of numpy",
    aspects=("2D",),
    alone=True,
)
def test_stuck_punch_agrees_with_one_linear_system():
    """All points stick: one linear system, with a reference point far off."""
    K, x, top, free = small()
    about = np.array([2.0, 3.0])
    load = np.array([1.0, -50.0, 74.0])
    n = len(free)
    k = 2 * len(top)
    A = np.zeros((n + 3 + k, n + 3 + k))
    b = np.zeros(n + 3 + k)
    A[:n, :n] = K[np.ix_(free, free)]
    for i, node in enumerate(top):
        for c in range(2):
            row = n + 3 + 2 * i + c
            dof = int(np.flatnonzero(free == 2 * node + c)[0])
            arm = x[node] - about
            motion = np.zeros(3)
            motion[c] = 1.0
            motion[2] = (-arm[1], arm[0])[c]
            A[row, dof] = 1.0
            A[row, n : n + 3] = -motion
            A[dof, row] = -1.0
            A[n : n + 3, row] = motion
    b[n : n + 3] = load
    y = np.linalg.solve(A, b)
    body = RigidBody(
        HalfSpace((0, 1), (0, -1)), about=about, load=dict(zip(("x", "y", "rz"), load, strict=True))
    )
    problem = block(body, n=2, law=Coulomb(50.0), comm=MPI.COMM_SELF)
    t = problem.solve().tables["top 0"]
    assert t.status == "kkk"
    np.testing.assert_allclose(body.values, y[n : n + 3], rtol=1e-9)
    np.testing.assert_allclose(t.force.reshape(-1), y[n + 3 :], atol=1e-9 * 50)


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(("dim", "method", "degree"), [(2, *m) for m in METHODS] + [(3, None, 1)])
@pytest.mark.verifies(
    "rigid bodies",
    reference="differences: central differences",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_jacobian_with_rigid_motions_agrees_with_differences(dim, method, degree):
    """Against differences of H, at random unknowns and statuses held."""
    up = "xyz"[dim - 1]
    middle = np.append(0.55 * np.ones(dim - 1), 1.6)
    rest = others(dim, up, "rz")
    body = RigidBody(
        Sphere(middle, 0.61),
        about=middle,
        load={up: -20.0, "rz": 1.0},
        motion=dict.fromkeys(rest, 0.01),
    )
    problem = block(body, dim, 2, method=method, degree=degree)
    system = ParametricContact(problem)
    x = system.probe(1)
    v = system.probe(2)
    x.scale(1e-2)
    eq = problem.equations  # what is prescribed is in order: H has that linearly
    q = np.where(eq.rigid.fixed, eq.constraints.motions(), eq.unknowns.motions(x))
    x.array[x.getLocalSize() - eq.rigid.owned :] = eq.rigid.here(q)
    state = eq.evaluate_contact(x)
    b = [system.create_vector() for _ in range(3)]
    y = x.copy()
    for vector, step in zip(b, (1e-6, -1e-6), strict=False):
        x.copy(y)
        y.axpy(step, v)
        problem.residual(y, vector, state.statuses)
    problem.linear_solver.update(state)
    problem.linear_solver.matrix.mult(v, b[2])
    b[0].axpy(-1.0, b[1])
    b[0].scale(1 / 2e-6)
    b[0].axpy(-1.0, b[2])
    # Dirichlet columns are not in the Jacobian: H takes their data in all rows.
    assert b[0].norm() < 1e-6 * b[2].norm()


# -- branches ------------------------------------------------------------------------------------


def parametric(method=None, law=None, about=(0.5, 1)):
    """Force and moment are parts of a parameter."""

    def where(domain):
        loads["c"] = gamma = fem.Constant(domain, 0.0)
        load = {"y": -10.0 - gamma, "rz": 0.6 * gamma, "x": 0.2 * gamma}
        loads["body"] = RigidBody(HalfSpace((0, 1), (0, -1)), about=about, load=load, name="punch")
        return [(loads["body"], facets(domain, 1, 1.0))]

    loads = {}
    problem = block(None, where=where, method=method, law=law)
    return problem, loads["body"], ParametricContact(problem, loads["c"])


@pytest.mark.parametrize(
    ("method", "route"), [("nodal", "pivoting"), ("nodal", "steps"), ("integral", "steps")]
)
@pytest.mark.verifies(
    "rigid bodies",
    "pivoting",
    reference="closed form: force and moment that press",
    aspects=(
        "2D",
        "branches",
    ),
)
def test_branch_under_a_growing_force_meets_a_solve(method, route):
    """Gamma is the force; both routes, against a solve at the end."""
    problem, body, system = parametric(method)
    x = solved_start(system)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 10.0), route=route)
    last = branch.points[-1]
    assert last.gamma == pytest.approx(10.0, abs=1e-12)
    result = system.result_at(last)
    np.testing.assert_allclose(result.rigid_bodies["punch"].contact, [-2.0, 20.0, -6.0], atol=1e-8)
    assert len({system.letters(p.piece) for p in branch.points}) > 1
    followed = body.values
    system.set_parameter(10.0)
    again = problem.solve()
    np.testing.assert_allclose(again.rigid_bodies["punch"].motion, followed, rtol=1e-7)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "rigid bodies", "all solutions", reference="itself: the solve", aspects=("2D",)
)
def test_all_solutions_carry_the_motion_of_a_rigid_body():
    """The reduced problem carries the unknowns of the body."""
    _, _, system = parametric(law=Coulomb(0.5))
    x = solved_start(system, 4.0)
    assert system.is_piecewise_affine
    found = find_solutions(system, [x], 4.0).found
    assert len(found) == 1
    x.axpy(-1.0, found[0].x)
    assert x.norm() < 1e-9 * found[0].x.norm()


@pytest.mark.verifies("Lemke", "rigid bodies", reference="itself: Newton's method", aspects=("2D",))
def test_lemke_solves_with_a_prescribed_rigid_motion():
    """Lemke's method solves for a body whose motion is prescribed, and says where it cannot."""
    body = punch(motion={"x": 0.001, "y": -0.01, "rz": 0.01})
    problem = block(body)
    problem.solve()
    u = problem.u.x.array.copy()
    x = problem.create_vector()
    attempt = Attempt("Lemke's method", "")
    assert start_by_lemke(problem.equations, x, attempt)
    problem.read(x)
    np.testing.assert_allclose(problem.u.x.array, u, atol=1e-12)
    problem, _, _ = parametric()
    x = problem.create_vector()
    assert not start_by_lemke(problem.equations, x, attempt)
    assert "not positive definite" in attempt.reason


def test_rates_of_loads_and_motions_of_a_rigid_body_agree_with_differences():
    """dH/dgamma where force, moment and a prescribed motion follow the parameter."""

    def where(domain):
        made["c"] = gamma = fem.Constant(domain, 0.0)
        load = {"y": -10.0 - gamma, "rz": 0.6 * gamma}
        motion = {"x": 0.01 * (gamma + gamma**2)}
        body = RigidBody(HalfSpace((0, 1), (0, -1)), about=(0.5, 1), load=load, motion=motion)
        return [(body, facets(domain, 1, 1.0))]

    made = {}
    problem = block(None, where=where)
    system = ParametricContact(problem, made["c"])
    x = solved_start(system)
    piece = system.piece_at(x, 0.0)
    after, before, rate = (system.create_vector() for _ in range(3))
    system.residual(x, 0.5 + 1e-4, after, piece)
    system.residual(x, 0.5 - 1e-4, before, piece)
    system.parameter_derivative(x, 0.5, rate, piece)
    after.axpy(-1.0, before)
    after.scale(1 / 2e-4)
    assert rate.norm() > 0.1
    after.axpy(-1.0, rate)
    assert after.norm() < 1e-6 * rate.norm()
