# SPDX-License-Identifier: LGPL-3.0-or-later
"""Validation of the arguments of continuation functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from dolfinx_contact._mpi import everywhere, same_everywhere
from dolfinx_contact._progress import PROGRESS
from dolfinx_contact._validate import count, instance, one_of, vector
from dolfinx_contact.continuation.observer import Stop, as_observer, is_observer
from dolfinx_contact.continuation.step_control import StepControl
from dolfinx_contact.continuation.system import System

__all__ = [
    "ROUND_OFF",
    "check_listeners",
    "check_rays",
    "check_states",
    "check_steps",
    "check_system",
    "checked_range",
    "reason_to_stop",
    "require_smooth",
    "samples_of",
]

_SHORTEST = 1e-150  # length of ranges of gamma whose squares are normal numbers
_LONGEST = 1e150
_SAMPLES = 33  # values of a range at which the data are validated
ROUND_OFF = 1e-12  # relative length below which a range of gamma is a point


def samples_of(low: float, high: float) -> list[float]:
    """Return equally spaced values of gamma, both ends included, for checks of the data."""
    return [float(gamma) for gamma in np.linspace(low, high, _SAMPLES)]


def check_system(system: Any) -> None:
    """Raise `ValueError` unless the argument is a `System`."""
    hint = "such as a ParametricContact of a contact problem and its parameter"
    instance(system, "what is followed", System, hint)


def require_smooth(system: System) -> None:
    """Raise ``ValueError`` if the system has kinks where no status changes.

    The statuses do not show such kinks, and continuation assumes that H is smooth between changes.
    """
    if system.kinks:
        raise ValueError(
            f"{system.kinks}; branches are followed only if H is smooth as long as no status "
            "changes: solve at single values of gamma, or use a bulk without kinks"
        )


def checked_range(
    ends: Any, starts: Sequence[float], parameter: str = "gamma"
) -> tuple[float, float]:
    """Return the lowest and highest value of a parameter after validation.

    Raises:
        ValueError: if the range is not valid or does not contain all ``starts``.
    """
    name = f"{parameter}_range"
    low, high = (float(end) for end in vector(ends, name, 2))
    if not low < high:
        raise ValueError(f"the range [{low}, {high}] of {parameter} is empty")
    if not all(low <= gamma <= high for gamma in starts):
        which = ", ".join(f"{gamma:g}" for gamma in starts)
        raise ValueError(f"{parameter} = {which} must lie in the range [{low}, {high}]")
    if not max(_SHORTEST, ROUND_OFF * max(-low, high)) < high - low < _LONGEST:
        raise ValueError(f"{name} [{low}, {high}] is too short or too long to be computed with")
    return low, high


def check_states(system: System, states: Sequence[Any], what: str) -> None:
    """Raise `ValueError` on every rank if a state is not a vector of the system. Collective.

    Args:
        system: system of equations.
        states: vectors of unknowns x.
        what: description of a state, for the message.
    """
    same_everywhere(system.comm, number_of_states=len(states))
    one = system.create_vector()
    with everywhere(system.comm, what):
        for x in states:
            hint = "a PETSc vector of all unknowns, as create_vector() makes it"
            instance(x, what, PETSc.Vec, hint)
            if (x.getLocalSize(), x.getSize()) != (one.getLocalSize(), one.getSize()):
                raise ValueError(
                    f"{what} does not fit the unknowns: {x.getLocalSize()} of {x.getSize()} "
                    f"entries on a rank that has {one.getLocalSize()} of {one.getSize()}"
                )
            if not np.isfinite(x.array_r).all():
                raise ValueError(f"{what} has an entry that is not finite")


def check_listeners(
    *,
    observer: Any = None,
    record: Any = None,
    progress: Any = None,
    stop: Any = None,
    of: str = "a records.BranchRecord",
) -> None:
    """Raise `ValueError` if ``observer``, ``record``, ``progress`` or ``stop`` is not valid.

    Args:
        observer: observer, or function called with every step.
        record: observer that stores the steps.
        progress: whether to show a progress line.
        stop: function called with every step.
        of: description of the required class of ``record``, for the message.
    """
    if observer is not None:
        as_observer(observer)
    if record is not None and not is_observer(record):
        raise ValueError(f"record must be {of}, got {record!r}")
    if stop is not None and not callable(stop):
        raise ValueError(f"stop must be a function of a step, got {stop!r}")
    one_of(progress, "progress", PROGRESS)


def check_rays(rays: Any) -> None:
    """Raise ``ValueError`` unless the option ``rays`` of a run is True, False or None.

    The option selects whether all directions in which an evolution can continue are computed, see
    `QuasiStatic.run` and `ArcLength.run`.
    """
    one_of(rays, "rays", (True, False, None))


def check_steps(control: Any, max_steps: Any) -> None:
    """Raise `ValueError` if ``control`` or ``max_steps`` is not valid."""
    if control is not None:
        instance(control, "control", StepControl)
    count(max_steps, "max_steps")


def reason_to_stop(comm: MPI.Comm, what: str, stop: Stop[Any], step: Any) -> str:
    """Call the user's function ``stop``; return the reason to stop, or "". Collective.

    Args:
        comm: communicator.
        what: name of the process, such as "branch", for the message.
        stop: user function, called with the step.
        step: accepted step; the problem is in the state at its end.

    Raises:
        ValueError: on every rank, if the returned value is not a string, or differs between ranks.
    """
    with everywhere(comm, "stop"):
        answer = stop(step)
        if not isinstance(answer, str):
            raise ValueError(
                f"stop must return the reason to end the {what}, a str, or '' to "
                f"continue; it returned {answer!r}"
            )
    same_everywhere(comm, the_answer_of_stop=answer)
    return answer
