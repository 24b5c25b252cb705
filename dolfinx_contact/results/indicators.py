# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Indicators of model validity: measures of the modelling assumptions at a solution.

A solution satisfies the discrete equations; an indicator measures the violation of an assumption
behind these equations. Each indicator has one definition, one threshold (`LIMITS`) and one warning
(`Result.warnings`). "Facet" denotes the mean facet size of the contact surface; x, g, n, j are
position, gap, normal and jump at contact points.

| indicator | definition | threshold |
|---|---|---|
| `misfit` | small sliding: abs(true gap of the displaced point - gap of the law) at closed points; at open points the penetration missed by the law | 0.03 facets |
| `slip` | small sliding of a pair: slip since the undeformed state over the facet size of the other face | 0.5 |
| `turn` | small sliding of a pair: angle between the displaced normals of both faces and the normal of the law, the larger of the root mean square weighted by the normal forces and half the maximum over closed points | 3 degrees |
| `slip_in_step` | slip in a step over the facet size of the other face (large sliding, surfaces of facets) | 2 |
| `passing` | change of the contact normal in a step, in the frame of the obstacle, at a point whose path leads through it | 90 degrees |
| `approach` | large sliding of a pair: approach in a step of points without an opposing point, over the search distance | 1 |
| `behind_plane` | large sliding of a pair: depth of nodes behind a plane of symmetry, where they penetrate their mirror images | 0.01 facets |
| `spin` | rotation of a face over the other one about the contact normal in a step, weighted by the normal forces | 21 degrees |
| `between_points` | depth of an edge, corner, sphere or cylinder in a facet, between its contact points, over the size of the facet, or the radius if that is smaller | 0.2 |
| `across` | fraction of the normal forces where the normals of body and obstacle are more than 66 degrees apart | 0.02 |
| `overlap` | initial penetration of closed points into a rigid obstacle, over the smallest extent of the body; not evaluated with interference or remove_overlap, nor after the obstacle has moved | 0.05 |
| `beside` | depth in a rigid obstacle of boundary nodes that belong to no contact surface and are not clamped, over the local compression of `growth`; 0 if no point is closed | 0.05 |
| `facets` | height of the smooth surface over the touched facets of a `RigidSurface` that are wider than those of the body, from the averaged normals; mean with the normal forces as weights, over the local compression | 0.02 |
| `growth` | static law: fraction of the friction bound at closed points whose initial gap exceeds the smallest one by more than 1 % of the local compression p b/E (mean pressure p and extent b of the closed points, modulus E of the surface); for an obstacle that was moved, the present gaps must satisfy this condition as well; in large sliding of a pair, gaps end at the search distance | 0.05 |
| `pressure` | linear body: mean pressure of the closed points over the modulus of the surface, one to two times Young's modulus | 0.2 |
| `negative_bound` | user-defined laws: largest negative friction bound of closed points, as a nodal force, over the largest one | 1e-6 |
| `penetration` | compliant laws: largest -g | 0.1 facets |
| `min_det_F` | smallest det(I + grad u); for a linear body, only if displacements in it differ by more than its smallest extent | 0 (below) |
| `apart` | static law: smallest gap of a moved body that no contact point touches; faces of one body, as of a crack, do not count | 1e-12 of the body size |
| `floating` | rigid motions of a moved body that are restrained only by contact without force | any |
| `rotation` | linear body: largest mean rotation of a connected part | 11.5 degrees |
| `displacement` | linear body: largest difference of a displacement component between two nodes of a connected part, over the largest extent of the part | 1 |
| `speed`, `residue` | history, signs of a jump of the state within a step: rate of change of all unknowns over that in the previous step; energy of the step that is neither stored nor dissipated, over the sum of the magnitudes of external work, stored energy and dissipation in the step | both: 1.5 and 0.1 |
| `alternation` | history, laws that depend on the time of a step: smallest of the last three changes of shear over pressure (sums over a surface), if they alternate in sign and the shear does not, over the largest of the four values | 0.05 |

"In a step" means since the last accepted state of an evolution; in the static law, since the
undeformed state.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx import fem

from dolfinx_contact._arrays import Array, Mask
from dolfinx_contact._geometry import dot, tangential, unit
from dolfinx_contact._mpi import any_rank, anywhere, largest, maximum, minimum
from dolfinx_contact.body.cells import smallest_jacobian
from dolfinx_contact.body.rigid import (
    bounding_box,
    sums_of_parts,
)
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, SurfaceEvaluation
from dolfinx_contact.equations.measures import least_scales, round_off_force
from dolfinx_contact.laws.status import OPEN, STICK, closed
from dolfinx_contact.obstacles import Cylinder, Sphere, is_uniform
from dolfinx_contact.points.rigid_body import shape_of
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.surface_geometry import distance_from_face, simplices_of
from dolfinx_contact.results.tables import ContactTable
from dolfinx_contact.rigid_surfaces import RigidSurface
from dolfinx_contact.rigid_surfaces.closest import ClosestFacets

__all__ = [
    "LIMITS",
    "Indicators",
    "StepIndicators",
    "SurfaceIndicators",
    "alternation",
    "indicators_of",
    "small_sliding_violated",
    "surface_indicators",
]


