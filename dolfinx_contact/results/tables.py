# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of contact points, with the signs and names of the output.

``un`` >= 0 is the gap and ``ut`` the tangential displacement; ``rn`` >= 0 and ``rt`` are contact
forces on the body, ``pressure`` and ``shear`` contact forces per area. In 2D the scalars ``ut``,
``rt`` and ``shear`` are components along t = (-n_y, n_x), where n points from the body into the
obstacle; in 3D they are norms.

The reaction of Dirichlet data at a contact node is not a contact force; its column is ``support``.
If Dirichlet data prescribe one component of a node, contact may act on the other components.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

import basix
from dolfinx import fem

from dolfinx_contact._arrays import Array, Indices, Mask
from dolfinx_contact._compat import FacetSubmesh
from dolfinx_contact._geometry import along_tangent, dot, in_space, tangential
from dolfinx_contact._install import optional
from dolfinx_contact._mpi import SharedValues
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, SurfaceEvaluation
from dolfinx_contact.laws import status
from dolfinx_contact.laws.status import STICK, closed, without_damage
from dolfinx_contact.points.memory import slid_after
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.points.trace import facet_closures

__all__ = [
    "ContactTable",
    "contact_table",
    "contact_tables",
    "forces_at_vertices",
    "friction_bound",
    "friction_of_supports",
    "support_at_nodes",
    "violation",
]

_NO_SLIP = 1e-12  # largest slip that counts as round-off, relative to the size of the body


