"""Attributes of pairs, rigid bodies, materials and results of searches that one would like to set.

Each is refused; the force is as before, E times the way.
"""

from bodies import block, moves, on_floor, refused

from dolfinx_contact import Frictionless, HalfSpace, Sphere, materials


def attack(case):
    body = block(case.comm, (2, 1), cell="quadrilateral")
    moves(body, 0.0, -0.01)
    floor = HalfSpace(point=(0.0, 0.0), normal=(0.0, 1.0))
    problem, contact = on_floor(body, Frictionless(), obstacle=floor)
    ball = Sphere((0.0, -3.0), 3.0)
    steel = materials.LinearElastic.from_young(1000.0, 0.0)
    case.equal("force", problem.solve().resultants[contact.name][1], 10.0)
    for thing, name, value in (
        (ball, "radius", 2.0),
        (steel, "mu", 1.0),
        (floor, "normal", (0.3, 1.0)),
        (contact, "method", "mixed"),
        (contact, "sliding", "large"),
        (contact, "facets", body.top),
        (problem, "bcs", []),
        (problem, "u", body.moved),
        (problem, "surfaces", []),
        (problem, "r", 1e3),
    ):
        words = refused(lambda t=thing, n=name, v=value: setattr(t, n, v))
        case.true(f"another {name} of {type(thing).__name__} is refused", words)
    words = refused(lambda: problem.surfaces.append(contact))
    case.true("another surface is refused", words)
    case.equal("force", problem.solve().resultants[contact.name][1], 10.0)
