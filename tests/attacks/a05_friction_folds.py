"""One point with friction above kt/|c|: the load turns back where it begins to slip.

S = [[1, -1.5], [-1.5, 4]], the top moved to the side by 1 and lifted by gamma from -1 to 1, F =
1: by hand the point sticks to gamma = 0.2, slips while the load goes back to 0, where it comes
off, and hangs free from there, or is pressed again with its slip of 1. With F = 0.5 it slips from
-0.5 to 0, and nothing turns.
"""

from bodies import free_point, one_point

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength

STIFFNESS = [[1.0, -1.5], [-1.5, 4.0]]


def followed(case, S, aside, friction, folds, longest):
    """Follow the path of a point with the stiffness S, its top moved aside along its tangents."""
    dim = len(S)
    body, energy = one_point(case.comm, S, dim)
    floor = HalfSpace((0,) * dim, (0,) * (dim - 1) + (1,))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(friction))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, -1.0)
    system = ParametricContact(
        problem, gamma, driven=[(body.moved, ufl.as_vector((*aside, gamma)))]
    )
    system.set_parameter(-1.0)
    start = problem.solve().tables["contact"]
    k = free_point(start)
    case.equal("pressed at the start", start.force[k, -1], 5.5)
    control = StepControl(initial=longest / 2, maximum=longest)
    history = ArcLength(system).run(gamma_range=(-1.0, 1.0), control=control)
    case.unpromised(f"not complete: {history.reason}", not history.complete)
    found = [p.gamma for p in history.folds]
    end = history.steps[-1]
    table = end.result.tables["contact"]
    if end.gamma > 0 or not folds:
        case.equal("folds", found, folds)
    else:
        case.equal("the first fold", found, folds[:1])
    case.equal("gamma", abs(end.gamma), 1.0)
    case.equal("gap", table.un[k], max(end.gamma, 0.0), 1e-9)
    case.equal("slip", table.ut[k], [*aside, 0.0])
    case.equal("force", table.force[k, -1], max(-4 * end.gamma, 0.0))


def attack(case):
    followed(case, STIFFNESS, [1.0], 1.0, [0.2, 0.0], 0.1)
    followed(case, STIFFNESS, [1.0], 1.0, [0.2, 0.0], 0.5)


def honest(case):
    followed(case, STIFFNESS, [1.0], 0.5, [], 0.1)