#: Thresholds of the indicators; a warning is issued above them (for `min_det_F` at or below).
LIMITS = {
    "misfit": 0.03,
    "slip": 0.5,
    "turn": 3.0,
    "slip_in_step": 2.0,
    "passing": 90.0,
    "approach": 1.0,
    "behind_plane": 0.01,
    "spin": 21.0,
    "between_points": 0.2,
    "across": 0.02,
    "overlap": 0.05,
    "beside": 0.05,
    "facets": 0.02,
    "growth": 0.05,
    "pressure": 0.2,
    "negative_bound": 1e-6,
    "penetration": 0.1,
    "min_det_F": 0.0,
    "rotation": np.degrees(0.2),
    "displacement": 1.0,
    "speed": 1.5,
    "residue": 0.1,
    "alternation": 0.05,
}
_MESSAGES = {
    "misfit": "the gap at the displaced contact points differs by {:.2g} facet sizes from the gap "
    "of small sliding; use sliding='large'",
    "slip": "contact points have slid over {:.2g} facets of the other face, and small sliding "
    "keeps the opposing points of the mesh; use sliding='large'",
    "turn": "the contact normals have turned by {:.2g} degrees, and small sliding keeps the "
    "normals of the mesh; use sliding='large'",
    "slip_in_step": "contact points slip over {:.2g} facets of the other face in one step, where "
    "Newton's method may fail or find a folded state; take steps of about one facet",
    "passing": "the contact normal changes by {:.3g} degrees in one step where points come through "
    "the obstacle: the body may have passed through it; take shorter steps",
    "approach": "points without an opposing point approach the other face by {:.3g} search "
    "distances in one step: the bodies may have passed through each other; take shorter steps or a "
    "larger search_distance",
    "behind_plane": "nodes are {:.2g} facet sizes behind a plane of symmetry and penetrate their "
    "mirror images; add a contact surface with a HalfSpace in that plane as obstacle",
    "spin": "the face rotates over the other face by {:.3g} degrees in one step, and friction acts "
    "along the chord; take shorter steps",
    "between_points": "the obstacle penetrates a facet between contact points, where no law acts, "
    "by {:.2g} of the facet size or the radius; refine the face there",
    "across": "a fraction of {:.2g} of the normal forces is inclined to the normal of the face by "
    "more than 66 degrees: an edge of the obstacle ploughs, or the obstacle is on the wrong side; "
    "use method='integral', round the edge, or reverse the obstacle",
    "overlap": "the body starts in the obstacle, by {:.2g} of its smallest extent, and is pushed "
    "out; interference=True allows it, remove_overlap starts without stress",
    "beside": "a part of the boundary without contact surface penetrates the obstacle by {:.2g} of "
    "the compression at the contact; add its facets to the surface, or use a RigidSurface that "
    "ends before it",
    "facets": "the distance of the facets of the rigid surface from the smooth surface is {:.2g} "
    "of the compression, so that their edges affect the forces; use a finer triangulation, or a "
    "Sphere, Cylinder or LevelSet",
    "growth": "points that came into contact under the load account for {:.0%} of the "
    "friction bound, and the static law counts their motion before contact as slip; use "
    "QuasiStatic",
    "pressure": "the mean contact pressure is {:.2g} times the stiffness of a linear body, and "
    "linear elasticity assumes small strains; use materials.NeoHookean, or the same units for "
    "moduli, displacements and loads",
    "negative_bound": "the friction bound of the law is negative, by {:.2g} of the largest force, "
    "so that friction acts along the slip; let the bound end at 0, as in ufl.max_value(..., 0.0)",
    "penetration": "the surface gives way by {:.2g} facet sizes; increase the stiffness of the law",
    "min_det_F": "the body is turned inside out: the smallest det F is {:.3g}; use the same units "
    "for mesh, displacements and loads, smaller steps, or an energy without bound at det F = 0",
    "rotation": "a linear body has rotated by {:.3g} degrees, and linear strains are not invariant "
    "under rotations; use materials.StVenantKirchhoff or materials.NeoHookean",
    "displacement": "displacements within a linear body differ by {:.3g} times its size: are mesh, "
    "displacements and loads in the same units? Linear elasticity assumes small strains",
    "apart": "no contact point touches, the smallest gap is {:.3g}, and the surfaces have no "
    "effect; check the signs and units of loads and displacements, and the side of the obstacle",
    "floating": "a body has a free rigid motion ({}), restrained only by contact without force, "
    "so that its position is one of many; add a Dirichlet condition or a load",
    "jump": "the state may jump in step {} from the time {:.6g} to {:.6g}: it changes {:.3g} times "
    "faster than in the step before, and {:.0%} of the energy exchanged is neither stored nor "
    "dissipated; {}",
    "alternation": "friction alternates from step to step by a fraction of {:.2g}: if the law "
    "weakens with the speed, steps are too short; take longer steps, or NSCD with mass='lumped'",
}
_LOCATE = "QuasiStatic.run(..., locate_jumps=True) decides"
_LONGER = (
    "a law depends on the time of a step: if it weakens with the speed, take longer steps, or NSCD "
    "with mass='lumped'; otherwise " + _LOCATE
)
_LENGTHS = ("misfit", "penetration")  # compared with the facet size
_LEFT = 0.5  # facets beyond the edge of a master, from which a point has left it
_FACING = 0.5  # smallest cosine between normals of faces that face each other
_CARRYING = 1e-3  # of the largest traction, above which an open point counts as carrying
_ACROSS = 0.4  # cosine of the normals of body and obstacle, below which a force is across
_SAMPLES = 4  # samples of an edge of the obstacle per facet of the body
_AT_ONCE = 0.01  # range of initial gaps that close together, relative to the compression
_STRAIGHT = 0.9  # cosine with the normal of a facet, above which a corner lies below the facet
_ALTERNATING = 4  # steps in which friction may alternate
_ROUND_OFF = 1e-9  # relative excess of a threshold that is not an excess
_TINY = float(np.finfo(np.float64).tiny)