@dataclass(frozen=True)
class ContactTable:
    """Table of the n contact points of one surface on all ranks, sorted by x, then y, then z.

    Points with equal coordinates, such as both sides of a crack, are sorted by the numbers of their
    nodes in the input mesh.

    Attributes:
        name: name of the surface.
        dim: dimension, 2 or 3.
        x: positions, shape (n, dim).
        area: area (length in 2D) of each point, shape (n,).
        un: gap, shape (n,); NaN at nodes of a pair without an opposing point. With
            ``method="mixed"``, the mean of the gap weighted by the hat function of the node, to
            which the law applies; the gap at the node itself may be negative. The same holds for
            ``ut``.
        ut: tangential displacement, shape (n, dim).
        increment: tangential displacement since the last accepted step of an evolution, shape
            (n, dim); ``ut`` otherwise.
        n: normals, shape (n, dim).
        force: contact force on the body at each point, shape (n, dim); 0 at points clamped by
            Dirichlet data.
        pressure: nominal contact pressure, per area of the mesh, shape (n,).
        shear: tangential traction on the body, shape (n, dim).
        letters: status of each point: o (open), k (stick), + or - (slip in 2D, by the sign of
            u_t), s (slip in 3D), or d (no contact law at the point, because it is clamped by
            Dirichlet data, at a crack front, at a crossing of pairs, or without an opposing point).
        bound: friction bound (radius of the friction disc), in units of force, shape (n,).
        support: reaction of Dirichlet data on the body at the node, shape (n, dim); 0 in free
            components and with ``method="integral"``, where contact points are not nodes. If a node
            is shared by two surfaces, both tables contain its full reaction.
        adhesion: part of ``force`` due to adhesion or another surface energy, shape (n, dim); None
            for other laws.
        bond: state of the bond of each point: i (unchanged in the step), w (weakened), r
            (recovered), b (broken); None for other laws.
        internal: internal variables of the law by name, such as the intensity of adhesion
            ``beta``, shape (n,) each.
        axisymmetric: whether forces and areas are integrals over the circumference of a body of
            revolution.
        slid: slip distance accumulated in an evolution, shape (n,); None for laws that do not
            depend on it.
    """

    name: str
    dim: int
    x: Array
    area: Array
    un: Array
    ut: Array
    increment: Array
    n: Array
    force: Array
    pressure: Array
    shear: Array
    letters: npt.NDArray[np.str_]
    bound: Array
    support: Array
    adhesion: Array | None = None
    bond: npt.NDArray[np.str_] | None = None
    internal: Mapping[str, Array] = field(default_factory=dict)
    axisymmetric: bool = False
    slid: Array | None = None

    def __str__(self) -> str:
        """Return the numbers of points, normal force and largest pressure as text."""
        counts = ", ".join(f"{n} {kind}" for kind, n in status.count(self.status).items() if n)
        pressure = np.max(self.pressure, initial=0.0)
        return (
            f"{self.name}: {len(self.letters)} points ({counts}), "
            f"sum of normal forces {self.rn.sum():.6g}, largest pressure {pressure:.6g}"
        )

    def resultant(self, forces: Array) -> Array:
        """Return the sum of forces at the points; only the axial part for bodies of revolution.

        The radial forces on a body of revolution sum to zero.

        Args:
            forces: forces at the points, shape (n, dim).
        """
        total = forces.sum(axis=0)
        return np.where(np.arange(self.dim) < self.axisymmetric, 0.0, total)

    @property
    def rn(self) -> Array:
        """Normal forces on the body, positive in compression, shape (n,)."""
        return -dot(self.force, self.n) + 0.0

    @property
    def rt(self) -> Array:
        """Tangential forces on the body, shape (n, dim)."""
        return tangential(self.force, self.n)

    @property
    def beta(self) -> Array | None:
        """Intensity of adhesion, 1 if intact, 0 if broken, shape (n,); None without adhesion."""
        return self.internal.get("beta")

    @property
    def rn_adh(self) -> Array:
        """Normal forces of adhesion, negative in tension, shape (n,); 0 without adhesion."""
        if self.adhesion is None:
            return np.zeros_like(self.un)
        return -dot(self.adhesion, self.n) + 0.0

    @property
    def friction(self) -> Array:
        """Tangential forces on the body without those of adhesion, shape (n, dim)."""
        if self.adhesion is None:
            return self.rt
        return self.rt - tangential(self.adhesion, self.n)

    @property
    def status(self) -> str:
        """Status letters of all points as one string; see the attribute ``letters``."""
        return "".join(self.letters)

    @property
    def closed(self) -> Mask:
        """Mask of the closed points (stick or slip), without clamped points, shape (n,)."""
        return self.sticks | self.slips

    @property
    def sticks(self) -> Mask:
        """Mask of the sticking points, shape (n,)."""
        return self.letters == "k"

    @property
    def slips(self) -> Mask:
        """Mask of the slipping points, shape (n,)."""
        return np.isin(self.letters, list("+-s"))

    def columns(self) -> dict[str, npt.NDArray[Any]]:
        """Return the columns of ``contact.csv`` by name, shape (n,) each.

        Vectors are split into three components; components along z are 0 in 2D. Laws with adhesion
        add its normal force ``rn_adh``, its tangential force ``rt_adh``, the internal variables of
        the law, and ``bond``. Laws depending on the slip distance add ``slid``.
        """
        vectors = {"": self.x, "ut_": self.ut, "rt_": self.rt, "support_": self.support}
        parts = {
            head: {f"{head}{axis}": in_space(v)[:, k] for k, axis in enumerate("xyz")}
            for head, v in vectors.items()
        }
        found: dict[str, npt.NDArray[Any]] = {"surface": np.full(len(self.letters), self.name)}
        found |= parts[""]
        found |= {"un": self.un, "ut": self.along(self.ut)} | parts["ut_"]
        found |= {"rn": self.rn, "rt": self.along(self.rt)} | parts["rt_"]
        found |= {"pressure": self.pressure, "shear": self.along(self.shear)}
        found |= {"status": self.letters} | parts["support_"]
        if self.bond is not None:
            of_bond = self.along(self.rt - self.friction)
            found |= {"rn_adh": self.rn_adh, "rt_adh": of_bond, **self.internal, "bond": self.bond}
        if self.slid is not None:
            found["slid"] = self.slid
        return found

    def to_pandas(self) -> Any:
        """Return the contact points as a pandas DataFrame with one row per point; see `columns`.

        Raises:
            ModuleNotFoundError: if pandas is not installed.

        Example:
            Several surfaces in one table, as in ``contact.csv``::

                rows = pandas.concat([t.to_pandas() for t in result.tables.values()])
        """
        return optional("pandas", "records").DataFrame(self.columns())

    def count(self, letters: str) -> int:
        """Return the number of points whose status letter is in the string ``letters``."""
        return int(np.isin(self.letters, list(letters)).sum())

    def along(self, vectors: Array) -> Array:
        """Return tangential vectors as scalars: components along t in 2D, norms in 3D.

        Args:
            vectors: tangential vectors at the points, shape (n, dim). In 2D, t = (-n_y, n_x) is the
                tangent for the normal n.
        """
        if self.dim == 2:
            return along_tangent(vectors, self.n)
        return np.asarray(np.linalg.norm(vectors, axis=1))


