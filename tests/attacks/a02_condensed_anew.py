"""Stiffness, load and friction change between searches on the contact points alone.

Each search, `reduced` and Lemke's method are compared with a problem that is made anew.
"""

from bodies import block, on_floor

import ufl
from dolfinx import fem

from dolfinx_contact import Coulomb, ParametricContact
from dolfinx_contact.continuation import find_solutions


class _Made:
    def __init__(self, comm, young, friction, size):
        body = block(comm, (2, 1), cell="quadrilateral")
        self.young = fem.Constant(body.domain, young)
        self.size = fem.Constant(body.domain, size)
        gamma = fem.Constant(body.domain, 0.0)
        self.problem, self.contact = on_floor(body, Coulomb(friction), young=self.young)
        way = self.size * gamma * ufl.as_vector((0.002, -0.01))
        self.system = ParametricContact(self.problem, gamma, driven=[(body.moved, way)])

    def answers(self):
        """Whether the search is complete, contact forces found, Lemke's, and S."""
        system = self.system
        answer = find_solutions(system, [system.create_vector()], 1.0, proof_seconds=5.0)
        points = answer.points(system)
        found = [system.result_at(p).resultants["contact"] for p in points]
        system.set_parameter(1.0)
        lemke = self.problem.solve(algorithm="lemke").resultants["contact"]
        return answer.complete, found, lemke, self.problem.reduced().S


def attack(case):
    changed = _Made(case.comm, 1000.0, 0.1, 1.0)
    for young, friction, size in ((1000.0, 0.1, 1.0), (400.0, 0.4, 1.0), (400.0, 0.1, 3.0)):
        changed.young.value = young
        changed.size.value = size
        changed.contact.law.friction.value = friction
        complete, found, lemke, S = changed.answers()
        expected = _Made(case.comm, young, friction, size).answers()
        case.true("as complete", complete == expected[0])
        case.equal("solutions", found, expected[1])
        case.equal("Lemke's", lemke, expected[2])
        case.equal("S", S, expected[3])
        case.equal("force", lemke[1], young * 0.01 * size)
