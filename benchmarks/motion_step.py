# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does a step of a motion with contact cost over a step of plain elastodynamics?

A cube is thrown at a floor aslant and slides on it as it rebounds. Every step of `NSCD` in which a
point is closed counts, those in which statuses change apart. The denominator is a step of the same
body without contact by the same scheme and length: right-hand side by products with the mass and
the stiffness, conjugate gradients from free flight until ||b - A x|| <= tolerance ||b||, with the
hierarchy that the contact problem would take (GAMG, rigid motions) set up once, untimed, or with
the diagonal: the faster of the two counts. Steps of both go in turns of as many as are asked for.

    mpirun -n 2 python3 benchmarks/motion_step.py --n 43 --output motion_step.json
"""

from __future__ import annotations

import argparse
import logging
import time

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from timing import save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.solvers.hierarchy import Hierarchy

E, NU, RHO, FALL, ACROSS = 1000.0, 0.3, 1.0, 1.0, 1.0


def arguments(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--n", type=int, default=16, help="cells along an edge")
    parser.add_argument("--cell", choices=("tet", "hex"), default="hex")
    parser.add_argument(
        "--courant", type=float, default=2.0, help="waves cross so many cells a step"
    )
    parser.add_argument("--steps", type=int, default=16, help="of each")
    parser.add_argument("--friction", type=float, default=0.3)
    parser.add_argument("--mass", default="redistributed")
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--output", default="motion_step.json")
    return parse_arguments(parser, argv)


def cube(args, comm):
    """The problem, its motion just before it hits, and the length of a step."""
    kind = {"tet": mesh.CellType.tetrahedron, "hex": mesh.CellType.hexahedron}[args.cell]
    domain = mesh.create_unit_cube(comm, args.n, args.n, args.n, kind)
    # The sole is slightly round, so that points close one after the other.
    x = domain.geometry.x
    away = (x[:, 0] - 0.46) ** 2 + (x[:, 1] - 0.53) ** 2
    x[:, 2] += 0.02 * (1 - x[:, 2]) * away
    sole = mesh.locate_entities_boundary(domain, 2, lambda x: x[2] < 0.011 * (1 - 1e-9) + 1e-6)
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u, velocity = fem.Function(V), fem.Function(V)
    velocity.x.array[:] = np.tile([ACROSS, 0.2, -FALL], len(velocity.x.array) // 3)
    surface = ContactSurface(
        u, sole, obstacle=HalfSpace((0, 0, 0), (0, 0, 1)), law=Coulomb(args.friction)
    )
    problem = ContactProblem(
        LinearElastic.from_young(E, NU).energy(u) * ufl.dx,
        u,
        [surface],
        petsc_options={"snes_rtol": args.tolerance, "linear_solver": "amg"},
    )
    speed = np.sqrt(E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)) / RHO)
    dt = args.courant / args.n / speed
    return problem, NSCD(problem, RHO, dt=dt, velocity=velocity, mass=args.mass), dt


class Elastodynamics:
    """Steps of the theta method without contact."""

    def __init__(self, motion, dt, tolerance, kind):
        self.problem, self.motion, self.h = motion.problem, motion, dt
        body = motion.problem.equations.bulk
        self.body, self.A = body, body.stiffness(motion.velocity.x.array)
        self.M, self.K = body.mass, body.body.stiffness(motion.velocity.x.array)
        self.ksp = PETSc.KSP().create(self.A.comm)
        self.ksp.setOperators(self.A)
        self.ksp.setType("cg")
        if kind == "amg":
            hierarchy = Hierarchy(motion.problem.V, "elastodynamics_", symmetric=True)
            self.ksp.setPC(hierarchy.build(self.A, np.zeros(0, dtype=np.int32), 1.0))
        else:
            self.ksp.getPC().setType("jacobi")
        self.ksp.setInitialGuessNonzero(True)
        self.ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        self.ksp.setTolerances(rtol=tolerance, max_it=500)
        self.u, self.v = self.A.createVecs()
        # It vibrates, as a body in contact does: without that a step would be no work.
        n = self.v.getLocalSize()
        x = motion.problem.V.tabulate_dof_coordinates()[: n // 3]
        self.v.array[:] = np.cos(np.pi * x[:, [1, 2, 2]]).reshape(-1)
        self.rows = self.u.duplicate()
        self.K.mult(self.u, self.rows)

    def step(self):
        """One step; its seconds and iterations."""
        comm = self.A.comm.tompi4py()
        comm.barrier()
        start, step = time.perf_counter(), self.body.step
        h, theta = step.length, step.theta
        w0 = self.u.copy()
        w0.axpy(h * (1 - theta), self.v)
        b, t = self.u.duplicate(), self.u.duplicate()
        self.M.mult(self.v, b)
        b.scale(1 / h)
        b.axpy(-(1 - theta), self.rows)
        self.M.mult(w0, t)
        b.axpy(step.rate / h, t)
        w = w0.copy()
        w.axpy(step.gain * h, self.v)
        self.ksp.solve(b, w)
        self.v = w.copy()
        self.v.axpy(-1.0, w0)
        self.v.scale(step.rate)
        self.u = w
        self.K.mult(self.u, self.rows)
        comm.barrier()
        return comm.allreduce(time.perf_counter() - start, op=max), self.ksp.getIterationNumber()


def main(argv=None):
    logging.getLogger("dolfinx_contact").setLevel(logging.ERROR)
    args, comm = arguments(argv), MPI.COMM_WORLD
    problem, motion, dt = cube(args, comm)
    plain = {}
    for kind in ("amg", "jacobi"):
        other = cube(args, comm)[1]
        plain[kind] = Elastodynamics(other, dt, args.tolerance, kind)
        plain[kind].step()
    steps, before, seconds = [], "", {"amg": [], "jacobi": []}
    moment = 0.0
    for i in range(args.steps):
        comm.barrier()
        start = time.perf_counter()
        history = motion.run([moment, (i + 1) * dt], progress=False)
        comm.barrier()
        taken = comm.allreduce(time.perf_counter() - start, op=max)
        moment = (i + 1) * dt
        result = history.steps[-1].result
        letters = history.steps[-1].status
        changed = sum(a != b for a, b in zip(letters, before, strict=False))
        krylov = sum(s.krylov for a in result.attempts for s in a.steps)
        steps.append(
            {
                "seconds": taken,
                "closed": len(letters) - letters.count("o"),
                "changed": changed,
                "newton": result.iterations,
                "krylov": krylov,
                "strategy": result.reason,
            }
        )
        before = letters
        for kind, each in plain.items():
            seconds[kind].append(each.step())
    elastic = {k: float(np.median([s for s, _ in v[2:]])) for k, v in seconds.items()}
    denominator = min(elastic.values())
    touching = [s for s in steps[2:] if s["closed"]]
    groups = {
        "contact": touching,
        "no_change": [s for s in touching if s["changed"] == 0],
        "changes": [s for s in touching if s["changed"]],
    }
    record = {
        "n": args.n,
        "ranks": comm.size,
        "dofs": problem.V.dofmap.index_map.size_global * 3,
        "points": problem.surfaces[0].number_everywhere,
        "courant": args.courant,
        "elastic_seconds": elastic,
        "elastic_iterations": {k: int(np.median([i for _, i in v])) for k, v in seconds.items()},
        "steps": steps,
    }
    for name, group in groups.items():
        if group:
            median = float(np.median([s["seconds"] for s in group]))
            record[f"{name}_seconds"] = median
            record[f"{name}_ratio"] = median / denominator
            record[f"{name}_steps"] = len(group)
    if comm.rank == 0:
        save(args.output, record)
        print({k: v for k, v in record.items() if k != "steps"})
        for s in steps:
            print(s)


if __name__ == "__main__":
    main()
