# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nested iteration: the solution on a coarse mesh is the initial guess on a finer mesh.

Displacement and multipliers are interpolated and determine the statuses. The regions of contact and
slip are thus computed on the coarse mesh, where Newton steps are cheap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dolfinx import fem, la

from dolfinx_contact._arrays import Indices
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
    """Solve a problem on a sequence of meshes, each from the solution on the previous mesh.

    Collective.

    Args:
        problems: contact problem on every mesh, from coarse to fine, with the surfaces in the same
            order. The meshes need not be nested, and their partitions are arbitrary.
        monitor: function called with every Newton iterate, on every rank; default: none.

    Returns:
        Results of all problems, from coarse to fine.

    Raises:
        ValueError: if an item is not a contact problem, and for the reasons listed in `prolong` and
            `ContactProblem.solve`.
    """
    if not isinstance(problems, list | tuple):
        raise ValueError(f"a list of ContactProblems is required, got {problems!r}")
    for problem in problems:
        instance(problem, "each problem", ContactProblem)
    results = []
    for i, problem in enumerate(problems):
        if i > 0:
            prolong(problems[i - 1], problem)
        results.append(problem.solve(monitor=monitor))
    return results


def prolong(coarse: ContactProblem, fine: ContactProblem, *, padding: float = 1e-2) -> None:
    """Interpolate displacement and multipliers to the Functions of a finer problem. Collective.

    In a linear body, the displacement is interpolated only in the cells at the contact surfaces,
    where it determines the statuses. In other cells interpolation would not save iterations,
    because the residual of the interpolant is large.

    Args:
        coarse: solved problem.
        fine: the same problem on another mesh.
        padding: largest distance of a node of the fine mesh from the coarse mesh, relative to the
            size of the body; default: 0.01.

    Raises:
        ValueError: if the problems have different surfaces or rigid bodies, or a surface is a pair.
    """
    kinds = [[(s.degrees, s.method) for s in p.surfaces] for p in (coarse, fine)]
    if kinds[0] != kinds[1]:
        raise ValueError("the problems need the same surfaces, with the same methods and degrees")
    if len(coarse.rigid_bodies) != len(fine.rigid_bodies):
        raise ValueError("the problems need the same rigid bodies")
    if any(s.between_bodies for s in fine.surfaces):
        raise ValueError("pairs of surfaces cannot be interpolated to another mesh yet")
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
            # The multiplier is extended to a function on the body whose trace is the multiplier.
            # Hence the interpolation between volume meshes serves the surfaces as well.
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
    """Interpolation from one mesh to selected cells of another mesh."""

    def __init__(
        self,
        source: fem.FunctionSpace,
        target: fem.FunctionSpace,
        cells: Indices,
        padding: float,
    ):
        self.source = source
        self.target = target
        self._cells = cells
        self._data = fem.create_interpolation_data(target, source, cells, padding)

    def __call__(self, f: fem.Function) -> fem.Function:
        """Interpolate ``f`` to the target, zero outside the selected cells. Collective."""
        g = fem.Function(self.target)
        g.interpolate_nonmatching(f, self._cells, self._data)
        g.x.scatter_forward()
        return g


def _all_cells(problem: ContactProblem) -> Indices:
    cells = problem.V.mesh.topology.index_map(problem.V.mesh.topology.dim)
    return np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)


def _contact_cells(problem: ContactProblem) -> Indices:
    """Return the local cells with a node on a contact surface.

    Every owned contact node belongs to one of these cells.
    """
    V = problem.V
    marks = fem.Function(fem.functionspace(V.mesh, ("Lagrange", 1)))
    for s in problem.surfaces:
        nodes = trace_dofs(marks.function_space, s.points.vertices, s.submesh.parent_facets)
        marks.x.array[nodes] = 1.0
    marks.x.scatter_reverse(la.InsertMode.add)
    marks.x.scatter_forward()
    touched = (marks.x.array > 0)[marks.function_space.dofmap.list].any(axis=1)
    return np.flatnonzero(touched).astype(np.int32)
