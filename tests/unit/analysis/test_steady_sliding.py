"""Steady sliding: benchmark numbers, one node in closed form, an independent quadratic problem."""

from mpi4py import MPI

import cases.squeal
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from cases._triangle import linear_triangle
from support.blocks import restore_statuses
from support.leaning_bodies import FASTEST, block, pad

import dolfinx.fem.petsc
import ufl
from dolfinx import fem

from dolfinx_contact.analysis import SteadySliding
from dolfinx_contact.laws import PLUS

#: Onset and frequency by damping, eigenvalues of largest growth at F = 0.5 and 1 (damping 0.02).
ONSET = {
    2: {
        0.005: (0.15614648, 3.489047),
        0.02: (0.22210131, 3.480986),
        0.1: (0.97595809, 3.345302),
    },
    4: {
        0.005: (0.18507002, 3.994371),
        0.02: (0.37678558, 2.954100),
        0.1: (0.94991906, 2.930980),
    },
}


@pytest.mark.ranks(2)
@pytest.mark.parametrize("n", ONSET)
def test_squeal_has_its_onset(n):
    for damping, (friction, frequency) in ONSET[n].items():
        sliding = SteadySliding(pad(n), (-1.0, 0.0), density=1.0, damping=damping)
        onset = sliding.onset()
        assert onset.friction == pytest.approx(friction, abs=1e-6)
        assert onset.frequency == pytest.approx(frequency, abs=1e-6)
        assert abs(sliding.modes(onset.friction).growth) < 1e-9
        sliding.destroy()


@pytest.mark.parametrize("n", FASTEST)
def test_squeal_has_its_growth_rates(n):
    sliding = SteadySliding(pad(n), (-1.0, 0.0), density=1.0, damping=0.02)
    for friction, expected in zip((0.5, 1.0), FASTEST[n], strict=True):
        modes = sliding.modes(friction)
        assert modes.eigenvalues[0] == pytest.approx(expected, abs=1e-9)
        assert modes.known_up_to == np.inf


@pytest.mark.parametrize("dense", [True, False])
@pytest.mark.verifies(
    "steady sliding", reference="closed form: growth and frequency of one node", aspects=("2D",)
)
def test_one_sliding_node_grows_at_its_closed_form(dense):
    """A node slipping to the left grows at sqrt((F k - kt)/m), and oscillates before that."""
    lmbda = 1.0
    mu = 1.0
    density = 3.0
    kt = (lmbda + 3 * mu) / 2
    k = (lmbda + mu) / 2
    m = density * 0.5 / 6  # of a linear triangle of area 1/2
    problem = linear_triangle(1, 0.3, lame=(lmbda, mu)).problem
    sliding = SteadySliding(problem, (-1.0, 0.0), density=density, dense=dense)
    assert sliding.modes(3.0).eigenvalues[0] == pytest.approx(np.sqrt((3 * k - kt) / m))
    assert sliding.modes(1.0).eigenvalues[0] == pytest.approx(1j * np.sqrt((kt - k) / m))
    other = SteadySliding(problem, (1.0, 0.0), density=density, dense=dense)
    assert other.modes(3.0).eigenvalues[0] == pytest.approx(1j * np.sqrt((kt + 3 * k) / m))


@pytest.mark.verifies(
    "steady sliding",
    "critical friction",
    reference="closed form: (lambda + 3 mu)/(lambda + mu)",
    aspects=("2D",),
)
def test_one_node_squeals_at_its_closed_form():
    problem = linear_triangle(1, 0.3).problem
    onset = SteadySliding(problem, (-1.0, 0.0), density=1.0).onset()
    critical = (100 + 3 * 82) / (100 + 82)
    assert (onset.friction, onset.frequency) == (pytest.approx(critical, rel=1e-6), 0.0)
    assert SteadySliding(problem, (1.0, 0.0), density=1.0).onset() is None


def dense(A):
    values = A.getValuesCSR()
    return scipy.sparse.csr_matrix((values[2], values[1], values[0])).toarray()


