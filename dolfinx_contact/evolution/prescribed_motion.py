# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Consistency of a motion with the Dirichlet data of its body.

Dirichlet data prescribe the displacement u_1 at the end of a step. With theta = 1/2 the velocity of
a held node follows from it as

    v_1 = 2 (u_1 - u_0)/h - v_0,

so that a velocity v_0 different from the velocity of the data oscillates in all later steps.
"""

from __future__ import annotations

import logging

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import node_positions
from dolfinx_contact._mpi import largest, require
from dolfinx_contact.body.moving import TimeStep
from dolfinx_contact.evolution.motion_energy import Deviation, Motion
from dolfinx_contact.problem import ContactProblem

__all__ = ["PrescribedMotion"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]

_ROUND_OFF = 1e-9  # fraction of the body size that counts as no displacement
_SAME = 1e-6  # fraction of the largest displacement or velocity that counts as no deviation
_DAMPED = 0.51  # theta above which an oscillation decays
_REVERSED = 0.1  # relative change of a deviation with reversed sign
_VISIBLE = 0.01  # fraction of the velocities above which an oscillation is reported
_REVERSALS = 3  # number of successive reversals after which an oscillation is reported


class PrescribedMotion:
    """Consistency checks of displacement and velocity with the Dirichlet data.

    Args:
        problem: contact problem of a time step.
    """

    def __init__(self, problem: ContactProblem):
        eq = problem.equations
        self._problem = problem
        self._comm = problem.comm
        self._held = np.asarray(eq.fixed[: eq.owned_sizes[0]])  # owned dofs with Dirichlet data
        self._zero = _ROUND_OFF * eq.body_size
        self._reported = False

    def require_displacement(self) -> None:
        """Raise ``ValueError`` if the displacement differs from the Dirichlet data. Collective."""
        u, data = self._displacement_and_data()
        (size,) = largest(self._comm, [max(_size(u), _size(data))])
        place = self._deviation(u, data, self._held, _SAME * size + self._zero)
        require(
            self._comm,
            not place,
            f"at the start the displacement differs from the Dirichlet data: {place}; solve() "
            "first, or copy the prescribed values into the displacement",
        )

    def require_velocity(self, v: Array) -> None:
        """Raise ``ValueError`` if a node fixed by Dirichlet data has a velocity. Collective.

        A node is fixed if its Dirichlet data are constant in the first step. On entry the Functions
        must contain the start of the first step, and the data the values at its end.

        Args:
            v: initial velocity, all local values.

        Raises:
            ValueError: on every rank, with the position of the node.
        """
        u, data = self._displacement_and_data()
        still = self._held & (np.abs(data - u) <= self._zero)
        (size,) = largest(self._comm, [_size(v)])
        place = self._deviation(v[: len(u)], np.zeros_like(u), still, _SAME * size)
        require(
            self._comm,
            not place,
            "the velocity at the start is against Dirichlet data that are constant in the first "
            f"step: {place}; it would change its sign in every step: set the velocity of held "
            "nodes to the velocity of the data",
        )

    def deviation(self, a: Motion, b: Motion, step: TimeStep) -> Deviation:
        """Compare the velocities of nodes with Dirichlet data with their mean in the step.

        If they oscillate from step to step, a warning is logged once on rank 0. Collective.

        Args:
            a: motion at the start of the step.
            b: motion at the end of the step.
            step: time step.
        """
        n = len(self._held)
        mean = np.asarray((b.u - a.u)[:n] / step.length)
        values = np.where(self._held, b.v[:n] - mean, 0.0)
        last = a.deviation
        if last is None or step.scheme == "theta-euler" or step.theta >= _DAMPED:
            return Deviation(values)
        sizes = [_size(v) for v in (values, values + last.values, mean, b.v)]
        size, change, *speeds = largest(self._comm, sizes)
        if not (change < _REVERSED * size and size > _VISIBLE * max(speeds)):
            return Deviation(values)
        if last.reversals + 1 == _REVERSALS and not self._reported:
            self._reported = True
            place = self._deviation(b.v[:n], mean, self._held, 0.5 * size)
            if self._comm.rank == 0:
                logger.warning(
                    "velocities of nodes held by Dirichlet data change from step to step about the "
                    "velocity of the data (%s according to the data): the motion started with "
                    "another velocity than the data, or these have a kink in time; theta > 1/2 "
                    "damps the oscillation",
                    place,
                )
        return Deviation(values, last.reversals + 1)

    def _displacement_and_data(self) -> tuple[Array, Array]:
        """Owned values of the displacement and of the Dirichlet data."""
        eq = self._problem.equations
        n = len(self._held)
        return self._problem.u.x.array[:n], eq.prescribed.values().reshape(-1)[:n]

    def _deviation(
        self, values: Array, data: Array, which: npt.NDArray[np.bool_], tolerance: float
    ) -> str:
        """Describe the largest deviation of values from data; "" if it is small. Collective.

        Args:
            values: owned values.
            data: owned values prescribed by the data.
            which: mask of the compared dofs.
            tolerance: deviation that counts as small.
        """
        off = np.where(which, np.abs(values - data), 0.0)
        (worst,) = largest(self._comm, [_size(off)])
        if worst <= tolerance:
            return ""
        # of equal deviations on several nodes and ranks the first in the order of coordinates
        V = self._problem.V
        bs = V.dofmap.index_map_bs
        dofs = np.flatnonzero(off == worst)
        size = self._problem.equations.body_size
        nodes = np.round(node_positions(V)[dofs // bs, :bs] / size, 9) * size + 0.0
        local: list[tuple[list[float], int, float, float]] = [
            (nodes[k].tolist(), int(i % bs), float(values[i]), float(data[i]))
            for k, i in enumerate(dofs)
        ]
        x, component, value, wanted = min(p for part in self._comm.allgather(local) for p in part)
        return (
            f"component {'xyz'[component]} at the node ({', '.join(f'{c:.6g}' for c in x)}) is "
            f"{value:.6g}, prescribed is {wanted:.6g}"
        )


def _size(values: Array) -> float:
    """Largest absolute value on this rank."""
    return float(np.max(np.abs(values), initial=0.0))
