# SPDX-License-Identifier: LGPL-3.0-or-later
"""Memory of the contact points at the last accepted state.

In a quasi-static evolution friction opposes the slip rate, not the total slip. In a step that
begins at an accepted state with the jump j_0, the law is evaluated at

    j - (I - n n^T) j_0,

with the current jump j and normal n: the normal part is total, and the tangential part is the slip
increment of the step (implicit Euler in the slip velocity; rate-independent friction needs no
time). Jumps are relative to the obstacle: the motion of a rigid body has been subtracted. On a
curved obstacle in large sliding, the increment is measured along its surface (`displaced`), and the
memory contains j_0 in the frame of the obstacle.

A memory is frozen: solves read it and never change it. An accepted step creates a new memory; a
rejected step keeps the old one. The memory also contains internal variables of the law, such as the
intensity of adhesion. A law with internal variables also receives j_0 and the duration of the step,
because friction acts on increments and adhesion on total jumps. For laws that depend on it, the
memory contains the slip distance in contact, which is summed over the accepted steps and never
decreases.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array, Codes
from dolfinx_contact._geometry import dot, tangential
from dolfinx_contact.laws import PointData
from dolfinx_contact.laws.compiled import CompiledLaw
from dolfinx_contact.laws.status import closed
from dolfinx_contact.laws.symbols import SLID, STEP, before

__all__ = ["Memory", "read_only_copy", "slid_after", "with_memory"]


@dataclass(frozen=True, eq=False)
class Memory:
    """Memory of the contact points of a surface on this rank. Its arrays are read-only copies.

    Attributes:
        jump: total jump at the last accepted state, shape (n, dim).
        fields: internal variables of the law at that state, by name, and the distance slipped until
            then (``SLID`` of `laws.symbols`) if the law depends on it, shape (n,) each.
        step: time from that state to the current one.
        gap: gap in the law at that state, shape (n,), for laws at the velocity level; None for
            other laws.
        displacement: displacement of the owned nodes at that state in large sliding of pairs, shape
            (nodes, dim); None otherwise.
        place: displacement of the points at that state in the frame of a curved obstacle that they
            follow, shape (n, dim); None otherwise.
        motion: motion at that state of the rigid body to which the frame belongs, shape (k,); None
            if the frame does not turn.
    """

    jump: Array
    fields: Mapping[str, Array] = field(default_factory=dict)
    step: float = 0.0
    gap: Array | None = None
    displacement: Array | None = None
    place: Array | None = None
    motion: Array | None = None

    def __post_init__(self) -> None:
        kept = {name: read_only_copy(values, np.float64) for name, values in self.fields.items()}
        object.__setattr__(self, "fields", kept)
        for name in ("jump", "gap", "displacement", "place", "motion"):
            object.__setattr__(self, name, read_only_copy(getattr(self, name), np.float64))

    def __reduce__(self) -> Any:
        # arrays become writeable when they are unpickled, unless the constructor runs again
        return type(self), tuple(getattr(self, f.name) for f in fields(self))

    def later(self, step: float) -> Memory:
        """Return a copy of the memory for a step of duration ``step``."""
        return replace(self, step=step)

    def reference(self, n: Array) -> Array:
        """Return the tangential part of the remembered jump, shape (n, dim).

        Args:
            n: current unit normals, shape (n, dim).
        """
        return tangential(self.jump, n)

    def reference_rate(self, n: Array, rate: Array) -> Array:
        """Return the rate of the tangential part of the remembered jump as the normals turn.

        Args:
            n: current unit normals, shape (n, dim).
            rate: rates of the normals, shape (n, dim).
        """
        along, turning = (dot(self.jump, v)[:, None] for v in (n, rate))
        return -turning * n - along * rate


def with_memory(law: CompiledLaw, memory: Memory | None, data: PointData) -> PointData:
    """Return the data of the law at the points, with values from the memory if the law uses it.

    Args:
        law: compiled law.
        memory: memory at the beginning of the step; None under the static law.
        data: data of the points.
    """
    if memory is not None and memory.gap is not None:
        data = replace(data, gap=memory.gap)
    n, dim = data.n.shape
    remembered = {} if memory is None else memory.fields
    if not (law.remembers or set(law.names) & set(remembered)):
        return data
    known = Memory(np.zeros((n, dim)), step=-1.0) if memory is None else memory
    added: dict[str, Array] = dict(zip(before(dim), list(known.jump.T), strict=True))
    added |= {STEP: np.full(n, known.step), SLID: np.zeros(n)}
    added |= {name: np.zeros(n) for name in law.kept}
    return replace(data, fields={**data.fields, **added, **known.fields})


def slid_after(data: PointData, jump: Array, statuses: Codes) -> Array:
    """Return the total distances slipped in contact until the end of a step, shape (n,).

    Args:
        data: data of the points with the memory of the step.
        jump: jumps in the law at the end of the step, shape (n, dim).
        statuses: statuses at the end of the step; motion of open points is not counted.
    """
    along = tangential(jump, data.n)
    step = np.where(closed(statuses), np.linalg.norm(along, axis=1), 0.0)
    return data.fields[SLID] + step


def read_only_copy(values: Any, dtype: npt.DTypeLike = None) -> Any:
    """Return a read-only copy of an array; None if the argument is None."""
    if values is None:
        return None
    copy = np.array(values, dtype=dtype)
    copy.flags.writeable = False
    return copy
