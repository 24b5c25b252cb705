"""Two bodies in contact, cracked boxes, discs of revolution, and tagged facets."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.materials import (
    Axisymmetric,
    LinearElastic,
)
from dolfinx_contact.meshing import crack, join
from dolfinx_contact.problem import discretise
from support.blocks import box, facets

COMM = MPI.COMM_WORLD


MATERIAL = LinearElastic.from_young(1000.0, 0.3)


def tagged(domain, **planes):
    """MeshTags of the facets on coordinate planes, ``axis, value`` by tag."""
    dim = domain.topology.dim
    found = [facets(domain, *plane) for plane in planes.values()]
    numbers = [int(k[1:]) for k in planes]
    values = np.repeat(np.array(numbers, dtype=np.int32), [len(f) for f in found])
    every = np.concatenate(found)
    order = np.argsort(every)
    return mesh.meshtags(domain, dim - 1, every[order], values[order])


def stacked(dim, cell, n=3, *, gap=0.0, heights=(0.0, 1.0)):
    """Two boxes one over the other, lower first: tags 1 below, 2 and 3 face to face, 4 above."""
    bodies = []
    tags = []
    for i, z in enumerate(heights):
        body = box(COMM, n, cell)
        body.geometry.x[:, dim - 1] += z + gap * i
        planes = {
            f"t{2 * i + 1}": (dim - 1, z + gap * i),
            f"t{2 * i + 2}": (dim - 1, z + 1 + gap * i),
        }
        bodies.append(body)
        tags.append(tagged(body, **planes))
    return join(bodies, facet_tags=tags)


def displacement(domain, degree=1):
    dim = domain.topology.dim
    return fem.Function(fem.functionspace(domain, ("Lagrange", degree, (dim,))))


def held(u, tags, tag, value):
    V = u.function_space
    fdim = tags.dim
    return fem.dirichletbc(
        np.asarray(value, dtype=float), fem.locate_dofs_topological(V, fdim, tags.find(tag)), V
    )


def largest(values):
    return COMM.allreduce(float(np.max(np.abs(values), initial=0.0)), op=max)


def triangle_on_a_body(n, friction):
    """The linear triangle on its mirror image, which is held."""
    upper = linear_triangle(n, friction).problem.V.mesh
    lower = linear_triangle(n, friction).problem.V.mesh
    lower.geometry.x[:, 1] *= -1.0
    tags = [
        tagged(upper, t1=(1, 0.0), t2=(0, 0.0)),
        tagged(lower, t3=(1, 0.0)),
    ]
    both = join([upper, lower], facet_tags=tags)
    domain = both.mesh
    u = displacement(both.mesh)
    V = u.function_space
    gamma = fem.Constant(both.mesh, -1.0)
    ds = ufl.Measure("ds", domain, subdomain_data=both.facet_tags)
    load = -gamma * fem.Constant(domain, (26.0, 7.5))
    energy = LinearElastic(100.0, 82.0).energy(u) * ufl.dx - ufl.dot(load, u) * ds(2)
    slope = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[0] + np.abs(x[1]), 1))
    still = fem.locate_dofs_topological(V, 2, both.cell_tags.find(2))
    ends = [
        fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V),
        fem.dirichletbc(np.zeros(2), still, V),
    ]
    pair = ContactPair(u, both, slave=1, master=3, law=Coulomb(friction))
    return ParametricContact(ContactProblem(energy, u, [pair], bcs=ends), gamma)


def cracked(dim, cell, reach, n=4):
    """A box with a crack at mid height reaching from -1 to ``reach``; tags as `stacked`."""
    domain = box(COMM, n, cell)
    fdim = dim - 1
    up = dim - 1
    domain.topology.create_entities(fdim)
    inside = mesh.locate_entities(
        domain, fdim, lambda x: np.isclose(x[up], 0.5) & (x[0] < reach + 1e-9)
    )
    ends = [facets(domain, up, 0.0), facets(domain, up, 1.0)]
    every = np.concatenate([inside, *ends])
    values = np.repeat(np.array([5, 1, 4], dtype=np.int32), [len(inside), *map(len, ends)])
    order = np.argsort(every)
    tags = mesh.meshtags(domain, fdim, every[order], values[order])
    return domain, tags


def refused(match, u, body, **options):
    with pytest.raises(ValueError, match=match) as info:
        discretise(ContactPair(u, body, law=Frictionless(), **{"slave": 3, "master": 2, **options}))
    assert len(set(COMM.allgather(str(info.value)))) == 1


FLOOR = HalfSpace((0.0, 0.0), (0.0, 1.0))


def held_of_revolution(V, i, domain, axis, place, value):
    dofs = fem.locate_dofs_topological(V.sub(i), 1, facets(domain, axis, place))
    return fem.dirichletbc(value, dofs, V.sub(i))


def section(n=5, cell="tri", size=1.0):
    """Return a disc of unit radius and height with cells of all shapes."""
    domain = box(COMM, n, cell)
    x = domain.geometry.x
    x[:, 0] = x[:, 0] ** 1.3
    x[:, 1] += 0.1 * np.sin(3 * x[:, 0]) * x[:, 1] * (1 - x[:, 1])
    x *= size
    return domain


def energy_of_revolution(u, both, *moduli):
    """Elastic energy of parts 1, 2, ..., of Young's modulus and Poisson's ratio of each."""
    dx = ufl.Measure("dx", both.mesh, subdomain_data=both.cell_tags)
    return sum(
        Axisymmetric(LinearElastic.from_young(*pair)).energy(u) * dx(k)
        for k, pair in enumerate(moduli, 1)
    )


def disc(
    domain, degree=1, method="nodal", *, size=1.0, modulus=1.0, law=None, lid=None, options=None
):
    """A disc on a floor, pressed by a hundredth of its height, free to widen."""
    V = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    given = dict(obstacle=FLOOR, law=law or Frictionless(), method=method, axisymmetric=True)
    surface = ContactSurface(u, facets(domain, 1, 0.0), **given)
    material = Axisymmetric(LinearElastic.from_young(1000.0 * modulus, 0.3))
    energy = material.energy(u) * ufl.dx
    bcs = [held_of_revolution(V, 1, domain, 1, size, -0.01 * size if lid is None else lid)]
    options = {"snes_rtol": 1e-12} | (options or {})
    return ContactProblem(energy, u, [surface], bcs=bcs, petsc_options=options)


def blocks(cell, below, above, degree, method, *, law, gap=0.0):
    """Two unit blocks, one on the other; tags 1 below, 2 and 3 face to face, 4 above."""
    bodies = []
    tags = []
    for i, n in enumerate((below, above)):
        body = box(COMM, n, cell)
        up = body.topology.dim - 1
        z = i * (1 + gap)
        body.geometry.x[:, up] += z
        tags.append(tagged(body, **{f"t{2 * i + 1}": (up, z), f"t{2 * i + 2}": (up, z + 1)}))
        bodies.append(body)
    both = join(bodies, facet_tags=tags)
    u = displacement(both.mesh, degree)
    return both, u, ContactPair(u, both, slave=3, master=2, law=law, method=method)


def pressed_blocks(*case, friction=None, gap=0.0):
    """The upper block is moved: straight down in a box without friction, or aside as well."""
    law = Frictionless() if friction is None else Coulomb(friction)
    both, u, pair = blocks(*case, law=law, gap=gap)
    V = u.function_space
    dim = both.mesh.topology.dim
    shift = np.zeros(dim)
    shift[-1] = -0.02
    ends = []
    if friction is None:
        for i in range(dim - 1):
            for x in (0.0, 1.0):
                dofs = fem.locate_dofs_topological(V.sub(i), dim - 1, facets(both.mesh, i, x))
                ends.append(fem.dirichletbc(0.0, dofs, V.sub(i)))
    else:
        shift[0] = 0.02
    ends += [held(u, both.facet_tags, 1, np.zeros(dim)), held(u, both.facet_tags, 4, shift)]
    options = {"snes_rtol": 1e-12}
    return ContactProblem(MATERIAL.energy(u) * ufl.dx, u, [pair], bcs=ends, petsc_options=options)


def branched(comm, n=6, *, slave="5_opposite", method="nodal"):
    """A block with a crack across it and an arm from there to its top, whose sides part with gamma.

    At the end of the arm two nodes above the crack face one below; the left part is pressed and
    dragged, the right one lifted.
    """
    domain = box(comm, n, "quad")
    domain.topology.create_entities(1)
    flat = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5))
    arm = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[0], 0.5) & (x[1] > 0.5 - 1e-9))
    every = [flat, arm, facets(domain, 1, 0.0), facets(domain, 1, 1.0)]
    values = np.repeat(np.array([5, 6, 1, 4], dtype=np.int32), [len(f) for f in every])
    order = np.argsort(np.concatenate(every))
    tags = mesh.meshtags(domain, 1, np.concatenate(every)[order], values[order])
    body = crack(domain, [5, 6], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Function(V)
    gamma = fem.Constant(body.mesh, 0.0)
    x = ufl.SpatialCoordinate(body.mesh)
    left = ufl.conditional(ufl.lt(x[0], 0.49), 1.0, 0.0)
    way = ufl.as_vector([-0.04 * left * gamma, 0.02 * gamma * (1 - left) - 0.02 * left])
    still = fem.locate_dofs_topological(V, 1, body.facet_tags.find(1))
    moved = fem.locate_dofs_topological(V, 1, body.facet_tags.find(4))
    # The two nodes at the middle of the top are free.
    middle = np.isclose(V.tabulate_dof_coordinates()[moved, 0], 0.5)
    bcs = [fem.dirichletbc(np.zeros(2), still, V), fem.dirichletbc(top, moved[~middle])]
    master = {"5_opposite": 5}[slave]
    pair = ContactPair(u, body, slave=slave, master=master, law=Coulomb(0.3), method=method)
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [pair], bcs=bcs)
    return ParametricContact(problem, gamma, driven=[(top, way)])
