# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction laws: how large the tangential traction may be at a given contact pressure.

A law is the radius of the disc (in 2D, of the interval) that holds the tangential traction. The
unilateral condition is common to all of them and lives in `cone.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact._agreement import refuse_other_mesh

__all__ = ["Coulomb", "FrictionLaw", "Frictionless", "Scalar", "Tresca"]

#: A number, a `dolfinx.fem.Constant`, a `dolfinx.fem.Function` or any scalar UFL expression.
Scalar: TypeAlias = Any


def _as_coefficient(domain: mesh.Mesh, value: Scalar, what: str) -> Scalar:
    """``value`` as UFL: numbers become Constants, so that forms need no new compilation."""
    if isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool):
        if not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{what} must be finite and nonnegative, got {value}")
        return fem.Constant(domain, float(value))
    if not isinstance(value, ufl.core.expr.Expr) or value.ufl_shape != ():
        raise ValueError(
            f"{what} must be a nonnegative number, a Constant, a scalar Function or a scalar UFL "
            f"expression, got {value!r}"
        )
    refuse_other_mesh(value, domain, what)
    return value


class FrictionLaw:
    """Radius of the friction disc at a contact point. Units of traction."""

    #: Whether the disc shrinks to a point where there is no contact pressure.
    needs_pressure: bool = True

    def bound(self, p: Any) -> Any:
        """UFL radius of the friction disc at the augmented pressure ``p`` (> 0 in contact)."""
        raise NotImplementedError

    def bind(self, domain: mesh.Mesh) -> FrictionLaw:
        """This law with its numbers as Constants of ``domain``. Not collective.

        Raises:
            ValueError: if a number is negative or not finite, or something is of another mesh.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Frictionless(FrictionLaw):
    """Signorini contact: no tangential traction."""

    def bound(self, p: Any) -> Any:
        return 0.0 * p

    def bind(self, domain: mesh.Mesh) -> Frictionless:
        return self


@dataclass(frozen=True)
class Coulomb(FrictionLaw):
    """Coulomb friction, ``|lambda_t| <= F |lambda_n|`` (seed: Signorini-Coulomb, static form).

    Attributes:
        friction: coefficient F >= 0, a number, a Constant, a Function or a UFL expression.
    """

    friction: Scalar

    def bound(self, p: Any) -> Any:
        return self.friction * p

    def bind(self, domain: mesh.Mesh) -> Coulomb:
        friction = _as_coefficient(domain, self.friction, "the friction coefficient")
        return replace(self, friction=friction)


@dataclass(frozen=True)
class Tresca(FrictionLaw):
    """Tresca friction: a friction bound given in advance, ``|lambda_t| <= g`` on the whole surface.

    As in the mathematical literature the bound holds where the surface is open too; multiply it by
    a field that vanishes there to change that.

    Attributes:
        threshold: g >= 0 in units of traction, as for `Coulomb.friction`.
    """

    threshold: Scalar
    needs_pressure = False

    def bound(self, p: Any) -> Any:
        return self.threshold + 0.0 * p

    def bind(self, domain: mesh.Mesh) -> Tresca:
        threshold = _as_coefficient(domain, self.threshold, "the friction threshold")
        return replace(self, threshold=threshold)
