# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is to be doubted in a state or a problem, measured and reported.

- Gap and normal are those of the reference configuration, and so are the opposing points on another
  body. At the points of a curved obstacle or a pair the distance to it is measured where they are
  now: the *misfit*; of pairs also how far they have moved along the other body, and turned.
- det F = det(I + grad u) <= 0 where a hyperelastic body is turned inside out. Energies that do not
  grow without bound there (St Venant-Kirchhoff), and large Newton steps, do not prevent it.
- An obstacle on the wrong side, or so far away that a friction bound given in advance acts on a
  free surface.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dolfinx import fem, mesh

from dolfinx_contact._shared import SharedValues
from dolfinx_contact.body.cells import smallest_jacobian
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import ContactState, Evaluation
from dolfinx_contact.equations.order import Gathered
from dolfinx_contact.laws.status import STICK, closed
from dolfinx_contact.points.pair_motion import Moved
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_normals, rounded, simplex_normals

__all__ = ["Sliding", "sliding_doubt", "slidings", "warn_of_inversion", "warn_of_obstacles"]

logger = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Marks = npt.NDArray[np.bool_]

_LARGEST_MISFIT = 1e-3  # of the body's size, above which there is a warning
_LARGEST_PART = 0.5  # of a facet
_LARGEST_TURN = 3.0  # degrees
_CARRIES = 1e-3  # of the largest traction, above which an open point carries something
_FAR = 10.0  # body sizes
_WRONG_SIDE = (
    "where the body comes nearest to the obstacle, at {}, the contact normal points into the body: "
    "the obstacle is on the wrong side (a plane with its normal reversed, a sphere inside the body)"
)
_NO_SLIP = 1e-9  # body sizes
_FACING = 0.5  # cosine of a normal and an axis, above which that is not along the face
_OUT = 0.05  # cosine of a normal that leads out of the body, and not along it
_BEHIND = 1e-2  # of a facet, by which a node may be behind a plane of symmetry


# -- states --------------------------------------------------------------------------------------


def warn_of_inversion(eq: ContactEquations, u: Array) -> float | None:
    """The smallest det F of a body that is not linear, with a warning if it is not positive.

    None for bodies that are linear in u, whose strains are small by assumption. Collective.
    """
    if eq.bulk.linear:
        return None
    value, place = smallest_jacobian(eq.V, u, axisymmetric=eq.axisymmetric)
    if not value > 0 and eq.comm.rank == 0:
        logger.warning(
            "the body is turned inside out: det F = %.3g in the cell at %s of the reference "
            "configuration",
            value,
            _shown(place),
        )
    return value


@dataclass(frozen=True)
class Sliding:
    """How far a state is from the reference configuration, in which small sliding has its gaps.

    Attributes:
        misfit: a length, by which the gap of the law is off at the displaced contact points; None
            if the obstacle has none. At closed points, which the law has on the obstacle, the
            distance by which they hang above or in it; at open points how deep they are in it,
            which the law does not see. Of a pair that of the slave from the displaced master, which
            counts by how much it is off by more than in the reference configuration, and at points
            that have left the master's face the distance by which.
        distance: of a pair, how far a point that is closed, or carries something across a gap, has
            moved along the master, in widths of the facet that was opposite, or of the whole face
            of the slave where that is narrower; of faces that slide over each other the way of the
            last step alone, of closed points; else 0.
        turn: of a pair, the angle in degrees by which normals have turned at closed points: its
            root mean square by the normal forces, or half the largest if that is more, which counts
            where a body bends to the shape of the other and the pressure falls off; else 0.
        spin: of faces that slide over each other, and of a face on a rigid obstacle, in space, the
            angle in degrees by which one has turned over the other in the last step, about their
            normals: its root mean square by the work of friction; else 0.
        entered: how deep a corner or edge of a `RigidSurface` is in a facet of the body, between
            contact points, which do not see it; a length.
        doubt: why nothing is proved of the state, "" where the sliding is small: a misfit of 1e-3
            of the body's size, half a facet or half the slave's face, 3 degrees, or a point that
            has left the face of the master by half a facet. Of curved obstacles also an edge that
            is a tenth of a facet in it (by the integral method half of one), points past a rim, and
            more than a fiftieth of the normal forces where normals of obstacle and body are more
            than 66 degrees apart, and points that came through the obstacle in the last step. Of
            obstacles that nothing touches also normals that point into the body where that comes
            nearest. Of
            faces that slide over each other also a spin of 35 degrees, of which steps have the
            chords, and of obstacles, where friction acts along these, one of 21 degrees.
    """

    misfit: float | None
    distance: float = 0.0
    turn: float = 0.0
    spin: float = 0.0
    entered: float = 0.0
    doubt: str = ""


