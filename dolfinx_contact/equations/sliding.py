# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact terms of the Jacobian for faces sliding over each other.

The contact terms of H depend on the displacements u, the vectors m(u) from which the normals are
computed, and the multipliers l. With D = dm/du the terms of the Jacobian are

    S = S_u + S_m D,

where S_u is the derivative by u and l, and S_m that by m. The pattern contains all candidates and
changes only with a search (`points.sliding`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx_contact._geometry import ratio, transformed
from dolfinx_contact._petsc import Entries, triplets
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import ContactState
from dolfinx_contact.points.sliding.facing import Facing
from dolfinx_contact.points.sliding.operator import SlidingOperator
from dolfinx_contact.points.sliding.points import SlidingPoints

__all__ = ["Numbering", "SlidingTerms"]

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class Numbering(Protocol):
    """Numbering of the unknowns."""

    def places(self, field: int, nodes: Indices) -> Indices:
        """Return places (..., dim) of the dofs of global nodes, -1 for fixed dofs. Collective."""


@dataclass(frozen=True, eq=False)
class _Block:
    """Blocks of entries; rows and columns (n, k, dim) are places.

    Negative places are ignored.
    """

    rows: Indices
    columns: Indices

    def add(self, A: PETSc.Mat, values: Array | None = None) -> None:
        """Add values (n, rows, dim, columns, dim), by default 0, to ``A``, without assembling it.

        Not collective.
        """
        n, r, d = self.rows.shape
        shape = n, r * d, self.columns.shape[1] * d
        rows = self.rows.reshape(shape[:2]).astype(PETSc.IntType)
        columns = self.columns.reshape(n, shape[2]).astype(PETSc.IntType)
        block = np.zeros(shape) if values is None else values.reshape(shape)
        A.setValuesRCV(rows, columns, block, addv=PETSc.InsertMode.ADD_VALUES)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Derivatives at p pieces of the faces; see `points.sliding.facing.Facing` for a, b and c.

    Attributes:
        facet: facets of the slave (p,).
        nodes: global nodes of the facets of the master (p, b).
        signs: signs of the components of the corners of both facets (p, c, dim).
        coupling: forces on both by the multipliers, with the opposite sign (p, a, c).
        on_master: forces on the master by the displacements of both and m (p, b, dim, c + a, dim).
        of_law: contact rows by the same (p, a, dim, c + a, dim).
        means: contact rows by the neighbouring tractions (p, a, a).
    """

    facet: Indices
    nodes: Indices
    signs: Array
    coupling: Array
    on_master: Array
    of_law: Array
    means: Array

    def of_pairs(self, master: Indices) -> _Pieces:
        """Return sums over the pieces of a pair of facets, which are consecutive.

        Args:
            master: facets of the master (p,).
        """
        if not len(master):
            return self
        other = (np.diff(self.facet) != 0) | (np.diff(master) != 0)
        first = np.concatenate([[0], 1 + np.flatnonzero(other)])
        values = self.coupling, self.on_master, self.of_law, self.means
        sums = (np.add.reduceat(v, first, axis=0) for v in values)
        return _Pieces(self.facet[first], self.nodes[first], self.signs[first], *sums)


class SlidingTerms:
    """The terms of one surface. Collective, like its methods.

    Args:
        equations: contact problem.
        number: number of the surface.
        numbering: numbering of the unknowns.
    """

    def __init__(self, equations: ContactEquations, number: int, numbering: Numbering):
        s = equations.surfaces[number]
        assert isinstance(s.points, SlidingPoints)
        self._points = s.points
        self._faces = s.points.faces
        self._comm = equations.comm
        self._dim = s.dim
        self._unit = equations.unknowns.units[number + 1]
        self._numbering = numbering
        self._size = sum(equations.owned_sizes)
        vertices = self._faces.slave_vertices
        self._slave = numbering.places(0, self._faces.slave_nodes)
        self._multipliers = numbering.places(number + 1, vertices)
        self._vectors = s.dim * vertices[..., None] + np.arange(s.dim)
        first = s.points.vertices.dofmap.index_map.local_range[0]
        own = first + np.arange(s.points.number, dtype=np.int64)[:, None]
        self._own = numbering.places(number + 1, own)
        self._own_vectors = s.dim * own[..., None] + np.arange(s.dim)
        self._searches = -1
        self._matrices: list[PETSc.Mat] = []

    @property
    def changed(self) -> bool:
        """Whether a search has changed the candidates since the pattern was set up."""
        return self._faces.whole is None and self._searches != self._faces.searches

    def set_up(self) -> list[Entries]:
        """Create matrices with the pattern of the candidates and return the entries of S."""
        self.destroy()
        n = self._size
        m = self._dim * self._points.number
        found = self._faces.whole or self._faces.found
        facet, master = found.pairs.T
        of_pairs = self._blocks(facet, found.nodes[master])
        shapes = ((n, n), (n, m), (m, n))
        for (rows, columns), blocks in zip(shapes, (*of_pairs, [self._turned]), strict=True):
            A = PETSc.Mat().createAIJ(((rows, None), (columns, None)), comm=self._comm)
            A.setUp()
            for block in blocks:
                block.add(A)
            A.assemble()
            A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
            self._matrices.append(A)
        S, N, D = self._matrices
        self._matrices.append(N.matMult(D))
        self._searches = self._faces.searches
        return [Entries(*triplets(A)[:2]) for A in (S, self._matrices[3])]

    def add(self, state: ContactState, A: PETSc.Mat) -> None:
        """Add S at a state to ``A``, which has its pattern."""
        operator = state.kinematics.operator
        assert isinstance(operator, SlidingOperator)
        at = self._at(state, operator)
        k = self._slave.shape[1]
        rates = self._faces.normal_rates(operator.x)
        images = self._faces.images[self._faces.corners]
        turned = images[:, :, :, None, None] * np.repeat(rates[:, None], k, axis=1)
        S, N, D, product = self._matrices
        places = (*self._blocks(at[0].facet, at[0].nodes), [self._turned])
        given = (*self._values(*at), [turned])
        for matrix, blocks, values in zip((S, N, D), places, given, strict=True):
            matrix.zeroEntries()
            for block, value in zip(blocks, values, strict=True):
                block.add(matrix, value)
            matrix.assemble()
        N.matMult(D, product)
        for matrix in (S, product):
            A.axpy(1.0, matrix, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)

    def destroy(self) -> None:
        """Free the matrices."""
        for A in self._matrices:
            A.destroy()
        self._matrices = []

    # -- parts -----------------------------------------------------------------------------------

    def _at(self, state: ContactState, operator: SlidingOperator) -> tuple[_Pieces, Array, Array]:
        """Return derivatives at pieces, and derivatives of contact rows by l and m at vertices."""
        facing, faces = operator.facing, self._faces
        n, nodal = operator.number, facing.nodal
        areas = self._points.areas
        counts = areas * nodal.share[:n]
        at = faces.corners[facing.facet]

        def at_corners(values: Array) -> Array:
            return np.asarray(faces.vertices.from_owners(values)[at])

        # contact rows by the gap, slip and spin of their node, and by its traction and normal
        by_jump = ratio(counts, nodal.weight[:n])[:, None, None] * state.by_jump
        by_gap = at_corners(transformed(by_jump, nodal.normal[:n]))
        by_slip = at_corners(-by_jump @ nodal.rotation[:n]) * faces.kept[at][:, :, None]
        of_traction = areas[:, None, None] * np.eye(self._dim)
        of_traction = of_traction - counts[:, None, None] * state.by_traction
        turned = state.by_jump @ nodal.by_turning[:n] + state.by_normal
        of_normal = -counts[:, None, None] * (turned @ nodal.by_normal[:n])
        # derivatives at the pieces
        places, gaps = facing.slopes()
        of_law = _of_law(facing, by_gap, by_slip, places, gaps)
        if self._dim == 3:
            by_spin = at_corners(-transformed(by_jump, nodal.by_spin[:n]))
            by_spin *= (faces.free_to_spin[at] * facing.weighted.sum(axis=2))[..., None]
            spins = facing.spins[:, None, None]
            of_law[:, :, :, : spins.shape[3]] += by_spin[..., None, None] * spins
        on_master = _on_master(facing, operator.at_quadrature(state.traction), places)
        alive = (nodal.weight > 0)[at][:, :, None]
        coupling = alive * (facing.weighted @ facing.jumps)
        by_around = at_corners(ratio(areas - counts, nodal.around[:n]))
        means = -by_around[:, :, None] * facing.mass * alive.transpose(0, 2, 1)
        nodes = facing.nodes[:, at.shape[1] :]
        pieces = _Pieces(facing.facet, nodes, facing.signs, coupling, on_master, of_law, means)
        rows = of_traction[:, None, :, None], of_normal[:, None, :, None]
        return pieces.of_pairs(facing.master), *rows

    def _blocks(self, facet: Indices, nodes: Indices) -> tuple[list[_Block], list[_Block]]:
        """Return blocks of S_u and S_m for pieces on slave facets with nodes of the master."""
        mine = self._slave[facet]
        multipliers = self._multipliers[facet]
        vectors = self._vectors[facet]
        theirs = self._numbering.places(0, nodes)
        bodies = np.concatenate([mine, theirs], axis=1)
        by_unknowns = [
            _Block(bodies, multipliers),
            _Block(theirs, bodies),
            _Block(multipliers, bodies),
            _Block(self._own, self._own),
            _Block(multipliers, multipliers),
        ]
        by_vectors = [
            _Block(theirs, vectors),
            _Block(multipliers, vectors),
            _Block(self._own, self._own_vectors),
        ]
        return by_unknowns, by_vectors

    def _values(
        self, at: _Pieces, of_traction: Array, of_normal: Array
    ) -> tuple[list[Array], list[Array]]:
        """Return the values of the blocks."""
        identity = np.eye(self._dim)
        k, c = at.coupling.shape[1:]
        # rows and columns of mirrored dofs
        mirrored = at.signs[:, k:, :, None, None]
        columns = np.concatenate([at.signs, np.ones_like(at.signs[:, :k])], axis=1)[:, None, None]
        coupling = -self._unit * np.einsum("pac,ij,pci->pciaj", at.coupling, identity, at.signs)
        on_master = mirrored * at.on_master * columns
        of_law = at.of_law * columns
        kept = self._faces.kept[self._faces.corners[at.facet]]
        means = self._unit * np.einsum("pca,ij,pci->pciaj", at.means, identity, kept)
        of_traction = self._unit * of_traction
        by_unknowns = [coupling, on_master[..., :c, :], of_law[..., :c, :], of_traction, means]
        return by_unknowns, [on_master[..., c:, :], of_law[..., c:, :], of_normal]

    @property
    def _turned(self) -> _Block:
        """Block of D: vectors at the corners of facets by the displacements there."""
        return _Block(self._vectors, self._slave)


def _of_law(facing: Facing, by_gap: Array, by_slip: Array, places: Array, gaps: Array) -> Array:
    """Return derivatives of the contact rows of corners (p, a, dim, c, dim) at pieces.

    Args:
        facing: pieces.
        by_gap: derivatives of the rows by the gap of the node (p, a, dim).
        by_slip: derivatives of the rows by the slip of the node (p, a, dim, dim).
        places: derivatives of the places of the rays (p, q, dim - 1, c, dim).
        gaps: derivatives of the gaps of the rays (p, q, c, dim).
    """
    p, q, e, c, dim = places.shape
    a = by_gap.shape[1]
    weighted = facing.weighted
    of_gaps = (weighted @ gaps.reshape(p, q, c * dim))[:, :, None]
    along = weighted.transpose(0, 2, 1)[..., None, None] * facing.along
    along = along.transpose(0, 2, 3, 1, 4).reshape(p, a * dim, q * e)
    of_slips = along @ places.reshape(p, q * e, c * dim)
    of_slips = of_slips.reshape(p, a, dim, c * dim)
    return (by_gap[..., None] * of_gaps + by_slip @ of_slips).reshape(p, a, dim, c, dim)


def _on_master(facing: Facing, tractions: Array, places: Array) -> Array:
    """Return derivatives of the forces on the master (p, b, dim, c, dim) by places of the rays.

    Args:
        facing: pieces.
        tractions: tractions at the points times their areas (p, q, dim).
        places: derivatives of the places of the rays (p, q, dim - 1, c, dim).
    """
    p, q, e, c, dim = places.shape
    b = facing.rays.slopes.shape[2]
    moving = facing.rays.slopes[:, :, :, None] * tractions[:, :, None, :, None]
    moving = moving.transpose(0, 2, 3, 1, 4).reshape(p, b * dim, q * e)
    return (moving @ places.reshape(p, q * e, c * dim)).reshape(p, b, dim, c, dim)
