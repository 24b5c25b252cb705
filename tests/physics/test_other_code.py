"""Histories and motions of blocks on a rigid floor, against Gauss-Seidel iterations in numpy.

The other code assembles the linear body with UFL, condenses it onto its contact nodes,

    A u - r = b,        r nodal forces of the floor,

and solves Signorini's and Coulomb's laws node by node in closed form. Steps of a history have the
stiffness A = K. In a motion by the theta scheme the displacement w = u_0 + h (1 - theta) v_0 +
theta h v_1 at the end of a step has A = M/(theta h^2) + theta K.
"""

from mpi4py import MPI

import numpy as np
import pytest
from support.blocks import box, facets
from support.histories import dragged

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import LinearElastic, lame

YOUNG, POISSON = 1000.0, 0.3
CELLS = ("tri", "quad")
SIZE = 0.01  # of the displacements


def seeds(number):
    """Numbers of random problems; --long runs those after the second."""
    return [0, 1, *(pytest.param(k, marks=pytest.mark.long) for k in range(2, number))]


class Body:
    """A linear body in numpy, of degree 1 on one rank; unknowns are numbered by node and axis.

    Attributes:
        K, M: stiffness in plane strain, lumped mass of density 1.
        floor, top: numbers of the unknowns on both sides, those of the floor from left to right.
    """

    def __init__(self, V):
        u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        lmbda, mu = lame(YOUNG, POISSON)
        eps = ufl.sym(ufl.grad(u))
        stress = 2 * mu * eps + lmbda * ufl.tr(eps) * ufl.Identity(2)
        self.K = fem.assemble_matrix(fem.form(ufl.inner(stress, ufl.grad(v)) * ufl.dx)).to_dense()
        mass = fem.assemble_matrix(fem.form(ufl.inner(u, v) * ufl.dx)).to_dense()
        self.M = np.diag(mass.sum(axis=1))
        x = V.tabulate_dof_coordinates()
        nodes = np.flatnonzero(np.isclose(x[:, 1], 0.0))
        nodes = nodes[np.argsort(x[nodes, 0])]
        self.floor = (2 * nodes[:, None] + [0, 1]).ravel()
        self.top = np.flatnonzero(np.repeat(np.isclose(x[:, 1], 1.0), 2))


def one_node(S, p, start, friction):
    """Solve S u - r = p of a node over y = 0 that slips from ``start``."""
    free = np.linalg.solve(S, p)
    if free[1] >= 0:
        return free
    rt, rn = S @ [start, 0.0] - p
    if rn >= 0 and abs(rt) <= friction * rn:
        return np.array([start, 0.0])
    sense = -np.sign(rt)
    ut = (p[0] + sense * friction * p[1]) / (S[0, 0] + sense * friction * S[0, 1])
    return np.array([ut, 0.0])


def settled(A, b, floor, given, start, friction):
    """Solve A u - r = b; return u and the forces r of the floor.

    Args:
        A, b: matrix and load of all unknowns.
        floor: numbers of the unknowns of the contact nodes.
        given: values of the prescribed unknowns, NaN where free.
        start: displacements from which the contact nodes slip, and first iterate.
        friction: coefficient of friction.
    """
    inside = np.isnan(given)
    inside[floor] = False
    held = ~np.isnan(given)
    b = b - A[:, held] @ given[held]
    inverse = np.linalg.inv(A[np.ix_(inside, inside)])
    back = A[np.ix_(floor, inside)] @ inverse
    S = A[np.ix_(floor, floor)] - back @ A[np.ix_(inside, floor)]
    load = b[floor] - back @ b[inside]
    u = start.copy()
    for _ in range(20000):
        before = u.copy()
        for at in (slice(i, i + 2) for i in range(0, len(u), 2)):
            p = load[at] - S[at] @ u + S[at, at] @ u[at]
            u[at] = one_node(S[at, at], p, start[at][0], friction)
        if np.abs(u - before).max() <= 1e-13 * SIZE:
            break
    whole = np.where(held, given, 0.0)
    whole[floor] = u
    whole[inside] = inverse @ (b[inside] - A[np.ix_(inside, floor)] @ u)
    return whole, S @ u - load


