# SPDX-License-Identifier: LGPL-3.0-or-later
"""Unknowns, statuses and memory as arrays that do not depend on the number of ranks.

Fields are arrays (cells, coefficients of a cell), with the cells in the order of the input of the
mesh; those of a contact surface are put into a Function on the body's mesh with the same nodes.
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
    from dolfinx_contact.problem import ContactProblem

__all__ = ["FieldArrays", "PointArrays"]


class FieldArrays:
    """Vectors of unknowns as arrays, and back. Collective.

    Args:
        problem: contact problem of the unknowns. Its Functions follow the vectors.
    """

    def __init__(self, problem: ContactProblem):
        self.problem = problem
        self._on_body: list[fem.Function | None] = [None]
        self._nodes: list[npt.NDArray[np.int32]] = [np.zeros(0, dtype=np.int32)]
        for s in problem.surfaces:
            W = fem.functionspace(s.domain, ("Lagrange", s.degrees[1], (s.dim,)))
            self._on_body.append(fem.Function(W))
            self._nodes.append(trace_dofs(W, s.points.Q, s.submesh.parent_facets))

    def gathered(self, vectors: Mapping[str, PETSc.Vec]) -> Arrays:
        """The arrays of vectors by name, on rank 0. Collective.

        The last vector stays in the Functions of the problem.
        """
        found = {}
        for name, x in vectors.items():
            self.problem.read(x)
            found[f"{name}.rigid"] = np.array([b.values for b in self.problem.rigid_bodies])
            for i, f in enumerate(self.problem.fields):
                found[f"{name}.{i}"] = _to_root(self._extended(i, f))
        return found

    def fill(
        self, vectors: Mapping[str, PETSc.Vec], arrays: Mapping[str, npt.NDArray[Any]]
    ) -> None:
        """Fill vectors from their arrays on rank 0. Collective."""
        comm = self.problem.comm
        for name, x in vectors.items():
            for i, f in enumerate(self.problem.fields):
                whole = self._on_body[i]
                _from_root(f if whole is None else whole, arrays.get(f"{name}.{i}"))
                if whole is not None:
                    bs = f.function_space.dofmap.index_map_bs
                    f.x.array[:] = whole.x.array.reshape(-1, bs)[self._nodes[i]].reshape(-1)
                    f.x.scatter_forward()
            motions = comm.bcast(arrays.get(f"{name}.rigid"))
            for body, values in zip(self.problem.rigid_bodies, motions, strict=True):
                body.values = np.array(values)
            self.problem.write(x)

    def _extended(self, i: int, f: fem.Function) -> fem.Function:
        """Field ``i`` as a Function on the mesh of the body; 0 away from its surface."""
        whole = self._on_body[i]
        if whole is None:
            return f
        W = whole.function_space
        bs = W.dofmap.index_map_bs
        # A rank may own a node of the body without having the facet next to it.
        values = la.vector(W.dofmap.index_map, bs)
        counts = la.vector(W.dofmap.index_map, 1)
        for v in (values, counts):
            v.array[:] = 0.0
        values.array.reshape(-1, bs)[self._nodes[i]] = f.x.array.reshape(-1, bs)
        counts.array[self._nodes[i]] = 1.0
        for v in (values, counts):
            v.scatter_reverse(la.InsertMode.add)
        n = W.dofmap.index_map.size_local
        # Every rank with the node has added the same value.
        mean = values.array.reshape(-1, bs)[:n] / np.maximum(counts.array[:n], 1.0)[:, None]
        whole.x.array[: n * bs] = mean.reshape(-1)
        whole.x.scatter_forward()
        return whole


class PointArrays:
    """Statuses and memory of the contact points of all ranks as arrays, and back. Collective.

    Points at one place (the sides of a crack) are ordered by their nodes in the input of the mesh.

    Args:
        problem: contact problem of the points.
    """

    def __init__(self, problem: ContactProblem):
        self._problem = problem
        self._surfaces = [Gathered(s.comm, s.positions, s.points.ids) for s in problem.surfaces]

    def gathered(self, accepted: AcceptedState) -> Arrays:
        """The arrays at a state, by name, on every rank. Collective."""
        found: Arrays = {}
        every = zip(self._surfaces, accepted.shown, accepted.memory, strict=True)
        for i, (surface, codes, memory) in enumerate(every):
            found[f"statuses.{i}"] = surface(codes)
            for name, values in _arrays(memory).items():
                found[f"memory.{i}.{name}"] = surface(values)
        return found

    def statuses(self, found: Mapping[str, npt.NDArray[Any]]) -> list[npt.NDArray[np.int8]]:
        """The statuses of the points of this rank, by surface."""
        return [found[f"statuses.{i}"][s.mine] for i, s in enumerate(self._surfaces)]

    def memory(self, found: Mapping[str, npt.NDArray[Any]]) -> tuple[Memory, ...]:
        """The memory of the points of this rank, by surface.

        The memory of sliding faces includes the displacement, and that on a turning rigid body its
        motion; both are those in the problem.
        """
        u = self._problem.u.x.array.reshape(-1, self._problem.equations.dim)
        memories = []
        for i, (surface, s) in enumerate(zip(self._surfaces, self._problem.surfaces, strict=True)):
            start = f"memory.{i}."
            names = [name for name in found if name.startswith(start)]
            arrays = {name.removeprefix(start): found[name][surface.mine] for name in names}
            jump = arrays.pop("jump")
            place = arrays.pop("place", None)
            displacement = u[: s.owned_nodes] if s.slides else None
            body = s.rigid_body
            motion = body.values if body is not None and s.turns else None
            memories.append(Memory(jump, arrays, 0.0, None, displacement, place, motion))
        return tuple(memories)


def _arrays(memory: Memory | None) -> Arrays:
    """All arrays of a memory."""
    if memory is None:
        return {}
    place = {} if memory.place is None else {"place": memory.place}
    return {"jump": memory.jump, **place, **memory.fields}


def _cells(f: fem.Function, number: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Input numbers of the first local cells, and places of their coefficients in the array."""
    V = f.function_space
    bs = V.dofmap.index_map_bs
    nodes = V.dofmap.list[:number].astype(np.int64)
    places = (bs * nodes[:, :, None] + np.arange(bs)).reshape(number, -1)
    return np.asarray(V.mesh.topology.original_cell_index[:number], np.int64), places


def _to_root(f: fem.Function) -> npt.NDArray[np.float64]:
    """The coefficients of all cells in the order of the input, on rank 0. Collective."""
    comm = f.function_space.mesh.comm
    cells = f.function_space.mesh.topology.index_map(f.function_space.mesh.topology.dim)
    numbers, places = _cells(f, cells.size_local)
    values = f.x.array[places]
    if comm.rank:
        comm.send((numbers, values), 0)
        return np.zeros((0, 0))
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
