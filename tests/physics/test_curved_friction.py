"""Friction on curved obstacles in large sliding, and rigid bodies that turn."""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from support.curved_obstacles import (
    OBSTACLES,
    OnBody,
    block,
    errors_of_differences,
    pressed_and_led,
    remembering,
    shaken_and_direction,
)
from support.demo_numbers import run
from support.sliding_bodies import smooth

from dolfinx import fem

from dolfinx_contact import (
    Coulomb,
    Cylinder,
    LevelSet,
    RigidBody,
    Sphere,
)
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD

# -- slips along surfaces --------------------------------------------------------------------------


def led(obstacle, dim, places):
    """Increments of the slip, and normals, of contact nodes led from place to place (n, dim)."""
    problem = block(obstacle, cell="quad" if dim == 2 else "hex", n=2, law=Coulomb(0.3))
    (s,) = problem.surfaces
    nodes = s.points.vertex_nodes[: s.points.number]
    x = s.node_positions
    found = []
    memory = None
    for k, place in enumerate(places):
        u = np.zeros_like(x)
        u[nodes] = place - x[nodes]
        at = s.kinematics(u, None, memory)
        if k:
            found.append((at.increment, at.data.n, at.slip))
        whole = np.zeros_like(at.whole) if k == 0 else at.whole
        memory = Memory(whole, place=at.place)
    return found


def on_circle(angle, radius, number):
    turned = radius * np.array([np.sin(angle), np.cos(angle)])
    return np.tile(turned, (number, 1)), np.tile([np.cos(angle), -np.sin(angle)], (number, 1))


@pytest.mark.parametrize("step", [1e-9, 1e-3, 0.1, 0.11, 1.0, 2.5])
@pytest.mark.verifies(
    "spheres",
    "Coulomb",
    reference="closed form: arcs of circles",
    aspects=("2D", "large sliding"),
)
def test_a_point_led_along_a_circle_slips_by_the_arc(step):
    """A point moving along a circle slips by the arc, in one step up to half a turn."""
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


@pytest.mark.ranks(2)
@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
@pytest.mark.verifies(
    "spheres",
    "cylinders",
    "Coulomb",
    reference="closed form: great circles and helices",
    aspects=("3D", "large sliding"),
)
def test_friction_follows_great_circles_and_helices(kind):
    """Great circles on a sphere, helices on a cylinder."""
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


@pytest.mark.verifies(
    "level sets",
    "Coulomb",
    reference="closed form: the arc of an ellipse",
    aspects=("2D", "large sliding"),
)
def test_steps_on_an_ellipse_err_by_the_fifth_power():
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
        assert errors[1] < errors[0] / 12
        assert errors[2] < errors[1] / 12


# -- derivatives -----------------------------------------------------------------------------------

TURNED = {2: {"rz": 0.3}, 3: {"rx": 0.2, "ry": -0.3, "rz": 0.4}}


def on_turned(dim, shape, **given):
    """Return a body pressed on an obstacle rotating about (0.4, ..., -1)."""
    motion = TURNED[dim] | {"x": 0.02} | ({"y": -0.01} if dim == 3 else {})
    about = [0.4, *[0.5] * (dim - 2), -1.0]
    return RigidBody(shape, about=about, motion=motion, load={"y" if dim == 2 else "z": 5.0})


@pytest.mark.ranks(2, 3)
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
def test_the_jacobian_on_curved_obstacles_agrees_with_differences(
    name, cell, given, turned, remembers
):
    """Every status somewhere; normals, gaps and slips depending on the displacement."""
    dim = 2 if cell in ("tri", "quad") else 3
    shape = OBSTACLES[name]
    obstacle = on_turned(dim, shape) if turned else shape
    given = given | ({"sliding": "large"} if turned else {})
    problem = block(obstacle, cell=cell, n=2, law=Coulomb(0.3), **given)
    if remembers:
        problem = remembering(problem)
    eq = problem.equations
    motions = rates = []
    if turned:
        motions = eq.rigid.here(np.where(eq.rigid.fixed, eq.constraints.motions(), 0.03))
        rates = eq.rigid.here(np.where(eq.rigid.fixed, 0.0, 1.0))
    x, v = shaken_and_direction(problem, motions, rates)
    errors = errors_of_differences(problem, x, v, (3e-5, 3e-6))
    assert errors[0] < 1e-5
    assert errors[1] < 0.02 * errors[0] + 1e-9


# -- what turns, what slides -----------------------------------------------------------------------


