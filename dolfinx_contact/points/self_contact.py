# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of a face with itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._kept import keep
from dolfinx_contact._numbers import is_number
from dolfinx_contact.laws import Law
from dolfinx_contact.meshing import GmshMesh, tagged_facets
from dolfinx_contact.points.elements import check_name, displacement_degree
from dolfinx_contact.points.opposite import Overlap
from dolfinx_contact.points.sliding.points import SlidingFacets, check_slave
from dolfinx_contact.points.surface import ContactSurface
from dolfinx_contact.points.trace import checked_planes, exterior_facets

__all__ = ["SelfContact"]

_ALONG = 1e-9  # of a direction, its part across a plane of symmetry that is none


def _check(a: Arguments) -> None:
    if not isinstance(a.u, fem.Function):
        raise ValueError(f"the displacement must be a Function, got {type(a.u).__name__}")
    check_name(a.name, "surface")
    if displacement_degree(a.u) != 1:
        raise ValueError(f"{a.name}: self contact needs displacements of degree 1")
    domain = a.u.function_space.mesh
    if domain.ufl_domain().ufl_coordinate_element().degree != 1:
        raise ValueError(f"{a.name}: self contact needs cells with straight edges")
    distance = a.search_distance
    good = distance is None or (is_number(distance) and np.isfinite(distance) and distance > 0)
    if not good:
        raise ValueError(f"{a.name}: the search distance must be positive, got {distance!r}")
    a.symmetry = checked_planes(a.symmetry, domain.geometry.dim, a.name)
    Overlap.of(a.name, a.interference, a.remove_overlap)
    a.direction = _checked_direction(a.direction, domain.geometry.dim, a.name)
    across = [axis for axis in a.symmetry if abs(a.direction[axis]) > _ALONG]
    if across:
        raise ValueError(
            f"{a.name}: of a facet and the image of another the slave follows from a direction "
            f"along the plane of symmetry; {a.direction.tolist()} is not along that across "
            f"{'xyz'[across[0]]}"
        )


def _checked_direction(
    direction: npt.ArrayLike | None, dim: int, name: str
) -> npt.NDArray[np.float64]:
    """The direction, by default the last axis, or ``ValueError`` if it is none."""
    if direction is None:
        return np.eye(dim)[-1]
    try:
        found = np.asarray(direction, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (dim,) or not np.isfinite(found).all() or not found.any():
        raise ValueError(f"{name}: the direction must be {dim} numbers, not all 0: {direction!r}")
    return np.asarray(found / np.linalg.norm(found))


def _compared(a: Arguments) -> dict[str, Any]:
    return {"direction": a.direction.tolist(), "search_distance": a.search_distance} | {
        "symmetry": repr(a.symmetry)
    }


class SelfContact(ContactSurface):
    """A face that may touch itself, with a law, wherever it goes.

    It is a `ContactPair` with ``sliding="large"`` whose slave and master are one face, and has its
    limits. Of two facets that face each other the one whose middle lies farther along ``direction``
    in the mesh is the slave, so that each place counts once: for a ring that is pressed flat
    from above its upper half, for the default direction. Choose it so that the parts that will meet
    lie apart along it. With planes of symmetry, along which the direction has to be, facets meet
    images of others behind these, as they do in the whole model; what comes to a plane from the
    side is to touch a `HalfSpace` there. Facets do not face themselves, those that they share a
    node with, what looks the same way, and what lies behind them through the body: where that is
    thinner than ``search_distance``, bodies overlap by less than half of its thickness T in the
    mesh, or by (d + T)/2 at facets that start within the body at a depth d.

    Args:
        u: displacement of the body, a vector Lagrange Function of degree 1.
        facets: as for `ContactSurface`.
        law: of contact and friction.
        tag: tag, or name of a physical group of a mesh from gmsh.
        direction: (dim,), by default the last axis.
        search_distance: how far before and behind a facet something counts as opposite, a length;
            by default a quarter of the size of the face.
        interference, remove_overlap, symmetry: as of `ContactPair`.
        name: used in messages and tables.

    Raises:
        ValueError: on every rank, as `ContactPair` with large sliding; if the direction is none.
    """

    @collective("self contact", _check, compare=_compared, local=("facets", "law"), where="name")
    def __init__(
        self,
        u: fem.Function,
        facets: GmshMesh | mesh.MeshTags | npt.NDArray[np.int32],
        *,
        law: Law,
        tag: int | str | None = None,
        direction: npt.ArrayLike | None = None,
        search_distance: float | None = None,
        interference: bool | float = False,
        remove_overlap: float | None = None,
        symmetry: Mapping[int, float] | None = None,
        name: str = "contact",
    ):
        V = u.function_space
        keep(V.mesh)
        face = exterior_facets(V.mesh, *tagged_facets(V.mesh.comm, facets, tag, name), name)
        along = np.asarray(direction, dtype=np.float64)
        planes = symmetry or {}
        obstacle = SlidingFacets(
            V, face, face, search_distance, name, planes=planes, direction=along
        )
        super().__init__(u, face, obstacle=obstacle, law=law, method="mixed", name=name)
        overlap = Overlap.of(name, interference, remove_overlap)
        check_slave(self.points, self.law_at_points, name, overlap, itself=True)

    def hold(self, fixed: npt.NDArray[np.bool_], crossing: npt.NDArray[np.bool_]) -> None:
        self.points.require_held(fixed, self.name)
