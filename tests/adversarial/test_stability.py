"""Assumption: the stiffness at a state shows whether it is stable.

Circulating, gyroscopic and damping forces, initial stress and sliding beyond the critical friction
make states leave although no contact point is at a border. Growth rates are closed forms
or eigenvalues of matrices assembled densely on one rank.
"""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from support.bodies import block, floor, triangle, two_blocks
from support.checks import assert_close, dense, nodes_of, tangent

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, ContactSurface, Coulomb, materials, meshing
from dolfinx_contact.analysis import stability_at_rest


def assert_stability(answer, growth, tolerance=1e-6):
    """Assert that a state is stable, or unstable with a growth rate (0: stable)."""
    assert answer.label == ("unstable" if growth > 0 else "stable"), answer.reason
    if growth > 0:
        assert_close(answer.growth, growth, tolerance)


def statuses_of(result):
    return set(result.tables["contact"].status)


def floating(force, *, length=1.0, stress=1.0, cells=(2, 2), comm=MPI.COMM_WORLD):
    """A free body above a floor; ``force`` of u and a test function adds to its residual."""
    body = block(cells, (length,) * len(cells), "tri" if len(cells) == 2 else None, comm=comm)
    test = ufl.TestFunction(body.V)
    energy = materials.LinearElastic(stress, stress).energy(body.u) * ufl.dx
    bulk = ufl.derivative(energy, body.u, test) + force(body.u, test) * ufl.dx
    problem = body.problem(Coulomb(0.5), bulk, obstacle=floor(-length, len(cells)), bcs=[])
    return body, problem


@pytest.mark.parametrize(
    ("k", "rho", "length", "stress", "cells"),
    [
        (-0.3, 1.0, 1.0, 1.0, (2, 2)),
        (-0.3, 7.8e3, 1e-9, 1e9, (2, 2)),
        (-0.05, 1e-9, 1e9, 1e-9, (2, 2)),
        (-0.2, 3.0, 1e-3, 1e11, (1, 1, 2)),
        (0.3, 1.0, 1.0, 1.0, (2, 2)),
        (0.3, 7.8e3, 1e-9, 1e9, (2, 2)),
    ],
)
def test_springs_drive_a_body_away_or_hold_it(k, rho, length, stress, cells):
    """Translations: rho lambda^2 = -k, with all contact points open."""
    own = k * stress / length**2
    _, problem = floating(
        lambda u, v: own * ufl.dot(u, v), length=length, stress=stress, cells=cells
    )
    assert statuses_of(problem.solve()) == {"o"}
    answer = stability_at_rest(problem, density=rho)
    assert_stability(answer, np.sqrt(-own / rho) if k < 0 else 0.0)


@pytest.mark.parametrize("damping", [0.0, pytest.param(0.1, marks=pytest.mark.sample), 0.9])
def test_circulation_makes_a_body_flutter_up_to_some_damping(damping):
    """Translations: rho lambda^2 + d lambda + k +- i c = 0; the stiffness k is positive."""
    k, c, rho = 0.5, 0.2, 2.0
    body, problem = floating(
        lambda u, v: k * ufl.dot(u, v) - c * ufl.dot(ufl.as_vector((-u[1], u[0])), v)
    )
    problem.solve()
    product = ufl.dot(ufl.TrialFunction(body.V), ufl.TestFunction(body.V))
    answer = stability_at_rest(
        problem, density=rho, damping=damping * product * ufl.dx if damping else 0.0
    )
    roots = np.concatenate([np.roots([rho, damping, k + s * 1j * c]) for s in (1, -1)])
    fastest = roots[np.argmax(roots.real)]
    assert_stability(answer, fastest.real)
    if fastest.real > 0:
        assert_close(abs(answer.frequency), abs(fastest.imag))


@pytest.mark.parametrize("d", [0.3, 0.05, -0.3])
def test_negative_damping_feeds_a_body_that_springs_hold(d):
    """rho lambda^2 - d lambda + k = 0: growth d / (2 rho)."""
    body, problem = floating(lambda u, v: 0.5 * ufl.dot(u, v))
    problem.solve()
    form = -d * ufl.dot(ufl.TrialFunction(body.V), ufl.TestFunction(body.V)) * ufl.dx
    answer = stability_at_rest(problem, density=2.0, damping=form)
    assert_stability(answer, max(d, 0.0) / 4.0)


