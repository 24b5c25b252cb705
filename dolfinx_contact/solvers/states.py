# SPDX-License-Identifier: LGPL-3.0-or-later
"""States that satisfy the equations but are not physical."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._shared import largest
from dolfinx_contact.body.cells import smallest_jacobian
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.laws.status import closed

__all__ = ["diverged", "held_across", "inverted"]

_FAR = 1e5  # sizes of the body, a displacement that is no equilibrium

_ACROSS = 1e-6  # of a unit normal, a component along a held direction


def diverged(equations: ContactEquations, x: PETSc.Vec) -> str:
    """Which motion is beyond all measure, in words; "" if none is. Collective.

    Where loads have no equilibrium a body slides away, and residuals that are relative to nodal
    forces of such displacements are meaningless.
    """
    parts = equations.blocks(x)
    values = np.array([np.max(np.abs(v), initial=0.0) for v in (parts[0], parts[-1])])
    body, rigid = largest(equations.comm, values) / equations.body_size
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


def held_across(eq: ContactEquations, state: Evaluation) -> str:
    """Where the support holds a touching point along its normal, in words; "" if nowhere.

    With friction on a curved obstacle it is held across that alone, where its multiplier has no
    component. Collective.
    """
    for i, (s, found) in enumerate(zip(eq.surfaces, state.surfaces, strict=True)):
        if s.displaced is None or not s.displaced.friction:
            continue
        n = s.points.vertices.dofmap.index_map.size_local
        fixed = np.asarray(eq.constraints.held[i])[s.points.vertex_trace_dofs]
        held = np.where(np.all(fixed, axis=1)[:, None], False, fixed)
        if not eq.comm.allreduce(int(held.any())):
            continue
        touches = s.points.at_vertices(closed(found.statuses).astype(float))[:n]
        normal = s.points.at_vertices(found.data.n)[:n]
        across = np.linalg.norm(np.where(held[:n], normal, 0.0), axis=1)
        worst = float(np.max(np.where(touches > 0, across, 0.0), initial=0.0))
        if eq.comm.allreduce(worst, op=max) > _ACROSS:
            return (
                f"{s.name}: Dirichlet data fix a displacement component of a touching node that "
                "was tangential to the obstacle and is not where it is now, so that friction and "
                "the support cannot be distinguished; fix all components there or leave it free"
            )
    return ""
