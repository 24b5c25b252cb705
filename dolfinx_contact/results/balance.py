# SPDX-License-Identifier: LGPL-3.0-or-later
"""Resultants of the forces on the body, on the two faces of pairs, and on rigid bodies.

The residual of the displacement equations is R = R_bulk - C with the residual R_bulk of the bulk
form and the contact forces C. R vanishes at free dofs and is the reaction of the support at
Dirichlet dofs. Internal forces do no work on translations, so minus the sum of R_bulk is the
resultant of the external forces in the bulk form (loads, springs). For a solution

    contact + support + external = 0,

where contact is summed from the tables, support from R at Dirichlet dofs, and external from the
bulk form. The three are computed independently. Moments are not compared. In a body of revolution
only the axial forces are compared, because radial forces cancel.

In a pair, the contact forces B^T W t act on the nodes of both bodies, with the matrix B from
displacements to jumps, the areas W of the points, and the tractions t. The resultants on the slave
and on the master balance if the rows of B sum to zero; their moments balance if, in addition, the
faces coincide and B reproduces linear fields. Across a gap, shear causes a moment that small
sliding neglects.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import in_space, node_positions
from dolfinx_contact._mpi import maximum, total
from dolfinx_contact.body.rigid import bounding_box
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.measures import round_off_force
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.results.tables import ContactTable, friction_of_supports

__all__ = [
    "Balance",
    "PairBalance",
    "RigidBodyResult",
    "at_conditions",
    "balance",
    "missing_friction",
    "pair_balance",
    "pair_forces",
    "rigid_body_results",
]


_NO_STRAIN = 1e-9  # strain whose stress is round-off
_SAME_PLACE = 1e-9  # distance of coinciding nodes, relative to the size of the faces


@dataclass(frozen=True)
class Balance:
    """Resultants of the forces on a body.

    Attributes:
        support: resultant of the reactions at all Dirichlet dofs, shape (dim,).
        external: resultant of loads and springs in the bulk form, shape (dim,).
        imbalance: norm of the sum of contact, support and external forces, divided by the sum of
            the magnitudes of all forces. Components normal to planes of symmetry at which sliding
            faces are mirrored are excluded.
    """

    support: Array
    external: Array
    imbalance: float


def balance(
    eq: ContactEquations,
    evaluation: Evaluation,
    tables: Iterable[ContactTable],
    supports: Array,
) -> Balance:
    """Compute the balance of forces at a state. Collective.

    Args:
        eq: contact problem.
        evaluation: evaluation with reactions.
        tables: contact tables of all surfaces, in their order.
        supports: reactions of Dirichlet data at the local nodes (`support_at_nodes`).
    """
    comm = eq.comm
    n = eq.V.dofmap.index_map.size_local
    reactions = supports[:n]
    support = _resultant(eq, reactions)
    external = _resultant(eq, -eq.bulk.rows(evaluation.u).reshape(-1, eq.dim))
    contact = np.zeros_like(support)
    size = 0.0
    for s, t in zip(eq.surfaces, tables, strict=True):
        if not s.between_bodies:  # forces between bodies are internal
            contact += t.resultant(t.force)
        size += float(np.linalg.norm(t.force, axis=1).sum())
    size += comm.allreduce(float(np.linalg.norm(reactions, axis=1).sum()))
    size += float(np.linalg.norm(external))
    # Stresses of a strain near zero, (I + grad u) - I, are round-off of the moduli.
    nothing = _NO_STRAIN * eq.scaling.stiffness * eq.body_size
    moved = maximum(comm, np.abs(evaluation.u))
    size = max(size, nothing, round_off_force(eq, moved))
    left = contact + support + external
    for s in eq.surfaces:
        if s.slides:  # planes of symmetry push along their normals
            left[list(s.obstacle.opposite.planes)] = 0.0
    imbalance = float(np.linalg.norm(left)) / size
    return Balance(support, external, imbalance)


def at_conditions(eq: ContactEquations, supports: Array, u: Array) -> tuple[Array, Array]:
    """Return reaction and mean displacement of each Dirichlet condition. Collective.

    A dof may belong to several conditions. Its reaction is attributed to the last of them, whose
    value is used.

    Args:
        eq: contact problem.
        supports: reactions of Dirichlet data at the local nodes (`support_at_nodes`).
        u: displacement at the local dofs.

    Returns:
        Reactions and mean displacements, shape (conditions, dim) each. The displacement is the mean
        over the nodes of the condition; it is NaN in components that the condition does not
        prescribe, and in the radial component of a body of revolution.
    """
    n = eq.owned_sizes[0]
    owner = np.full(n, -1)
    for number, bc in enumerate(eq.bcs):
        dofs = bc.dof_indices()[0]  # DOLFINx counts ghosts among the owned dofs of blocked spaces
        owner[dofs[dofs < n]] = number

    def sums(values: Array) -> Array:
        each = [np.where(owner == k, values, 0.0).reshape(-1, eq.dim) for k in range(len(eq.bcs))]
        return np.array([_resultant(eq, of_one) for of_one in each]).reshape(-1, eq.dim)

    numbers = sums(np.ones(n))
    none = np.full_like(numbers, np.nan)
    means = np.divide(sums(u[:n]), numbers, out=none, where=numbers > 0)
    return sums(supports.reshape(-1)[:n]), means


def _resultant(eq: ContactEquations, forces: Array) -> Array:
    """Return the sum of forces, shape (n, dim), over all ranks. Collective.

    For a body of revolution the radial component is 0.
    """
    whole = total(eq.comm, forces.sum(axis=0))
    return np.where(np.arange(eq.dim) < eq.axisymmetric, 0.0, whole)


# -- pairs and rigid bodies ------------------------------------------------------------------------


@dataclass(frozen=True)
class PairBalance:
    """Contact forces on the two faces of a pair.

    Attributes:
        slave: resultant on the slave, shape (dim,).
        master: resultant on the master, shape (dim,).
        imbalance: norm of the sum of all nodal forces, divided by the sum of their magnitudes.
        moment: norm of the moment of all nodal forces, divided by the sum of their magnitudes and
            by the diagonal of the bounding box of the slave; None for bodies of revolution, and in
            small sliding if the faces do not coincide.
    """

    slave: Array
    master: Array
    imbalance: float
    moment: float | None

    def summary(self) -> dict[str, Any]:
        """Return resultants and imbalances as a dictionary for `summary.json`."""
        return {
            "slave": self.slave.tolist(),
            "master": self.master.tolist(),
            "force_imbalance": self.imbalance,
            "moment_imbalance": self.moment,
        }


def pair_forces(eq: ContactEquations, number: int, evaluation: Evaluation) -> Array:
    """Return the contact forces of a surface at the owned nodes, shape (n, dim). Collective."""
    contact = evaluation.surfaces[number]
    return contact.kinematics.operator.transpose(contact.traction).reshape(-1, eq.dim)


def pair_balance(eq: ContactEquations, number: int, evaluation: Evaluation) -> PairBalance:
    """Compute the balance of the contact forces of a pair at a state. Collective.

    Args:
        eq: contact problem.
        number: index of the pair among the surfaces.
        evaluation: evaluation of the state.
    """
    comm = eq.comm
    s = eq.surfaces[number]
    n = eq.V.dofmap.index_map.size_local
    forces = pair_forces(eq, number, evaluation)
    x = node_positions(eq.V)
    # Nodes at the front of a crack belong to both faces, where the forces cancel.
    slave, master = (side[:n] for side in s.obstacle.opposite.sides)
    sums = [_resultant(eq, forces[a & ~b]) for a, b in ((slave, master), (master, slave))]
    both = _resultant(eq, forces[slave & master])
    whole = comm.allreduce(float(np.linalg.norm(forces, axis=1).sum())) or 1.0
    low, high = bounding_box(comm, x[:n][slave])
    size = float(np.linalg.norm(high - low))
    moment = None
    if s.slides:
        x = x + evaluation.u.reshape(-1, eq.dim)
    if not eq.axisymmetric and (s.slides or _apart(s, x) <= _SAME_PLACE * size):
        arms = x[:n] - (low + high) / 2
        turned = np.cross(in_space(arms), in_space(forces))
        moment = float(np.linalg.norm(comm.allreduce(turned.sum(axis=0)))) / (whole * size)
    return PairBalance(
        sums[0], sums[1], float(np.linalg.norm(sums[0] + sums[1] + both)) / whole, moment
    )


def _apart(s: DiscreteSurface, x: Array) -> float:
    """Return the largest distance between a slave node and its opposing point. Collective.

    Args:
        s: pair.
        x: positions of the local nodes, shape (n, dim).
    """
    opposite = s.obstacle.opposite
    assert opposite is not None
    on = opposite.sides[0] & ~opposite.none
    off = np.linalg.norm((s.opposite(x) - x)[on], axis=1)
    return maximum(s.comm, off)


@dataclass(frozen=True)
class RigidBodyResult:
    """Motion of a rigid body at a solution, and the forces on it.

    Moments are taken about the reference point. The sum contact + load + support is zero. Friction
    along tangents in which Dirichlet data move a contact node belongs to the support of the node
    and is not part of these forces (`missing_friction`).

    Attributes:
        name: name of the body.
        components: names of the components of its motion.
        motion: displacements and rotations (radians), by component.
        contact: contact force and moment of all surfaces touching the body, by component.
        load: applied forces and moments by component, 0 where the motion is prescribed.
        support: reactions to prescribed motions by component, 0 where the motion is free.
        dim: dimension, 2 or 3.
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
        """Displacement of the reference point of the rigid body, shape (dim,)."""
        return self.motion[: self.dim]

    @property
    def rotation(self) -> Array:
        """Rotation of the rigid body in radians, shape (1,) in 2D and (3,) in 3D."""
        return self.motion[self.dim :]

    @property
    def force(self) -> Array:
        """Contact force on the rigid body, shape (dim,)."""
        return self.contact[: self.dim]

    @property
    def moment(self) -> Array:
        """Contact moment about the reference point, shape (1,) in 2D and (3,) in 3D."""
        return self.contact[self.dim :]

    def summary(self) -> dict[str, Any]:
        """Return motion and forces, by component, as a dictionary for `summary.json`."""
        return {
            name: dict(zip(self.components, getattr(self, name).tolist(), strict=True))
            for name in ("motion", "contact", "load", "support")
        }


