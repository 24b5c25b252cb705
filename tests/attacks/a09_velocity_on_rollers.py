"""A start velocity into rollers: of a P2 body one component is held on its top, by a condition on a
subspace, and the body is thrown along both.

Held are the nodes in every step: the velocity there must be zero after the first step. Honest is a
body that is thrown along the rollers alone, and keeps its velocity.
"""

from mpi4py import MPI

import numpy as np
from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials
from dolfinx_contact.evolution import NSCD


def throw(case, up):
    body = block(case.comm, (1, 1), cell="quadrilateral", degree=2)
    rows = body.V.sub(1)
    dofs = fem.locate_dofs_topological(rows, 1, body.top)
    roller = fem.dirichletbc(fem.Constant(body.domain, 0.0), dofs, rows)
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    floor = HalfSpace(point=(0.0, -5.0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=[roller])
    velocity = fem.Function(body.V)
    velocity.interpolate(lambda x: np.stack([1.0 + 0 * x[0], up + 0 * x[0]]))
    motion = NSCD(problem, 1.0, dt=0.01, velocity=velocity, mass="consistent")
    speeds = []
    motion.run(
        [0.0, 0.04],
        observer=lambda _: speeds.append(np.max(np.abs(velocity.x.array[dofs]), initial=0.0)),
    )
    case.warned("velocit.* turn|Dirichlet")
    case.equal("velocity at the rollers", case.comm.allreduce(max(speeds), MPI.MAX), 0.0, 1e-9)
    along = velocity.x.array[0::2]
    case.equal("velocity along", along, np.ones_like(along), 1e-6)


def attack(case):
    throw(case, 0.5)


def honest(case):
    throw(case, 0.0)
