"""Runs that are recorded, killed and resumed with what a second script has made."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from bodies import Block, block

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, materials
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.records import EvolutionRecord

_FOLDERS: list[tempfile.TemporaryDirectory[str]] = []  # removed at the end of the process


class Killed(Exception):
    """What ends a run early."""


class Killer:
    """An observer that ends a run after so many points."""

    def __init__(self, after: int):
        self._left = after

    def __call__(self, *_: Any) -> None:
        """Count a point."""
        self._left -= 1
        if not self._left:
            raise Killed


def folder(comm: MPI.Comm) -> Path:
    """A new folder for a record, the same on all ranks."""
    name = None
    if comm.rank == 0:
        _FOLDERS.append(tempfile.TemporaryDirectory())
        name = _FOLDERS[-1].name
    return Path(comm.bcast(name)) / "record"


def resumed(
    comm: MPI.Comm,
    first: Callable[[], QuasiStatic | NSCD],
    second: Callable[[], QuasiStatic | NSCD],
    times: Sequence[float],
    after: int = 2,
) -> Any:
    """The history of ``second`` from a record of ``first`` that was killed after some steps."""
    where = folder(comm)
    evolution = first()
    with EvolutionRecord(where, evolution) as record, contextlib.suppress(Killed):
        evolution.run(times, record=record, observer=Killer(after))
    with EvolutionRecord(where, second(), resume=True) as record:
        return record.go_on()


def compare(case: Any, found: Any, expected: Any, tolerance: float = 1e-6) -> None:
    """Compare the last step of a resumed history with that of one that was never killed."""
    ends = found.steps[-1], expected.steps[-1]
    tables = [end.result.tables["contact"] for end in ends]
    case.equal("forces", *(np.column_stack([t.rn, t.rt]) for t in tables), tolerance)
    case.equal("work of loads and supports", *(e.energies.external for e in ends), tolerance)
    case.equal("dissipated", *(e.energies.dissipated for e in ends), tolerance)


def pushed(
    comm: MPI.Comm, cells: tuple[int, int], height: float = 0.0
) -> tuple[Block, ContactProblem]:
    """A block that its weight and a side force push along a floor of some height, for motions."""
    body = block(comm, cells, cell="quadrilateral")
    steel = materials.LinearElastic.from_young(1000.0, 0.2)
    force = fem.Constant(body.domain, (30.0, -100.0))
    energy = steel.energy(body.u) * ufl.dx - ufl.dot(force, body.u) * ufl.dx
    floor = HalfSpace(point=(0, height), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(0.3))
    return body, ContactProblem(energy, body.u, [contact], bcs=body.bcs)


@dataclass
class Dragged:
    """A block that is pressed on a floor by its top and dragged to and fro."""

    body: Block
    young: fem.Function
    evolution: QuasiStatic


#: Pressed, dragged to the right, and back.
TIMES = (0.0, 1.0, 2.0, 3.0)
WAY = np.array([[0.0, 0.0], [0.0, -0.02], [0.012, -0.02], [-0.004, -0.015]])


def dragged(
    comm: MPI.Comm,
    young: Callable[[Any], Any] = lambda x: 1000.0 + 0 * x[0],
    friction: Callable[[Any], Any] = lambda x: 0.3 + 0 * x[0],
    cell: str = "quadrilateral",
) -> Dragged:
    """Make one, of a stiffness cell by cell and a friction node by node."""
    body = block(comm, (4, 2), cell=cell)
    stiffness = fem.Function(fem.functionspace(body.domain, ("DG", 0)))
    stiffness.interpolate(young)
    coefficient = fem.Function(fem.functionspace(body.domain, ("Lagrange", 1)))
    coefficient.interpolate(friction)
    steel = materials.LinearElastic.from_young(stiffness, 0.2)
    floor = HalfSpace(point=(0, 0), normal=(0, 1))
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Coulomb(coefficient))
    problem = ContactProblem(steel.energy(body.u) * ufl.dx, body.u, [contact], bcs=body.bcs)

    def load(t: float) -> None:
        x, y = (np.interp(t, TIMES, WAY[:, k]) for k in range(2))
        body.moved.interpolate(lambda p: np.stack([x + 0 * p[0], y + 0 * p[0]]))

    return Dragged(body, stiffness, QuasiStatic(problem, load))
