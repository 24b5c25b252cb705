"""One point in 3D with exactly three solutions: it sticks, slips or hangs free.

S = [[1, 0, -1.5 c], [0, 1, -1.5 s], [., ., 4]] with (c, s) = (0.6, 0.8), the top moved by (c, s,
0.1), F = 1: by hand the slips along (c, s) are 0, 0.5 and 1, the forces 1.1, 0.35 and 0. What is
found must be among them, one at least must be, and who says complete has all three.
"""

from bodies import free_point, moves, one_point

from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import find_solutions

RIGHT = [(0.0, 1.1), (0.5, 0.35), (1.0, 0.0)]


def attack(case):
    S = [[1.0, 0.0, -0.9], [0.0, 1.0, -1.2], [-0.9, -1.2, 4.0]]
    body, energy = one_point(case.comm, S, 3)
    floor = HalfSpace((0, 0, 0), (0, 0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(1.0))
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    moves(body, 0.6, 0.8, 0.1)
    gamma = fem.Constant(body.domain, 0.0)
    system = ParametricContact(problem, gamma)
    guesses = []
    for value in (0.0, 5.0):
        x = system.create_vector()
        x.set(value)
        guesses.append(x)
    solutions = find_solutions(system, guesses, 0.0, lengths=(0.5, 0.1), max_iterations=20)
    case.true("something is found", solutions.found)
    found = set()
    for solution in solutions.found:
        system.put(solution.x, 0.0, solution.piece)
        table = problem.table(contact)
        k = free_point(table)
        slip = float(table.ut[k] @ [0.6, 0.8, 0.0])
        force = float(table.force[k, 2])
        near = [i for i, (a, b) in enumerate(RIGHT) if abs(a - slip) + abs(b - force) < 1e-6]
        case.true(f"slip {slip}, force {force} is one of the three", near)
        found.update(near)
    case.true("complete with all", not solutions.complete or len(found) == 3)
    result = problem.solve()
    case.true("unique is not proved", result.unique != "proved")
