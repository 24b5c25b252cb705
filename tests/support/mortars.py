"""Bodies with non-matching faces, and exact integrals over common facets."""

from itertools import pairwise

from mpi4py import MPI

import numpy as np
from scipy.spatial.transform import Rotation

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    ParametricContact,
)
from dolfinx_contact.grids import create_grid
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise
from support.blocks import CELLS
from support.checks import solved_start
from support.pairs import MATERIAL, displacement, held, largest, tagged

COMM = MPI.COMM_WORLD


#: Cells along the lower and the upper face, and from where to where these reach.
CASES = [
    (5, 7, (0.0, 1.0), (0.0, 1.0)),
    (20, 3, (0.0, 1.0), (0.0, 1.0)),
    (7, 3, (-0.3, 1.45), (0.0, 1.0)),  # a short one on a long one, its ends inside facets
    (3, 3, (-0.3, 1.45), (0.0, 1.0)),
]


SIDES = [(3, 2), (2, 3)]  # tags of slave and master: 3 is above


BASE = np.array([[0.3, -0.1], [0.07, -0.4]])  # of the linear field of the patch test


def stacked(below, above, x_below, x_above, cell="quad", *, angle=0.0, comm=COMM):
    """Two boxes of height 1, face to face on y = 0; tags 1 below, 2 and 3, 4 above, 5, 6 aside."""
    bodies = []
    tags = []
    for i, (n, reach) in enumerate([(below, x_below), (above, x_above)]):
        y = np.linspace(i - 1.0, i, max(n // 2, 1) + 1)
        body = create_grid(comm, [np.linspace(*reach, n + 1), y], CELLS[cell])
        planes = {f"t{2 * i + 1}": (1, i - 1.0), f"t{2 * i + 2}": (1, float(i))}
        tags.append(tagged(body, **planes, t5=(0, reach[0]), t6=(0, reach[1])))
        bodies.append(body)
    both = join(bodies, facet_tags=tags)
    x = both.mesh.geometry.x
    c = np.cos(angle)
    s = np.sin(angle)
    x[:, :2] = x[:, :2] @ np.array([[c, -s], [s, c]]).T
    return both


def hats(points, a, b):
    """Exact integrals of the hat functions of sorted points from ``a`` to ``b``."""
    found = np.zeros(len(points))
    for k, (p, q) in enumerate(pairwise(points)):
        c = max(p, a)
        d = min(q, b)
        if d > c:
            share = ((d - p) ** 2 - (c - p) ** 2) / (2 * (q - p))
            found[k + 1] += share
            found[k] += d - c - share
    return found


SOLID_CASES = [
    (2, 3, (0.0, 1.0), (0.0, 1.0)),
    (4, 2, (0.0, 1.0), (0.0, 1.0)),  # nodes of one are some of the other's
    (4, 2, (-0.3, 1.45), (0.0, 1.0)),
    (3, 3, (-0.3, 1.45), (0.0, 1.0)),
]


SOLID_BASE = np.array([[0.3, -0.1, 0.02], [0.07, 0.1, -0.03], [0.01, 0.04, -0.5]])
TILT = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()


def solids(below, above, x_below, x_above, cells, *, turn=TILT, comm=COMM):
    """Return `stacked` bodies in 3D, rotated, with the tags 7 and 8 at the sides."""
    bodies = []
    tags = []
    for i, (n, reach) in enumerate([(below, x_below), (above, x_above)]):
        x = np.linspace(*reach, n + 1)
        z = np.linspace(i - 1.0, i, max(n // 2, 1) + 1)
        body = create_grid(comm, [x, x, z], CELLS[cells])
        planes = {f"t{2 * i + 1}": (2, i - 1.0), f"t{2 * i + 2}": (2, float(i))}
        aside = dict(t5=(0, reach[0]), t6=(0, reach[1]), t7=(1, reach[0]), t8=(1, reach[1]))
        tags.append(tagged(body, **planes, **aside))
        bodies.append(body)
    both = join(bodies, facet_tags=tags)
    both.mesh.geometry.x[:] = both.mesh.geometry.x @ turn.T
    return both


def sheared(options=None, law=Coulomb(0.15)):  # noqa: B008
    """Two blocks of different meshes, pressed and then drawn more and more to the right."""
    both = stacked(9, 6, (0.0, 1.0), (0.0, 1.0))
    u = displacement(both.mesh)
    V = u.function_space
    gamma = fem.Constant(both.mesh, 0.0)
    moved = fem.Function(V)
    pair = ContactPair(u, both, slave=2, master=3, law=law)
    top = fem.locate_dofs_topological(V, 1, both.facet_tags.find(4))
    ends = [held(u, both.facet_tags, 1, (0, 0)), fem.dirichletbc(moved, top)]
    energy = MATERIAL.energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [pair], bcs=ends, petsc_options=options)
    way = ufl.as_vector((0.02 * gamma, -0.02 + 0.012 * gamma))
    system = ParametricContact(problem, gamma, driven=[(moved, way)])
    x = solved_start(system, 0.0)
    return system, x


def pair_of(u, both, degrees, sides=(3, 2), law=Coulomb(0.5), **options):  # noqa: B008
    """An integral pair; tags of slave and master."""
    sides = dict(zip(("slave", "master"), sides, strict=True))
    options = {"method": "integral", "multiplier_degree": degrees[1], **options}
    return ContactPair(u, both, law=law, **sides, **options)


def largest_sum(pair):
    """Return the largest sum of the weights of a contact point; all sums should vanish."""
    ones, sums = pair.points.operator.B.createVecs()
    ones.set(1.0)
    pair.points.operator.B.mult(ones, sums)
    return largest(sums.array_r)


def solved_patch(
    both, frame, base, sides, degrees, aside, *, load=None, clear=1e-11, fixed=(1,), **options
):
    """A linear displacement, with pressure and a shear below the bound, to round-off.

    It is given on the facets of the tags ``fixed``, and the traction on those ``aside``.
    """
    dim = len(base)
    u = displacement(both.mesh, degrees[0])
    V = u.function_space
    gradient = 1e-3 * frame @ base @ frame.T
    strain = (gradient + gradient.T) / 2
    stress = MATERIAL.lmbda * np.trace(strain) * np.eye(dim) + 2 * MATERIAL.mu * strain
    normal = frame[:, -1]
    traction = stress @ normal
    pressure = -normal @ traction
    shear = np.linalg.norm(traction + pressure * normal)
    assert 0 < 3 * shear < pressure
    exact = fem.Function(V)
    exact.interpolate(lambda x: gradient @ x[:dim])
    pair = pair_of(u, both, degrees, sides, **options)
    assert largest_sum(discretise(pair)) < 1e-14
    ds = ufl.Measure("ds", both.mesh, subdomain_data=both.facet_tags)
    given = ufl.dot(fem.Constant(both.mesh, stress), ufl.FacetNormal(both.mesh))
    energy = MATERIAL.energy(u) * ufl.dx - ufl.dot(given, u) * ds(aside)
    if load is not None:
        energy -= load(u, traction)
    facets = np.concatenate([both.facet_tags.find(tag) for tag in fixed])
    ends = [fem.dirichletbc(exact, fem.locate_dofs_topological(V, dim - 1, np.sort(facets)))]
    accurate = {"snes_rtol": 1e-13}
    result = ContactProblem(energy, u, [pair], bcs=ends, petsc_options=accurate).solve()
    table = result.tables["contact"]
    free = table.letters != "d"
    assert set(table.letters[free]) == {"k"}
    np.testing.assert_allclose(table.pressure[free], pressure, rtol=clear)
    found = np.linalg.norm(table.shear[free], axis=1)
    np.testing.assert_allclose(found, shear, atol=clear * pressure)
    assert largest(u.x.array - exact.x.array) < 1e-11 * largest(exact.x.array)
    assert result.imbalance < 1e-12
    return table


def pressed(comm, dim, degrees, *, law=Coulomb(0.2), unit=1.0, **options):  # noqa: B008
    """A block with a round face, pressed on another and drawn aside: all statuses."""
    if dim == 2:
        both = stacked(5, 7, (-0.3, 1.3), (0.0, 1.0), "tri", comm=comm)
    else:
        both = solids(3, 4, (-0.3, 1.3), (0.0, 1.0), "tet", turn=np.eye(3), comm=comm)
    x = both.mesh.geometry.x
    upper = np.unique(both.mesh.geometry.dofmap[both.cell_tags.find(2)])
    x[upper, dim - 1] += 0.2 * (x[upper, 0] - 0.4) ** 2 * (1 - x[upper, dim - 1])
    x[:] = unit * x
    u = displacement(both.mesh, degrees[0])
    pair = pair_of(u, both, degrees, law=law, **options)
    way = unit * np.array([0.015, *[0.0] * (dim - 2), -0.04])
    ends = [held(u, both.facet_tags, 1, np.zeros(dim)), held(u, both.facet_tags, 4, way)]
    steel = LinearElastic.from_young(1000.0, 0.3)
    return ContactProblem(steel.energy(u) * ufl.dx, u, [pair], bcs=ends)
