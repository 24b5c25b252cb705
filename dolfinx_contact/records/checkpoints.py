# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields of a branch point or a step on the disk, to be read on any number of ranks.

The unknowns of a point and its tangent are written cell by cell of the mesh as it was given to
DOLFINx (`checkpoint_files.py`). That is not done for Functions of submeshes: those of a contact
surface are put into a Function of the body's mesh at the same nodes, and taken from there when they
are read. A checkpoint is a folder of its own, written under another name and renamed when it is
complete.
"""

from __future__ import annotations

import json
import os
import shutil
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la

from dolfinx_contact._errors import on_root
from dolfinx_contact._files import os_error, sync
from dolfinx_contact.io.disk import reserve
from dolfinx_contact.io.writers import disk_errors
from dolfinx_contact.points.trace import trace_dofs
from dolfinx_contact.records.checkpoint_files import (
    checkpoint_format,
    read_checkpoint,
    write_checkpoint,
)

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["Checkpoints", "DamagedCheckpoint"]

_RIGID = "rigid_bodies.json"  # displacements and rotations of all, by vector
_ARRAYS = "arrays.npz"


class DamagedCheckpoint(ValueError):
    """The files of a checkpoint are missing, or not those that were written."""


class Checkpoints:
    """Checkpoints of one problem in one folder.

    Args:
        folder: made when something is written.
        problem: whose unknowns are kept. Its Functions follow what is written and read.

    Attributes:
        format: in which checkpoints are written here; any is read.
    """

    def __init__(self, folder: Path, problem: ContactProblem):
        self.folder = folder
        self.problem = problem
        self.comm = problem.comm
        self.format = checkpoint_format(self.comm)
        self._whole: list[fem.Function | None] = [None]
        self._nodes: list[npt.NDArray[np.int32]] = [np.zeros(0, dtype=np.int32)]
        for s in problem.surfaces:
            W = fem.functionspace(s.domain, ("Lagrange", s.degrees[1], (s.dim,)))
            nodes = trace_dofs(W, s.points.Q, s.submesh.parent_facets)
            self._whole.append(fem.Function(W))
            self._nodes.append(nodes)

    def write(
        self,
        name: str,
        vectors: dict[str, PETSc.Vec],
        arrays: Mapping[str, npt.NDArray[Any]] | None = None,
        functions: Mapping[str, fem.Function] | None = None,
    ) -> str:
        """Keep ``vectors`` of unknowns under ``name``; a check sum of the files. Collective.

        The last of them stays in the problem's Functions, ``arrays`` are those of rank 0, and
        ``functions`` others on the mesh of the body. Returns when all is on the disk.

        Raises:
            OSError: on every rank, with the path, if they cannot be written; nothing is left then.
        """
        on_root(self.comm, lambda: self.folder.mkdir(exist_ok=True))
        part = self.folder / f".{name}.part"
        final = self.folder / name
        on_root(self.comm, lambda: shutil.rmtree(part) if part.exists() else None)
        try:
            return self._write(part, final, vectors, arrays or {}, functions or {})
        except BaseException:
            if self.comm.rank == 0:
                shutil.rmtree(part, ignore_errors=True)
            raise

    def remove(self, name: str) -> None:
        """Forget what was kept under ``name``, on rank 0."""
        if self.comm.rank == 0:
            shutil.rmtree(self.folder / name, ignore_errors=True)

    def _write(
        self,
        part: Path,
        final: Path,
        vectors: dict[str, PETSc.Vec],
        arrays: Mapping[str, npt.NDArray[Any]],
        others: Mapping[str, fem.Function],
    ) -> str:
        kept = [self._whole[i] or f for i, f in enumerate(self.problem.fields)]
        motions: dict[str, list[list[float]]] = {}
        size = len(vectors) * sum(_size(f) for f in kept) + sum(_size(f) for f in others.values())
        reserve(self.comm, final, size)
        for prefix, x in vectors.items():
            self.problem.read(x)
            motions[prefix] = [[float(v) for v in b.values] for b in self.problem.rigid_bodies]
            functions = {}
            for i, f in enumerate(self.problem.fields):
                functions[f"{prefix}_{i}"] = self._on_the_body(i, f)
            with disk_errors(self.comm, final):
                write_checkpoint(part, functions, self.format)
        with disk_errors(self.comm, final):
            write_checkpoint(part, others, self.format)

        def finish() -> str:
            if arrays:
                try:
                    np.savez(part / _ARRAYS, **arrays)  # type: ignore[arg-type]
                except OSError as error:
                    raise os_error(error, final) from None
            if self.problem.rigid_bodies:
                (part / _RIGID).write_text(json.dumps(motions))
            total = _check_sum(part, on_disk=True)
            if final.exists():  # no line of the journal names it: that run was killed in between
                shutil.rmtree(final)
            part.rename(final)
            sync(self.folder)
            return total

        self.comm.barrier()
        return on_root(self.comm, finish)

    def read(self, name: str, check_sum: str, vectors: dict[str, PETSc.Vec]) -> None:
        """Fill ``vectors`` with what was kept under ``name``. Collective.

        Raises:
            DamagedCheckpoint: on every rank, if the files are not those that were written.
        """
        path = self._checked(name, check_sum)
        bodies = self.problem.rigid_bodies
        motions: dict[str, list[list[float]]] = {}
        if bodies:
            motions = on_root(self.comm, lambda: json.loads((path / _RIGID).read_text()))
        for prefix, x in vectors.items():
            for i, f in enumerate(self.problem.fields):
                whole = self._whole[i]
                target = f if whole is None else whole
                read_checkpoint(path, {f"{prefix}_{i}": target})
                if whole is not None:
                    bs = f.function_space.dofmap.index_map_bs
                    f.x.array[:] = whole.x.array.reshape(-1, bs)[self._nodes[i]].reshape(-1)
                    f.x.scatter_forward()
            for body, values in zip(bodies, motions.get(prefix, []), strict=True):
                body.values = np.array(values)
            self.problem.write(x)

    def read_functions(self, name: str, check_sum: str, functions: dict[str, fem.Function]) -> None:
        """Fill Functions on the mesh of the body that were kept under ``name``. Collective.

        Raises:
            DamagedCheckpoint: on every rank, if the files are not those that were written.
        """
        read_checkpoint(self._checked(name, check_sum), functions)

    def _checked(self, name: str, check_sum: str) -> Path:
        """The folder of a checkpoint, or `DamagedCheckpoint` on every rank. Collective."""
        path = self.folder / name

        def check() -> None:
            if not path.is_dir() or _check_sum(path) != check_sum:
                raise DamagedCheckpoint(f"the checkpoint {path} is damaged or missing")

        on_root(self.comm, check)
        return path

    def arrays(self, name: str) -> dict[str, npt.NDArray[Any]]:
        """The arrays kept under ``name``, which has been read, on every rank. Collective."""

        def load() -> dict[str, npt.NDArray[Any]]:
            with np.load(self.folder / name / _ARRAYS) as found:
                return dict(found)

        return on_root(self.comm, load)

    def _on_the_body(self, i: int, f: fem.Function) -> fem.Function:
        """Field ``i`` as a Function on the mesh of the body; 0 away from its surface."""
        whole = self._whole[i]
        if whole is None:
            return f
        W = whole.function_space
        bs = W.dofmap.index_map_bs
        # A rank may own a node of the body without seeing the facet beside it.
        values = la.vector(W.dofmap.index_map, bs)
        counts = la.vector(W.dofmap.index_map, 1)
        for v in (values, counts):
            v.array[:] = 0.0
        values.array.reshape(-1, bs)[self._nodes[i]] = f.x.array.reshape(-1, bs)
        counts.array[self._nodes[i]] = 1.0
        for v in (values, counts):
            v.scatter_reverse(la.InsertMode.add)
        n = W.dofmap.index_map.size_local
        # Every rank that sees a node has added the same value.
        mean = values.array.reshape(-1, bs)[:n] / np.maximum(counts.array[:n], 1.0)[:, None]
        whole.x.array[: n * bs] = mean.reshape(-1)
        whole.x.scatter_forward()
        return whole


def _size(f: fem.Function) -> int:
    """Bytes that this rank writes of a Function, at most."""
    V = f.function_space
    cells = len(V.dofmap.list)
    bs = V.dofmap.index_map_bs
    # Numbers of the unknowns of every cell, its orientation and offset; values; what ADIOS2 adds.
    return cells * (8 * V.dofmap.list.shape[1] * bs + 12) + 8 * len(f.x.array) + (1 << 15)


def _check_sum(folder: Path, *, on_disk: bool = False) -> str:
    """CRC-32 of the names and contents of the files in a folder; ``on_disk`` puts them there."""
    total = 0
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        total = zlib.crc32(path.relative_to(folder).as_posix().encode(), total)
        with open(path, "rb") as file:
            while block := file.read(1 << 22):
                total = zlib.crc32(block, total)
            if on_disk:
                os.fsync(file.fileno())
    if on_disk:
        sync(folder)
    return f"{total:08x}"
