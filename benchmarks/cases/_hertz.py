# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Hertz contact: closed forms, and their comparison with a table of contact points.

An elastic body whose face has the radius of curvature $R$, pressed on a rigid plane, is close to a
half-space if the contact is small against $R$ and the body (Johnson, Contact Mechanics, 1985,
sections 4.2 and 5.5): with $E^* = E/(1-\nu^2)$, $x$ the distance from the axis and $P$ the load (in
2D per unit length),

$$p(x) = p_0\sqrt{1 - x^2/a^2},\qquad
a = \sqrt{4PR/(\pi E^*)},\ p_0 = \frac{2P}{\pi a}\ \text{(line)},\qquad
a = \sqrt[3]{3PR/(4E^*)},\ p_0 = \frac{3P}{2\pi a^2}\ \text{(point)}.$$

Two elastic bodies are as one on a plane, with $1/R = 1/R_1 + 1/R_2$ and
$1/E^* = (1-\nu_1^2)/E_1 + (1-\nu_2^2)/E_2$.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dolfinx_contact import ContactTable
from dolfinx_contact.plot import draw_curves

__all__ = ["Hertz"]

_INSIDE = 0.9  # of the contact: nodes at the edge cover both sides


@dataclass(frozen=True)
class Hertz:
    """Closed forms for one pair of bodies.

    Attributes:
        dim: 2 for line contact, 3 for point contact.
        curvature_radius: radius R of the relative curvature.
        stiffness: modulus E* of the pair.
        parts: number of copies of the meshed part in the whole body, by symmetry.
    """

    dim: int
    curvature_radius: float
    stiffness: float
    parts: int = 1

    def __post_init__(self) -> None:
        if self.dim not in (2, 3):
            raise ValueError(f"the dimension must be 2 or 3, got {self.dim}")
        if not (0 < self.curvature_radius < np.inf and 0 < self.stiffness < np.inf):
            raise ValueError("the radius of curvature and the stiffness must be positive")

    def radius(self, load: float) -> float:
        """Return the half width or radius of the contact."""
        if self.dim == 2:
            return float(np.sqrt(4 * load * self.curvature_radius / (np.pi * self.stiffness)))
        return float(np.cbrt(3 * load * self.curvature_radius / (4 * self.stiffness)))

    def peak(self, load: float) -> float:
        """Return the pressure on the axis."""
        a = self.radius(load)
        return float(2 * load / (np.pi * a) if self.dim == 2 else 3 * load / (2 * np.pi * a**2))

    def load(self, radius: float) -> float:
        """Return the load for a radius of the contact."""
        if self.dim == 2:
            return np.pi * self.stiffness * radius**2 / (4 * self.curvature_radius)
        return 4 * self.stiffness * radius**3 / (3 * self.curvature_radius)

    def approach(self, load: float, depth: float, poisson: float) -> float:
        """Return the approach of a point of the axis at a depth towards the contact.

        The body is a half-space (Johnson, sections 3.2 and 5.6). In 2D it is unbounded in the
        depth; in 3D it tends to a^2 / R.
        """
        a = self.radius(load)
        if self.dim == 2:
            part = 2 * np.log(2 * depth / a) - poisson / (1 - poisson)
            return float(load / (np.pi * self.stiffness) * part)
        beyond = load * (3 - 2 * poisson) / (2 * np.pi * self.stiffness * (1 - poisson) * depth)
        return float(a**2 / self.curvature_radius - beyond)

    def pressure(self, load: float, x: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the pressure at distances ``x`` from the axis."""
        part = np.maximum(1 - (np.asarray(x, dtype=float) / self.radius(load)) ** 2, 0)
        return np.asarray(self.peak(load) * np.sqrt(part))

    def compare(self, table: ContactTable) -> dict[str, float]:
        """Compare a table of contact points with the closed forms.

        p^2 is linear in x^2, so that a linear least-squares fit over the points inside 0.9 a, each
        with its area, gives radius and peak pressure without a look at the edge.

        Args:
            table: points of a body whose axis is at 0 in all coordinates but the last.

        Returns:
            ``load``; ``radius`` and ``peak_pressure`` of the fit, ``largest_pressure`` of a point,
            each with ``..._closed_form`` (the largest is compared with the peak) and relative
            ``..._error``; ``profile_error``, the root mean square deviation inside, over the peak;
            ``touching_radius`` and ``stick_radius`` of the zones as points show them.

        Raises:
            ValueError: if fewer than two points are inside the contact, or the pressures of these
                do not fall towards its edge.
        """
        load = float(table.rn.sum()) * self.parts
        a = self.radius(load)
        p0 = self.peak(load)
        p = table.pressure
        x = _from_axis(table)
        inside = x < _INSIDE * a
        if inside.sum() < 2:
            raise ValueError("fewer than two contact points are inside the contact: refine it")
        weights = np.sqrt(table.area[inside])
        x2 = x[inside] ** 2
        columns = np.column_stack([weights, -weights * x2])
        squared, slope = np.linalg.lstsq(columns, weights * p[inside] ** 2, rcond=None)[0]
        if not (squared > 0 and slope > 0):
            raise ValueError("the pressures are not those of a Hertzian contact")
        radius = np.sqrt(squared / slope)
        peak = np.sqrt(squared)
        largest = p.max()
        away = (p - self.pressure(load, x))[inside]

        def zone(letters: str) -> float:
            """Radius of the disc (half of the width) with the area of the points."""
            area = float(table.area[np.isin(table.letters, list(letters))].sum()) * self.parts
            return area / 2 if self.dim == 2 else float(np.sqrt(area / np.pi))

        return {
            "load": load,
            "radius": float(radius),
            "radius_closed_form": a,
            "radius_error": float(abs(radius / a - 1)),
            "peak_pressure": float(peak),
            "peak_pressure_closed_form": p0,
            "peak_pressure_error": float(abs(peak / p0 - 1)),
            "largest_pressure": float(largest),
            "largest_pressure_error": float(abs(largest / p0 - 1)),
            "profile_error": float(np.sqrt(np.average(away**2, weights=weights**2)) / p0),
            "touching_radius": zone("k+-s"),
            "stick_radius": zone("k"),
        }

    def draw(self, file: str | os.PathLike[str], table: ContactTable) -> None:
        """Draw the pressures of contact points beside the closed form; only on this rank.

        Arguments as in `compare`; errors as in `draw_curves`.
        """
        load = float(table.rn.sum()) * self.parts
        r = np.linspace(0.0, 1.25 * self.radius(load), 400)
        draw_curves(
            file,
            {"Hertz": (r, self.pressure(load, r))},
            marks={"contact points": (_from_axis(table), table.pressure)},
            labels=("distance from the axis", "pressure"),
        )


def _from_axis(table: ContactTable) -> npt.NDArray[np.float64]:
    return np.asarray(np.linalg.norm(table.x[:, :-1], axis=1))
