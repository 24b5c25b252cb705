"""Bodies that fly, far from the obstacle that they might touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

from bodies import block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, materials


@dataclass
class Flying:
    """A body without supports under a uniform force per volume."""

    u: fem.Function
    velocity: fem.Function
    force: fem.Constant
    problem: ContactProblem

    def mean(self, f: fem.Function) -> list[float]:
        """The mean of a vector field over the body."""
        domain = f.function_space.mesh
        size = fem.assemble_scalar(fem.form(fem.Constant(domain, 1.0) * ufl.dx))
        parts = [fem.assemble_scalar(fem.form(f[k] * ufl.dx)) for k in range(len(f))]
        total = domain.comm.allreduce(size)
        return [domain.comm.allreduce(part) / total for part in parts]


def flying(
    comm: MPI.Comm,
    force: tuple[float, ...],
    cells: tuple[int, ...] = (2, 2),
    cell: str | None = "quadrilateral",
    young: Any = 1000.0,
) -> Flying:
    """Make one of the edges 1, at rest, a hundred above the floor."""
    dim = len(cells)
    body = block(comm, cells, (1.0,) * dim, cell)
    f = fem.Constant(body.domain, force)
    steel = materials.LinearElastic.from_young(young, 0.2)
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(f, body.u) * ufl.dx
    up = (0.0,) * (dim - 1)
    floor = HalfSpace(point=(*up, -100.0), normal=(*up, 1.0))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless())
    problem = ContactProblem(energy, body.u, [contact])
    return Flying(body.u, fem.Function(body.V), f, problem)