def slidings(eq: ContactEquations, state: Evaluation) -> dict[str, Sliding]:
    """By surface, whether the sliding is small in the state in the Functions. Collective.

    It is zero on flat obstacles but for the spin, for which any sliding along lines is exact.
    """
    found: dict[str, Sliding] = {}
    parts = zip(eq.surfaces, eq.constraints.clamped, state.surfaces, strict=True)
    for s, clamped, contact in parts:
        closed_points = closed(contact.statuses)
        held: Marks = np.zeros(len(closed_points), dtype=bool)
        if s.method != "integral":
            held = clamped[: len(held)]
        if s.slides:
            found[s.name] = _of_sliding(eq, s, state, contact)
        elif s.motion is not None:
            normal = -np.sum(contact.traction * s.points.data.n, axis=1)
            forces = np.where(held, 0.0, s.points.areas * np.maximum(normal, 0.0))
            acting = closed_points | _carrying(s, contact.traction)
            moved = s.motion()
            found[s.name] = _of_pair(
                eq, s, moved, closed_points & ~held, acting & ~held, held, forces
            )
        elif s.obstacle.flat:
            found[s.name] = _with_spin(eq, s, Sliding(0.0), contact)
            found[s.name] = _with_side(eq, s, found[s.name], state)
        else:
            small = _of_obstacle(eq, s, eq.gaps(s, state), closed_points, held)
            small = _with_edges(s, small, state, contact, held)
            small = _with_spin(eq, s, small, contact)
            found[s.name] = _with_side(eq, s, small, state)
    return found


def _of_sliding(
    eq: ContactEquations,
    s: DiscreteSurface,
    state: Evaluation,
    contact: ContactState,
) -> Sliding:
    """Of faces that slide over each other: the way, and whether one may have passed the other.

    Collective.

    That is where nothing is opposite to a point, and the bodies have moved towards or away from
    each other in the step by more than the distance within which that is looked for.
    """
    points = s.points
    depth = s.obstacle.opposite.depth
    n = eq.owned_sizes[0] // eq.dim
    moved: Array = np.reshape(state.u[: n * eq.dim], (-1, eq.dim))
    memory = contact.kinematics.memory
    if memory is not None and memory.displacement is not None:
        moved = moved - memory.displacement
    master = moved[s.obstacle.opposite.sides[1][:n]]
    sums = s.comm.allreduce(np.append(master.sum(axis=0), len(master)))
    away = contact.kinematics.operator.absent
    assert away is not None
    nodes = points.vertex_trace_dofs[: points.number]
    here = nodes < n
    way = np.zeros(points.number)
    way[here] = np.sum((moved[nodes[here]] - sums[:-1] / sums[-1]) * contact.data.n[here], axis=1)
    far = float(np.max(np.abs(way[away]), initial=0.0))
    far = s.comm.allreduce(far, op=max)
    operator = contact.kinematics.operator
    from dolfinx_contact.points.sliding.operator import SlidingOperator  # loaded where it slides
    from dolfinx_contact.results.spins import LARGEST_SPIN, spin_by_work

    assert isinstance(operator, SlidingOperator)
    passed = operator.facets_passed[closed(contact.statuses)]
    way_along = float(np.max(passed, initial=0.0))
    way_along = s.comm.allreduce(way_along, op=max)
    reasons = [*_behind_planes(eq, s, state), *_held_along(eq, s, contact)]
    if far > depth:
        reasons.append(
            f"in one step points that have nothing opposite now have moved by {far:.3g} along "
            f"their normals, more than the search distance {depth:.3g}: the bodies may have "
            "passed through each other; take shorter steps, or a longer search distance"
        )
    spin = spin_by_work(s, contact, operator.facing.nodal.apart[: points.number])
    if spin > LARGEST_SPIN:
        half = np.radians(spin) / 2
        reasons.append(
            f"the faces have turned over each other by {spin:.3g} degrees in one step, in which "
            f"friction works along chords that are {1 - np.sin(half) / half:.2g} shorter than "
            f"their arcs, and supports do {1 - np.sin(2 * half) / (2 * half):.2g} less work; take "
            "shorter steps"
        )
    return Sliding(0.0, way_along, spin=spin, doubt="; ".join(reasons))