def _exceeding(values: Mapping[str, float | None]) -> dict[str, str]:
    """Return messages about the indicators that exceed their thresholds, by name."""
    return {
        name: _MESSAGES[name].format(value)
        for name, value in values.items()
        if value is not None and value > LIMITS[name] * (1.0 + _ROUND_OFF)
    }


@dataclass(frozen=True)
class SurfaceIndicators:
    """Indicators of a contact surface; see the table at the top of the module.

    Attributes:
        facet: mean facet size, a length.
        misfit: error of the gap; None if the obstacle is unknown at displaced points.
        slip: slip since the undeformed state, relative to the facet size of the other face.
        turn: rotation of the contact normals, in degrees.
        slip_in_step: slip in a step, relative to the facet size of the other face.
        passing: change of the contact normal in a step, in degrees.
        approach: approach in a step, relative to the search distance.
        behind_plane: depth behind a plane of symmetry, relative to the facet size.
        spin: rotation of a face over the other one in a step, in degrees.
        between_points: depth of the obstacle in a facet, relative to the size of the facet, or to
            the radius of the obstacle if that is smaller.
        across: fraction of the normal forces at points where the normals of body and obstacle are
            more than 66 degrees apart.
        overlap: initial penetration of closed points into the obstacle, relative to the smallest
            extent of the body.
        beside: depth in the obstacle of boundary nodes that belong to no contact surface, relative
            to the local compression.
        facets: height of the smooth surface over the facets of a rigid surface, relative to the
            local compression.
        growth: fraction of the total friction bound at points that came into contact under the
            load; 0 in steps from a state.
        pressure: mean pressure of the closed points of a linear body, relative to its modulus.
        negative_bound: largest negative friction bound of closed points, as a nodal force relative
            to the largest one.
        penetration: largest depth of penetration; None if the law is not compliant.
    """

    facet: float
    misfit: float | None = None
    slip: float = 0.0
    turn: float = 0.0
    slip_in_step: float = 0.0
    passing: float = 0.0
    approach: float = 0.0
    behind_plane: float = 0.0
    spin: float = 0.0
    between_points: float = 0.0
    across: float = 0.0
    overlap: float = 0.0
    beside: float = 0.0
    facets: float = 0.0
    growth: float = 0.0
    pressure: float = 0.0
    negative_bound: float = 0.0
    penetration: float | None = None

    @property
    def warnings(self) -> dict[str, str]:
        """Messages about the indicators that exceed their thresholds, by name."""
        values = {**vars(self)}
        facet = values.pop("facet")
        for name in _LENGTHS:
            if values[name] is not None:
                values[name] /= facet
        return _exceeding(values)


@dataclass(frozen=True)
class StepIndicators:
    """Indicators of a jump of the state within a step of a history, and of alternating friction.

    Attributes:
        number: index of the step.
        start: time at the start of the step.
        time: time at the end of the step.
        speed: rate of change of all unknowns, relative to the previous step.
        residue: energy neither stored nor dissipated, relative to the energy exchanged in the step;
            positive for the energy released by a jump.
        searched: whether the run itself locates jumps, so that no warning is needed.
        timed: whether a law depends on the duration of a step, so that friction may decrease with
            the slip velocity.
        alternation: smallest of the last three changes of the ratio of shear to pressure, if they
            alternate in sign, relative to the largest ratio; 0 otherwise, and for laws that do not
            depend on time.
    """

    number: int
    start: float
    time: float
    speed: float
    residue: float
    searched: bool = False
    timed: bool = False
    alternation: float = 0.0

    @property
    def warnings(self) -> dict[str, str]:
        """Messages about a possible jump and alternating friction, by name."""
        found = _exceeding({"alternation": self.alternation})
        jumps = self.speed > LIMITS["speed"] and self.residue > LIMITS["residue"]
        if jumps and not self.searched:
            values = self.number, self.start, self.time, self.speed, self.residue
            advice = _LONGER if self.timed else _LOCATE
            found = {"jump": _MESSAGES["jump"].format(*values, advice)} | found
        return found


@dataclass(frozen=True)
class Indicators:
    """Indicators of model validity at a solution.

    Attributes:
        surfaces: indicators by surface name.
        min_det_F: smallest det(I + grad u), including the hoop stretch of a body of revolution;
            None for linear bodies with displacements differing by less than the smallest extent.
        rotation: largest mean rotation of a connected part in degrees; None for a nonlinear body
            and for bodies of revolution.
        displacement: largest difference of a displacement component in a connected part, over the
            largest extent of the part; None for a nonlinear body.
        step: indicators of a jump within the step of a history; None for other solves, first steps
            and steps from states that are not solutions.
        apart: static law: smallest gap of a moved body that no contact point touches, or None.
        floating: rigid motions of moved bodies that are restrained only by contact without force;
            "" if there are none.
    """

    surfaces: dict[str, SurfaceIndicators]
    min_det_F: float | None = None
    rotation: float | None = None
    displacement: float | None = None
    step: StepIndicators | None = None
    apart: float | None = None
    floating: str = ""

    @property
    def warnings(self) -> dict[str, str]:
        """Messages by indicator and surface, with keys such as ``"misfit of 'floor'"``."""
        found = {}
        if self.min_det_F is not None and not self.min_det_F > LIMITS["min_det_F"]:
            found["min_det_F"] = _MESSAGES["min_det_F"].format(self.min_det_F)
        found |= _exceeding({"rotation": self.rotation, "displacement": self.displacement})
        if self.apart is not None:
            found["apart"] = _MESSAGES["apart"].format(self.apart)
        if self.floating:
            found["floating"] = _MESSAGES["floating"].format(self.floating)
        if self.step is not None:
            found |= self.step.warnings
        for surface, s in self.surfaces.items():
            found |= {f"{name} of {surface!r}": text for name, text in s.warnings.items()}
        return found


