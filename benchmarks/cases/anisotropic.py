# SPDX-License-Identifier: LGPL-3.0-or-later
"""Oblique fibres.

Reference: Stroh's half-plane. `demos/demo_anisotropic.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number

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


def elasticity(fibres, degrees):
    """C with lambda = mu = 1, and fibres at an angle (2, 2, 2, 2)."""
    angle = np.radians(degrees)
    a = np.array([np.cos(angle), np.sin(angle)])
    unit = np.eye(2)
    volume = np.einsum("ij,kl->ijkl", unit, unit)
    along_fibres = np.einsum("i,j,k,l->ijkl", a, a, a, a)
    straight = np.einsum("ik,jl->ijkl", unit, unit)
    crossed = np.einsum("il,jk->ijkl", unit, unit)
    return volume + fibres * along_fibres + straight + crossed


def threshold(C):
    """F* of slip to the left, of the half-plane above the floor; infinite if there is none."""
    Q = C[:, 0, :, 0]
    R = C[:, 0, :, 1]
    T = C[:, 1, :, 1]
    inverse = np.linalg.inv(T)
    upper = [np.zeros((2, 2)), np.eye(2)]
    lower = [-inverse @ Q, -inverse @ (R + R.T)]
    N = np.block([upper, lower])
    p, vectors = np.linalg.eig(N)  # waves exp(i (x + p y))
    decays = p.imag > 0  # upwards
    A = vectors[:2, decays]
    columns = []
    for root, a in zip(p[decays], A.T, strict=True):
        columns.append((R.T + root * T) @ a)
    forces = np.stack(columns, axis=1)
    Z = -1j * forces @ np.linalg.inv(A)
    compliance = np.linalg.inv(Z).real
    normal = compliance[1, 1]
    coupling = compliance[1, 0]
    if coupling < -1e-12:
        return -normal / coupling
    return np.inf


def body(n, friction, fibres, degrees, comm=MPI.COMM_WORLD):
    domain = mesh.create_unit_square(comm, n, n)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    v = ufl.TestFunction(V)
    y = ufl.SpatialCoordinate(domain)[1]
    values = elasticity(fibres, degrees)
    C = ufl.as_tensor(values.tolist())
    i, j, k, m = ufl.indices(4)

    def work(a, b):  # C has the symmetries of strains
        stress = C[i, j, k, m] * ufl.grad(a)[i, j]
        return stress * ufl.grad(b)[k, m] * ufl.dx

    def edge(height):
        return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))

    bottom = np.sort(edge(0.0))
    ones = np.ones(len(bottom), dtype=np.int32)
    tags = mesh.meshtags(domain, 1, bottom, ones)
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    slid = ufl.as_vector((-0.1 * (1 - y), 0 * y))
    reaction = friction * v[0] + v[1]
    residual = work(u, v) - work(slid, v) + reaction * ds
    top = fem.locate_dofs_topological(V, 1, edge(1.0))
    held = fem.dirichletbc(np.zeros(2), top, V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
    return ContactProblem(residual, u, [surface], bcs=[held])


def negative(n, friction, *material, comm=MPI.COMM_WORLD):
    problem = body(n, friction, *material, comm)
    A = np.linalg.inv(problem.reduced().S)
    normal = A[1::2, 1::2]
    coupling = A[1::2, 0::2]
    held = normal + friction * coupling
    eigenvalues = np.linalg.eigvalsh(held + held.T)
    return int(np.sum(eigenvalues < 0))


def main(argv=None):
    parser = ScriptParser("Oblique fibres", output="output/anisotropic")
    add = parser.add_argument
    add("--fibres", type=number(), default=20.0, help="stiffness, matrix: 1")
    add("--degrees", type=number(), default=45.0, help="to the floor")
    add("--frictions", type=number(above=0), nargs="+", default=[1.6, 5.0])
    add("--n", type=int, nargs="+", default=[5, 7], help="cells: all solutions")
    add("--fine", type=int, nargs="+", default=[8, 16, 32], help="eigenvalues")
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    material = (args.fibres, args.degrees)
    limit = threshold(elasticity(*material))
    say(f"the half-plane holds up to F* = {limit:.6g}")
    rows = []
    for friction in args.frictions:
        counts = [negative(n, friction, *material, comm=comm) for n in args.fine]
        say(f"F = {friction:g}: negative eigenvalues {counts} for n = {args.fine}")
        solutions = []
        statuses = []
        for n in args.n:
            problem = body(n, friction, *material, comm)
            system = ParametricContact(problem)  # without a parameter
            start = system.create_vector()
            found = find_solutions(system, [start], 0.0)
            count = len(found.found)
            solutions.append([count, found.complete])
            letters = [system.letters(s.piece) for s in found.found]
            statuses.append(sorted(letters))
            say(f"  n = {n}: {count} solutions, {found.method}")
        row = {"friction": friction, "solutions": solutions, "statuses": statuses}
        row["negative"] = counts
        rows.append(row)
    points = found.points(system)
    plot.picture_of_states(folder / "states.png", system, points)
    return io.write_summary(comm, folder, {"rows": rows})


if __name__ == "__main__":
    main()
