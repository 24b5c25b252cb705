# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton iterations and whole static solves against GetFEM, on the same blocks.

Blocks of quadrilaterals and hexahedra, pressed and dragged on a plane, nodal contact with the same
augmentation parameter on both sides, one rank each. GetFEM (`add_basic_contact_brick`, Newton with
MUMPS) serves as it comes. Both are asked for their sum of contact forces, which must agree.

Every run is warm, all take turns, and medians of three count (`timing.py`). Construction is all
that follows on the mesh: spaces, forms or bricks, contact, Dirichlet data; solving is all Newton
steps with the assembly. Meshing and compilation count nowhere.

    python3 benchmarks/contact_vs_getfem.py --output getfem.json
"""

from __future__ import annotations

import argparse
import time

from mpi4py import MPI

import numpy as np
from timing import REPEATS, in_turns, save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    parse_arguments,
)
from dolfinx_contact.materials import LinearElastic, lame

FRICTION = 0.3
PRESS = 0.02
SHIFT = 0.004
POISSON = 0.3
SIZES = {2: [32, 64, 128], 3: [8, 12]}


def ours(dim, n, solver, degree):
    """Seconds, iterations and the sum of normal forces of this package.

    The body is integrated exactly up to `degree`, by UFL's own estimate where that is None.
    """
    comm = MPI.COMM_SELF
    if dim == 2:
        domain = mesh.create_unit_square(comm, n, n, mesh.CellType.quadrilateral)
    else:
        domain = mesh.create_unit_cube(comm, n, n, n, mesh.CellType.hexahedron)
    bottom, top = (
        mesh.locate_entities_boundary(domain, dim - 1, lambda x, z=z: np.isclose(x[dim - 1], z))
        for z in (0.0, 1.0)
    )
    motion = np.zeros(dim)
    motion[0] = SHIFT
    motion[-1] = -PRESS
    start = time.perf_counter()
    V = fem.functionspace(domain, ("Lagrange", 1, (dim,)))
    u = fem.Function(V)
    bc = fem.dirichletbc(motion, fem.locate_dofs_topological(V, dim - 1, top), V)
    floor = HalfSpace(np.zeros(dim), np.eye(dim)[-1])
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(FRICTION))
    problem = ContactProblem(
        LinearElastic.from_young(1.0, POISSON).energy(u) * ufl.dx(degree=degree),
        u,
        [surface],
        bcs=[bc],
        r=1.0,
        petsc_options={"linear_solver": solver, "snes_rtol": 1e-9},
    )
    built = time.perf_counter()
    result = problem.solve()
    end = time.perf_counter()
    record = {
        **_seconds(start, built, end),
        "iterations": result.iterations,
        "sum_rn": float(result.tables["contact"].rn.sum()),
        "unknowns": result.dofs,
        "linear_solver": problem.linear_solver.name,
    }
    return record


def getfem(dim, n):
    """The same of GetFEM."""
    import getfem as gf

    gf.util("trace level", 0)
    gf.util("warning level", 0)
    x = np.linspace(0.0, 1.0, n + 1)
    domain = gf.Mesh("cartesian", *[x] * dim)
    faces = domain.outer_faces()
    normals = domain.normal_of_faces(faces)
    domain.set_region(1, faces[:, normals[dim - 1] < -0.5])
    domain.set_region(2, faces[:, normals[dim - 1] > 0.5])
    start = time.perf_counter()
    mf = gf.MeshFem(domain, dim)
    mf.set_fem(gf.Fem(f"FEM_QK({dim},1)"))
    mim = gf.MeshIm(domain, gf.Integ(f"IM_GAUSS_PARALLELEPIPED({dim},2)"))
    model = gf.Model("real")
    model.add_fem_variable("u", mf)
    lmbda, mu = lame(1.0, POISSON)
    model.add_initialized_data("lmbda", [lmbda])
    model.add_initialized_data("mu", [mu])
    model.add_isotropic_linearized_elasticity_brick(mim, "u", "lmbda", "mu")
    motion = np.zeros(dim)
    motion[0] = SHIFT
    motion[-1] = -PRESS
    model.add_initialized_data("motion", motion)
    model.add_Dirichlet_condition_with_simplification("u", 2, "motion")
    dofs = mf.basic_dof_on_region(1)
    nodes = dofs.reshape(-1, dim)
    count = len(nodes)
    normal = gf.Spmat("empty", count, mf.nbdof())
    tangent = gf.Spmat("empty", (dim - 1) * count, mf.nbdof())
    for i, node in enumerate(nodes):
        normal.add(i, int(node[-1]), -1.0)
        for k in range(dim - 1):
            tangent.add((dim - 1) * i + k, int(node[k]), 1.0)
    points = mf.basic_dof_nodes(dofs)[:, ::dim]
    on_edge = sum(np.isclose(points[k], 0) | np.isclose(points[k], 1) for k in range(dim - 1))
    area = (1.0 / n) ** (dim - 1) * 0.5**on_edge
    model.add_variable("lambda_n", count)
    model.add_variable("lambda_t", (dim - 1) * count)
    model.add_initialized_data("r", [1.0])
    model.add_initialized_data("friction", [FRICTION])
    model.add_initialized_data("gap", np.zeros(count))
    model.add_initialized_data("alpha", area)
    model.add_basic_contact_brick(
        "u", "lambda_n", "lambda_t", "r", normal, tangent, "friction", "gap", "alpha", 1
    )
    built = time.perf_counter()
    iterations, converged = model.solve("max_res", 1e-10, "max_iter", 100, "lsolver", "mumps")
    end = time.perf_counter()
    return {
        **_seconds(start, built, end),
        "iterations": int(iterations),
        "converged": bool(converged),
        "sum_rn": float(-model.variable("lambda_n").sum()),
        "unknowns": int(model.nbdof()),
    }


def _seconds(start, built, end):
    return {
        "seconds": end - start,
        "construction_seconds": built - start,
        "newton_seconds": end - built,
    }


def compared(dim, n, mine, theirs):
    """A line of the table: ratios of ours to GetFEM's, each with what it is the ratio of."""
    record = {"dim": dim, "n": n, "ours": mine, "getfem": theirs}
    for side in (mine, theirs):
        side["per_iteration"] = side["newton_seconds"] / max(side["iterations"], 1)
    for name, key in (
        ("iteration", "per_iteration"),
        ("construction", "construction_seconds"),
        ("newton", "newton_seconds"),
        ("solve", "seconds"),
    ):
        record[f"ours_{key}"] = mine[key]
        record[f"getfem_{key}"] = theirs[key]
        record[f"{name}_ratio"] = mine[key] / theirs[key]
    record["force_difference"] = abs(mine["sum_rn"] / theirs["sum_rn"] - 1)
    return record


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--n", type=int, nargs="*", help="cells along an edge, instead of a list")
    parser.add_argument("--dim", type=int, choices=[2, 3], help="only this dimension")
    parser.add_argument(
        "--degree", type=int, help="of our quadrature in the body, UFL's own by default"
    )
    parser.add_argument("--repeats", type=int, default=REPEATS, help="timed runs of each")
    parser.add_argument("--output", default="contact_vs_getfem.json")
    args = parse_arguments(parser, argv)
    records = []
    titles = (
        "dim", "n", "unknowns", "ours: construction + solve", "GetFEM",
        "Newton steps, ours / GetFEM", "step ratio", "construction ratio", "solve ratio",
        "together", "difference of forces",
    )  # fmt: skip
    print("| " + " | ".join(titles) + " |")
    print("|---" * len(titles) + "|")
    for dim in [args.dim] if args.dim else [2, 3]:
        for n in args.n or SIZES[dim]:
            runs = {"getfem": lambda dim=dim, n=n: getfem(dim, n)}
            for solver in ("direct", "amg"):
                runs[solver] = lambda dim=dim, n=n, solver=solver: ours(dim, n, solver, args.degree)
            found = in_turns(MPI.COMM_SELF, runs, args.repeats)
            theirs = found.pop("getfem")
            if not theirs["converged"]:
                raise RuntimeError(f"GetFEM fails: {dim}D, n = {n}")
            for solver, mine in found.items():
                record = compared(dim, n, mine, theirs)
                records.append(record)
                print(f"| {dim} | {n} | {mine['unknowns']} | {solver} "
                      f"{mine['construction_seconds']:.3f} + {mine['newton_seconds']:.3f} s "
                      f"| {theirs['construction_seconds']:.3f} + {theirs['newton_seconds']:.3f} s "
                      f"| {mine['iterations']} / {theirs['iterations']} "
                      f"| {record['iteration_ratio']:.2f} | {record['construction_ratio']:.2f} "
                      f"| {record['newton_ratio']:.2f} | {record['solve_ratio']:.2f} "
                      f"| {record['force_difference']:.0e} |", flush=True)  # fmt: skip
    save(args.output, records)
    return records


if __name__ == "__main__":
    main()
