"""Bodies in motion: impacts, friction, energy, schemes, against closed forms and other codes."""

from mpi4py import MPI

import cases.bouncing_bar
import numpy as np
import pytest
from scipy.linalg import expm
from support.blocks import facets
from support.histories import COMM
from support.histories import falling_block as block
from support.moving_bar import Bar

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Frictionless,
    HalfSpace,
)
from dolfinx_contact.body.inertia import mass_matrix
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic, NeoHookean

QUAD = mesh.CellType.quadrilateral


def largest(values):
    return COMM.allreduce(float(np.max(np.abs(values), initial=0.0)), op=max)


def at_speed(problem, *speed):
    """A velocity, the same everywhere."""
    v = fem.Function(problem.V)
    v.x.array[:] = np.tile(speed, len(v.x.array) // len(speed))
    return v


def forces(history):
    return np.array([s.result.resultants["contact"] for s in history.steps])


def times(history):
    return np.array([history.start, *(s.time for s in history.steps)])


# -- a bar, step by step ---------------------------------------------------------------------------


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    ("scheme", "theta", "level", "mass", "restitution", "damping"),
    [
        ("theta", 0.5, "position", "redistributed", 0.0, (0.3, 1e-3)),
        ("theta", 0.6, "position", "lumped", 0.0, None),
        ("theta-euler", 0.7, "position", "redistributed", 0.0, None),
        ("modified-theta", 0.55, "position", "consistent", 0.0, (0.0, 1e-3)),
        ("theta", 0.5, "velocity", "lumped", 0.5, None),
        ("theta-euler", 0.5, "velocity", "consistent", 1.0, (0.3, 0.0)),
        ("modified-theta", 0.7, "velocity", "lumped", 0.0, None),
    ],
)
@pytest.mark.verifies(
    "NSCD motion",
    "restitution",
    "energies of motions",
    reference="independent code: a bar in numpy, scheme by scheme",
    aspects=("2D",),
)
def test_impact_of_a_bar_agrees_with_another_code(scheme, theta, level, mass, restitution, damping):
    """Forces, gaps and energies of a bar hitting the floor and leaving it, as another code's."""
    n = 6
    a, b = damping or (0.0, 0.0)
    problem = cases.bouncing_bar.bar(n, COMM, height=0.3)
    velocity = at_speed(problem, 0.0, -10.0)
    how = dict(scheme=scheme, theta=theta, level=level, mass=mass, restitution=restitution)
    motion = NSCD(problem, 1.0, dt=0.07, velocity=velocity, damping=damping, **how)
    history = motion.run([0.0, 0.09, 1.1], progress=False)
    oracle = Bar(n, mass, height=0.3, velocity=-10.0, damping=(a, b))
    wanted = oracle.run(times(history), scheme, theta, level, restitution)
    force = forces(history)[:, 1]
    assert 4 < np.count_nonzero(wanted[0]) < len(force) - 1
    np.testing.assert_allclose(force, wanted[0], rtol=0, atol=1e-9 * wanted[0].max())
    gaps = [s.result.tables["contact"].un.mean() for s in history.steps]
    np.testing.assert_allclose(gaps, wanted[1], rtol=0, atol=1e-9)
    account = [s.energies for s in history.steps]
    energy = [e.kinetic + e.stored - e.external for e in account]
    np.testing.assert_allclose(energy, wanted[2], rtol=0, atol=1e-9 * 500)
    if scheme == "theta" and theta == 0.5:
        assert max(abs(e.residue) for e in account) < 1e-10 * 500


@pytest.mark.verifies(
    "NSCD motion",
    "energies of motions",
    reference="closed form: rests on (1, 2), pressed by 1/2",
    aspects=("2D",),
)
def test_rod_rests_on_the_floor_for_one_period():
    """E = rho = 1, held at 1, u(x, 0) = (1 - x)/2, u(0) >= 0: rests on (1, 2), pressed by 1/2."""
    errors = []
    for n in (8, 16):
        domain = mesh.create_rectangle(COMM, [[0.0, 0.0], [1.0, 1.0]], [1, n], QUAD)
        V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        u = fem.Function(V)
        u.interpolate(lambda x: np.vstack([0 * x[0], (1 - x[1]) / 2]))
        high = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], 1))
        floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
        below = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Frictionless())
        energy = LinearElastic.from_young(1.0, 0.0).energy(u) * ufl.dx
        bcs = [fem.dirichletbc(np.zeros(2), high, V)]
        history = NSCD(ContactProblem(energy, u, [below], bcs=bcs), 1.0, dt=1 / n).run([0.0, 3.0])
        t = times(history)
        force = forces(history)[:, 1]
        exact = 0.5 * np.diff(np.clip(t, 1, 2)) / np.diff(t)
        un = [s.result.tables["contact"].un.mean() for s in history.steps]
        gap = np.abs(t[1:] - 1.5) - 0.5
        errors.append((np.abs(un - np.maximum(gap, 0) / 2).mean(), np.mean(np.abs(force - exact))))
        first, last = np.flatnonzero(force > 0.25)[[0, -1]]
        assert abs(t[first] - 1) < 1.5 / n
        assert abs(t[last + 1] - 2) < 1.5 / n
        account = history.energies
        assert abs(account.residue) < 1e-12
        assert abs(account.kinetic + account.stored + account.contact) < 1e-12
        errors[-1] += (account.contact / 0.125,)
    assert errors[1][0] < 0.6 * errors[0][0]
    assert errors[1][1] < 0.8 * errors[0][1]
    assert errors[1][2] < 0.6 * errors[0][2]


