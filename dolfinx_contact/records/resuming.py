# SPDX-License-Identifier: LGPL-3.0-or-later
"""Going on with a recorded branch, in one call."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

from dolfinx_contact.continuation import Branch, Observer
from dolfinx_contact.continuation.branch import Stop
from dolfinx_contact.records.points import Functional
from dolfinx_contact.records.record import BranchRecord

if TYPE_CHECKING:
    from dolfinx_contact.parametric import ParametricContact

__all__ = ["resume"]


def resume(
    folder: str | os.PathLike[str],
    system: ParametricContact,
    functionals: Mapping[str, Functional] | None = None,
    *,
    branch: int = 0,
    every: int = 10,
    max_steps: int | None = None,
    observer: Observer | None = None,
    stop: Stop | None = None,
) -> Branch:
    """Go on with a recorded branch as if the run had never been killed. Collective.

    Args:
        folder: of the record.
        system: the same problem, on any number of ranks.
        functionals: the same as recorded.
        branch: see `BranchRecord.go_on`, as for the budget, the observer, errors and the result.
        every: fields are kept at every so many points.
        max_steps: another budget.
        observer: told of every point beside the record.
        stop: the same stop condition as at the beginning.
    """
    with BranchRecord(folder, system, functionals, every=every, resume=True) as record:
        return record.go_on(branch, max_steps=max_steps, observer=observer, stop=stop)
