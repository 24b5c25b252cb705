# SPDX-License-Identifier: LGPL-3.0-or-later
"""States of a problem as arrays that do not depend on the number of ranks.

Fields are stored as arrays of shape (cells, coefficients per cell), with the cells in the order of
the input mesh. Multipliers are first transferred to Functions on the mesh of the body, at the same
nodes. Statuses and memory are stored in the order of the contact points in their table.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeVar

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

from dolfinx_contact._arrays import Array, Codes, Ints
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.trace import trace_nodes
from dolfinx_contact.results.outer_surface import Arrays

if TYPE_CHECKING:
    from dolfinx_contact.evolution.step import AcceptedState
    from dolfinx_contact.points.surface import DiscreteSurface
    from dolfinx_contact.problem import ContactProblem

__all__ = ["StateArrays", "by_cells", "coefficients", "input_numbers", "places"]

T = TypeVar("T", bound=np.generic)


def places(problem: ContactProblem) -> dict[str, list[list[float]]]:
    """Return the coordinates of contact points by surface, in table order. Collective."""
    return {s.name: s.in_order.positions.tolist() for s in problem.surfaces}


class StateArrays:
    """Conversion of states of a problem to arrays, and back. Collective.

    Args:
        problem: contact problem, whose Functions are overwritten.
    """

    def __init__(self, problem: ContactProblem):
        self._problem = problem
        self._multipliers = [
            _Multiplier(s, f) for s, f in zip(problem.surfaces, problem.fields[1:], strict=True)
        ]
        self._fields = [problem.u, *(m.on_body for m in self._multipliers)]
        self._points = [s.in_order for s in problem.surfaces]

    def of_vectors(self, vectors: Mapping[str, PETSc.Vec]) -> Arrays:
        """Convert vectors of unknowns to arrays by name, on rank 0. Collective.

        Afterwards, the Functions of the problem contain the last vector.
        """
        arrays = {}
        for name, x in vectors.items():
            self._problem.read(x)
            for m in self._multipliers:
                m.extend()
            arrays[f"{name}.rigid"] = np.array([b.values for b in self._problem.rigid_bodies])
            arrays |= self.of_functions({f"{name}.{i}": f for i, f in enumerate(self._fields)})
        return arrays

    def fill(self, vectors: Mapping[str, PETSc.Vec], arrays: Arrays) -> None:
        """Fill vectors of unknowns from their arrays on rank 0. Collective."""
        for name, x in vectors.items():
            self.fill_functions({f"{name}.{i}": f for i, f in enumerate(self._fields)}, arrays)
            for m in self._multipliers:
                m.restrict()
            motions = self._problem.comm.bcast(arrays.get(f"{name}.rigid"))
            for body, values in zip(self._problem.rigid_bodies, motions, strict=True):
                body.values = np.array(values)
            self._problem.write(x)

    def of_functions(self, functions: Mapping[str, fem.Function]) -> Arrays:
        """Convert Functions on the body to arrays by name, on rank 0. Collective."""
        return {
            name: by_cells(f.function_space.mesh, coefficients(f.function_space, f.x.array))
            for name, f in functions.items()
        }

    def fill_functions(self, functions: Mapping[str, fem.Function], arrays: Arrays) -> None:
        """Fill Functions on the body from their arrays on rank 0. Collective."""
        for name, f in functions.items():
            _fill(f, arrays.get(name))

    def of_points(self, accepted: AcceptedState) -> Arrays:
        """Return statuses and memory of all contact points as arrays, on every rank. Collective."""
        arrays: Arrays = {}
        surfaces = zip(self._points, accepted.state.statuses, accepted.memory, strict=True)
        for i, (points, codes, memory) in enumerate(surfaces):
            arrays[f"statuses.{i}"] = points(codes)
            place = {} if memory.place is None else {"place": memory.place}
            for name, values in {"jump": memory.jump, **place, **memory.fields}.items():
                arrays[f"memory.{i}.{name}"] = points(values)
        return arrays

    def statuses(self, arrays: Arrays) -> list[Codes]:
        """Return the statuses of the points of this rank, by surface, from `of_points`."""
        return [arrays[f"statuses.{i}"][points.mine] for i, points in enumerate(self._points)]

    def memory(self, arrays: Arrays) -> tuple[Memory, ...]:
        """Return the memory of the points of this rank, by surface, from arrays of `of_points`.

        For sliding faces the memory includes the displacement, and the motion of a rotating rigid
        body, if there is one. Both are read from the problem.
        """
        u = self._problem.u.x.array.reshape(-1, self._problem.equations.dim)
        memories = []
        for i, (points, s) in enumerate(zip(self._points, self._problem.surfaces, strict=True)):
            start = f"memory.{i}."
            names = [name for name in arrays if name.startswith(start)]
            fields = {name.removeprefix(start): arrays[name][points.mine] for name in names}
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


class _Multiplier:
    """Transfer of a multiplier to a Function on the mesh of the body, and back.

    Args:
        s: contact surface of the multiplier.
        multiplier: Function of the multiplier on the surface.

    Attributes:
        on_body: Function on the mesh of the body.
    """

    def __init__(self, s: DiscreteSurface, multiplier: fem.Function):
        W = fem.functionspace(s.domain, ("Lagrange", s.degrees[1], (s.dim,)))
        self.on_body = fem.Function(W)
        self._multiplier = multiplier
        self._nodes = trace_nodes(W, s.points.Q, s.submesh.parent_facets)
        self._shared = SharedValues(W.dofmap.index_map)

    def extend(self) -> None:
        """Copy the multiplier to the body, with 0 away from the surface. Collective."""
        bs = self.on_body.function_space.dofmap.index_map_bs
        values = self._multiplier.x.array.reshape(-1, bs)
        # A rank may own a node of the body without the adjacent facet, and several ranks may have
        # the same facet.
        sums = self._shared.sums(self._nodes, np.column_stack([values, np.ones(len(values))]))
        self.on_body.x.array[:] = (sums[:, :-1] / np.maximum(sums[:, -1:], 1.0)).reshape(-1)

    def restrict(self) -> None:
        """Copy the values of the Function on the body to the multiplier. Collective."""
        values = self.on_body.x.array.reshape(-1, self.on_body.function_space.dofmap.index_map_bs)
        self._multiplier.x.array[:] = values[self._nodes].reshape(-1)
        self._multiplier.x.scatter_forward()


def by_cells(domain: mesh.Mesh, values: npt.NDArray[T]) -> npt.NDArray[T]:
    """Gather values at cells on rank 0, in the order of the input mesh. Collective.

    Args:
        domain: mesh of the cells.
        values: k values at each of the n owned cells of this rank, shape (n, k).

    Returns:
        Values at all cells on rank 0, shape (number, k); on other ranks, the given values.

    Raises:
        ValueError: on every rank, if the cells of the mesh have no numbers, as in a submesh.
    """
    comm = domain.comm
    numbers = input_numbers(domain)[: len(values)]
    if comm.rank:
        comm.send((numbers, values), 0)
        return values
    # one rank after the other, so that rank 0 holds one copy of a field
    number = domain.topology.index_map(domain.topology.dim).size_global
    whole = np.empty((number, values.shape[1]), values.dtype)
    whole[numbers] = values
    for rank in range(1, comm.size):
        numbers, values = comm.recv(source=rank)
        whole[numbers] = values
    return whole


def coefficients(V: fem.FunctionSpace, values: npt.NDArray[T]) -> npt.NDArray[T]:
    """Return the coefficients of a Function by owned cell, shape (cells, coefficients).

    Args:
        V: function space of the Function.
        values: local values of the Function.
    """
    topology = V.mesh.topology
    return values[_places(V)[: topology.index_map(topology.dim).size_local]]


def _fill(f: fem.Function, whole: Array | None) -> None:
    """Fill a Function from its coefficients in all cells, given on rank 0. Collective."""
    comm = f.function_space.mesh.comm
    numbers = input_numbers(f.function_space.mesh)
    if comm.rank:
        comm.send(numbers, 0)
        values = comm.recv(source=0)
    else:
        assert whole is not None
        values = whole[numbers]
        for rank in range(1, comm.size):
            comm.send(whole[comm.recv(source=rank)], rank)
    f.x.array[_places(f.function_space)] = values
    f.x.scatter_forward()


def input_numbers(domain: mesh.Mesh) -> Ints:
    """Return the indices of the local cells in the input mesh.

    Raises:
        ValueError: if the cells have no numbers, as in a submesh.
    """
    try:
        return np.asarray(domain.topology.original_cell_index, np.int64)
    except RuntimeError as error:
        message = (
            "a record needs a mesh whose cells have numbers of the input, not a submesh: copy it "
            "with meshing.join([submesh]).mesh, or keep the displacements with io.EvolutionSeries"
        )
        raise ValueError(message) from error


def _places(V: fem.FunctionSpace) -> Ints:
    """Return the indices of the coefficients in local cells, shape (cells, coefficients)."""
    bs = V.dofmap.index_map_bs
    nodes = V.dofmap.list.astype(np.int64)
    # a rank may have no cells
    return (bs * nodes[:, :, None] + np.arange(bs)).reshape(len(nodes), bs * nodes.shape[1])