def thrown(n, **how):
    """A bar thrown at a floor that it touches, at the speed 10, until the waves have come back."""
    problem = cases.bouncing_bar.bar(n, COMM, weight=0.0, height=0.0)
    motion = NSCD(problem, 1.0, dt=1 / 3 / n, velocity=at_speed(problem, 0.0, -10.0), **how)
    return motion.run([0.0, 0.8], progress=False)


@pytest.mark.verifies("NSCD motion", reference="closed form: rho c v0 for 2 L/c", aspects=("2D",))
def test_bar_rebounds_with_its_speed():
    """Pressed by rho c v0 for 2L/c it comes back with v0: to 1 % on 400 cells, 5 % on 16."""
    history = thrown(16)
    t = times(history)
    force = forces(history)[:, 1]
    kept = Bar(16, weight=0.0, height=0.0, velocity=-10.0).run(t)[0]
    np.testing.assert_allclose(force, kept, rtol=0, atol=1e-9 * 300)
    assert abs(history.energies.residue) < 1e-10 * 500
    found = []
    for n in (16, 400):
        t = np.linspace(0.0, 0.8, round(2.4 * n) + 1)
        force = Bar(n, weight=0.0, height=0.0, velocity=-10.0).run(t)[0]
        rebound = force.sum() * t[1] / 10 - 10  # mean velocity
        last = t[np.flatnonzero(force > 150)[-1] + 1]
        inner = (t[1:] > 0.1) & (t[1:] < 0.5)
        found.append([rebound / 10, last / (2 / 3), force[inner].mean() / 300])
    np.testing.assert_allclose(found, 1.0, rtol=0, atol=0.05)
    np.testing.assert_allclose(found[1], 1.0, rtol=0, atol=0.01)


# -- blocks ----------------------------------------------------------------------------------------


def shaken(problem, size=1.0):
    """Return a deforming velocity vanishing at supports."""
    v = fem.Function(problem.V)
    dim = problem.V.mesh.geometry.dim

    def field(x):
        way = np.array([np.sin(2 * x[0]), np.cos(x[0]) * x[dim - 1], x[0] * x[1]])
        return size * way[:dim] * (1 - x[dim - 1])

    v.interpolate(field)
    return v


def viscous(problem, velocity):
    """A damping form: viscosity."""
    w = ufl.TestFunction(problem.V)
    return 2.0 * ufl.inner(ufl.sym(ufl.grad(velocity)), ufl.sym(ufl.grad(w))) * ufl.dx


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.verifies(
    "restitution",
    reference="closed form: the speed after, the impulse and the loss",
    aspects=("2D",),
)
def test_stiff_block_rebounds_with_its_restitution(e):
    """The block rebounds with e times its speed in the step of the impact."""
    problem, _ = block(material=LinearElastic.from_young(1e9, 0.3), height=0.1)
    how = dict(scheme="theta-euler", theta=1.0, level="velocity", mass="lumped", restitution=e)
    motion = NSCD(problem, 2.0, dt=0.01, velocity=at_speed(problem, 0.0, -3.0), **how)
    history = motion.run([0.0, 0.08], progress=False)
    hits = [k for k, f in enumerate(forces(history)[:, 1]) if f > 1e-6]
    assert len(hits) == 1
    assert len(history.steps) == 8  # also where it passes its first place, free of forces
    assert history.steps[hits[0]].time == pytest.approx(0.04)  # it would be there at 0.0333
    speeds = motion.velocity.x.array.reshape(-1, 2) - (0.0, 3.0 * e)
    assert largest(speeds) < 3e-5
    assert forces(history)[:, 1].sum() * 0.01 == pytest.approx(6.0 * (1 + e), rel=1e-5)
    assert history.energies.contact == pytest.approx(9.0 * (1 - e**2), abs=1e-4)