def indicators_of(eq: ContactEquations, evaluation: Evaluation) -> Indicators:
    """Return the indicators of model validity at the state in the user's Functions. Collective."""
    det = turn = displacement = None
    large = True
    if eq.bulk.linear:
        parts = eq.scaling.parts
        if not eq.axisymmetric:
            turn = float(np.degrees(parts.largest_turn(evaluation.u)))
        moved, extents = parts.differences(evaluation.u)
        displacement = float(np.max(moved / extents.max(axis=1)))
        # a linear body is turned inside out only where the difference exceeds its thickness
        large = bool(np.any(moved > extents.min(axis=1)))
    if large:
        det, _ = smallest_jacobian(eq.V, evaluation.u, axisymmetric=eq.axisymmetric)
    return Indicators(
        surface_indicators(eq, evaluation),
        det,
        turn,
        displacement,
        apart=_apart(eq, evaluation),
        floating=_floating(eq, evaluation),
    )


def alternation(tables: Sequence[ContactTable]) -> float:
    """Return the indicator of friction alternating from step to step (`StepIndicators`).

    Args:
        tables: tables of the surface at the ends of the last steps, in order of time.
    """
    if len(tables) < _ALTERNATING:
        return 0.0
    pressures = [t.rn.sum() for t in tables[-_ALTERNATING:]]
    if min(pressures) <= 0.0:
        return 0.0
    shears = [t.rt.sum(axis=0) for t in tables[-_ALTERNATING:]]
    ratios = np.array(shears) / np.array(pressures)[:, None]
    changes = np.diff(ratios, axis=0)
    alternates = (dot(changes[1:], changes[:-1]) < 0.0).all()
    if not alternates or (dot(ratios[1:], ratios[:-1]) <= 0.0).any():
        return 0.0
    sizes, largest = np.linalg.norm(changes, axis=1), np.linalg.norm(ratios, axis=1).max()
    return float(sizes.min() / largest)


def _apart(eq: ContactEquations, evaluation: Evaluation) -> float | None:
    """Return the smallest gap if a body has moved and touches nothing, otherwise None.

    The faces of a crack, and a face that may touch itself, belong to one body and may stay open.
    Displacements and gaps that are round-off of the body size count as zero. Collective.
    """
    if not eq.is_static:
        return None
    _, none = least_scales(eq, 0.0)
    moved, acting, gaps = bool(np.any(np.abs(evaluation.u) > none)), False, []
    for s, contact, clamped in _contacts(eq, evaluation):
        acting |= bool(np.any(closed(contact.statuses) & ~clamped) or np.any(contact.answer))
        if not _within_one_part(eq, s):
            gaps.append(contact.kinematics.gap[~clamped])
    free = any(len(gap) for gap in gaps)
    moved, acting, free = anywhere(eq.comm, moved, acting, free)
    smallest = minimum(eq.comm, np.nan_to_num(np.concatenate([*gaps, []]), nan=np.inf), np.inf)
    return smallest if moved and free and not acting and abs(smallest) > none else None


def _within_one_part(eq: ContactEquations, s: DiscreteSurface) -> bool:
    """Return whether both faces of a pair belong to one connected part. Collective."""
    opposite = s.obstacle.opposite
    if opposite is None:
        return False
    part = eq.scaling.parts.of_nodes[opposite.sides[0] | opposite.sides[1]].astype(float)
    return minimum(eq.comm, part, np.inf) == -minimum(eq.comm, -part, np.inf)


def _floating(eq: ContactEquations, evaluation: Evaluation) -> str:
    """Describe rigid motions restrained only by contact without force; "" if none. Collective."""
    scaling = eq.scaling
    if not len(scaling.loose):
        return ""
    size = maximum(eq.comm, np.abs(evaluation.u))
    mobile = scaling.loose.any(axis=(0, 2))
    moved = bool(np.any(np.abs(evaluation.u.reshape(-1, eq.dim)[mobile]) > _ROUND_OFF * size))
    if not any_rank(eq.comm, moved):
        return ""
    least = _ROUND_OFF * round_off_force(eq, size)
    carrying = []
    for s, contact in zip(eq.surfaces, evaluation.surfaces, strict=True):
        force = np.linalg.norm(contact.traction, axis=1) * s.points.areas
        carrying.append(np.where(force > least, contact.statuses, OPEN))
    restrained = not scaling.unrestrained_motions(evaluation.statuses, evaluation)
    return scaling.unrestrained_motions(carrying, evaluation) if restrained else ""


def small_sliding_violated(eq: ContactEquations, evaluation: Evaluation) -> str:
    """Return the reasons why small sliding is not valid at a state; "" if it is. Collective.

    Proofs reject a state with such a reason, because the discrete problem differs from the problem
    of the displaced bodies.
    """
    found = {
        s.name: _of_small_sliding(eq, s, evaluation, contact, clamped)
        for s, contact, clamped in _contacts(eq, evaluation)
    }
    return "; ".join(f"{name}: {text}" for name, text in Indicators(found).warnings.items())


def surface_indicators(
    eq: ContactEquations, evaluation: Evaluation
) -> dict[str, SurfaceIndicators]:
    """Return the indicators of every contact surface, by name. Collective."""
    return {
        s.name: _of_surface(eq, s, evaluation, contact, clamped)
        for s, contact, clamped in _contacts(eq, evaluation)
    }


