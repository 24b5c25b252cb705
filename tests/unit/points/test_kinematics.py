"""Gap, slip and B at a state: their derivatives by Taylor, transposes, and who needs B to stay."""

from mpi4py import MPI

import numpy as np
import pytest
from support import histories as rigid_punches
from support import mortars, pairs
from support.blocks import block

import ufl

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    Cylinder,
    Frictionless,
    LevelSet,
    RigidBody,
    Sphere,
    materials,
)
from dolfinx_contact.points.memory import Memory

COMM = MPI.COMM_WORLD
RUBBER = materials.NeoHookean(600.0, 400.0)
STEEL = materials.LinearElastic.from_young(1000.0, 0.3)


def pressed(u, pair, tags):
    dim = u.function_space.mesh.geometry.dim
    bcs = [pairs.held(u, tags, tag, np.zeros(dim)) for tag in (1, 4)]
    return ContactProblem(STEEL.energy(u) * ufl.dx, u, [pair], bcs=bcs)


def pair(dim, cell, **given):
    """Two blocks whose faces match."""
    both = pairs.stacked(dim, cell, 2)
    degree = given.pop("degree", 1)
    u = pairs.displacement(both.mesh, degree)
    law = given.pop("law", Coulomb(0.2))
    return pressed(u, ContactPair(u, both, slave=2, master=3, law=law, **given), both.facet_tags)


def mortar(dim, **given):
    """Two blocks whose faces do not match, in the plane at an angle."""
    if dim == 2:
        both = mortars.stacked(2, 3, (0.0, 1.0), (0.0, 1.0), "tri", angle=0.7)
    else:
        both = mortars.solids(2, 3, (0.0, 1.0), (0.0, 1.0), "tet")
    u = pairs.displacement(both.mesh, given.pop("degree", 1))
    law = Coulomb(0.2)
    return pressed(u, ContactPair(u, both, slave=3, master=2, law=law, **given), both.facet_tags)


def crossing_floor(dim, **given):
    """A block on a rigid floor that is not along an axis."""
    slope = np.array([0.3, *[0.2] * (dim - 2)])
    floor = LevelSet(lambda x: x[dim - 1] + sum(a * x[i] for i, a in enumerate(slope)))
    return block(n=3, cell="tri" if dim == 2 else "tet", obstacle=floor, **given)


def round_floor(obstacle, cell, **given):
    """A block going far over a curved floor."""
    return block(n=3, cell=cell, obstacle=obstacle, material=RUBBER, law=Frictionless(), **given)


def rigid(dim, degree=1):
    names = ("x", "y", "rz") if dim == 2 else ("x", "y", "z", "rx", "ry", "rz")
    body = rigid_punches.punch(dim, load={names[dim - 1]: -3.0}, free=names[:1] + names[dim:],
                                 held=names[1 : dim - 1])  # fmt: skip
    method = None if degree == 1 else "integral"
    return rigid_punches.punched_block(body, dim, n=3, method=method, degree=degree)


def ball():
    """A sphere moving without rotating, over a nonlinear block."""
    about = (0.3, 0.5, 1.6)
    held = ("y", "rx", "ry", "rz")
    body = RigidBody(
        Sphere(about, 0.5), about=about, load={"z": -6.0}, motion={"x": 0.2}, held=held
    )
    return rigid_punches.punched_block(body, 3, n=3, law=Frictionless(), hyper=True)


