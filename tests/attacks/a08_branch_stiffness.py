"""A stiffness of degree 2, different at the middles of edges alone, is mirrored between a branch
and its resumption.

The right answer is the branch of the second script, never killed: its points have the same
parameters and statuses, and the functional of all of them is that of the second script.
"""

import contextlib

import numpy as np
from bodies import block
from recorded import Killed, Killer, folder

import ufl
from dolfinx import fem

from dolfinx_contact import (
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import Observer, StepControl, follow
from dolfinx_contact.records import BranchRecord, read_journal, resume

RANGE = (0.0, 1.0)


def make(comm, mirrored):
    body = block(comm, (2, 2), cell="quadrilateral")
    young = fem.Function(fem.functionspace(body.domain, ("Lagrange", 2)))

    def bubbles(x):
        at = 1.0 - x[0] if mirrored else x[0]
        return 300.0 + 4000.0 * np.abs(np.sin(2 * np.pi * x[0])) * at

    young.interpolate(bubbles)
    rubber = materials.NeoHookean(*materials.lame(1.0, 0.2))
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    energy = young * rubber.energy(body.u) * ufl.dx
    problem = ContactProblem(energy, body.u, [contact], bcs=body.bcs)
    gamma = fem.Constant(body.domain, 0.0)
    way = ufl.as_vector((0.02 * gamma, -0.02 * (1 + gamma)))
    system = ParametricContact(problem, gamma, driven=[(body.moved, way)])
    system.set_parameter(0.0)
    problem.solve()
    x = system.create_vector()
    problem.write(x)
    return system, x, {"energy": problem.energy}


def recorded(comm, where, mirrored, after):
    system, x, work = make(comm, mirrored)
    with BranchRecord(where, system, work, every=1) as record:
        told = dict(record=record, observer=_Killer(after))
        with contextlib.suppress(Killed):
            follow(system, x, 0.0, gamma_range=RANGE, control=CONTROL, **told)


class _Killer(Observer):
    def __init__(self, after):
        self._count = Killer(after)

    def begin(self, *_):
        pass

    def step(self, *_):
        self._count()

    def end(self, *_):
        pass


CONTROL = StepControl(initial=0.2, maximum=0.5)


def history(case, first, second):
    where = folder(case.comm)
    whole = folder(case.comm)
    recorded(case.comm, where, first, 3)
    system, _, work = make(case.comm, second)
    resume(where, system, work, every=1)
    recorded(case.comm, whole, second, 1000)
    found, expected = (read_journal(w).columns() for w in (where, whole))
    case.equal("parameters", found["gamma"], expected["gamma"])
    case.equal("energies", found["energy"], expected["energy"])


def attack(case):
    history(case, False, True)


def honest(case):
    history(case, False, False)