def _behind_planes(eq: ContactEquations, s: DiscreteSurface, state: Evaluation) -> list[str]:
    """That nodes of the faces are behind planes of symmetry, in their own images. Collective."""
    opposite = s.obstacle.opposite
    n = eq.owned_sizes[0] // eq.dim
    faces = np.logical_or(*opposite.sides)[:n]
    X = s.node_positions[:n][faces]
    x = X + np.reshape(state.u[: n * eq.dim], (-1, eq.dim))[faces]
    reasons = []
    for axis, place in opposite.planes.items():
        side = np.sign(s.comm.allreduce(float(np.sum(X[:, axis] - place))))
        depth = float(np.max(side * (place - x[:, axis]), initial=0.0))
        depth = s.comm.allreduce(depth, op=max)
        if depth > _BEHIND * s.points.mean_width:
            reasons.append(
                f"a node of the faces is {depth:.3g} behind the plane of symmetry "
                f"{'xyz'[axis]} = {place:g}, where it is in its own image: let what comes there "
                "touch a HalfSpace in that plane too"
            )
    return reasons


def _held_along(eq: ContactEquations, s: DiscreteSurface, contact: ContactState) -> list[str]:
    """That friction is not unique where Dirichlet data hold both faces along it. Collective.

    So it is at nodes that lie, as those that they face, on a plane across which both are held, as
    on one of symmetry that has not been named: those that stick, or carry something across it.
    """
    opposite = s.obstacle.opposite
    n = eq.owned_sizes[0] // eq.dim
    X = np.round(s.node_positions[:n] / eq.body_size, 9) + 0.0  # no -0
    fixed = eq.fixed[: n * eq.dim].reshape(-1, eq.dim) & ~opposite.across[:n]
    nodes = s.points.vertex_trace_dofs[: s.points.number]
    mine = nodes < n
    normal = contact.kinematics.data.n
    pressing = np.sum(contact.traction * normal, axis=1)[:, None] * normal
    friction = np.abs(contact.traction - pressing)
    largest = s.comm.allreduce(float(np.max(np.abs(contact.traction), initial=0.0)), op=max)
    rubs = (contact.statuses == STICK)[:, None] | (friction > _CARRIES * largest)
    rubs &= np.abs(contact.kinematics.increment) <= _NO_SLIP * eq.body_size
    rubs &= np.abs(normal) < _FACING  # along the face
    held: Marks = np.zeros((n, eq.dim), dtype=bool)
    held[nodes[mine]] = rubs[mine] & fixed[nodes[mine]]
    master = opposite.sides[1][:n]
    reasons = []
    for axis in range(eq.dim):
        theirs = np.unique(X[master & fixed[:, axis], axis])
        places = np.unique(np.concatenate(s.comm.allgather(theirs)))
        rubbing = held[:, axis] & np.isin(X[:, axis], places)
        number = s.comm.allreduce(int(rubbing.sum()))
        if number:
            first = s.comm.allreduce(float(np.min(X[rubbing, axis], initial=np.inf)), op=min)
            reasons.append(
                f"{number} nodes that rub are held along {'xyz'[axis]}, and so is what they face "
                f"at {'xyz'[axis]} = {first * eq.body_size:.6g}: their friction in that direction "
                "is not unique; where that is a plane of symmetry name it, "
                f"symmetry={{{axis}: {first * eq.body_size:.6g}}}"
            )
    return reasons


