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

from dolfinx_contact._geometry import ratio
from dolfinx_contact._petsc import Entries, matrix_of, triplets
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

    def add(self, values: Array, A: PETSc.Mat) -> None:
        """Add values (n, rows, dim, columns, dim) to ``A``; the caller assembles ``A``.

        Not collective.
        """
        n, r, d = self.rows.shape
        c = self.columns.shape[1]
        rows = self.rows.reshape(n, r * d).astype(PETSc.IntType)
        columns = self.columns.reshape(n, c * d).astype(PETSc.IntType)
        A.setValuesRCV(
            rows, columns, values.reshape(n, r * d, c * d), addv=PETSc.InsertMode.ADD_VALUES
        )

    def pattern(self) -> tuple[Indices, Indices]:
        """Return rows and columns of all entries without repetition and without fixed dofs."""
        n, r, d = self.rows.shape
        c = self.columns.shape[1]
        # The last place of a node identifies it.
        row = np.broadcast_to(self.rows.max(axis=2)[:, :, None], (n, r, c)).reshape(-1)
        column = np.broadcast_to(self.columns.max(axis=2)[:, None], (n, r, c)).reshape(-1)
        known = np.flatnonzero((row >= 0) & (column >= 0))
        width = int(column.max(initial=0)) + 1
        _, first = np.unique(row[known] * width + column[known], return_index=True)
        block, i, j = np.unravel_index(known[first], (n, r, c))
        rows = np.repeat(self.rows[block, i], d, axis=1)
        columns = np.tile(self.columns[block, j], (1, d))
        return rows.reshape(-1), columns.reshape(-1)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Derivatives at p pieces of the faces; facets have a corners (slave) and b nodes (master).

    Attributes:
        facet: facets of the slave (p,).
        nodes: global nodes of the facets of the master (p, b).
        mirrors: -1 along axes across which the master facet is a mirror image, otherwise 1
            (p, dim).
        coupling: forces on slave and master by the multipliers (p, a + b, a).
        on_master: forces on the master by u of the slave, m, and u of the master
            (p, b, dim, c, dim).
        of_law: contact rows by the same (p, a, dim, c, dim).
        means: contact rows by the neighbouring tractions (p, a, a).
    """

    facet: Indices
    nodes: Indices
    mirrors: Array
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
        return _Pieces(self.facet[first], self.nodes[first], self.mirrors[first], *sums)


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
        for shape, blocks in zip(shapes, (*of_pairs, [self._turned]), strict=True):
            places = zip(*(b.pattern() for b in blocks), strict=True)
            entries = Entries(*(np.concatenate(part) for part in places))
            self._matrices.append(matrix_of(self._comm, shape, entries))
        S, N, D = self._matrices
        self._matrices.append(N.matMult(D))
        self._searches = self._faces.searches
        return [Entries(*triplets(A)[:2]) for A in (S, self._matrices[3])]

    def add(self, state: ContactState, A: PETSc.Mat) -> None:
        """Add S at a state to ``A``, which has its pattern."""
        operator = state.kinematics.operator
        assert isinstance(operator, SlidingOperator)
        at = self._at(state, operator)
        blocks = self._blocks(at[0].facet, at[0].nodes)
        k = self._slave.shape[1]
        rates = self._faces.normal_rates(operator.x)
        images = self._faces.images[self._faces.corners]
        turned = images[:, :, :, None, None] * np.repeat(rates[:, None], k, axis=1)
        S, N, D, product = self._matrices
        found = zip(
            (S, N, D), (*blocks, [self._turned]), (*self._values(*at), [turned]), strict=True
        )
        for matrix, places, values in found:
            matrix.zeroEntries()
            for block, value in zip(places, values, strict=True):
                block.add(value, matrix)
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
        facing = operator.facing
        faces = self._faces
        n = operator.number
        nodal = facing.nodal
        areas = self._points.areas
        weight = nodal.weight[:n]
        counts = areas * nodal.share[:n]
        by_weight = ratio(counts, weight)
        by_jump = by_weight[:, None, None] * state.by_jump
        by_gap = faces.vertices.from_owners(np.einsum("nij,nj->ni", by_jump, nodal.normal[:n]))
        by_slip = faces.vertices.from_owners(-by_jump @ nodal.rotation[:n]) * faces.kept[:, None]
        by_spin = -np.einsum("nij,nj->ni", by_jump, nodal.by_spin[:n])
        by_spin = faces.vertices.from_owners(by_spin) * faces.free_to_spin[:, None]
        at = faces.corners[facing.facet]
        places, gaps = facing.slopes()
        of_law = _of_law(facing, by_gap[at], by_slip[at], places, gaps)
        if self._dim == 3:
            of_spin = facing.weighted.sum(axis=1)[..., None, None] * facing.spin_slopes()[:, None]
            of_law += by_spin[at][..., None, None] * of_spin[:, :, None]
        t = facing.areas[..., None] * operator.at_quadrature(state.traction)
        on_master = _on_master(facing, t, places)
        alive = (nodal.weight > 0)[at]
        basis = facing.basis * alive[:, None]
        both = np.concatenate([-facing.basis, facing.rays.weights], axis=2)
        coupling = (facing.areas[..., None] * both).transpose(0, 2, 1) @ basis
        of_traction = areas[:, None, None] * np.eye(self._dim)
        of_traction = of_traction - counts[:, None, None] * state.by_traction
        turned = state.by_jump @ nodal.by_turning[:n] + state.by_normal
        of_normal = -counts[:, None, None] * (turned @ nodal.by_normal[:n])
        around = nodal.around[:n]
        by_around = ratio(areas - counts, around)
        by_around = faces.vertices.from_owners(by_around)
        means = -by_around[at][:, :, None] * facing.mass * alive[:, None]
        parts = (
            facing.facet,
            facing.master_nodes,
            facing.mirrors,
            coupling,
            on_master,
            of_law,
            means,
        )
        pieces = _Pieces(*parts).of_pairs(facing.master)
        return pieces, of_traction[:, None, :, None], of_normal[:, None, :, None]

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
        k = self._slave.shape[1]
        moved = [*range(k), *range(2 * k, 2 * k + at.nodes.shape[1])]
        turned = slice(k, 2 * k)
        identity = np.eye(self._dim)
        coupling = self._unit * np.einsum("pca,ij->pciaj", at.coupling, identity)
        on_master, of_law = at.on_master, at.of_law
        if (at.mirrors < 0).any():  # rows and columns of the mirrored dofs
            theirs = at.mirrors[:, None].repeat(at.nodes.shape[1], axis=1)
            mine = np.ones((len(theirs), k, self._dim))
            bodies = np.concatenate([mine, theirs], axis=1)
            columns = np.concatenate([mine, bodies], axis=1)[:, None, None]
            coupling = bodies[..., None, None] * coupling
            on_master = theirs[..., None, None] * on_master * columns
            of_law = of_law * columns
        kept = self._faces.kept[self._faces.corners[at.facet]]
        means = self._unit * np.einsum("pca,ij,pci->pciaj", at.means, identity, kept)
        by_unknowns = [
            coupling,
            on_master[:, :, :, moved],
            of_law[:, :, :, moved],
            self._unit * of_traction,
            means,
        ]
        return by_unknowns, [
            on_master[:, :, :, turned],
            of_law[:, :, :, turned],
            of_normal,
        ]

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
    weighted = facing.weighted.transpose(0, 2, 1)
    of_gaps = (weighted @ gaps.reshape(p, q, c * dim))[:, :, None]
    along = (facing.weighted[..., None, None] * facing.along).transpose(0, 2, 3, 1, 4)
    of_slips = along.reshape(p, a * dim, q * e) @ places.reshape(p, q * e, c * dim)
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