def _of_surface(
    eq: ContactEquations,
    s: DiscreteSurface,
    evaluation: Evaluation,
    contact: SurfaceEvaluation,
    clamped: Mask,
) -> SurfaceIndicators:
    """Return the indicators of a surface; ``clamped`` is the mask of clamped points. Collective."""
    found = _of_small_sliding(eq, s, evaluation, contact, clamped)
    depth = maximum(s.comm, np.nan_to_num(-contact.kinematics.gap)) if s.law.compliant else None
    found = replace(
        found,
        spin=_spin(eq, s, contact),
        penetration=depth,
        growth=_growth(eq, s, contact),
        pressure=_pressure(eq, s, contact) if eq.bulk.linear else 0.0,
        negative_bound=_negative_bound(eq, s, evaluation, contact),
    )
    if s.slides:
        passed = contact.kinematics.operator.facets_passed  # type: ignore[attr-defined]
        return replace(
            found,
            slip_in_step=maximum(s.comm, _touching(contact, passed)),
            approach=_approach(s, evaluation, contact),
            behind_plane=_behind_plane(s, evaluation) / found.facet,
        )
    if s.between_bodies:
        return found
    return replace(
        found,
        slip_in_step=_slip_over_facets(s, contact),
        passing=_passing(s, contact),
        between_points=_between_points(s, evaluation),
        across=_across(eq, s, evaluation, contact, clamped),
        overlap=_overlap(eq, s, contact),
        beside=_beside(eq, s, evaluation, contact),
        facets=_facets(eq, s, contact),
    )


def _contacts(
    eq: ContactEquations, evaluation: Evaluation
) -> list[tuple[DiscreteSurface, SurfaceEvaluation, Mask]]:
    """Return each surface, its evaluation, and the mask of points clamped by Dirichlet data."""
    clamped = [c.clamped_points for c in eq.constraints.surfaces]
    return list(zip(eq.surfaces, evaluation.surfaces, clamped, strict=True))


def _negative_bound(
    eq: ContactEquations, s: DiscreteSurface, evaluation: Evaluation, contact: SurfaceEvaluation
) -> float:
    """Return the magnitude of the most negative friction bound of closed points. Collective.

    As a nodal force, it is divided by the largest contact force; 0 at rest (only round-off).
    """
    areas = s.points.areas
    below = maximum(s.comm, _touching(contact, np.nan_to_num(-contact.answers.bound)) * areas)
    largest = maximum(s.comm, np.linalg.norm(contact.traction, axis=1) * areas)
    size = maximum(s.comm, np.abs(evaluation.u))
    none, _ = least_scales(eq, size)
    return below / max(largest, round_off_force(eq, size)) if below > none else 0.0


