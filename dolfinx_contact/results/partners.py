# SPDX-License-Identifier: LGPL-3.0-or-later
"""What acts on the partners of a body: the other face of a pair, and rigid bodies, which move.

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

from dolfinx_contact._mesh_mark import node_positions
from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.points.surface import DiscreteSurface

__all__ = ["PairBalance", "RigidBodyResult", "pair_balance", "pair_forces", "rigid_body_results"]

_SAME_PLACE = 1e-9  # of the size of the faces, by which nodes may be off
Array = npt.NDArray[np.float64]


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


def pair_forces(eq: ContactEquations, number: int, state: Evaluation) -> npt.NDArray[np.float64]:
    """Contact forces of a surface at the owned nodes of the displacement (n, dim). Collective."""
    found = state.surfaces[number]
    return found.kinematics.operator.transpose(found.traction).reshape(-1, eq.dim)


def pair_balance(eq: ContactEquations, number: int, state: Evaluation) -> PairBalance:
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
    x = node_positions(eq.V)[:, : eq.dim]
    # Where a crack ends nodes are of both faces; what acts there cancels.
    slave, master = (side[:n] for side in s.obstacle.opposite.sides)
    sums = [eq.resultant(forces[a & ~b]) for a, b in ((slave, master), (master, slave))]
    both = eq.resultant(forces[slave & master])
    total = comm.allreduce(float(np.linalg.norm(forces, axis=1).sum())) or 1.0
    low, high = bounding_box(comm, x[:n][slave])
    size = float(np.linalg.norm(high - low))
    moment = None
    if s.slides:
        x = x + state.u.reshape(-1, eq.dim)
    if not eq.axisymmetric and (s.slides or _apart(s, x) <= _SAME_PLACE * size):
        arms = x[:n] - (low + high) / 2
        turned = np.cross(_in_space(arms), _in_space(forces))
        moment = float(np.linalg.norm(comm.allreduce(turned.sum(axis=0)))) / (total * size)
    return PairBalance(
        sums[0], sums[1], float(np.linalg.norm(sums[0] + sums[1] + both)) / total, moment
    )


def _apart(s: DiscreteSurface, x: npt.NDArray[np.float64]) -> float:
    """The largest distance of a node of the slave from the point opposite. Collective.

    Args:
        s: the pair.
        x: positions of the local nodes (n, dim).
    """
    opposite = s.opposite_nodes
    assert opposite is not None
    on = (opposite.rows >= 0) & ~opposite.none
    off = np.linalg.norm((s.opposite(x) - x)[on], axis=1)
    return float(s.comm.allreduce(float(np.max(off, initial=0.0)), op=max))


def _in_space(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Three components."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


@dataclass(frozen=True)
class RigidBodyResult:
    """A rigid body at a solution.

    Forces act on the rigid body, moments about its reference point. In the components of its motion
    that are free contact and load balance, in the others the support takes what is left:
    contact + load + support = 0.

    Attributes:
        name: of the body.
        components: names of the components of its motion.
        motion: displacement and rotation by component.
        contact: force and moment by contact on all surfaces that touch it.
        load: given forces and moments, zero where the motion is prescribed.
        support: reaction of what is prescribed, zero where the motion is free.
        dim: 2 or 3.
    """

    name: str
    components: tuple[str, ...]
    motion: Array
    contact: Array
    load: Array
    support: Array
    dim: int

    @property
    def displacement(self) -> Array:
        """Of the reference point (dim,)."""
        return self.motion[: self.dim]

    @property
    def rotation(self) -> Array:
        """About the reference point, in radians: (1,) in 2D, (3,) in 3D."""
        return self.motion[self.dim :]

    @property
    def force(self) -> Array:
        """Contact force on the body (dim,)."""
        return self.contact[: self.dim]

    @property
    def moment(self) -> Array:
        """Contact moment on the body: (1,) in 2D, (3,) in 3D."""
        return self.contact[self.dim :]

    def summary(self) -> dict[str, Any]:
        """Numbers by component for `summary.json`."""
        return {
            name: {c: float(v) for c, v in zip(self.components, values, strict=True)}
            for name, values in (
                ("motion", self.motion),
                ("contact", self.contact),
                ("load", self.load),
                ("support", self.support),
            )
        }


def rigid_body_results(eq: ContactEquations, state: Evaluation) -> dict[str, RigidBodyResult]:
    """The rigid bodies at a state with reactions, by name."""
    found = {}
    rigid = eq.rigid
    assert state.pushes is not None
    loads = rigid.loads()
    support = np.where(rigid.fixed, -state.pushes, 0.0)
    for b in rigid.bodies:
        contact, load, held = (
            rigid.forces_of_body(v, b) + 0.0 for v in (state.pushes, loads, support)
        )
        motion = rigid.of_body(state.q, b)
        found[b.name] = RigidBodyResult(b.name, b.components, motion, contact, load, held, b.dim)
    return found
