# SPDX-License-Identifier: LGPL-3.0-or-later
"""Multigrid hierarchy of the stiffness, which remains in use when statuses change.

The hierarchy is an algebraic multigrid of PETSc (GAMG, or BoomerAMG of hypre) with the rigid
motions as near null space. It is built from the stiffness with all currently closed nodes fixed, or
joined in pairs (`closed_points`). Statuses may change afterwards, because the `surface_filter`
corrects the resulting errors at the contact nodes. Aggregates of GAMG are plain (`PLAIN`) or
smoothed (`SMOOTHED`). Smoothed aggregates cost more in the set-up and need fewer iterations.

In a time step, the mass may make the matrix so well conditioned that a hierarchy costs more time
than it saves. A polynomial preconditioner of low degree is then used instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np

from dolfinx import fem, la

from dolfinx_contact._arrays import Indices
from dolfinx_contact._petsc import (
    as_raised,
    destroy,
    forget_product,
    half_of,
    has_package,
    logged,
    options_in_database,
)
from dolfinx_contact.body.rigid import Parts

__all__ = ["PLAIN", "SMOOTHED", "Hierarchy", "Interpolation", "condition", "rigid_body_space"]

_GAMG: dict[str, Any] = {
    "pc_type": "gamg",
    "pc_use_amat": True,
    "pc_gamg_threshold": 0.005,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 2,
    "mg_levels_pc_type": "jacobi",
}


@dataclass(frozen=True)
class Interpolation:
    """Interpolation of GAMG with its measured costs (`benchmarks/settings_study.py`).

    Costs are multiples of the cost of an iteration with plain aggregates.

    Attributes:
        options: PETSc options of the PC.
        set_up: cost of setting up a hierarchy.
        iteration: cost of an iteration.
        per_digit: iterations per decimal digit by which a new hierarchy reduces the residual.
    """

    options: dict[str, Any]
    set_up: float
    iteration: float
    per_digit: float


#: Plain aggregates are cheap to set up. In V-cycles they take more iterations, the more levels
#: there are (Braess, Computing 55, 1995). W-cycles visit the next coarser level, of a twelfth of
#: the unknowns, twice, and take hardly more on a large mesh than on a small one. Levels of some
#: hundred unknowns are factorised.
PLAIN = Interpolation(
    {
        "pc_gamg_agg_nsmooths": 0,
        "pc_gamg_aggressive_coarsening": 1,
        "pc_mg_cycle_type": "w",
        "pc_gamg_coarse_eq_limit": 1000,
    },
    set_up=22.0,
    iteration=1.0,
    per_digit=3.0,
)
SMOOTHED = Interpolation(
    {"pc_gamg_agg_nsmooths": 1, "pc_gamg_aggressive_coarsening": 2},
    set_up=62.0,
    iteration=1.25,
    per_digit=2.5,
)
_HYPRE: dict[str, Any] = {
    "pc_type": "hypre",
    "pc_hypre_type": "boomeramg",
    "pc_hypre_boomeramg_nodal_coarsen": 4,
    "pc_hypre_boomeramg_vec_interp_variant": 2,
    "pc_hypre_boomeramg_strong_threshold": 0.5,
    "pc_hypre_boomeramg_coarsen_type": "HMIS",
    "pc_hypre_boomeramg_interp_type": "ext+i",
    "pc_hypre_boomeramg_P_max": 4,
    "pc_hypre_boomeramg_agg_nl": 1,
}
#: Two steps of Chebyshev's method. Iterations are due to the coupling to the contact nodes: more
#: steps, or a hierarchy, save none (measured).
_POLYNOMIAL: dict[str, Any] = {
    "pc_type": "ksp",
    "pc_use_amat": True,
    "ksp_ksp_type": "chebyshev",
    "ksp_ksp_max_it": 2,
    "ksp_ksp_norm_type": "none",
    "ksp_ksp_chebyshev_esteig": "0,0.1,0,1.1",
    "ksp_pc_type": "jacobi",
}
_WELL = 30.0  # condition number, after diagonal scaling, below which that is faster (measured)
_LANCZOS = 20  # Lanczos steps for the condition number
#: PETSc's default for Galerkin products on one rank takes twice as long.
_PRODUCTS = {"matptap_via": "rap"}


class Hierarchy:
    """Multigrid hierarchy of the stiffness, in use until the next call of `build`.

    Args:
        V: displacement space.
        prefix: prefix of PETSc options, to which the hierarchy appends ``amg_``.
        symmetric: whether the stiffness is symmetric and positive definite.
        massive: whether the stiffness contains a mass matrix; a polynomial preconditioner may then
            suffice.
        interpolation: interpolation of GAMG, `PLAIN` or `SMOOTHED` aggregates.

    Attributes:
        null_space: rigid motions as a near null space (`Mat.setNearNullSpace`).
        interpolation: interpolation of GAMG in the next `build`, `PLAIN` or `SMOOTHED`.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        prefix: str,
        *,
        symmetric: bool = True,
        massive: bool = False,
        interpolation: Interpolation = SMOOTHED,
    ):
        self._default = "gamg"
        self.interpolation = interpolation
        self._massive = massive and symmetric
        self.comm = V.mesh.comm
        self.prefix = prefix + "amg_"
        self._symmetric = symmetric
        self.null_space, self._vectors = rigid_body_space(V)
        self._bs = V.dofmap.index_map_bs
        self.pc: PETSc.PC | None = None
        self.matrix: PETSc.Mat | None = None
        self._products: PETSc.Mat | None = None
        self._coarse: PETSc.Mat | None = None
        #: Number of set-ups so far.
        self.builds = 0

    @property
    def kind(self) -> str:
        """PETSc type of the preconditioner, for example ``gamg``."""
        return str(PETSc.Options().getString(self.prefix + "pc_type", self._default))

    @property
    def may_smooth(self) -> bool:
        """Whether plain aggregates are in use and can be replaced by smoothed aggregates."""
        given = PETSc.Options().hasName(self.prefix + "pc_gamg_agg_nsmooths")
        return self.kind == "gamg" and self.interpolation is PLAIN and not given

    @property
    def options(self) -> dict[str, Any]:
        """Default PETSc options of the preconditioner; the options database overrides them."""
        gamg = {**_GAMG, **self.interpolation.options}
        return {"gamg": gamg, "hypre": _HYPRE, "ksp": _POLYNOMIAL}.get(self.kind, {})

    def build(
        self,
        K: PETSc.Mat,
        identity: Indices,
        diagonal: float,
        added: PETSc.Mat | None = None,
        half: PETSc.Mat | None = None,
    ) -> PETSc.PC:
        """Build the hierarchy of ``K`` with fixed dofs. Collective.

        Args:
            K: stiffness.
            identity: owned local dofs whose rows and columns become ``diagonal`` times the
                identity.
            diagonal: diagonal entry of these rows.
            added: matrix to add to ``K`` first; it is destroyed.
            half: upper half of ``K`` in symmetric storage, if available for the lifetime of the
                hierarchy; None otherwise.
        """
        self.destroy()
        with logged("ContactAMGSetUp"):
            self.matrix = K.copy()
            if added is not None:
                self.matrix.axpy(1.0, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                added.destroy()
                half = None
            self.matrix.setBlockSize(self._bs)
            rows = identity + K.getOwnershipRange()[0]
            self.matrix.zeroRowsColumns(rows.astype(np.int32), diag=diagonal)
            self.matrix.setNearNullSpace(self.null_space)
            if self._symmetric:
                self.matrix.setOption(PETSc.Mat.Option.SPD, True)
                if self._massive:
                    well = condition(self.matrix, _LANCZOS) <= _WELL
                    self._default = "ksp" if well else "gamg"
                if self.kind in ("gamg", "ksp"):
                    self._products = (
                        half_of(self.matrix)
                        if half is None
                        else _with_identity_rows(half, identity, diagonal)
                    )
            self.pc = PETSc.PC().create(self.comm)
            self.pc.setOperators(self._products or self.matrix, self.matrix)
            self.set_up(self.pc)
            if self.kind == "gamg" and self._symmetric:
                self._shrink(self.pc, half is not None)
        self.builds += 1
        return self.pc

    def _shrink(self, pc: PETSc.PC, free: bool) -> None:
        """Store only half of the first coarse matrix, and free data of the set-up. Collective.

        ``free`` also frees the finest matrix, because `_products` provides its diagonal.
        """
        levels = pc.getMGLevels()
        for level in range(levels - 1):
            forget_product(pc.getMGSmoother(level).getOperators()[1])
        if levels > 2:
            smoother = pc.getMGSmoother(levels - 2)
            coarse = smoother.getOperators()[1]
            self._coarse = half_of(coarse)
            smoother.setOperators(self._coarse, coarse)
        finest = pc.getMGSmoother(levels - 1)
        # Jacobi's method needs the diagonal only; a smoother of the user may need the matrix.
        if free and levels > 1 and finest.getPC().getType() == PETSc.PC.Type.JACOBI:
            pc.setReusePreconditioner(True)
            pc.setOperators(self._products, self._products)
            finest.setOperators(self._products, self._products)
            assert self.matrix is not None
            self.matrix.destroy()
            self.matrix = None

    def set_up(self, pc: PETSc.PC) -> None:
        """Set up a PC, whose operators are set, with the options of the hierarchy. Collective.

        Raises:
            ValueError: on every rank, if hypre is chosen and PETSc was built without it.
        """
        if self.kind == "hypre" and not has_package("hypre"):
            raise ValueError(
                f"this PETSc was built without hypre: -{self.prefix}pc_type gamg, the default"
            )
        pc.setOptionsPrefix(self.prefix)
        products = _PRODUCTS if self.comm.size == 1 else {}
        ours = options_in_database(self.prefix, self.options)
        with ours, options_in_database("", products), as_raised():
            pc.setFromOptions()
            pc.setUp()

    def destroy(self) -> None:
        """Free the hierarchy."""
        destroy(self.pc, self.matrix, self._products, self._coarse)
        self.pc = self.matrix = self._products = self._coarse = None


class _IdentityRows:
    """Context of a matrix-free Mat: a symmetric matrix with rows and columns of a scaled identity.

    Matrix and work vector are composed with the Mat, so that PETSc frees them on all ranks.

    Args:
        rows: owned local indices of the replaced rows.
        diagonal: diagonal entry of these rows.
    """

    def __init__(self, rows: Indices, diagonal: float):
        self._rows = rows
        self._diagonal = diagonal

    def getDiagonal(self, mat: PETSc.Mat, y: PETSc.Vec) -> None:
        """Write the diagonal into ``y``."""
        mat.query("matrix").getDiagonal(y)
        y.array[self._rows] = self._diagonal

    def mult(self, mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Write the product with ``x`` into ``y``."""
        work = mat.query("work")
        x.copy(work)
        values = x.array_r[self._rows]
        work.array[self._rows] = 0.0
        mat.query("matrix").mult(work, y)
        y.array[self._rows] = self._diagonal * values


def _with_identity_rows(A: PETSc.Mat, rows: Indices, diagonal: float) -> PETSc.Mat:
    """Return matrix-free ``A`` with some rows and columns of a scaled identity. Collective."""
    made = PETSc.Mat().createPython(A.getSizes(), _IdentityRows(rows, diagonal), comm=A.comm)
    made.setUp()
    work = A.createVecRight()
    made.compose("matrix", A)
    made.compose("work", work)
    work.destroy()
    return made


def condition(A: PETSc.Mat, steps: int) -> float:
    """Return a lower bound of the condition number after diagonal scaling. Collective.

    It is the ratio of the extreme Ritz values of conjugate gradients.

    Args:
        A: symmetric positive definite matrix.
        steps: number of conjugate gradient steps.
    """
    ksp = PETSc.KSP().create(A.comm)
    ksp.setOperators(A)
    ksp.setType("cg")
    ksp.getPC().setType("jacobi")
    ksp.setComputeEigenvalues(True)
    ksp.setTolerances(rtol=1e-12, max_it=steps)
    x, b = A.createVecs()
    b.array[:] = np.random.default_rng(A.comm.rank).standard_normal(b.getLocalSize())
    ksp.solve(b, x)
    values = ksp.computeEigenvalues().real
    destroy(ksp, x, b)
    return float(values.max() / values.min()) if len(values) and values.min() > 0 else np.inf


def rigid_body_space(V: fem.FunctionSpace) -> tuple[PETSc.NullSpace, list[PETSc.Vec]]:
    """Return the rigid motions of the body as a PETSc null space, and its vectors. Collective.

    For a body of revolution they are the rigid motions of its section, whose circumferential strain
    is small in each cell. With only the axial translation, the one true rigid motion, Krylov solves
    stagnate (measured).
    """
    index_map = V.dofmap.index_map
    n = index_map.size_local
    motions = Parts(V, joined=True).motions()
    dim = motions.shape[2]
    basis = [la.vector(index_map, dim) for _ in motions]
    for b, motion in zip(basis, motions, strict=True):
        b.array[:] = motion.reshape(-1)
    la.orthonormalize(basis)
    comm = V.mesh.comm
    vectors = [
        PETSc.Vec().createWithArray(b.array[: dim * n].copy(), bsize=dim, comm=comm) for b in basis
    ]
    return PETSc.NullSpace().create(vectors=vectors, comm=comm), vectors
