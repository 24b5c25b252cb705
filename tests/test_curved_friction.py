"""Friction on curved obstacles in large sliding, and rigid bodies that turn."""

from itertools import pairwise

from mpi4py import MPI

import demo_belt
import numpy as np
import pytest
from blocks import box, facets, same_tables
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from test_large_sliding import DX, OBSTACLES, RUBBER, block, ellipse, shaken
from test_sliding_pair import smooth

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Cylinder,
    Frictionless,
    HalfSpace,
    LevelSet,
    NonlocalCoulomb,
    ParametricContact,
    RigidBody,
    Sphere,
    materials,
    plot,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.laws.status import closed
from dolfinx_contact.meshing import join
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.records import EvolutionRecord, resume

COMM = MPI.COMM_WORLD
STEEL = materials.LinearElastic.from_young(1000.0, 0.3)


# -- slips along surfaces --------------------------------------------------------------------------


def led(obstacle, dim, places):
    """Increments of the slip, and normals, of contact nodes led from place to place (n, dim)."""
    problem = block(obstacle, cell="quad" if dim == 2 else "hex", n=2, law=Coulomb(0.3))
    (s,) = problem.surfaces
    nodes = s.points.vertex_trace_dofs[: s.points.number]
    x = s.node_positions
    found = []
    s.memory = None
    for k, place in enumerate(places):
        u = np.zeros_like(x)
        u[nodes] = place - x[nodes]
        at = s.kinematics(u)
        if k:
            found.append((at.increment, at.data.n, at.slip))
        whole = np.zeros_like(at.whole) if k == 0 else at.whole
        s.memory = Memory(whole, place=at.place)
    return found


def on_circle(angle, radius, number):
    turned = radius * np.array([np.sin(angle), np.cos(angle)])
    return np.tile(turned, (number, 1)), np.tile([np.cos(angle), -np.sin(angle)], (number, 1))


@pytest.mark.verifies(
    "spheres",
    "cylinders",
    "level sets",
    "Coulomb",
    reference="closed form: arcs of circles, helices and ellipses",
    aspects=("2D", "3D", "large sliding"),
)
class TestArcs:
    """The slip of a point that is led along an obstacle is the way along its surface."""

    @pytest.mark.parametrize("step", [1e-9, 1e-3, 0.1, 0.11, 1.0, 2.5])
    def test_circle(self, step):
        obstacle = Sphere((0.0, 0.0), 2.0)
        angles = [-0.3, -0.3 + step, -0.3 + step / 3]
        number = block(obstacle, n=2).surfaces[0].points.number
        places = [on_circle(a, 2.0, number)[0] for a in angles]
        found = led(obstacle, 2, places)
        for (a, b), (slip, _, _) in zip(pairwise(angles), found, strict=True):
            exact = 2.0 * (b - a) * on_circle(b, 2.0, number)[1]
            np.testing.assert_allclose(slip, exact, rtol=0, atol=1e-14 + 1e-12 * abs(b - a))
        # What memory has turns with the surface.
        whole = 2.0 * (angles[2] - angles[0]) * on_circle(angles[2], 2.0, number)[1]
        np.testing.assert_allclose(found[1][2], whole, rtol=0, atol=1e-12)

    @pytest.mark.parametrize("kind", ["sphere", "cylinder"])
    def test_space(self, kind):
        """Great circles on a sphere, helices on a cylinder, seen from inside and outside."""
        start, angle, along = 0.2, 1.3, 0.7
        frame = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
        axis = frame[:, 1]
        shape = Sphere((0.0, 0.0, 0.0), 2.0)
        if kind == "cylinder":
            shape = Cylinder((0.0, 0.0, 0.0), axis, 2.0)
        number = block(shape, cell="hex", n=2).surfaces[0].points.number

        def place(part):
            phi = start + part * angle
            local = np.array([2 * np.sin(phi), part * along * (kind == "cylinder"), 2 * np.cos(phi)])
            return np.tile(frame @ local, (number, 1))

        ((slip, _, _),) = led(shape, 3, [place(0.0), place(1.0)])
        phi = start + angle
        tangent = np.array([np.cos(phi), 0.0, -np.sin(phi)])
        exact = 2.0 * angle * frame @ tangent + along * (kind == "cylinder") * axis
        np.testing.assert_allclose(slip, np.tile(exact, (number, 1)), atol=1e-12)

    def test_ellipse(self):
        """Where curvature changes a step is off by the fifth power of its length."""
        obstacle = LevelSet(lambda x: x[0] ** 2 / 4 + x[1] ** 2 - 1.0)
        number = block(obstacle, n=2).surfaces[0].points.number
        ends = 0.2, 1.2

        def speed(phi):
            return np.hypot(2 * np.cos(phi), np.sin(phi))

        exact = quad(speed, *ends, epsabs=1e-14, epsrel=1e-13)[0]
        errors = []
        for steps in (2, 4, 8):
            phi = np.linspace(*ends, steps + 1)
            places = [np.tile([2 * np.sin(p), np.cos(p)], (number, 1)) for p in phi]
            found = led(obstacle, 2, places)
            way = sum(np.linalg.norm(slip[:1], axis=1).sum() for slip, _, _ in found)
            errors.append(abs(way - exact) if number else 0.0)
            for slip, n, _ in found:
                assert np.abs(np.sum(slip * n, axis=1)).max(initial=0.0) < 1e-14
        if number:
            assert errors[0] < 5e-3
            assert errors[1] < errors[0] / 12 and errors[2] < errors[1] / 12


