# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a solve found: tables of contact points, resultants of all forces, and checks of the state.

Contact and support are apart: no resultant, sum or energy of contact contains a reaction of
Dirichlet data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from dolfinx_contact.balance import balance
from dolfinx_contact.checks import misfits, warn_of_inversion
from dolfinx_contact.laws import status
from dolfinx_contact.tables import ContactTable, by_coordinates, contact_table

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.solvers.history import Attempt, Step

__all__ = ["ContactTable", "Result", "by_coordinates", "collect"]

_NOTHING = 1e-12  # of the body's size, a displacement that is none


@dataclass(frozen=True)
class Result:
    """A solution and how it was found.

    Attributes:
        tables: contact points by surface name.
        attempts: strategies tried; the last one converged.
        energies: ``bulk`` (the energy that the user gave, load potential included, if it was one)
            and ``friction``, the work -rt.ut of friction at contact points.
        kkt_violation: worst violation of the contact law, relative.
        dofs: number of unknowns, multipliers included.
        support: resultant of the reactions of all Dirichlet data on the body (dim,).
        external: resultant of all else that acts on it: loads and springs of the bulk form (dim,).
        imbalance: |contact + support + external| over the sum of the sizes of all forces, each
            taken from a source of its own (`balance`). Moments are not compared.
        misfits: by surface name, the length by which the gap of the law is off at the displaced
            contact points (`checks.misfits`); None if the obstacle does not say.
        min_det_F: the smallest det(I + grad u) of a body that is not linear in u, else None.
    """

    tables: dict[str, ContactTable]
    attempts: list[Attempt]
    energies: dict[str, float]
    kkt_violation: float
    dofs: int
    support: npt.NDArray[np.float64]
    external: npt.NDArray[np.float64]
    imbalance: float
    misfits: dict[str, float | None]
    min_det_F: float | None

    @property
    def converged(self) -> bool:
        """True: a failed solve raises."""
        return self.attempts[-1].converged

    @property
    def reason(self) -> str:
        """Which strategy converged."""
        return self.attempts[-1].strategy

    @property
    def iterations(self) -> int:
        """Newton iterations of all attempts."""
        return sum(a.iterations for a in self.attempts)

    @property
    def history(self) -> list[Step]:
        """Newton iterates of the attempt that converged."""
        return self.attempts[-1].steps

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of open, stuck, slipping and clamped points over all surfaces."""
        return status.count("".join(t.status for t in self.tables.values()))

    @property
    def resultants(self) -> dict[str, npt.NDArray[np.float64]]:
        """Contact force on the body by surface name, without reactions of Dirichlet data."""
        return {name: t.force.sum(axis=0) for name, t in self.tables.items()}

    @property
    def misfit(self) -> float | None:
        """The largest of `misfits`, a length; None if no obstacle says."""
        return max((v for v in self.misfits.values() if v is not None), default=None)

    def summary(self) -> dict[str, Any]:
        """Scalars for `summary.json`."""
        tables = self.tables.values()
        rt = sum(t.rt.sum(axis=0) for t in tables)
        counts = self.counts

        return {
            "converged": self.converged,
            "newton_iterations": self.iterations,
            "strategy": self.reason,
            "dofs": self.dofs,
            "sum_rn": float(sum(t.rn.sum() for t in tables)),
            **{f"sum_rt_{i}": float(v) for i, v in zip("xyz", np.asarray(rt), strict=False)},
            "support": self.support.tolist(),
            "external": self.external.tolist(),
            "force_imbalance": self.imbalance,
            "open": counts["open"],
            "stick": counts["stick"],
            "slip": counts["slip"],
            "clamped": counts["clamped"],
            "kkt_violation": self.kkt_violation,
            "misfit": self.misfit,
            "min_det_F": self.min_det_F,
        }


def collect(problem: ContactProblem, x: PETSc.Vec, attempts: Sequence[Attempt]) -> Result:
    """The result at the solution ``x``, which is left in the problem's Functions. Collective.

    What is to be doubted in it is logged as warnings, on rank 0 only.
    """
    b = problem.create_vector()
    problem.residual(x, b)
    b.destroy()
    tables = {s.name: contact_table(problem, s) for s in problem.surfaces}
    energies = {}
    if problem.energy_form is not None:
        local = float(np.real(fem.assemble_scalar(problem.energy_form)))
        energies["bulk"] = problem.comm.allreduce(local)
    energies["friction"] = float(-sum(np.sum(t.rt * t.ut) for t in tables.values()))
    force = max(
        max(float(np.max(np.abs(t.force), initial=0.0)) for t in tables.values()),
        problem.comm.allreduce(float(np.max(np.abs(problem.reactions), initial=0.0)), op=max),
    )
    u = problem.comm.allreduce(float(np.max(np.abs(problem.u.x.array), initial=0.0)), op=max)
    # Below that all is round-off.
    length = max(u, _NOTHING * problem.body_size)
    force = max(force, problem.round_off_force(u), problem.stiffness_scale * length * _NOTHING)
    forces = balance(problem, tables.values(), u)
    return Result(
        tables,
        list(attempts),
        energies,
        max(t.kkt_violation(force, length) for t in tables.values()),
        x.getSize(),
        forces.support,
        forces.external,
        forces.imbalance,
        misfits(problem),
        warn_of_inversion(problem),
    )
