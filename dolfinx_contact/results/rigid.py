# SPDX-License-Identifier: LGPL-3.0-or-later
"""How rigid bodies move, and what acts on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.state import State

__all__ = ["RigidBodyResult", "rigid_body_results"]

Array = npt.NDArray[np.float64]


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


def rigid_body_results(eq: ContactEquations, state: State) -> dict[str, RigidBodyResult]:
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