def contact_table(
    eq: ContactEquations, number: int, evaluation: Evaluation, supports: Array
) -> ContactTable:
    """Return the table of the contact points of a surface at a state. Collective.

    If Dirichlet data prescribe the whole tangential displacement of a point, the support replaces
    friction: the friction bound is 0, and the status letter describes the prescribed motion.

    Args:
        eq: contact problem.
        number: index of the surface.
        evaluation: evaluation with reactions.
        supports: reactions of Dirichlet data at the local nodes, shape (nodes, dim).
    """
    s = eq.surfaces[number]
    contact = evaluation.surfaces[number]
    at = contact.kinematics
    n = s.points.number
    area = at.operator.areas
    normal = at.data.n
    traction = contact.traction
    letters = _letters(s, contact)
    bound = friction_bound(s, contact) * area
    support = np.zeros_like(traction)
    if not s.is_weak:
        constraints = eq.constraints.surfaces[number]
        clamped = constraints.clamped_points
        letters = np.where(clamped, "d", letters)
        traction = np.where(clamped[:, None], 0.0, traction)
        trace = s.points.vertex_nodes
        support = forces_at_vertices(eq.V, s.submesh, trace, supports)[:n]
        guided = (constraints.removed[:n].sum(axis=1) == s.dim - 1) & ~clamped
        bound = np.where(guided, 0.0, bound)
        moved = _letters_of_motion(at.increment, normal, _NO_SLIP * eq.body_size)
        letters = np.where(guided & (letters != "o"), moved, letters)
    pressure = -dot(traction, normal) + 0.0
    gap = at.gap + 0.0
    opposite = s.obstacle.opposite
    absent = at.operator.absent
    if absent is not None:
        gap[absent] = np.nan
    elif not s.is_weak and opposite is not None and not opposite.matching:
        gap[opposite.none[s.points.vertex_nodes[:n]]] = np.nan
    columns: dict[str, npt.NDArray[Any]] = {
        "x": s.points.positions,
        "area": area,
        "un": gap,
        "ut": at.slip,
        "increment": at.increment,
        "n": normal,
        "force": traction * area[:, None],
        "pressure": pressure,
        "shear": tangential(traction, normal),
        "letters": letters,
        "bound": bound,
        "support": support,
    }
    # laws with memory: variables, bonds, and slip distance
    variables = s.law.variables(s.dim).items()
    internal = {name: contact.answers.bond(f"after.{inner}") for name, inner in variables}
    if s.law_at_points.compiled.bonded:
        columns["bond"] = _letters_of_bonds(s, contact, internal)
        adhesion = contact.answers.bond("traction") * area[:, None]
        columns["adhesion"] = np.where((letters == "d")[:, None], 0.0, adhesion)
    if s.law_at_points.compiled.knows_slip:
        columns["slid"] = slid_after(contact.data, contact.jump, contact.statuses)
    return ContactTable(
        s.name,
        s.dim,
        **s.in_order.columns(columns),
        internal=s.in_order.columns(internal),
        axisymmetric=s.axisymmetric,
    )


def contact_tables(
    eq: ContactEquations, evaluation: Evaluation, supports: Array
) -> dict[str, ContactTable]:
    """Return the tables of all surfaces at a state, by name; see `contact_table`. Collective."""
    return {
        s.name: contact_table(eq, number, evaluation, supports)
        for number, s in enumerate(eq.surfaces)
    }


