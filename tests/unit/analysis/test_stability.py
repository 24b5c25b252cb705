"""Stability at rest: one node in closed form, continua of slip, points that just touch."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle
from support.blocks import restore_statuses
from support.leaning_bodies import block, leaning

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    NormalCompliance,
    Tresca,
)
from dolfinx_contact.analysis import SteadySliding, critical_friction, stability_at_rest
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.laws import MINUS, PLUS, STICK
from dolfinx_contact.materials import NeoHookean, lame

COMM = MPI.COMM_WORLD


@pytest.mark.parametrize("damping", [0.0, 0.3])
@pytest.mark.verifies(
    "stability at rest", reference="closed form: the growth of one node", aspects=("2D",)
)
def test_one_node_has_its_labels(damping):
    """kt = kn = 2, k = 1, F = 3, p = (-2.5, -1): stick and open stay, slip to the left grows."""
    density = 6.0
    m = 6.0 / 12  # mass of the node of a linear triangle of area 1/2
    system = linear_triangle(1, 3.0, (-5.0, -2.0), (1.0, 1.0))
    system.problem.solve()
    found = find_solutions(system, [system.create_vector()], -1.0)
    labels = {}
    for point in found.points(system):
        x = system.create_vector()
        x.array[:] = point.y.array_r[: x.getLocalSize()]
        system.put(x, point.gamma, point.piece)
        status = system.problem.table(system.problem.surfaces[0]).status[0]
        labels[status] = stability_at_rest(system.problem, density=density, damping=damping)
    assert {k: v.label for k, v in labels.items()} == {
        "o": "stable",
        "k": "stable",
        "-": "unstable",
    }
    # m l^2 + eta (kt - F k) l + kt - F k = 0, with the damping of the same motion
    excess = 3.0 * 1.0 - 2.0
    b = damping * excess
    growth = (b + np.sqrt(b**2 + 4 * m * excess)) / (2 * m)
    assert labels["-"].growth == pytest.approx(growth, rel=1e-9)
    if damping == 0:
        assert growth == pytest.approx(np.sqrt(excess / m))
    assert labels["-"].border == 1


class Pressed:
    """A body at rest under a load balancing a uniform pressure and a shear at the bound.

    The undeformed body is a solution; statuses are those that are given.

    Attributes:
        problem: the contact problem.
        load: load on the contact nodes, a stress.
    """

    def __init__(self, unloaded, friction, codes, sense, part=1.0):
        (surface,) = unloaded.surfaces
        dim = unloaded.V.mesh.geometry.dim
        self.load = fem.Function(unloaded.V)
        # Nodal forces, as those of contact; with a uniform load the exact integral is the same.
        rule = {"quadrature_rule": "vertex", "quadrature_degree": 1} if dim == 2 else {}
        bottom = np.sort(surface.submesh.parent_facets)
        tags = mesh.meshtags(unloaded.V.mesh, dim - 1, bottom, np.ones_like(bottom))
        ds = ufl.Measure("ds", unloaded.V.mesh, subdomain_data=tags, metadata=rule)
        energy = unloaded.energy - ufl.dot(self.load, unloaded.u) * ds(1)
        contacts, bcs = unloaded.contacts, unloaded.bcs
        self.problem = ContactProblem(energy, unloaded.u, contacts, bcs=bcs)
        (self.surface,) = self.problem.surfaces
        shear = np.zeros(dim)
        shear[0] = -sense * friction * part
        shear[-1] = 1.0
        if friction:
            self.surface.law.friction.value = friction
        self.put(np.tile(shear, (len(self.surface.multiplier.x.array) // dim, 1)), codes)

    def put(self, traction, codes):
        """Put tractions at the multiplier nodes into the Functions, and the load against them."""
        self.surface.multiplier.x.array[:] = traction.reshape(-1)
        nodes = self.surface.points.trace_nodes
        self.load.x.array.reshape(-1, traction.shape[1])[nodes] = -traction
        restore_statuses(self.problem, codes)


def pressed(*args, **given):
    return Pressed(*args, **given).problem


@pytest.mark.verifies(
    "stability at rest", reference="itself: critical friction, and steady sliding", aspects=("2D",)
)
def test_slipping_points_leave_beyond_the_critical_friction():
    """All points at the bound: they leave where friction exceeds the critical one."""
    critical = critical_friction(leaning(3)).friction
    for part, label in ((0.98, "stable"), (1.02, "unstable")):
        problem = pressed(leaning(3), part * critical, MINUS, -1.0)
        found = stability_at_rest(problem, density=1.0)
        assert (found.label, found.border) == (label, 4)
    onset = SteadySliding(problem, (-1.0, 0.0), density=1.0).modes(part * critical)
    real = onset.eigenvalues[onset.eigenvalues.imag == 0].real
    assert found.growth == pytest.approx(real.max(), rel=1e-8)


def test_reversed_shear_stays():
    """The same pressure with the shear of the other sense stays."""
    problem = pressed(leaning(3), 2.0, PLUS, 1.0)
    assert stability_at_rest(problem, density=1.0).label == "stable"


def test_sticking_points_are_stable():
    """With the shear below its bound all points stick, and nothing can grow."""
    problem = pressed(leaning(3), 2.0, STICK, -1.0, part=0.9)
    found = stability_at_rest(problem, density=1.0)
    assert (found.label, found.border, found.pieces) == ("stable", 0, 0)


def test_just_touching_point_is_stable():
    """Without load a node may do anything, and a pressure that would fall keeps it: stable."""
    system = linear_triangle(1, 3.0, (0.0, 0.0), (1.0, 1.0))
    system.problem.solve()
    found = stability_at_rest(system.problem, density=1.0)
    assert (found.label, found.border, found.pieces) == ("stable", 1, 4)


@pytest.mark.ranks(2)
@pytest.mark.verifies("stability at rest", reference="itself: critical friction", aspects=("3D",))
def test_stability_in_space_leaves_touching_points_open():
    """Slip against the shear in 3D; points that just touch are not decided."""
    critical = critical_friction(block(1), (1.0, 0.0, 0.0)).friction
    sense = -np.sign(critical)
    for part, label in ((0.98, "stable"), (1.02, "unstable")):
        friction = part * abs(critical)
        problem = pressed(block(1, friction=friction), friction, PLUS, sense)
        assert stability_at_rest(problem, density=1.0).label == label
    problem = pressed(block(1, friction=friction), friction, PLUS, -sense)
    assert stability_at_rest(problem, density=1.0).label == "stable"
    found = stability_at_rest(block(1), density=1.0)
    assert found.label == "not decided"


# -- the stiffness where no point is at a border ---------------------------------------------------


class Column:
    """A column 1 x 10 standing on its contact points with much friction, E = 1000.

    With a load P it is pressed at its free top, by a force keeping its direction or following the
    body; else the top is held.
    """

    def __init__(self, poisson, *, load=None, law=None):
        cells = [3, 30] if load else [4, 20]
        domain = mesh.create_rectangle(COMM, [[0, 0], [1, 10]], cells, mesh.CellType.quadrilateral)
        bottom, top = (
            mesh.locate_entities_boundary(domain, 1, lambda x, y=y: np.isclose(x[1], y))
            for y in (0.0, 10.0)
        )
        self.V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
        u = fem.Function(self.V)
        v = ufl.TestFunction(self.V)
        both = np.concatenate([top, bottom])
        numbers = np.repeat(np.array([1, 2], dtype=np.int32), [len(top), len(bottom)])
        order = np.argsort(both)
        tags = mesh.meshtags(domain, 1, both[order], numbers[order])
        ds = ufl.Measure("ds", domain=domain, subdomain_data=tags)
        #: Load on the contact nodes, a stress.
        self.push = fem.Function(self.V)
        nodal = ds(2, metadata={"quadrature_rule": "vertex", "quadrature_degree": 1})
        self.P = fem.Constant(domain, 0.0)
        self.top = fem.Constant(domain, np.zeros(2))
        F = ufl.derivative(NeoHookean(*lame(1000.0, poisson)).energy(u) * ufl.dx, u, v)
        F -= ufl.dot(self.push, v) * nodal
        bcs = []
        if load == "follows":
            turned = ufl.cofac(ufl.Identity(2) + ufl.grad(u)) * ufl.FacetNormal(domain)
            F += self.P * ufl.dot(turned, v) * ds(1)
        elif load == "dead":
            F += self.P * v[1] * ds(1)
        else:
            held = fem.locate_dofs_topological(self.V, 1, top)
            bcs = [fem.dirichletbc(self.top, held, self.V)]
        floor = HalfSpace((0, 0), (0, 1))
        surface = ContactSurface(u, bottom, obstacle=floor, law=law or Coulomb(10.0))
        self.problem = ContactProblem(F, u, [surface], bcs=bcs)
        (self.surface,) = self.problem.surfaces

    def pressed(self, by):
        for self.top.value[1] in -np.arange(0.05, by + 0.01, 0.05):
            assert self.problem.solve().converged
        assert set(self.problem.table(self.surface).letters) <= {"k"}
        return self.problem

    def loaded(self, by):
        """Apply a multiple of EI/L^2."""
        self.P.value = by * 1000.0 / 12.0 / 100.0
        assert self.problem.solve().converged
        assert set(self.problem.table(self.surface).letters) <= {"k"}
        return self.problem


@pytest.mark.verifies(
    "stability at rest",
    "hyperelastic bodies",
    reference="independent code: an eigenvalue by a dense solver",
    aspects=("2D",),
)
def test_buckled_column_has_its_negative_eigenvalue():
    """All points stick, and the constrained stiffness has the eigenvalue -0.0535."""
    column = Column(0.3)
    found = stability_at_rest(column.pressed(0.05), density=1.0)
    assert (found.label, found.border, found.growth) == ("stable", 0, 0.0)
    found = stability_at_rest(column.pressed(0.4), density=1.0)
    assert (found.label, found.border, found.frequency) == ("unstable", 0, 0.0)
    assert found.reason.endswith("has a negative eigenvalue")
    # mu of K v = mu M v, by a dense solver; with C = eta K it is l^2 + eta mu l + mu = 0, with
    # C = c M it is l^2 + c l + mu = 0.
    mu = -0.5399788468
    eta = 0.7
    c = 0.3
    assert found.growth == pytest.approx(np.sqrt(-mu), rel=2e-6)
    found = stability_at_rest(column.problem, density=1.0, damping=eta)
    grows = 0.5 * (-eta * mu + np.sqrt((eta * mu) ** 2 - 4 * mu))
    assert found.growth == pytest.approx(grows, rel=2e-6)
    v = ufl.TrialFunction(column.V)
    w = ufl.TestFunction(column.V)
    for sign in (1.0, -1.0):
        damping = sign * c * ufl.dot(v, w) * ufl.dx
        found = stability_at_rest(column.problem, density=1.0, damping=damping)
        grows = 0.5 * (-sign * c + np.sqrt(c**2 - 4 * mu))
        assert (found.label, found.growth) == ("unstable", pytest.approx(grows, rel=2e-6))
    # Four times the mass makes it half as fast.
    heavy = stability_at_rest(column.problem, density=4.0)
    assert heavy.growth == pytest.approx(0.5 * np.sqrt(-mu), rel=2e-6)


@pytest.mark.verifies(
    "stability at rest",
    "hyperelastic bodies",
    reference="closed form: Euler's and Beck's columns",
    aspects=("2D",),
)
def test_columns_buckle_as_euler_and_flutter_as_beck():
    """pi^2/4 under a dead load; 20.05 under one that follows, by flutter, never by divergence."""
    column = Column(0.0, load="dead")
    assert stability_at_rest(column.loaded(2.3), density=1.0).label == "stable"
    assert stability_at_rest(column.loaded(2.8), density=1.0).label == "unstable"
    column = Column(0.0, load="follows")
    for load in (2.8, 19.0):
        assert stability_at_rest(column.loaded(load), density=1.0).label == "stable"
    problem = column.loaded(24.0)
    found = stability_at_rest(problem, density=1.0)
    assert (found.label, found.border) == ("unstable", 0)
    # The frequency of the onset is 11.016 of (EI/(rho A L^4))^(1/2) for a slender column.
    assert found.growth > 0.1
    assert found.frequency == pytest.approx(11.016 * np.sqrt(1000 / 12) / 100, rel=0.1)
    assert "flutter" in found.reason
    # With a point at the border nothing is said of oscillations.
    surface = column.surface
    friction = 0.01
    surface.law.friction.value = friction
    codes = np.where(np.isclose(surface.positions[:, 0], 0.0), PLUS, problem.statuses[0])
    traction = surface.multiplier.x.array.reshape(-1, 2)
    corner = np.isclose(surface.points.Q.tabulate_dof_coordinates()[:, 0], 0.0)
    change = -friction * traction[corner, 1] - traction[corner, 0]
    traction[corner, 0] += change
    nodes = surface.points.trace_nodes[np.flatnonzero(corner)]
    column.push.x.array.reshape(-1, 2)[nodes, 0] = -change
    restore_statuses(problem, codes)
    found = stability_at_rest(problem, density=1.0)
    assert (found.label, found.border) == ("not decided", 1)
    assert "an oscillation grows" in found.reason


def test_laws_and_masses_that_are_refused():
    for law in (Tresca(0.1), NormalCompliance(100.0, friction=Coulomb(0.3))):
        column = Column(0.3, law=law)
        with pytest.raises(ValueError, match="for Coulomb's friction or none, not"):
            stability_at_rest(column.problem, density=1.0)
    column = Column(0.3)
    density = fem.Function(column.V.sub(0).collapse()[0])
    density.interpolate(lambda x: x[1] - 1.0)
    with pytest.raises(ValueError, match="density must be positive everywhere"):
        stability_at_rest(column.problem, density=density)
