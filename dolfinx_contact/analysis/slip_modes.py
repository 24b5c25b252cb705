# SPDX-License-Identifier: LGPL-3.0-or-later
"""Critical friction coefficients F and their slips, from an eigenproblem.

The eigenproblem is T f = f/F; T maps shears f to pressures (`critical_friction`). Slips of one sign
are also found for multiple eigenvalues. Components of slips below the accuracy of their
eigenvectors are set to zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from dolfinx_contact._arrays import Array, Mask

__all__ = ["SlipModes"]

Complex = npt.NDArray[np.complex128]

_REAL = 1e-9  # relative imaginary part, or difference of coefficients, that counts as zero
_DEPENDENT = 1e-6  # relative singular value below which eigenvectors count as dependent
_SIGN = 1e-8  # least slip, relative to the largest at equal softness, whose sign counts
_BLURRED = 10.0  # safety factor of the error bound of an eigenvector
_MOST = 1e-3  # largest relative slip that counts as zero
_NOTHING = 1e-11  # eigenvalue of T that counts as zero, relative to the largest


@dataclass(frozen=True)
class SlipModes:
    """Critical coefficients F, sorted by magnitude, with slips and shears of all m points.

    Slips are compared relative to the compliance of their points; otherwise the round-off of soft
    bodies would hide the slips of stiff bodies. Slips below the accuracy of their eigenvector are
    set to 0.

    Attributes:
        friction: coefficients F, shape (k,).
        slips: slips, scaled such that the largest entry of each column is 1, shape (m, k).
        shears: shears that cause these slips, shape (m, k).
        known_up_to: magnitude below which no F is missing.
        residuals: residual norms |T f - f/F| / |f|, relative to the largest 1/|F|, shape (k,); T
            maps the shears f to pressures.
    """

    friction: Complex
    slips: Complex
    shears: Complex
    known_up_to: float
    residuals: Array

    @classmethod
    def of(
        cls,
        values: Complex,
        shears: Complex,
        slips: Complex,
        pressures: Complex,
        softness: Array,
        known_up_to: float = np.inf,
    ) -> SlipModes:
        """Sort the coefficients F of T f = f/F (shears f, pressures T f); find slips of one sign.

        Args:
            values: eigenvalues 1/F, shape (k,).
            shears: eigenvectors f in columns, shape (m, k).
            slips: slips caused by these shears, shape (m, k).
            pressures: products T f, shape (m, k).
            softness: estimated slip of each point under a unit force, shape (m,).
            known_up_to: magnitude below which no F is missing; infinite by default.
        """
        off = np.linalg.norm(pressures - values * shears, axis=0)
        there = np.abs(values) > _NOTHING * max(np.abs(values).max(initial=0.0), _NOTHING)
        F = 1.0 / values[there]
        largest = np.abs(values).max(initial=0.0)
        residuals = off[there] / (largest * np.linalg.norm(shears[:, there], axis=0))
        # Coefficients that differ by less than their accuracy count as equal.
        same = max(_REAL, float(residuals.max(initial=0.0)))
        F = np.where(np.abs(F.imag) <= same * np.abs(F), F.real, F)
        # The positive one of two mirrored coefficients comes first, despite round-off.
        size = np.abs(F)
        order = np.lexsort((-F.imag, -F.real, np.round(size / size.min(initial=np.inf), 9)))
        F = F[order]
        residuals = residuals[order]
        slips, shears = (v[:, there][:, order] for v in (slips, shears))
        soft = softness[:, None]
        slips = slips / soft
        none = _blur(F, residuals, same, known_up_to)
        _with_one_sign(F, slips, shears, same, none)
        sizes = np.abs(slips)
        slips = np.where(sizes > none * sizes.max(axis=0), slips * soft, 0.0)
        most = slips[np.abs(slips).argmax(axis=0), np.arange(len(order))]
        return cls(F, slips / most, shears / most, known_up_to, residuals)

    @classmethod
    def of_matrix(cls, flexibility: Array, T: Array, softness: Array) -> SlipModes:
        """Compute all critical coefficients from the responses to unit shears.

        Args:
            flexibility: slips caused by a unit shear at each point, as columns, shape (m, m).
            T: pressures caused by these shears, as columns, shape (m, m).
            softness: estimated slip of each point under a unit force, shape (m,).
        """
        values, shears = np.linalg.eig(T)
        return cls.of(values, shears, flexibility @ shears, T @ shears, softness)

    @property
    def smallest(self) -> float:
        """Smallest magnitude of a coefficient with a slip of one sign; infinite if none exists."""
        return float(np.abs(self.friction[self.one_signed]).min(initial=np.inf))

    @property
    def one_signed(self) -> Mask:
        """Mask of the coefficients that are real and have a slip of one sign, shape (k,)."""
        return np.asarray((self.friction.imag == 0) & (self.slips.real.min(axis=0) >= 0.0))


def _blur(F: Complex, residuals: Array, same: float, known_up_to: float) -> Array:
    """Return relative error bounds of the eigenvectors of T f = f/F, shape (k,).

    The bound is the residual divided by the distance to the nearest other eigenvalue 1/F, listed or
    above `known_up_to` (G. W. Stewart and J. Sun, Matrix Perturbation Theory, 1990, ch. V).
    Coefficients within the relative distance ``same`` count as equal.
    """
    values = 1.0 / F
    apart = np.abs(values[:, None] - values)
    apart[apart <= same * np.abs(values)] = np.inf
    beyond = np.abs(np.abs(values) - 1.0 / known_up_to if known_up_to > 0 else np.inf)
    gap = np.minimum(apart.min(axis=1, initial=np.inf), beyond)
    largest = np.abs(values).max(initial=0.0)
    return np.clip(_BLURRED * residuals * largest / np.maximum(gap, same * largest), _SIGN, _MOST)


def _with_one_sign(F: Complex, slips: Complex, shears: Complex, same: float, none: Array) -> None:
    """Replace one eigenvector of each multiple eigenvalue by a slip of one sign, if one exists.

    All linear combinations of the eigenvectors are possible slips, and the vectors from the
    eigensolver need not have one sign. The first vector is replaced.

    Args:
        F: coefficients, shape (k,).
        slips: slips divided by the slip of each point under a unit force, as columns, shape (m, k);
            changed in place.
        shears: shears as columns, shape (m, k); changed in place.
        same: relative difference below which coefficients count as equal.
        none: slip that counts as zero, relative to the largest slip of the column, shape (k,).
    """
    real = np.flatnonzero(F.imag == 0)
    real = real[np.argsort(F.real[real], kind="stable")]
    values = F.real[real]
    apart = np.flatnonzero(np.diff(values) > same * np.abs(values[1:]))
    for group in np.split(real, apart + 1):
        if len(group) < 2:
            continue
        # Round-off may have turned two equal eigenvalues into a complex pair.
        u, f = (np.hstack([v[:, group].real, v[:, group].imag]) for v in (slips, shears))
        _, sizes, back = np.linalg.svd(u, full_matrices=False)
        kept = (sizes > _DEPENDENT * sizes[0])[: len(group)]
        back = (back[: len(group)] / sizes[: len(group), None])[kept].T
        weights = back @ _nonnegative(u @ back, float(none[group].max()))
        if weights.any():
            first = group.min()
            slips[:, first], shears[:, first] = u @ weights, f @ weights


def _nonnegative(vectors: Array, none: float) -> Array:
    """Return weights of a combination of vectors without negative components, shape (k,).

    Of all combinations with components up to 1, it has the largest sum; all weights are 0 if there
    is none.

    Args:
        vectors: orthonormal vectors as columns, shape (m, k).
        none: size of a negative component that counts as zero, relative to the largest one.
    """
    m, k = vectors.shape
    found = linprog(
        -vectors.sum(axis=0),
        A_ub=np.vstack([vectors, -vectors]),
        b_ub=np.concatenate([np.ones(m), np.full(m, 0.5 * none)]),
        bounds=[(None, None)] * k,
        options={"primal_feasibility_tolerance": 1e-9},
    )
    if found.status != 0:
        raise RuntimeError(f"the linear program was not solved: {found.message}")
    weights = np.asarray(found.x)
    slip = vectors @ weights
    return weights if slip.min() >= -none * slip.max() and slip.max() > 0.5 else np.zeros(k)
