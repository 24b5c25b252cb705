"""The work of decohesion, a Function, is mirrored between a killed path by arc length and its
resumption.

The right answer is the path of the second script, never killed.
"""

import contextlib

from bodies import block
from recorded import Killed, Killer, folder

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactProblem,
    ContactSurface,
    HalfSpace,
    ParametricContact,
    materials,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength
from dolfinx_contact.records import PathRecord, read_journal

RANGE = (0.0, 0.03)
CONTROL = StepControl(initial=0.02, maximum=0.1)


def make(comm, left, right):
    body = block(comm, (2, 1), (1.0, 0.5), "quadrilateral")
    work = fem.Function(fem.functionspace(body.domain, ("Lagrange", 1)))
    work.interpolate(lambda x: left + (right - left) * x[0])
    steel = materials.LinearElastic.from_young(200.0, 0.0)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    bond = RCCM(100.0, 100.0, work, 0.0, 0.0)
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=bond)
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)
    lift = fem.Constant(body.domain, 0.0)
    way = ufl.as_vector((0.0, lift))
    return ArcLength(ParametricContact(problem, lift, driven=[(body.moved, way)]))


def recorded(comm, where, after, left, right):
    path = make(comm, left, right)
    with PathRecord(where, path) as record, contextlib.suppress(Killed):
        path.run(gamma_range=RANGE, record=record, control=CONTROL, observer=Killer(after))


def history(case, first, second):
    where = folder(case.comm)
    whole = folder(case.comm)
    recorded(case.comm, where, 3, *first)
    with PathRecord(where, make(case.comm, *second), resume=True) as record:
        record.go_on()
    recorded(case.comm, whole, 1000, *second)
    found, expected = (read_journal(w).rows() for w in (where, whole))
    case.true("as many points", len(found) == len(expected))
    case.equal("loads", [r["gamma"] for r in found], [r["gamma"] for r in expected])
    case.equal("damage", found[-1]["damage"], expected[-1]["damage"], 1e-4)


def attack(case):
    history(case, (0.05, 0.1), (0.1, 0.05))


def honest(case):
    history(case, (0.05, 0.1), (0.05, 0.1))
