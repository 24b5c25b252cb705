# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does a step of a motion with contact cost over a step of plain elastodynamics?

Two motions of a cube on a floor, with friction. *Thrown*, it hits the floor aslant and slides on it
as it rebounds: points close and open all the time. *Sliding*, it lies there by its weight and is
pushed: once all points slip, no status changes any more. Every step of `NSCD` in which a point is
closed counts, those in which statuses change apart. The denominator is a step of the same body
without contact by the same scheme and length: right-hand side by products with the mass and the
stiffness, conjugate gradients from free flight until ||b - A x|| <= tolerance ||b||, with a
hierarchy (GAMG, rigid motions) that is set up once, untimed, and with the diagonal; there are
ratios to both. Steps of all go in turns of as many as are asked for.

    mpirun -n 2 python3 benchmarks/motion_step.py --n 43 --output motion_step.json
"""

from __future__ import annotations

import argparse
import logging

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from timing import Timer, save

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.solvers.hierarchy import Hierarchy

E = 1000.0
NU = 0.3
RHO = 1.0
FALL = 1.0
ACROSS = 1.0
WEIGHT = 20.0
CASES = ("thrown", "sliding")
WARM_UP = 2  # first steps of each case that do not count


def arguments(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--n", type=int, default=16, help="cells along an edge")
    parser.add_argument("--cell", choices=("tet", "hex"), default="hex")
    parser.add_argument(
        "--courant", type=float, default=2.0, help="waves cross so many cells a step"
    )
    parser.add_argument("--steps", type=int, default=16, help="of each")
    parser.add_argument("--friction", type=float, default=0.3, help="of what is thrown")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--mass", default="redistributed")
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--output", default="motion_step.json")
    return parse_arguments(parser, argv)


def cube(args, comm, case="thrown"):
    """The problem, its motion just before it hits or is pushed, and the length of a step."""
    kind = {"tet": mesh.CellType.tetrahedron, "hex": mesh.CellType.hexahedron}[args.cell]
    domain = mesh.create_unit_cube(comm, args.n, args.n, args.n, kind)
    sole = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
    thrown = case == "thrown"
    if thrown:
        # The sole is slightly round, so that points close one after the other.
        x = domain.geometry.x
        away = (x[:, 0] - 0.46) ** 2 + (x[:, 1] - 0.53) ** 2
        x[:, 2] += 0.02 * (1 - x[:, 2]) * away
    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u = fem.Function(V)
    velocity = fem.Function(V)
    friction = args.friction if thrown else 0.1
    surface = ContactSurface(
        u, sole, obstacle=HalfSpace((0, 0, 0), (0, 0, 1)), law=Coulomb(friction)
    )
    body = LinearElastic.from_young(E, NU).energy(u) * ufl.dx
    problem = ContactProblem(
        body if thrown else body + WEIGHT * u[2] * ufl.dx,
        u,
        [surface],
        petsc_options={"snes_rtol": args.tolerance, "linear_solver": "amg"},
    )
    if not thrown:
        problem.solve(progress=False)
    pushed = [ACROSS, 0.2, -FALL if thrown else 0.0]
    velocity.x.array[:] = np.tile(pushed, len(velocity.x.array) // 3)
    speed = np.sqrt(E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)) / RHO)
    dt = args.courant / args.n / speed
    return problem, NSCD(problem, RHO, dt=dt, velocity=velocity, mass=args.mass), dt


class Elastodynamics:
    """Steps of the theta method without contact."""

    def __init__(self, motion, dt, tolerance, kind):
        self.problem = motion.problem
        self.motion = motion
        self.h = dt
        body = motion.problem.equations.bulk
        self.body = body
        self.A = body.stiffness(motion.velocity.x.array)
        self.M = body.mass
        self.K = body.body.stiffness(motion.velocity.x.array)
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
        """One step; its iterations."""
        step = self.body.step
        h = step.length
        theta = step.theta
        w0 = self.u.copy()
        w0.axpy(h * (1 - theta), self.v)
        b = self.u.duplicate()
        t = self.u.duplicate()
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
        return self.ksp.getIterationNumber()


def measured(args, comm, case, plain):
    """The record of a case, with steps of plain elastodynamics in between."""
    problem, motion, dt = cube(args, comm, case)
    steps = []
    before = ""
    moment = 0.0
    elastic = {kind: [] for kind in plain}
    for i in range(args.steps):
        times = [moment, (i + 1) * dt]
        timer = Timer(comm)
        history = timer("step", lambda t=times: motion.run(t, progress=False))
        moment = times[1]
        result = history.steps[-1].result
        letters = history.steps[-1].status
        steps.append(
            {
                "seconds": timer.total,
                "processor_seconds": timer.processor,
                "closed": len(letters) - letters.count("o"),
                "changed": sum(a != b for a, b in zip(letters, before, strict=False)),
                "newton": result.iterations,
                "krylov": sum(a.krylov_iterations for a in result.attempts),
                "evaluations": sum(a.evaluations for a in result.attempts),
                "strategy": result.reason,
            }
        )
        before = letters
        for kind, each in plain.items():
            timer = Timer(comm)
            iterations = timer("step", each.step)
            elastic[kind].append((timer.total, timer.processor, iterations))
    wall, processor, iterations = (
        {kind: float(np.median([v[i] for v in each[WARM_UP:]])) for kind, each in elastic.items()}
        for i in range(3)
    )
    touching = [s for s in steps[WARM_UP:] if s["closed"]]
    groups = {
        "contact": touching,
        "no_change": [s for s in touching if s["changed"] == 0],
        "changes": [s for s in touching if s["changed"]],
    }
    record = {
        "dofs": problem.V.dofmap.index_map.size_global * 3,
        "points": problem.surfaces[0].points.number_everywhere,
        "elastic_seconds": wall,
        "elastic_processor_seconds": processor,
        "elastic_iterations": iterations,
        "preconditioner": motion.problem.linear_solver.hierarchy.kind,
        "residue": history.energies.residue / history.energies.at_start,
    }
    for name, group in groups.items():
        if group:
            for of, plainly in (("seconds", wall), ("processor_seconds", processor)):
                median = record[f"{name}_{of}"] = float(np.median([s[of] for s in group]))
                for kind, denominator in plainly.items():
                    word = "" if of == "seconds" else "processor_"
                    record[f"{name}_over_{kind}_{word}ratio"] = median / denominator
            for count in ("newton", "krylov"):
                record[f"{name}_{count}"] = float(np.mean([s[count] for s in group]))
            record[f"{name}_steps"] = len(group)
    return record | {"steps": steps}


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    plain = {}
    for kind in ("amg", "jacobi"):
        _, other, dt = cube(args, comm)
        plain[kind] = Elastodynamics(other, dt, args.tolerance, kind)
        plain[kind].step()
    record = {"n": args.n, "ranks": comm.size, "courant": args.courant}
    for case in args.cases:
        record[case] = measured(args, comm, case, plain)
        if comm.rank == 0:
            print(case, {k: v for k, v in record[case].items() if k != "steps"})
            for s in record[case]["steps"]:
                print(" ", s)
    if comm.rank == 0:
        save(args.output, record)
    return record


if __name__ == "__main__":
    logging.getLogger("dolfinx_contact").setLevel(logging.ERROR)
    main()
