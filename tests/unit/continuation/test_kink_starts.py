"""Branches and diagrams that begin, or reach the end of their range, where pieces meet."""

from mpi4py import MPI

import numpy as np
import pytest
from support.textbook import Textbook

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import (
    Ending,
    explore,
    find_solutions,
    follow,
)
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
END = 1.0


def body(dom, load, friction, *, nu=0.3, slope=None):
    """A clamped body that just touches a half-space, under the load gamma (load + slope x)."""
    dim = dom.geometry.dim
    V = fem.functionspace(dom, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    top = COMM.allreduce(float(dom.geometry.x[:, dim - 1].max(initial=0.0)), op=MPI.MAX)
    below, above = (
        mesh.locate_entities_boundary(dom, dim - 1, lambda x, at=at: np.isclose(x[dim - 1], at))
        for at in (0.0, top)
    )
    gamma = fem.Constant(dom, 0.0)
    forces = fem.Constant(dom, np.asarray(load, dtype=float))
    slopes = fem.Constant(dom, np.zeros(dim) if slope is None else np.asarray(slope, dtype=float))
    density = gamma * (forces + ufl.SpatialCoordinate(dom)[0] * slopes)
    energy = LinearElastic.from_young(1000.0, nu).energy(u) - ufl.dot(density, u)
    up = np.eye(dim)[dim - 1]
    surface = ContactSurface(u, below, obstacle=HalfSpace(np.zeros(dim), up), law=Coulomb(friction))
    clamped = fem.locate_dofs_topological(V, dim - 1, above)
    bc = fem.dirichletbc(np.zeros(dim), clamped, V)
    problem = ContactProblem(energy * ufl.dx, u, [surface], bcs=[bc])
    return ParametricContact(problem, gamma)


def square(load=(20.0, 5.0)):
    return body(mesh.create_unit_square(COMM, 2, 2), load, 1.0)


def sheared():
    """Three contact points with one solution on one side of the load, three on the other."""
    dom = mesh.create_unit_square(COMM, 2, 1, diagonal=mesh.DiagonalType.left)
    x = dom.geometry.x
    y = x[:, 1].copy()
    x[:, 0] -= 0.85 * y
    x[:, 1] = 1.1 * y
    return body(dom, (-14.4, -10.4), 1.9, nu=0.37, slope=(3.2, -7.6))


def state(system, point):
    x = system.create_vector()
    x.array[:] = point.y.array_r[: x.getLocalSize()]
    return x


def ends(system, diagram, gamma):
    """The different states at an end of the range, by their norms."""
    points = [p for b in diagram.branches for p in (b.points[0], b.points[-1])]
    norms = sorted(state(system, p).norm() for p in points if p.gamma == gamma)
    return [n for k, n in enumerate(norms) if k == 0 or n > norms[k - 1] * (1 + 1e-6)]


def number_of_solutions(system, gamma):
    found = find_solutions(system, [system.create_vector()], gamma)
    assert found.complete
    return len(found.found)


@pytest.mark.each_value
@pytest.mark.parametrize("route", ["pivoting", "steps"])
@pytest.mark.parametrize("load", [(20.0, 5.0), (-20.0, -5.0), (5.0, -20.0), (0.0, -1.0)])
def test_diagram_from_an_unloaded_state_has_both_branches(load, route):
    """Every point touches and none is pressed: both branches are found, and nothing else."""
    system = square(load)
    diagram = explore(system, [(system.create_vector(), 0.0)], gamma_range=(-1.0, 1.0), route=route)
    assert diagram.complete
    assert diagram.nodes == []
    assert sorted(b.points[-1].gamma for b in diagram.branches) == [-1.0, 1.0]
    assert all(b.points[1].gamma != 0.0 for b in diagram.branches)  # no branch of no length


@pytest.mark.parametrize("route", ["pivoting", "steps"])
def test_many_rays_leave_a_state_without_load(route):
    """The start is a node, of as many rays as there are solutions at both ends."""
    system = sheared()
    numbers = [number_of_solutions(system, gamma) for gamma in (END, -END)]
    assert numbers == [3, 1]
    start = system.create_vector()
    diagram = explore(system, [(start, 0.0)], gamma_range=(-END, END), route=route)
    assert diagram.complete
    assert [len(node.rays) for node in diagram.nodes] == [4]
    assert diagram.nodes[0].point.incoming is None
    assert [len(ends(system, diagram, gamma)) for gamma in (END, -END)] == numbers
    assert [edge.start for edge in diagram.edges] == [0] * 4


@pytest.mark.parametrize("route", ["pivoting", "steps"])
def test_the_range_ends_where_branches_meet(route):
    """From one of three solutions to the state without load, and back to the two others."""
    system = sheared()
    first = find_solutions(system, [system.create_vector()], END).found[0].x
    diagram = explore(system, [(first, END)], gamma_range=(0.0, END), route=route)
    assert diagram.complete
    assert len(ends(system, diagram, END)) == 3
    assert len(diagram.nodes) == 1
    from_there = explore(system, [(system.create_vector(), 0.0)], gamma_range=(0.0, END))
    assert len(ends(system, from_there, END)) == 3


@pytest.mark.ranks(2)
@pytest.mark.parametrize("route", ["pivoting", "steps"])
@pytest.mark.parametrize("direction", ["increasing", "decreasing"])
def test_branch_from_an_unloaded_state_has_the_requested_direction(direction, route):
    """The branch takes the requested direction, in the piece of its first step."""
    system = square()
    x = system.create_vector()
    branch = follow(system, x, 0.0, gamma_range=(-1.0, 1.0), direction=direction, route=route)
    assert branch.complete
    assert branch.points[-1].gamma == (1.0 if direction == "increasing" else -1.0)
    assert branch.special == []


def test_rays_of_slip_in_space_are_followed_from_a_state_without_load():
    """In 3D no piece tells some rays of such a start: those led by H are followed."""
    system = body(mesh.create_unit_cube(COMM, 1, 1, 1), (10.0, 4.0, 12.0), 0.5)
    x = system.create_vector()
    for direction, gamma in (("increasing", END), ("decreasing", -END)):
        branch = follow(system, x, 0.0, gamma_range=(-END, END), direction=direction)
        assert branch.complete
        assert branch.points[-1].gamma == gamma
    diagram = explore(system, [(x, 0.0)], gamma_range=(-END, END))
    assert not diagram.complete
    assert [len(ends(system, diagram, gamma)) for gamma in (END, -END)] == [1, 1]


def diamond():
    """|x| + |gamma| = 1."""

    def signs(codes):
        return (1 if codes[0] % 2 else -1), (1 if codes[0] // 2 else -1)

    def distances(x, g, codes):
        a, b = signs(codes)
        return [[(a * x[0], codes[0] ^ 1), (b * g, codes[0] ^ 2)]]

    return Textbook(
        1,
        lambda x, g, c: np.array([signs(c)[0] * x[0] + signs(c)[1] * g - 1]),
        lambda x, g, c: [[float(signs(c)[0])]],
        lambda x, g, c: [float(signs(c)[1])],
        distances,
        lambda x, g: [(1 if x[0] > 0 else 0) + 2 * (1 if g > 0 else 0)],
        (0, 1, 2, 3),
    )


def at(system, value):
    x = system.create_vector()
    x.set(value)
    return x


def test_both_rays_of_a_fold_at_a_kink_are_followed():
    """Gamma decreases on both rays: each is followed once, and none in the other direction."""
    system = diamond()
    span = {"gamma_range": (-2.0, 2.0)}
    closed = explore(system, [(at(system, 0.0), 1.0)], **span)
    assert closed.complete
    assert [b.ending for b in closed.branches] == [Ending.CLOSED]
    with pytest.raises(ValueError, match="gamma increases on none of the 2 rays"):
        follow(system, at(system, 0.0), 1.0, direction="increasing", **span)
    branch = follow(system, at(system, 0.0), 1.0, direction="decreasing", **span)
    assert branch.ending is Ending.CLOSED


@pytest.mark.each_value
@pytest.mark.parametrize("beyond", [0.0, 1e-15, -1e-15, -1e-13])
@pytest.mark.parametrize(("x", "gamma"), [(0.0, 1.0), (0.5, 0.5), (1.0, 0.0)])
def test_the_range_ends_at_a_fold_at_a_kink(x, gamma, beyond):
    """Both halves of the diamond are found in a range ending at its tip, wherever it begins.

    The end is at the tip to round-off, which may be on either side of it.
    """
    system = diamond()
    end = max(1.0 + beyond, gamma)
    diagram = explore(system, [(at(system, x), gamma)], gamma_range=(-0.5, end))
    assert diagram.complete
    lowest = [p for b in diagram.branches for p in b.points if p.gamma == -0.5]
    left = at(system, -0.5)
    assert sorted(round((state(system, p) - left).norm(), 9) for p in lowest) == [0.0, 1.0]
