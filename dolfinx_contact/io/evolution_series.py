# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of an evolution: states for ParaView and a table of steps."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dolfinx_contact._mpi import Arguments, collective, on_root
from dolfinx_contact._validate import count
from dolfinx_contact.continuation.observer import Observer
from dolfinx_contact.io.fields import StateFields
from dolfinx_contact.io.table import GrowingTable
from dolfinx_contact.io.writers import Format, Writer

if TYPE_CHECKING:
    from dolfinx_contact.equations.state import State
    from dolfinx_contact.evolution.history import EvolutionStep
    from dolfinx_contact.evolution.run import RunState
    from dolfinx_contact.problem import ContactProblem

__all__ = ["EvolutionSeries"]

_TABLE = "steps.csv"


def _check(a: Arguments) -> None:
    count(a.every, "every")


class EvolutionSeries(Observer):
    """Observer that writes the start and the steps of an evolution. Collective context manager.

    The following files are written, with the suffix ``.pvd`` instead of ``.bp`` for
    ``format="vtk"``. The script ``paraview.py`` in the folder shows them:

    - ``evolution_body.bp``: displacement of the bodies.
    - ``evolution_body_stress.bp``: stresses, if requested.
    - ``evolution_contact.bp`` or ``evolution_contact_NAME.bp``: fields of a contact surface.
    - ``steps.csv``: table with the rows of `History.rows`, one for the start and one per step. Each
      row is on the disk before the next step is computed.

    The files of fields are completed at the end of the context, and files of an earlier series are
    then removed. After an error they contain the states up to the last accepted step. If the
    process may be killed, use `EvolutionRecord`, which saves every step. To combine the series with
    another observer, pass ``continuation.Observers(series, other)``. An observer function that only
    calls ``series(step)`` does not write the start.

    Args:
        folder: output folder, created if necessary.
        problem: contact problem of the evolution.
        every: number of steps between two states whose fields are written, at least 1, counted from
            the start. The table contains all steps.
        stress: 3 x 3 UFL stress, or a dictionary of stresses by cell tag, as for `write_fields`;
            default: no stresses are written.
        format: "vtx" (``.bp``) or "vtk" (``.pvd``); default: see `write_fields`.

    Raises:
        OSError: on every rank, with the path and the reason, if a file cannot be written.
        ValueError: on every rank, if the format is not available, if the stress is not valid for
            `write_fields`, if arguments differ between ranks, or if a run uses the observer outside
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
        format: Format = None,
    ):
        self._problem = problem
        self._every = every
        self._fields = StateFields(problem, stress)
        self._writer = Writer(problem.comm, folder, format, "evolution_")
        self._count: int | None = None  # of states; None outside the context

    @property
    def files(self) -> list[Path]:
        """Paths of the files, available after the end of the context."""
        return self._writer.files

    def __enter__(self) -> EvolutionSeries:
        self._writer.__enter__()
        self._table = GrowingTable(self._problem.comm, self._writer.folder / _TABLE)
        self._count = 0
        return self

    def begin(self, task: Any, state: RunState) -> None:
        """Write the start of an evolution, in its first run only. Collective."""
        from dolfinx_contact.evolution.history import History, PathHistory

        if self._count:
            return
        start = state.accepted
        history = History(start.time, start.energies)
        if start.state.gamma is not None:
            history = PathHistory(start.time, start.energies, gamma=start.gamma)
        history.begin(state.number, self._problem)
        self._write(history.first, start.time, start.state)

    def step(self, step: EvolutionStep, state: RunState | None = None) -> None:
        """Write an accepted step. Collective."""
        self._write(step.row(), step.time, step.state)

    def __call__(self, step: EvolutionStep) -> None:
        self.step(step)

    def _write(self, row: dict[str, Any], time: float, state: State | None) -> None:
        """Write a row of the table and, if the step is due, the fields. Collective.

        The fields are written every ``every`` steps (`EvolutionSeries`).

        Args:
            row: row of the table.
            time: time of the state.
            state: state whose fields are written; None for the present values of the Functions.
        """
        if self._count is None:
            raise ValueError(
                "an EvolutionSeries writes only in its context: with EvolutionSeries(...) as "
                "series: evolution.run(times, observer=series)"
            )
        self._table.add(row)
        if self._count % self._every == 0:
            with self._problem.at(state) as shown:
                self._writer.write(time, self._fields.at(shown))
        self._count += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        if not self._count:
            table = self._writer.folder / _TABLE
            on_root(self._problem.comm, lambda: table.unlink(missing_ok=True))
        self._count = None
        # the steps before an error are complete, unless they could not be written
        written = error if isinstance(error, OSError) else None
        self._writer.__exit__(None, written, trace)
