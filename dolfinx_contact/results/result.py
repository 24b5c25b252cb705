# SPDX-License-Identifier: LGPL-3.0-or-later
"""Result of a solve: tables of contact points, resultants of all forces, and checks of the state.

Contact forces and supports are separate: resultants, sums and energies of contact never include
reactions of Dirichlet data.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn, TypeAlias, TypeVar

import numpy as np

from dolfinx_contact._arrays import Array, as_text
from dolfinx_contact._mpi import maximum, require
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.equations.measures import (
    Scales,
    fixed_along_normal,
    least_scales,
    local_displacement,
    round_off_force,
    without_normal,
)
from dolfinx_contact.laws import status
from dolfinx_contact.results.balance import (
    PairBalance,
    RigidBodyResult,
    at_conditions,
    balance,
    missing_friction,
    pair_balance,
    rigid_body_results,
)
from dolfinx_contact.results.indicators import Indicators, indicators_of
from dolfinx_contact.results.tables import (
    ContactTable,
    contact_tables,
    support_at_nodes,
    violation,
)
from dolfinx_contact.results.uniqueness import Uniqueness
from dolfinx_contact.solvers.attempts import Attempt, Step

__all__ = ["Named", "Result", "Shown", "collect"]

#: Function of a solution that returns the equations and the evaluation for tables and indicators.
Shown: TypeAlias = Callable[[Evaluation], tuple[ContactEquations, Evaluation]]

_LARGEST_VIOLATION = 1e-4  # largest violation without a warning, relative to the largest force
_LARGEST_IMBALANCE = 1e-6  # largest imbalance without a warning, relative to all forces
_MISSING_FRICTION = 1e-3  # largest one without a warning, relative to the force on a rigid body
_T = TypeVar("_T")


class Named(dict[str, _T]):
    """Dictionary by surface or body name; its ``KeyError`` lists the existing names."""

    def __missing__(self, name: object) -> NoReturn:
        known = ", ".join(map(repr, self)) or "none"
        raise KeyError(f"nothing is named {name!r} here; names: {known}")


@dataclass(frozen=True)
class Result:
    """Result of a solve: numbers and tables of the solution, and solver statistics. Picklable.

    Attributes:
        tables: contact points by surface name.
        attempts: strategies tried; the last one converged.
        energies: ``bulk``, the energy of the bulk form including the load potential (absent if the
            problem was given as a residual), and ``friction``, the frictional dissipation
            -sum(rt.ut) with the tangential forces rt (without adhesion) and the tangential
            displacements ut (their increments in a step of an evolution).
        kkt_violation: largest violation of the contact law, relative to the force and length
            scales.
        dofs: number of unknowns, including multipliers.
        support: resultant of the reactions at all Dirichlet dofs of the body, shape (dim,).
        supports: reaction of each condition of `ContactProblem.bcs`, in this order, shape
            (conditions, dim). The reaction of a dof in several conditions belongs to the last one,
            whose value is used; the rows therefore add up to ``support``.
        support_displacements: mean displacement of the nodes of each condition, shape (conditions,
            dim); NaN in components that the condition does not prescribe.
        external: resultant of the remaining forces on the body, i.e. loads and springs of the bulk
            form, shape (dim,).
        imbalance: norm of the sum of contact, support and external forces over the sum of the
            magnitudes of all forces. The three resultants are computed independently (`balance`).
            Moments are not compared.
        pairs: forces on both faces of every pair of bodies, by name (`balance.PairBalance`).
        indicators: indicators of model validity of the body and of each surface.
        rigid_bodies: motions of the rigid bodies and the forces on them, by name.
        static: whether friction opposes the total slip (the static law); False in a step from a
            state.
        other_warnings: warnings about the data of the problem, the violation of the contact law and
            the imbalance of forces, by name.
    """

    tables: dict[str, ContactTable]
    attempts: list[Attempt]
    energies: dict[str, float]
    kkt_violation: float
    dofs: int
    support: Array
    supports: Array
    support_displacements: Array
    external: Array
    imbalance: float
    pairs: dict[str, PairBalance]
    indicators: Indicators
    rigid_bodies: dict[str, RigidBodyResult]
    static: bool
    other_warnings: dict[str, str]

    def __str__(self) -> str:
        """Return a text with law, strategy, points, forces, residuals and names of warnings."""
        counts = ", ".join(f"{n} {kind}" for kind, n in self.counts.items() if n)
        forces = [*self.resultants.values(), *self.supports, self.external]
        largest = max(float(np.abs(f).max()) for f in forces)
        reactions = ", ".join(_shown(f, largest) for f in self.supports)
        law = "static law" if self.static else "step from a state"
        lines = [
            f"{law}: {self.reason}, {self.iterations} iterations, {self.dofs} unknowns; "
            f"points: {counts}",
            *(
                f"contact force of {name}: {_shown(f, largest)}"
                for name, f in self.resultants.items()
            ),
            f"reactions of Dirichlet data: {reactions or 'none'}; "
            f"loads and springs: {_shown(self.external, largest)}",
            f"violation of the law {self.kkt_violation:.1e}, imbalance {self.imbalance:.1e}",
        ]
        if self.warnings:
            lines.append(f"warnings ({len(self.warnings)}): {', '.join(self.warnings)}")
        return "\n".join(lines)

    @property
    def converged(self) -> bool:
        """Whether the solve converged; always True, because a failed solve raises an error."""
        return self.attempts[-1].converged

    @property
    def reason(self) -> str:
        """Name of the strategy that converged."""
        return self.attempts[-1].strategy

    @property
    def iterations(self) -> int:
        """Total number of Newton iterations of all strategies tried."""
        return sum(a.iterations for a in self.attempts)

    @property
    def history(self) -> list[Step]:
        """Newton iterates of the strategy that converged."""
        return self.attempts[-1].steps

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of open, stuck, slipping and clamped points over all surfaces.

        Clamped points are points without a contact law: points clamped by Dirichlet data, at a
        crack front, at a crossing of pairs, or without an opposing point.
        """
        return status.count("".join(t.status for t in self.tables.values()))

    @property
    def resultants(self) -> dict[str, Array]:
        """Contact force on the body by surface name, without reactions of Dirichlet data.

        For a pair it is the force on the slave; `pairs` has both forces. In a body of revolution
        all resultants are axial, because the radial forces cancel.
        """
        return Named({name: t.resultant(t.force) for name, t in self.tables.items()})

    @property
    def warnings(self) -> dict[str, str]:
        """Texts of all warnings that apply to the solution and its data, by name."""
        return self.other_warnings | self.indicators.warnings

    @property
    def misfit(self) -> float | None:
        """Largest error of the gap in small sliding (`misfit`); None if it was not evaluated."""
        misfits = (s.misfit for s in self.indicators.surfaces.values())
        return max((v for v in misfits if v is not None), default=None)

    @property
    def min_det_F(self) -> float | None:
        """Smallest det(I + grad u); None for linear bodies with small displacements."""
        return self.indicators.min_det_F

    def summary(self, uniqueness: Uniqueness | None = None) -> dict[str, Any]:
        """Return the scalars for `summary.json`.

        Args:
            uniqueness: answer of `ContactProblem.uniqueness`, whose verdict is added to the scalars
                as ``unique``; default: None.
        """
        tables = self.tables.values()
        rt = sum(t.resultant(t.rt) for t in tables)
        counts = self.counts
        bodies = {name: body.summary() for name, body in self.rigid_bodies.items()}
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
            "pairs": {name: pair.summary() for name, pair in self.pairs.items()},
            **counts,
            "kkt_violation": self.kkt_violation,
            "misfit": self.misfit,
            "min_det_F": self.min_det_F,
            **{
                f"{name}_penetration": s.penetration
                for name, s in self.indicators.surfaces.items()
                if s.penetration is not None
            },
            **({"rigid_bodies": bodies} if bodies else {}),
            **({} if uniqueness is None else {"unique": uniqueness.verdict}),
        }


