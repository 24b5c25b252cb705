# SPDX-License-Identifier: LGPL-3.0-or-later
r"""The reduced problem of a linear body that Dirichlet data hold, in 2D and 3D.

With the stiffness K of the body (Dirichlet rows and columns put in) and the points' jumps B u, unit
forces at the points give the compliance A = B K^-1 B^T, and the body without contact its free
displacement c. In the frames of the points a = A r + c, hence S = A^-1 and p = S c of
`algorithms.ReducedContact`. The problem is dense, small, and the same on every rank.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._errors import require
from dolfinx_contact._factor import BATCH
from dolfinx_contact._petsc import staged
from dolfinx_contact.algorithms.reduced_contact import ReducedContact
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.measures import Scales
from dolfinx_contact.equations.parametric import ParametricEquations
from dolfinx_contact.laws import Coulomb, Frictionless, Tresca
from dolfinx_contact.points.surface import ContactSurface
from dolfinx_contact.reduced.gathered import GatheredPoints

__all__ = ["Compliance", "check_reducible"]

Array = npt.NDArray[np.float64]
_SYMMETRIC = 1e-8  # of the largest entry of a compliance


def check_reducible(eq: ContactEquations) -> None:
    """Raise ``ValueError`` if a problem has no reduced one of the usual laws. Collective."""
    laws = [s.law for s in eq.surfaces]
    known = all(isinstance(law, Coulomb | Tresca | Frictionless) for law in laws)
    alone = all(s.points.E is None for s in eq.surfaces)
    parts = [
        (r[: s.points.number].any(axis=1) & ~c[: s.points.number])
        for s, r, c in zip(eq.surfaces, eq.constraints.removed, eq.constraints.clamped, strict=True)
    ]
    guided = eq.comm.allreduce(int(any(part.any() for part in parts)))
    trace = np.concatenate([s.points.vertex_trace_dofs for s in eq.surfaces])
    shared = eq.comm.allreduce(int(len(np.unique(trace)) < len(trace)))
    for ok, what in (
        (known, "the law of Coulomb or Tresca, or none of friction"),
        (alone, "contact at the nodes (nodal or mixed)"),
        (eq.bulk.linear, "a body that is linear"),
        (eq.linear or not eq.bulk.linear, "small sliding on curved obstacles"),
        (len(eq.scaling.loose.of_body) == 0, "a body that Dirichlet data hold"),
        (eq.dim == 2 or not guided, "contact nodes that Dirichlet data do not hold in part"),
        (not shared, "surfaces without common nodes"),
        (eq.rigid.size == 0, "obstacles without unknowns of their own"),
    ):
        require(eq.comm, ok, f"the reduced problem needs {what}; take Newton's method")


class Compliance:
    """A contact problem on its points, by the compliance. Collective.

    Args:
        system: the problem; `check_reducible` must hold.
        x: state at which it is taken; where the body is linear it does not matter.
        solve: K^-1 of columns (owned, k), in which Dirichlet rows are 0.

    Attributes:
        contact: the reduced problem, its points in the order of their coordinates.
        points: those.
    """

    @staged("ContactCondensation")
    def __init__(self, system: ParametricEquations, x: PETSc.Vec, solve: Callable[[Array], Array]):
        eq: ContactEquations = system.equations
        self.comm = eq.comm
        self._equations = eq
        self._solve = solve
        self._n = eq.owned_sizes[0]
        self._x = x.copy()
        b = x.duplicate()
        self.points = points = GatheredPoints(system)
        scales = Scales(eq)
        state = eq.residual(x, b)
        scales.measure(state)
        self._x.array[self._n :] = 0.0
        self._relax(self._x)
        free = self.displacements(self._x)
        m = points.number
        d = eq.dim
        T = points.frames
        A = self._jumps_by_forces().reshape(m, d, m, d)
        A = np.einsum("iap,iajb,jbq->ipjq", T, A, T).reshape(m * d, m * d)
        size = float(np.abs(A).max())
        require(
            self.comm,
            bool(np.abs(A - A.T).max() <= _SYMMETRIC * size),
            "the reduced problem needs a symmetric stiffness; take Newton's method",
        )
        held = np.diag(A) <= 1e-12 * size  # prescribed tangents, which no force moves
        A[held, held] = float(np.diag(A)[~held].mean())
        S = np.asarray(np.linalg.inv(0.5 * (A + A.T)), dtype=np.float64)
        r = points.gathered(np.concatenate([s.points.data.r for s in eq.surfaces]))
        place = points.gathered(np.concatenate([s.positions for s in eq.surfaces]))
        self.contact = ReducedContact(
            S,
            S @ free.reshape(-1),
            points.friction,
            points.bound,
            r * points.areas,
            scales.force,
            # A body that contact holds everywhere does not move: then the load tells.
            max(scales.length, float(np.abs(free).max())),
            place,
        )
        b.destroy()

    def _relax(self, x: PETSc.Vec) -> None:
        """Bring the body to rest under the tractions in ``x``. Collective."""
        b = x.duplicate()
        self._equations.residual(x, b)
        x.array[: self._n] -= self._solve(b.array_r[: self._n, None])[:, 0]
        b.destroy()

    def _jumps_by_forces(self) -> Array:
        """B K^-1 B^T, Cartesian, in the order of the points. Collective."""
        eq = self._equations
        points = self.points
        d = self._equations.dim
        counts = [s.points.number for s in eq.surfaces]
        starts = np.concatenate([[0], np.cumsum(counts)])
        places = np.full(starts[-1], -1)
        places[points.local] = points.mine
        fixed = np.flatnonzero(eq.fixed[: self._n])
        size = d * points.number
        found = np.zeros((size, size))
        for a in range(0, size, BATCH):
            columns = range(a, min(a + BATCH, size))
            load = np.zeros((self._n, len(columns)))
            for k, column in enumerate(columns):
                here = np.flatnonzero(places == column // d)
                for s, first, last in zip(eq.surfaces, starts[:-1], starts[1:], strict=True):
                    force = np.zeros((last - first, d))
                    force[here[(here >= first) & (here < last)] - first, column % d] = 1.0
                    load[:, k] += s.points.forces(force / s.points.areas[:, None])
            load[fixed] = 0.0
            u = self._solve(load)
            for k, column in enumerate(columns):
                jumps = np.concatenate([self._product(s, u[:, k]) for s in eq.surfaces])
                found[:, column] = points.gathered(jumps).reshape(-1)
        return found

    @staticmethod
    def _product(s: ContactSurface, u: Array) -> Array:
        v = s.points.B.createVecRight()
        v.array[:] = u
        values = s.points.product(v)
        v.destroy()
        return np.asarray(values)

    # -- states ----------------------------------------------------------------------------------

    def displacements(self, x: PETSc.Vec) -> Array:
        """Displacements (ut, un) of all points at a state, (m, dim). Collective."""
        eq = self._equations
        offsets = [
            found.jump - s.points.data.gap[:, None] * s.points.data.n
            for s, found in zip(eq.surfaces, eq.contact(x).surfaces, strict=True)
        ]
        jumps = self.points.gathered(np.concatenate(offsets))
        return np.einsum("iap,ia->ip", self.points.frames, jumps)

    def forces(self, x: PETSc.Vec) -> Array:
        """Forces (rt, rn) of all points at a state, (m, dim). Collective."""
        eq = self._equations
        parts = [
            found.traction * s.points.areas[:, None]
            for s, found in zip(eq.surfaces, eq.contact(x).surfaces, strict=True)
        ]
        forces = self.points.gathered(np.concatenate(parts))
        return np.einsum("iap,ia->ip", self.points.frames, forces)

    def expand(self, r: Array, x: PETSc.Vec) -> None:
        """Put the state under forces (m, dim) into ``x``. Collective."""
        eq = self._equations
        points = self.points
        forces = np.einsum("iap,ip->ia", points.frames, r)
        tractions = np.zeros((sum(s.points.number for s in eq.surfaces), eq.dim))
        tractions[points.local] = forces[points.mine] / points.areas[points.mine][:, None]
        self._x.copy(x)
        first = 0
        row = self._n
        for s, unit in zip(eq.surfaces, eq.units[1:-1], strict=True):
            n = s.points.number
            x.array[row : row + n * eq.dim] = tractions[first : first + n].reshape(-1) / unit
            first = first + n
            row = row + n * eq.dim
        self._relax(x)

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._x.destroy()