# -- derivatives -----------------------------------------------------------------------------------

TURNED = {2: {"rz": 0.3}, 3: {"rx": 0.2, "ry": -0.3, "rz": 0.4}}


def on_turned(dim, shape, **given):
    """Of a body about (0.4, ..., -1) that is pressed, and turned as prescribed."""
    motion = TURNED[dim] | {"x": 0.02} | ({"y": -0.01} if dim == 3 else {})
    about = [0.4, *[0.5] * (dim - 2), -1.0]
    return RigidBody(shape, about=about, motion=motion, load={"y" if dim == 2 else "z": 5.0})


def remembering(problem):
    """Let the contact points have been somewhere else."""
    (s,) = problem.surfaces
    place = smooth(s.positions, 5, 0.05)
    s.memory = Memory(np.zeros_like(place), place=place, step=1.0)


@pytest.mark.parametrize("remembers", [False, True])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("name", "cell", "given"),
    [
        ("disc", "quad", {}),
        ("ellipse", "tri", {"method": "integral"}),
        ("disc", "quad", {"degree": 2}),
        ("ball", "tet", {}),
        ("bumps", "hex", {}),
        ("cylinder", "hex", {"method": "integral"}),
    ],
)
@pytest.mark.verifies(
    "spheres",
    "cylinders",
    "level sets",
    "rigid bodies",
    "Coulomb",
    reference="differences: central differences",
    aspects=("2D", "3D", "large sliding"),
)
def test_jacobian(name, cell, given, turned, remembers):
    """Every status somewhere, normals, gaps and slips that follow the displacement."""
    dim = 2 if cell in ("tri", "quad") else 3
    shape = OBSTACLES[name]
    obstacle = on_turned(dim, shape) if turned else shape
    given = given | ({"sliding": "large"} if turned else {})
    problem = block(obstacle, cell=cell, n=2, law=Coulomb(0.3), **given)
    eq = problem.equations
    (s,) = problem.surfaces
    if remembers:
        remembering(problem)
    x, v = (shaken(problem, size, seed) for size, seed in ((0.05, 1.0), (1.0, 2.0)))
    n = eq.owned_sizes[0]
    v.array[:n][eq.fixed[:n]] = 0.0
    if turned:
        rest = n + eq.owned_sizes[1]
        x.array[rest:] = eq.rigid.here(np.where(eq.rigid.fixed, eq.rigid.prescribed(1.0), 0.03))
        v.array[rest:] = eq.rigid.here(np.where(eq.rigid.fixed, 0.0, 1.0))
    x.array[:n][eq.fixed[:n]] = eq.prescribed.values().reshape(-1)[:n][eq.fixed[:n]]
    codes = s.law_at_points.codes
    mine = np.arange(s.points.number) + COMM.rank
    statuses = [np.array(codes, dtype=np.int8)[mine % len(codes)]]
    b, after, before, product = (x.duplicate() for _ in range(4))
    jacobian = Jacobian(eq)
    jacobian.update(eq.residual(x, b, statuses))
    jacobian.matrix.mult(v, product)
    errors = []
    for eps in (3e-5, 3e-6):
        for sign, f in ((eps, after), (-eps, before)):
            y = x.copy()
            y.axpy(sign, v)
            eq.residual(y, f, statuses)
        after.axpy(-1.0, before)
        after.scale(0.5 / eps)
        after.axpy(-1.0, product)
        rows = [np.sum(f.array_r[n:] ** 2) for f in (after, product)]
        errors.append(np.sqrt(np.divide(*COMM.allreduce(np.array(rows)))))
    assert errors[0] < 1e-5
    assert errors[1] < 0.02 * errors[0] + 1e-9


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("method", ["nodal", "integral"])
@pytest.mark.parametrize("remembers", [False, True])
@pytest.mark.verifies(
    "rigid bodies",
    "moving obstacles",
    "Coulomb",
    reference="differences: central differences",
    aspects=("2D", "3D", "large sliding", "branches"),
)
def test_derivative_by_the_motion(dim, method, remembers):
    """dH/dgamma where a body turns and moves, and of an obstacle that is moved by Constants."""
    domain = box(COMM, 3 if dim == 2 else 2, "tri" if dim == 2 else "hex")
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 0.3)
    shape = OBSTACLES["ellipse" if dim == 2 else "bumps"]
    turning = {name: value * gamma**2 for name, value in TURNED[dim].items()}
    rest = {"x": 0.1 * gamma, "y": 0.02 * gamma}
    rest |= {"z": 0.0 * gamma} if dim == 3 else {}
    body = RigidBody(shape, about=[0.4, *[0.5] * (dim - 2), -1.0], motion=turning | rest)
    moved = ellipse(domain, (0.4 + 0.3 * gamma, gamma**2 - 1.05), gamma)
    for obstacle in (body, moved) if dim == 2 else (body,):
        bottom = facets(domain, dim - 1, 0.0)
        surface = ContactSurface(
            u, bottom, obstacle=obstacle, law=Coulomb(0.3), method=method, sliding="large"
        )
        held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
        bcs = [fem.dirichletbc(np.zeros(dim), held, V)]
        problem = ContactProblem(RUBBER.energy(u) * DX, u, [surface], bcs=bcs)
        system = ParametricContact(problem, gamma)
        if remembers:
            remembering(problem)
        x = shaken(problem, 0.05, 1.0)
        eq = problem.equations
        contact = slice(eq.owned_sizes[0], sum(eq.owned_sizes[:2]))

        def residual(gamma_now, f, x=x, system=system, eq=eq):
            """With the body where it is to be, so that nothing is left to go."""
            gamma.value = gamma_now
            x.array[sum(eq.owned_sizes[:-1]) :] = eq.rigid.here(eq.prescribed_motions())
            system.residual(x, gamma_now, f, piece)

        b, c, d = (problem.create_vector() for _ in range(3))
        x.array[sum(eq.owned_sizes[:-1]) :] = eq.rigid.here(eq.prescribed_motions())
        piece = system.piece_at(x, 0.3)
        system.parameter_derivative(x, 0.3, c, piece)
        errors = []
        for h in (2e-3, 1e-3):
            residual(0.3 + h, b)
            residual(0.3 - h, d)
            b.axpy(-1.0, d)
            b.scale(1 / (2 * h))
            b.axpy(-1.0, c)
            rows = [np.sum(f.array_r[contact] ** 2) for f in (b, c)]
            errors.append(np.sqrt(np.divide(*COMM.allreduce(np.array(rows)))))
        gamma.value = 0.3
        assert errors[1] < 1e-3
        assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