CASES = {
    "floor, P1": lambda: crossing_floor(2),
    "floor, P1, quadrilaterals": lambda: block(n=3, cell="quad"),
    "floor, P1, Gauss points": lambda: crossing_floor(2, method="integral"),
    "floor, P2": lambda: crossing_floor(2, degree=2),
    "floor, P2, Gauss points": lambda: crossing_floor(2, degree=2, method="integral"),
    "floor, P2 and P2": lambda: crossing_floor(2, degree=2, multiplier_degree=2),
    "floor, mixed": lambda: crossing_floor(2, method="mixed"),
    "floor in space, P1": lambda: crossing_floor(3),
    "floor in space, P2": lambda: crossing_floor(3, degree=2),
    "pair, P1": lambda: pair(2, "tri"),
    "pair, P2": lambda: pair(2, "quad", degree=2),
    "pair, P2, Gauss points": lambda: pair(2, "quad", degree=2, method="integral"),
    "pair, mixed": lambda: pair(2, "tri", method="mixed"),
    "pair in space, P1": lambda: pair(3, "hex"),
    "pair in space, P2": lambda: pair(3, "tet", degree=2),
    "mortar": lambda: mortar(2),
    "mortar in space": lambda: mortar(3),
    "common points, P1": lambda: mortar(2, method="integral"),
    "common points, P2": lambda: mortar(2, degree=2, method="integral"),
    "common points in space": lambda: mortar(3, degree=2, method="integral"),
    "means over common points, P2": lambda: mortar(2, degree=2),
    "means over common points in space": lambda: mortar(3, degree=2),
    "a round face": lambda: mortars.pressed(COMM, 2, (1, 1)),
    "circle": lambda: round_floor(Sphere((0.3, -0.6), 0.5), "quad"),
    "circle, P2": lambda: round_floor(Sphere((0.3, -0.6), 0.5), "tri", degree=2),
    "cylinder": lambda: round_floor(Cylinder((0.3, 0.0, -0.6), (0.0, 1.0, 0.0), 0.5), "hex"),
    "sphere": lambda: round_floor(Sphere((0.3, 0.4, -0.6), 0.5), "hex"),
    "sphere, Gauss points": lambda: round_floor(
        Sphere((0.3, 0.4, -0.6), 0.5), "tet", method="integral"
    ),
    "wave": lambda: round_floor(LevelSet(lambda x: x[1] + 0.1 * ufl.sin(4.0 * x[0])), "tri"),
    "rigid body": lambda: rigid(2),
    "rigid body, P2": lambda: rigid(2, degree=2),
    "rigid body in space": lambda: rigid(3),
    "rigid ball": ball,
}


def wave(points, phase):
    """Vectors at points, shape (n, dim), breaking all symmetries."""
    dim = points.shape[1]
    k = np.array([[17.0, 5.0, 3.0], [20.0, 6.0, 2.0], [23.0, 7.0, 1.0]])[:dim, :dim]
    return np.sin(points @ k.T + phase + np.arange(dim))


class Case:
    """A surface, a state and a direction."""

    def __init__(self, name):
        self.problem = CASES[name]()
        self.eq = self.problem.equations
        (self.s,) = self.problem.surfaces
        (self.term,) = self.eq.terms
        x = self.s.node_positions
        self.u = 0.05 * wave(x, 0.3)
        self.v = wave(x, 2.9)
        if self.s.between_bodies:
            _, master = self.s.obstacle.opposite.sides
            self.u[master] *= -0.5
            self.v[master] *= -0.5
        q = np.arange(self.eq.rigid.size)
        self.q = 0.05 * np.cos(q)
        self.p = np.sin(2.0 * q + 1.0)
        if self.s.displaced is not None and self.eq.rigid.size:  # the ball does not turn
            self.p[self.problem.equations.dim :] = 0.0

    def at(self, h):
        """Kinematics of a state that is h along the direction."""
        u = (self.u + h * self.v).reshape(-1)
        return self.term.kinematics(u, self.q + h * self.p)

    @property
    def seen(self):
        """The direction at the owned nodes, seen from the rigid body."""
        return self.term.relative(self.v[: self.s.owned_nodes], self.p)

    def difference(self, f, h):
        return (f(self.at(h)) - f(self.at(-h))) / (2 * h)

    def sum(self, values):
        return self.problem.comm.allreduce(float(np.sum(values)))


def jump_rate(at, v):
    """Derivatives of the jumps along a displacement of the nodes."""
    step = at.operator.rate(v)
    return step if at.data.moved is None else np.einsum("nij,nj->ni", at.data.moved, step)