def _shown(vector: Array, largest: float) -> str:
    """Return the components of a force as text; components that are round-off are 0.

    Args:
        vector: components of the force.
        largest: largest force, which determines the magnitude of the round-off.
    """
    return "(" + ", ".join(as_text(v, largest) for v in vector) + ")"


def collect(
    eq: ContactEquations,
    evaluation: Evaluation,
    attempts: Sequence[Attempt],
    shown: Shown | None = None,
) -> Result:
    """Return the result at the solution in the user's Functions. Collective.

    Args:
        eq: equations of the contact problem.
        evaluation: evaluation at the solution, with reactions.
        attempts: strategies that were tried; the last one converged.
        shown: function that maps the evaluation of the solution to the equations and the evaluation
            used for tables and indicators; default: those of the solution. In dynamics, they belong
            to the end of the step, which differs from the solution.

    Raises:
        ValueError: on every rank, if a point touches an obstacle where its normal is undefined.
    """
    assert evaluation.reactions is not None
    lost = without_normal(eq, evaluation) or fixed_along_normal(eq, evaluation)
    require(eq.comm, not lost, lost)
    at = (eq, evaluation) if shown is None else shown(evaluation)
    supports = support_at_nodes(*at)
    tables = contact_tables(*at, supports)
    energy = eq.bulk.energy_at(evaluation.u)
    energies = {} if energy is None else {"bulk": energy}
    energies["friction"] = float(-sum(np.sum(t.friction * t.increment) for t in tables.values()))
    scales = _scales_of_law(eq, evaluation, tables.values())
    forces = balance(eq, evaluation, tables.values(), supports)
    reactions, displacements = at_conditions(at[0], supports, at[1].u)
    violated = violation(eq, evaluation, *scales)
    warnings = dict(eq.warnings)
    if not eq.is_weak and not violated <= _LARGEST_VIOLATION:
        warnings["law"] = (
            f"the law of contact is violated by {violated:.1e} of the forces: "
            "either the law has no status for some states, or snes_rtol is too large"
        )
    if not forces.imbalance <= _LARGEST_IMBALANCE:
        warnings["imbalance"] = (
            f"the forces on the body are out of balance by {forces.imbalance:.1e} of their size; "
            "a smaller snes_rtol may help"
        )
    for name, part in missing_friction(eq, evaluation).items():
        if part > _MISSING_FRICTION:
            warnings[f"friction on {name!r}"] = (
                f"the force on the rigid body lacks friction of {part:.2g} of its size: friction "
                "at nodes that Dirichlet data move along the body belongs to their supports; "
                "replace these data by stiff springs"
            )
    return Result(
        Named(tables),
        list(attempts),
        Named(energies),
        violated,
        sum(eq.unknowns.global_sizes),
        forces.support,
        reactions,
        displacements,
        forces.external,
        forces.imbalance,
        Named(
            {
                s.name: pair_balance(eq, number, evaluation)
                for number, s in enumerate(eq.surfaces)
                if s.between_bodies
            }
        ),
        indicators_of(*at),
        Named(rigid_body_results(eq, evaluation)),
        eq.is_static,
        warnings,
    )


def _scales_of_law(
    eq: ContactEquations, evaluation: Evaluation, tables: Collection[ContactTable]
) -> Scales:
    """Return the force and length scales for the relative violation of a law. Collective."""
    assert evaluation.reactions is not None
    largest = max(float(np.max(np.abs(t.force), initial=0.0)) for t in tables)
    contacts = zip(eq.surfaces, evaluation.surfaces, eq.scaling.at_vertices, strict=True)
    kept = [local_displacement(s, found, stiffness) for s, found, stiffness in contacts]
    force = max(largest, maximum(eq.comm, np.abs(evaluation.reactions)))
    u = max(maximum(eq.comm, np.abs(evaluation.u)), maximum(eq.comm, kept))
    none = least_scales(eq, u)
    return Scales(max(force, round_off_force(eq, u), none.force), max(u, none.length))
