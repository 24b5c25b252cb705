# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a solve found, in the signs and names of the output tables.

Gap ``un`` >= 0, ``ut`` the tangential displacement; ``rn`` >= 0 and ``rt`` are forces on the body
at contact points, ``pressure`` and ``shear`` the same per area. In 2D the scalars ``ut``, ``rt``
and ``shear`` are along t = (-n_y, n_x), n pointing from the body into the obstacle; in 3D they are
norms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.solvers.history import Attempt, Step
    from dolfinx_contact.surface import ContactSurface

__all__ = ["ContactTable", "Result", "by_coordinates", "collect"]


@dataclass(frozen=True)
class ContactTable:
    """Contact points of one surface, all ranks, in order of coordinates (x, then y, then z).

    Attributes:
        name: of the surface.
        dim: 2 or 3.
        x: positions (n, dim).
        area: area (length in 2D) of each point.
        un: gap.
        ut: tangential displacement (n, dim).
        n: normals (n, dim).
        force: force on the body (n, dim).
        pressure: contact pressure.
        shear: tangential traction on the body (n, dim).
        letters: status, one letter a point: o, k, + or - (2D), s (3D), d.
        bound: radius of the friction disc, a force.
    """

    name: str
    dim: int
    x: npt.NDArray[np.float64]
    area: npt.NDArray[np.float64]
    un: npt.NDArray[np.float64]
    ut: npt.NDArray[np.float64]
    n: npt.NDArray[np.float64]
    force: npt.NDArray[np.float64]
    pressure: npt.NDArray[np.float64]
    shear: npt.NDArray[np.float64]
    letters: npt.NDArray[np.str_]
    bound: npt.NDArray[np.float64]

    @property
    def rn(self) -> npt.NDArray[np.float64]:
        """Normal forces, positive in compression."""
        return -np.sum(self.force * self.n, axis=1)

    @property
    def rt(self) -> npt.NDArray[np.float64]:
        """Tangential forces (n, dim)."""
        return self.force + self.rn[:, None] * self.n

    @property
    def status(self) -> str:
        """All letters in one string."""
        return "".join(self.letters)

    def count(self, letters: str) -> int:
        """Number of points whose letter is one of ``letters``."""
        return int(np.isin(self.letters, list(letters)).sum())

    def along(self, vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Tangential ``vectors`` as scalars: along t in 2D, norms in 3D."""
        if self.dim == 2:
            return np.asarray(-vectors[:, 0] * self.n[:, 1] + vectors[:, 1] * self.n[:, 0])
        return np.asarray(np.linalg.norm(vectors, axis=1))

    def kkt_violation(self, force: float, length: float) -> float:
        """Worst violation of the contact law, forces over ``force`` and lengths over ``length``.

        Gap, pressure, complementarity, friction disc and slip direction, at the contact points that
        are not clamped. In the integral method, whose conditions are weak, it measures the
        discretisation as well.
        """
        free = self.letters != "d"
        area = self.area[free]
        un, ut, radius = self.un[free], self.ut[free], self.bound[free]
        rn, rt = self.pressure[free] * area, self.shear[free] * area[:, None]
        slide = np.linalg.norm(ut, axis=1)
        size = np.linalg.norm(rt, axis=1)
        # A sliding point has rt = -radius ut/|ut|; weighted by the slide, so that it is continuous.
        against = np.linalg.norm(rt * slide[:, None] + radius[:, None] * ut, axis=1)
        violations = [
            np.maximum(-un, 0) / length,
            np.maximum(-rn, 0) / force,
            np.abs(un * rn) / (length * force),
            np.maximum(size - radius, 0) / force,
            against / (length * force),
        ]
        return float(max(np.max(v, initial=0.0) for v in violations))


@dataclass(frozen=True)
class Result:
    """A solution and how it was found.

    Attributes:
        tables: contact points by surface name.
        attempts: strategies tried; the last one converged.
        energies: ``bulk`` (the energy that the user gave, load potential included, if it was one)
            and ``friction``, the work -rt.ut of friction.
        kkt_violation: worst violation of the contact law, relative.
        dofs: number of unknowns, multipliers included.
    """

    tables: dict[str, ContactTable]
    attempts: list[Attempt]
    energies: dict[str, float]
    kkt_violation: float
    dofs: int

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
        kinds = {"open": "o", "stick": "k", "slip": "+-s", "clamped": "d"}
        return {k: sum(t.count(v) for t in self.tables.values()) for k, v in kinds.items()}

    @property
    def resultants(self) -> dict[str, npt.NDArray[np.float64]]:
        """Force on the body by surface name."""
        return {name: t.force.sum(axis=0) for name, t in self.tables.items()}

    def summary(self) -> dict[str, Any]:
        """Scalars for `summary.json`."""
        tables = self.tables.values()
        rt = sum(t.rt.sum(axis=0) for t in tables)
        names = ("sum_rt_x", "sum_rt_y", "sum_rt_z")
        counts = self.counts
        return {
            "converged": self.converged,
            "newton_iterations": self.iterations,
            "strategy": self.reason,
            "dofs": self.dofs,
            "sum_rn": float(sum(t.rn.sum() for t in tables)),
            **{k: float(v) for k, v in zip(names, np.asarray(rt), strict=False)},
            "open": counts["open"],
            "stick": counts["stick"],
            "slip": counts["slip"],
            "clamped": counts["clamped"],
            "kkt_violation": self.kkt_violation,
        }


def collect(problem: ContactProblem, x: PETSc.Vec, attempts: Sequence[Attempt]) -> Result:
    """The result at the solution ``x``, which is left in the problem's Functions. Collective."""
    b = problem.create_vector()
    problem.residual(x, b)
    b.destroy()
    tables = {
        s.name: _table(problem, s, clamped)
        for s, clamped in zip(problem.surfaces, problem.constraints.clamped, strict=True)
    }
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
    force = max(force, problem.round_off_force(u))
    violation = max(t.kkt_violation(force or 1.0, u or 1.0) for t in tables.values())
    return Result(tables, list(attempts), energies, violation, x.getSize())


def _table(
    problem: ContactProblem, s: ContactSurface, clamped: npt.NDArray[np.bool_]
) -> ContactTable:
    state, n = s.state(), s.num_owned_points
    area, normal, traction = state["area"][:n], state["n"][:n], state["traction"][:n]
    letters = s.status.letters(s.dim)[:n]
    force = traction * area[:, None]
    if s.method != "integral":
        held = clamped[:n]
        letters = np.where(held, "d", letters)
        force = np.where(held[:, None], problem.support_forces(s)[:n], force)
        traction = np.where(held[:, None], force / area[:, None], traction)
    pressure = -np.sum(traction * normal, axis=1)
    columns = {
        "x": state["x"][:n],
        "area": area,
        "un": state["un"][:n] + 0.0,
        "ut": state["ut"][:n],
        "n": normal,
        "force": force,
        "pressure": pressure,
        "shear": traction + pressure[:, None] * normal,
        "letters": letters,
        "bound": s.friction_bound()[:n] * area,
    }
    gathered = {k: np.concatenate(s.comm.allgather(v)) for k, v in columns.items()}
    order = by_coordinates(gathered["x"])
    return ContactTable(s.name, s.dim, **{k: v[order] for k, v in gathered.items()})


def by_coordinates(x: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Order by x, then y, then z, blind to round-off."""
    size = np.ptp(x, axis=0).max(initial=0.0) or 1.0
    rounded = np.round((x - x.min(axis=0)) / size, 9)
    return np.lexsort(rounded.T[::-1])
