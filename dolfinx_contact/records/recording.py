# SPDX-License-Identifier: LGPL-3.0-or-later
"""Following a branch with or without a record, in one call."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from petsc4py import PETSc

from dolfinx_contact._errors import same_everywhere
from dolfinx_contact.continuation import Branch, Route, Seen, StepControl, follow
from dolfinx_contact.records.branch_record import BranchRecord
from dolfinx_contact.records.journal import Journal
from dolfinx_contact.records.points import Functional
from dolfinx_contact.records.series import write_series
from dolfinx_contact.records.tracing import journal_of

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["follow_with_journal"]


def follow_with_journal(
    system: ParametricContact,
    x: PETSc.Vec,
    gamma: float,
    functionals: Mapping[str, Functional] | None = None,
    *,
    gamma_range: tuple[float, float],
    record: str | os.PathLike[str] | None = None,
    surface_displacement: bool = False,
    resume: bool = False,
    series: str | os.PathLike[str] | None = None,
    control: StepControl | None = None,
    max_steps: int = 1000,
    route: Route = "auto",
    observer: Seen | None = None,
    progress: bool | None = None,
) -> tuple[Branch, Journal]:
    """Follow a branch and look at it: `follow`, then `journal_of`. Collective.

    With a folder for a record every point, fields included, is on the disk before the next one is
    computed, and a run that was killed goes on from there.

    Args:
        system: the problem.
        x: a solution at ``gamma``; not looked at where a branch is resumed.
        gamma: where to start.
        functionals: by name, as for `BranchRecord`.
        gamma_range: the branch ends where gamma reaches either end.
        record: folder of the record, if there is to be one.
        surface_displacement: see `BranchRecord`.
        resume: whether to go on with it; if nothing was recorded in it, from the start.
        series: folder for the recorded fields, for ParaView.
        control: step lengths.
        max_steps: budget from the start of the branch.
        route: see `follower_for`.
        observer: called with every point, beside the record; see `follow`, as for the progress.
        progress: whether rank 0 reports where it is.

    Returns:
        All points of the branch, with special points and the work of this run only, and its
        journal.

    Raises:
        OSError: as `BranchRecord`.
        ValueError: as `follow` and `BranchRecord`.
    """
    of_record = [bool(resume), series is not None, bool(surface_displacement)]
    same_everywhere(system.comm, record=record is not None, resume_series_and_surface=of_record)
    if record is None:
        if any(of_record):
            raise ValueError(
                "to resume a branch, or to keep or write its fields, a record is needed"
            )
        branch = follow(
            *(system, x, gamma),
            gamma_range=gamma_range,
            control=control,
            max_steps=max_steps,
            route=route,
            observer=observer,
            progress=progress,
        )
        return branch, journal_of(system, [branch], functionals)
    shows = surface_displacement
    with BranchRecord(
        record, system, functionals, every=1, surface_displacement=shows, resume=resume
    ) as kept:
        if kept.journal.branches:
            branch = kept.go_on(max_steps=max_steps, observer=observer, progress=progress)
        else:
            branch = follow(
                *(system, x, gamma),
                gamma_range=gamma_range,
                control=control,
                max_steps=max_steps,
                route=route,
                observer=observer,
                record=kept,
                progress=progress,
            )
        branch.points = kept.points()
        if series is not None:
            write_series(series, kept)
        return branch, kept.journal
