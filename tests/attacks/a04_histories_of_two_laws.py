"""One law of the speed on two faces, with other coefficients on each.

A block whose sides are dragged is pressed between a floor and a ceiling: both faces slip with the
speed of the sides. Q is mu(v) times P at the points between the sides, with mu of each face.
"""

import numpy as np
from a04_speed_solved_statically import OfSpeed, in_numbers
from bodies import block

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    body = block(case.comm, (2, 2), cell="quadrilateral")
    sides = mesh.locate_entities_boundary(
        body.domain, 1, lambda x: np.isclose(x[0], 0.0) | np.isclose(x[0], 1.0)
    )
    way = fem.Constant(body.domain, 0.0)
    dofs = fem.locate_dofs_topological(body.V.sub(0), 1, sides)
    held = [fem.dirichletbc(way, dofs, body.V.sub(0))]
    laws = OfSpeed(0.5, 0.1, 2.0), OfSpeed(0.3, 0.6, 1.0)
    floor = HalfSpace((0.0, 0.01), (0.0, 1.0))
    ceiling = HalfSpace((0.0, 0.99), (0.0, -1.0))
    faces = [
        ContactSurface(body.u, facets, obstacle=obstacle, law=law, name=name)
        for facets, obstacle, law, name in (
            (body.bottom, floor, laws[0], "floor"),
            (body.top, ceiling, laws[1], "ceiling"),
        )
    ]
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, faces, bcs=held)

    def load(t):
        way.value = t

    evolution = QuasiStatic(problem, load)
    body.u.interpolate(lambda x: np.stack([0 * x[0], 0.01 - 0.02 * x[1]]))
    for face in faces:
        face.multiplier.interpolate(
            lambda x, s=face.name: np.outer((0.0, 20.0 if s == "floor" else -20.0), 0 * x[0] + 1)
        )
    history = evolution.run([0.05 * k for k in range(10)], sudden=float("inf"))
    for face, law in zip(faces, laws, strict=True):
        table = history.steps[-1].result.tables[face.name]
        free = np.abs(table.x[:, 0] - 0.5) < 0.4
        found = float(np.sum(np.abs(table.rt[free, 0])) / np.sum(table.rn[free]))
        case.equal(f"Q/P on the {face.name}", found, in_numbers(law, 1.0))
