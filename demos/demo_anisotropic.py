# SPDX-License-Identifier: LGPL-3.0-or-later
# # Oblique fibres: friction beyond which finer meshes have more solutions
#
# This demo illustrates how to:
#
# - define an anisotropic material in UFL by a residual;
# - access the compliance of the contact points (`reduced`);
# - count, with a proof, the solutions on two meshes.
#
# Ballard and Iurlano (arXiv:2303.16298) prove that an isotropic plane body has a solution for any
# friction coefficient, and an anisotropic one only below a bound. A discrete problem always has a
# solution; the bound shows as disagreement between meshes.
#
# A half-plane with the surface displacement $\mathrm{Re}\,(w e^{ikx})$ responds with the traction
# $|k| Z w$, where $Z$ is a matrix of the material (Stroh). With $A = Z^{-1}$, a wave of pressure
# $p$ on a face that slips to the left opens the gap $(A_{nn} + F\, \mathrm{Re} A_{nt})\, p/|k|$.
# With oblique fibres $\mathrm{Re} A_{nt}$ is negative, so that beyond
#
# $$F^* = -A_{nn}/\mathrm{Re} A_{nt}$$
#
# pressure no longer closes the face, for waves of any length.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    io,
    plot,
)
from dolfinx_contact.continuation import find_solutions

comm = MPI.COMM_WORLD
fibres, angle = 20.0, np.radians(45.0)  # stiffness over that of the matrix, angle with the floor
frictions = [1.6, 5.0]
meshes = [5, 7]  # cells along an edge, for all solutions
finer = [8, 16, 32]  # for the eigenvalues

# ## The material
#
# $C = \lambda\, I \otimes I + 2 \mu\, \mathbb{I} + f\, a \otimes a \otimes a \otimes a$ with
# $\lambda = \mu = 1$ and the direction $a$ of the fibres.

a = np.array([np.cos(angle), np.sin(angle)])
unit = np.eye(2)
C = (
    np.einsum("ij,kl->ijkl", unit, unit)
    + np.einsum("ik,jl->ijkl", unit, unit)
    + np.einsum("il,jk->ijkl", unit, unit)
    + fibres * np.einsum("i,j,k,l->ijkl", a, a, a, a)
)

# ## The bound of the half-plane
#
# The waves $e^{ik(x + py)}$ that decay upwards are eigenvectors of Stroh's matrix.

Q, R, T = C[:, 0, :, 0], C[:, 0, :, 1], C[:, 1, :, 1]
inverse = np.linalg.inv(T)
N = np.block([[np.zeros((2, 2)), unit], [-inverse @ Q, -inverse @ (R + R.T)]])
roots, vectors = np.linalg.eig(N)
decays = roots.imag > 0
modes = vectors[:2, decays]
tractions = np.stack(
    [(R.T + root * T) @ mode for root, mode in zip(roots[decays], modes.T, strict=True)], axis=1
)
A = np.linalg.inv(-1j * tractions @ np.linalg.inv(modes)).real
bound = -A[1, 1] / A[1, 0]
say = io.Report(comm)
say(f"half-plane: F* = {bound:.6f}")

# ## A block that slips uniformly
#
# The loads are such that $u = (-(1 - y)/10, 0)$ with the pressure 1 on the whole face is a solution
# on every mesh.


def block(n, friction):
    domain = mesh.create_unit_square(comm, n, n)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    tensor = ufl.as_tensor(C.tolist())
    i, j, k, m = ufl.indices(4)

    def work(w):
        return tensor[i, j, k, m] * ufl.grad(w)[i, j] * ufl.grad(v)[k, m] * ufl.dx

    bottom = np.sort(mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 0)))
    top = mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], 1))
    ones = np.ones(len(bottom), dtype=np.int32)
    ds = ufl.Measure("ds", domain, subdomain_data=mesh.meshtags(domain, 1, bottom, ones))(1)
    y = ufl.SpatialCoordinate(domain)[1]
    slid = ufl.as_vector((-0.1 * (1 - y), 0 * y))
    residual = work(u) - work(slid) + (friction * v[0] + v[1]) * ds
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, top), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
    return ContactProblem(residual, u, [surface], bcs=[held])


# ## What the meshes show
#
# Negative eigenvalues of the symmetric part of $A_{nn} + F A_{nt}$ count the distributions of
# pressure that do not close the face. Below the bound, neither this number nor the number of
# solutions depends on the mesh. Above the bound, both grow with the mesh.

numbers = {}
for friction in frictions:
    negative = []
    for n in finer:
        compliance = np.linalg.inv(block(n, friction).reduced().S)
        matrix = compliance[1::2, 1::2] + friction * compliance[1::2, 0::2]
        negative.append(int(np.sum(np.linalg.eigvalsh(matrix + matrix.T) < 0)))
    say(f"F = {friction:g}: {negative} negative eigenvalues for n = {finer}")
    numbers[friction] = []
    for n in meshes:
        problem = block(n, friction)
        system = ParametricContact(problem)  # without a parameter
        found = find_solutions(system, [system.create_vector()], 0.0)
        numbers[friction].append(len(found.found))
        proved = "proved" if found.complete else "not proved"
        say(f"  n = {n}: {len(found.found)} solutions, {proved}")

folder = io.output_folder(comm, "output/anisotropic")
plot.picture_of_states(folder / "states.png", system, found.points(system))