@pytest.mark.verifies(
    "NSCD motion", "Coulomb", reference="closed form: v0/(mu g), v0^2/(2 mu g)", aspects=("2D",)
)
def test_a_stiff_block_slides_and_stops():
    """It stops at v0/(mu g), after v0^2/(2 mu g), up to one step, dissipating all energy."""
    stiff = LinearElastic.from_young(1e9, 0.3)
    problem, _ = block(material=stiff, weight=10.0, friction=0.25)
    stop = 1 / 2.5
    dt = 0.4 / 18.5
    how = dict(scheme="theta-euler", theta=1.0, mass="lumped")
    motion = NSCD(problem, 1.0, dt=dt, velocity=at_speed(problem, 1.0, 0.0), **how)
    loss = []

    def watch(step):
        e = step.energies
        loss.append((step.time, 0.5 - e.kinetic, e.dissipated, step.status))

    motion.run([0.0, 0.5], observer=watch, progress=False)
    t, lost, spent = (np.array([row[k] for row in loss]) for k in range(3))
    np.testing.assert_allclose(spent, lost, rtol=0, atol=1e-8)
    stopped = next(row[0] for row in loss if row[3] == "kk")
    assert abs(stopped - stop) <= 1.01 * dt
    assert lost[-1] == pytest.approx(0.5, abs=1e-8)
    way = largest(problem.u.x.array[::2])
    assert abs(way - 0.2) <= dt
    # Coulomb's: the weight times mu times the way that mean velocities go.
    speed = np.sqrt(2 * np.append(0.5, 0.5 - lost).clip(0))
    np.testing.assert_allclose(
        np.diff(np.append(0.0, spent))[:15],
        2.5 * (np.diff(np.append(0.0, t)) * (speed[1:] + speed[:-1]) / 2)[:15],
        rtol=1e-6,
    )


