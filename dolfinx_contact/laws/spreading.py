# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Nonlocal friction: the friction bound depends on the average pressure around a point.

The shear t_t is bounded by the friction coefficient F times the pressure p after convolution on the
surface with a smooth kernel omega of radius rho (Duvaut, C. R. Acad. Sci. Paris A 290, 1980; Oden
and Pires, J. Appl. Mech. 50, 1983, section 3; Demkowicz and Oden, Nonlinear Anal. 6, 1982),

    |t_t|(x) <= F (N p)(x),   (N p)(x) = int omega(|x - y|/rho) p(y) dy / int omega(|x - y|/rho) dy,

so that a constant pressure is preserved, also near the ends of the surface. In the mathematical
literature, the convolution is divided by the integral of omega over the whole plane (line in 2D)
and decreases near the ends; the ratio of both integrals is a field, by which F can be multiplied.
As in the literature, friction also acts on open points: it can hold an open point next to a closed
point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

import ufl

from dolfinx_contact._validate import positive
from dolfinx_contact.laws.friction import FrictionLaw
from dolfinx_contact.laws.law import ContactPoint, Scalar, Sign, constant_law

__all__ = ["NonlocalCoulomb", "kernel"]

Array = npt.NDArray[np.float64]


def kernel(x: Array) -> Array:
    """Return omega(x) = exp(1 - 1/(1 - x^2)) for x < 1, otherwise 0, with x = distance/radius."""
    inside = np.minimum(np.asarray(x) ** 2, 1.0 - 1e-12)
    return np.asarray(np.where(np.asarray(x) < 1.0, np.exp(1.0 - 1.0 / (1.0 - inside)), 0.0))


@constant_law
@dataclass(frozen=True)
class NonlocalCoulomb(FrictionLaw):
    """Coulomb friction with the bound F times the average pressure of neighbouring points.

    Distances are measured in the reference configuration. Points with Dirichlet conditions
    contribute zero pressure.

    Attributes:
        friction: friction coefficient F >= 0, a number, a Constant, a Function or a UFL expression.
        radius: distance rho > 0 up to which points contribute to the average, a number with the
            unit of length.

    Raises:
        ValueError: if the radius is not a positive number.
    """

    friction: Scalar
    radius: float
    needs_pressure = False
    signs: ClassVar[Mapping[str, Sign]] = {"friction": "nonnegative"}
    options = ("radius",)

    def __post_init__(self) -> None:
        radius = positive(
            self.radius, "the radius of NonlocalCoulomb", "a finite and positive number"
        )
        object.__setattr__(self, "radius", radius)
        super().__post_init__()

    @property
    def name(self) -> str:
        return f"NonlocalCoulomb({self.radius:g})"

    @property
    def averaging(self) -> float:  # type: ignore[override]
        return self.radius

    def bound(self, a: ContactPoint, p: Any) -> Any:
        return self.friction * a.around

    def grips(self, a: ContactPoint) -> Any:
        return ufl.gt(self.friction, 0.0)

    def holds(self, a: ContactPoint) -> Any:
        return ufl.And(self.grips(a), ufl.gt(a.around, 0.0))
