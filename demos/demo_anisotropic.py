# SPDX-License-Identifier: LGPL-3.0-or-later
# # Oblique fibres: beyond which friction a finer mesh has more solutions
#
# This demo illustrates how to:
#
# - write an anisotropic body in UFL, and get at the compliance of its contact points;
# - look, with a proof, at how many solutions a mesh and a finer one have.
#
# P. Ballard and F. Iurlano (arXiv:2303.16298) prove that an isotropic plane body has a solution for
# any friction, an anisotropic one as long as friction is not too strong; beyond, there may be none.
# A discrete problem always has one; what can be seen is that meshes do not agree.
#
# A half-plane whose surface is drawn in waves exp(i k x) answers by forces |k| Z u, with a matrix Z
# of the material, Hermitian (Stroh). Where it slips to the left under the pressure p the shear is
# F p, and the gap that p makes is (A_nn + F Re A_nt) p / |k|, A = Z^-1, however short the waves.
# Of an isotropic body Re A_nt = 0. Of one with oblique fibres this is negative beyond
# F* = -A_nn / Re A_nt: the harder a wave of pressure presses, the less it holds.

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.continuation import find_solutions
from dolfinx_contact.parametric import ParametricContact


def elasticity(fibres, degrees):
    """C with lambda = mu = 1, and fibres at an angle (2, 2, 2, 2)."""
    unit = np.eye(2)
    a = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    C = np.einsum("ij,kl->ijkl", unit, unit) + fibres * np.einsum("i,j,k,l->ijkl", a, a, a, a)
    return C + np.einsum("ik,jl->ijkl", unit, unit) + np.einsum("il,jk->ijkl", unit, unit)


def threshold(C):
    """F* of slip to the left, of the half-plane above the floor; infinite if there is none."""
    Q, R, T = C[:, 0, :, 0], C[:, 0, :, 1], C[:, 1, :, 1]
    inverse = np.linalg.inv(T)
    N = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ Q, -inverse @ (R + R.T)]])
    p, vectors = np.linalg.eig(N)  # waves exp(i (x + p y)), those that decay upwards
    p, A = p[p.imag > 0], vectors[:2, p.imag > 0]
    forces = np.stack([(R.T + q * T) @ a for q, a in zip(p, A.T, strict=True)], axis=1)
    compliance = np.linalg.inv(-1j * forces @ np.linalg.inv(A)).real
    return -compliance[1, 1] / compliance[1, 0] if compliance[1, 0] < -1e-12 else np.inf


# ## A block that may slip uniformly
#
# The block hangs from its held top. Its loads are such that the state u = (-0.1 (1 - y), 0) with a
# pressure of 1 all over the contact face, which slips to the left, is a solution on every mesh.


def body(n, friction, fibres, degrees, comm=MPI.COMM_WORLD):
    domain = mesh.create_unit_square(comm, n, n)
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, v, y = fem.Function(V), ufl.TestFunction(V), ufl.SpatialCoordinate(domain)[1]
    C, (i, j, k, m) = ufl.as_tensor(elasticity(fibres, degrees).tolist()), ufl.indices(4)

    def work(a, b):  # C has the symmetries of strains
        return C[i, j, k, m] * ufl.grad(a)[i, j] * ufl.grad(b)[k, m] * ufl.dx

    def edge(height):
        return mesh.locate_entities_boundary(domain, 1, lambda x: np.isclose(x[1], height))

    bottom = np.sort(edge(0.0))
    tags = mesh.meshtags(domain, 1, bottom, np.ones(len(bottom), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    slid = ufl.as_vector((-0.1 * (1 - y), 0 * y))
    residual = work(u, v) - work(slid, v) + (friction * v[0] + v[1]) * ds
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, edge(1.0)), V)
    surface = ContactSurface(u, bottom, obstacle=HalfSpace((0, 0), (0, 1)), law=Coulomb(friction))
    return ContactProblem(residual, u, [surface], bcs=[held])


# ## What the meshes say
#
# Of the symmetric part of A_nn + F A_nt of all contact points the negative eigenvalues are counted:
# the ways in which pressure does not hold the face. And all solutions are looked for.


def negative(n, friction, *material, comm=MPI.COMM_WORLD):
    A = np.linalg.inv(body(n, friction, *material, comm).reduced().S)
    held = A[1::2, 1::2] + friction * A[1::2, 0::2]
    return int(np.sum(np.linalg.eigvalsh(held + held.T) < 0))


def main(argv=None):
    parser = ScriptParser("Oblique fibres", output="output/anisotropic")
    parser.add_argument("--fibres", type=number(), default=20.0, help="stiffness, matrix: 1")
    parser.add_argument("--degrees", type=number(), default=45.0, help="to the floor")
    parser.add_argument("--frictions", type=number(above=0), nargs="+", default=[1.6, 5.0])
    parser.add_argument("--n", type=int, nargs="+", default=[5, 7], help="cells: all solutions")
    parser.add_argument("--fine", type=int, nargs="+", default=[8, 16, 32], help="eigenvalues")
    args, comm = parser.parse(argv), MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    material, rows = (args.fibres, args.degrees), []
    say(f"the half-plane holds up to F* = {threshold(elasticity(*material)):.6g}")
    for friction in args.frictions:
        row = dict(friction=friction, solutions=[], statuses=[])
        row["negative"] = [negative(n, friction, *material, comm=comm) for n in args.fine]
        say(f"F = {friction:g}: negative eigenvalues {row['negative']} for n = {args.fine}")
        for n in args.n:
            problem = body(n, friction, *material, comm)
            system = ParametricContact(problem, fem.Constant(problem.V.mesh, 0.0))
            found = find_solutions(system, [system.create_vector()], 0.0)
            row["solutions"].append([len(found.found), found.complete])
            row["statuses"].append(sorted(system.letters(s.piece) for s in found.found))
            say(f"  n = {n}: {len(found.found)} solutions, {found.method}")
        rows.append(row)
    output.picture_of_states(folder / "states.png", system, found.points(system))
    return output.write_summary(comm, folder, {"rows": rows})


if __name__ == "__main__":
    main()
