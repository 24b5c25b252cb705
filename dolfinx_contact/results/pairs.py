# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces between the two faces of a pair: action and reaction.

The contact forces B^T W t act on the nodes of both bodies. Their sums on the slave and on the
master are taken apart, from the rows of the nodes that lie on either face. They balance where the
rows of B sum to zero; their moments balance where the faces lie on each other and B reproduces
linear fields as well. Across a gap, shear makes a moment that small sliding leaves out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.state import State
from dolfinx_contact.points.surface import ContactSurface

__all__ = ["PairBalance", "pair_balance", "pair_forces"]

_SAME_PLACE = 1e-9  # of the size of the faces, by which nodes may be off


@dataclass(frozen=True)
class PairBalance:
    """Contact forces on the two faces of a pair.

    Attributes:
        slave: resultant on the slave (dim,).
        master: resultant on the master (dim,).
        imbalance: |slave + master| over the sum of the sizes of all nodal forces.
        moment: the moment of all nodal forces over the sum of their sizes and the size of the
            faces; None where the faces do not lie on each other, and of bodies of revolution.
    """

    slave: npt.NDArray[np.float64]
    master: npt.NDArray[np.float64]
    imbalance: float
    moment: float | None

    def summary(self) -> dict[str, Any]:
        """For `summary.json`."""
        return {
            "slave": self.slave.tolist(),
            "master": self.master.tolist(),
            "force_imbalance": self.imbalance,
            "moment_imbalance": self.moment,
        }


def pair_forces(eq: ContactEquations, number: int, state: State) -> npt.NDArray[np.float64]:
    """Contact forces of a surface at the owned nodes of the displacement (n, dim). Collective."""
    found = state.surfaces[number]
    return found.kinematics.operator.transpose(found.traction).reshape(-1, eq.dim)


def pair_balance(eq: ContactEquations, number: int, state: State) -> PairBalance:
    """The balance of a pair at a state. Collective.

    Args:
        eq: the contact problem.
        number: of the pair among its surfaces.
        state: with tractions.
    """
    comm = eq.comm
    s = eq.surfaces[number]
    n = eq.V.dofmap.index_map.size_local
    forces = pair_forces(eq, number, state)
    x = eq.V.tabulate_dof_coordinates()[:, : eq.dim]
    # Where a crack ends nodes are of both faces; what acts there cancels.
    slave, master = (side[:n] for side in s.obstacle.opposite.sides)
    sums = [eq.resultant(forces[a & ~b]) for a, b in ((slave, master), (master, slave))]
    total = comm.allreduce(float(np.linalg.norm(forces, axis=1).sum())) or 1.0
    low, high = bounding_box(comm, x[:n][slave])
    size = float(np.linalg.norm(high - low))
    moment = None
    if not eq.axisymmetric and _apart(s, x) <= _SAME_PLACE * size:
        arms = x[:n] - (low + high) / 2
        turned = np.cross(_in_space(arms), _in_space(forces))
        moment = float(np.linalg.norm(comm.allreduce(turned.sum(axis=0)))) / (total * size)
    return PairBalance(sums[0], sums[1], float(np.linalg.norm(sums[0] + sums[1])) / total, moment)


def _apart(s: ContactSurface, x: npt.NDArray[np.float64]) -> float:
    """The largest distance of a node of the slave from what lies opposite. Collective.

    Args:
        s: the pair.
        x: positions of the local nodes (n, dim).
    """
    opposite = s._opposite_nodes
    assert opposite is not None
    on = (opposite.rows >= 0) & ~opposite.none
    off = np.linalg.norm((s._opposite(x) - x)[on], axis=1)
    return float(s.comm.allreduce(float(np.max(off, initial=0.0)), op=max))


def _in_space(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Three components."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))
