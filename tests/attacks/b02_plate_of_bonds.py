"""A stiff plate drawn off bonds that break together, by soft springs and in a single step.

By hand: all open at the end, at the height of the lift; the damage has cost w on the whole area.
"""

from bodies import block, moves

import ufl

from dolfinx_contact import RCCM, ContactProblem, ContactSurface, HalfSpace, materials
from dolfinx_contact.evolution import QuasiStatic


def attack(case):
    for cells, size, cell in (((4, 1), (1.0, 0.5), "triangle"), ((2, 2, 1), (1, 1, 1), None)):
        dim = len(cells)
        body = block(case.comm, cells, size, cell)
        steel = materials.LinearElastic.from_young(20.0, 0.3)
        floor = HalfSpace((0,) * dim, (0,) * (dim - 1) + (1,))
        law = RCCM(100.0, 100.0, 0.01, 0.3)
        contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=law)
        energy = steel.energy(body.u) * ufl.dx
        problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
        pull = (0.05,) + (0.0,) * (dim - 2) + (0.6,)

        def load(t, body=body, pull=pull):
            moves(body, *(t * part for part in pull))

        history = QuasiStatic(problem, load).run([0.0, 1.0, 1.2], at_jump="jump")
        last = history.steps[-1]
        table = last.result.tables["contact"]
        case.equal("time", history.time, 1.2)
        force = last.result.resultants["contact"]
        case.true(f"all but free: {force}", abs(force[-1]) < 0.02 * 100 * 0.01)
        case.equal("gaps", table.un, 0 * table.un + 0.72, 0.02)
