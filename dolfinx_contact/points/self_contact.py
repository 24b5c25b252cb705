# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discretisation of a face that may touch itself."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx_contact._mpi import keep
from dolfinx_contact.points.descriptions import ContactSurface, Overlap, SelfContact
from dolfinx_contact.points.sliding.points import SlidingFacets, check_slave
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import exterior_facets, tagged_facets

__all__ = ["DiscreteSelfContact"]


class DiscreteSelfContact(DiscreteSurface):
    """Discretisation of `SelfContact`. Collective.

    Args:
        contact: description of the face.

    Raises:
        ValueError: on every rank, as `points.pair.DiscretePair` with large sliding.
    """

    def __init__(self, contact: SelfContact):
        V = contact.u.function_space
        name = contact.name
        keep(V.mesh)
        tagged = tagged_facets(V.mesh.comm, contact.facets, contact.tag, name)
        face = exterior_facets(V.mesh, *tagged, name)
        obstacle = SlidingFacets(
            V,
            face,
            face,
            contact.search_distance,
            name,
            planes=contact.symmetry or {},
            direction=np.asarray(contact.direction),
        )
        super().__init__(
            ContactSurface(
                contact.u, face, obstacle=obstacle, law=contact.law, method="mixed", name=name
            )
        )
        self.description = contact
        overlap = Overlap.of(name, contact.interference, contact.remove_overlap)
        check_slave(self.points, self.law_at_points, name, overlap, itself=True)

    def hold(self, fixed: npt.NDArray[np.bool_], crossing: npt.NDArray[np.bool_]) -> None:
        self.points.require_held(fixed, self.name)
