# SPDX-License-Identifier: LGPL-3.0-or-later
"""The weight 2 pi r of integrals over half of a section of a body of revolution.

Users write integrands per volume or per area of the body. Every form of the user passes once
through `weighted`, where it enters the package, so that later modules need not know the weight.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import ufl

__all__ = ["circumference", "weighted"]


def circumference(domain: Any) -> Any:
    """Return 2 pi r with r = x, a UFL expression.

    Args:
        domain: mesh of the section, from DOLFINx or UFL.
    """
    return 2 * np.pi * ufl.SpatialCoordinate(domain)[0]


def weighted(form: ufl.Form, *, axisymmetric: bool) -> ufl.Form:
    """Return a form whose integrals over the section equal those over the whole body.

    Args:
        form: form of any rank, over cells, exterior or interior facets, without the weight.
        axisymmetric: whether the mesh is half of a section of a body of revolution; if not, the
            form is returned as it is.
    """
    if not axisymmetric:
        return form
    return ufl.Form(
        [
            it.reconstruct(integrand=circumference(it.ufl_domain()) * it.integrand())
            for it in form.integrals()
        ]
    )