# -- what turns, what slides -----------------------------------------------------------------------


class OnBody:
    """A block held and moved at its top, on a body or another obstacle at its bottom."""

    def __init__(self, dim, obstacle, law, *, n=3, comm=COMM, cell=None, **given):
        cell = cell or ("quad" if dim == 2 else "hex")
        domain = box(comm, n, cell)
        self.dim = dim
        V = fem.functionspace(domain, ("Lagrange", given.pop("degree", 1), (dim,)))
        self.X = V.tabulate_dof_coordinates()[:, :dim]
        self.u = fem.Function(V)
        self.top = fem.Function(V)
        material = given.pop("material", RUBBER)
        bottom = facets(domain, dim - 1, 0.0)
        obstacle = obstacle(domain) if callable(obstacle) else obstacle
        self.surface = ContactSurface(self.u, bottom, obstacle=obstacle, law=law, **given)
        held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
        bcs = [fem.dirichletbc(self.top, held)]
        energy = material.energy(self.u) * DX
        options = {"snes_rtol": 1e-11}
        self.problem = ContactProblem(
            energy, self.u, [self.surface], bcs=bcs, petsc_options=options
        )

    def move(self, motion):
        """Prescribe displacements (n, dim) of the positions X (n, dim) at the top."""
        self.top.x.array[:] = motion(self.X).reshape(-1)

    def run(self, motion, times, **given):
        """A history; its energies, tables and steps."""

        def load(t):
            self.move(lambda X: motion(t, X))

        given = {"rays": False, "sudden": np.inf} | given
        return QuasiStatic(self.problem, load).run(times, **given)


