# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of an evolution: states for ParaView and a table of steps."""

from __future__ import annotations

import os
import re
import shutil
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._validate import count, flag
from dolfinx_contact.evolution.energy import Energies
from dolfinx_contact.io.disk import aside
from dolfinx_contact.io.fields import check_stress, faces, state_fields
from dolfinx_contact.io.folder import output_folder
from dolfinx_contact.io.script import write_script
from dolfinx_contact.io.table import GrowingTable
from dolfinx_contact.io.writers import FieldSeries, Format, checked_format

if TYPE_CHECKING:
    from dolfinx_contact.evolution.history import EvolutionStep
    from dolfinx_contact.problem import ContactProblem

__all__ = ["EvolutionSeries"]

_TABLE = "steps.csv"


def _check(a: Arguments) -> None:
    count(a.every, "every")
    flag(a.start, "start")


class EvolutionSeries:
    """An observer of evolutions that writes their accepted steps. Collective, as a context.

    ``evolution_body.bp`` holds the displacement, ``evolution_contact.bp`` (or
    ``evolution_contact_NAME.bp``) the fields of a contact surface, ``..._opposite.bp`` those of the
    master of a pair, over the time of the evolution; ``evolution_body_stress.bp`` contains the
    stresses, if requested; ``steps.csv`` is the table of steps. With
    ``format="vtk"`` it is ``evolution_body.pvd`` with a ``.vtu`` of each time, ... ``paraview.py``
    in the folder shows them. Files of an earlier series are removed when the first step is
    accepted, or when the context ends without a step. Each row of the table is on the disk before
    the next step is computed. Fields are complete when the context ends, also after an error, up to
    the last accepted step. `EvolutionRecord` keeps the fields of a killed run.

    Args:
        folder: output folder, created if necessary.
        problem: contact problem of the evolution.
        every: number of steps between two written states, from 1; the table contains all steps.
        stress: 3 x 3 UFL stress, or one per cell tag, as for `write_fields`; by default no stresses
            are written.
        start: whether the table begins with a row for the start of the first step: its time, and
            zero energies if it is the first step of the evolution; other columns are blank.
        format: "vtx" (``.bp``) or "vtk" (``.pvd``); by default as in `write_fields`.

    Attributes:
        files: paths of the files, after the context has ended.

    Raises:
        OSError: on every rank, with the path and the reason, if a file cannot be written.
        ValueError: on every rank, if the format is not available, the stress is refused as by
            `write_fields`, or arguments differ between ranks; also from a run that uses it outside
            its context.

    Example:
        ::

            with io.EvolutionSeries("output/path", problem) as series:
                history = evolution.run(times, observer=series)
    """

    @collective("a series", _check)
    def __init__(
        self,
        folder: str | os.PathLike[str],
        problem: ContactProblem,
        *,
        every: int = 1,
        stress: Any = None,
        start: bool = False,
        format: Format = None,
    ):
        self._problem = problem
        self._comm = problem.comm
        self._start = start
        self._stress, self._tags = stress, check_stress(problem, stress)
        self._every = every
        self._format = checked_format(self._comm, format)
        self._folder = output_folder(self._comm, folder)
        self._faces = faces(problem)
        self._series: FieldSeries | None = None
        self._stack: ExitStack | None = None
        self.files: list[Path] = []

    def __enter__(self) -> EvolutionSeries:
        self._count = 0
        self._table = GrowingTable(self._comm, self._folder / _TABLE)
        self._stack = ExitStack()
        self._part = self._stack.enter_context(aside(self._comm, self._folder, "evolution"))
        self._series = FieldSeries(self._part, self._folder, self._format)
        return self

    def __call__(self, step: EvolutionStep) -> None:
        if self._series is None:
            raise ValueError(
                "an EvolutionSeries writes in its context alone: with EvolutionSeries(...) as "
                "series: evolution.run(times, observer=series)"
            )
        if self._count == 0:
            self._forget()
        if self._start and self._count == 0:
            self._table.add(step.row_before(Energies().row() if step.number == 1 else {}))
        self._table.add(step.row())
        self._count += 1
        if (self._count - 1) % self._every:
            return
        with self._problem.at(step.state) as shown:
            given = self._faces, self._stress, self._tags
            self._series.write(step.time, state_fields(shown, *given, prefix="evolution_"))

    def __exit__(self, *_: object) -> None:
        assert self._stack is not None
        assert self._series is not None
        stack = self._stack
        written = self._series
        self._stack = None
        self._series = None
        with stack:
            written.close()
            if self._count:
                write_script(self._comm, self._part, self._folder)
            else:
                self._forget()
        self.files = written.files

    def _forget(self) -> None:
        """Remove the files of an earlier series. Collective."""
        on_root(self._comm, lambda: _remove_series(self._folder))


def _remove_series(folder: Path) -> None:
    """Remove the files of a series from a folder. Not collective."""
    (folder / _TABLE).unlink(missing_ok=True)
    for path in folder.glob("evolution_*"):
        kinds = r"\.bp|\.pvd|(_p\d+_)?\d{6}\.p?vtu"
        if re.fullmatch(rf"evolution_(body|body_stress|contact.*?)({kinds})", path.name):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
