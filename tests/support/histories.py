"""Dragged, driven, falling, punched and sheared blocks."""

from mpi4py import MPI

import numpy as np
from cases._triangle import element

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    Frictionless,
    HalfSpace,
    ParametricContact,
    RigidBody,
    materials,
)
from dolfinx_contact.materials import LinearElastic
from support.blocks import box, facets, interpolate
from support.pairs import displacement

COMM = MPI.COMM_WORLD


def dragged(
    cell="quad", n=4, *, method=None, degree=1, obstacle=None, energy=None, r=None, law=None
):
    """A block on a floor, friction 0.3, and the Function by which its top moves."""
    domain = box(COMM, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    top = fem.Function(V)
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=obstacle(domain) if obstacle else HalfSpace(np.zeros(dim), np.eye(dim)[-1]),
        law=law(domain) if law else Coulomb(0.3),
        method=method,
    )
    density = (energy or LinearElastic.from_young(1000.0, 0.3)).energy(u)
    bcs = [fem.dirichletbc(top, held)]
    return ContactProblem(density * ufl.dx, u, [surface], bcs=bcs, r=r), top


def put(top, motion):
    top.x.array[:] = np.tile(motion, len(top.x.array) // len(motion))


def cycle(top):
    """A load: down in the first unit of time, then to the right and back in two each."""

    def load(t):
        motion = np.zeros(top.function_space.mesh.geometry.dim)
        motion[0] = 0.012 * np.interp(t, [1, 3, 5], [0, 1, -1])
        motion[-1] = -0.01 * min(t, 1.0)
        put(top, motion)

    return load


def klarbring():
    """The node with kt = kn = 2, k = 1 and friction 3, under (-g, -1); its Constant g."""
    system = element((1.0, 1.0), 3.0, 1.0, (-2.0, 0.0), (0.0, -2.0))
    return system.problem, system.constant


def falling_block(
    cell="quad",
    n=1,
    *,
    comm=COMM,
    material=None,
    weight=0.0,
    friction=0.0,
    degree=1,
    height=0.0,
    held=None,
    size=1.0,
):
    """A block over a floor, with the Function on its top if that is held."""
    domain = box(comm, n, cell, size=size)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    up = np.eye(dim)[-1]
    material = material or LinearElastic.from_young(1000.0, 0.3)
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=HalfSpace(-height * up, up),
        law=Coulomb(friction) if friction else Frictionless(),
    )
    pull = fem.Constant(domain, float(weight)) * u[dim - 1] * ufl.dx
    bcs = []
    if held is not None:
        top = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, size))
        held = fem.Function(V)
        bcs = [fem.dirichletbc(held, top)]
    return ContactProblem(material.energy(u) * ufl.dx + pull, u, [surface], bcs=bcs), held


def punched_block(
    obstacle,
    dim=2,
    n=4,
    law=None,
    *,
    method=None,
    degree=1,
    comm=COMM,
    size=1.0,
    young=1000.0,
    where=None,
    more=(),
    hyper=False,
    options=None,
):
    """A block held at its bottom, with contact on its top or on given pairs (obstacle, facets)."""
    domain = box(comm, n, "tri" if dim == 2 else "tet", size=size)
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    low = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 0.0))
    parts = where(domain) if where else [(obstacle, facets(domain, dim - 1, size))]
    surfaces = [
        ContactSurface(u, f, obstacle=o, law=law or Coulomb(0.3), method=method, name=f"top {i}")
        for i, (o, f) in enumerate(parts)
    ]
    material = materials.LinearElastic.from_young(young, 0.3)
    if hyper:
        material = materials.NeoHookean(600.0, 400.0)
    bcs = [fem.dirichletbc(np.zeros(dim), low, V), *(bc(V) for bc in more)]
    return ContactProblem(material.energy(u) * ufl.dx, u, surfaces, bcs=bcs, petsc_options=options)


def punch(dim=2, size=1.0, **given):
    """A flat punch on the top of the punched_block, about the middle of its face."""
    up = np.eye(dim)[-1]
    middle = size * (0.5 * np.ones(dim) + 0.5 * up)
    return RigidBody(HalfSpace(size * up, -up), about=middle, name="punch", **given)


def driven_block(kind, cell="quad", n=4, material=None, comm=COMM):
    """A block whose parameter is of the given kind, with the starting value of gamma."""
    domain = box(comm, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    top = fem.Function(V)
    gamma = fem.Constant(domain, 0.5)
    x = ufl.SpatialCoordinate(domain)
    energy = (material or LinearElastic.from_young(1000.0, 0.3)).energy(u) * ufl.dx
    friction = 0.3
    point = fem.Constant(domain, (0.0,) * dim)
    driven = []
    move = ufl.as_vector([0.004, *[0.0] * (dim - 2), -0.01 - 0.001 * x[0]])
    if kind == "load":
        energy -= gamma**2 * ufl.dot(ufl.as_vector([3.0, *[0.0] * (dim - 2), -2.0]), u) * ufl.dx
    elif kind == "friction":
        friction = 0.2 * gamma
    elif kind == "obstacle":
        point = ufl.as_vector([*[0.0] * (dim - 1), 0.005 * gamma])
    elif kind == "dirichlet":
        move = ufl.sin(gamma) * move
        driven = [(top, move)]
    interpolate(top, move)
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        obstacle=HalfSpace(point, np.eye(dim)[-1]),
        law=Coulomb(friction),
    )
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(top, held)])
    return ParametricContact(problem, gamma, driven=driven)


def rollers(u, *axes_and_values):
    """Normal displacements of planes that are held at 0."""
    V = u.function_space
    return [
        fem.dirichletbc(
            0.0,
            fem.locate_dofs_topological(
                V.sub(i), V.mesh.topology.dim - 1, facets(V.mesh, i, value)
            ),
            V.sub(i),
        )
        for i, value in axes_and_values
    ]


def sheared_block(law, dim, cell, s, pressed, shear):
    """A block in simple shear, nu = 0; normal displacements are known but at the floor."""
    domain = box(COMM, 2, cell)
    u = displacement(domain)
    up = dim - 1
    V = u.function_space
    floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(u, facets(domain, up, 0.0), obstacle=floor, law=law)
    held = fem.Function(V)
    normal = fem.Function(V.sub(up).collapse()[0])
    held.x.array.reshape(-1, dim)[:] = [s, *[0.0] * (dim - 2), -pressed]
    normal.interpolate(lambda x: -pressed * x[up])
    above = fem.locate_dofs_geometrical((V.sub(up), normal.function_space), lambda x: x[up] > 1e-9)
    ends = [
        fem.dirichletbc(normal, above, V.sub(up)),
        fem.dirichletbc(held, fem.locate_dofs_topological(V, up, facets(domain, up, 1.0))),
        *rollers(u, *[(1, y) for y in (0.0, 1.0) if dim == 3]),
    ]
    aside = ufl.FacetNormal(domain)[0] * shear * u[up] * ufl.ds
    energy = LinearElastic.from_young(1000.0, 0.0).energy(u) * ufl.dx - aside
    options = {"snes_rtol": 1e-13}
    return ContactProblem(energy, u, [surface], bcs=ends, petsc_options=options)
