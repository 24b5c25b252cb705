"""Curved obstacles in large displacement: gap and normal where the contact points are now."""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
import pytest
from blocks import box, facets

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
    Sphere,
    materials,
)
from dolfinx_contact.equations.jacobian import Jacobian
from dolfinx_contact.laws.status import closed

COMM = MPI.COMM_WORLD
RUBBER = materials.NeoHookean(*materials.lame(1000.0, 0.3))
STEEL = materials.LinearElastic.from_young(1000.0, 0.3)


def block(obstacle, *, cell="quad", n=4, top=None, law=None, material=RUBBER, degree=1, **given):
    """A unit block held and moved at its top, in contact at its bottom."""
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    options = given.pop("options", None)
    surface = ContactSurface(
        u, facets(domain, dim - 1, 0.0), obstacle=obstacle, law=law or Frictionless(), **given
    )
    moved = np.array(top if top is not None else [*[0.0] * (dim - 1), -0.1])
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    bcs = [fem.dirichletbc(moved, held, V)]
    energy = material.energy(u) * ufl.dx
    return ContactProblem(energy, u, [surface], bcs=bcs, petsc_options=options)


def strip(n=4, push=-0.4, cell=mesh.CellType.quadrilateral, solid=False, **given):
    """A band of rubber, held at its ends, pushed around a cylinder below its middle."""
    if solid:
        corners, cells = [np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.25, 0.4])], (4 * n, 1, n)
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
    return ContactProblem(RUBBER.energy(u) * ufl.dx, u, [surface], bcs=bcs)


def places(problem):
    """Contact nodes of this rank where they are now, their tractions and statuses."""
    (s,), dim = problem.surfaces, problem.equations.dim
    n, nodes = s.num_owned_points, s.points.vertex_trace_dofs
    x = s.node_positions[nodes] + problem.u.x.array.reshape(-1, dim)[nodes]
    return x[:n], s.multiplier.x.array.reshape(-1, dim)[:n], s.statuses


def quadratic(history):
    """Whether the last residuals of Newton's method fall like squares."""
    r = [step.measures.worst for step in history][-4:]
    small = [(a, b) for a, b in pairwise(r) if a < 0.05]
    return len(small) >= 2 and all(b < 20 * a**2 + 1e-12 for a, b in small)


@pytest.mark.parametrize("solid", [False, True])
def test_around_a_cylinder(solid):
    """The law at displaced points, from nothing but nodal values and the definition of the disc."""
    radius, problem = 0.4, strip(n=3 if solid else 6, solid=solid)
    result = problem.solve()
    assert quadratic(result.history)
    assert result.kkt_violation < 1e-9
    assert result.misfit < 1e-9 * radius
    assert result.imbalance < 1e-9
    x, t, codes = places(problem)
    arm = (x - np.array([0.0, -radius]) if not solid else x - [0.0, 0.0, -radius])[:, [0, -1]]
    gap, out = np.linalg.norm(arm, axis=1) - radius, arm / np.linalg.norm(arm, axis=1)[:, None]
    touching = closed(codes)
    assert np.abs(gap[touching]).max(initial=0.0) < 1e-9 * radius
    assert gap.min(initial=1.0) > -1e-9 * radius
    pressure, largest = np.sum(t[:, [0, -1]] * out, axis=1), np.abs(t).max(initial=1.0)
    assert pressure.min(initial=0.0) > -1e-9 * largest
    across = t.copy()
    across[:, [0, -1]] -= pressure[:, None] * out
    assert np.abs(across).max(initial=0.0) < 1e-9 * largest
    assert np.abs(t[~touching]).max(initial=0.0) < 1e-9 * largest
    # It goes around by more than the contact is long.
    (table,) = result.tables.values()
    angles = np.arctan2(-table.n[:, 0], -table.n[:, -1])[table.rn > 0]
    assert np.ptp(angles) > (0.7 if solid else 1.0)
    np.testing.assert_allclose(table.pressure, np.linalg.norm(table.force, axis=1) / table.area)


OBSTACLES = {
    "disc": Sphere((0.4, -3.0), 3.0),
    "ball": Sphere((0.4, 0.6, -3.0), 3.0),
    "cylinder": Cylinder((0.4, 0.5, -2.0), (0.3, 1.0, 0.1), 2.0),
    "ellipse": LevelSet(lambda x: (x[0] - 0.4) ** 2 / 4 + (x[1] + 1.0) ** 2 - 1.0),
    "bumps": LevelSet(lambda x: x[2] + 0.1 * ufl.sin(3 * x[0]) * ufl.cos(2 * x[1])),
}


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
def test_jacobian_by_taylor(obstacle, cell, law, given):
    """|H(x + h d) - H(x) - h J d| falls like h^2 with the statuses held, far from small slopes."""
    problem = block(OBSTACLES[obstacle], cell=cell, n=2, law=law, **given)
    x, d = problem.create_vector(), problem.create_vector()
    random = np.random.default_rng(1 + COMM.rank)
    x.array[:] = random.uniform(-0.1, 0.1, len(x.array))
    d.array[:] = 0.02 * random.standard_normal(len(d.array))
    fixed = problem.equations.fixed[: problem.equations.owned_sizes[0]]
    prescribed = problem.equations.constraints.values().reshape(-1)[: len(fixed)]
    x.array[: len(fixed)][fixed], d.array[: len(fixed)][fixed] = prescribed[fixed], 0.0
    b0, b1, y, Jd = (problem.create_vector() for _ in range(4))
    state = problem.residual(x, b0)
    counts = COMM.allreduce(np.bincount(closed(state.statuses[0]).astype(int), minlength=2))
    assert counts.min() > 0
    jacobian = Jacobian(problem.equations)
    jacobian.update(state)
    jacobian.matrix.mult(d, Jd)
    n, sizes = len(fixed), []
    for h in (1.0, 0.5, 0.25):
        y.waxpy(h, d, x)
        problem.residual(y, b1, state.statuses)
        b1.axpy(-1.0, b0)
        b1.axpy(-h, Jd)
        # Rows of the contact alone: the body's are larger.
        sizes.append(np.sqrt(COMM.allreduce(np.sum(b1.array_r[n:] ** 2))))
    assert sizes[0] > 0
    np.testing.assert_allclose(np.array(sizes[:2]) / sizes[1:], 4.0, rtol=0.2)


@pytest.mark.parametrize("cell", ["tri", "hex"])
def test_a_plane_is_a_plane(cell):
    """As a level set it goes the way of curved obstacles, and gives the numbers of a half-space."""
    dim = 2 if cell == "tri" else 3
    normal = np.array([0.1, *[0.0] * (dim - 2), 1.0])
    point, top = np.array([0.3, *[0.0] * (dim - 1)]), [0.4, *[0.0] * (dim - 2), -0.06]
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


def test_which_sliding():
    """Large by default for bodies that are not linear, and for these alone."""
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


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"law": Coulomb(0.3)}, "the way that it has gone along a normal that has turned"),
        ({"method": "mixed"}, "gaps of mixed contact are averages"),
        ({"sliding": "huge"}, "sliding must be 'small', 'large' or None, got 'huge'"),
    ],
)
def test_refused(given, message):
    with pytest.raises(ValueError, match=message):
        block(Sphere((0.4, -3.0), 3.0), **given)
