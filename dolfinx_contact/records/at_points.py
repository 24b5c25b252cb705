# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays at the contact points of a problem, taken from and brought to any number of ranks.

A surface has them in the order of its table: by place, and points at one place (the sides of a
crack) by their nodes in the mesh as it was given to DOLFINx.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.order import Gathered
from dolfinx_contact.points.memory import Memory

if TYPE_CHECKING:
    from dolfinx_contact.evolution.accepted import AcceptedState
    from dolfinx_contact.problem import ContactProblem

__all__ = ["AtPoints"]

Arrays = dict[str, npt.NDArray[Any]]


class AtPoints:
    """Statuses and memory of the points of all surfaces. Collective.

    Args:
        problem: whose surfaces have them.
    """

    def __init__(self, problem: ContactProblem):
        self._surfaces = [Gathered(s.comm, s.positions, s.points.ids) for s in problem.surfaces]

    def gathered(self, accepted: AcceptedState) -> Arrays:
        """What the points of all ranks have at a state, by name, on every rank. Collective."""
        found: Arrays = {}
        every = zip(self._surfaces, accepted.shown, accepted.memory, strict=True)
        for i, (surface, codes, memory) in enumerate(every):
            found[f"{i}.statuses"] = surface(codes)
            for name, values in _arrays(memory).items():
                found[f"{i}.memory.{name}"] = surface(values)
        return found

    def statuses(self, found: Mapping[str, npt.NDArray[Any]]) -> list[npt.NDArray[np.int8]]:
        """The statuses of the points of this rank, surface by surface."""
        return [found[f"{i}.statuses"][s.mine] for i, s in enumerate(self._surfaces)]

    def memory(self, found: Mapping[str, npt.NDArray[Any]]) -> tuple[Memory | None, ...]:
        """The memory of the points of this rank, surface by surface."""
        memories: list[Memory | None] = []
        for i, surface in enumerate(self._surfaces):
            start = f"{i}.memory."
            names = [name for name in found if name.startswith(start)]
            arrays = {name.removeprefix(start): found[name][surface.mine] for name in names}
            jump = arrays.pop("jump", None)
            memories.append(None if jump is None else Memory(jump, arrays))
        return tuple(memories)


def _arrays(memory: Memory | None) -> Arrays:
    """All arrays of a memory, whichever it has."""
    return {} if memory is None else {"jump": memory.jump, **memory.fields}
