"""A branch that ends by its budget is resumed from its record, with an observer of one's own.

All points, those that come again too, have the closed form of a block that comes down, and so
have the functionals that the record keeps.
"""

import shutil
import tempfile

import numpy as np
from a12_point_stands import Reader, compared, lowered

from dolfinx_contact import Coulomb
from dolfinx_contact.continuation import StepControl, follow
from dolfinx_contact.records import BranchRecord, read_journal, resume


def _force(contact):
    return lambda problem: float(np.sum(problem.table(contact).rn))


def _recorded(case, folder):
    control = StepControl(maximum=0.06)
    body, problem, contact, gamma, system = lowered(case, Coulomb(0.3))
    work = {"energy": problem.energy, "force": _force(contact)}
    with BranchRecord(folder, system, work, every=4) as record:
        follow(
            system,
            system.create_vector(),
            0.0,
            gamma_range=(0.0, 1.0),
            max_steps=14,
            control=control,
            observer=Reader(body, problem, contact, gamma),
            record=record,
            route="steps",
        )
    body, problem, contact, gamma, system = lowered(case, Coulomb(0.3))
    work = {"energy": problem.energy, "force": _force(contact)}
    reader = Reader(body, problem, contact, gamma)
    branch = resume(folder, system, work, every=4, max_steps=200, observer=reader)
    case.equal("the end", branch.points[-1].gamma, 1.0)
    compared(case, reader)
    columns = read_journal(folder).columns()
    deep = np.maximum(0.01 * np.asarray(columns["gamma"]) - 0.004, 0.0)
    case.equal("recorded force", columns["force"], 1000.0 * deep)
    case.equal("recorded energy", columns["energy"], 500.0 * deep**2)
    case.true("points before and after", len(deep) > 16)


def attack(case):
    folder = case.comm.bcast(tempfile.mkdtemp() if case.comm.rank == 0 else None)
    try:
        _recorded(case, f"{folder}/branch")
    finally:
        case.comm.barrier()
        if case.comm.rank == 0:
            shutil.rmtree(folder, ignore_errors=True)