def sliding_doubt(eq: ContactEquations, state: Evaluation) -> str:
    """Why nothing is proved of a state in the Functions, "" where sliding is small. Collective."""
    found = slidings(eq, state)
    return "; ".join(f"{name}: {s.doubt}" for name, s in found.items() if s.doubt)


def _carrying(s: DiscreteSurface, traction: Array) -> Marks:
    """Points that carry something, as bonds and given bounds do at open points. Collective."""
    size = np.linalg.norm(traction, axis=1)
    largest = s.comm.allreduce(float(size.max(initial=0.0)), op=max)
    return np.asarray(size > _CARRIES * largest, dtype=bool)


def _width(s: DiscreteSurface) -> float:
    """Of the whole face: the diagonal of the box around its points. Collective."""
    x = s.positions
    low = np.array(s.comm.allgather(x.min(axis=0, initial=np.inf))).min(axis=0)
    high = np.array(s.comm.allgather(x.max(axis=0, initial=-np.inf))).max(axis=0)
    return max(float(np.linalg.norm(high - low)), s.points.mean_width)


def _of_obstacle(
    eq: ContactEquations, s: DiscreteSurface, law: Array, closed_points: Marks, held: Marks
) -> Sliding:
    """By the distances of the displaced points from a curved obstacle. Collective."""
    true = s.true_gaps()
    if true is None:
        return Sliding(None)
    depth = np.maximum(np.maximum(-true, 0) - np.maximum(-law, 0), 0)
    off = np.where(held, 0.0, np.where(closed_points, np.abs(true - law), depth))
    misfit, x, above = _worst(s, off, true)
    if misfit <= _LARGEST_MISFIT * eq.body_size:
        return Sliding(misfit)
    return Sliding(
        misfit,
        doubt="the sliding is not small: gap and normal are those of the reference configuration, "
        f"and that of the point which was at {_shown(x)} is off by {misfit:.3g} "
        f"({misfit / eq.body_size:.2g} of the body's size); the point is {abs(above):.3g} "
        f"{'inside' if above < 0 else 'away from'} the obstacle",
    )


def _with_edges(
    s: DiscreteSurface, sliding: Sliding, state: Evaluation, contact: ContactState, held: Marks
) -> Sliding:
    """With what contact points do not see of the edges of a curved obstacle. Collective."""
    from dolfinx_contact.results.facets_of_obstacles import passed_of, pressed_across

    u: Array = state.u.reshape(-1, s.dim)
    passed = passed_of(s, u)
    # In small sliding normals are those of the reference configuration.
    across = pressed_across(s, contact, np.zeros_like(u) if s.displaced is None else u, held)
    reasons = [r for r in (sliding.doubt, across, _through(s, contact), *passed.reasons) if r]
    return replace(sliding, entered=passed.depth, doubt="; ".join(reasons))


def _with_spin(
    eq: ContactEquations, s: DiscreteSurface, sliding: Sliding, contact: ContactState
) -> Sliding:
    """With the spin of the face over a rigid obstacle, in space. Collective.

    Linear bodies do not turn: their displacements are small by assumption, at any scale.
    """
    turns = s.rigid_body is not None and s.rigid_body.turns
    small = eq.bulk.linear and s.displaced is None and not turns
    if s.dim == 2 or small:
        return sliding
    from dolfinx_contact.results.spins import spin_doubt, spin_over_obstacle

    spin = spin_over_obstacle(s, contact)
    reasons = [r for r in (sliding.doubt, spin_doubt(s, spin)) if r]
    return replace(sliding, spin=spin, doubt="; ".join(reasons))