@pytest.mark.each_value
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
def test_a_stuck_block_that_turns_with_its_body_keeps_sticking(shape, method, angle):
    """A stuck block turning with the body under it in one step sticks, its tractions turned."""
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
    step = problem.with_memory(block_on.evolution.memory)
    problem = problem.with_memory(step.equations.memory_after(step.evaluate()))
    still = problem.solve(expected=[problem.evaluate().statuses])
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
    found = problem.evaluate()
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


def is_dry(table, friction):
    """Return whether friction at slipping points is mu p and opposes the slip."""
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
    """Pressed down until t = 1, then moving around the axis y through (0.4, ., -1)."""
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


@pytest.mark.parametrize(
    ("dim", "cell", "shape"),
    [
        *((2, "quad", "sphere"), (3, "hex", "cylinder")),
        pytest.param(3, "tet", "sphere", marks=pytest.mark.long),
        pytest.param(2, "tri", "sphere", marks=pytest.mark.long),
        pytest.param(3, "hex", "sphere", marks=pytest.mark.long),
        pytest.param(3, "tet", "cylinder", marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "spheres",
    "cylinders",
    "Coulomb",
    "quasi-static",
    "balance of forces",
    reference="closed form: slip around an axis, friction against it",
    aspects=("2D", "3D", "large sliding"),
)
def test_friction_around_curved_obstacles_balances(dim, cell, shape):
    """A block led around a cylinder or over a ball: forces balance, friction is mu p."""
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
    tables = [s.result.tables["contact"] for s in history.steps]
    sliding = [t for t in tables if not np.any(t.letters == "k")][-5:]
    first = sliding[0]
    assert len(sliding) == 5
    np.testing.assert_allclose(first.pressure, table.pressure, atol=1e-3 * table.pressure.max())
    touching = table.letters != "o"
    step = np.linalg.norm(table.increment[touching], axis=1)
    np.testing.assert_allclose(step, 0.5 * 0.1, rtol=1e-3)
    whole = [np.linalg.norm(t.ut[touching], axis=1) for t in (first, table)]
    np.testing.assert_allclose(whole[1] - whole[0], 4 * 0.5 * 0.1, rtol=2e-2)


# -- against what is known otherwise ---------------------------------------------------------------


@pytest.mark.verifies(
    "NSCD motion",
    "energies of motions",
    "Coulomb",
    reference="closed form: the balance of energy",
    aspects=("2D", "large sliding"),
)
def test_motion_around_a_drum_loses_its_residue():
    """A block moves around a drum, and the energy residue falls with the steps."""
    rests = []
    for steps in (40, 80):
        on_drum = OnBody(2, Sphere((0.4, -1.0), 1.0), Coulomb(0.3), n=4)

        def load(t, on_drum=on_drum):
            on_drum.move(lambda X: around(1.0 + t**2, X, 2, angle=0.5))

        load(0.0)
        on_drum.problem.solve()
        motion = NSCD(on_drum.problem, 1e-3, dt=1.0 / steps, load=load, theta=1.0)
        last = motion.run([0.0, 1.0]).steps[-1].energies
        assert last.dissipated > 5.0
        rests.append(abs(last.residue) / last.external)
    assert rests[1] < 0.03
    assert rests[1] < 0.85 * rests[0]


# -- what is not there -----------------------------------------------------------------------------


# -- the demo --------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.verifies(
    "spheres",
    "hyperelastic bodies",
    "Coulomb",
    "quasi-static",
    reference="closed form: Euler's belt on a drum",
    aspects=("2D", "large sliding"),
)
def test_the_belt_has_the_tension_of_the_capstan_equation(folder, no_pictures):
    """T2/T1 = exp(mu alpha), and its convergence with cells and thickness."""
    off = []
    for n in (64, 128):
        names = run("belt", folder, n=n, steps=n // 2)
        assert names["history"].steps[-1].result.kkt_violation < 1e-9
        assert names["slid"] > 0.6 * names["pull"] > 3 * names["size"]
        ratio, thin = names["ratios"][-1], names["thin"]
        off.append(ratio / names["thick"] - 1)
    # A belt without thickness, to half a percent.
    assert ratio == pytest.approx(thin, rel=5e-3)
    assert thin == pytest.approx(np.exp(0.3 * np.pi), rel=1e-15)
    assert abs(off[1]) < 1e-3
    assert abs(off[1]) < 0.4 * abs(off[0])
    names = run("belt", folder, n=128, steps=64, thickness=0.02)
    assert names["ratios"][-1] == pytest.approx(names["thick"], rel=2e-3)
    assert names["ratios"][-1] < 0.995 * thin
