"""Curved obstacles in large displacement: gap and normal where the contact points are now."""

from itertools import pairwise

from mpi4py import MPI

import cases.around_a_cylinder
import numpy as np
import pytest
from support.blocks import box, facets
from support.checks import solved_start
from support.curved_obstacles import DX, OBSTACLES, RUBBER, block, ellipse, shaken

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Cylinder,
    Frictionless,
    HalfSpace,
    LevelSet,
    NormalCompliance,
    ParametricContact,
    Sphere,
    materials,
)
from dolfinx_contact.continuation import follow
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.laws.status import closed

COMM = MPI.COMM_WORLD

STEEL = materials.LinearElastic.from_young(1000.0, 0.3)


def strip(n=4, push=-0.4, cell=mesh.CellType.quadrilateral, solid=False, **given):
    """A band of rubber, held at its ends, pushed around a cylinder below its middle."""
    if solid:
        corners = [np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.25, 0.4])]
        cells = (4 * n, 1, n)
        domain = mesh.create_box(COMM, corners, cells, mesh.CellType.hexahedron)
        obstacle = Cylinder((0.0, 0.0, -0.4), (0.0, 1.0, 0.0), 0.4)
    else:
        corners = [np.array([-1.0, 0.0]), np.array([1.0, 0.4])]
        domain = mesh.create_rectangle(COMM, corners, (4 * n, n), cell)
        obstacle = Sphere((0.0, -0.4), 0.4)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    ends = mesh.locate_entities_boundary(domain, dim - 1, lambda x: np.isclose(np.abs(x[0]), 1.0))
    surface = ContactSurface(
        u, facets(domain, dim - 1, 0.0), obstacle=obstacle, law=Frictionless(), **given
    )
    moved = np.array([*[0.0] * (dim - 1), push])
    bcs = [fem.dirichletbc(moved, fem.locate_dofs_topological(V, dim - 1, ends), V)]
    return ContactProblem(RUBBER.energy(u) * DX, u, [surface], bcs=bcs)


def places(problem):
    """Contact nodes of this rank where they are now, their tractions and statuses."""
    (s,) = problem.surfaces
    dim = problem.equations.dim
    n = s.points.number
    nodes = s.points.vertex_nodes
    x = s.node_positions[nodes] + problem.u.x.array.reshape(-1, dim)[nodes]
    return x[:n], s.multiplier.x.array.reshape(-1, dim)[:n], problem.statuses[0]


def quadratic(history):
    """Whether the last residuals of Newton's method fall like squares."""
    r = [step.measures.worst for step in history][-4:]
    small = [(a, b) for a, b in pairwise(r) if a < 0.05]
    return len(small) >= 2 and all(b < 20 * a**2 + 1e-12 for a, b in small)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.verifies(
    "Signorini",
    "hyperelastic bodies",
    reference="closed form: Signorini's law at the displaced points",
    aspects=(
        "2D",
        "3D",
        "large sliding",
    ),
)
@pytest.mark.verifies(
    "cylinders",
    reference="closed form: Signorini's law at the displaced points",
    aspects=(
        "3D",
        "large sliding",
    ),
)
@pytest.mark.verifies(
    "spheres",
    reference="closed form: Signorini's law at the displaced points",
    aspects=(
        "2D",
        "large sliding",
    ),
)
def test_law_holds_at_points_displaced_around_a_cylinder(solid):
    """The law at displaced points, from nothing but nodal values and the definition of the disc."""
    radius = 0.4
    problem = strip(n=3 if solid else 6, solid=solid)
    result = problem.solve()
    assert quadratic(result.history)
    assert result.kkt_violation < 1e-9
    assert result.misfit < 1e-9 * radius
    assert result.imbalance < 1e-9
    x, t, codes = places(problem)
    arm = (x - np.array([0.0, -radius]) if not solid else x - [0.0, 0.0, -radius])[:, [0, -1]]
    gap = np.linalg.norm(arm, axis=1) - radius
    out = arm / np.linalg.norm(arm, axis=1)[:, None]
    touching = closed(codes)
    assert np.abs(gap[touching]).max(initial=0.0) < 1e-9 * radius
    assert gap.min(initial=1.0) > -1e-9 * radius
    pressure = np.sum(t[:, [0, -1]] * out, axis=1)
    largest = np.abs(t).max(initial=1.0)
    assert pressure.min(initial=0.0) > -1e-9 * largest
    across = t.copy()
    across[:, [0, -1]] -= pressure[:, None] * out
    assert np.abs(across).max(initial=0.0) < 1e-9 * largest
    assert np.abs(t[~touching]).max(initial=0.0) < 1e-9 * largest
    # It goes around by more than the contact is long.
    (table,) = result.tables.values()
    angles = np.arctan2(-table.n[:, 0], -table.n[:, -1])[table.rn > 0]
    assert np.ptp(angles) > (0.7 if solid else 1.0)
    size = np.linalg.norm(table.force, axis=1)
    np.testing.assert_allclose(table.pressure * table.area, size, atol=1e-15 * size.max(initial=0))


