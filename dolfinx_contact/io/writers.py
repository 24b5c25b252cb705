# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of Functions for ParaView and PyVista, of one state or a series in time.

VTX (``.bp``, a folder) is written by DOLFINx and ADIOS2, every rank its part. VTK (``.vtu`` for a
state; ``.pvd`` and a folder of ``.vtu`` for a series) is written here, from rank 0, with all the
digits; cells of displacements of degree 2 are Lagrange cells, so that nothing is lost. Functions of
one file have one mesh and one Lagrange element.
"""

from __future__ import annotations

import base64
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeAlias
from xml.sax.saxutils import quoteattr

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import fem, plot

from dolfinx_contact._compat import VTXFile, has_vtx
from dolfinx_contact._errors import everywhere, on_root, require, same_everywhere
from dolfinx_contact._files import os_error
from dolfinx_contact._geometry import node_positions
from dolfinx_contact.io.disk import put, reserve
from dolfinx_contact.io.gathering import gather_cells

__all__ = [
    "Format",
    "Series",
    "VTKSeries",
    "VTXSeries",
    "checked_format",
    "disk_errors",
    "see_room",
    "series",
]

logger = logging.getLogger(__name__)

#: Of files; None is VTX, or VTK where DOLFINx was built without ADIOS2.
Format: TypeAlias = Literal["vtx", "vtk"] | None

_OVERHEAD = 1 << 15  # bytes a rank, a step and a file, for what ADIOS2 adds
_TYPES = {"float64": "Float64", "int64": "Int64", "uint8": "UInt8"}


def checked_format(comm: MPI.Comm, format: Format) -> Literal["vtx", "vtk"]:
    """The format that is meant. Collective.

    Raises:
        ValueError: on every rank, if it is not known, or is VTX and DOLFINx lacks ADIOS2, or it
            differs between ranks.
    """
    same_everywhere(comm, format=format)
    require(comm, format in ("vtx", "vtk", None), f"format is {format!r}: vtx and vtk are known")
    require(comm, format != "vtx" or has_vtx(), "DOLFINx was built without ADIOS2: format='vtk'")
    if format is None and not has_vtx():
        if comm.rank == 0:
            logger.info("DOLFINx was built without ADIOS2: fields are written as .vtu (VTK)")
        return "vtk"
    return format or "vtx"


class Series:
    """States of Functions one after the other in one file.

    Attributes:
        file: that a program opens.
    """

    file: Path

    def write(self, time: float) -> None:
        """Write the Functions as they are. Collective."""
        raise NotImplementedError

    def close(self) -> None:
        """Finish the file; an error of before is enough. Collective."""


def series(
    comm: MPI.Comm,
    stem: Path,
    functions: Sequence[fem.Function],
    format: Literal["vtx", "vtk"],
    *,
    single: bool = True,
) -> Series:
    """Begin a file in a folder that exists. Collective.

    Args:
        comm: of the mesh.
        stem: path without suffix.
        functions: whose values are written, of one mesh and one Lagrange element.
        format: of the file.
        single: whether it is one state.

    Raises:
        OSError: on every rank, with the path, if it cannot be written.
    """
    if format == "vtx":
        return VTXSeries(comm, stem, functions)
    return VTKSeries(comm, stem, functions, single=single)


def see_room(
    comm: MPI.Comm, stem: Path, functions: Sequence[Sequence[fem.Function]], steps: int = 1
) -> None:
    """See that there is room for files of ``functions``, before ADIOS2 fails. Collective.

    Raises:
        OSError: on every rank, with the path, if there is none.
    """
    size = sum(_vtx_size(several) for several in functions)
    reserve(comm, stem.with_name(stem.name + ".bp"), steps * size)


@contextmanager
def disk_errors(comm: MPI.Comm, path: Path) -> Iterator[None]:
    """Raise errors of ADIOS2 and of files as ``OSError`` of ``path`` on every rank. Collective."""
    with everywhere(comm, f"writing {path}"):
        try:
            yield
        except (OSError, RuntimeError) as error:
            raise os_error(error, path) from error


# -- VTX -----------------------------------------------------------------------------------------


class VTXSeries(Series):
    """See `series`."""

    def __init__(self, comm: MPI.Comm, stem: Path, functions: Sequence[fem.Function]):
        self.file = stem.with_name(stem.name + ".bp")
        self._comm = comm
        self._failed = False
        with disk_errors(comm, self.file):
            self._vtx = VTXFile(comm, self.file, functions)

    def write(self, time: float) -> None:
        self._guarded(lambda: self._vtx.write(time))

    def close(self) -> None:
        if not self._failed:
            self._guarded(self._vtx.close)

    def _guarded(self, do: Any) -> None:
        try:
            with disk_errors(self._comm, self.file):
                do()
        except OSError:
            self._failed = True
            self._vtx.abandon()
            raise


def _vtx_size(functions: Sequence[fem.Function]) -> int:
    """Bytes that this rank writes in a step, at most."""
    V = functions[0].function_space
    nodes = len(node_positions(V))
    cells = len(V.dofmap.list)
    numbers = sum(_components(f) for f in functions)
    # Nodes with their coordinates, numbers and whether they are ghosts; cells; values.
    return nodes * (24 + 8 + 1 + 8 * numbers) + 8 * cells * (1 + V.dofmap.list.shape[1]) + _OVERHEAD


def _components(f: fem.Function) -> int:
    """Of the values as they are written: vectors have three, tensors nine."""
    return (1, 3, 9)[len(f.ufl_shape)]


# -- VTK -----------------------------------------------------------------------------------------


class VTKSeries(Series):
    """See `series`; ``single`` makes one ``.vtu``."""

    def __init__(
        self, comm: MPI.Comm, stem: Path, functions: Sequence[fem.Function], *, single: bool
    ):
        self._comm = comm
        self._stem = stem
        self._functions = list(functions)
        self._single = single
        self._times = list[tuple[float, str]]()
        self.file = stem.with_name(stem.name + (".vtu" if single else ".pvd"))
        if not single:
            on_root(comm, stem.mkdir)

    def write(self, time: float) -> None:
        name = f"{self._stem.name}/point_{len(self._times):06d}.vtu"
        file = self.file if self._single else self.file.parent / name
        content = vtu(self._comm, self._functions)
        self._times.append((time, name))
        on_root(self._comm, lambda: put(file, content))

    def close(self) -> None:
        if self._single:
            return
        sets = "".join(
            f'<DataSet timestep="{time!r}" part="0" file={quoteattr(name)}/>\n'
            for time, name in self._times
        )
        text = _document("Collection", "0.1", f"<Collection>\n{sets}</Collection>\n")
        on_root(self._comm, lambda: put(self.file, text.encode()))


def vtu(comm: MPI.Comm, functions: Sequence[fem.Function]) -> bytes:
    """Functions of all ranks as an unstructured grid of VTK, on rank 0; nothing elsewhere."""
    V = functions[0].function_space
    kind, cells, x = _cells(V)
    points = {f.name: _at_points(f, cells, len(x)) for f in functions}
    seen = gather_cells(comm, V, cells, points)
    kind = comm.allreduce(kind, op=MPI.MAX)  # a rank may have no cells
    if not seen:
        return b""
    connectivity = seen["cells"].astype(np.int64)
    count, width = connectivity.shape
    arrays = "".join(_array(f.name, _padded(f, seen[f.name])) for f in functions)
    text = (
        f'<Piece NumberOfPoints="{len(seen["x"])}" NumberOfCells="{count}">\n'
        f"<PointData>\n{arrays}</PointData>\n"
        f"<Points>\n{_array('Points', seen['x'])}</Points>\n<Cells>\n"
        f"{_array('connectivity', connectivity.reshape(-1))}"
        f"{_array('offsets', np.arange(1, count + 1, dtype=np.int64) * width)}"
        f"{_array('types', np.full(count, kind, dtype=np.uint8))}</Cells>\n</Piece>\n"
    )
    # Version 2.2: Lagrange hexahedra are numbered as DOLFINx has it.
    grid = f"<UnstructuredGrid>\n{text}</UnstructuredGrid>\n"
    return _document("UnstructuredGrid", "2.2", grid).encode()


def _cells(
    V: fem.FunctionSpace,
) -> tuple[int, npt.NDArray[np.int32], npt.NDArray[np.float64]]:
    """VTK's number of the cells' kind (0 without cells), their nodes in its order, all x."""
    topology, kinds, x = plot.vtk_mesh(V)
    cells = topology.reshape(-1, V.dofmap.list.shape[1] + 1)[:, 1:]
    return int(kinds[0]) if len(kinds) else 0, cells, x


def _at_points(
    f: fem.Function, cells: npt.NDArray[np.int32], count: int
) -> npt.NDArray[np.float64]:
    """Values at the nodes of another space with the same element, whose numbers may be others."""
    bs = f.function_space.dofmap.index_map_bs
    values = np.zeros((count, bs))
    values[cells] = f.x.array.reshape(-1, bs)[_cells(f.function_space)[1]]
    return values


def _padded(f: fem.Function, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Vectors with three components."""
    wanted = _components(f)
    return np.pad(values, ((0, 0), (0, wanted - values.shape[1])))


def _array(name: str, values: npt.NDArray[Any]) -> str:
    data = np.ascontiguousarray(values)
    coded = base64.b64encode(np.uint64(data.nbytes).tobytes() + data.tobytes()).decode()
    components = data.shape[1] if data.ndim > 1 else 1
    return (
        f'<DataArray type="{_TYPES[data.dtype.name]}" Name={quoteattr(name)} '
        f'NumberOfComponents="{components}" format="binary">{coded}</DataArray>\n'
    )


def _document(kind: str, version: str, content: str) -> str:
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="{version}" '
        f'byte_order="LittleEndian" header_type="UInt64">\n{content}</VTKFile>\n'
    )
