# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Write and read reduced problems: npz, and FCLib's HDF5 format for other programs.

An npz file holds the arrays of a `PointProblem` under the names of its arguments, and ``format``.

FCLib (Acary, Bremond, Koziara and Perignon, FCLIB: a collection of discrete 3D frictional contact
problems, INRIA RT-0444, 2014) states the problem as u = W r + q with displacements u, compliance W,
forces r, and displacements q without forces, in the frame of each contact, normal first. With k
contacts of dim components, the datasets are

    /fclib_local/spacedim              2 or 3
    /fclib_local/W/{m, n, nzmax, nz}   rows, columns, entries, and -2 for compressed rows
    /fclib_local/W/{p, i, x}           starts, columns, entries
    /fclib_local/vectors/{q, mu}       shapes (dim k,), (k,); mu: friction coefficients
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
from dolfinx_contact._install import optional
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["fclib_local", "load_points", "save_points"]

FORMAT = "dolfinx_contact points 1"
_COMPRESSED_ROWS = -2

Arrays = dict[str, npt.NDArray[Any]]


def save_points(file: str | os.PathLike[str], problem: PointProblem) -> None:
    """Write a problem to a file, replacing an existing one.

    Args:
        file: file name with the suffix ``.npz``, or ``.hdf5`` or ``.h5`` for FCLib.
        problem: problem to be written.

    Raises:
        ValueError: for another suffix, or for FCLib if the problem has prescribed friction bounds.
        ModuleNotFoundError: for HDF5 without h5py.
    """
    path = Path(file)
    if path.suffix == ".npz":
        arrays = {f.name: getattr(problem, f.name) for f in fields(problem)}
        arrays = {name: values for name, values in arrays.items() if values is not None}
        with part_of(path) as part:
            np.savez(part, format=FORMAT, **arrays)
    elif path.suffix in (".hdf5", ".h5"):
        local = fclib_local(problem)
        h5py = optional("h5py", "records")
        with part_of(path) as part, h5py.File(part, "w") as data:
            for name, values in local.items():
                data.create_dataset(name, data=values)
    else:
        raise ValueError(f"points are saved as .npz, .hdf5 or .h5 (FCLib), not as {path.name!r}")


def load_points(file: str | os.PathLike[str]) -> PointProblem:
    """Read a problem from a file of `save_points` with the suffix ``.npz``.

    Args:
        file: file name.

    Raises:
        FileNotFoundError: if the file does not exist.
        ValueError: if the file does not contain a valid problem in this format.
    """
    path = Path(file)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        return _of_npz(path)
    except Exception as error:  # a file of another kind may cause any error
        raise ValueError(f"{path}: {error}") from error


def _of_npz(path: Path) -> PointProblem:
    if not zipfile.is_zipfile(path):
        raise ValueError("it is not an npz file")
    with np.load(path, allow_pickle=False) as data:
        content: Arrays = dict(data)
    stored = str(content.pop("format", "nothing"))
    if stored != FORMAT:
        raise ValueError(f"it has no points: its format is {stored!r}, not {FORMAT!r}")
    arguments: dict[str, Any] = {
        name: values.item() if values.ndim == 0 else values for name, values in content.items()
    }
    return PointProblem(**arguments)


def fclib_local(problem: PointProblem) -> Arrays:
    """Return the datasets of FCLib's local problem by their paths in the file.

    Raises:
        ValueError: if the problem has prescribed friction bounds, which FCLib does not support.
    """
    if problem.bound.any():
        raise ValueError("FCLib supports Coulomb friction only, without prescribed friction bounds")
    d = problem.dim
    size = len(problem.p)
    order = np.roll(np.arange(size).reshape(-1, d), 1, axis=1).reshape(-1)
    W = problem.A[np.ix_(order, order)]
    q = problem.free.reshape(-1)[order]
    numbers = {"m": size, "n": size, "nzmax": size * size, "nz": _COMPRESSED_ROWS}
    integers = {f"W/{name}": [number] for name, number in numbers.items()} | {
        "spacedim": [d],
        "W/p": np.arange(0, size * size + 1, size),
        "W/i": np.tile(np.arange(size), size),
    }
    texts = {
        "title": "a body condensed onto its contact points",
        "description": "displacements, gaps and forces: quasi-static contact",
        "math_info": "W is symmetric and positive definite, and full",
    }
    local: Arrays = {name: np.asarray(v, dtype=np.int32) for name, v in integers.items()}
    local |= {"W/x": W.reshape(-1), "vectors/q": q, "vectors/mu": problem.friction}
    # Strings end with a null byte.
    local |= {f"info/{k}": np.array(v.encode(), dtype=f"S{len(v) + 1}") for k, v in texts.items()}
    return {f"/fclib_local/{name}": values for name, values in local.items()}