def violation(eq: ContactEquations, evaluation: Evaluation, force: float, length: float) -> float:
    """Return the largest violation of the contact laws, relative to ``force``. Collective.

    The violation is measured by the natural residual at all points that are not clamped: the
    traction minus the traction that the law determines from jump and traction. It vanishes if and
    only if the law holds. Its augmentation parameter is chosen such that a gap of ``length`` is
    equivalent to ``force``. Points without an admissible status also count as violations. If
    several statuses are admissible, for example in a law that softens with a slope larger than this
    parameter, the status of the state is used. With ``method="integral"``, whose conditions are
    weak, the violation includes the discretisation error.

    Args:
        eq: contact problem.
        evaluation: evaluation of the state.
        force: force scale, the unit of the result.
        length: length scale.
    """
    worst = 0.0
    for number, (s, contact) in enumerate(zip(eq.surfaces, evaluation.surfaces, strict=True)):
        points = s.points
        r = np.asarray(force / (length * points.areas), dtype=np.float64)
        answers = s.law_at_points(contact.jump, contact.law_traction, replace(contact.data, r=r))
        admissible = answers.holds(contact.statuses)
        codes = np.where(admissible, contact.statuses, answers.required)
        off = (contact.traction - answers.traction(codes)) * points.areas[:, None]
        constraints = eq.constraints.surfaces[number]
        if not s.is_weak:
            off[constraints.removed[: points.number]] = 0.0
        missed = np.where(admissible | constraints.clamped_points, 0.0, answers.missed)
        share = contact.kinematics.operator.share
        if share is not None:  # partly covered nodes have another condition
            off = np.where((share < 1.0)[:, None], contact.off * points.areas[:, None], off)
            missed = np.where(share < 1.0, 0.0, missed)
        off = np.maximum(np.abs(off), (missed * points.areas)[:, None])
        worst = max(worst, float(np.max(off, initial=0.0)))
    return float(eq.comm.allreduce(worst / force, op=np.maximum))


def friction_bound(s: DiscreteSurface, contact: SurfaceEvaluation) -> Array:
    """Return the radius of the friction disc per area at each point, shape (n,).

    It is evaluated at the pressure that the contact law determines. It is 0 without friction and,
    unless open points may carry traction, at open points.
    """
    acts = closed(contact.answers.required) | (not s.law.needs_pressure)
    return np.where(acts, np.maximum(contact.answers.bound, 0.0), 0.0)


def friction_of_supports(eq: ContactEquations, number: int, evaluation: Evaluation) -> Array:
    """Return the sizes of the frictional forces that belong to supports, shape (n,).

    If Dirichlet data move a contact point along a tangent, its friction along the tangent is not
    part of the contact forces. It is 0 at points that do not slip along such tangents, and if it is
    unknown: with ``method="integral"``, with a nonlocal law, and for a law without a friction disc
    at points with no free tangent.

    Args:
        eq: contact problem.
        number: index of the surface.
        evaluation: evaluation of the state.
    """
    s, contact = eq.surfaces[number], evaluation.surfaces[number]
    constraints = eq.constraints.surfaces[number]
    n = s.points.number
    if s.is_weak:
        return np.zeros(n)
    removed = constraints.removed[:n] & ~constraints.clamped_points[:, None]
    slip = np.linalg.norm(np.where(removed, contact.kinematics.increment, 0.0), axis=1)
    friction = np.linalg.norm(contact.law_traction - contact.traction, axis=1)
    no_free_tangent = removed.sum(axis=1) == s.dim - 1
    friction = np.where(no_free_tangent, np.fmax(friction_bound(s, contact), 0.0), friction)
    forces = friction * contact.kinematics.operator.areas
    return np.where(slip > _NO_SLIP * eq.body_size, forces, 0.0)


def _letters(s: DiscreteSurface, contact: SurfaceEvaluation) -> npt.NDArray[np.str_]:
    """Return status letters; at frictionless points in 2D, the sign of the sliding direction."""
    touching = closed(contact.statuses)
    codes = without_damage(contact.statuses)
    letters = np.where(touching, status.letters(s.dim)[codes], "o")
    if s.dim == 3:
        return letters
    free = touching.copy()
    bond = contact.statuses - codes
    for of_bond in np.unique(bond):
        free &= (bond != of_bond) | ~contact.answers.may_be(STICK + of_bond)
    at = contact.kinematics
    return np.where(free, np.where(along_tangent(at.increment, at.data.n) < 0, "-", "+"), letters)


