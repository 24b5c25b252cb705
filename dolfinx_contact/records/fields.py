# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unknowns, statuses and memory as arrays that do not depend on the number of ranks.

Fields are arrays (cells, coefficients of a cell), with the cells in the order of the input of the
mesh; multipliers are put into a Function on the body's mesh with the same nodes.
Statuses and memory are in the order of the contact points in their table.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la

from dolfinx_contact.equations.order import Gathered
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.trace import trace_dofs
from dolfinx_contact.records.arrays import Arrays

if TYPE_CHECKING:
    from dolfinx_contact.evolution.step import AcceptedState
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["FieldArrays", "PointArrays"]


class FieldArrays:
    """Conversion between vectors of unknowns and arrays. Collective.

    Args:
        problem: contact problem of the unknowns, whose Functions are overwritten.
    """

    def __init__(self, problem: ContactProblem):
        self.problem = problem
        self._surfaces = [_SurfaceField(s) for s in problem.surfaces]

    def gathered(self, vectors: Mapping[str, PETSc.Vec]) -> Arrays:
        """Return the arrays of vectors by name, on rank 0. Collective.

        Afterwards, the Functions of the problem contain the last vector.
        """
        arrays = {}
        for name, x in vectors.items():
            self.problem.read(x)
            arrays[f"{name}.rigid"] = np.array([b.values for b in self.problem.rigid_bodies])
            u, *multipliers = self.problem.fields
            arrays[f"{name}.0"] = _to_root(u)
            for i, (f, field) in enumerate(zip(multipliers, self._surfaces, strict=True), 1):
                arrays[f"{name}.{i}"] = _to_root(field.extended(f))
        return arrays

    def fill(
        self, vectors: Mapping[str, PETSc.Vec], arrays: Mapping[str, npt.NDArray[np.float64]]
    ) -> None:
        """Fill vectors from their arrays on rank 0. Collective."""
        for name, x in vectors.items():
            u, *multipliers = self.problem.fields
            _from_root(u, arrays.get(f"{name}.0"))
            for i, (f, field) in enumerate(zip(multipliers, self._surfaces, strict=True), 1):
                _from_root(field.on_body, arrays.get(f"{name}.{i}"))
                field.restrict(f)
            motions = self.problem.comm.bcast(arrays.get(f"{name}.rigid"))
            for body, values in zip(self.problem.rigid_bodies, motions, strict=True):
                body.values = np.array(values)
            self.problem.write(x)


class _SurfaceField:
    """A Function on the body's mesh with the nodes of a multiplier.

    Args:
        s: contact surface of the multiplier.

    Attributes:
        on_body: the Function.
    """

    def __init__(self, s: DiscreteSurface):
        W = fem.functionspace(s.domain, ("Lagrange", s.degrees[1], (s.dim,)))
        self.on_body = fem.Function(W)
        self._nodes = trace_dofs(W, s.points.Q, s.submesh.parent_facets)

    def restrict(self, f: fem.Function) -> None:
        """Set a multiplier to the values on the body. Collective."""
        bs = f.function_space.dofmap.index_map_bs
        f.x.array[:] = self.on_body.x.array.reshape(-1, bs)[self._nodes].reshape(-1)
        f.x.scatter_forward()

    def extended(self, f: fem.Function) -> fem.Function:
        """Return a multiplier on the body; 0 away from its surface. Collective."""
        W = self.on_body.function_space
        bs = W.dofmap.index_map_bs
        # A rank may own a node of the body without having the facet next to it.
        values = la.vector(W.dofmap.index_map, bs)
        counts = la.vector(W.dofmap.index_map, 1)
        for v in (values, counts):
            v.array[:] = 0.0
        values.array.reshape(-1, bs)[self._nodes] = f.x.array.reshape(-1, bs)
        counts.array[self._nodes] = 1.0
        for v in (values, counts):
            v.scatter_reverse(la.InsertMode.add)
        n = W.dofmap.index_map.size_local
        # Every rank with the node has added the same value.
        mean = values.array.reshape(-1, bs)[:n] / np.maximum(counts.array[:n], 1.0)[:, None]
        self.on_body.x.array[: n * bs] = mean.reshape(-1)
        self.on_body.x.scatter_forward()
        return self.on_body