@pytest.mark.parametrize("g", [2.0, 0.8])
def test_gyroscopic_forces_hold_a_body_that_springs_drive_away(g):
    """Translations: rho lambda^2 +- i g lambda - c = 0."""
    c, rho = 0.2, 2.0

    def springs(u, v):
        turned = u[1].dx(0) - u[0].dx(1)
        return -c * ufl.dot(u, v) + 5.0 * turned * (v[1].dx(0) - v[0].dx(1))

    def forms(body):
        """Mass, gyroscopic forces and stiffness, bilinear."""
        trial, test = ufl.TrialFunction(body.V), ufl.TestFunction(body.V)
        E = ufl.sym(ufl.grad(trial))
        elastic = ufl.inner(ufl.tr(E) * ufl.Identity(2) + 2 * E, ufl.sym(ufl.grad(test)))
        turned = ufl.as_vector((-trial[1], trial[0]))
        parts = (rho * ufl.dot(trial, test), g * ufl.dot(turned, test), elastic)
        return [p * ufl.dx for p in (*parts[:2], parts[2] + springs(trial, test))]

    body, problem = floating(springs)
    problem.solve()
    answer = stability_at_rest(problem, density=rho, damping=forms(body)[1])
    M, G, K = (dense(f) for f in forms(block(cell="tri", comm=MPI.COMM_SELF)))
    n = len(M)
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ K, -inverse @ G]])
    growth = scipy.linalg.eigvals(A).real.max()
    if g == 2.0:
        assert growth < 1e-6
        assert answer.label != "unstable"
    else:
        assert_close(growth, np.roots([rho, 1j * g, -c]).real.max())
        assert_stability(answer, growth)


def least_eigenvalue(own, energy, density):
    """Least eigenvalue of the tangent stiffness of a body on one rank, held at both ends."""
    trial, test = ufl.TrialFunction(own.V), ufl.TestFunction(own.V)
    K = dense(tangent(energy, own))
    M = dense(density * ufl.dot(trial, test) * ufl.dx)
    free = nodes_of(own.V, lambda y: (y[:, 1] > 1e-6) & (y[:, 1] < 1 - 1e-6))
    free = np.concatenate([2 * free, 2 * free + 1])
    return scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], eigvals_only=True)[0]


@pytest.mark.parametrize("stress", [-0.8, -1.15, 0.5])
def test_initial_stress_can_destabilise_a_linear_body(stress):
    """The energy s grad(u):grad(u) / 2 is quadratic; one part is a hundred times as heavy."""

    def stressed(comm):
        body = block((3, 3), comm=comm)
        G = ufl.grad(body.u)
        energy = materials.LinearElastic(1.0, 1.0).energy(body.u) * ufl.dx
        energy += 0.5 * fem.Constant(body.domain, stress) * ufl.inner(G, G) * ufl.dx
        heavy = fem.Function(fem.functionspace(body.domain, ("Discontinuous Lagrange", 0)))
        heavy.interpolate(lambda x: np.where(x[0] < 1 / 3, 100.0, 1.0))
        return body, energy, heavy

    body, energy, heavy = stressed(MPI.COMM_WORLD)
    body.move_top(0.0, -0.1)
    problem = body.problem(Coulomb(50.0), energy)
    assert statuses_of(problem.solve()) == {"k"}
    answer = stability_at_rest(problem, density=heavy)
    least = least_eigenvalue(*stressed(MPI.COMM_SELF))
    assert (least < 0) == (stress < -1)
    assert_stability(answer, np.sqrt(max(-least, 0.0)), 1e-5)


S_TT, S_NT = 173.0, 91.0  # of a triangle with lambda = 100, mu = 82: (l + 3 m) / 2, (l + m) / 2


def at_node(slip, friction, pressure=3.0):
    """Body force under which the node slips to the left with friction at its limit."""
    return 6 * np.array([S_TT * slip - friction * pressure, S_NT * slip - pressure])