def deviations(step, u, r):
    """Return the largest deviations of a step from displacements and nodal forces."""
    table = step.result.tables["contact"]
    order = np.argsort(table.x[:, 0])
    forces = np.stack([table.along(table.rt), table.rn], axis=1)[order].ravel()
    return np.array([np.abs(step.state.displacement - u).max(), np.abs(forces - r).max()])


@pytest.mark.parametrize("seed", seeds(28))
@pytest.mark.verifies(
    "quasi-static",
    "Coulomb",
    reference="independent code: Gauss-Seidel iterations in numpy",
    aspects=("2D",),
)
def test_cyclic_histories_agree_with_another_code(seed):
    """A block is pressed and drawn to and fro in 48 steps; all numbers agree to 1e-11."""
    random = np.random.default_rng(seed)
    steps = 48
    n = int(random.integers(3, 6))
    friction = random.uniform(0.1, 0.6)
    problem, top = dragged(CELLS[seed % 2], n, law=lambda _: Coulomb(friction))
    phase = np.cumsum(random.uniform(0.1, 0.9, steps))
    aside = random.uniform(0.5, 1.5) * SIZE * np.sin(phase)
    down = SIZE * (-0.6 + 0.4 * np.cos(random.uniform(0.3, 1.1) * phase))
    motions = np.vstack([np.zeros(2), np.stack([aside, down], axis=1)])

    def load(time):
        top.x.array[:] = np.tile(motions[round(time)], len(top.x.array) // 2)

    history = QuasiStatic(problem, load).run(range(steps + 1), progress=False)
    body = Body(problem.V)
    u = np.zeros(len(body.K))
    statuses = set()
    for step, motion in zip(history.steps, motions[1:], strict=True):
        given = np.full(len(u), np.nan)
        given[body.top] = np.tile(motion, len(body.top) // 2)
        u, r = settled(body.K, np.zeros(len(u)), body.floor, given, u[body.floor], friction)
        sizes = np.array([SIZE, np.abs(r).max()])
        assert (deviations(step, u, r) < 1e-11 * sizes).all()
        statuses |= set(step.status)
    assert len(statuses) >= 3  # sticking, slipping both ways, or open


@pytest.mark.parametrize("seed", seeds(24))
@pytest.mark.verifies(
    "NSCD motion",
    "Coulomb",
    reference="independent code: Gauss-Seidel iterations in numpy",
    aspects=("2D",),
)
def test_motions_agree_with_another_code(seed):
    """A block is thrown at a floor and followed through 60 steps; numbers agree to 1e-10."""
    random = np.random.default_rng(seed)
    steps, h = 60, 0.02
    n = int(random.integers(3, 6))
    friction = random.uniform(0.1, 0.6)
    theta = random.uniform(0.55, 1.0)
    speed = np.array([random.uniform(-0.5, 0.5), random.uniform(-0.5, -0.1)])
    domain = box(MPI.COMM_WORLD, n, CELLS[seed % 2])
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), fem.Function(V)
    floor = HalfSpace((0.0, 0.0), (0.0, 1.0))
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=floor, law=Coulomb(friction))
    energy = LinearElastic.from_young(YOUNG, POISSON).energy(u) + u[1]  # gravity 1
    problem = ContactProblem(energy * ufl.dx, u, [surface])
    v.x.array[:] = np.tile(speed, len(v.x.array) // 2)
    motion = NSCD(problem, 1.0, dt=h, velocity=v, theta=theta, mass="lumped")
    history = motion.run(h * np.arange(steps + 1), progress=False)
    body = Body(V)
    f = -body.M @ np.tile([0.0, 1.0], len(body.M) // 2)
    A = body.M / (theta * h**2) + theta * body.K
    u, v = np.zeros(len(f)), np.tile(speed, len(f) // 2)
    free = np.full(len(f), np.nan)
    sizes, errors = [], []
    for step in history.steps:
        w = u + h * (1 - theta) * v
        b = body.M @ (w / (theta * h**2) + v / h) - (1 - theta) * body.K @ u + f
        u, r = settled(A, b, body.floor, free, w[body.floor], friction)
        v = (u - w) / (theta * h)
        errors.append(deviations(step, u, r))
        sizes.append([np.abs(u).max(), np.abs(r).max()])
    assert (np.max(errors, axis=0) < 1e-10 * np.max(sizes, axis=0)).all()