@pytest.mark.ranks(2, 3)
@pytest.mark.parametrize(
    ("obstacle", "cell", "law", "given"),
    [
        ("disc", "quad", Frictionless(), {}),
        ("ellipse", "tri", Frictionless(), {}),
        ("ellipse", "tri", NormalCompliance(50.0, 1.5), {}),
        ("ellipse", "quad", Frictionless(), {"degree": 2}),
        ("disc", "tri", Frictionless(), {"degree": 2, "multiplier_degree": 2}),
        ("cylinder", "hex", Frictionless(), {}),
        ("ball", "tet", Frictionless(), {"method": "integral"}),
        ("bumps", "tet", Frictionless(), {}),
    ],
)
@pytest.mark.verifies(
    "spheres",
    "level sets",
    "normal compliance",
    reference="differences: Taylor remainders of second order",
    aspects=(
        "2D",
        "3D",
        "large sliding",
    ),
)
def test_the_jacobian_of_large_sliding_passes_taylors_test(obstacle, cell, law, given):
    """|H(x + h d) - H(x) - h J d| falls like h^2 with the statuses held, far from small slopes."""
    problem = block(OBSTACLES[obstacle], cell=cell, n=2, law=law, **given)
    x = shaken(problem, 0.1, 1.0)
    d = shaken(problem, 0.02, 2.0)
    fixed = problem.equations.fixed[: problem.equations.owned_sizes[0]]
    prescribed = problem.equations.constraints.values().reshape(-1)[: len(fixed)]
    x.array[: len(fixed)][fixed] = prescribed[fixed]
    d.array[: len(fixed)][fixed] = 0.0
    b0, b1, y, Jd = (problem.create_vector() for _ in range(4))
    state = problem.residual(x, b0)
    counts = COMM.allreduce(np.bincount(closed(state.statuses[0]).astype(int), minlength=2))
    assert counts.min() > 0
    jacobian = Jacobian(problem.equations)
    jacobian.update(state)
    jacobian.matrix.mult(d, Jd)
    n = len(fixed)
    sizes = []
    for h in (1.0, 0.5, 0.25):
        y.waxpy(h, d, x)
        problem.residual(y, b1, state.statuses)
        b1.axpy(-1.0, b0)
        b1.axpy(-h, Jd)
        # Only rows of the contact: the body's are larger.
        sizes.append(np.sqrt(COMM.allreduce(np.sum(b1.array_r[n:] ** 2))))
    assert sizes[0] > 0
    np.testing.assert_allclose(np.array(sizes[:2]) / sizes[1:], 4.0, rtol=0.2)


@pytest.mark.parametrize("cell", ["tri", "hex"])
@pytest.mark.verifies(
    "level sets",
    "planes",
    reference="itself: the half-space",
    aspects=(
        "2D",
        "3D",
        "large sliding",
    ),
)
def test_a_plane_is_a_plane(cell):
    """As a level set it uses the code of curved obstacles and gives the numbers of a half-space."""
    dim = 2 if cell == "tri" else 3
    normal = np.array([0.1, *[0.0] * (dim - 2), 1.0])
    point = np.array([0.3, *[0.0] * (dim - 1)])
    top = [0.4, *[0.0] * (dim - 2), -0.06]
    plane = LevelSet(lambda x: 2.0 * sum(normal[i] * (x[i] - point[i]) for i in range(dim)))
    a, b, c = (
        block(obstacle, cell=cell, n=3, top=top, sliding=sliding)
        for obstacle, sliding in (
            (HalfSpace(point, normal), "small"),
            (HalfSpace(point, normal), "large"),
            (plane, None),
        )
    )
    assert a.surfaces[0].displaced is b.surfaces[0].displaced is None
    assert c.surfaces[0].displaced is not None
    tables = [p.solve().tables["contact"] for p in (a, b, c)]
    assert 0 < tables[0].count("o") < len(tables[0].x)
    for other in tables[1:]:
        for name in ("un", "ut", "n", "force", "pressure"):
            mine = getattr(tables[0], name)
            np.testing.assert_allclose(
                getattr(other, name), mine, rtol=0, atol=1e-12 * np.abs(mine).max()
            )


def test_sliding_is_large_by_default_for_nonlinear_bodies_only():
    """The default is large sliding for nonlinear bodies only."""
    disc = Sphere((0.4, -3.0), 3.0)
    for material, sliding, follows in (
        (STEEL, None, False),
        (RUBBER, None, True),
        (STEEL, "large", True),
        (RUBBER, "small", False),
    ):
        problem = block(disc, material=material, sliding=sliding)
        assert (problem.surfaces[0].displaced is not None) is follows
        # With small sliding friction is as ever.
        if not follows:
            block(disc, material=material, sliding=sliding, law=Coulomb(0.3))