def _with_side(
    eq: ContactEquations, s: DiscreteSurface, sliding: Sliding, state: Evaluation
) -> Sliding:
    """With an obstacle on the wrong side of a face. Collective.

    So it is where data have turned it round or moved it across the body, and where the body came
    through a thin tool steps ago: the law holds, of a face that has nothing before it, or is pulled
    to the obstacle.
    """
    body = s.rigid_body
    moved: Array = state.u.reshape(-1, s.dim)
    seen = s.relative(moved, None if body is None else body.values)
    nodes = s.points.vertex_trace_dofs
    gaps, normals = s.at_vertices(seen[nodes])
    place = _opposed(eq, s, gaps, normals, moved)
    if place is None:
        return sliding
    reasons = [r for r in (sliding.doubt, _WRONG_SIDE.format(_shown(place))) if r]
    return replace(sliding, doubt="; ".join(reasons))


def _through(s: DiscreteSurface, contact: ContactState) -> str:
    """That points came through the obstacle in the last step, in words; "" if none. Collective."""
    from dolfinx_contact.results.through import way_through

    depth = way_through(s, contact)
    if depth is None:
        return ""
    worst, at, _ = _worst(s, depth, depth)
    if not worst > 0.0:
        return ""
    return (
        f"the point which was at {_shown(at)} came to the other side of the obstacle in one step, "
        f"on a way that is up to {worst:.3g} within it: the body may have passed through; take "
        "shorter steps"
    )


def _of_pair(
    eq: ContactEquations,
    s: DiscreteSurface,
    moved: Moved,
    closed_points: Marks,
    acting: Marks,
    held: Marks,
    forces: Array,
) -> Sliding:
    """By what the points of the slave have opposite now. Collective.

    Args:
        eq: the contact problem.
        s: the pair.
        moved: its points.
        closed_points: those that are closed, and not held.
        acting: these, and open ones that carry something.
        held: points that Dirichlet data hold.
        forces: normal forces.
    """
    misfit, at, above = _misfit(s, moved, closed_points, held)
    # One wide facet of the master is no measure for a small body that wanders along it.
    face = _width(s)
    part = np.where(acting, moved.distance / np.minimum(moved.facet, face), 0.0)
    distance, along, moved_by = _worst(s, part, moved.distance)
    turn, turned = _turn(s, moved, closed_points, forces)
    beyond, edge, _ = _worst(s, np.where(acting, moved.beyond, 0.0), moved.beyond)
    reasons = []
    if distance > _LARGEST_PART:
        whole = distance * face < moved_by * (1 + 1e-9)
        measure = "the whole face" if whole else "the facet that was opposite"
        reasons.append(
            f"the point which was at {_shown(along)} has moved {moved_by:.3g} along the other "
            f"body, {distance:.2g} of {measure}"
        )
    if beyond > _LARGEST_PART * s.points.mean_width:
        reasons.append(
            f"the point which was at {_shown(edge)} acts {beyond:.3g} beyond the edge of the master"
        )
    if turn > _LARGEST_TURN:
        reasons.append(f"normals have turned by {turn:.2g} degrees, most at {_shown(turned)}")
    if misfit > _LARGEST_MISFIT * eq.body_size:
        where = "inside" if above < 0 else "away from"
        reasons.append(
            f"the gap of the point which was at {_shown(at)} is off by {misfit:.3g} "
            f"({misfit / eq.body_size:.2g} of the body's size), {abs(above):.3g} {where} the master"
        )
    if not reasons:
        return Sliding(misfit, distance, turn)
    doubt = (
        "the sliding is not small: opposing points, gap and normal are those of the reference "
        f"configuration; {'; '.join(reasons)}"
    )
    return Sliding(misfit, distance, turn, doubt=doubt)


def _misfit(
    s: DiscreteSurface, moved: Moved, closed_points: Marks, held: Marks
) -> tuple[float, Array, float]:
    """By how much the gap of the law is off at worst, where, and the gap there. Collective.

    What the law has at the gap of the reference configuration less -j.n is somewhere else.
    """
    left = moved.beyond > _LARGEST_PART * s.points.mean_width
    true = s.points.data.gap + moved.opened
    law = s.points.data.gap + moved.linear
    depth = np.maximum(np.maximum(-true, 0) - np.maximum(-law, 0), 0)
    depth = np.where(moved.facing & ~held, depth, 0.0)
    off = np.where(closed_points, np.abs(true - law), depth)
    off = np.where(closed_points & left, np.hypot(moved.beyond, true), off)
    return _worst(s, off, true)


