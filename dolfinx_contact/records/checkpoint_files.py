# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions in a folder, by the cells of the mesh as it was given to DOLFINx.

So they are read on any number of ranks, from the same mesh, made in the same way. There are two
formats. ``bp`` is that of ADIOS2, written and read by adios4dolfinx, every rank its part. Where
that is not installed, as beside wheels of DOLFINx, it is ``npy``: for each Function a file of
NumPy, written from rank 0, with the coefficients of every cell as the reference element has them.
Either is known by its files when it is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact._errors import everywhere, on_root
from dolfinx_contact._files import os_error
from dolfinx_contact._optional import optional

__all__ = ["checkpoint_format", "read_checkpoint", "write_checkpoint"]


def checkpoint_format(comm: MPI.Comm) -> Literal["bp", "npy"]:
    """The format that is written here: ``bp`` where all ranks have adios4dolfinx. Collective."""
    try:
        import_module("adios4dolfinx")
        found = True
    except ModuleNotFoundError:  # also of adios2, which it needs
        found = False
    return "bp" if comm.allreduce(found, op=MPI.LAND) else "npy"


def write_checkpoint(
    folder: Path, functions: Mapping[str, fem.Function], format: Literal["bp", "npy"]
) -> None:
    """Add Functions to a checkpoint, in one format. Collective.

    Args:
        folder: made with the first of them.
        functions: by names of files, on one mesh. (Functions of submeshes are refused.)
        format: see `checkpoint_format`.

    Raises:
        OSError: on every rank, with the path, if ``npy`` cannot be written.
        RuntimeError: of ADIOS2.
    """
    for name, f in functions.items():
        if format == "bp":
            optional("adios4dolfinx", "bp").write_function_on_input_mesh(folder, f, name=name)
        else:
            _save(folder, name, f)


def read_checkpoint(folder: Path, functions: Mapping[str, fem.Function]) -> None:
    """Fill Functions from what `write_checkpoint` wrote, ghosts included. Collective.

    Raises:
        ModuleNotFoundError: on every rank, if ADIOS2 wrote them and adios4dolfinx is missing here.
    """
    for name, f in functions.items():
        comm = f.function_space.mesh.comm
        if on_root(comm, lambda name=name: (folder / f"{name}.npy").exists()):  # type: ignore[misc]
            with everywhere(comm, f"reading {folder}"):
                _load(folder / f"{name}.npy", f)
            f.x.scatter_forward()
            continue
        if checkpoint_format(comm) != "bp":
            raise ModuleNotFoundError(
                f"the checkpoint {folder} is in the format bp of ADIOS2, and adios4dolfinx, which "
                "reads it, is not installed (python3-adios4dolfinx of Debian, or conda; beside a "
                "wheel of DOLFINx it cannot be)",
                name="adios4dolfinx",
            )
        optional("adios4dolfinx", "bp").read_function(folder, f, name=name)


# -- npy -----------------------------------------------------------------------------------------


def _save(folder: Path, name: str, f: fem.Function) -> None:
    """Write coefficients by input cells, an array (cells, coefficients of a cell), from rank 0."""
    domain = f.function_space.mesh
    cells = domain.topology.index_map(domain.topology.dim)
    here = np.arange(cells.size_local, dtype=np.int32)
    values = f.x.array[_coefficients(f.function_space, here)]
    _transform(f.function_space, values, here, "Tt_apply")
    parts = domain.comm.gather((domain.topology.original_cell_index[here], values))

    def write() -> None:
        assert parts is not None
        whole = np.empty((cells.size_global, values.shape[1]))
        for number, part in parts:
            whole[number] = part
        path = folder / f"{name}.npy"
        try:
            folder.mkdir(exist_ok=True)
            with open(path, "wb") as file:
                # `np.save` does not tell why it fails.
                head = np.lib.format.header_data_from_array_1_0(whole)
                np.lib.format.write_array_header_1_0(file, head)
                file.write(whole.data)
        except OSError as error:
            raise os_error(error, path) from None

    on_root(domain.comm, write)


def _load(file: Path, f: fem.Function) -> None:
    """Take the coefficients of the cells of this rank from a file of `_save`."""
    topology = f.function_space.mesh.topology
    here = np.arange(len(f.function_space.dofmap.list), dtype=np.int32)
    whole = np.load(file, mmap_mode="r")
    values = np.array(whole[topology.original_cell_index[here]])
    _transform(f.function_space, values, here, "Tt_inv_apply")
    f.x.array[_coefficients(f.function_space, here)] = values


def _coefficients(V: fem.FunctionSpace, cells: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
    """Places in a Function's array of the coefficients of cells, one row each."""
    bs = V.dofmap.bs
    nodes = V.dofmap.list[cells].astype(np.int64)
    return (bs * nodes[:, :, None] + np.arange(bs)).reshape(len(cells), -1)


def _transform(
    V: fem.FunctionSpace, values: npt.NDArray[Any], cells: npt.NDArray[np.int32], method: str
) -> None:
    """To the reference element or back, where coefficients depend on how edges are directed."""
    if not V.element.needs_dof_transformations or not len(cells):
        return
    V.mesh.topology.create_entity_permutations()
    directions = V.mesh.topology.get_cell_permutation_info()[cells]
    flat = values.reshape(-1)
    getattr(V.element, method)(flat, directions, V.dofmap.bs)
