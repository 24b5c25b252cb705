# SPDX-License-Identifier: LGPL-3.0-or-later
"""States that solve the equations and that no body can be in."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact.body.deformation import smallest_jacobian
from dolfinx_contact.equations.contact import ContactEquations

__all__ = ["diverged", "inverted"]

_FAR = 1e5  # sizes of the body, a displacement that is no equilibrium


def diverged(equations: ContactEquations, x: PETSc.Vec) -> str:
    """Which motion is beyond all measure, in words; "" if none is. Collective.

    Where loads have no equilibrium a body slides away, and residuals that are relative to nodal
    forces of such displacements say nothing any more.
    """
    parts = equations.blocks(x)
    values = np.array([np.max(np.abs(v), initial=0.0) for v in (parts[0], parts[-1])])
    body, rigid = equations.comm.allreduce(values, op=np.maximum) / equations.body_size
    if max(body, rigid) <= _FAR:
        return ""
    which = "the body" if body >= rigid else "a rigid body"
    return (
        f"{which} goes away, by {max(body, rigid):.1e} times the size of the body: nothing holds "
        "it against the loads"
    )


def inverted(equations: ContactEquations, x: PETSc.Vec) -> str:
    """Where a hyperelastic body is turned inside out, in words; "" if nowhere. Collective."""
    if equations.bulk.linear:
        return ""
    u = equations.displacement(x)
    smallest, place = smallest_jacobian(
        equations.V, u, vertices=False, axisymmetric=equations.axisymmetric
    )
    if smallest > 0:
        return ""
    where = ", ".join(f"{c:.4g}" for c in place)
    return f"its solution has det F = {smallest:.3g} at ({where})"
