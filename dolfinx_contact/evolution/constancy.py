# SPDX-License-Identifier: LGPL-3.0-or-later
"""Test that the data of a problem keep their values during a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import largest
from dolfinx_contact.equations.data import Datum

__all__ = ["Constancy"]

_SAME = 1e-9  # relative change that counts as none


class Constancy:
    """Comparison of data with the values that they had when this object was created.

    Args:
        comm: communicator of all ranks on which the data exist.
        data: data to be compared.
    """

    def __init__(self, comm: MPI.Comm, data: Sequence[Datum]):
        self._comm = comm
        self._data = list(data)
        self._values = [d.values.copy() for d in self._data]

    def changed(self) -> str:
        """Return a description of a datum that has changed; "" if none has. Collective.

        Changes up to 1e-9 of the largest value are ignored. For a Constant both values are
        appended.
        """
        if not self._data:
            return ""
        pairs = list(zip(self._data, self._values, strict=True))
        mine = [
            (np.max(_change(d.values, v), initial=0.0), np.max(np.abs(v), initial=0.0))
            for d, v in pairs
        ]
        found: Any = largest(self._comm, mine)
        for (d, v), (here, _), (away, size) in zip(pairs, mine, found, strict=True):
            if away > 0 and not away <= _SAME * size:  # the size is NaN where a datum is
                text = d.place
                if not hasattr(d.value, "x"):
                    text += f" ({v.tolist()} before, {d.values.tolist()} now)"
                # the text comes from a rank on which the datum has changed
                told = self._comm.allgather(text if here > 0 and not here <= _SAME * size else "")
                return next(w for w in told if w)
        return ""


def _change(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the absolute differences of the entries of two arrays.

    They are 0 where both values are NaN, and infinite where only one of them is finite.
    """
    away = np.full(np.shape(a), np.inf)
    np.subtract(a, b, out=away, where=np.isfinite(a) & np.isfinite(b))
    return np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(away))
