# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of contact points, in the signs and names of the output.

Gap ``un`` >= 0, ``ut`` the tangential displacement; ``rn`` >= 0 and ``rt`` are contact forces on
the body, ``pressure`` and ``shear`` the same per area. In 2D the scalars ``ut``, ``rt`` and
``shear`` are along t = (-n_y, n_x), n pointing from the body into the obstacle; in 3D they are
norms.

What Dirichlet data do to the body at a contact node is not contact: it is ``support``. Where they
fix one component of a node, the others may carry contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from dolfinx_contact.problem import ContactProblem
    from dolfinx_contact.surface import ContactSurface

__all__ = ["ContactTable", "by_coordinates", "contact_table"]


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
        force: contact force on the body (n, dim), 0 where Dirichlet data clamp the point.
        pressure: contact pressure.
        shear: tangential traction on the body (n, dim).
        letters: status, one letter a point: o, k, + or - (2D), s (3D), d.
        bound: radius of the friction disc, a force.
        support: reaction of Dirichlet data on the body at the node (n, dim), 0 in the components
            that none fix; zeros in the integral method, whose points are no nodes. A node that two
            surfaces share has it in the tables of both.
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
    support: npt.NDArray[np.float64]

    @property
    def rn(self) -> npt.NDArray[np.float64]:
        """Normal forces, positive in compression."""
        return -np.sum(self.force * self.n, axis=1) + 0.0

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


def contact_table(problem: ContactProblem, s: ContactSurface) -> ContactTable:
    """The table of a surface at the problem's Functions and last residual. Collective.

    Where Dirichlet data prescribe all of the tangential displacement, the support holds what
    friction would: the bound is 0 there, and the letter that of the prescribed motion.
    """
    number = problem.surfaces.index(s)
    clamped, removed = problem.constraints.clamped[number], problem.constraints.removed[number]
    state, n = s.state(), s.num_owned_points
    area, normal, traction = state["area"][:n], state["n"][:n], state["traction"][:n]
    letters, support = s.status.letters(s.dim)[:n], np.zeros_like(traction)
    bound = s.friction_bound()[:n] * area
    if s.method != "integral":
        held = clamped[:n]
        letters = np.where(held, "d", letters)
        traction = np.where(held[:, None], 0.0, traction)
        support = problem.support_forces(s)[:n]
        guided = (removed[:n].sum(axis=1) == s.dim - 1) & ~held
        bound = np.where(guided, 0.0, bound)
        moved = _letters_of_motion(state["ut"][:n], normal, 1e-12 * problem.body_size)
        letters = np.where(guided & (letters != "o"), moved, letters)
    pressure = -np.sum(traction * normal, axis=1) + 0.0
    columns = {
        "x": state["x"][:n],
        "area": area,
        "un": state["un"][:n] + 0.0,
        "ut": state["ut"][:n],
        "n": normal,
        "force": traction * area[:, None],
        "pressure": pressure,
        "shear": traction + pressure[:, None] * normal,
        "letters": letters,
        "bound": bound,
        "support": support,
    }
    gathered = {k: np.concatenate(s.comm.allgather(v)) for k, v in columns.items()}
    order = by_coordinates(gathered["x"])
    return ContactTable(s.name, s.dim, **{k: v[order] for k, v in gathered.items()})


def _letters_of_motion(
    ut: npt.NDArray[np.float64], n: npt.NDArray[np.float64], least: float
) -> npt.NDArray[np.str_]:
    """The letters of closed points that move along ``ut``, (n, dim), by more than ``least``."""
    size = np.linalg.norm(ut, axis=1)
    sliding: Any = "s"
    if ut.shape[1] == 2:
        sliding = np.where(ut[:, 1] * n[:, 0] - ut[:, 0] * n[:, 1] > 0, "+", "-")
    return np.where(size > least, sliding, "k")


def by_coordinates(x: npt.NDArray[np.float64]) -> npt.NDArray[np.intp]:
    """Order by x, then y, then z, blind to round-off."""
    size = np.ptp(x, axis=0).max(initial=0.0) or 1.0
    rounded = np.round((x - x.min(axis=0)) / size, 9)
    return np.lexsort(rounded.T[::-1])