def _letters_of_bonds(
    s: DiscreteSurface, contact: SurfaceEvaluation, internal: dict[str, Array]
) -> npt.NDArray[np.str_]:
    """Return the letters for the states of the bonds, shape (n,); see `ContactTable`."""
    letters: npt.NDArray[np.str_] = np.full(s.points.number, "i")
    x = s.law.weakening
    if x is not None:
        lost = x.sense * (internal[x.name] - contact.data.fields[x.name])
        letters = np.where(lost > 0, "w", np.where(lost < 0, "r", "i"))
    return np.where(contact.answers.bond("broken") > 0, "b", letters)


def _letters_of_motion(ut: Array, n: Array, least: float) -> npt.NDArray[np.str_]:
    """Return letters of closed points that describe their tangential motion, shape (n,).

    Args:
        ut: tangential displacements, shape (n, dim).
        n: normals, shape (n, dim).
        least: smallest displacement that counts as motion.
    """
    size = np.linalg.norm(ut, axis=1)
    sliding: Any = "s"
    if ut.shape[1] == 2:
        sliding = np.where(along_tangent(ut, n) > 0, "+", "-")
    return np.where(size > least, sliding, "k")


# -- reactions of Dirichlet data ------------------------------------------------------------------


def support_at_nodes(eq: ContactEquations, state: Evaluation) -> Array:
    """Return the Dirichlet reactions on the body at the local nodes, shape (n, dim). Collective.

    Components without Dirichlet data are 0.
    """
    reaction = fem.Function(eq.V)
    owned = eq.owned_sizes[0]
    assert state.reactions is not None
    reaction.x.array[:owned] = np.where(eq.fixed[:owned], state.reactions, 0.0)
    reaction.x.scatter_forward()
    return reaction.x.array.reshape(-1, eq.dim).copy()


def forces_at_vertices(
    V: fem.FunctionSpace,
    submesh: FacetSubmesh,
    trace: Indices,
    forces: Array,
) -> Array:
    """Distribute nodal forces to the local vertices of a surface. Collective.

    For elements of higher degree, the force at a node is divided between vertices in the ratio of
    their hat functions at the node. The sum over the surface is thus preserved.

    Args:
        V: displacement space.
        submesh: facets of the surface.
        trace: nodes of V at the local vertices of the surface.
        forces: forces at the local nodes of V, shape (n, dim).

    Returns:
        Forces at the local vertices, shape (vertices, dim).
    """
    if V.ufl_element().degree == 1:
        return np.asarray(forces[trace])
    tdim = V.mesh.topology.dim
    topology = V.mesh.topology
    index_map = V.dofmap.index_map
    facets = submesh.parent_facets[: submesh.mesh.topology.index_map(tdim - 1).size_local]
    to_cells = topology.connectivity(tdim - 1, tdim)
    nodes = V.dofmap.list[to_cells.array[to_cells.offsets[facets]]]
    closures = facet_closures(V, facets)
    # Distribute the force of a node over its facets, on whichever rank they are.
    at_nodes = SharedValues(index_map)
    count = at_nodes.sums(closures, np.ones(closures.shape))
    share = forces / np.maximum(count, 1.0)[:, None]
    on_facet = (nodes[:, :, None] == closures[:, None, :]).any(axis=2)
    hats, corners = _hats(V)
    parts = np.einsum("pv,cp,cpd->cvd", hats, on_facet, share[nodes])
    return at_nodes.sums(nodes[:, corners], parts)[trace]


def _hats(V: fem.FunctionSpace) -> tuple[Array, list[int]]:
    """Return the linear hat functions of a cell, evaluated at the nodes of a space.

    Returns:
        Values, shape (nodes, vertices), and numbers of the nodes at the vertices.
    """
    cell = V.mesh.basix_cell()
    corners = basix.geometry(cell)
    linear = basix.create_element(basix.ElementFamily.P, cell, 1)
    layout = V.dofmap.dof_layout
    nodes = [int(layout.entity_dofs(0, i)[0]) for i in range(len(corners))]
    points = V.ufl_element().sub_elements[0].basix_element.points
    return np.round(linear.tabulate(0, points)[0, :, :, 0], 12), nodes
