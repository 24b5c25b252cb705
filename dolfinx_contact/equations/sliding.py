# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact terms of the Jacobian for faces sliding over each other.

The contact terms of H depend on the displacements u, the multipliers l, and the sums m(u) of area
vectors around slave nodes, from which the normals are computed. With D = dm/du, the contact terms
of the Jacobian are

    S = S_u + S_m D,

where S_u is the derivative of H with respect to u and l, and S_m the derivative with respect to m.
The sparsity pattern covers all candidate pairs of facets and changes only with a search
(`points.sliding_faces`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol, TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import Array, Ints
from dolfinx_contact._geometry import ratio, transformed
from dolfinx_contact._petsc import Entries, destroy, triplets
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import SurfaceEvaluation
from dolfinx_contact.points.sliding_kinematics import Facing
from dolfinx_contact.points.sliding_pair import SlidingOperator, SlidingPoints

__all__ = ["Numbering", "SlidingTerms"]

#: Names of the rows and columns of a block (`SlidingTerms._places`).
_Names: TypeAlias = tuple[str, str]
#: Blocks of S_u and of S_m.
_OF_UNKNOWNS: tuple[_Names, ...] = (
    ("bodies", "multipliers"),
    ("master", "bodies"),
    ("multipliers", "bodies"),
    ("own multiplier", "own multiplier"),
    ("multipliers", "multipliers"),
)
_OF_VECTORS: tuple[_Names, ...] = (
    ("master", "vectors"),
    ("multipliers", "vectors"),
    ("own multiplier", "own vector"),
)


class Numbering(Protocol):
    """Interface of a numbering of all unknowns of a problem."""

    def places(self, field: int, nodes: Ints) -> Ints:
        """Return the global indices of the unknowns at nodes, shape (..., dim). Collective.

        Indices of fixed dofs are -1.

        Args:
            field: 0 for the displacement, i + 1 for the multipliers of surface i.
            nodes: global nodes of this field, shape (...).
        """


class _Matrices(NamedTuple):
    """Matrices whose sum S_u + S_m D is the contact part of the Jacobian for one surface.

    Attributes:
        S_u: derivatives of the rows of H with respect to displacements u and multipliers.
        S_m: derivatives of the rows of H with respect to the sums m of area vectors at slave nodes.
        D: derivative of m with respect to u.
        product: S_m D.
    """

    S_u: PETSc.Mat
    S_m: PETSc.Mat
    D: PETSc.Mat
    product: PETSc.Mat


class SlidingTerms:
    """Contact terms of the Jacobian for one pair in large sliding. All methods are collective.

    Args:
        equations: contact problem.
        number: index of the surface.
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
        # places by slave facet, and by contact point
        vertices = self._faces.slave_vertices
        self._slave = numbering.places(0, self._faces.slave_nodes)
        self._multipliers = numbering.places(number + 1, vertices)
        self._vectors = s.dim * vertices[..., None] + np.arange(s.dim)
        first = s.points.vertices.dofmap.index_map.local_range[0]
        own = first + np.arange(s.points.number, dtype=np.int64)[:, None]
        self._own_multiplier = numbering.places(number + 1, own)
        self._own_vector = s.dim * own[..., None] + np.arange(s.dim)
        self._searches = -1
        self._matrices: _Matrices | None = None

    @property
    def changed(self) -> bool:
        """Whether a search has changed the candidates since the pattern was set up."""
        return self._faces.whole is None and self._searches != self._faces.searches

    def set_up(self) -> list[Entries]:
        """Create the matrices with the pattern of the candidates, and return the entries."""
        self.destroy()
        n = self._size
        m = self._dim * self._points.number
        candidates = self._faces.whole or self._faces.found
        facet, master = candidates.pairs.T
        places = self._places(facet, candidates.nodes[master])
        S_u = self._matrix(n, n, [(places[row], places[column]) for row, column in _OF_UNKNOWNS])
        S_m = self._matrix(n, m, [(places[row], places[column]) for row, column in _OF_VECTORS])
        D = self._matrix(m, n, [(self._vectors, self._slave)])
        self._matrices = _Matrices(S_u, S_m, D, S_m.matMult(D))
        self._searches = self._faces.searches
        return [Entries(*triplets(A)[:2]) for A in (S_u, self._matrices.product)]

    def add(self, contact: SurfaceEvaluation, A: PETSc.Mat) -> None:
        """Add the contact terms at an evaluation to a matrix with the pattern of `set_up`."""
        operator = contact.kinematics.operator
        assert isinstance(operator, SlidingOperator)
        assert self._matrices is not None
        S_u, S_m, D, product = self._matrices
        facing, faces = operator.facing, self._faces
        k = self._slave.shape[1]
        # S_u and S_m
        first = _first_of_pairs(facing)
        places = self._places(facing.facet[first], facing.nodes[first, k:])
        values = self._by_point(contact, operator) | self._by_pair(contact, operator, first)
        for matrix, blocks in ((S_u, _OF_UNKNOWNS), (S_m, _OF_VECTORS)):
            matrix.zeroEntries()
            for row, column in blocks:
                _add(matrix, places[row], places[column], values[row, column])
            matrix.assemble()
        # D
        rates = faces.normal_rates(operator.x)
        turned = faces.images[faces.corners][..., None, None] * np.repeat(rates[:, None], k, axis=1)
        D.zeroEntries()
        _add(D, self._vectors, self._slave, turned)
        D.assemble()
        S_m.matMult(D, product)
        for matrix in (S_u, product):
            A.axpy(1.0, matrix, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)

    def destroy(self) -> None:
        """Free the matrices."""
        destroy(*(self._matrices or ()))
        self._matrices = None

    # -- parts -----------------------------------------------------------------------------------

    def _places(self, facet: Ints, nodes: Ints) -> dict[str, Ints]:
        """Return the indices of rows and columns for pairs of facets, by name of the unknowns.

        Shape (pairs, nodes, dim), or (points, 1, dim) for *own multiplier* and *own vector*, which
        belong to single contact points.
        """
        master = self._numbering.places(0, nodes)
        return {
            "bodies": np.concatenate([self._slave[facet], master], axis=1),
            "master": master,
            "multipliers": self._multipliers[facet],
            "vectors": self._vectors[facet],
            "own multiplier": self._own_multiplier,
            "own vector": self._own_vector,
        }

    def _matrix(self, rows: int, columns: int, blocks: Sequence[tuple[Ints, Ints]]) -> PETSc.Mat:
        """Return a matrix of zeros with the pattern of given blocks of rows and columns."""
        A = PETSc.Mat().createAIJ(((rows, None), (columns, None)), comm=self._comm)
        A.setUp()
        for row, column in blocks:
            _add(A, *_pairs_once(row, column))
        A.assemble()
        A.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        return A

    def _by_point(
        self, contact: SurfaceEvaluation, operator: SlidingOperator
    ) -> dict[_Names, Array]:
        """Return derivatives of the contact rows that couple each point only with itself.

        They are taken with respect to its traction and the vector that determines its normal.
        """
        n, nodal = operator.number, operator.facing.nodal
        areas = self._points.areas
        counts = (areas * nodal.share[:n])[:, None, None]
        by_traction = areas[:, None, None] * np.eye(self._dim) - counts * contact.by_traction
        turned = contact.by_jump @ nodal.by_turning[:n] + contact.by_normal
        return {
            ("own multiplier", "own multiplier"): self._unit * by_traction,
            ("own multiplier", "own vector"): -counts * (turned @ nodal.by_normal[:n]),
        }

    def _by_pair(
        self, contact: SurfaceEvaluation, operator: SlidingOperator, first: Ints
    ) -> dict[_Names, Array]:
        """Return the blocks of the Jacobian that couple the nodes of pairs of facets.

        Each block has shape (p, k, dim, l, dim) for p pairs of facets, with k nodes in the rows and
        l nodes in the columns: the corners of the slave facet for multipliers and vectors, of the
        master facet for the master, and of both facets for the bodies. ``first`` is the index of
        the first common part of each pair, whose contributions are summed.
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

        # contact rows by the gap, slip and spin of their node
        by_jump = ratio(counts, nodal.weight[:n])[:, None, None] * contact.by_jump
        by_gap = at_corners(transformed(by_jump, nodal.normal[:n]))
        by_slip = at_corners(-by_jump @ nodal.rotation[:n]) * faces.kept[at][:, :, None]
        # contact rows, and forces on the master, by the displacements of both faces and m
        places, gaps = facing.slopes()
        of_law = _of_law(facing, by_gap, by_slip, places, gaps)
        if self._dim == 3:
            by_spin = at_corners(-transformed(by_jump, nodal.by_spin[:n]))
            by_spin *= (faces.free_to_spin[at] * facing.weighted.sum(axis=2))[..., None]
            spins = facing.spins[:, None, None]
            of_law[:, :, :, : spins.shape[3]] += by_spin[..., None, None] * spins
        on_master = _on_master(facing, operator.at_quadrature(contact.traction), places)
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
        # blocks
        identity = self._unit * np.eye(self._dim)
        return {
            ("bodies", "multipliers"): np.einsum("pac,ij,pci->pciaj", coupling, -identity, signs),
            ("master", "bodies"): on_master[..., :c, :],
            ("master", "vectors"): on_master[..., c:, :],
            ("multipliers", "bodies"): of_law[..., :c, :],
            ("multipliers", "vectors"): of_law[..., c:, :],
            ("multipliers", "multipliers"): np.einsum("pca,ij,pci->pciaj", means, identity, kept),
        }


def _add(A: PETSc.Mat, rows: Ints, columns: Ints, values: Array | None = None) -> None:
    """Add blocks to a matrix without assembling. Not collective.

    Args:
        A: matrix.
        rows: indices of the rows of n blocks, shape (n, k, dim); negative indices are ignored.
        columns: indices of the columns, shape (n, l, dim); negative indices are ignored.
        values: entries of the blocks, shape (n, k, dim, l, dim); default: 0.
    """
    n, k, dim = rows.shape
    shape = n, k * dim, columns.shape[1] * dim
    entries = np.zeros(shape) if values is None else values.reshape(shape)
    A.setValuesRCV(
        rows.reshape(shape[:2]).astype(PETSc.IntType),
        columns.reshape(n, shape[2]).astype(PETSc.IntType),
        entries,
        addv=PETSc.InsertMode.ADD_VALUES,
    )


def _pairs_once(rows: Ints, columns: Ints) -> tuple[Ints, Ints]:
    """Return the pairs of nodes in blocks (`_add`), each once, as blocks of one pair.

    PETSc takes twice as long if pairs in several blocks are inserted repeatedly.
    """
    # the last place of a node identifies it
    last = columns.max(axis=2)
    keys = rows.max(axis=2)[:, :, None] * (last.max(initial=0) + 2) + last[:, None]
    first = np.unique(keys, return_index=True)[1]
    block, row, column = np.unravel_index(first, keys.shape)
    return rows[block, row, None], columns[block, column, None]


def _first_of_pairs(facing: Facing) -> Ints:
    """Return the index of the first of the consecutive common parts of each pair of facets."""
    pairs = np.stack([facing.facet, facing.master], axis=1)
    other = np.diff(pairs, axis=0, prepend=-1).any(axis=1)
    return np.flatnonzero(other)


def _of_law(facing: Facing, by_gap: Array, by_slip: Array, places: Array, gaps: Array) -> Array:
    """Return derivatives of contact rows of the slave corners, shape (p, a, dim, c + a, dim).

    There are p common parts of slave and master facets, with q quadrature points each, and a
    corners of a slave facet. Rows are differentiated with respect to the displacements of the c
    corners of both facets, then the sums of area vectors at the slave corners.

    Args:
        facing: common parts of both faces.
        by_gap: derivatives of the rows with respect to the nodal gap, shape (p, a, dim).
        by_slip: derivatives of the rows with respect to the nodal slip, shape (p, a, dim, dim).
        places: derivatives of the reference coordinates at which the rays meet the master facet,
            shape (p, q, dim - 1, c + a, dim).
        gaps: derivatives of the gaps along the rays, shape (p, q, c + a, dim).
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
    """Return derivatives of the forces on the master at fixed tractions.

    Rays from the slave then meet the master facet at other points. Shape (p, b, dim, c + a, dim)
    with b corners of the master facet; for p, q, c and a see `_of_law`.

    Args:
        facing: common parts of slave and master facets.
        tractions: tractions times areas at the quadrature points, shape (p, q, dim).
        places: derivatives of the reference coordinates at which the rays meet the master facet,
            shape (p, q, dim - 1, c + a, dim).
    """
    p, q, e, c, dim = places.shape
    b = facing.rays.slopes.shape[2]
    moving = facing.rays.slopes[:, :, :, None] * tractions[:, :, None, :, None]
    moving = moving.transpose(0, 2, 3, 1, 4).reshape(p, b * dim, q * e)
    return (moving @ places.reshape(p, q * e, c * dim)).reshape(p, b, dim, c, dim)
