"""Motions and stability: squeal grows as the analysis says, lost equilibria end at rest."""

from mpi4py import MPI

import numpy as np
import pytest
from support.histories import klarbring
from support.leaning_bodies import FASTEST, on_box, pad

from dolfinx import fem, mesh

from dolfinx_contact import HalfSpace, RigidBody
from dolfinx_contact.analysis import SteadySliding
from dolfinx_contact.evolution import NSCD, NoContinuation, QuasiStatic

COMM = MPI.COMM_WORLD


def slides(friction):
    """The pad of 2 x 2 squares on a floor that goes to the right, and the floor's way."""
    domain = mesh.create_unit_square(COMM, 2, 2, mesh.CellType.quadrilateral)
    way = fem.Constant(domain, 0.0)
    given = {"x": way, "y": 0.02}
    floor = RigidBody(HalfSpace((0, 0), (0, 1)), about=(0, 0), motion=given, held=["rz"])
    problem = on_box(domain, floor=floor, friction=friction)
    problem.solve()
    return problem, way


@pytest.mark.chatty
@pytest.mark.parametrize("friction", [pytest.param(f, marks=pytest.mark.long) for f in (0.1, 0.5)])
@pytest.mark.verifies(
    "steady sliding",
    "NSCD motion",
    reference="itself: the eigenvalue of steady sliding, from a motion",
    aspects=("2D",),
)
def test_squeal(friction):
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
@pytest.mark.chatty
@pytest.mark.verifies(
    "jumps", "NSCD motion", reference="closed form: Klarbring's node beyond g = 3", aspects=("2D",)
)
def test_klarbring_by_dynamics():
    """Beyond g = 3 no equilibrium continues; the motion from there ends open, and goes on so."""
    problem, g = klarbring()
    problem.solve()
    evolution = QuasiStatic(problem, lambda t: setattr(g, "value", t))
    with pytest.raises(NoContinuation):
        evolution.run([0.0, 1.0, 2.0, 2.9, 4.0], progress=False)
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