def pressed_and_led(t, X, press=0.06, shear=0.04):
    """Down until t = 1, then to the side."""
    moved = np.zeros_like(X)
    moved[:, -1] = -press * min(t, 1.0)
    moved[:, 0] = shear * max(t - 1.0, 0.0)
    return moved


@pytest.mark.parametrize("shape", ["disc", "ellipse", "ball", "cylinder", "bumps"])
@pytest.mark.parametrize("method", ["nodal", "integral"])
@pytest.mark.parametrize("angle", [0.2, 1.0])
@pytest.mark.verifies(
    "rigid bodies",
    "spheres",
    "cylinders",
    "level sets",
    "Coulomb",
    "quasi-static",
    reference="theorem: a rotation changes nothing",
    aspects=("2D", "3D", "large sliding"),
)
def test_turned(shape, method, angle):
    """A stuck block that turns with the body under it in one step sticks, its tractions turned."""
    dim = 2 if shape in ("disc", "ellipse") else 3
    about = np.array([0.4, *[0.5] * (dim - 2), -1.0])
    names = ("x", "y", "rz") if dim == 2 else ("x", "y", "z", "rx", "ry", "rz")
    axis = np.array([0.2, 0.9, 0.4]) if dim == 3 else np.array([0.0, 0.0, 1.0])
    vector = angle * axis / np.linalg.norm(axis)
    Q = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
    constants = {}

    def body_on(domain):
        for name in names:
            constants[name] = fem.Constant(domain, 0.0)
        return RigidBody(OBSTACLES[shape], about=about, motion=constants)

    block_on = OnBody(dim, body_on, Coulomb(2.0), method=method, sliding="large")
    body = block_on.surface.rigid_body
    block_on.run(pressed_and_led, [0.0, 0.5, 1.0, 1.5, 2.0])
    problem, u = block_on.problem, block_on.u
    # Held where it is, for a step; then turned in that same step.
    problem.equations.remember(problem.equations.advanced(problem.state()))
    still = problem.solve(expected=[problem.state().statuses])
    assert still.tables["contact"].letters.tolist().count("k") > 1
    before = u.x.array.reshape(-1, dim).copy()
    tractions = block_on.surface.multiplier.x.array.reshape(-1, dim).copy()
    X = block_on.X
    turned = (X + before - about) @ Q.T + about - X
    for name, value in zip(names[dim:], vector[-len(names[dim:]) :], strict=True):
        constants[name].value = value
    block_on.top.x.array[:] = turned.reshape(-1)
    u.x.array[:] = turned.reshape(-1)
    block_on.surface.multiplier.x.array[:] = (tractions @ Q.T).reshape(-1)
    body.values = body.numbers()
    found = problem.state()
    for rows in found.rows:
        assert np.abs(rows).max(initial=0.0) < 1e-9 * 1000.0
    # From another start, where the body still has all the way to turn.
    body.values = np.zeros(len(names))
    u.x.array[:] = (turned + 1e-3 * smooth(X, 2, 1.0)).reshape(-1)
    problem.solve(expected=[found.statuses])
    size = COMM.allreduce(np.abs(tractions).max(initial=0.0), max)
    off = block_on.surface.multiplier.x.array.reshape(-1, dim) - tractions @ Q.T
    assert COMM.allreduce(np.abs(off).max(initial=0.0), max) < 1e-9 * size
    table = problem.table(block_on.surface)
    if method == "nodal":  # where conditions hold point by point
        assert np.abs(table.increment[table.letters == "k"]).max() < 1e-9


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.verifies(
    "rigid bodies",
    reference="itself: an obstacle where the body has come",
    aspects=("2D", "3D", "large sliding", "branches"),
)
def test_a_cam(dim):
    """A disc or ball beside the axis about which it turns, against one that stands where it is."""
    about = np.array([0.5, *[0.4] * (dim - 2), -1.2])
    arm = np.array([0.5, *[0.1] * (dim - 2), 0.2])
    vector = np.array([0.0, 0.0, 0.7]) if dim == 2 else np.array([0.3, -0.9, 0.2])
    Q = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
    shift = np.array([0.03, *[0.02] * (dim - 2), 0.08])
    names = ("x", "y", "rz") if dim == 2 else ("x", "y", "z", "rx", "ry", "rz")
    gammas = []

    def body_on(domain):
        gammas.append(fem.Constant(domain, 1.0))
        values = [*shift, *vector[-(len(names) - dim) :]]
        motion = {name: v * gammas[0] for name, v in zip(names, values, strict=True)}
        return RigidBody(Sphere(about + arm, 1.0), about=about, motion=motion)

    law = Frictionless()
    cam = OnBody(dim, body_on, law, sliding="large")
    result = cam.problem.solve()
    still = OnBody(dim, Sphere(about + shift + Q @ arm, 1.0), law).problem.solve()
    table, expected = (r.tables["contact"] for r in (result, still))
    assert table.count("o") < len(table.x)
    for name in ("force", "n", "un"):
        mine = getattr(expected, name)
        np.testing.assert_allclose(
            getattr(table, name), mine, rtol=0, atol=1e-9 * np.abs(mine).max()
        )
    assert result.misfit < 1e-9
    # Forces pass through the centre: their moment about the axis is that of the resultant there.
    found = result.rigid_bodies["rigid body"]
    force = -table.force.sum(axis=0)
    np.testing.assert_allclose(found.contact[:dim], force, atol=1e-9 * np.abs(force).max())
    moment = np.cross(*(np.pad(v, (0, 3 - dim)) for v in (Q @ arm, force)))[-(len(names) - dim) :]
    np.testing.assert_allclose(found.contact[dim:], moment, atol=1e-8 * np.abs(force).max())
    # The same by a branch, along which the body turns.
    cam.u.x.array[:] = 0.0
    gammas[0].value = 0.0
    system = ParametricContact(cam.problem, gammas[0])
    cam.problem.solve()
    x = system.create_vector()
    cam.problem.write(x)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
    ended = system.result_at(branch.points[-1]).tables["contact"]
    size = np.abs(expected.force).max()
    np.testing.assert_allclose(ended.force, expected.force, rtol=0, atol=1e-7 * size)


