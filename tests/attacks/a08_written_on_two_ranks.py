"""A history of degree 2 with solved and vector data is written on two ranks and resumed on one.

A serial run starts the two ranks by itself; on two ranks the same are used again. The vector field
of forces is P2, the stiffness solves a Poisson problem (it is off by round-off on other ranks). In
the attack the forces are mirrored. The right answer is the history of the second script, never
killed.
"""

import contextlib
import os
import subprocess
import sys

from mpi4py import MPI

import numpy as np
from bodies import block
from recorded import Killed, Killer, compare, folder

import ufl
from dolfinx import fem
from dolfinx.fem.petsc import LinearProblem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.records import EvolutionRecord

TIMES = (0.0, 1.0, 2.0, 3.0)


def make(comm, mirrored):
    body = block(comm, (2, 2), cell="quadrilateral", degree=2)
    force = fem.Function(body.V)
    profile = fem.Function(body.V)
    at = (lambda x: 1.0 - x[0]) if mirrored else (lambda x: x[0])
    profile.interpolate(lambda x: np.stack([20.0 * at(x) ** 2, -60.0 * at(x)]))
    W = fem.functionspace(body.domain, ("Lagrange", 1))
    a = ufl.TrialFunction(W)
    b = ufl.TestFunction(W)
    form = (a * b + 0.1 * ufl.dot(ufl.grad(a), ufl.grad(b))) * ufl.dx
    source = 1000.0 * (1 + ufl.SpatialCoordinate(body.domain)[0])
    exact = {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"}
    young = LinearProblem(form, source * b * ufl.dx, petsc_options=exact).solve()
    steel = materials.LinearElastic.from_young(young, 0.2)
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)

    def load(t):
        force.x.array[:] = t * profile.x.array

    return QuasiStatic(problem, load)


def write(where):
    evolution = make(MPI.COMM_WORLD, False)
    with EvolutionRecord(where, evolution) as record, contextlib.suppress(Killed):
        evolution.run(TIMES, record=record, observer=Killer(2))


def history(case, mirrored):
    where = folder(case.comm)
    if case.comm.size > 1:
        write(where)
    else:
        ours = ("OMPI_COMM", "PMIX_", "PRTE_", "OMPI_MCA_orte", "OMPI_MCA_ess")
        there = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
        ranks = ["mpirun", "--oversubscribe", "-n", "2", sys.executable, __file__, str(where)]
        done = subprocess.run(ranks, env=there, capture_output=True, text=True, timeout=150)
        if done.returncode:
            raise RuntimeError(done.stderr[-2000:])
    with EvolutionRecord(where, make(case.comm, mirrored), resume=True) as record:
        found = record.go_on()
    compare(case, found, make(case.comm, mirrored).run(TIMES))


def attack(case):
    history(case, True)


def honest(case):
    history(case, False)


if __name__ == "__main__":
    write(sys.argv[1])