def _turn(
    s: DiscreteSurface, moved: Moved, closed_points: Marks, forces: Array
) -> tuple[float, Array]:
    """By how many degrees normals have turned, weighted by forces, and where most. Collective."""
    degrees = np.where(closed_points, np.degrees(moved.turn), 0.0)
    turn, turned, _ = _worst(s, degrees, degrees)
    sums = s.comm.allreduce(np.array([forces @ degrees**2, forces.sum()]))
    if sums[1] > 0:
        turn = max(turn / 2, float(np.sqrt(sums[0] / sums[1])))
    return turn, turned


def _worst(s: DiscreteSurface, values: Array, others: Array) -> tuple[float, Array, float]:
    """The largest value at the points of all ranks, its place, and another number there."""
    gathered = Gathered(s.comm, s.positions, s.points.ids)
    values = gathered(values)
    others = gathered(others)
    # Of points with the same value, up to round-off, the first in the table.
    i = int(np.flatnonzero(~(values < (1 - 1e-9) * np.max(values)))[0])
    return float(values[i]), gathered.positions[i], float(others[i])


# -- obstacles -----------------------------------------------------------------------------------


def warn_of_obstacles(eq: ContactEquations) -> None:
    """Warn of obstacles on the wrong side and of friction far from one. Collective."""
    for s in eq.surfaces:
        n = s.points.vertices.dofmap.index_map.size_local
        gaps = s.points.vertex_gaps[:n]
        nearest = s.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=min)
        if not np.isfinite(nearest):
            continue  # a solve refuses it
        given = not s.law.needs_pressure and s.law.averaging is None
        if given and nearest > _FAR * eq.body_size:
            at_rest = np.zeros_like(s.points.data.n)
            slope = s.law_at_points(at_rest, at_rest, s.point_data()).unit_bound
            bound = float(np.nanmax(slope, initial=0.0))
            if s.comm.allreduce(bound, op=max) > 0 and s.comm.rank == 0:
                logger.warning(
                    "%s: the friction bound of Tresca acts on the whole surface, and the obstacle "
                    "is %.3g away, more than ten times the size of the body",
                    s.name,
                    nearest,
                )
        n = s.points.vertex_normals
        still = np.zeros((s.node_positions.shape[0], s.dim))
        place = _opposed(eq, s, s.points.vertex_gaps, n, still)
        if place is not None and s.comm.rank == 0:
            logger.warning("%s: %s", s.name, _WRONG_SIDE.format(_shown(place)))


def _opposed(
    eq: ContactEquations, s: DiscreteSurface, gaps: Array, normals: Array, moved: Array
) -> Array | None:
    """Where the body comes nearest to an obstacle whose normal points into the body there.

    None if it does not. Of a body that is deep in its obstacle those points decide that are
    deepest, and where they face neither way (the rims of a round foot) those that are nearest to
    the obstacle's surface. At an edge of the face the normal may lead out of the body through
    another one beside it: the obstacle is beside the face then, not behind it. Collective.

    Args:
        eq: the contact problem.
        s: a surface with an obstacle.
        gaps: at the local vertices (n,).
        normals: there (n, dim).
        moved: by which the local nodes of the displacement have moved (m, dim).
    """
    tolerance = 1e-9 * eq.body_size
    lowest = s.comm.allreduce(float(np.min(gaps, initial=np.inf)), op=min)
    closest = s.comm.allreduce(float(np.min(np.abs(gaps), initial=np.inf)), op=min)
    at_vertices = moved[s.points.vertex_trace_dofs]
    marked = gaps <= lowest + tolerance
    deepest, x = _facing(s, marked, normals, at_vertices)
    if not np.isfinite(deepest):
        return None
    if -0.5 <= deepest < 0.5:
        marked = np.abs(gaps) <= closest + tolerance
        deepest, x = _facing(s, marked, normals, at_vertices)
    if deepest >= -0.5:
        return None
    marked = marked & ~_led_out(s, marked, normals, moved)
    deepest, x = _facing(s, marked, normals, at_vertices)
    return x if np.isfinite(deepest) else None


