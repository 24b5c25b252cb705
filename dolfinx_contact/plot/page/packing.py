# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays made small for a page: exactly, or fields of many states by few modes.

A field of m states is sum_k c_k v_k, with the first modes of a singular value decomposition, block
by block of states. Modes are whole numbers of 16 bits times a step, which is as large as the error
allows; the reported error is that of what the page decodes, measured at every vertex of every
state. Numbers of the same kind are laid byte plane by byte plane, so that they deflate well.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Arrays", "Packed", "largest_value", "packed_field"]

_BLOCK = 128  # states that share their modes
_INT16 = 32767


@dataclass(frozen=True)
class Packed:
    """An array as a page holds it.

    Attributes:
        data: deflated, base64.
        words: how it is read: ``dtype``, ``shape``, and whether rows are ``xor`` with those before.
    """

    data: str
    words: dict[str, Any]

    @classmethod
    def of(cls, values: npt.NDArray[Any], *, xor: bool = False) -> Packed:
        """Pack an array to the last bit.

        Args:
            values: of 1, 2, 4 or 8 bytes an entry.
            xor: whether every row (of the first axis) is stored as its difference from the one
                before, bit by bit: for rows that are much the same.
        """
        little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        size = little.dtype.itemsize
        rows = len(little) if little.ndim else 1
        raw = little.view(np.uint8).reshape(rows, -1) if little.size else np.zeros((0, 0), np.uint8)
        if xor and len(raw) > 1:
            raw = np.concatenate([raw[:1], raw[1:] ^ raw[:-1]])
        planes = raw.reshape(-1, size).T
        data = base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()
        words = {"dtype": little.dtype.str[1:], "shape": list(values.shape), "xor": xor}
        return cls(data, words)

    @classmethod
    def text(cls, text: str) -> Packed:
        """Pack a text."""
        data = base64.b64encode(zlib.compress(text.encode(), 9)).decode()
        return cls(data, {"dtype": "text", "shape": [], "xor": False})


class Arrays:
    """The arrays of a page by name."""

    def __init__(self) -> None:
        self.packed: dict[str, Packed] = {}

    def add(self, name: str, values: npt.NDArray[Any] | str, *, xor: bool = False) -> str:
        """Pack an array or a text; its name."""
        if name in self.packed:
            raise ValueError(f"there is an array {name} already")
        if isinstance(values, str):
            self.packed[name] = Packed.text(values)
        else:
            self.packed[name] = Packed.of(values, xor=xor)
        return name


def largest_value(
    name: str, count: int, read: Callable[[int], npt.NDArray[Any]]
) -> tuple[float, npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """The largest length of a field at any vertex of any state, and the ends of its components.

    Args:
        name: of the field, for messages.
        count: number of states.
        read: the values (n, d) at a state.

    Raises:
        ValueError: if a value is not finite, or states have other shapes.
    """
    shape = read(0).shape
    largest = 0.0
    low = np.zeros(shape[1])
    high = np.zeros(shape[1])
    for i in range(count):
        values = np.asarray(read(i), dtype=np.float64)
        if values.shape != shape:
            raise ValueError(f"{name} of state {i} is that of another mesh")
        if not np.isfinite(values).all():
            raise ValueError(f"{name} of state {i} has an entry that is not finite")
        largest = max(largest, float(np.linalg.norm(values, axis=1).max(initial=0.0)))
        low = np.minimum(low, values.min(axis=0, initial=0.0))
        high = np.maximum(high, values.max(axis=0, initial=0.0))
    return largest, low, high


def packed_field(
    arrays: Arrays,
    name: str,
    count: int,
    read: Callable[[int], npt.NDArray[Any]],
    allowed: float,
) -> dict[str, Any]:
    """Put a field of many states into a page.

    Args:
        arrays: of the page.
        name: of the field.
        count: number of states, at least 1.
        read: the values (n, d) at a state.
        allowed: largest length of an error at a vertex.

    Returns:
        ``blocks`` with the number of their first state, and the largest ``error``: at most what is
        allowed, if that is no less than 1e-4 of the largest value.
    """
    blocks = []
    worst = 0.0
    for first in range(0, count, _BLOCK):
        here = range(first, min(first + _BLOCK, count))
        whole = np.array([read(i) for i in here], dtype=float)
        modes, steps, parts, error = _reduced(whole, allowed)
        worst = max(worst, error)
        key = f"{name}.{first}"
        blocks.append(
            {
                "first": first,
                "modes": arrays.add(f"{key}.modes", modes),
                "steps": arrays.add(f"{key}.steps", steps),
                "parts": arrays.add(f"{key}.parts", parts),
            }
        )
    vertices, components = whole.shape[1:]
    shape = {"count": count, "vertices": vertices, "components": components}
    return {"blocks": blocks, "error": worst} | shape


def decoded(
    modes: npt.NDArray[np.int16], steps: npt.NDArray[np.float32], parts: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """The states (m, n d) of a block, as a page decodes them."""
    return (parts * steps) @ modes.astype(np.float32)


def _reduced(whole: npt.NDArray[np.float64], allowed: float) -> tuple[Any, Any, Any, float]:
    """Modes (r, n d), their steps (r,), parts (m, r), and the largest error of a block."""
    count, _, components = whole.shape
    flat = whole.reshape(count, -1)
    values, vectors = np.linalg.eigh(flat @ flat.T)
    order = np.argsort(values)[::-1]
    left = vectors[:, order]  # of states
    rows = left.T @ flat  # modes times their singular values
    sizes = np.abs(rows).max(axis=1, initial=0.0)
    kept = int((sizes > 0).sum())

    def tried(rank: int, margin: float) -> tuple[Any, Any, Any, float]:
        # What is left of the error is shared by the modes.
        share = margin * allowed / max(np.sqrt(rank), 1.0)
        most = np.abs(left[:, :rank]).max(axis=0, initial=0.0)
        steps = np.maximum(sizes[:rank] / _INT16, share / np.maximum(most, 1e-300))
        steps = np.where(sizes[:rank] > 0, steps, 1.0).astype(np.float32)
        modes = np.rint(rows[:rank] / steps[:, None].astype(float)).astype(np.int16)
        parts = left[:, :rank].astype(np.float32)
        off = (flat - decoded(modes, steps, parts)).reshape(count, -1, components)
        return modes, steps, parts, float(np.linalg.norm(off, axis=2).max(initial=0.0))

    for margin in (0.5, 0.05, 0.0):
        rank = next((r for r in _ranks(kept) if tried(r, margin)[3] <= allowed), None)
        if rank is not None:
            # The least of those between this one and the one that was not enough.
            low = max(r for r in (-1, *_ranks(kept)) if r < rank)
            while rank - low > 1:
                middle = (low + rank) // 2
                low, rank = (low, middle) if tried(middle, margin)[3] <= allowed else (middle, rank)
            return tried(rank, margin)
    # States that have little in common: their errors add up in modes, and do not in themselves.
    rows = flat
    left = np.eye(count)
    sizes = np.abs(rows).max(axis=1, initial=0.0)
    return tried(count, 0.0)


def _ranks(most: int) -> Iterator[int]:
    """Numbers of modes to try: 0, 1, 2, 4, ... and all."""
    yield 0
    rank = 1
    while rank < most:
        yield rank
        rank *= 2
    if most:
        yield most
