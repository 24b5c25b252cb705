# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Contact terms of the Jacobian for faces sliding over each other.

The contact terms of H depend on the displacements u, the vectors m(u) from which the normals are
computed, and the multipliers l. With D = dm/du the terms of the Jacobian are

    S = S_u + S_m D,

where S_u is the derivative with respect to u and l, and S_m that with respect to m. The pattern
contains all candidates and changes only with a search (`points.sliding`).
"""

from __future__ import annotations

from typing import Protocol, TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import ratio, transformed
from dolfinx_contact._petsc import Entries, triplets
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import ContactState
from dolfinx_contact.points.sliding_kinematics import Facing
from dolfinx_contact.points.sliding_pair import SlidingOperator, SlidingPoints

__all__ = ["Numbering", "SlidingTerms"]

#: Places of rows and columns (n, k, dim) of blocks of entries; negative ones are ignored.
_Block: TypeAlias = tuple[Ints, Ints]


class Numbering(Protocol):
    """Numbering of the unknowns."""

    def places(self, field: int, nodes: Ints) -> Ints:
        """Return places (..., dim) of the dofs of global nodes, -1 for fixed dofs. Collective."""


def _add(A: PETSc.Mat, block: _Block, values: Array | None = None) -> None:
    """Add values (n, rows, dim, columns, dim), by default 0, without assembling. Not collective."""
    n, r, d = block[0].shape
    shape = n, r * d, block[1].shape[1] * d
    rows = block[0].reshape(shape[:2]).astype(PETSc.IntType)
    columns = block[1].reshape(n, shape[2]).astype(PETSc.IntType)
    entries = np.zeros(shape) if values is None else values.reshape(shape)
    A.setValuesRCV(rows, columns, entries, addv=PETSc.InsertMode.ADD_VALUES)


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
        shapes = ((n, n), (n, m), (m, n))
        every = self._blocks(facet, found.nodes[master])
        for (rows, columns), blocks in zip(shapes, every, strict=True):
            A = PETSc.Mat().createAIJ(((rows, None), (columns, None)), comm=self._comm)
            A.setUp()
            for block in blocks:
                _add(A, block)
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
        facing, faces = operator.facing, self._faces
        k = self._slave.shape[1]
        first = _first_of_pairs(facing)
        places = self._blocks(facing.facet[first], facing.nodes[first, k:])
        rates = faces.normal_rates(operator.x)
        turned = faces.images[faces.corners][..., None, None] * np.repeat(rates[:, None], k, axis=1)
        S, N, D, product = self._matrices
        values = (*self._values(state, operator, first), [turned])
        for matrix, blocks, parts in zip((S, N, D), places, values, strict=True):
            matrix.zeroEntries()
            for block, part in zip(blocks, parts, strict=True):
                _add(matrix, block, part)
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

    def _blocks(self, facet: Ints, nodes: Ints) -> tuple[list[_Block], list[_Block], list[_Block]]:
        """Return blocks of S_u, S_m and D for pairs of slave facets and nodes of the master."""
        mine, vectors, multipliers = (
            v[facet] for v in (self._slave, self._vectors, self._multipliers)
        )
        theirs = self._numbering.places(0, nodes)
        bodies = np.concatenate([mine, theirs], axis=1)
        by_unknowns = [
            (bodies, multipliers),
            (theirs, bodies),
            (multipliers, bodies),
            (self._own, self._own),
            (multipliers, multipliers),
        ]
        by_vectors = [(theirs, vectors), (multipliers, vectors), (self._own, self._own_vectors)]
        return by_unknowns, by_vectors, [(self._vectors, self._slave)]

    def _values(
        self, state: ContactState, operator: SlidingOperator, first: Ints
    ) -> tuple[list[Array], list[Array]]:
        """Return the values of the blocks; see `points.sliding_kinematics.Facing` for a, b and c.

        Args:
            state: state.
            operator: B at the state.
            first: first piece of each pair of facets, over whose pieces sums are taken.
        """
        facing, faces = operator.facing, self._faces
        n, nodal = operator.number, facing.nodal
        areas = self._points.areas
        counts = areas * nodal.share[:n]
        at = faces.corners[facing.facet]

        def at_corners(values: Array) -> Array:
            return faces.vertex_exchange.from_owners(values)[at]

        def of_pairs(parts: Array) -> Array:
            return np.add.reduceat(parts, first, axis=0) if len(first) else parts

        # contact rows by the gap, slip and spin of their node, and by its traction and normal
        by_jump = ratio(counts, nodal.weight[:n])[:, None, None] * state.by_jump
        by_gap = at_corners(transformed(by_jump, nodal.normal[:n]))
        by_slip = at_corners(-by_jump @ nodal.rotation[:n]) * faces.kept[at][:, :, None]
        of_traction = areas[:, None, None] * np.eye(self._dim)
        of_traction = of_traction - counts[:, None, None] * state.by_traction
        turned = state.by_jump @ nodal.by_turning[:n] + state.by_normal
        of_normal = -counts[:, None, None] * (turned @ nodal.by_normal[:n])
        # contact rows, and forces on the master, by the displacements of both faces and m
        places, gaps = facing.slopes()
        of_law = _of_law(facing, by_gap, by_slip, places, gaps)
        if self._dim == 3:
            by_spin = at_corners(-transformed(by_jump, nodal.by_spin[:n]))
            by_spin *= (faces.free_to_spin[at] * facing.weighted.sum(axis=2))[..., None]
            spins = facing.spins[:, None, None]
            of_law[:, :, :, : spins.shape[3]] += by_spin[..., None, None] * spins
        on_master = _on_master(facing, operator.at_quadrature(state.traction), places)
        # forces on both faces by the multipliers, and contact rows by the neighbouring tractions
        alive = (nodal.weight > 0)[at][:, :, None]
        coupling = of_pairs(alive * (facing.weighted @ facing.jumps))
        by_around = at_corners(ratio(areas - counts, nodal.around[:n]))[:, :, None]
        means = of_pairs(-by_around * facing.mass * alive.transpose(0, 2, 1))
        # signs of the rows and columns of mirrored dofs
        signs, kept = facing.signs[first], faces.kept[at[first]]
        k, c = coupling.shape[1:]
        columns = np.concatenate([signs, np.ones_like(signs[:, :k])], axis=1)[:, None, None]
        on_master = signs[:, k:, :, None, None] * of_pairs(on_master) * columns
        of_law = of_pairs(of_law) * columns
        identity = self._unit * np.eye(self._dim)
        by_unknowns = [
            np.einsum("pac,ij,pci->pciaj", coupling, -identity, signs),
            on_master[..., :c, :],
            of_law[..., :c, :],
            self._unit * of_traction,
            np.einsum("pca,ij,pci->pciaj", means, identity, kept),
        ]
        return by_unknowns, [on_master[..., c:, :], of_law[..., c:, :], of_normal]


def _first_of_pairs(facing: Facing) -> Ints:
    """Return the first piece of each pair of facets; the pieces of a pair are consecutive."""
    pairs = np.stack([facing.facet, facing.master], axis=1)
    other = np.diff(pairs, axis=0, prepend=-1).any(axis=1)
    return np.flatnonzero(other)


def _of_law(facing: Facing, by_gap: Array, by_slip: Array, places: Array, gaps: Array) -> Array:
    """Return derivatives of the contact rows of corners (p, a, dim, c, dim) at pieces.

    Args:
        facing: pieces.
        by_gap: derivatives of the rows with respect to the gap of the node (p, a, dim).
        by_slip: derivatives of the rows with respect to the slip of the node (p, a, dim, dim).
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
    """Return the part of the derivatives of the forces on the master that is due to moving rays.

    Shape (p, b, dim, c, dim).

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
