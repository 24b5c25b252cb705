"""Steps that are not solved, since Newton's method is given two iterations, or a load has no limit.

Softening bonds of rubber: a solution continues the evolution up to the end (it is found with the
default budget), so that an error must not say that none does.
"""

import numpy as np
from bodies import block, moves

import ufl

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NoContinuation, QuasiStatic


def dragged(case, **options):
    body = block(case.comm, (3, 2), cell="quadrilateral")
    rubber = materials.NeoHookean(*materials.lame(100.0, 0.3))
    floor = HalfSpace((0, 0), (0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.5))
    energy = rubber.energy(body.u) * ufl.dx
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs, petsc_options=options)
    evolution = QuasiStatic(problem, lambda t: moves(body, 0.3 * t, -0.2 * min(1.0, 3 * t)))
    return problem, evolution


def attack(case):
    _, evolution = dragged(case)
    right = evolution.run([0.0, 0.3, 0.6]).steps[-1].result.resultants["contact"]
    problem, evolution = dragged(case, snes_max_it=2)
    try:
        history = evolution.run([0.0, 0.3, 0.6], shortest=0.02)
    except NoContinuation as error:
        text = str(error)
        case.true(f"no claim of nonexistence: {text}", "no solution continues" not in text)
        case.true("no claim of a jump", not any(s.jump for s in error.history.steps))
    else:
        resultant = history.steps[-1].result.resultants["contact"]
        case.equal("force", resultant, right, 1e-2)
    case.true("state is finite", np.all(np.isfinite(problem.u.x.array)))


def honest(case):
    _, evolution = dragged(case)
    history = evolution.run([0.0, 0.3, 0.6])
    case.true("complete", history.complete)