def by_hand(problem, slip, friction, density, C):
    """All lambda by rows of t and n at the contact nodes; one rank. With C a form or eta."""
    V = problem.V
    dim = problem.V.mesh.geometry.dim
    v = ufl.TrialFunction(V)
    w = ufl.TestFunction(V)

    def assembled(form):
        A = dolfinx.fem.petsc.assemble_matrix(fem.form(form))
        A.assemble()
        return dense(A)

    K = dense(problem.equations.bulk.stiffness(problem.u.x.array))
    M = assembled(density * ufl.dot(v, w) * ufl.dx)
    C = C * K if isinstance(C, float) else assembled(C)
    nodes = problem.surfaces[0].points.trace_nodes
    last = dim - 1
    free = ~problem.equations.fixed
    test = np.eye(len(K))
    keep = free.copy()
    for node in nodes:
        dofs = dim * node + np.arange(dim)
        keep[dofs[last]] = False
        # (t-row) - s F (n-row), s against the slip of the body, rn along +z.
        test[dofs[:last], dofs[last]] = np.asarray(slip)[:last] * friction
    K, C, M = ((test @ A)[np.ix_(keep, keep)] for A in (K, C, M))
    n = len(K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    B = np.block([[np.eye(n), np.zeros((n, n))], [np.zeros((n, n)), M]])
    values = scipy.linalg.eig(A, B)[0]
    return values[values.imag > -1e-9]


def rubbing(V, along):
    """Damping at the floor, of different size along each axis, and some of the stiffness."""
    v = ufl.TrialFunction(V)
    w = ufl.TestFunction(V)
    height = ufl.SpatialCoordinate(V.mesh)[len(along) - 1]
    at_bottom = ufl.conditional(ufl.lt(height, 1e-9), 1.0, 0.0)
    floor = sum(c * v[i] * w[i] for i, c in enumerate(along)) * at_bottom * ufl.ds
    return floor + 0.01 * ufl.inner(ufl.sym(ufl.grad(v)), ufl.sym(ufl.grad(w))) * ufl.dx


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.verifies(
    "steady sliding",
    reference="independent code: a dense quadratic eigenproblem in scipy",
    aspects=("3D",),
)
def test_squeal_agrees_with_the_quadratic_eigenproblem(quadratic):
    """Block that leans, slip in a skew direction; damping by stiffness and of another kind."""
    slip = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    alone = block(3, comm=MPI.COMM_SELF)
    C = rubbing(alone.V, (0.3, 0.1, 0.0)) if quadratic else 0.05
    expected = by_hand(alone, slip, 0.8, 2.0, C)
    problem = block(3)
    C = rubbing(problem.V, (0.3, 0.1, 0.0)) if quadratic else 0.05
    sliding = SteadySliding(problem, slip, density=2.0, damping=C)
    found = sliding.modes(0.8)
    away = np.abs(found.eigenvalues[:, None] - expected)
    size = np.abs(expected).max()
    assert away.min(axis=1).max() < 1e-8 * size
    assert away.min(axis=0).max() < 1e-8 * size
    assert found.growth == pytest.approx(expected.real.max(), abs=1e-8 * size)
    few = SteadySliding(problem, slip, density=2.0, damping=C, dense=False, count=8).modes(0.8)
    near = few.eigenvalues[np.abs(few.eigenvalues) < 0.8 * few.known_up_to]
    assert len(near) >= 2
    assert np.abs(near[:, None] - expected).min(axis=1).max() < 1e-7 * size


def test_steady_sliding_takes_the_directions_of_a_solution():
    """All points slipping to the right in the solution is the uniform direction."""
    problem = pad(4, friction=0.7)
    uniform = SteadySliding(problem, (1.0, 0.0), density=1.0, damping=0.02).modes(0.7)
    restore_statuses(problem, PLUS)
    found = SteadySliding(problem, "solution", density=1.0, damping=0.02).modes()
    np.testing.assert_allclose(found.eigenvalues[:5], uniform.eigenvalues[:5], atol=1e-9)


@pytest.mark.long
def test_the_squeal_demo_has_its_benchmark_numbers(folder):
    """Numbers of the benchmark, modes hidden by regularised friction, and the animation."""
    pad_options = ["--nx=2", "--ny=2", "--width=1", "--height=1", "--friction=0.5"]
    found = cases.squeal.main(
        [*pad_options, "--damping=0.02", "--slopes", "0.1", "2", "--frames=2", f"--output={folder}"]
    )
    expected = (*FASTEST[2][:1], *ONSET[2][0.02])
    assert found["growth"] + 1j * found["frequency"] == pytest.approx(expected[0], abs=1e-9)
    assert found["onset"] == pytest.approx(expected[1], abs=1e-6)
    assert found["onset_frequency"] == pytest.approx(expected[2], abs=1e-6)
    regularised = found["regularised"]
    assert found["growth"] > regularised["0.1"] > 0 > regularised["2"]
