# SPDX-License-Identifier: LGPL-3.0-or-later
"""How far a state is from a solution, block by block and in physical measures.

Forces are compared with the largest nodal force at work (reactions, contact forces, the first
residual), gaps and slips with the largest displacement. So the test does not change with the units
of the input, and a small contact row cannot hide behind a large force row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem

__all__ = ["Measures", "Scales"]


@dataclass(frozen=True)
class Measures:
    """Relative residuals, each a largest entry over all ranks.

    Attributes:
        force: equilibrium of the free nodes, over the force scale.
        constraint: Dirichlet data, gap of closed and slip of stuck points, over the length scale.
        cone: traction of open and shear of slipping points off the law, over the force scale.
    """

    force: float
    constraint: float
    cone: float

    @property
    def worst(self) -> float:
        """The largest of the three; NaN if one is."""
        return float(np.max([self.force, self.constraint, self.cone]))


class Scales:
    """Force and length scales of one solve; they only grow.

    Args:
        problem: the contact problem.
    """

    def __init__(self, problem: ContactProblem):
        self._problem = problem
        self.force = self.length = 0.0

    def measure(self, b: PETSc.Vec) -> Measures:
        """Measures of the residual ``b`` of the state in the problem's Functions. Collective."""
        p = self._problem
        parts = p.blocks(b)
        fixed = p.constraints.fixed.reshape(-1)[: len(parts[0])]
        force, dirichlet = _largest(parts[0][~fixed]), _largest(parts[0][fixed])
        first = force if self.force == 0.0 else 0.0
        forces = [first, _largest(p.reactions[fixed])]
        lengths = [_largest(p.u.x.array), dirichlet / p.stiffness_scale]
        constraint, cone = [dirichlet / p.stiffness_scale], [0.0]
        start = 1
        for s in p.surfaces:
            rows = s.row_measures(parts[start])
            constraint.append(rows.length)
            cone.append(rows.force)
            forces.append(rows.contact_force)
            lengths.append(float(np.max(-s.vertex_gaps, initial=0.0)))
            start += len(s.unknowns)
            if s.average is not None:
                constraint.append(_largest(parts[start - 1] / s.mean_augmentation))
        values = np.array([max(forces), max(lengths), force, max(constraint), max(cone)])
        # np.maximum carries NaN over to every rank.
        values = p.comm.allreduce(values, op=np.maximum)
        self.force = max(self.force, float(values[0]))
        self.length = max(self.length, float(values[1]), 1e-14 * p.body_size)
        force_scale = max(self.force, p.round_off_force(self.length))
        return Measures(values[2] / force_scale, values[3] / self.length, values[4] / force_scale)


def _largest(values: npt.NDArray[Any]) -> float:
    return float(np.max(np.abs(values), initial=0.0))
