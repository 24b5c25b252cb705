"""Laws beside Coulomb's in motions: friction of velocities, compliance, adhesion."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets
from support.histories import klarbring
from support.leaning_bodies import FASTEST, on_box, pad

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    RCCM,
    BilinearCohesive,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    NormalCompliance,
    Regularised,
    RigidBody,
)
from dolfinx_contact.analysis import SteadySliding
from dolfinx_contact.evolution import NSCD, NoContinuation, QuasiStatic
from dolfinx_contact.materials import Axisymmetric, LinearElastic

COMM = MPI.COMM_WORLD


def block(law, *, young=1e6, height=0.0, weight=10.0):
    """A unit block of four squares above a floor."""
    domain = box(COMM, 2, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=HalfSpace((0, -height), (0, 1)), law=law
    )
    energy = (LinearElastic.from_young(young, 0.0).energy(u) + weight * u[1]) * ufl.dx
    return ContactProblem(energy, u, [surface])


def velocity(problem, x, y):
    v = fem.Function(problem.V)
    v.x.array[:] = np.tile([x, y], len(v.x.array) // 2)
    return v


@pytest.mark.parametrize(
    ("scheme", "theta", "mass"),
    [
        ("theta", 0.5, "redistributed"),
        pytest.param("theta", 0.5, "consistent", marks=pytest.mark.long),
        pytest.param("theta-euler", 1.0, "lumped", marks=pytest.mark.long),
        pytest.param("modified-theta", 0.6, "redistributed", marks=pytest.mark.long),
        pytest.param("modified-theta", 0.6, "lumped", marks=pytest.mark.long),
    ],
)
@pytest.mark.verifies(
    "friction of speed and time",
    "regularised friction",
    "NSCD motion",
    reference="closed form: sinh(v/eps) falls as an exponential",
    aspects=("2D",),
)
def test_friction_of_the_velocity_decays_as_its_closed_form(scheme, theta, mass):
    """v' = -mu g tanh(v/eps): sinh(v/eps) falls as an exponential of time."""
    eps = 0.5
    mu = 0.3
    g = 10.0
    end = 0.4
    t = np.linspace(0.0, end, 2001)
    speed = eps * np.arcsinh(np.sinh(1.0 / eps) * np.exp(-mu * g * t / eps))
    way = np.trapezoid(speed, t)
    off = []
    for dt in (0.02, 0.01):
        problem = block(Regularised(Coulomb(mu), width=1e-6, speed=eps), young=1e8, weight=g)
        bound = problem.surfaces[0].law.friction.friction
        bound.value = 0.0  # at rest under its weight
        problem.solve()
        bound.value = mu
        how = dict(scheme=scheme, theta=theta, mass=mass, velocity=velocity(problem, 1.0, 0.0))
        history = NSCD(problem, 1.0, dt=dt, **how).run([0.0, end], progress=False)
        off.append(COMM.allreduce(np.abs(problem.u.x.array[::2] - way).max(), op=MPI.MAX) / way)
        assert history.energies.dissipated == pytest.approx(0.5 * (1 - speed[-1] ** 2), rel=0.05)
    assert off[1] < 0.6 * off[0]
    assert off[1] < 0.02


@pytest.mark.ranks(2)
def test_a_speed_is_needed():
    with pytest.raises(ValueError, match="lacks a speed"):
        NSCD(block(Regularised(Coulomb(0.3), width=1e-3)), 1.0, dt=0.01)


@pytest.mark.long
@pytest.mark.verifies(
    "normal compliance",
    "NSCD motion",
    reference="closed form: half a period of an oscillator",
    aspects=("2D",),
)
def test_stiff_block_on_springs_rebounds_after_half_a_period():
    """A stiff block on springs: half a period of an oscillator in contact, and away again."""
    C = 1e4
    v0 = 1.0
    problem = block(NormalCompliance(C), young=1e8, height=0.0, weight=0.0)
    motion = NSCD(problem, 1.0, dt=1e-4, velocity=velocity(problem, 0.0, -v0), mass="lumped")
    history = motion.run([0.0, 0.04], progress=False)
    force = np.array([s.result.resultants["contact"][1] for s in history.steps])
    t = np.array([s.time for s in history.steps])
    half = np.pi / np.sqrt(C)
    np.testing.assert_allclose(t[force > 1e-3 * force.max()][-1], half, rtol=0.02)
    assert force.max() == pytest.approx(v0 * np.sqrt(C), rel=0.01)
    assert force.sum() * 1e-4 == pytest.approx(2 * v0, rel=0.01)
    # The law is taken at the end of a step, which dissipates as much of an oscillation.
    lost = 0.5 * np.pi / 2 * np.sqrt(C) * 1e-4
    assert history.energies.residue == pytest.approx(lost, rel=0.02)


