# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compression of arrays for a page: lossless, or by few modes with a bounded error.

State i of a field is approximated by u_i = sum_k c_ik v_k with coefficients c_ik. The modes v_k are
the first singular vectors of a block of states, stored as 16-bit integers times a step size. The
reported error is the difference between decoded and original values at every vertex of every state.
Bytes of equal significance are stored next to each other, which improves compression by deflate.
"""

from __future__ import annotations

import base64
import zlib
from bisect import bisect_left
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._arrays import Array

__all__ = ["Arrays"]

_BLOCK = 128  # number of states that share their modes
_INT16 = 32767


def deflated(data: bytes) -> str:
    """Compress data with deflate and return them as a base64 string."""
    return base64.b64encode(zlib.compress(data, 9)).decode()


class Arrays:
    """Compressed arrays of a page.

    Attributes:
        data: deflated content in base64, by name.
        formats: data required for decoding, by name: ``dtype``, ``shape``, and whether each row is
            stored as its bitwise difference (``xor``) from the preceding row.
    """

    def __init__(self) -> None:
        self.data: dict[str, str] = {}
        self.formats: dict[str, dict[str, Any]] = {}

    def add_text(self, name: str, text: str) -> str:
        """Store a compressed text under a name, and return the name."""
        self.data[name] = deflated(text.encode())
        self.formats[name] = {"dtype": "text", "shape": [], "xor": False}
        return name

    def add(self, name: str, values: npt.NDArray[Any], *, xor: bool = False) -> str:
        """Store an array with lossless compression under a name, and return the name.

        Args:
            name: unique name of the array.
            values: array of 1, 2, 4 or 8 bytes per entry.
            xor: store each row as its bitwise difference from the preceding row; smaller if
                successive rows are similar.
        """
        little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        size = little.dtype.itemsize
        if little.size:
            raw = little.reshape(len(little), -1).view(np.uint8)
            if xor:
                raw = np.concatenate([raw[:1], raw[1:] ^ raw[:-1]])
        else:
            raw = np.zeros((0, size), np.uint8)
        self.data[name] = deflated(raw.reshape(-1, size).T.tobytes())
        dtype = little.dtype.str[1:]
        self.formats[name] = {"dtype": dtype, "shape": list(values.shape), "xor": xor}
        return name

    def add_field(self, name: str, values: npt.NDArray[Any], allowed: float) -> dict[str, Any]:
        """Store a field with a bounded error.

        Args:
            name: unique name of the field.
            values: values at the vertices in all states, shape (states, vertices, components).
            allowed: largest admissible Euclidean norm of the error at a vertex; at least 1e-4 of
                the largest value.

        Returns:
            Description for the page: ``blocks`` of states, each with the index of its first state;
            the measured ``error``; and the numbers of ``vertices`` and ``components``.
        """
        blocks = []
        error = 0.0
        for first in range(0, len(values), _BLOCK):
            *parts, block_error = _reduced(values[first : first + _BLOCK].astype(float), allowed)
            error = max(error, block_error)
            names = ("modes", "steps", "parts")
            stored = zip(names, parts, strict=True)
            blocks.append(
                {"first": first} | {k: self.add(f"{name}.{first}.{k}", v) for k, v in stored}
            )
        _, vertices, components = values.shape
        return {
            "blocks": blocks,
            "error": error,
            "vertices": vertices,
            "components": components,
        }


def _reduced(values: Array, allowed: float) -> tuple[Any, Any, Any, float]:
    """Approximate m states of a field, d components at n vertices, by r modes.

    The values have shape (m, n, d); the error at a vertex has at most the norm ``allowed``.

    Returns:
        Modes as integers, shape (r, n d); their factors, shape (r,); coefficients, shape (m, r);
        and largest error at a vertex.
    """
    count = len(values)
    flat = values.reshape(count, -1)
    _, vectors = np.linalg.eigh(flat @ flat.T)
    left = vectors[:, ::-1]

    def encode(left: Array, rank: int, margin: float) -> tuple[Any, Any, Any, float]:
        rows = left[:, :rank].T @ flat
        sizes = np.abs(rows).max(axis=1, initial=0.0)
        # The rounding of all modes together takes a share ``margin`` of the allowed error.
        share = margin * allowed / np.sqrt(max(rank, 1))
        most = np.abs(left[:, :rank]).max(axis=0, initial=0.0)
        steps = np.maximum(sizes / _INT16, share / np.maximum(most, 1e-300))
        steps = np.where(sizes > 0, steps, 1.0).astype(np.float32)
        modes = np.rint(rows / steps[:, None].astype(float)).astype(np.int16)
        parts = left[:, :rank].astype(np.float32)
        decoded = (parts * steps) @ modes.astype(np.float32)
        off = (flat - decoded).reshape(values.shape)
        return modes, steps, parts, float(np.linalg.norm(off, axis=2).max(initial=0.0))

    ranks = range(count + 1)
    rank = bisect_left(ranks, True, key=lambda r: encode(left, r, 0.5)[-1] <= allowed)
    if rank <= count:
        return encode(left, rank, 0.5)
    # States with little in common: rounding errors add up over modes, so each state is a mode.
    return encode(np.eye(count), count, 0.0)
