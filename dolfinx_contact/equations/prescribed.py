# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed displacements: the user's Dirichlet data, of which a part may be applied."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.equations.constraints import Constraints

__all__ = ["PrescribedDisplacement"]


class PrescribedDisplacement:
    """Dirichlet data of a body as conditions of the problem's own, which follow the user's.

    Args:
        V: space of the displacement.
        constraints: which components are fixed, and to what.

    Attributes:
        part: of the way from a start to the user's data that is prescribed, 1 but in `ramped`.
    """

    def __init__(self, V: fem.FunctionSpace, constraints: Constraints):
        self._V = V
        self._constraints = constraints
        self.part = 1.0
        self._start: npt.NDArray[np.float64] | None = None
        #: What the unknowns are where the displacement is what is prescribed, if they are not it.
        self.unknowns: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]] | None = None

    @cached_property
    def _components(
        self,
    ) -> list[tuple[int, fem.Function, npt.NDArray[np.int32], fem.DirichletBC]]:
        """Every component that is fixed somewhere: Function of values, nodes, condition."""
        V = self._V
        found = []
        bs = V.dofmap.index_map_bs
        for i in range(bs):
            fixed = self._constraints.fixed[:, i]
            if not V.mesh.comm.allreduce(int(fixed.any())):
                continue
            W, parents = V.sub(i).collapse()
            # Since DOLFINx 0.11 a list with one array for each kind of cell.
            nodes = np.asarray(parents, dtype=np.int32).reshape(-1) // bs
            here = np.flatnonzero(fixed[nodes]).astype(np.int32)
            f = fem.Function(W)
            dofs = [(bs * nodes[here] + i).astype(np.int32), here]
            found.append((i, f, nodes, fem.dirichletbc(f, dofs, V.sub(i))))
        return found

    @property
    def conditions(self) -> list[fem.DirichletBC]:
        """What is prescribed now, one for every component that is fixed somewhere. Collective."""
        values = self.values()
        for i, f, nodes, _ in self._components:
            f.x.array[:] = values[nodes, i]
        return [bc for *_, bc in self._components]

    def values(self) -> npt.NDArray[np.float64]:
        """What is prescribed at the local nodes x dim, 0 where the displacement is free."""
        values = self._constraints.values(fill=0.0)
        if self.unknowns is not None:
            values = self.unknowns(values.reshape(-1)).reshape(values.shape)
        if self._start is not None:
            values = self._start + self.part * (values - self._start)
        return np.where(self._constraints.fixed, values, 0.0)

    @contextmanager
    def ramped(self, start: npt.NDArray[np.float64]) -> Iterator[None]:
        """Prescribe `part` of the way from ``start`` to the user's data while the context lasts.

        Args:
            start: displacement of the local nodes, (n, dim).
        """
        self._start = start.copy()
        try:
            yield
        finally:
            self._start = None
            self.part = 1.0
