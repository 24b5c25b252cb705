# SPDX-License-Identifier: LGPL-3.0-or-later
r"""What contact points remember from the last accepted state.

In a quasi-static evolution friction resists slip as it happens, not displacement as it is: the law
of a step from t_n to t_n+1 sees the jump

    j - (I - n n^T) j_n,

whose normal part is total and whose tangential part is the increment since the accepted state n
(implicit Euler in the slip velocity, for which rate-independent friction needs no time).
n is the normal of now, and j the motion relative to what is touched, so that a rigid body that
moves is subtracted. On a curved obstacle in large sliding the increment is that along its surface,
from where the points were on it (`displaced`), and memory has j_n in the frame of the obstacle.

A memory is frozen: H reads it, nothing in a solve writes it. Accepting a step makes a new one,
rejecting a step keeps the old one. Fields that a law remembers (the intensity of an adhesion) are
here as well, and such a law sees the whole of j_n, and the time since: friction acts on increments,
adhesion on total jumps. So is the distance that points have slipped while they touched, of laws
that depend on it: it is summed up over the accepted steps, and never falls.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.laws import PointData
from dolfinx_contact.laws.compiled import CompiledLaw
from dolfinx_contact.laws.status import closed
from dolfinx_contact.laws.symbols import SLID, STEP, before, from_memory

__all__ = ["Memory", "slid_after", "with_memory"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Memory:
    """What the contact points of a surface remember, on this rank.

    Attributes:
        jump: j_n, the total jump at the last accepted state (n, dim), a length. Read-only.
        fields: of the law, as they were there, and what it keeps (n,), by name; of a law that
            depends on it the distance slipped until then, ``SLID`` of `laws.symbols`. Read-only.
        step: time from that state to the present one.
        gap: what replaces the gap in the law (n,), where it is about velocities; None elsewhere.
        displacement: of the owned nodes (nodes, dim) at that state, of faces that slide over each
            other; None of others. Read-only.
        place: displacement of the points at that state, in the frame of a curved obstacle that they
            follow (n, dim); None of others. Read-only.
        motion: of the rigid body at that state whose frame that is (k,); None where frames do not
            turn. Read-only.
    """

    jump: Array
    fields: Mapping[str, Array] = field(default_factory=dict)
    step: float = 0.0
    gap: Array | None = None
    displacement: Array | None = None
    place: Array | None = None
    motion: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "jump", _frozen(self.jump))
        fields = {name: _frozen(values) for name, values in self.fields.items()}
        object.__setattr__(self, "fields", fields)
        for name in ("gap", "displacement", "place", "motion"):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _frozen(values))

    def __reduce__(self) -> Any:
        # Arrays become writeable when they are unpickled, unless the constructor runs again.
        return type(self), tuple(getattr(self, f.name) for f in fields(self))

    def fits(self, number: int, dim: int) -> bool:
        """Whether it is that of so many points."""
        lengths = all(len(values) == number for values in self.fields.values())
        vectors = [self.jump] if self.place is None else [self.jump, self.place]
        return lengths and all(values.shape == (number, dim) for values in vectors)

    @property
    def slides(self) -> bool:
        """Whether it is that of faces that slide over each other."""
        return self.displacement is not None

    @property
    def follows(self) -> bool:
        """Whether it is that of points that follow a curved obstacle."""
        return self.place is not None

    def later(self, step: float) -> Memory:
        """The same memory at a time later by ``step``."""
        return replace(self, step=step)

    def reference(self, n: Array) -> Array:
        """The part of j_n along the surface whose normals are ``n`` (n, dim)."""
        return np.asarray(self.jump - np.sum(self.jump * n, axis=1)[:, None] * n)

    def reference_rate(self, n: Array, rate: Array) -> Array:
        """The rate of `reference` while the normals ``n`` turn at a rate (n, dim)."""
        along, turning = (np.sum(self.jump * v, axis=1)[:, None] for v in (n, rate))
        return np.asarray(-turning * n - along * rate)


def with_memory(law: CompiledLaw, memory: Memory | None, data: PointData) -> PointData:
    """What a law that uses it is given at points; without a memory it is the static law."""
    if memory is not None and memory.gap is not None:
        data = replace(data, gap=memory.gap)
    n, dim = data.n.shape
    held = {} if memory is None else memory.fields
    if not set(law.names) & {*from_memory(dim, law.kept), *held}:
        return data
    known = Memory(np.zeros((n, dim)), step=-1.0) if memory is None else memory
    added: dict[str, Array] = dict(zip(before(dim), list(known.jump.T), strict=True))
    added |= {STEP: np.full(n, known.step), SLID: np.zeros(n)}
    added |= {name: np.zeros(n) for name in law.kept}
    return replace(data, fields={**data.fields, **added, **known.fields})


def slid_after(data: PointData, jump: Array, statuses: npt.NDArray[np.int8]) -> Array:
    """The distances that points have slipped at the end of a step (n,).

    Args:
        data: of the points, with the memory of the step.
        jump: at its end, as laws see it (n, dim).
        statuses: at its end; what is open has moved and not slipped.
    """
    along = jump - np.sum(jump * data.n, axis=1)[:, None] * data.n
    step = np.where(closed(statuses), np.linalg.norm(along, axis=1), 0.0)
    return np.asarray(data.fields[SLID] + step)


def _frozen(values: Array) -> Array:
    found = np.array(values, dtype=np.float64)
    found.flags.writeable = False
    return found
