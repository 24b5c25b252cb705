# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of the Functions of a problem, on the disk, to be compared on any number of ranks.

They are kept cell by cell, at the nodes of the mesh as it was given to DOLFINx, in the checkpoints
of a record: all of them once, and later those that have changed. Values that were solved for or
projected differ in their last bits on another number of ranks. So they are compared to 1e-9 of the
largest of their component; what is below 1e-12 of the largest of all is no value, but round-off.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from dolfinx_contact.body.cells import midpoints
from dolfinx_contact.equations.given_data import Datum, placed_data
from dolfinx_contact.records.checkpoints import Checkpoints, DamagedCheckpoint

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["KeptData", "nodes_of", "other_values", "owned_values"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
_TOLERANCE = 1e-9  # of the largest value of a component
_ROUND_OFF = 1e-12  # of the largest value of all components
_NO_LENGTH = 1e-13  # of the size of the body, a gap or displacement that is none


@dataclass
class _Kept:
    """A Function of which values are kept.

    Attributes:
        place: where it occurs, in words.
        function: it.
        least: what is no difference in any case.
        known: its owned values when they were kept last, or compared.
        where: name of the checkpoint that has them.
    """

    place: str
    function: fem.Function
    least: float = 0.0
    known: Array | None = None
    where: str = ""


class KeptData:
    """Functions of a problem's data in checkpoints. Collective.

    What Dirichlet conditions prescribe is one Function on the displacement's space, whatever they
    are given by: 0 where the displacement is free.

    Args:
        problem: whose data they are.
        checkpoints: of the record.
        more: data beside those of the problem, Constants among them.
        but: Functions and Constants that vary otherwise.
    """

    def __init__(
        self,
        problem: ContactProblem,
        checkpoints: Checkpoints,
        *,
        more: Sequence[Datum] = (),
        but: Sequence[Any] = (),
    ):
        self.problem = problem
        self._checkpoints = checkpoints
        eq = problem.equations
        seen = list(but)
        lengths = [f for s in eq.surfaces for f in _functions_in(s.given.gap)]
        no_length = _NO_LENGTH * eq.body_size
        self._prescribed = fem.Function(problem.V)
        self._kept = [_Kept("what is prescribed to the body", self._prescribed, no_length)]
        for place, f in (*placed_data(eq, conditions=False), *more):
            if isinstance(f, fem.Function) and not any(f is other for other in seen):
                seen.append(f)
                least = no_length if any(f is g for g in lengths) else 0.0
                self._kept.append(_Kept(place, f, least))

    @property
    def elements(self) -> list[str]:
        """Of the Functions, in order."""
        return [str(k.function.function_space.ufl_element()) for k in self._kept]

    def changed(self) -> dict[str, fem.Function]:
        """What has changed since it was kept, by the names in the checkpoint. Collective."""
        self._prescribe()
        here = [
            k.known is None or not np.array_equal(k.known, owned_values(k.function))
            for k in self._kept
        ]
        anywhere = self.problem.comm.allreduce(np.array(here, dtype=np.int32))
        return {
            f"data_{i}": k.function
            for i, (k, other) in enumerate(zip(self._kept, anywhere, strict=True))
            if other
        }

    def are_kept(self, name: str, functions: Mapping[str, fem.Function]) -> list[str]:
        """Take notice of what was kept in a checkpoint.

        Args:
            name: of the checkpoint.
            functions: as `changed` had them.

        Returns:
            The checkpoints that have the values of all Functions, in order.
        """
        for i, k in enumerate(self._kept):
            if f"data_{i}" in functions:
                k.known = owned_values(k.function).copy()
                k.where = name
        return [k.where for k in self._kept]

    def difference(self, where: Sequence[str], sums: Mapping[str, str]) -> str | None:
        """Where values are not those that were kept, in words that begin with a colon. Collective.

        What is in a checkpoint that is damaged cannot be compared; the log warns of it.

        Args:
            where: as `are_kept` had it.
            sums: check sums of the checkpoints by name.

        Returns:
            The first Function that is another; None if all are those that were kept.
        """
        if len(where) != len(self._kept):
            return ""
        self._prescribe()
        missing = [i for i, k in enumerate(self._kept) if k.where != where[i] or k.known is None]
        recorded: dict[int, Array] = {}
        for name in dict.fromkeys(where[i] for i in missing):
            mine = [i for i in missing if where[i] == name]
            found = {f"data_{i}": fem.Function(self._kept[i].function.function_space) for i in mine}
            try:
                self._checkpoints.read_functions(name, sums[name], found)
            except DamagedCheckpoint as error:
                if self.problem.comm.rank == 0:
                    places = ", ".join(self._kept[i].place for i in mine)
                    logger.warning("%s; not compared with what was recorded: %s", error, places)
                continue
            recorded |= {i: owned_values(found[f"data_{i}"]) for i in mine}
        for i, k in enumerate(self._kept):
            before = recorded.get(i) if i in missing else k.known
            if before is None:
                continue
            other = other_values(k.function, before, k.least)
            if other is not None:
                return f": {k.place}: {other}"
            k.known = owned_values(k.function).copy()
            k.where = where[i]
        return None

    def _prescribe(self) -> None:
        """Let the Function of what is prescribed follow the data. Collective."""
        self._prescribed.x.array[:] = self.problem.equations.prescribed.values().reshape(-1)


def nodes_of(problem: ContactProblem) -> fem.Function:
    """The nodes of the body's mesh as a Function on it. Collective."""
    domain = problem.V.mesh
    dim = domain.geometry.dim
    degree = domain.ufl_domain().ufl_coordinate_element().degree
    x = fem.Function(fem.functionspace(domain, ("Lagrange", degree, (dim,))))
    x.interpolate(lambda x: x[:dim])
    return x


def other_values(f: fem.Function, recorded: Array, least: float) -> str | None:
    """How a Function differs most from recorded owned values; None if it does not. Collective.

    Args:
        f: the Function.
        recorded: its owned values.
        least: what is no difference.
    """
    V = f.function_space
    comm = f.function_space.mesh.comm
    bs = V.dofmap.index_map_bs
    a = recorded.reshape(-1, bs)
    b = owned_values(f).reshape(-1, bs)
    size = np.zeros(bs)
    for values in (a, b):
        finite = np.where(np.isfinite(values), np.abs(values), 0.0)
        size = np.maximum(size, finite.max(axis=0, initial=0.0))
    size = comm.allreduce(size, op=np.maximum)
    tolerance = np.maximum(_TOLERANCE * size, max(_ROUND_OFF * float(size.max()), least))
    with np.errstate(invalid="ignore"):
        off = np.abs(a - b) / np.where(tolerance > 0, tolerance, 1.0)
    # What is not finite is the same where it is of one kind.
    off = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.nan_to_num(off, nan=np.inf))
    mine = (0.0, 0, 0.0, 0.0, "")
    if off.size and off.max() > 1.0:
        node, component = (int(i) for i in np.unravel_index(int(np.argmax(off)), off.shape))
        cell, place = _cell_of(V, node)
        mine = (float(off.max()), cell, float(a[node, component]), float(b[node, component]), place)
    worst = max(comm.allgather(mine), key=lambda found: (found[0], -found[1]))
    if worst[0] == 0.0:
        return None
    for digits in (6, 10, 17):
        was, now = (f"{v:.{digits}g}" for v in worst[2:4])
        if was != now:
            break
    return f"{was} was recorded, {now} is given in {worst[4]}"


def _cell_of(V: fem.FunctionSpace, node: int) -> tuple[int, str]:
    """A cell of this rank with a node: its number in the input, and it in words."""
    cells = np.flatnonzero((V.dofmap.list == node).any(axis=1))[:1]
    if not len(cells):  # of no cell of this rank, in a mesh without ghosts
        return 0, "a cell of another rank"
    number = int(V.mesh.topology.original_cell_index[cells[0]])
    x = ", ".join(f"{c:.6g}" for c in midpoints(V.mesh, cells)[0])
    return number, f"cell {number} (in the order of the input), at ({x})"


def owned_values(f: fem.Function) -> Array:
    """The values of a Function at the unknowns of this rank, no copy."""
    V = f.function_space
    return np.asarray(f.x.array[: V.dofmap.index_map.size_local * V.dofmap.index_map_bs])


def _functions_in(e: Any) -> list[fem.Function]:
    every = ufl.algorithms.extract_coefficients(ufl.as_ufl(e))
    return [f for f in every if isinstance(f, fem.Function)]