def orbiting(cell, n, angle, press=0.08):
    """Press a block on a cylinder, moving its top around it; gamma is the fraction of the way.

    Only the frame changes on the way, leaving the pressed state a solution everywhere.
    """
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    moved = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    centre = np.array([0.4, *[0.5] * (dim - 2), -1.0])
    last = dim - 1
    obstacle = Sphere(centre, 1.0) if dim == 2 else Cylinder(centre, (0.0, 1.0, 0.0), 1.0)
    bottom = facets(domain, last, 0.0)
    surface = ContactSurface(u, bottom, obstacle=obstacle, law=Frictionless())
    x = ufl.SpatialCoordinate(domain)
    a = x[0] - centre[0]
    b = x[last] - press - centre[last]
    c = ufl.cos(angle * gamma)
    s = ufl.sin(angle * gamma)
    way = [c * a + s * b - x[0] + centre[0], *[0.0 * a] * (dim - 2), c * b - s * a - x[last] - 1.0]
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, last, facets(domain, last, 1.0)))
    problem = ContactProblem(RUBBER.energy(u) * DX, u, [surface], bcs=[held])
    return ParametricContact(problem, gamma, driven=[(moved, ufl.as_vector(way))])


@pytest.mark.parametrize(
    ("cell", "n"), [("quad", 6), pytest.param("hex", 3, marks=pytest.mark.long)]
)
@pytest.mark.verifies(
    "moving obstacles",
    "hyperelastic bodies",
    reference="itself: the forces of the start, turned",
    aspects=(
        "2D",
        "3D",
        "large sliding",
        "branches",
    ),
)
def test_branch_around_a_cylinder_agrees_with_solves(cell, n):
    """The way is much longer than the contact; Newton solves and the branch agree."""
    angle = 1.2
    system = orbiting(cell, n, 1.2)
    problem = system.problem
    (s,) = system.problem.surfaces
    system.set_parameter(0.0)
    first = problem.solve().tables["contact"]
    length = first.area[first.rn > 0].sum()
    assert 0 < length < angle
    turn = np.eye(s.dim)
    places = np.ix_([0, -1], [0, -1])
    turn[places] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]

    def agrees(table):
        size = np.abs(first.force).max()
        np.testing.assert_allclose(table.force, first.force @ turn.T, rtol=0, atol=1e-8 * size)
        np.testing.assert_allclose(table.n, first.n @ turn.T, rtol=0, atol=1e-8)
        np.testing.assert_allclose(table.un, first.un, rtol=0, atol=1e-9)

    x = system.create_vector()
    problem.write(x)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
    assert branch.points[-1].gamma == 1.0
    result = system.result_at(branch.points[-1])
    assert result.kkt_violation < 1e-9
    agrees(result.tables["contact"])
    # Back to the start, and there in one solve.
    problem.read(x)
    system.set_parameter(1.0)
    result = problem.solve()
    assert quadratic(result.history)
    agrees(result.tables["contact"])


@pytest.mark.verifies(
    "moving obstacles",
    "level sets",
    reference="itself: the block that is moved over an obstacle at rest",
    aspects=(
        "2D",
        "large sliding",
    ),
)
def test_moving_an_obstacle_is_moving_the_block_over_it():
    """An ellipse moved and turned under a block held still is a block moved over one that waits."""
    domain = box(COMM, 4, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    obstacle = ellipse(domain, (0.2 + 0.2 * gamma, 0.06 * gamma - 1.05), 0.4 * gamma)
    surface = ContactSurface(u, facets(domain, 1, 0.0), obstacle=obstacle, law=Frictionless())
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    bcs = [fem.dirichletbc(np.zeros(2), held, V)]
    problem = ContactProblem(RUBBER.energy(u) * DX, u, [surface], bcs=bcs)
    system = ParametricContact(problem, gamma)
    x = solved_start(system)
    branch = follow(system, x, 0.0, gamma_range=(0.0, 1.0))
    assert branch.points[-1].gamma == 1.0
    found = system.result_at(branch.points[-1])
    assert found.kkt_violation < 1e-9
    assert found.counts["open"] < 5
    # The same by a solve at the end, and by another obstacle that stands where this one has come.
    still = block(ellipse(domain, (0.4, -0.99), 0.4), n=4, top=[0.0, 0.0])
    for p in (problem, still):
        solved = p.solve().tables["contact"]
        size = np.abs(solved.force).max()
        assert size > 0
        force = found.tables["contact"].force
        np.testing.assert_allclose(force, solved.force, rtol=0, atol=1e-8 * size)


@pytest.mark.long
@pytest.mark.verifies(
    "spheres",
    "hyperelastic bodies",
    reference="closed form: the pressure of a ring",
    aspects=(
        "2D",
        "large sliding",
    ),
)
def test_the_pressed_ring_has_the_pressure_of_its_closed_form(folder, no_pictures):
    """The pressure of a ring to second order, and no change of it on the way around."""
    errors = []
    for n, steps in ((2, 5), (3, 7)):
        words = [f"--n={n}", f"--steps={steps}", f"--output={folder / str(n)}"]
        summary = cases.around_a_cylinder.main(words)
        assert summary["way"] > 1.2 * summary["contact_length"] > 2.0
        assert summary["pressure_drift"] < 1e-8
        assert summary["kkt_violation"] < 1e-9
        assert summary["misfit"] < 1e-9
        errors.append(summary["pressure"] / summary["pressure_closed_form"] - 1)
    assert abs(errors[1]) < 3e-3
    assert errors[0] / errors[1] == pytest.approx(9 / 4, rel=0.2)