def _growth(eq: ContactEquations, s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return the fraction of the friction bound at points that closed under the load. Collective.

    Points with nearly equal initial gaps close simultaneously and are not counted, because they
    move together before contact. Differences of gaps are compared with the compression of the body
    near the points, since displacements far away may be large. The obstacle may have been moved
    since the start, as a load or to another position.
    """
    if contact.kinematics.memory is not None or STICK not in s.law_at_points.codes:
        return 0.0
    compression = _compression(eq, s, contact)
    late = np.ones(len(contact.statuses), dtype=bool)
    for gaps in (
        np.maximum(s.start_gaps, 0.0),
        s.start_gaps if s.between_bodies else s.points.gaps,
    ):
        late &= gaps - minimum(s.comm, gaps, np.inf) > _AT_ONCE * compression
    bound = np.maximum(_touching(contact, np.nan_to_num(contact.answers.bound)), 0.0)
    bound = bound * s.points.areas
    return _ratio_of_sums(s.comm, bound[late].sum(), bound.sum())


def _pressure(eq: ContactEquations, s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return the mean pressure over the modulus at the stiffest vertex of a surface. Collective."""
    touching = closed(contact.statuses)
    areas = s.points.areas[touching]
    pressure = np.abs(dot(contact.traction, contact.data.n))[touching]
    force, area = s.comm.allreduce(np.array([pressure @ areas, areas.sum()]))
    if area == 0.0:
        return 0.0
    geometry = s.points.geometry
    width = (geometry.vertex_areas / geometry.circumferences) ** (1 / (s.dim - 1))
    modulus = maximum(s.comm, eq.scaling.at_vertices[eq.surfaces.index(s)] * width)
    return float(force / area / modulus)


def _compression(eq: ContactEquations, s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return p b/E with mean pressure p, extent b and modulus E of the closed points. Collective.

    Round-off of the body size is added if points are closed.
    """
    touching = closed(contact.statuses)
    if not any_rank(s.comm, touching.any()):
        return 0.0
    low, high = bounding_box(s.comm, s.positions[touching])
    extent = float(np.linalg.norm(high - low)) + s.points.geometry.facet_size
    return _pressure(eq, s, contact) * extent + _ROUND_OFF * eq.body_size


def _touching(contact: SurfaceEvaluation, values: Array) -> Array:
    """Return the values at closed points, and 0 at open points."""
    return np.where(closed(contact.statuses), values, 0.0)


def _normal_forces(contact: SurfaceEvaluation, areas: Array) -> Array:
    """Return the compressive normal forces at closed points; 0 at open points and in tension."""
    return np.maximum(_touching(contact, -dot(contact.traction, contact.data.n)), 0.0) * areas


def _ratio_of_sums(comm: MPI.Comm, part: float, whole: float) -> float:
    """Return the ratio of two sums over all ranks; 0 if the denominator is 0. Collective."""
    parts, wholes = comm.allreduce(np.array([part, whole]))
    return float(parts / wholes) if wholes > 0 else 0.0


def _angles(a: Array, b: Array) -> Array:
    """Return the angles between unit vectors a and b, shape (n, dim) each, in degrees."""
    return np.degrees(2.0 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=1) / 2.0, 1.0)))


# -- small sliding -------------------------------------------------------------------------------


def _of_small_sliding(
    eq: ContactEquations,
    s: DiscreteSurface,
    evaluation: Evaluation,
    contact: SurfaceEvaluation,
    clamped: Mask,
) -> SurfaceIndicators:
    """Return `misfit` of a surface and, for a pair, `slip` and `turn`. Collective."""
    found = SurfaceIndicators(s.points.geometry.facet_size, 0.0)
    if s.between_bodies and not s.slides:
        return _of_pair(s, evaluation, contact, clamped, found)
    if s.obstacle.flat or s.displaced is not None:
        return found
    true = s.true_gaps()
    if true is None:
        return replace(found, misfit=None)
    off = _off(eq.terms[eq.surfaces.index(s)].gaps(evaluation), true, closed(contact.statuses))
    return replace(found, misfit=maximum(s.comm, np.where(clamped, 0.0, off)))


def _off(law: Array, true: Array, is_closed: Mask) -> Array:
    """Return the errors of the gaps used by the law, shape (n,).

    At closed points, the error is the magnitude of the difference between the two gaps. At open
    points, it is the part of the true penetration that is missing in the gap of the law.

    Args:
        law: gaps of the law, shape (n,).
        true: gaps of the displaced points, shape (n,).
        is_closed: mask of the closed points, shape (n,).
    """
    depth = np.maximum(np.maximum(-true, 0.0) - np.maximum(-law, 0.0), 0.0)
    return np.where(is_closed, np.abs(true - law), depth)


def _of_pair(
    s: DiscreteSurface,
    evaluation: Evaluation,
    contact: SurfaceEvaluation,
    clamped: Mask,
    found: SurfaceIndicators,
) -> SurfaceIndicators:
    """Return ``found`` with `misfit`, `slip` and `turn` of a pair in small sliding. Collective."""
    at = contact.kinematics
    n = s.points.data.n
    jump = at.jump + at.reference
    u = evaluation.u.reshape(-1, s.dim)
    touching = closed(contact.statuses) & ~clamped
    # compare the master where it is with the master of the mesh, whose facets may be chords
    facets = s.obstacle.opposite.master_facets
    master, width = simplices_of(s.u.function_space, facets, u)
    x = s.positions
    before = distance_from_face(master[0], x)
    after = distance_from_face(master[1], x + s.displacements(u))
    cosine = np.clip(-dot(n, before.normal), _FACING, 1.0)
    law = s.points.data.gap - dot(jump, n)
    true = s.points.data.gap + (after.gap - before.gap) / cosine
    off = _off(law, true, touching)
    faces = (dot(n, after.normal) < -_FACING) & (after.beyond <= 1e-9 * found.facet)
    beyond = after.beyond - before.beyond
    off = np.where(touching | (faces & ~clamped), off, 0.0)
    off = np.where(touching & (beyond > _LEFT * found.facet), np.hypot(beyond, true), off)
    # slips of points that are closed or transmit a traction across a gap, as bonds do
    size = np.linalg.norm(contact.traction, axis=1)
    acting = touching | ((size > _CARRYING * maximum(s.comm, size)) & ~clamped)
    along = np.linalg.norm(tangential(jump, n), axis=1)
    area = s.comm.allreduce(float(s.points.areas.sum()))
    width = min(width, max(area ** (1 / (s.dim - 1)), found.facet))
    # normals
    outward = [s.points.outward(v) for v in (u, np.zeros_like(u))]
    turn = np.maximum(
        _angles(n, outward[0]) - _angles(n, outward[1]),
        _angles(n, -after.normal) - _angles(n, -before.normal),
    )
    turn = np.maximum(turn, 0.0)
    forces = np.where(clamped, 0.0, _normal_forces(contact, s.points.areas))
    mean = float(np.sqrt(_ratio_of_sums(s.comm, forces @ turn**2, forces.sum())))
    return replace(
        found,
        misfit=maximum(s.comm, off),
        slip=maximum(s.comm, np.where(acting, along, 0.0)) / width,
        turn=max(mean, maximum(s.comm, _touching(contact, turn)) / 2),
    )


# -- steps ---------------------------------------------------------------------------------------


def _slip_over_facets(s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return the slip in a step over the larger facet size of body and obstacle. Collective.

    For obstacles other than rigid surfaces of facets the result is 0.
    """
    shape = shape_of(s.obstacle)
    if not isinstance(shape, RigidSurface):
        return 0.0
    width = max(s.points.geometry.facet_size, shape.facet_size)
    slips = np.linalg.norm(contact.kinematics.increment, axis=1)
    return maximum(s.comm, _touching(contact, slips)) / width


def _passing(s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return the largest change of normal, in degrees, of points passing through the obstacle.

    The path of a point in the step leads through the obstacle if the normal changes by more than a
    right angle and an intermediate position lies inside the obstacle, all in the frame of the
    obstacle. The intermediate position divides the path in the ratio of the gaps at its ends.
    Collective.
    """
    at, shape = contact.kinematics, s.displaced
    if shape is None or at.place is None:
        return 0.0
    start = np.zeros_like(at.place) if at.memory is None else at.memory.place
    if start is None:
        return 0.0
    gap, before = shape.gaps_and_normals(start)
    after = at.data.n
    if s.rigid_body is not None and at.motion is not None:
        after = after @ s.rigid_body.kinematics.rotation(at.motion)
    turned = dot(before, after) < 0.0
    if not any_rank(s.comm, turned):
        return 0.0
    first, last = np.maximum(gap, 0.0), np.maximum(at.gap, 0.0)
    part = np.divide(first, first + last, out=np.full_like(first, 0.5), where=first + last > 0)
    middle = start + part[:, None] * (at.place - start)
    turned &= shape.gaps_and_normals(middle)[0] < 0.0
    return maximum(s.comm, np.where(turned, _angles(before, after), 0.0))


def _approach(s: DiscreteSurface, evaluation: Evaluation, contact: SurfaceEvaluation) -> float:
    """Return the largest approach in a step of unopposed slave points. Collective.

    It is measured along the normal, relative to the mean motion of the master, and divided by the
    search distance.
    """
    opposite = s.obstacle.opposite
    n = s.owned_nodes
    moved: Array = evaluation.u.reshape(-1, s.dim)[:n]
    memory = contact.kinematics.memory
    if memory is not None and memory.displacement is not None:
        moved = moved - memory.displacement
    master = moved[opposite.sides[1][:n]]
    sums = s.comm.allreduce(np.append(master.sum(axis=0), len(master)))
    nodes = s.points.vertex_nodes[: s.points.number]
    absent = contact.kinematics.operator.absent
    assert absent is not None
    alone = absent & (nodes < n)
    way = (moved[nodes[alone]] - sums[:-1] / sums[-1]) * contact.data.n[alone]
    return maximum(s.comm, way.sum(axis=1)) / opposite.depth


def _behind_plane(s: DiscreteSurface, evaluation: Evaluation) -> float:
    """Return the largest depth of nodes of both faces behind planes of symmetry. Collective."""
    opposite = s.obstacle.opposite
    n = s.owned_nodes
    faces = np.logical_or(*opposite.sides)[:n]
    X = s.node_positions[:n][faces]
    x = X + evaluation.u.reshape(-1, s.dim)[:n][faces]
    depth = 0.0
    for axis, place in opposite.planes.items():
        side = np.sign(s.comm.allreduce(float(np.sum(X[:, axis] - place))))
        depth = max(depth, maximum(s.comm, side * (place - x[:, axis])))
    return depth


def _spin(eq: ContactEquations, s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return the largest rotation, in a step, of a face over the other one, in degrees.

    In a pair, the rotation of a connected part of the face is the root mean square of the angles at
    its points. On an obstacle it is the rotation of the points about their mean normal, by least
    squares. The weights are the normal forces. Small sliding of pairs, and of linear bodies on
    obstacles that do not rotate, is not tested, because it assumes small displacements. Collective.
    """
    turns = s.rigid_body is not None and s.rigid_body.turns
    small = s.between_bodies or (eq.bulk.linear and s.displaced is None and not turns)
    if s.dim == 2 or STICK not in s.law_at_points.codes or (small and not s.slides):
        return 0.0
    at = contact.kinematics
    weights = _normal_forces(contact, at.operator.areas)[:, None]
    part, number = s.parts[0].astype(np.int32), s.parts[1]

    def means(values: Array) -> Array:
        rows = weights * np.column_stack([np.ones(len(values)), values])
        sums = sums_of_parts(s.comm, number, part, rows)
        return np.asarray(sums[:, 1:] / np.maximum(sums[:, :1], _TINY))

    if s.slides:
        apart = at.operator.facing.nodal.apart[: s.points.number]  # type: ignore[attr-defined]
        return float(np.degrees(np.sqrt(means(apart**2).max(initial=0.0))))
    # the start and the end of the step in the frame of the obstacle, about their means
    before: Any = np.zeros_like(weights)
    if at.memory is not None:
        before = at.memory.jump if at.memory.place is None else at.memory.place
    x = at.operator.apply(s.node_positions[: s.owned_nodes])
    x, y = (v - means(v)[part] for v in (x + before, x + at.path[0]))
    axis = unit(means(at.path[1]))[part]
    sine = dot(axis, np.cross(x, y))
    cosine = dot(x, y) - dot(axis, x) * dot(axis, y)
    angles = np.arctan2(*means(np.stack([sine, cosine], axis=1)).T)
    return float(np.degrees(np.max(np.abs(angles), initial=0.0)))


# -- edges of the obstacle -----------------------------------------------------------------------


def _between_points(s: DiscreteSurface, evaluation: Evaluation) -> float:
    """Return the largest depth of the obstacle in a facet of the surface. Collective.

    The depth is evaluated for corners and edges of a rigid surface, spheres and cylinders. It is
    relative to the facet size, or to the radius if that is smaller.
    """
    now, cells, normals = s.points.facets.simplices(evaluation.u.reshape(-1, s.dim))
    corners = now[cells]
    sizes = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    low, high = bounding_box(s.comm, corners.reshape(-1, s.dim))
    probes, radius = _probes(s, (low, high), s.points.geometry.facet_size / _SAMPLES)
    reach = maximum(s.comm, sizes) + radius
    probes = probes[((probes > low - reach) & (probes < high + reach)).all(axis=1)]
    if not len(probes):  # on every rank
        return 0.0
    depth: Array = np.zeros(len(probes))
    distance: Array = np.full(len(probes), np.inf)
    if len(cells):
        found, parts, feet, distance = ClosestFacets(now, cells)(probes)
        height = dot(probes - feet, normals[found])
        depth = radius - np.where(height < 0.0, -distance, distance)
        # subtract the depth of the nearest contact point and a removed overlap
        away = np.linalg.norm(corners[found] - probes[:, None], axis=2).min(axis=1)
        depth = depth - np.maximum(radius - away, 0.0)
        taken = s.points.removed_at_vertices
        if taken is not None:
            depth = depth - dot(parts, taken.x.array[cells[found]])
        if radius == 0.0:  # corners beside the face, or on the far side of the body
            below = (height < -_STRAIGHT * distance) & (depth < sizes[found])
            depth = np.where(below, depth, 0.0)
        depth /= np.minimum(sizes[found], radius if radius > 0.0 else np.inf)
    closest = distance <= -largest(s.comm, -distance)
    return maximum(s.comm, depth[closest])


def _probes(s: DiscreteSurface, box: tuple[Array, Array], spacing: float) -> tuple[Array, float]:
    """Return points of the displaced obstacle that may lie in a facet, and a radius around them.

    They lie on a rigid surface, its creases and rims (radius 0), at the centre of a sphere or on
    the axis of a cylinder at distances up to ``spacing``; other obstacles have none. The shape is
    (n, dim).
    """
    shape = shape_of(s.obstacle)
    if isinstance(shape, RigidSurface):
        points = shape.points + s.partner.dragged(shape.points)
        return np.concatenate(
            [points, *(_between(points[i], points[j], spacing) for i, j in shape.edges)]
        ), 0.0
    given: tuple[Any, ...] = ()
    if isinstance(shape, Sphere):
        given = shape.radius, shape.centre
    elif isinstance(shape, Cylinder):
        given = shape.radius, shape.point, shape.axis
    known = [v for v in map(_numbers, given) if v is not None]
    if not known or len(known) < len(given):
        return np.zeros((0, s.dim)), 0.0
    radius, place = float(known[0]), known[1] + s.partner.dragged(known[1][None])[0]
    if len(known) == 2:
        return place[None], radius
    # points along the axis as far as the face reaches
    axis = known[2] / np.linalg.norm(known[2])
    middle = place + ((box[0] + box[1]) / 2 - place) @ axis * axis
    half = np.linalg.norm(box[1] - box[0]) * axis
    return _between(middle - half, middle + half, spacing), radius


def _between(a: Array, b: Array, spacing: float) -> Array:
    """Return points on the segment from a to b, at most ``spacing`` apart, shape (n, dim)."""
    number = int(np.ceil(np.linalg.norm(b - a) / spacing)) + 1
    return np.asarray(np.linspace(a, b, number))


def _numbers(given: Any) -> Array | None:
    """Return the values of numbers and Constants; None for other UFL expressions."""
    if isinstance(given, fem.Constant):
        return np.asarray(given.value, dtype=np.float64)
    try:
        return np.asarray(given, dtype=np.float64) if is_uniform(given) else None
    except (TypeError, ValueError):
        return None


def _overlap(eq: ContactEquations, s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return the largest initial penetration of closed points into an obstacle. Collective.

    It is divided by the smallest extent of the body; 0 with an interference, a removed overlap or a
    moved obstacle.
    """
    given = s.description
    if given.interference is not None or given.remove_overlap is not None:
        return 0.0
    moved = not np.array_equal(s.start_gaps, s.points.gaps)
    depth = maximum(s.comm, _touching(contact, -s.start_gaps))
    low, high = bounding_box(eq.comm, s.node_positions)
    return 0.0 if any_rank(eq.comm, moved) else depth / float(np.min(high - low))


def _beside(
    eq: ContactEquations, s: DiscreteSurface, evaluation: Evaluation, contact: SurfaceEvaluation
) -> float:
    """Return the largest depth in the obstacle of boundary nodes on no contact surface.

    The depth is divided by the local compression (`_compression`). Collective.
    """
    compression = _compression(eq, s, contact)
    if compression == 0.0:
        return 0.0
    motion = None if s.rigid_body is None else s.rigid_body.values
    u = evaluation.u.reshape(-1, s.dim)[: s.owned_nodes]
    x = s.node_positions[: s.owned_nodes] + s.partner.relative(u, motion)
    gaps = s.gaps_at(x[eq.bare_nodes])
    if gaps is None:
        return 0.0
    taken = s.points.removed_overlap
    removed = 0.0 if taken is None else maximum(s.comm, taken.x.array)
    depth = maximum(s.comm, np.nan_to_num(-gaps)) - removed
    return max(depth, 0.0) / compression


def _facets(eq: ContactEquations, s: DiscreteSurface, contact: SurfaceEvaluation) -> float:
    """Return the mean height of the smooth surface above the touched facets. Collective.

    The mean has the normal forces as weights and is divided by the local compression. Facets not
    wider than the facets of the body have the height 0.
    """
    shape = shape_of(s.obstacle)
    if not isinstance(shape, RigidSurface):
        return 0.0
    place = contact.kinematics.place
    x = s.positions + (0.0 if place is None else place)
    force = _normal_forces(contact, s.points.areas)
    touched = np.flatnonzero(force)
    heights, widths = shape.heights
    facets = shape.distances(x[touched]).facets
    wide = widths[facets] > s.points.geometry.facet_size
    moments = force[touched] @ np.where(wide, heights[facets], 0.0)
    height = _ratio_of_sums(s.comm, moments, force.sum())
    return height / _compression(eq, s, contact) if height else 0.0


# -- sides of the obstacle -----------------------------------------------------------------------


def _across(
    eq: ContactEquations,
    s: DiscreteSurface,
    evaluation: Evaluation,
    contact: SurfaceEvaluation,
    clamped: Mask,
) -> float:
    """Return the fraction of the normal forces at points with deviating normals. Collective.

    The normals of face and obstacle deviate if they enclose more than 66 degrees.
    """
    u = evaluation.u.reshape(-1, s.dim)
    follows = s.displaced is not None or (s.obstacle.flat and not eq.bulk.linear)
    outward = s.points.outward(u if follows else np.zeros_like(u))
    force = np.where(clamped, 0.0, _normal_forces(contact, s.points.areas))
    aside = dot(contact.data.n, outward) < _ACROSS
    return _ratio_of_sums(s.comm, force[aside].sum(), force.sum())
