# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nested iteration: solve on a coarse mesh, and start from its solution on a finer one.

The displacement and the multipliers are interpolated; the statuses follow from them. The regions
of contact and slip are found on the coarse mesh, where Newton steps are cheap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la

from dolfinx_contact._petsc import logged
from dolfinx_contact._validate import instance
from dolfinx_contact.points.trace import trace_dofs
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.results.result import Result

if TYPE_CHECKING:
    from dolfinx_contact.solvers.history import Step

__all__ = ["prolong", "solve_nested"]


def solve_nested(
    problems: Sequence[ContactProblem], *, monitor: Callable[[Step], None] | None = None
) -> list[Result]:
    """Solve the same problem on finer and finer meshes, each from the solution before.

    Args:
        problems: the problem on every mesh, coarse to fine; surfaces correspond by their order. The
            meshes need not be nested, and may be distributed as they like.
        monitor: called with every Newton iterate, on every rank.

    Returns:
        The results, coarse to fine.

    Raises:
        ValueError: if these are no contact problems, and as `prolong` and `ContactProblem.solve`.
    """
    if not isinstance(problems, list | tuple):
        raise ValueError(f"a list of ContactProblems is needed, got {problems!r}")
    for problem in problems:
        instance(problem, "each problem", ContactProblem)
    results = []
    for i, problem in enumerate(problems):
        if i > 0:
            prolong(problems[i - 1], problem)
        results.append(problem.solve(monitor=monitor))
    return results


def prolong(coarse: ContactProblem, fine: ContactProblem, *, padding: float = 1e-2) -> None:
    """Interpolate displacement and multipliers of ``coarse`` into the Functions of ``fine``.

    The displacement of a linear body is interpolated in the cells of the contact surfaces alone,
    where the status comes from: the first Newton step finds the rest as fast as from the
    interpolant, whose residual is large.

    Args:
        coarse: a solved problem.
        fine: the same problem on another mesh.
        padding: how far a node of the fine mesh may lie outside the coarse one, over the size of
            the body.

    Raises:
        ValueError: if the problems differ in their surfaces, or one is a pair. Collective.
    """
    kinds = [[(s.degrees, s.method) for s in p.surfaces] for p in (coarse, fine)]
    if kinds[0] != kinds[1]:
        raise ValueError("the problems need the same surfaces, with the same methods and degrees")
    if len(coarse.rigid_bodies) != len(fine.rigid_bodies):
        raise ValueError("the problems need the same rigid bodies")
    if any(s.between_bodies for s in fine.surfaces):
        raise ValueError("between bodies a solution cannot be taken to another mesh yet")
    with logged("ContactProlong"):
        cells = _contact_cells(fine) if fine.equations.bulk.linear else _all_cells(fine)
        distance = padding * coarse.equations.body_size
        interpolate = _Interpolation(coarse.V, fine.V, cells, distance)
        fine.u.x.array[:] = interpolate(coarse.u).x.array
        for known, new in zip(coarse.rigid_bodies, fine.rigid_bodies, strict=True):
            new.values = known.values.copy()
        for a, b in zip(coarse.surfaces, fine.surfaces, strict=True):
            degree = a.degrees[1]
            maps = interpolate
            if degree != a.degrees[0]:
                spaces = [
                    fem.functionspace(p.V.mesh, ("Lagrange", degree, (a.dim,)))
                    for p in (coarse, fine)
                ]
                maps = _Interpolation(spaces[0], spaces[1], cells, distance)
            # The trace of a function on the body that is the multiplier at the contact nodes is
            # the multiplier, so that volumes are interpolated for surfaces as well.
            from_dofs = trace_dofs(maps.source, a.points.Q, a.submesh.parent_facets)
            to_dofs = trace_dofs(maps.target, b.points.Q, b.submesh.parent_facets)
            n = a.points.Q.dofmap.index_map.size_local
            extended = fem.Function(maps.source)
            values = extended.x.array.reshape(-1, a.dim)
            values[from_dofs[:n]] = a.multiplier.x.array.reshape(-1, a.dim)[:n]
            extended.x.scatter_reverse(la.InsertMode.add)
            extended.x.scatter_forward()
            found = maps(extended).x.array.reshape(-1, a.dim)[to_dofs]
            b.multiplier.x.array[:] = found.reshape(-1)


class _Interpolation:
    """Interpolation from one mesh into some cells of another."""

    def __init__(
        self,
        source: fem.FunctionSpace,
        target: fem.FunctionSpace,
        cells: npt.NDArray[np.int32],
        padding: float,
    ):
        self.source = source
        self.target = target
        self._cells = cells
        self._data = fem.create_interpolation_data(target, source, cells, padding)

    def __call__(self, f: fem.Function) -> fem.Function:
        """``f`` on the target, zero away from the cells. Collective."""
        g = fem.Function(self.target)
        g.interpolate_nonmatching(f, self._cells, self._data)
        g.x.scatter_forward()
        return g


def _all_cells(problem: ContactProblem) -> npt.NDArray[np.int32]:
    cells = problem.V.mesh.topology.index_map(problem.V.mesh.topology.dim)
    return np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)


def _contact_cells(problem: ContactProblem) -> npt.NDArray[np.int32]:
    """Local cells with a node on a contact surface: every owned contact node has one."""
    V = problem.V
    marks = fem.Function(fem.functionspace(V.mesh, ("Lagrange", 1)))
    for s in problem.surfaces:
        nodes = trace_dofs(marks.function_space, s.points.vertices, s.submesh.parent_facets)
        marks.x.array[nodes] = 1.0
    marks.x.scatter_reverse(la.InsertMode.add)
    marks.x.scatter_forward()
    touched = (marks.x.array > 0)[marks.function_space.dofmap.list].any(axis=1)
    return np.flatnonzero(touched).astype(np.int32)