@pytest.mark.verifies(
    "RCCM adhesion",
    "NSCD motion",
    "energies of motions",
    reference="closed form: the cost of the bond",
    aspects=("2D",),
)
def test_broken_bond_costs_its_work():
    """A block flying off loses the work w of its bond from its kinetic energy."""
    w = 0.1
    C = 1e3
    problem = block(RCCM(C, C, w), young=1e7, weight=0.0)
    v = velocity(problem, 0.0, 1.0)
    motion = NSCD(problem, 1.0, dt=5e-4, velocity=v, mass="lumped")
    history = motion.run([0.0, 0.06], progress=False)
    e = history.energies
    u = problem.table(problem.surfaces[0]).un.min()
    assert u > 4 * np.sqrt(w / C)
    left = w * (1 - w / C / (2 * u**2))  # work of the bond up to there
    assert e.damage + e.stored == pytest.approx(left, rel=0.01)
    assert 0.5 - e.kinetic == pytest.approx(left, rel=0.02)
    assert abs(e.residue) < 0.03 * w


@pytest.mark.long
@pytest.mark.verifies(
    "bilinear cohesion",
    "NSCD motion",
    reference="closed form: the cost of the interface",
    aspects=("2D",),
)
def test_broken_interface_costs_its_work():
    """The same of an interface by energy and dissipation, whose cost is exact."""
    problem = block(BilinearCohesive(10.0, 0.005, 0.015), young=1e7, weight=0.0)
    motion = NSCD(problem, 1.0, dt=5e-4, velocity=velocity(problem, 0.0, 1.0), mass="lumped")
    e = motion.run([0.0, 0.06], progress=False).energies
    assert problem.table(problem.surfaces[0]).un.min() > 0.02
    assert e.damage == pytest.approx(0.1, rel=1e-9)
    assert 0.5 - e.kinetic == pytest.approx(0.1, rel=0.02)
    assert abs(e.residue) < 0.03 * 0.1


