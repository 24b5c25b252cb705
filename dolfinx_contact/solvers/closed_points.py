# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Closed nodes and points in a multigrid hierarchy of the stiffness.

On a rigid obstacle, closed nodes are fixed. Closed nodes of two bodies move together. Coarse levels
must represent this; therefore the hierarchy is built from

    K + B_c^T kappa B_c

where B_c contains the rows of B at the closed points. The spring of a point is as stiff as the
nodes that it joins, in series: kappa = 1 / sum_k b_k^2 / K_kk, times its share of the area of a
node if there are more points than nodes. Stiffer springs impair the smoother. The remaining
compliance across one layer of cells is corrected by the exact solve on the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Indices, Ints, Mask
from dolfinx_contact._geometry import ratio
from dolfinx_contact._mpi import SharedValues, count_of
from dolfinx_contact._petsc import Entries, destroy, matrix_of, triplets
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation
from dolfinx_contact.laws.status import closed
from dolfinx_contact.points.trace import at_global_places, facet_closures

__all__ = ["ClosedPoints"]


@dataclass(frozen=True)
class ClosedPoints:
    """Nodes and points that a hierarchy treats as closed.

    Attributes:
        fixed: mask of owned displacement dofs of nodes in contact with an obstacle.
        joined: masks of closed points of this rank, one per contact pair.
        guessed: whether closed nodes are guessed because a surface has no closed point.
    """

    fixed: Mask
    joined: list[Mask]
    guessed: bool

    @classmethod
    def of(cls, eq: ContactEquations, evaluation: Evaluation) -> ClosedPoints:
        """Return the closed nodes and points, guessed for surfaces without any. Collective."""
        V = eq.V
        bs = V.dofmap.index_map_bs
        nodes: list[Indices] = [np.zeros(0, dtype=np.int32)]
        joined = []
        guessed = False
        for term, contact in zip(eq.terms, evaluation.surfaces, strict=True):
            s = term.surface
            points = closed(contact.statuses)
            touching = count_of(eq.comm, points) > 0
            guessed = guessed or not touching
            # Too many closed nodes cost less than too few.
            reach = eq.constraints.reach(s, evaluation.u) or np.inf
            if s.between_bodies:
                gaps = term.gaps(evaluation) if s.slides else s.points.data.gap
                joined.append(points if touching else gaps <= reach)
                continue
            vertices = s.points.at_vertices(points.astype(float)) > 0.5
            if not touching:
                vertices = s.points.vertex_gaps <= reach
            nodes.append(s.points.vertex_nodes[vertices])
        at_vertices = SharedValues(V.dofmap.index_map).marked(np.concatenate(nodes))
        marked = at_vertices.copy()
        for s in eq.surfaces:
            if s.degrees[0] > 1 and not s.between_bodies:
                closures = facet_closures(V, s.submesh.parent_facets)
                whole = at_vertices[closures].sum(axis=1) >= V.mesh.geometry.dim
                marked[closures[whole]] = True
        return cls(np.repeat(marked[: V.dofmap.index_map.size_local], bs), joined, guessed)

    def differs(self, other: ClosedPoints | None) -> bool:
        """Return whether the closed nodes or points differ from ``other`` on this rank."""
        if other is None or bool((self.fixed != other.fixed).any()):
            return True
        pairs = zip(self.joined, other.joined, strict=True)
        return any(bool((a != b).any()) for a, b in pairs)

    def springs(
        self, equations: ContactEquations, stiffness: PETSc.Mat, evaluation: Evaluation
    ) -> PETSc.Mat | None:
        """Return the stiffness of springs at closed points, or None without pairs. Collective.

        The springs join opposing nodes of both bodies, in the numbering of the stiffness of the
        body.

        Args:
            equations: contact problem.
            stiffness: stiffness of the body.
            evaluation: evaluation with the operators from displacements to jumps.
        """
        pairs = [i for i, s in enumerate(equations.surfaces) if s.between_bodies]
        if not pairs:
            return None
        dim = equations.dim
        diagonal = stiffness.getDiagonal()
        compliance = 1.0 / diagonal.array_r.reshape(-1, dim).mean(axis=1)
        diagonal.destroy()
        found = []
        for i, points in zip(pairs, self.joined, strict=True):
            s = equations.surfaces[i]
            whole = s.points.from_vertices(s.points.geometry.vertex_areas)
            operator = evaluation.surfaces[i].kinematics.operator
            B = operator.scalar_matrix(equations.comm, len(compliance))
            found.append(_springs(B, points * operator.areas / whole, compliance))
            B.destroy()
        rows, columns, values = (np.concatenate(part) for part in zip(*found, strict=True))
        along = np.arange(dim)
        entries = Entries(*((dim * at[:, None] + along).reshape(-1) for at in (rows, columns)))
        A = matrix_of(equations.comm, stiffness.getLocalSize(), entries)
        entries.add(np.repeat(values, dim), A)
        return A


def _springs(B: PETSc.Mat, share: Array, compliance: Array) -> tuple[Ints, Ints, Array]:
    """Return springs at joined points as rows, columns, values of matrix entries. Collective.

    Args:
        B: scalar matrix from nodes to points with the weights of the jumps; its rows are scaled.
        share: ratio of the area of each joined point to the area of a node, shape (n,).
        compliance: compliance of the owned nodes.
    """
    points, nodes, b = triplets(B)
    soft = at_global_places(B.comm.tompi4py(), compliance, nodes)
    local = points - B.getOwnershipRange()[0]
    total = np.bincount(local, b**2 * soft, len(share)).astype(np.float64)
    scale = B.createVecLeft()
    scale.array[:] = np.sqrt(ratio(share, total))
    B.diagonalScale(L=scale)
    joined = B.transposeMatMult(B)
    springs = triplets(joined)
    destroy(scale, joined)
    return springs
