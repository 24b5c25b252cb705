# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Point problems in files: numpy's npz, and the HDF5 of FCLib, the collection of such problems.

An npz file has the arrays of a `PointProblem` by the names of its arguments, those alone that it
has, and ``format``. Units are those of the problem; a point's tangents come before its normal.

FCLib (Acary, Bremond, Koziara and Perignon, FCLIB: a collection of discrete 3D frictional contact
problems, INRIA RT-0444, 2014) has the local problem

    u = W r + q,    0 <= u_N  against  r_N >= 0,    |r_T| <= mu r_N,    r_T = -mu r_N u_T/|u_T|

in the frame of each contact, the normal first: u are velocities there, or displacements and gaps as
here, r forces on the body. So W is the compliance S^-1, and q has the displacements without
contact, S^-1 p. Its file has

    /fclib_local/spacedim              2 or 3
    /fclib_local/W/{m, n, nzmax, nz}   rows, columns, entries, -2 for compressed rows
    /fclib_local/W/{p, i, x}           starts of rows, columns, entries
    /fclib_local/vectors/{q, mu}       (dim m,), (m,)
    /fclib_local/info/{title, description, math_info}
"""

from __future__ import annotations

import os
import zipfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact._files import part_of
from dolfinx_contact._optional import optional
from dolfinx_contact.algorithms.point_problem import PointProblem

__all__ = ["fclib_local", "load_points", "save_points"]

FORMAT = "dolfinx_contact points 1"
_NUMBERS = ("force", "length")
_COMPRESSED_ROWS = -2
_HDF5 = (".hdf5", ".h5")

Arrays = dict[str, npt.NDArray[Any]]


def save_points(file: str | os.PathLike[str], problem: PointProblem) -> None:
    """Write a problem, in place of a file that is there already.

    Args:
        file: ``.npz``, or ``.hdf5`` or ``.h5`` for FCLib.
        problem: to be written.

    Raises:
        ValueError: for another suffix, or where FCLib has no such problem.
        ModuleNotFoundError: for HDF5 without h5py.
    """
    path = Path(file)
    if path.suffix == ".npz":
        arrays = _arrays(problem)
        with part_of(path) as part:
            np.savez(part, **arrays)
    elif path.suffix in _HDF5:
        local = fclib_local(problem)
        h5py = optional("h5py", "records")
        with part_of(path) as part, h5py.File(part, "w") as data:
            for name, values in local.items():
                data.create_dataset(name, data=values)
    else:
        raise ValueError(f"points are saved as .npz, .hdf5 or .h5 (FCLib), not as {path.name!r}")


def load_points(file: str | os.PathLike[str]) -> PointProblem:
    """The problem in an npz file of `save_points`.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no such file, or the numbers in it are no such problem.
    """
    path = Path(file)
    if path.is_file() and not zipfile.is_zipfile(path):
        raise ValueError(f"{path} is no npz file")
    try:
        with np.load(path, allow_pickle=False) as data:
            found: Arrays = dict(data)
    except FileNotFoundError:
        raise
    except Exception as error:
        raise ValueError(f"{path} is no npz file: {error}") from None
    found_format = str(found.pop("format", "nothing"))
    if found_format != FORMAT:
        raise ValueError(f"{path} has no points: its format is {found_format!r}, not {FORMAT!r}")
    known = {f.name for f in fields(PointProblem)}
    unknown = sorted(set(found) - known)
    if unknown or not {"S", "p", "friction"} <= set(found):
        raise ValueError(f"{path} has other arrays than a point problem: {sorted(found)}")
    given: dict[str, Any] = {
        name: values.item() if name in _NUMBERS and values.size == 1 else values
        for name, values in found.items()
    }
    try:
        return PointProblem(**given)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _arrays(problem: PointProblem) -> dict[str, Any]:
    named = {f.name: getattr(problem, f.name) for f in fields(problem)}
    return {"format": FORMAT} | {name: v for name, v in named.items() if v is not None}


def fclib_local(problem: PointProblem) -> Arrays:
    """The datasets of FCLib's local problem, by their paths in the file.

    Raises:
        ValueError: for friction bounds given in advance, which FCLib does not have.
    """
    if problem.bound.any():
        raise ValueError("FCLib knows Coulomb's friction alone, not bounds given in advance")
    d = problem.dim
    size = len(problem.p)
    order = np.roll(np.arange(size).reshape(-1, d), 1, axis=1).reshape(-1)
    W = problem.A[np.ix_(order, order)]
    q = problem.free.reshape(-1)[order]
    numbers = {"m": size, "n": size, "nzmax": size * size, "nz": _COMPRESSED_ROWS}
    local: Arrays = {f"W/{name}": _integers([number]) for name, number in numbers.items()}
    local["spacedim"] = _integers([d])
    local["W/p"] = _integers(np.arange(0, size * size + 1, size))
    local["W/i"] = _integers(np.tile(np.arange(size), size))
    local["W/x"] = W.reshape(-1)
    local["vectors/q"] = q
    local["vectors/mu"] = problem.friction
    local["info/title"] = _text("a body condensed onto its contact points")
    local["info/description"] = _text("displacements, gaps and forces: quasi-static contact")
    local["info/math_info"] = _text("W is symmetric and positive definite, and full")
    return {f"/fclib_local/{name}": values for name, values in local.items()}


def _integers(values: Any) -> npt.NDArray[np.int32]:
    return np.asarray(values, dtype=np.int32)


def _text(words: str) -> npt.NDArray[Any]:
    """A string that ends with a zero, as C reads it."""
    return np.array(words.encode(), dtype=f"S{len(words) + 1}")
