# SPDX-License-Identifier: LGPL-3.0-or-later
"""Immutable copies of the states of a contact problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact.points.memory import Memory, read_only_copy

__all__ = ["State"]


@dataclass(frozen=True, eq=False)
class State:
    """State of a contact problem on this rank: a frozen value that can be pickled.

    `ContactProblem.snapshot` returns the current state, and `ContactProblem.restore` copies a state
    into the Functions. Evaluators such as `ContactProblem.table` and `io.write_fields` accept a
    state. All arrays are read-only copies.

    Attributes:
        displacement: local values of the displacement, ghosts included.
        multipliers: local values of the multiplier of each surface, in units of stress.
        statuses: status codes of the contact points of each surface (`laws.status`).
        motions: displacement and rotation of each rigid body, lengths and radians.
        memory: memory of each surface for a step beginning in this state.
        previous: memory of each surface at the beginning of the step that ended in this state; the
            entries are None under the static law.
        time: time of the state in an evolution; None for other states.
        gamma: load parameter of a point on a branch; None for other states.
        velocity: local values of the velocity in dynamics; None for other states.
        energies: energies since the start of an evolution, by name; None for other states.
        signature: checksum of the mesh, and of the names, methods and contact points of the
            surfaces on this rank.

    Example:
        Solve for two loads from the same start::

            start = problem.snapshot()
            results = []
            for force in (1.0, 2.0):
                problem.restore(start)
                load.value[1] = -force
                results.append(problem.solve())
    """

    displacement: Array
    multipliers: tuple[Array, ...]
    statuses: tuple[Codes, ...]
    motions: tuple[Array, ...]
    memory: tuple[Memory, ...]
    previous: tuple[Memory | None, ...]
    time: float | None = None
    gamma: float | None = None
    velocity: Array | None = None
    energies: Mapping[str, float] | None = None
    signature: int = 0

    def __post_init__(self) -> None:
        for name in ("multipliers", "statuses", "motions"):
            object.__setattr__(self, name, tuple(map(read_only_copy, getattr(self, name))))
        for name in ("memory", "previous"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("displacement", "velocity"):
            object.__setattr__(self, name, read_only_copy(getattr(self, name)))

    def __reduce__(self) -> Any:
        # Arrays become writeable when they are unpickled, unless the constructor runs again.
        return type(self), tuple(getattr(self, f.name) for f in fields(self))