@pytest.mark.parametrize(
    ("cell", "n", "degree", "damping"),
    [
        ("tri", 2, 1, None),
        ("tri", 2, 2, (0.2, 1e-3)),
        ("hex", 2, 1, "form"),
        ("tet", 1, 2, None),
    ],
)
@pytest.mark.verifies(
    "energies of motions",
    reference="theorem: theta = 1/2 keeps the energy",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_energy_is_kept(cell, n, degree, damping):
    """With theta = 1/2, a linear body and no impact the energy is constant to 1e-10."""
    problem, top = block(cell, n, degree=degree, weight=3.0, height=1.0, held=True)
    velocity = shaken(problem)
    if damping == "form":
        damping = viscous(problem, velocity)

    def load(t):
        top.x.array[:: problem.V.dofmap.index_map_bs] = 0.1 * (1 - np.cos(3 * t))

    motion = NSCD(problem, 2.0, dt=0.05, load=load, velocity=velocity, damping=damping)
    history = motion.run([0.0, 0.4], progress=False)
    account = history.energies
    total = account.at_start + abs(account.external)
    assert account.at_start > 0.1
    assert max(abs(s.energies.residue) for s in history.steps) < 1e-10 * total
    if damping is not None:
        assert account.damping > 1e-3 * total
    held = problem.equations.fixed
    assert largest(problem.u.x.array[: len(held)][held] - top.x.array[: len(held)][held]) < 1e-12


@pytest.mark.verifies(
    "energies of motions", reference="closed form: a body that drag slows", aspects=("2D",)
)
@pytest.mark.parametrize("theta", [0.5, 0.8])
def test_drag_takes_what_the_body_loses(theta):
    """m v' = -a m v by the theta scheme: velocities and the work of drag, step by step."""
    a, h, m = 2.0, 0.1, 3.0
    problem, _ = block(height=1.0)
    velocity = at_speed(problem, 0.3, 0.2)
    how = dict(theta=theta, mass="consistent", damping=(a, 0.0), velocity=velocity)
    history = NSCD(problem, m, dt=h, **how).run([0.0, 3 * h], progress=False)
    v = (
        np.array([0.3, 0.2])
        * ((1 - (1 - theta) * a * h) / (1 + theta * a * h)) ** np.arange(4)[:, None]
    )
    assert largest(velocity.x.array.reshape(-1, 2) - v[-1]) < 1e-12
    dragged = a * h * m * (v[1:] + v[:-1]) / 2 * (theta * v[1:] + (1 - theta) * v[:-1])
    wanted = dragged.sum(axis=1).cumsum()
    np.testing.assert_allclose([s.energies.damping for s in history.steps], wanted, rtol=1e-10)
    assert max(abs(s.energies.residue) for s in history.steps) < 1e-12


@pytest.mark.verifies(
    "energies of motions", "hyperelastic bodies", reference="itself: half the step", aspects=("2D",)
)
def test_hyperelastic_energy_error_is_of_second_order():
    """The energy error falls with the square of the steps."""
    found = []
    for dt in (0.02, 0.01):
        problem, _ = block("tri", 2, material=NeoHookean(60.0, 40.0), height=1.0)
        motion = NSCD(problem, 1.0, dt=dt, velocity=shaken(problem, 2.0))
        history = motion.run([0.0, 0.2], progress=False)
        found.append(np.abs([s.energies.residue for s in history.steps]).max())
    assert 1.8 < np.log2(found[0] / found[1]) < 2.2


def dense(matrix):
    return matrix.convert("dense").getDenseArray().copy()


@pytest.mark.verifies(
    "NSCD motion", reference="independent code: the matrix exponential of scipy", aspects=("2D",)
)
def test_schemes_have_their_order():
    """Against the exact solution of M u'' + C u' + K u = f, of the same matrices, nothing hit."""
    problem, _ = block("tri", 2, comm=MPI.COMM_SELF, weight=3.0, height=1.0, held=True)
    start = shaken(problem).x.array.copy()
    velocity = fem.Function(problem.V)
    how = dict(mass="consistent", damping=(0.2, 1e-3), velocity=velocity)
    end = 0.02
    n = len(start)
    motion = NSCD(problem, 2.0, dt=0.1, **how)
    body = motion.problem.equations.bulk
    K = dense(body.body.stiffness(np.zeros(n)))
    rows = body.body.residual_at(np.zeros(n))
    inner = np.flatnonzero(~problem.equations.fixed)
    M, C, K = (A[np.ix_(inner, inner)] for A in (dense(body.mass), dense(body.damping), K))
    m = len(inner)
    A = np.zeros((2 * m + 1, 2 * m + 1))
    A[:m, m : 2 * m] = np.eye(m)
    A[m:-1, :-1] = -np.linalg.solve(M, np.hstack([K, C]))
    A[m:-1, -1] = -np.linalg.solve(M, rows[inner])
    exact = (expm(end * A) @ np.concatenate([np.zeros(m), start[inner], [1.0]]))[:m]
    orders = {("theta", 0.5): 2, ("modified-theta", 0.5): 2, ("theta", 0.6): 1}
    for (scheme, theta), order in (orders | {("theta-euler", 0.5): 1}).items():
        errors = []
        for steps in (8, 16):
            problem.u.x.array[:] = 0.0
            velocity.x.array[:] = start
            motion = NSCD(problem, 2.0, dt=end / steps, scheme=scheme, theta=theta, **how)
            motion.run([0.0, end], start=problem.snapshot(), progress=False)
            errors.append(np.abs(problem.u.x.array[inner] - exact).max())
        assert order - 0.25 < np.log2(errors[0] / errors[1]) < order + 0.25


@pytest.mark.parametrize(("cell", "degree"), [("tri", 1), ("quad", 2), ("tet", 1), ("hex", 1)])
def test_mass_matrices_have_the_mass_of_the_body(cell, degree):
    """Nodes that may touch have no redistributed mass, and all other masses are positive."""
    problem, _ = block(cell, 2, degree=degree, comm=MPI.COMM_SELF)
    V = problem.V
    dim = problem.V.mesh.geometry.dim
    x = ufl.SpatialCoordinate(V.mesh)
    touching = np.repeat(np.isclose(V.tabulate_dof_coordinates()[:, dim - 1], 0), dim)
    for kind in ("consistent", "lumped", "redistributed"):
        M = dense(mass_matrix(V, 2.0 + x[0], kind, touching))
        assert np.abs(M - M.T).max() < 1e-15
        for i in range(dim):
            ones = np.tile(np.eye(dim)[i], len(M) // dim)
            assert ones @ M @ ones == pytest.approx(2.5)
        where = ~touching if kind == "redistributed" else np.ones(len(M), dtype=bool)
        assert not M[~where].any()
        assert np.linalg.eigvalsh(M[np.ix_(where, where)]).min() > 1e-4
        assert (
            kind == "consistent" or degree == 1 or np.count_nonzero(M - np.diag(M.diagonal())) == 0
        )


# -- what must not matter --------------------------------------------------------------------------


# -- bad input -------------------------------------------------------------------------------------


def test_motion_refuses_a_start_within_the_floor():
    problem, _ = block("tri", 2, height=-0.01)
    with pytest.raises(ValueError, match=r"within the obstacle, by up to 0.01") as info:
        NSCD(problem, 1.0, dt=0.1).run([0.0, 1.0])
    assert len(set(COMM.allgather(str(info.value)))) == 1