def _led_out(s: DiscreteSurface, marked: Marks, normals: Array, moved: Array) -> Marks:
    """At which vertices normals lead out of the body through a facet of its boundary. Collective.

    Args:
        s: the surface.
        marked: vertices that count (n,).
        normals: n at the vertices (n, dim).
        moved: by which the local nodes of the displacement have moved (m, dim).
    """
    V = s.u.function_space
    domain = s.domain
    dim = s.dim
    nodes = s.points.vertex_trace_dofs
    shared = SharedValues(V.dofmap.index_map)
    mine = np.flatnonzero(marked[: s.points.vertices.dofmap.index_map.size_local])
    at_nodes = shared.sums(nodes[mine], np.column_stack([np.ones(len(mine)), normals[mine]]))
    facets = mesh.exterior_facet_indices(domain.topology)
    corners = _corner_nodes(V, facets)
    x = s.node_positions + moved[: len(s.node_positions)]
    outward = facet_normals(domain, facets)
    N = simplex_normals(s.node_positions[corners[:, :dim]])
    # As these turn with the corners, so does the side that is outside.
    N = np.sign(np.sum(N * outward, axis=1))[:, None] * simplex_normals(x[corners[:, :dim]])
    there = at_nodes[corners]
    out = (there[..., 0] > 0.5) & (np.einsum("fd,fvd->fv", N, there[..., 1:]) > _OUT)
    return np.asarray(shared.sums(corners, out.astype(np.float64))[nodes] > 0.5)


def _corner_nodes(V: fem.FunctionSpace, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Nodes of the displacement at the corners of facets (n, k)."""
    topology = V.mesh.topology
    dim = topology.dim
    for of, to in ((dim, 0), (dim - 1, 0), (0, dim)):
        topology.create_connectivity(of, to)
    layout = V.dofmap.dof_layout
    vertices = topology.connectivity(dim, 0).array
    corners = vertices.size // max(len(V.dofmap.list), 1)
    of_vertices = np.zeros(int(vertices.max(initial=-1)) + 1, dtype=np.int32)
    places = [layout.entity_dofs(0, i)[0] for i in range(corners)]
    of_vertices[vertices.reshape(-1, max(corners, 1))] = V.dofmap.list[:, places]
    of_facets = topology.connectivity(dim - 1, 0)
    return np.array([of_vertices[of_facets.links(f)] for f in facets], dtype=np.int32).reshape(
        len(facets), -1
    )


def _facing(
    s: DiscreteSurface, marked: npt.NDArray[np.bool_], normals: Array, moved: Array
) -> tuple[float, Array]:
    """Largest n.N over the facets around ``marked`` local vertices, N outward, and where.

    Args:
        s: the surface.
        marked: vertices (n,).
        normals: n at the vertices (n, dim).
        moved: by which these have moved (n, dim).
    """
    corners, x, side = s.facet_sides
    # As normals turn with the corners, so does the side that is outside.
    N = side[:, None] * simplex_normals((x + moved)[corners[:, : s.dim]])
    along = np.einsum("fd,fvd->fv", N, normals[corners])
    along = np.round(np.where(marked[corners], along, -np.inf).reshape(-1), 9)
    places = x[corners.reshape(-1)[along == np.max(along, initial=-np.inf)]].tolist()
    mine: tuple[float, list[float]] = (
        float(np.max(along, initial=-np.inf)),
        min(places, default=[]),
    )
    # The same place on any number of ranks.
    value, place = min(s.comm.allgather(mine), key=lambda part: (-part[0], part[1]))
    return value, np.array(place)


def _shown(x: npt.ArrayLike) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in rounded(np.asarray(x))) + ")"
