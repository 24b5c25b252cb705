"""Quadratic elements with friction: equilibrium and contact law from displacements, in numpy."""

from mpi4py import MPI

import numpy as np
import pytest

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.materials import LinearElastic

YOUNG = 100.0
POISSON = 0.3


def height(x, dim):
    """Initial gap below the block."""
    return 0.02 * sum((x[i] - 0.4) ** 2 for i in range(dim - 1))


def pressed(dim, cells, friction):
    """Press a block on a curved floor and drag it.

    Returns:
        Coordinates and displacements of the nodes, and the nodes of the cells, vertices first.
    """
    comm = MPI.COMM_SELF
    create = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    domain = create(comm, *[cells] * dim)
    V = fem.functionspace(domain, ("Lagrange", 2, (dim,)))
    u = fem.Function(V)
    top, bottom = (
        mesh.locate_entities_boundary(domain, dim - 1, lambda x, z=z: np.isclose(x[dim - 1], z))
        for z in (1.0, 0.0)
    )
    moved = np.array([0.009, 0.003, -0.01])[[0, 1, 2] if dim == 3 else [0, 2]]
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, dim - 1, top), V)
    below = -height(ufl.SpatialCoordinate(domain), dim)
    up = np.eye(dim)[-1]
    floor = HalfSpace(point=ufl.as_vector([0.0] * (dim - 1) + [below]), normal=up)
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction), sliding="small")
    energy = LinearElastic.from_young(YOUNG, POISSON).energy(u) * ufl.dx
    tight = {"snes_rtol": 1e-13}
    ContactProblem(energy, u, [surface], bcs=[held], petsc_options=tight).solve()
    return V.tabulate_dof_coordinates()[:, :dim], u.x.array.reshape(-1, dim), V.dofmap.list


def rule(corners, points=3):
    """Return points and weights of a Gauss rule on a simplex, exact for polynomials of degree 3."""
    s, w = np.polynomial.legendre.leggauss(points)
    s, w = (s + 1) / 2, w / 2
    d = len(corners) - 1
    barycentric, weights = np.ones((1, 1)), np.ones(1)
    for k in range(d):  # a simplex is a cone over the simplex before
        scale = np.repeat(s, len(weights))[:, None]
        old = np.tile(barycentric, (points, 1))
        barycentric = np.hstack([scale * old, 1 - scale])
        weights = np.kron(w * s**k, weights)
    edges = corners[1:] - corners[0]
    return barycentric @ corners, weights * np.sqrt(np.linalg.det(edges @ edges.T))


def monomials(x, degree):
    """Return the monomials up to the degree 1 or 2, shape (points, number)."""
    terms = [np.ones(len(x)), *x.T]
    if degree == 2:
        terms += [x[:, i] * x[:, j] for i in range(x.shape[1]) for j in range(i + 1)]
    return np.stack(terms, axis=1)


def gradients(x):
    """Return the gradients of the quadratic monomials, shape (points, number, dim)."""
    n, dim = x.shape
    eye = np.broadcast_to(np.eye(dim), (n, dim, dim))
    terms = [np.zeros((n, dim)), *eye.transpose(1, 0, 2)]
    for i in range(dim):
        for j in range(i + 1):
            terms.append(x[:, [i]] * np.eye(dim)[j] + x[:, [j]] * np.eye(dim)[i])
    return np.stack(terms, axis=1)


def forces(x, u, cells):
    """Return the nodal forces in equilibrium with the stresses, shape (nodes, dim)."""
    dim = x.shape[1]
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    shear = YOUNG / (2 * (1 + POISSON))
    result = np.zeros_like(x)
    for nodes in cells:
        shapes = np.linalg.inv(monomials(x[nodes], 2))
        points, weights = rule(x[nodes[: dim + 1]])
        slopes = np.einsum("pmi,mk->pki", gradients(points), shapes)
        gradient = np.einsum("pki,kj->pji", slopes, u[nodes])
        strain = (gradient + gradient.transpose(0, 2, 1)) / 2
        trace = np.trace(strain, axis1=1, axis2=2)
        stress = lame * trace[:, None, None] * np.eye(dim) + 2 * shear * strain
        result[nodes] += np.einsum("p,pki,pji->kj", weights, slopes, stress)
    return result


def face(x, u, cells):
    """Integrate over the lower face with the hat functions of its vertices.

    Returns:
        Vertices; mean displacements with the gap in the last column, shape (vertices, dim); the
        integrals of hat functions times quadratic shape functions, shape (vertices, nodes).
    """
    dim = x.shape[1]
    vertices = np.unique([n for nodes in cells for n in nodes[: dim + 1] if x[n, -1] < 1e-9])
    number = {n: i for i, n in enumerate(vertices)}
    areas = np.zeros(len(vertices))
    motions = np.zeros((len(vertices), dim))
    coupling = np.zeros((len(vertices), len(x)))
    for nodes in cells:
        corners = nodes[: dim + 1]
        below = x[corners, -1] < 1e-9
        if below.sum() != dim:
            continue
        points, weights = rule(x[corners[below]])
        shapes = monomials(points, 2) @ np.linalg.inv(monomials(x[nodes], 2))
        hats = (monomials(points, 1) @ np.linalg.inv(monomials(x[corners], 1)))[:, below]
        motion = shapes @ u[nodes]
        motion[:, -1] += height(points.T, dim)
        at = [number[n] for n in corners[below]]
        areas[at] += weights @ hats
        motions[at] += np.einsum("p,pi,pj->ij", weights, hats, motion)
        coupling[np.ix_(at, nodes)] += np.einsum("p,pi,pk->ik", weights, hats, shapes)
    return vertices, motions / areas[:, None], coupling


@pytest.mark.parametrize(("dim", "cells"), [(2, 8), (3, 4)])
@pytest.mark.verifies(
    "mixed contact",
    "Coulomb",
    reference="independent code: assembly in numpy",
    aspects=("2D", "3D"),
)
def test_quadratic_displacements_satisfy_equilibrium_and_the_contact_law(dim, cells):
    friction = 0.3
    x, u, dofmap = pressed(dim, cells, friction)
    f = forces(x, u, dofmap)
    vertices, motion, coupling = face(x, u, dofmap)
    small = 1e-9 * np.abs(f).max()
    on_face = x[:, -1] < 1e-9
    np.testing.assert_allclose(f[~on_face & (x[:, -1] < 1 - 1e-9)], 0.0, atol=small)
    # tractions that are linear on facets hold the nodes of the face
    traction = np.linalg.lstsq(coupling[:, on_face].T, f[on_face], rcond=None)[0]
    np.testing.assert_allclose(coupling[:, on_face].T @ traction, f[on_face], atol=small)
    pressure, shear = traction[:, -1], traction[:, :-1]
    gap, slip = motion[:, -1], motion[:, :-1]
    largest, longest = pressure.max(), np.abs(u).max()
    assert pressure.min() > -1e-9 * largest
    assert gap.min() > -1e-9 * longest
    assert np.minimum(gap / longest, pressure / largest).max() < 1e-9
    size = np.linalg.norm(shear, axis=1)
    assert np.all(size < friction * pressure + 1e-9 * largest)
    slips = np.linalg.norm(slip, axis=1)
    closed = pressure > 1e-6 * largest
    moves = closed & (slips > 1e-8 * longest)
    opposite = -friction * pressure[moves, None] * slip[moves] / slips[moves, None]
    np.testing.assert_allclose(shear[moves], opposite, atol=1e-7 * largest)
    assert moves.any()
    assert np.any(closed & ~moves)
    assert np.any(~closed)
    assert len(vertices) == (cells + 1) ** (dim - 1)