@pytest.mark.parametrize("friction", [1.0, 1.8, 2.0, 3.0])
def test_a_sliding_node_leaves_beyond_its_critical_friction(friction):
    """lambda^2 = (F S_nt - S_tt) / m with m = rho A / 6."""
    domain = triangle()
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + x[1], 1))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    load = fem.Constant(domain, at_node(-0.01, friction))
    energy = materials.LinearElastic(100.0, 82.0).energy(u) * ufl.dx - ufl.dot(load, u) * ufl.dx
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    contact = ContactSurface(u, bottom, obstacle=floor(), law=Coulomb(friction))
    problem = ContactProblem(energy, u, [contact], bcs=[held])
    node = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0] + x[1], 0))
    u.x.array[2 * node[0]] = -0.01
    table = problem.solve().tables["contact"]
    answer = stability_at_rest(problem, density=4.0)
    leaves = 0.0
    if table.status.replace("d", "") == "-":
        assert_close(table.ut[0, 0], -0.01)
        leaves = max(friction * S_NT - S_TT, 0.0)
    assert_stability(answer, np.sqrt(leaves / (4.0 * 0.5 / 6)))


@pytest.mark.parametrize("friction", [(3.0, 2.2), (1.0, 2.2), (3.0, 1.0), (1.5, 1.2)])
def test_the_faster_of_two_sliding_nodes_is_found(friction):
    """Two triangles of other masses and stiffnesses, wherever they are in the mesh."""
    both = meshing.join([triangle(at, MPI.COMM_WORLD) for at in (0.0, 5.0)])
    domain = both.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    x = ufl.SpatialCoordinate(domain)
    left = x[0] < 3
    dx = ufl.Measure("dx", domain, subdomain_data=both.cell_tags)
    stiff = ufl.conditional(left, 1.0, 10.0)
    F = ufl.conditional(left, *(fem.Constant(domain, f) for f in friction))
    energy = materials.LinearElastic(100.0 * stiff, 82.0 * stiff).energy(u) * dx
    leaves = []
    for tag, (own, part, density) in enumerate(
        zip(friction, (1.0, 10.0), (4.0, 1.0), strict=True), 1
    ):
        force = 6 * np.array([-0.01 * S_TT * part - 9 * own, -0.01 * S_NT * part - 9])
        energy -= ufl.dot(fem.Constant(domain, force), u) * dx(tag)
        leaves.append((own * S_NT - S_TT) * part / (density * 0.5 / 6))
    bottom = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0))
    slope = mesh.locate_entities_boundary(
        domain, 1, lambda x: np.isclose(x[0] + x[1], 1) | np.isclose(x[0] + x[1], 6)
    )
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    contact = ContactSurface(u, bottom, obstacle=floor(), law=Coulomb(F))
    problem = ContactProblem(energy, u, [contact], bcs=[held])
    u.interpolate(lambda x: np.stack([-0.01 * (x[1] < 0.1) * (x[0] % 5 < 0.1), 0 * x[0]]))
    letters = problem.solve().tables["contact"].status.replace("d", "")
    answer = stability_at_rest(problem, density=ufl.conditional(left, 4.0, 1.0))
    most = max([v for v, letter in zip(leaves, letters, strict=True) if letter != "k"] + [0.0])
    assert_stability(answer, np.sqrt(most))


@pytest.mark.parametrize(
    ("k", "densities"), [(-0.05, (2.0, 2.0)), (-0.05, (1.0, 9.0)), (0.05, (1.0, 9.0))]
)
def test_two_stuck_bodies_leave_together(k, densities):
    """A translation grows with sqrt(-k / rho); with two densities at least with its mean."""
    both = two_blocks((2, 2), (2, 1))
    dx = ufl.Measure("dx", both.domain, subdomain_data=both.parts)
    press = ufl.as_vector((0.0, 0.1))
    energy = materials.LinearElastic(1.0, 1.0).energy(both.u) * dx
    energy += k / 2 * ufl.dot(both.u, both.u) * dx
    energy += ufl.dot(press, both.u) * dx(1) - 2 * ufl.dot(press, both.u) * dx(2)
    pair = ContactPair(both.u, both.slave, master_facets=both.master, law=Coulomb(20.0))
    problem = ContactProblem(energy, both.u, [pair])
    assert statuses_of(problem.solve()) == {"k"}
    upper = ufl.gt(ufl.SpatialCoordinate(both.domain)[1], 0)
    answer = stability_at_rest(problem, density=ufl.conditional(upper, *densities))
    if densities[0] == densities[1] or k > 0:
        assert_stability(answer, np.sqrt(max(-k, 0.0) / densities[0]))
    else:
        mean = (densities[0] + 0.5 * densities[1]) / 1.5
        assert answer.label == "unstable"
        assert answer.growth >= np.sqrt(-k / mean) * (1 - 1e-9)