def is_dry(table, friction):
    """Whether the friction of points that slip is mu p, and against the slip."""
    slips = np.isin(table.letters, ["+", "-", "s"])
    assert slips.sum() > 1
    shear = table.shear[slips]
    size = np.linalg.norm(shear, axis=1)
    np.testing.assert_allclose(size, friction * table.pressure[slips], rtol=1e-8)
    way = table.increment[slips]
    along = np.sum(way * shear, axis=1) / (size * np.linalg.norm(way, axis=1))
    assert along.max() < -1 + 1e-6
    assert np.abs(np.sum(table.increment * table.n, axis=1)).max() < 1e-12


def around(t, X, dim, press=0.08, angle=0.5):
    """Pressed down until t = 1, then led around the axis y through (0.4, ., -1)."""
    moved = np.zeros_like(X)
    moved[:, -1] = -press * min(t, 1.0)
    turn = angle * max(t - 1.0, 0.0)
    c, s = np.cos(turn), np.sin(turn)
    arm = X + moved
    arm = np.stack([arm[:, 0] - 0.4, arm[:, -1] + 1.0])
    turned = np.array([[c, s], [-s, c]]) @ arm
    moved[:, 0] = turned[0] + 0.4 - X[:, 0]
    moved[:, -1] = turned[1] - 1.0 - X[:, -1]
    return moved


