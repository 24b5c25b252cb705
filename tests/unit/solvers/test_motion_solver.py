"""What a step of a motion is solved with: one product a residual, short solves, a polynomial."""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import block as static_block
from support.blocks import box, facets

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact._forcing import Forcing
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.solvers.hierarchy import condition
from dolfinx_contact.solvers.surface_filter import SurfaceFilter

COMM = MPI.COMM_WORLD


def largest(values):
    return COMM.allreduce(float(np.max(np.abs(values), initial=0.0)), op=max)


def thrown(n, dt, solver="amg", comm=COMM, **given):
    """A motion of a cube that hits a rough floor askew, its weight, and the top of the cube."""
    domain = box(comm, n, "hex")
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V)
    velocity = fem.Function(V)
    weight = fem.Constant(domain, 3.0)
    velocity.interpolate(lambda x: np.array([1.0 + x[2], 0.3 - x[0], -1.0 - 0.4 * x[0]]))
    surface = ContactSurface(
        u, facets(domain, 2, 0.0), obstacle=HalfSpace((0, 0, 0), (0, 0, 1)), law=Coulomb(0.3)
    )
    problem = ContactProblem(
        LinearElastic.from_young(100.0, 0.3).energy(u) * ufl.dx + weight * u[2] * ufl.dx,
        u,
        [surface],
        petsc_options={"linear_solver": solver, "snes_rtol": 1e-10},
    )
    return NSCD(problem, 1.0, dt=dt, velocity=velocity, **given), weight


@pytest.mark.ranks(2)
@pytest.mark.parametrize(
    "given",
    [
        {},
        {"scheme": "modified-theta", "theta": 0.6, "mass": "lumped", "damping": (0.3, 1e-3)},
        {"scheme": "theta-euler", "theta": 0.7, "mass": "consistent"},
    ],
    ids=lambda given: given.get("scheme", "default"),
)
def test_residual_by_one_product(given):
    """It is that of the terms one by one, by assembly, as steps, lengths and loads change."""
    motion, weight = thrown(3, 0.02, **given)
    body = motion.problem.equations.bulk
    noise = np.random.default_rng(COMM.rank)
    for number, (length, load) in enumerate([(0.02, 3.0), (0.02, 3.0), (0.01, 3.0), (0.01, 9.0)]):
        time = 0.0 if number == 0 else motion._accepted.time
        weight.value = load
        motion.run([time, time + length], progress=False)
        for scale in (1.0, 1e-3):
            w = fem.Function(motion.problem.V)
            w.x.array[:] = body.origin
            w.x.array[:] += scale * noise.standard_normal(len(w.x.array))
            w.x.scatter_forward()
            rows = body.affine_residual(w.x.array)
            terms = body.residual_at(w.x.array)
            assert largest(rows - terms) < 1e-12 * largest(terms)
            assert largest(terms) > 0


def test_condition_is_that_of_the_scaled_matrix():
    motion, _ = thrown(3, 0.02)
    motion.run([0.0, 0.02], progress=False)
    K = motion.problem.equations.bulk.stiffness(motion.problem.u.x.array)
    found = condition(K, 200)
    x, y = K.createVecs()
    start, end = K.getOwnershipRange()
    dense = np.zeros(K.getSize())
    for i in range(K.getSize()[0]):
        x.set(0.0)
        if start <= i < end:
            x.array[i - start] = 1.0
        K.mult(x, y)
        dense[start:end, i] = y.array_r
    dense = COMM.allreduce(dense)
    root = np.sqrt(dense.diagonal())
    values = np.linalg.eigvalsh(dense / np.outer(root, root))
    assert found == pytest.approx(values[-1] / values[0], rel=1e-3)
    assert condition(K, 20) == pytest.approx(found, rel=0.3)


@pytest.mark.parametrize(("dt", "kind"), [(0.02, "ksp"), (0.2, "gamg")])
def test_polynomial_where_steps_are_short(dt, kind):
    """It stands for a hierarchy only there, and either finds what a direct solver finds."""
    found = []
    for solver in ("amg", "direct"):
        motion, _ = thrown(5, dt, solver)
        history = motion.run(np.linspace(0.0, 6 * dt, 7), progress=False)
        linear = motion.problem.linear_solver
        assert linear.name == solver
        if solver == "amg":
            assert linear.hierarchy.kind == linear.hierarchy.pc.getType() == kind
        found.append([s.result.tables["contact"].force for s in history.steps])
        letters = set("".join(s.status for s in history.steps))
        assert "s" in letters
        assert len(letters) > 1
    size = np.abs(found[1]).max()
    assert size > 0
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-7 * size)


@pytest.mark.ranks(2)
def test_static_problems_keep_their_hierarchy():
    problem = static_block(cell="hex", n=4, options={"linear_solver": "amg"})
    problem.solve()
    assert problem.linear_solver.hierarchy.pc.getType() == "gamg"


@pytest.mark.ranks(2)
def test_forcing_in_motion():
    """A step that would end near the target goes there; statuses that change ask for little."""
    forcing = Forcing.in_motion()
    forcing.restart(warm=True)
    assert forcing.tolerance(1.0, 1e-8, 1.0) == 3e-2
    assert forcing.tolerance(0.1, 1e-8, 0.5) == 3e-2
    assert forcing.tolerance(1e-2, 1e-8, 0.0) == pytest.approx(9e-3)  # leaves 9e-5
    forcing.restart(warm=True)
    forcing.tolerance(0.1, 1e-8, 1.0)
    assert forcing.tolerance(5e-4, 1e-8, 0.0) == pytest.approx(0.1 * 1e-8 / 5e-4)
    tightened = 0
    while forcing.tighten():
        tightened += 1
    assert tightened == 3


# -- every solve by multigrid ----------------------------------------------------------------------


@pytest.mark.ranks(2)
def test_krylov_vectors_vanish_on_the_surface(monkeypatch):
    """Solves begin with an application of the filter: later ones have nothing left on s."""
    shares = []
    apply = SurfaceFilter.apply

    def watched(self, pc, r, z):
        squares = np.sum(r.array_r[self.surface.local] ** 2), np.sum(r.array_r**2)
        part, whole = self.comm.allreduce(np.array(squares))
        shares.append(np.sqrt(part / whole))
        apply(self, pc, r, z)

    monkeypatch.setattr(SurfaceFilter, "apply", watched)
    problem = static_block(cell="hex", n=5, options={"linear_solver": "amg"})
    result = problem.solve()
    assert result.reason == "full steps"
    krylov = sum(s.krylov for s in result.history)
    assert len(shares) == krylov + result.iterations
    assert np.count_nonzero(np.array(shares) > 1e-8) <= result.iterations
    assert krylov > result.iterations