@pytest.mark.ranks(2)
@pytest.mark.parametrize("what", ["velocity", "damping"])
def test_motion_refuses_data_that_differ_between_ranks(what):
    problem = block(Coulomb(0.3))
    other = velocity(problem, 0.0, 0.0) if what == "velocity" else (1.0, 0.0)
    given = {what: other if COMM.rank > 0 else None}
    if COMM.size == 1:
        NSCD(problem, 1.0, dt=0.1, **given)
        return
    with pytest.raises(ValueError, match=r"differs? between ranks"):
        NSCD(problem, 1.0, dt=0.1, **given)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "bodies of revolution",
    "NSCD motion",
    reference="closed form: the kinetic energy of a cylinder",
    aspects=("2D",),
)
def test_falling_body_of_revolution_has_all_its_mass():
    """A falling cylinder of radius and height 1 has the mass of its whole volume."""
    domain = box(COMM, 3, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    floor = HalfSpace((0, -5.0), (0, 1))
    surface = ContactSurface(
        u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(0.3), axisymmetric=True
    )
    energy = Axisymmetric(LinearElastic.from_young(1e3, 0.3)).energy(u)
    problem = ContactProblem(energy * ufl.dx, u, [surface])
    for mass in ("consistent", "lumped", "redistributed"):
        v = velocity(problem, 0.0, -2.0)
        u.x.array[:] = 0.0
        motion = NSCD(problem, 3.0, dt=0.1, velocity=v, mass=mass)
        history = motion.run([0.0, 0.2], start=problem.snapshot(), progress=False)
        assert history.energies.kinetic == pytest.approx(0.5 * 3.0 * np.pi * 4.0, rel=1e-12)


@pytest.mark.ranks(2)
@pytest.mark.verifies(
    "normal compliance",
    "energies of motions",
    "energies of histories",
    reference="closed form: springs hold C/2 un^2",
    aspects=("2D",),
)
@pytest.mark.parametrize("moves", [True, False])
def test_springs_of_a_compliant_floor_store_the_exact_energy(moves):
    """The mean force times the way is exact for linear springs, from where they are at rest."""
    C = 200.0
    domain = box(COMM, 2, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    below = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=NormalCompliance(C))
    bulk = LinearElastic.from_young(1e3, 0.3).energy(u) * ufl.dx
    if moves:
        problem = ContactProblem(bulk, u, [below])
        motion = NSCD(problem, 1.0, dt=0.01, velocity=velocity(problem, 0.0, -1.0))
        history = motion.run([0.0, 0.05], progress=False)
    else:
        top = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
        held = fem.Function(V)

        def load(t):
            held.x.array[1::2] = -0.01 * t

        problem = ContactProblem(bulk, u, [below], bcs=[fem.dirichletbc(held, top)])
        history = QuasiStatic(problem, load).run([0.0, 0.3, 1.0], progress=False)
        assert abs(history.energies.residue) < 1e-12
    assert len(history.steps) > 1
    table = history.steps[-1].result.tables["contact"]
    assert table.un.max() < -1e-3
    springs = C / 2 * np.sum(table.area * table.un**2)
    inner = COMM.allreduce(fem.assemble_scalar(fem.form(bulk)))
    assert history.energies.stored == pytest.approx(inner + springs, rel=1e-9)


def slides(friction):
    """The pad of 2 x 2 squares on a floor going to the right, and the floor's way."""
    domain = mesh.create_unit_square(COMM, 2, 2, mesh.CellType.quadrilateral)
    way = fem.Constant(domain, 0.0)
    given = {"x": way, "y": 0.02}
    floor = RigidBody(HalfSpace((0, 0), (0, 1)), about=(0, 0), motion=given, held=["rz"])
    problem = on_box(domain, floor=floor, friction=friction)
    problem.solve()
    return problem, way


@pytest.mark.parametrize("friction", [pytest.param(f, marks=pytest.mark.long) for f in (0.1, 0.5)])
@pytest.mark.verifies(
    "steady sliding",
    "NSCD motion",
    reference="itself: the eigenvalue of steady sliding, from a motion",
    aspects=("2D",),
)
def test_perturbed_motion_grows_as_the_squeal_mode(friction):
    """A perturbed motion has the eigenvalue of largest growth of steady sliding.

    The theta method with 1/2 maps exp(lambda h) to (1 + lambda h/2)/(1 - lambda h/2).
    """
    problem, way = slides(friction)

    def load(t):
        way.value = t

    QuasiStatic(problem, load).run([0.0, 0.5, 1.0, 2.0, 3.0])
    assert set(problem.table(problem.surfaces[0]).status) == {"-"}
    modes = SteadySliding(pad(2), (-1.0, 0.0), density=1.0, damping=0.02).modes(friction)
    expected = modes.eigenvalues[0]
    if friction == 0.5:
        assert expected == pytest.approx(FASTEST[2][0], abs=1e-9)
    assert (expected.real > 0) == (friction == 0.5)
    steady = problem.u.x.array.copy()
    velocity = fem.Function(problem.V)
    h = 0.02
    mode = modes.real.x.array + 1j * modes.imaginary.x.array
    mode *= 1e-5 / COMM.allreduce(np.abs(mode).max(), op=MPI.MAX)
    problem.u.x.array[:] += mode.real
    velocity.x.array[:] = (expected * mode).real
    given = {"mass": "consistent", "damping": (0.0, 0.02), "velocity": velocity}
    motion = NSCD(problem, 1.0, dt=h, load=load, **given)
    seen = []

    def observer(step):
        assert set(step.status) == {"-"}
        seen.append(problem.u.x.array - steady)

    motion.run([3.0, 6.0], start=problem.snapshot(), observer=observer, progress=False)
    y = np.array(seen)  # y_k+2 = a y_k+1 + b y_k
    known = np.stack([y[1:-1].ravel(), y[:-2].ravel()])
    a, b = np.linalg.solve(*(COMM.allreduce(known @ v) for v in (known.T, y[2:].ravel())))
    root = max(np.roots([1.0, -a, -b]), key=lambda r: r.imag)
    found = 2 / h * (root - 1) / (root + 1)
    assert found == pytest.approx(expected, abs=1e-4)


@pytest.mark.long
@pytest.mark.verifies(
    "jumps", "NSCD motion", reference="closed form: Klarbring's node beyond g = 3", aspects=("2D",)
)
def test_klarbring_node_opens_in_a_motion():
    """Beyond g = 3 no equilibrium continues; the motion from there ends open, and goes on so."""
    problem, g = klarbring()
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: setattr(g, "value", t))
    with pytest.raises(NoContinuation):
        evolution.run([0.0, 1.0, 2.0, 2.9, 4.0], locate_jumps=True, progress=False)
    motion = NSCD(problem, 1.0, dt=0.05, mass="lumped", damping=(1.0, 0.0))
    start = problem.snapshot()
    g.value = 3.01
    history = motion.settle(200.0, start=start, progress=False)
    assert history.reason == "the body is at rest"
    (table,) = history.steps[-1].result.tables.values()
    (at,) = np.flatnonzero(table.letters == "o")
    found = table.along(table.ut)[at], table.un[at]
    np.testing.assert_allclose(found, ((1 - 2 * 3.01) / 3, (3.01 - 2) / 3), atol=2e-3)
    state = history.steps[-1].state
    after = evolution.run([3.01, 3.02, 4.0], start=state, progress=False)
    assert after.complete
    (table,) = after.steps[-1].result.tables.values()
    found = table.along(table.ut)[at], table.un[at]
    np.testing.assert_allclose(found, (-7 / 3, 2 / 3), rtol=1e-9)
    assert history.energies.dissipated > 0
