"""An observer reads displacement, table, support and forms at every point of a branch.

A block with nu = 0 comes down by 0.01 gamma on a floor 0.004 below it: its pressure is
E (0.01 gamma - 0.004) where that is positive. The branch is followed by pivoting and by steps.
"""

from mpi4py import MPI

import numpy as np
from bodies import block, on_floor

import ufl
from dolfinx import fem

from dolfinx_contact import Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import Observer, follow


class Reader(Observer):
    """What an observer of one's own reads."""

    def __init__(self, body, problem, contact, gamma):
        self.body = body
        self.problem = problem
        self.contact = contact
        self.gamma = gamma
        self.seen = []
        self.lowest = fem.form(ufl.dot(body.u, body.u) * ufl.dx)

    def step(self, step, state):
        comm = self.body.domain.comm
        body = self.body
        table = self.problem.table(self.contact)
        top = fem.locate_dofs_topological(body.V, body.domain.topology.dim - 1, body.top)
        ways = body.u.x.array.reshape(len(body.u.x.array) // table.dim, -1)[top, table.dim - 1]
        way = -comm.allreduce(float(np.max(-ways, initial=0.0)), op=MPI.MAX)
        size = comm.allreduce(fem.assemble_scalar(self.lowest))
        self.seen.append(
            dict(
                gamma=step.point.gamma,
                constant=float(self.gamma.value),
                force=np.sum(table.rn),
                way=way,
                size=size,
                status=table.status,
            )
        )

    def column(self, name):
        """What was seen under a name."""
        return [row[name] for row in self.seen]


def lowered(case, law, **options):
    """The block, its problem and its system; it stands in the Functions at gamma = 0."""
    body = block(case.comm, (2, 1), cell="quadrilateral", degree=options.pop("degree", 1))
    floor = HalfSpace(point=(0.0, -0.004), normal=(0.0, 1.0))
    problem, contact = on_floor(body, law, obstacle=floor, **options)
    gamma = fem.Constant(body.domain, 0.0)
    way = ufl.as_vector((0.0, -0.01 * gamma))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    return body, problem, contact, gamma, system


def compared(case, seen, width=1.0):
    """What was seen, with the closed form."""
    gammas = np.array(seen.column("gamma"))
    way = 0.01 * gammas
    case.equal("gamma", seen.column("constant"), gammas)
    case.equal("way of the top", seen.column("way"), -way)
    case.equal("force", seen.column("force"), width * 1000.0 * np.maximum(way - 0.004, 0.0))
    touching = np.maximum(way - 0.004, 0.0)
    foot = -np.minimum(way, 0.004)  # u is linear between foot and top
    size = (foot**2 + foot * -way + way**2) / 3.0
    case.equal("form", seen.column("size"), width * size)
    for status, depth in zip(seen.column("status"), touching, strict=True):
        if depth > 1e-9:
            case.true("closed", "o" not in status)


def _followed(case, route):
    body, problem, contact, gamma, system = lowered(case, Coulomb(0.3))
    reader = Reader(body, problem, contact, gamma)
    branch = follow(
        system,
        system.create_vector(),
        0.0,
        gamma_range=(0.0, 1.0),
        observer=reader,
        route=route,
    )
    case.equal("points told of", reader.column("gamma"), [p.gamma for p in branch.points])
    case.equal("the end", branch.points[-1].gamma, 1.0)
    compared(case, reader)


def attack(case):
    for route in ("pivoting", "steps"):
        _followed(case, route)


def honest(case):
    _followed(case, "auto")
