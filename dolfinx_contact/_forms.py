# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled UFL, found again in a time that does not grow with what else was compiled before.

A look-up in FFCx's cache lists its folder, which on a machine in use holds thousands of files.
Here the cache has a folder for every first two letters of a signature.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, jit

__all__ = ["compiled_expression", "compiled_form"]


def compiled_form(form: ufl.Form, entity_maps: Any = None) -> fem.Form:
    """A form, compiled. Collective.

    Args:
        form: UFL.
        entity_maps: of submeshes that occur in it.
    """
    maps = {} if entity_maps is None else {"entity_maps": entity_maps}
    return fem.form(form, jit_options=_folder(form.signature()[:2]), **maps)


def compiled_expression(
    e: Any, points: npt.NDArray[np.float64], comm: MPI.Comm | None = None
) -> fem.Expression:
    """An expression at points of the reference cell, compiled once for all ranks. Collective.

    Args:
        e: UFL.
        points: of the reference cell.
        comm: of the ranks, by default those of the mesh.
    """
    return fem.Expression(e, points, comm=comm, jit_options=_folder("expressions"))


def _folder(name: str) -> dict[str, Any]:
    cache: Path = jit.get_options()["cache_dir"]
    return {"cache_dir": cache / "dolfinx_contact" / name}