def rigid_body_results(eq: ContactEquations, evaluation: Evaluation) -> dict[str, RigidBodyResult]:
    """Return the motion of each rigid body and the forces on it at a state, by name."""
    found = {}
    rigid = eq.rigid
    assert evaluation.pushes is not None
    loads = rigid.loads
    support = np.where(rigid.fixed, -evaluation.pushes, 0.0)
    for b in rigid.bodies:
        contact, load, force = (
            rigid.forces_of_body(v, b) + 0.0 for v in (evaluation.pushes, loads, support)
        )
        motion = rigid.of_body(evaluation.q, b)
        found[b.name] = RigidBodyResult(b.name, b.components, motion, contact, load, force, b.dim)
    return found


def missing_friction(eq: ContactEquations, evaluation: Evaluation) -> dict[str, float]:
    """Return the friction missing in the force on each rigid body, relative to that force.

    It is the sum of the sizes of the frictional forces at nodes that Dirichlet data move along the
    body (`friction_of_supports`). Collective.
    """
    missing = dict.fromkeys(eq.rigid.bodies, 0.0)
    for number, s in enumerate(eq.surfaces):
        if s.rigid_body is not None:
            here = float(np.sum(friction_of_supports(eq, number, evaluation)))
            missing[s.rigid_body] += eq.comm.allreduce(here)
    forces = rigid_body_results(eq, evaluation)
    largest = {b: float(np.linalg.norm(forces[b.name].force)) for b in missing}
    return {b.name: v / max(v, largest[b]) if v > 0 else 0.0 for b, v in missing.items()}
