# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Read and write reduced problems: npz, the HDF5 format of FCLib, text formats of Siconos.

An npz file holds the arrays of a `PointProblem` under the names of its arguments, and ``format``.

FCLib (Acary, Bremond, Koziara and Perignon, FCLIB: a collection of discrete 3D frictional contact
problems, INRIA RT-0444, 2014) and Siconos store the local problem u = W r + q of `LocalProblem`, in
the frame of each contact with the normal first. FCLib's datasets are

    /fclib_local/spacedim              2 or 3
    /fclib_local/W/{m, n, nzmax, nz}   rows, columns, entries, and the storage:
                                       -2 compressed rows, -1 compressed columns, else triplets
    /fclib_local/W/{p, i, x}           starts, columns, entries (triplets: columns, rows, entries)
    /fclib_local/vectors/{q, mu}       (dim m,), (m,)
    /fclib_local/info/{title, description, math_info}

A global problem M v = H r + f, u = H^T v + w (``/fclib_global``) is condensed: W = H^T M^-1 H and
q = H^T M^-1 f + w. Equality constraints (G, V, R) are refused.

A text file of Siconos holds dim, m, the storage of W (0 dense by columns, 1 sparse blocks, 2 sparse
by columns as CSparse prints it), the size of W twice, W, q and mu.
"""

from __future__ import annotations

import os
import re
import zipfile
from collections.abc import Callable
from dataclasses import fields
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array, csc_array, csr_array
from scipy.sparse.linalg import splu

from dolfinx_contact._arrays import Array
from dolfinx_contact._files import part_of
from dolfinx_contact._install import optional
from dolfinx_contact.algorithms.local_problem import LocalProblem
from dolfinx_contact.reduced.point_problem import PointProblem

__all__ = ["fclib_local", "load_local", "load_points", "save_points"]

FORMAT = "dolfinx_contact points 1"
_COMPRESSED_ROWS, _COMPRESSED_COLUMNS = -2, -1
_HDF5 = (".hdf5", ".h5")
_DENSE, _BLOCKS, _SPARSE = 0, 1, 2

Arrays = dict[str, npt.NDArray[Any]]
T = TypeVar("T")
Local = tuple[int, Array, Array, Array]  # dim, W, q, mu with the normal first


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
    elif path.suffix in _HDF5:
        local = fclib_local(problem)
        h5py = optional("h5py", "records")
        with part_of(path) as part, h5py.File(part, "w") as data:
            for name, values in local.items():
                data.create_dataset(name, data=values)
    else:
        raise ValueError(f"points are saved as .npz, .hdf5 or .h5 (FCLib), not as {path.name!r}")


def load_points(file: str | os.PathLike[str]) -> PointProblem:
    """Read a problem with a regular compliance from npz, FCLib or Siconos.

    Args:
        file: file name with the suffix ``.npz`` (`save_points`), ``.hdf5`` or ``.h5`` (FCLib), or
            ``.dat`` (Siconos).

    Raises:
        FileNotFoundError: if the file does not exist.
        ValueError: if the content does not fit the format, or the compliance is singular; then use
            `load_local`.
        ModuleNotFoundError: for HDF5 without h5py.
    """
    path = Path(file)
    if path.suffix in (*_HDF5, ".dat"):
        return _read(path, lambda: _local(path).points())
    return _read(path, lambda: _of_npz(path))


def load_local(file: str | os.PathLike[str]) -> LocalProblem:
    """Read the local problem u = W r + q from a file of FCLib or Siconos; W may be singular.

    Args:
        file: file name with the suffix ``.hdf5`` or ``.h5`` (FCLib), or another one (Siconos).

    Raises:
        FileNotFoundError: if the file does not exist.
        ValueError: if the content does not fit the format.
        ModuleNotFoundError: for HDF5 without h5py.
    """
    path = Path(file)
    return _read(path, lambda: _local(path))


def _read(path: Path, build: Callable[[], T]) -> T:
    """Call ``build`` and add the file name to its errors."""
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        return build()
    except ModuleNotFoundError:
        raise
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


def _local(path: Path) -> LocalProblem:
    dim, W, q, mu = _of_fclib(path) if path.suffix in _HDF5 else _of_siconos(path.read_text())
    if W.shape != (dim * len(mu), dim * len(mu)) or dim not in (2, 3):
        raise ValueError(f"W has the shape {W.shape}, with {len(mu)} contacts in {dim}D")
    # Tangents before the normal.
    order = np.roll(np.arange(len(q)).reshape(-1, dim), -1, axis=1).reshape(-1)
    return LocalProblem(W[np.ix_(order, order)], q[order], mu)


def _of_fclib(path: Path) -> Local:
    h5py = optional("h5py", "records")
    with h5py.File(path) as data:
        if "fclib_local" in data:
            group = data["fclib_local"]
            W = _matrix(group["W"]).toarray()
            q = np.asarray(group["vectors/q"], dtype=np.float64)
        elif "fclib_global" in data:
            group = data["fclib_global"]
            H = _matrix(group["H"]).tocsc()
            solve = splu(_matrix(group["M"]).tocsc()).solve
            W = np.asarray(H.T @ solve(H.toarray()))
            q = H.T @ solve(np.asarray(group["vectors/f"])) + np.asarray(group["vectors/w"])
        else:
            raise ValueError("the file has neither /fclib_local nor /fclib_global")
        constraints = [name for name in ("G", "V", "R") if name in group]
        if constraints:
            raise ValueError(f"equality constraints are not supported; the file has {constraints}")
        return int(group["spacedim"][0]), W, q, np.asarray(group["vectors/mu"])


def _matrix(group: Any) -> Any:
    """Return the sparse matrix that an FCLib group stores."""
    rows, columns, kind = (int(group[name][0]) for name in ("m", "n", "nz"))
    p, i, x = (np.asarray(group[name]) for name in ("p", "i", "x"))
    shape = (rows, columns)
    if kind == _COMPRESSED_ROWS:
        return csr_array((x, i, p), shape=shape)
    if kind == _COMPRESSED_COLUMNS:
        return csc_array((x, i, p), shape=shape)
    return coo_array((x[:kind], (i[:kind], p[:kind])), shape=shape)


class _Numbers:
    """Reader of successive numbers in a text."""

    def __init__(self, text: str):
        self._words = iter(text.split())

    def integers(self, count: int) -> list[int]:
        """Return the next ``count`` integers."""
        return [int(word) for word in self._next(count)]

    def reals(self, count: int) -> Array:
        """Return the next ``count`` real numbers."""
        return np.array(self._next(count), dtype=np.float64)

    def rest(self) -> list[float]:
        """Return all remaining numbers."""
        return [float(word) for word in self._words]

    def _next(self, count: int) -> list[str]:
        words = list(islice(self._words, count))
        if len(words) < count:
            raise ValueError("the file is truncated")
        return words


def _of_siconos(text: str) -> Local:
    numbers = _Numbers(text)
    dim, contacts, storage, rows, columns = numbers.integers(5)
    W: Array
    if storage == _DENSE:
        if numbers.integers(2) != [rows, columns]:
            raise ValueError("the two sizes of W differ")
        W = numbers.reals(rows * columns).reshape(columns, rows).T
    elif storage == _BLOCKS:
        W = _of_blocks(numbers, rows, columns)
    elif storage == _SPARSE:
        W, after = _of_csparse(text, rows, columns)
        numbers = _Numbers(after)
    else:
        raise ValueError(f"W has the unknown storage {storage}; known are 0, 1 and 2")
    q, mu = numbers.reals(rows), numbers.reals(contacts)
    if len(numbers.rest()) > 1:  # some files end with one more number
        raise ValueError("there is text after the friction coefficients, as in a global problem")
    return dim, W, q, mu


def _of_blocks(numbers: _Numbers, rows: int, columns: int) -> Array:
    """Read a matrix in sparse blocks; each block is its number and its entries by columns."""
    _, down, across = numbers.integers(3)
    row_ends, column_ends = ([0, *numbers.integers(count)] for count in (down, across))
    starts, block_columns = (numbers.integers(count) for count in numbers.integers(2))
    W = np.zeros((rows, columns))
    for row, (first, last) in enumerate(pairwise(starts)):
        for column in block_columns[first:last]:
            numbers.integers(1)
            top, bottom = row_ends[row : row + 2]
            left, right = column_ends[column : column + 2]
            block = numbers.reals((bottom - top) * (right - left))
            W[top:bottom, left:right] = block.reshape(right - left, bottom - top).T
    return W


def _of_csparse(text: str, rows: int, columns: int) -> tuple[Array, str]:
    """Return a matrix read from text printed by CSparse, and the remaining text.

    Lines are ``col <column> : ...``, ``<row> : <entry>`` or ``<row> <column> : <entry>``.
    """
    head = re.search(r"nnz:\s*(\d+).*\n", text)
    if head is None:
        raise ValueError("the sparse matrix has no line with 'nnz:'")
    W = np.zeros((rows, columns))
    line = re.compile(r"\s*(?:(col)\s+(\d+)|(\d+)(?:\s+(\d+))?)\s*:\s*(.*)\n")
    place = head.end()
    column = -1
    entries = 0
    while (match := line.match(text, place)) and (match[1] or entries < int(head[1])):
        if match[1]:
            column = int(match[2])
        else:
            at = (int(match[3]), column if match[4] is None else int(match[4]))
            if at[1] < 0:
                raise ValueError("the sparse matrix has entries before its first column")
            W[at] += float(match[5])
            entries += 1
        place = match.end()
    if entries < int(head[1]):
        raise ValueError("the file is truncated")
    return W, text[place:]


def fclib_local(problem: PointProblem) -> Arrays:
    """Return the datasets of FCLib's local problem by their paths in the file.

    Raises:
        ValueError: if the problem has prescribed friction bounds, which FCLib does not support.
    """
    if problem.bound.any():
        raise ValueError("FCLib knows Coulomb's friction alone, not bounds given in advance")
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
