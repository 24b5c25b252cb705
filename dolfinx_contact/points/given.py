# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is given on a contact surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from dolfinx_contact._compat import interpolation_points
from dolfinx_contact._forms import compiled_expression
from dolfinx_contact.obstacles import Obstacle

__all__ = ["Given", "at_nodes", "fields_of"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Given:
    """What is given on the surface, in UFL on the body.

    Attributes:
        gap: signed distance to the obstacle.
        normal: unit normal, from the body into the obstacle.
        fields: of the law, by name.
    """

    gap: Any
    normal: Any
    fields: Mapping[str, Any]

    @property
    def all(self) -> tuple[Any, ...]:
        """All of it."""
        return self.gap, self.normal, *self.fields.values()

    @property
    def at_points(self) -> dict[str, Any]:
        """Everything by name; the fields of the law with a colon before theirs."""
        fields = {f":{name}": e for name, e in self.fields.items()}
        return {"gap": self.gap, "normal": self.normal, **fields}


def fields_of(values: Mapping[str, Array]) -> dict[str, Array]:
    """The fields of the law among values by the names of `Given.at_points`."""
    return {name[1:]: v for name, v in values.items() if name.startswith(":")}


def at_nodes(W: fem.FunctionSpace, surface: Obstacle) -> tuple[Array, Array]:
    """Gap and normal of an obstacle at the local nodes of a scalar P1 space. Collective."""
    domain = W.mesh
    found = []
    x = ufl.SpatialCoordinate(domain)
    # FFCx compiles no expression in which nothing but constants occurs.
    nothing = fem.Constant(domain, 0.0) * x
    gap, normal = surface.on(domain)
    for e, shape in ((gap + nothing[0], ()), (normal + nothing, (domain.geometry.dim,))):
        V = fem.functionspace(domain, ("Lagrange", 1, shape)) if shape else W
        f = fem.Function(V)
        f.interpolate(compiled_expression(e, interpolation_points(V)))
        f.x.scatter_forward()
        found.append(f.x.array.reshape(-1, *shape))
    return found[0], found[1]
