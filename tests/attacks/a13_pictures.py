"""Pictures and animations of a body of two materials, by the stress of one and of both.

One material's stress is refused in a picture, and in an animation of a record; both are drawn.
"""

from a13_two_columns import GLASS, STEEL, columns, folder, on_floor
from bodies import moves, refused

import ufl

from dolfinx_contact import plot, records
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    problem = on_floor(body, STEEL.energy(body.u) * dx(1) + GLASS.energy(body.u) * dx(2))
    one = STEEL.full_stress(body.u)
    both = {1: STEEL.full_stress(body.u)}
    both[2] = GLASS.full_stress(body.u)
    with folder(case.comm) as path:
        evolution = QuasiStatic(problem, lambda t: moves(body, 0.0, -0.01 * t))
        with records.EvolutionRecord(path / "record", evolution) as record:
            evolution.run([1.0, 2.0], record=record)
            words = refused(lambda: plot.animate(path / "one.gif", record, stress=one))
            case.true("an animation of one material is refused", "one of each tag" in words)
        case.comm.barrier()
        case.true("nothing is drawn", not (path / "one.gif").exists())
        words = refused(lambda: plot.picture_of_body(path / "one.png", problem, stress=one))
        case.true("a picture of one material is refused", "one of each tag" in words)
        drawn = plot.picture_of_body(path / "both.png", problem, stress=both)
        case.true("both are drawn, or it is said why", drawn or case.warned("drawn|draw"))