class PointArrays:
    """Conversion of statuses and memory of all contact points to and from arrays. Collective.

    Points with equal coordinates, such as both sides of a crack, are sorted by the numbers of their
    nodes in the input mesh.

    Args:
        problem: contact problem of the points.
    """

    def __init__(self, problem: ContactProblem):
        self._problem = problem
        self._surfaces = [Gathered(s.comm, s.positions, s.points.ids) for s in problem.surfaces]

    def gathered(self, accepted: AcceptedState) -> Arrays:
        """Return the arrays at a state, by name, on every rank. Collective."""
        arrays: Arrays = {}
        surfaces = zip(self._surfaces, accepted.shown, accepted.memory, strict=True)
        for i, (surface, codes, memory) in enumerate(surfaces):
            arrays[f"statuses.{i}"] = surface(codes)
            if memory is not None:
                place = {} if memory.place is None else {"place": memory.place}
                for name, values in {"jump": memory.jump, **place, **memory.fields}.items():
                    arrays[f"memory.{i}.{name}"] = surface(values)
        return arrays

    def statuses(self, arrays: Mapping[str, npt.NDArray[Any]]) -> list[npt.NDArray[np.int8]]:
        """Return the statuses of the points of this rank, by surface."""
        return [arrays[f"statuses.{i}"][s.mine] for i, s in enumerate(self._surfaces)]

    def memory(self, arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[Memory, ...]:
        """Return the memory of the points of this rank, by surface.

        The memory of sliding faces includes the displacement, and that on a turning rigid body its
        motion; both are those in the problem.
        """
        u = self._problem.u.x.array.reshape(-1, self._problem.equations.dim)
        memories = []
        for i, (surface, s) in enumerate(zip(self._surfaces, self._problem.surfaces, strict=True)):
            start = f"memory.{i}."
            names = [name for name in arrays if name.startswith(start)]
            fields = {name.removeprefix(start): arrays[name][surface.mine] for name in names}
            body = s.rigid_body
            memories.append(
                Memory(
                    fields.pop("jump"),
                    place=fields.pop("place", None),
                    fields=fields,
                    displacement=u[: s.owned_nodes] if s.slides else None,
                    motion=body.values if body is not None and s.partner.turns else None,
                )
            )
        return tuple(memories)


def _cells(f: fem.Function, number: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the input numbers of the first local cells, and the places of their coefficients."""
    V = f.function_space
    bs = V.dofmap.index_map_bs
    nodes = V.dofmap.list[:number].astype(np.int64)
    places = (bs * nodes[:, :, None] + np.arange(bs)).reshape(number, -1)
    return np.asarray(V.mesh.topology.original_cell_index[:number], np.int64), places


def _to_root(f: fem.Function) -> npt.NDArray[np.float64]:
    """Return the coefficients of all cells in the order of the input, on rank 0. Collective."""
    comm = f.function_space.mesh.comm
    cells = f.function_space.mesh.topology.index_map(f.function_space.mesh.topology.dim)
    numbers, places = _cells(f, cells.size_local)
    values = f.x.array[places]
    if comm.rank:
        comm.send((numbers, values), 0)
        return np.zeros((0, 0))
    # one rank after the other, so that rank 0 holds one copy of the field
    whole = np.empty((cells.size_global, values.shape[1]))
    whole[numbers] = values
    for rank in range(1, comm.size):
        numbers, values = comm.recv(source=rank)
        whole[numbers] = values
    return whole


def _from_root(f: fem.Function, whole: npt.NDArray[np.float64] | None) -> None:
    """Fill a Function from the coefficients of all cells on rank 0. Collective."""
    comm = f.function_space.mesh.comm
    numbers, places = _cells(f, len(f.function_space.dofmap.list))
    if comm.rank:
        comm.send(numbers, 0)
        values = comm.recv(source=0)
    else:
        assert whole is not None
        values = whole[numbers]
        for rank in range(1, comm.size):
            comm.send(whole[comm.recv(source=rank)], rank)
    f.x.array[places] = values
    f.x.scatter_forward()
