"""Two bodies in contact, a cracked box, and tagged facets."""

from mpi4py import MPI

import numpy as np
import pytest
from cases._triangle import linear_triangle

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactPair,
    ContactProblem,
    Coulomb,
    Frictionless,
    ParametricContact,
)
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join
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
    """A box with a crack at mid height that reaches from -1 to ``reach``; tags as `stacked`."""
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
