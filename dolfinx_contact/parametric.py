# SPDX-License-Identifier: LGPL-3.0-or-later
"""A contact problem with a parameter, as a system that the continuation can follow.

The parameter gamma is a Constant of the user's forms: a factor of the load, a material or friction
coefficient, a position of an obstacle. Dirichlet data may depend on it as well. The derivative of H
by gamma is exact, by UFL.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_constants

from dolfinx_contact._agreement import described, refuse_other_mesh
from dolfinx_contact._compat import (
    dirichlet_value,
    interpolation_points,
    is_mesh_of,
    is_value_of,
)
from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact.condensed import CondensedContact, can_condense
from dolfinx_contact.continuation import BranchPoint, Events, Piece, Preconditioner
from dolfinx_contact.continuation.arguments import checked_gamma
from dolfinx_contact.laws import Status, status
from dolfinx_contact.laws.status import MINUS, OPEN, PLUS, STICK, WHERE_OPEN
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.result import Result, by_coordinates, collect
from dolfinx_contact.solvers.history import Attempt
from dolfinx_contact.solvers.measures import Scales
from dolfinx_contact.surface import ContactSurface

__all__ = ["ParametricContact"]

_MANY_POINTS = 50


class ParametricContact:
    """H(x, gamma) = 0 for a contact problem, with the statuses of contact points as pieces.

    Statuses are those of `laws.status`: 0 open, 1 stick, 2 slip with u_t > 0, 3 slip with u_t < 0;
    in 3D, 2 is slip; 4 to 6 are the same at open points, under a friction bound given in advance.

    Args:
        problem: the contact problem; its Functions follow what is evaluated.
        gamma: the parameter, a scalar Constant in the bulk, a law or an obstacle.
        driven: pairs of a Function used in a Dirichlet condition and the UFL expression of gamma
            (and position) that it is to have.

    Raises:
        ValueError: on every rank, if ``gamma`` is no scalar Constant of the mesh, something of
            ``driven`` is of another mesh or shape or in no Dirichlet condition, or ranks differ.
    """

    def __init__(
        self,
        problem: ContactProblem,
        gamma: fem.Constant,
        *,
        driven: Sequence[tuple[fem.Function, Any]] = (),
    ):
        if not isinstance(problem, ContactProblem):
            raise ValueError(f"a ContactProblem is needed, got {type(problem).__name__}")
        with everywhere(problem.comm, "a contact problem with a parameter"):
            driven = _checked(problem, gamma, driven)
        same_everywhere(
            problem.comm,
            gamma=float(gamma.value),
            driven=[described(expression, problem.V.mesh) for _, expression in driven],
        )
        self.problem, self.constant, self.comm = problem, gamma, problem.comm
        self._scales = Scales(problem)
        variable = ufl.variable(gamma)
        self._rates = [
            [_rate(row, gamma, variable, problem.entity_maps) for row in rows]
            for rows in problem.rows
        ]
        self._driven = [_Driven(f, expression, gamma, variable) for f, expression in driven]
        #: Surfaces whose obstacle moves with gamma.
        self.moving = [s for s in problem.surfaces if self.depends_on_gamma(s.gap)]
        self._metric = self._mass()
        counts = [s.num_owned_points for s in problem.surfaces]
        #: Owned points that Dirichlet data clamp: they have no status of their own.
        self.clamped = np.concatenate(
            [
                clamped[:n] if s.method != "integral" else np.zeros(n, dtype=bool)
                for s, clamped, n in zip(
                    problem.surfaces, problem.constraints.clamped, counts, strict=True
                )
            ]
        )
        self._offsets = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        self._num_points = self.comm.allreduce(int(self._offsets[-1]))
        self._exact = self._is_affine(variable)
        self._condensed: CondensedContact | None = None
        self._condensed_from = 0  # mark of the data
        self._data = self._given()

    def _given(self) -> list[Any]:
        """What the user may change between two calls: Functions and Constants but gamma's own."""
        problem = self.problem
        ours = [*problem.fields, self.constant]
        for s in problem.surfaces:
            ours += s.helpers
        found: list[Any] = []
        for row in problem.rows:
            for form in row:
                found += [*form.coefficients(), *extract_constants(form)]
        found += [
            dirichlet_value(bc)
            for bc in problem.bcs
            if not any(is_value_of(d.function, bc) for d in self._driven)
        ]
        return [f for f in found if not any(f is other for other in ours)]

    def _mark(self) -> int:
        """A checksum of `_data` and of the mesh, on this rank."""
        mark = zlib.crc32(np.ascontiguousarray(self.problem.V.mesh.geometry.x))
        for f in self._data:
            values = f.x.array if hasattr(f, "x") else np.asarray(f.value)
            mark = zlib.crc32(np.ascontiguousarray(values), mark)
        return mark

    def _mass(self) -> PETSc.Mat:
        """Mass matrix of the displacement over the volume and the square of the body's size."""
        from dolfinx.fem.petsc import assemble_matrix

        problem = self.problem
        u, v = ufl.TrialFunction(problem.V), ufl.TestFunction(problem.V)
        one = fem.Constant(problem.V.mesh, 1.0)
        volume = self.comm.allreduce(float(np.real(fem.assemble_scalar(fem.form(one * ufl.dx)))))
        mass = assemble_matrix(fem.form(ufl.inner(u, v) * ufl.dx))
        mass.assemble()
        mass.scale(1.0 / (volume * problem.body_size**2))
        self._mass_in, self._mass_out = mass.createVecRight(), mass.createVecLeft()
        return mass

    def set_parameter(self, gamma: float) -> None:
        """Put gamma into the forms and the Dirichlet data, for a solve at this value. Collective.

        Raises:
            ValueError: on every rank, if gamma is no finite number, or differs between ranks.
        """
        with everywhere(self.comm, "set_parameter"):
            gamma = checked_gamma(gamma)
        same_everywhere(self.comm, gamma=gamma)
        self._set(gamma, None)

    def check_parameter(self, gammas: Sequence[float]) -> None:
        """Raise ``ValueError`` if a law is none at one of these values of gamma. Collective."""
        varying = [s for s in self.problem.surfaces if self.depends_on_gamma(s.law.bound(s.gap))]
        if varying:
            with self.restored(always=True):
                for gamma in gammas:
                    self._set(gamma, None)
                    for s in varying:
                        s.check_law(f" at gamma = {gamma:g}")

    def put(self, x: PETSc.Vec, gamma: float, piece: Piece) -> None:
        """Put a point of a branch into the Functions of the problem, its statuses included."""
        self._set(gamma, piece)
        self.problem.read(x)

    def result_at(self, point: BranchPoint) -> Result:
        """The tables of a point of a branch, which is left in the Functions. Collective.

        Statuses are those of the piece of the point, also where it lies on a border.
        """
        x = self.create_vector()
        x.array[:] = point.y.array_r[: x.getLocalSize()]
        self.put(x, point.gamma, point.piece)
        with self.problem.status_held():
            done = Attempt("continuation", "a point of a branch", converged=True)
            result = collect(self.problem, x, [done])
        x.destroy()
        return result

    @contextmanager
    def restored(self, *, always: bool = False) -> Iterator[None]:
        """Put Functions, statuses, gamma and Dirichlet data back if the context raises.

        Args:
            always: also if it does not.
        """
        functions = [*self.problem.fields, *(d.function for d in self._driven)]
        before, statuses = [f.x.array.copy() for f in functions], self.problem.statuses
        gamma = self.constant.value.copy()
        done = False
        try:
            yield
            done = not always
        finally:
            if not done:
                for f, values in zip(functions, before, strict=True):
                    f.x.array[:] = values
                self.problem.statuses = statuses
                self.constant.value = gamma

    @property
    def scales(self) -> tuple[float, float]:
        """Force and length that residuals are measured by; they grow along a branch."""
        return self._scales.force, self._scales.length

    @scales.setter
    def scales(self, scales: Sequence[float]) -> None:
        self._scales.force, self._scales.length = scales

    @property
    def has_many_pieces(self) -> bool:
        """Whether kinks are passed in batches by default: in 3D beyond fifty contact points."""
        in_space = any(s.dim == 3 for s in self.problem.surfaces)
        return in_space and self._num_points > _MANY_POINTS

    # -- affine pieces ---------------------------------------------------------------------------

    def depends_on_gamma(self, expression: Any) -> bool:
        """Whether a UFL expression contains the parameter."""
        return self.constant in extract_constants(ufl.as_ufl(expression))

    def _is_affine(self, variable: Any) -> bool:
        """Whether the bulk is linear in u and gamma enters the data linearly."""
        problem = self.problem
        direction = ufl.TrialFunction(problem.V)
        residual = problem.rows[0][0]
        stiffness = ufl.algorithms.expand_derivatives(
            ufl.derivative(residual, problem.u, direction)
        )
        if problem.u in stiffness.coefficients() or self.constant in stiffness.constants():
            return False
        curved = _second_rate(residual, self.constant, variable)
        return not curved and all(d.is_affine for d in self._driven)

    def condensed(self, x: PETSc.Vec, gamma: float) -> CondensedContact | None:
        """The problem condensed onto its contact points, or its linearisation at (x, gamma).

        None where the statuses of the points are no polyhedral cones (3D friction, integral
        contact, a threshold given in advance, gamma in the law or in the obstacle) or there are too
        many points. Collective.
        """
        if not can_condense(self):
            return None
        if not self._exact:
            return CondensedContact(self, x, gamma, exact=False)
        mark = self._mark()
        if self._condensed is None or self.comm.allreduce(int(mark != self._condensed_from)):
            # From nothing: no state leaves its round-off in what is degenerate without load.
            nothing = self.create_vector()
            with self.restored(always=True):
                self._condensed = CondensedContact(self, nothing, 0.0, exact=True)
            nothing.destroy()
            self._condensed_from = mark
        return self._condensed

    @property
    def is_piecewise_affine(self) -> bool:
        """Whether every piece is affine in (x, gamma). Collective."""
        return self._exact and can_condense(self)

    def surface_parts(
        self,
    ) -> Iterator[tuple[ContactSurface, npt.NDArray[np.bool_], int]]:
        """Surfaces, which of their owned points are clamped, and the first local number."""
        for s, a, b in self._parts():
            yield s, self.clamped[a:b], a

    def add_tractions(
        self,
        x: PETSc.Vec,
        points: npt.NDArray[np.int64],
        tractions: npt.NDArray[np.float64],
    ) -> None:
        """Add tractions at local points of nodal surfaces to the multipliers in ``x``."""
        sizes = np.cumsum(self.problem.owned_sizes)
        for (s, a, b), start in zip(self._parts(), sizes[:-1], strict=True):
            chosen = (points >= a) & (points < b)
            rows = start + s.dim * (points[chosen] - a)[:, None] + np.arange(s.dim)
            x.array[rows] += tractions[chosen] / self.problem.unit_of(s.multiplier)

    # -- System ----------------------------------------------------------------------------------

    @property
    def preconditioner(self) -> Preconditioner | None:
        """That of the problem's linear solver; None if it is a direct one. Collective."""
        return self.problem.linear_solver.preconditioner

    @property
    def matrix(self) -> PETSc.Mat:
        """The derivative of H by x, a product of PETSc's or an assembled matrix. Collective."""
        return self.problem.linear_solver.matrix

    def create_vector(self) -> PETSc.Vec:
        return self.problem.create_vector()

    def residual(self, x: PETSc.Vec, gamma: float, b: PETSc.Vec, piece: Piece | None) -> None:
        self._set(gamma, piece)
        with self.problem.status_held(piece is not None):
            self.problem.residual(x, b)

    def jacobian(self, x: PETSc.Vec, gamma: float, piece: Piece | None) -> None:
        self._set(gamma, piece)
        with self.problem.status_held(piece is not None):
            self.problem.read(x)
            self.problem.update_status()
            self.problem.linear_solver.update()

    def parameter_derivative(
        self, x: PETSc.Vec, gamma: float, c: PETSc.Vec, piece: Piece | None
    ) -> None:
        self._set(gamma, piece)
        problem = self.problem
        problem.read(x)
        with problem.status_held(piece is not None):
            problem.update_status()
            problem.assemble_rates(self._rates, self._dirichlet_rates(), c)

    def error(self, b: PETSc.Vec) -> float:
        return self._scales.measure(b).worst

    def metric(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        n = self._mass_in.getLocalSize()
        self._mass_in.array[:] = x.array_r[:n]
        self._metric.mult(self._mass_in, self._mass_out)
        out.set(0.0)
        out.array[:n] = self._mass_out.array_r

    def piece_at(self, x: PETSc.Vec, gamma: float) -> Piece:
        self._set(gamma, None)
        self.problem.read(x)
        self.problem.update_status()
        return self._piece([s.status for s in self.problem.surfaces])

    def events(self, x: PETSc.Vec, gamma: float, piece: Piece) -> Events:
        self._set(gamma, piece)
        self.problem.read(x)
        parts = [_events(s, piece.codes[a:b], a) for s, a, b in self._parts()]
        distance, point, target = (np.concatenate(column) for column in zip(*parts, strict=True))
        free = ~self.clamped[point]
        return Events(distance[free], point[free], target[free])

    def probe(self, seed: int) -> PETSc.Vec:
        parts = []
        for f, n in zip(self.problem.fields, self.problem.owned_sizes, strict=True):
            V = f.function_space
            bs = V.dofmap.index_map_bs
            # Keyed by coordinates: neither numbering nor ranks matter.
            places = V.tabulate_dof_coordinates()[: n // bs] / self.problem.body_size
            phase = places @ np.array([12.9898, 78.233, 37.719]) + seed
            parts.append(np.sin(43.7585 * (phase[:, None] + np.arange(bs))).reshape(-1))
        x = self.create_vector()
        x.array[:] = np.concatenate(parts)
        return x

    def statuses(self, point: int) -> Sequence[int]:
        number = np.searchsorted(self._offsets, point, side="right") - 1
        return self._statuses(self.problem.surfaces[number])

    @staticmethod
    def _statuses(surface: ContactSurface) -> Sequence[int]:
        tangential = (STICK, PLUS, MINUS) if surface.dim == 2 else (STICK, PLUS)
        if surface.law.needs_pressure:
            return (OPEN, *tangential)
        return (*tangential, *(WHERE_OPEN + k for k in tangential))

    # -- pieces ----------------------------------------------------------------------------------

    def letters(self, piece: Piece) -> str:
        """Statuses of all points of all surfaces, in order of coordinates. Collective."""
        words = []
        for s, a, b in self._parts():
            letters = np.where(self.clamped[a:b], "d", status.letters(s.dim)[piece.codes[a:b]])
            places = np.concatenate(self.comm.allgather(s.positions[: b - a]))
            word = np.concatenate(self.comm.allgather(letters))
            words += word[by_coordinates(places)].tolist()
        return "".join(words)

    def piece_of(self, letters: str) -> Piece:
        """The piece whose `letters` these are. Collective.

        Raises:
            ValueError: on every rank, if they are not statuses of these points.
        """
        parts, start = [], 0
        for s, a, b in self._parts():
            counts = self.comm.allgather(b - a)
            order = by_coordinates(np.concatenate(self.comm.allgather(s.positions[: b - a])))
            word = np.array(list(letters[start : start + len(order)]))
            start += len(order)
            known = "".join(status.letters(s.dim)[list(self._statuses(s))]) + "d"
            fits = len(word) == len(order) and set(word) <= set(known)
            require(self.comm, fits, f"{s.name}: {len(order)} statuses of {known} are needed")
            placed = np.empty(len(order), dtype=word.dtype)
            placed[order] = word
            first = sum(counts[: self.comm.rank])
            mine = placed[first : first + b - a]
            same = bool(np.array_equal(mine == "d", self.clamped[a:b]))
            require(self.comm, same, f"{s.name}: other points are clamped")
            every = "".join(status.letters(s.dim))
            parts.append([OPEN if c == "d" else every.index(c) for c in mine])
        require(self.comm, start == len(letters), f"{start} statuses are needed, not more")
        return Piece(np.concatenate(parts).astype(np.int8))

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """Places of the owned points of all surfaces, in the order of a piece (n, dim)."""
        return np.concatenate([s.positions[: b - a] for s, a, b in self._parts()])

    def _parts(self) -> Iterator[tuple[ContactSurface, int, int]]:
        """Surfaces with the range of their points among the local points."""
        ends = self._offsets[1:]
        return zip(self.problem.surfaces, self._offsets[:-1], ends, strict=True)

    def _piece(self, statuses: Sequence[Status]) -> Piece:
        codes = []
        for s, state in zip(self.problem.surfaces, statuses, strict=True):
            n = s.num_owned_points
            slip = np.where(state.slip[:n] > 0, MINUS, PLUS) if s.dim == 2 else PLUS
            code = np.where(state.stick[:n] > 0, STICK, slip)
            off = OPEN if s.law.needs_pressure else code + WHERE_OPEN
            codes.append(np.where(state.active[:n] > 0, code, off))
        return Piece(np.where(self.clamped, OPEN, np.concatenate(codes)).astype(np.int8))

    def _set(self, gamma: float, piece: Piece | None) -> None:
        """Put gamma, Dirichlet data and the statuses of ``piece`` into the problem. Collective."""
        self.constant.value = gamma
        for d in self._driven:
            d.function.interpolate(d.value)
        for s in self.moving:
            s.update_geometry()
        if piece is None:
            return
        for s, a, b in self._parts():
            codes = piece.codes[a:b]
            closed, friction = status.closed(codes).astype(float), status.senses(codes)
            slip = np.where(friction == MINUS, 1.0, np.where(friction == PLUS, -1.0, 0.0))
            stuck = (friction == STICK).astype(float)
            s.set_owned_status(Status(closed, stuck, slip if s.dim == 2 else np.abs(slip)))

    def _dirichlet_rates(self) -> npt.NDArray[np.float64]:
        """Derivatives of Dirichlet values by gamma on the local displacement dofs, 0 elsewhere."""
        problem = self.problem
        if not self._driven:
            return np.zeros_like(problem.u.x.array)
        kept = [d.function.x.array.copy() for d in self._driven]
        fixed = problem.constraints.values(fill=0.0)
        for d, values in zip(self._driven, kept, strict=True):
            d.function.interpolate(d.rate)
            d.function.x.array[:] += values
        moved = problem.constraints.values(fill=0.0)
        for d, values in zip(self._driven, kept, strict=True):
            d.function.x.array[:] = values
        return np.asarray(moved - fixed).reshape(-1)

    def destroy(self) -> None:
        """Free the PETSc objects made here."""
        for thing in (self._metric, self._mass_in, self._mass_out, self._condensed):
            if thing is not None:
                thing.destroy()


def _checked(problem: ContactProblem, gamma: Any, driven: Any) -> list[tuple[fem.Function, Any]]:
    """The pairs ``driven``, or ``ValueError`` if something does not fit. Not collective."""
    domain = problem.V.mesh
    if not isinstance(gamma, fem.Constant) or gamma.ufl_shape != ():
        raise ValueError("gamma must be a scalar Constant")
    if gamma.ufl_domain() != domain.ufl_domain():
        raise ValueError("gamma is a Constant of another mesh")
    pairs = []
    for pair in driven:
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise ValueError("driven must be a list of pairs: a Function and its UFL expression")
        f, expression = pair
        if not isinstance(f, fem.Function):
            raise ValueError(f"a driven Function must be a Function, got {type(f).__name__}")
        if not is_mesh_of(domain, f.function_space):
            raise ValueError(f"the driven Function {f.name} is of another mesh")
        try:
            expression = ufl.as_ufl(expression)
        except ValueError:
            raise ValueError(f"what drives {f.name} is no UFL expression: {pair[1]!r}") from None
        if expression.ufl_shape != f.ufl_shape:
            raise ValueError(
                f"the driven Function {f.name} has shape {f.ufl_shape}, its expression "
                f"{expression.ufl_shape}"
            )
        refuse_other_mesh(expression, domain, f"the expression that drives {f.name}")
        if not any(is_value_of(f, bc) for bc in problem.bcs):
            raise ValueError(f"the driven Function {f.name} is in no Dirichlet condition")
        pairs.append((f, expression))
    return pairs


class _Driven:
    """A Function of Dirichlet data with its value and rate as interpolable expressions."""

    def __init__(self, function: fem.Function, expression: Any, gamma: fem.Constant, variable: Any):
        points = interpolation_points(function.function_space)
        expression = ufl.as_ufl(expression)
        domain = function.function_space.mesh
        x = ufl.SpatialCoordinate(domain)
        # FFCx compiles no expression in which nothing but constants occurs.
        nothing = fem.Constant(domain, 0.0) * (x if expression.ufl_shape else x[0])
        rate = nothing + ufl.diff(ufl.replace(expression, {gamma: variable}), variable)
        self.function = function
        second = ufl.diff(ufl.diff(ufl.replace(expression, {gamma: variable}), variable), variable)
        #: Whether gamma enters linearly.
        self.is_affine = not _nonzero(second)
        self.value = fem.Expression(expression + nothing, points)
        self.rate = fem.Expression(rate, points)


def _rate(row: ufl.Form, gamma: fem.Constant, variable: Any, maps: Any) -> fem.Form | None:
    """The derivative of a row by gamma, compiled; None if gamma is not in it."""
    if gamma not in row.constants():
        return None
    rate = ufl.algorithms.expand_derivatives(
        ufl.diff(ufl.replace(row, {gamma: variable}), variable)
    )
    return None if rate.empty() else fem.form(rate, entity_maps=maps)


def _nonzero(expression: Any) -> bool:
    expanded = ufl.algorithms.expand_derivatives(expression)
    return not isinstance(expanded, ufl.constantvalue.Zero)


def _second_rate(form: ufl.Form, gamma: fem.Constant, variable: Any) -> bool:
    """Whether the second derivative of a form by gamma is anything but zero."""
    if gamma not in form.constants():
        return False
    second = ufl.diff(ufl.diff(ufl.replace(form, {gamma: variable}), variable), variable)
    return not ufl.algorithms.expand_derivatives(second).empty()


def _events(
    s: ContactSurface, codes: npt.NDArray[np.int8], offset: int
) -> tuple[npt.NDArray[Any], ...]:
    """Distances of the owned points of a surface to their next status, in units of length.

    On a held piece: an open point may close (p = 0) and then slips against its displacement, if no
    friction acted on it before; a closed one may open; a stuck one may reach its friction bound;
    the shear of a slipping one may fall below it.
    """
    n = len(codes)
    p, shear, bound = (values[:n] for values in s.augmented_values())
    unit = 1.0 / s.mean_augmentation
    points = np.arange(n, dtype=np.int32) + offset
    closed, friction = status.closed(codes), status.senses(codes)
    sticks, slips = friction == STICK, (friction == PLUS) | (friction == MINUS)
    shift = np.where(closed, 0, WHERE_OPEN)
    towards = np.where(shear > 0, MINUS, PLUS) if s.dim == 2 else np.full(n, PLUS)
    closes = np.where(codes == OPEN, towards, codes - WHERE_OPEN)
    opens = np.full(n, OPEN) if s.law.needs_pressure else codes + WHERE_OPEN
    parts = [(~closed, -p, closes), (closed, p, opens)]
    if s.dim == 2:
        sense = np.where(friction == MINUS, 1.0, -1.0)
        parts += [
            (sticks, bound - shear, MINUS + shift),
            (sticks, bound + shear, PLUS + shift),
            (slips, sense * shear - bound, STICK + shift),
        ]
    else:
        parts += [
            (sticks, bound - shear, PLUS + shift),
            (slips, shear - bound, STICK + shift),
        ]
    distance = np.concatenate([(unit * d)[mask] for mask, d, _ in parts])
    point = np.concatenate([points[mask] for mask, _, _ in parts])
    target = np.concatenate([np.asarray(target, dtype=np.int8)[mask] for mask, _, target in parts])
    return distance, point, target