def largest(values):
    return COMM.allreduce(float(np.max(np.abs(values), initial=0.0)), op=max)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name", CASES)
@pytest.mark.verifies(
    "matching meshes",
    "mortar",
    reference="differences: central differences of gap and slip",
    aspects=("pairs",),
)
@pytest.mark.verifies(
    "planes",
    "nodal contact",
    "integral contact",
    "mixed contact",
    reference="differences: central differences of gap and slip",
    aspects=(
        "2D",
        "3D",
    ),
)
def test_derivatives_of_kinematics_pass_taylors_test(name):
    """Central differences fall as the square of the step, or are exact where B and n stay."""
    case = Case(name)
    at = case.at(0.0)
    seen = case.seen
    for what, rate in (
        (lambda k: k.jump, jump_rate(at, seen)),
        (lambda k: k.gap, at.gap_rate(seen)),
    ):
        size = largest(rate)
        assert size > 0.1
        coarse, fine = (largest(case.difference(what, h) - rate) / size for h in (1e-2, 1e-3))
        if case.s.linear:
            assert coarse < 1e-12
            assert fine < 1e-11
        else:
            assert coarse < 1e-1
            assert fine < max(coarse / 80, 1e-11)
    tractions = wave(case.s.positions, 1.7)
    change = at.operator.transpose_rate(tractions, seen)
    found = case.difference(lambda k: k.operator.transpose(tractions), 1e-2)
    assert largest(found - change) < 1e-12 * largest(at.operator.transpose(tractions))


@pytest.mark.ranks(2)
@pytest.mark.parametrize("name", CASES)
def test_forces_do_the_work_of_pressure_and_shear(name):
    """B^T is the transpose of the derivatives of gap and slip; rigid bodies get the reaction."""
    case = Case(name)
    at = case.at(0.0)
    s = case.s
    n = at.data.n
    pressure = 1.0 + 0.5 * np.sin(7.0 * s.positions[:, 0])
    shear = wave(s.positions, 1.7)
    shear -= np.sum(shear * n, axis=1)[:, None] * n
    # No law has shear on a curved obstacle, where the slip turns with the normal.
    shear *= s.linear
    forces = at.operator.transpose(shear - pressure[:, None] * n)
    nodes = case.v[: s.owned_nodes].reshape(-1)
    work = case.sum(forces * nodes)
    if case.eq.rigid.size:
        work -= case.sum(case.term.pushes(forces, case.u, case.q) * case.p)
    gap = at.gap_rate(case.seen)
    slip = jump_rate(at, case.seen)  # its normal part does no work on shear
    areas = s.points.areas
    if name == "wave":
        # The level set is divided by the size of its gradient, a distance only to first order.
        assert s.displaced is not None
        gap = -np.sum(at.operator.rate(case.seen) * n, axis=1)
    expected = case.sum(areas * pressure * gap) + case.sum(areas[:, None] * shear * slip)
    size = case.sum(areas * pressure * np.abs(gap)) + case.sum(
        areas[:, None] * np.abs(shear * slip)
    )
    assert abs(work - expected) < 1e-13 * size
    assert size > 0.01


@pytest.mark.ranks(2)
@pytest.mark.parametrize("dim", [2, 3])
def test_laws_see_the_slip_since_the_last_step(dim):
    """Laws see the increment; gap and its rate are those without a memory."""
    case = Case("pair, P1" if dim == 2 else "pair in space, P1")
    plain = case.at(0.0)
    before = case.at(-0.1)
    (case.term,) = case.eq.with_memory([Memory(before.jump)]).terms
    at = case.at(0.0)
    np.testing.assert_allclose(at.gap, plain.gap, rtol=0, atol=1e-14)
    np.testing.assert_allclose(at.slip, plain.slip, rtol=0, atol=1e-14)
    moved = plain.slip - before.slip
    np.testing.assert_allclose(at.increment, moved, rtol=0, atol=1e-14)