@pytest.mark.parametrize(("dim", "cell"), [(2, "quad"), (2, "tri"), (3, "hex"), (3, "tet")])
@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
@pytest.mark.verifies(
    "spheres",
    "cylinders",
    "Coulomb",
    "quasi-static",
    "balance of forces",
    reference="closed form: slip around an axis, friction against it",
    aspects=("2D", "3D", "large sliding"),
)
def test_led_around(dim, cell, shape):
    """A block led around a cylinder or over a ball: forces balance, friction is mu p."""
    if dim == 2 and shape == "cylinder":
        pytest.skip("in the plane a cylinder is a Sphere")
    centre = (0.4, *[0.5] * (dim - 2), -1.0)
    obstacle = Sphere(centre, 1.0)
    if shape == "cylinder":
        obstacle = Cylinder(centre, (0.0, 1.0, 0.0), 1.0)
    led_block = OnBody(dim, obstacle, Coulomb(0.3), cell=cell, n=4 if dim == 2 else 3)
    times = [0.0, 0.5, 1.0, *np.linspace(1.1, 3.0, 20)]
    history = led_block.run(lambda t, X: around(t, X, dim), times)
    last = history.steps[-1].result
    table = last.tables["contact"]
    is_dry(table, 0.3)
    assert last.imbalance < 1e-9
    assert last.kkt_violation < 1e-9
    force = last.resultants["contact"]
    assert np.linalg.norm(force + last.support) < 1e-9 * np.linalg.norm(force)
    if shape == "sphere" and dim == 3:
        return
    # When all slips nothing but the frame changes any more, and the slip is the angle.
    slipping = [s for s in history.steps if set(s.result.tables["contact"].letters) <= {"o", "+", "-", "s"}]
    assert len(slipping) > 5
    first = slipping[-5].result.tables["contact"]
    closed_points = table.letters != "o"
    for name in ("pressure",):
        mine = getattr(table, name)
        np.testing.assert_allclose(getattr(first, name), mine, atol=1e-3 * mine.max())
    step = np.linalg.norm(table.increment[closed_points], axis=1)
    np.testing.assert_allclose(step, 0.5 * 0.1, rtol=1e-3)
    whole = np.linalg.norm((table.ut - first.ut)[closed_points], axis=1)
    print(step, whole)
