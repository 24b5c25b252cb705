# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact problem of a body, whose Functions contain the start and the result of a solve."""

from __future__ import annotations

import logging
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact._arrays import Array
from dolfinx_contact._geometry import mesh_mark
from dolfinx_contact._mpi import (
    Arguments,
    all_ranks,
    any_rank,
    collective,
    keep,
    require,
    same_everywhere,
)
from dolfinx_contact._petsc import ProblemOptions, in_database, require_real, staged
from dolfinx_contact._progress import PROGRESS
from dolfinx_contact._ufl import described
from dolfinx_contact._validate import (
    ReadOnly,
    copy_with,
    count,
    instance,
    nonnegative,
    one_of,
    positive,
)
from dolfinx_contact.body.bulk import Bulk, weighted
from dolfinx_contact.body.cells import check_cells
from dolfinx_contact.body.checks import unintended
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.equations.evaluation import Evaluation, Statuses
from dolfinx_contact.equations.measures import require_solution
from dolfinx_contact.equations.state import State
from dolfinx_contact.equations.validation import check, check_sides, validate
from dolfinx_contact.points.descriptions import (
    Contact,
    ContactPair,
    ContactSurface,
)
from dolfinx_contact.points.memory import Memory
from dolfinx_contact.points.pair import DiscretePair
from dolfinx_contact.points.revolution import axis_condition
from dolfinx_contact.points.rigid_body import RigidBody
from dolfinx_contact.points.surface import DiscreteSurface
from dolfinx_contact.results.indicators import small_sliding_violated
from dolfinx_contact.results.result import Result, Shown, collect
from dolfinx_contact.results.tables import (
    ContactTable,
    contact_tables,
    forces_at_vertices,
    support_at_nodes,
)
from dolfinx_contact.results.uniqueness import Theory, Uniqueness, check_seconds
from dolfinx_contact.solvers.attempts import Attempt, SolveProgress, Step
from dolfinx_contact.solvers.linear import LinearSolverChoice
from dolfinx_contact.solvers.newton import LinearSolver
from dolfinx_contact.solvers.strategies import Trial, solve

if TYPE_CHECKING:
    from dolfinx_contact.algorithms import Algorithm
    from dolfinx_contact.body.moving import MovingBody
    from dolfinx_contact.reduced import PointProblem

__all__ = ["ContactProblem", "discretise"]

logger = logging.getLogger(__name__)

_INCREMENTS = 8  # of the load, in the strategy of that name
_IN_MOTION = "the state belongs to a motion, whose inertia forces are not part of a static problem"
_NOT_SOLVED = (
    "solve again if data have changed; after `step.solve()`, ask `step.uniqueness()`, and after a "
    "history `uniqueness(state=history.steps[-1].state)`"
)


def _check_step(a: Arguments) -> None:
    a.step = nonnegative(a.step, "the duration of a step")


def _check_solve(a: Arguments) -> None:
    a.expected = [list(statuses) for statuses in a.expected]
    count(a.increments, "the number of increments")
    if not (isinstance(a.algorithm, str) and a.algorithm == "newton"):
        from dolfinx_contact.algorithms.classical import algorithm_named

        a.algorithm = algorithm_named(a.algorithm)
    one_of(a.progress, "progress", PROGRESS)


def _check(a: Arguments) -> None:
    require_real()
    instance(a.u, "the displacement", fem.Function)
    a.surfaces, a.bcs = check(a.bulk, a.u, a.surfaces, a.bcs)
    if a.r is not None:
        positive(a.r, "the augmentation parameter r", "positive")
    a.petsc_options = {} if a.petsc_options is None else a.petsc_options
    ProblemOptions(a.petsc_options_prefix, a.petsc_options).check()


def _described(a: Arguments) -> dict[str, Any]:
    domain = a.u.function_space.mesh
    return {
        "contact_surfaces": [s.name for s in a.surfaces],
        "Dirichlet_data": [described(bc, domain) for bc in a.bcs],
        "bulk": lambda: described(a.bulk, domain),
        "r": described(a.r, domain),
        "rigid_bodies": [_rigid_body(s) for s in a.surfaces],
        "petsc_options": sorted((k, described(v, domain)) for k, v in a.petsc_options.items()),
        "PETSc_database": sorted(in_database(a.petsc_options_prefix).items()),
    }


def _rigid_body(contact: Contact) -> str:
    """Return a description of the rigid body of a surface; empty if there is none."""
    obstacle = getattr(contact, "obstacle", None)
    return str(obstacle.described()) if isinstance(obstacle, RigidBody) else ""


def discretise(contact: Contact, *, linear: bool = True) -> DiscreteSurface:
    """Discretise a description of contact: contact points, multiplier, operators. Collective.

    Args:
        contact: description of the contact.
        linear: whether the body is linear.

    Raises:
        ValueError: on every rank, if the description does not fit the mesh.
    """
    if isinstance(contact, ContactSurface):
        return DiscreteSurface(contact, linear=linear)
    if isinstance(contact, ContactPair) and contact.sliding != "large":
        return DiscretePair(contact)
    from dolfinx_contact.points.sliding_pair import SlidingPair

    return SlidingPair(contact)


@dataclass
class _LastWrite:
    """Record of the last write to the Functions: unknowns, statuses, and memory of the law.

    Displacement and multipliers determine neither the status at the limit between two statuses, for
    example between stick and slip, nor the memory, for example which bonds are broken. Stored
    statuses and memory are therefore reused as long as the unknowns in the Functions are bitwise
    identical to the stored ones.

    Attributes:
        unknowns: owned values of all unknowns, in the user's units, shape (n,).
        statuses: statuses of the contact points.
        previous: memory of each surface under which the unknowns were computed; None for the static
            law.
        memory: memory of each surface for a step beginning there; None if it must be computed from
            the unknowns, the statuses and ``previous``.
    """

    unknowns: Array | None = None
    statuses: Statuses = ()
    previous: Sequence[Memory | None] = ()
    memory: Sequence[Memory] | None = None


class ContactProblem(ReadOnly):
    """Static equilibrium of a body with unilateral contact and friction on parts of its boundary.

    Friction opposes the total slip (the static law). `step_from` returns the problem of one step.
    With friction, use `QuasiStatic` if the contact zone grows with the load (Hertz, indentation):
    in the static law, tangential displacement that precedes contact counts as slip as well.

    `solve` starts from the current displacement and multipliers and overwrites them with the
    solution. If no solution is found, they keep their values.

    Methods for users: `solve`, `uniqueness`, `theory` and `reduced` solve or analyse the problem;
    `snapshot`, `restore` and `step_from` handle states; `table`, `tables`, `contact_fields` and
    `support_forces` evaluate a solution.

    Methods for other layers of the package: `write` and `read` copy the Functions to a vector of
    unknowns and back, `show` and `collect` write states to the Functions, `evaluate` computes the
    residual of a state, and `with_memory` returns the problem of a step. They validate less than
    the methods for users.

    In a body of revolution (``axisymmetric=True`` in all surfaces) the problem multiplies every
    integral of ``bulk``, over cells and facets, by 2 pi r. Integrands are therefore per volume or
    area and must not contain this weight. u_r = 0 is prescribed on the axis.

    Forms, surfaces and conditions are read and compiled once, and attributes are read-only. Between
    two solves the values of Constants and Functions may be changed, and single entries of
    `petsc_options`. Numbers and arrays are copied, also by ``fem.dirichletbc``.

    Args:
        bulk: UFL energy (a functional of ``u``) or residual (linear in a test function of the space
            of ``u``) of the body, without contact terms. A residual with kinks in ``u``, for
            example from ``max_value(u[0], 0)**2``, can be solved, but neither proofs nor branches
            support it. A residual with jumps, for example from ``abs(u[0])``, has in general no
            root; friction must be modelled by the law of a surface.
        u: displacement, a vector Lagrange Function.
        surfaces: descriptions of the contact surfaces, each made with ``u``.
        bcs: Dirichlet conditions on the space of ``u`` or its components; default: none.
        r: augmentation parameter, a stiffness per area; default: derived from the stiffness of the
            contact nodes, and updated by `solve` if the stiffness has changed. It affects the
            iterates but not the solution. The exception is ``method="integral"``, whose weak
            contact conditions depend on r; the effect vanishes under mesh refinement.
        petsc_options_prefix: options prefix of the SNES; every strategy creates its own SNES. The
            relative tolerance applies to the measures of the residual (`equations.measures`), not
            to its norm. `Result.attempts` contains the outcome.
        petsc_options: options of the SNES, named without the prefix; options on the command line
            take precedence.

    Attributes:
        u: displacement.
        contacts: descriptions of the contact surfaces, as given.
        surfaces: discretised contact surfaces with contact points and multipliers, in the order of
            `contacts`.
        bcs: Dirichlet conditions, including the conditions on the axis of a body of revolution.
        energy: UFL energy as given; None if a residual was given.
        equations: residual H as a function of vectors, independent of the Functions.
        petsc_options: options of the SNES, without the prefix.

    Raises:
        ValueError: on every rank, if the arguments do not fit together or belong to different
            meshes, arguments differ between ranks, all contact nodes are clamped, a mesh coordinate
            is not finite, a cell has no volume, or axisymmetric and plane surfaces or materials are
            mixed.
        AttributeError: if an attribute is changed afterwards.
        RuntimeError: if PETSc has complex scalars.

    Example:
        One problem for many loads, stiffnesses and coefficients of friction::

            young, load = fem.Constant(domain, 1000.0), fem.Constant(domain, (0.0, -1.0))
            steel = materials.LinearElastic.from_young(young, 0.3)
            energy = steel.energy(u) * ufl.dx - ufl.dot(load, u) * ds(top)
            surface = ContactSurface(u, facets, obstacle=floor, law=Coulomb(0.1))
            problem = ContactProblem(energy, u, [surface], bcs=bcs)
            for friction, stiffness, force in cases:
                surface.law.friction.value = friction
                young.value, load.value[1] = stiffness, -force
                result = problem.solve()
    """

    _listed = (
        "contact_fields",
        "create_vector",
        "destroy",
        "discrete",
        "evaluate",
        "fields",
        "linear_solver",
        "read",
        "reduced",
        "residual",
        "restore",
        "restored",
        "rigid_bodies",
        "snapshot",
        "solve",
        "step_from",
        "support_forces",
        "table",
        "tables",
        "theory",
        "uniqueness",
        "write",
    )
    _advice = (
        "change values of its Constants and Functions, numbers of laws "
        "(surface.law.friction.value = 0.5) and single entries of petsc_options; otherwise make "
        "another problem"
    )

    @collective("a contact problem", _check, compare=_described, local=("surfaces", "bcs"))
    @staged("ContactSetUp")
    def __init__(
        self,
        bulk: ufl.Form,
        u: fem.Function,
        surfaces: Sequence[Contact],
        *,
        bcs: Sequence[fem.DirichletBC] = (),
        r: float | None = None,
        petsc_options_prefix: str = "contact_",
        petsc_options: Mapping[str, Any] | None = None,
    ):
        self.u = u
        self.V = u.function_space
        self.comm = u.function_space.mesh.comm
        keep(self.V.mesh)
        self.petsc_options = dict(petsc_options or {})
        PETSc.garbage_cleanup(self.comm)  # objects of earlier problems on several ranks
        check_cells(self.V.mesh)
        given = ProblemOptions(petsc_options_prefix, self.petsc_options)
        axisymmetric = surfaces[0].axisymmetric
        body = Bulk(weighted(bulk, axisymmetric=axisymmetric), u)
        #: The UFL energy as given, or None if a residual was given.
        self.energy: ufl.Form | None = bulk if body.is_energy else None
        spaces = fem.extract_function_spaces([body.residual_form])
        if len(fem.bcs_by_block(spaces, bcs)[0]) != len(bcs):
            raise ValueError("a Dirichlet condition is not on the space of u or a component of it")
        on_axis = axis_condition(self.V) if axisymmetric else []
        body.displacement.x.array[:] = u.x.array
        #: Descriptions of the contact surfaces.
        self.contacts: tuple[Contact, ...] = tuple(surfaces)
        #: Discretisations of the contact surfaces, in the order of their descriptions.
        self.surfaces: tuple[DiscreteSurface, ...] = tuple(
            discretise(s, linear=body.linear) for s in surfaces
        )
        #: The unknown Functions: the displacement, then the multipliers of the surfaces.
        self.fields: list[fem.Function] = [u, *(s.multiplier for s in self.surfaces)]
        #: Dirichlet conditions, including the conditions on the axis.
        self.bcs: tuple[fem.DirichletBC, ...] = (*bcs, *on_axis)
        self.equations = ContactEquations(body, self.V, self.surfaces, self.bcs, r=r, options=given)
        for name, text in unintended(bulk, self.V, bcs).items():
            self.equations.warn(name, text)
        self._linear = LinearSolverChoice(self.equations)
        # shared with the problems of steps, which write to the same Functions
        self._written = _LastWrite()
        #: Checksum of mesh and contact points, used to reject states of other problems.
        self.signature = mesh_mark(self.V.mesh)
        for s in self.surfaces:
            self.signature = zlib.crc32(f"{s.name} {s.method}".encode(), self.signature)
            self.signature = zlib.crc32(np.ascontiguousarray(s.points.positions), self.signature)
        #: Kinds of the evolutions run on this problem, shared with the problems of steps.
        self.evolved: list[str] = []
        check_sides(self.equations)

    def __repr__(self) -> str:
        topology = self.V.mesh.topology
        cells = topology.index_map(topology.dim).size_global
        kind = "linear" if self.equations.bulk.linear else "nonlinear"
        surfaces = ", ".join(
            f"{s.name!r} ({s.method}, {type(s.law).__name__})" for s in self.surfaces
        )
        return (
            f"<ContactProblem: {kind} body of {cells} cells, degree {self.V.ufl_element().degree}, "
            f"{sum(self.equations.unknowns.global_sizes)} unknowns; surfaces {surfaces}>"
        )

    def moving(self, body: MovingBody) -> ContactProblem:
        """Return the problem of a dynamic step, with the same Functions and surfaces. Collective.

        The new problem has its own linear solver.

        Args:
            body: body with mass and damping.
        """
        eq = self.equations
        equations = ContactEquations(
            body, self.V, self.surfaces, self.bcs, r=eq.forced_r, options=eq.options
        )
        equations.warnings = eq.warnings
        return copy_with(self, equations=equations, _linear=LinearSolverChoice(equations))

    @collective("a step", _check_step)
    def step_from(self, state: State, *, step: float = 0.0) -> ContactProblem:
        """Return the problem of one step that begins in a given state. Collective.

        In the returned problem, friction opposes the slip increment since the given state, and
        internal variables of laws start from their values in that state. In the problem itself, by
        contrast, friction opposes the total slip (the static law). Quasi-static histories, dynamic
        motions and paths are sequences of such steps.

        The returned problem shares Functions, data, compiled forms and matrices with this problem.
        It supports the same operations: `solve`, `uniqueness`, `continuation.follow`,
        `continuation.find_solutions` and the analysis of stability.

        Args:
            state: state at the beginning of the step.
            step: duration of the step, a non-negative time; default: 0, an instantaneous step.
                Laws depending on a viscosity or a velocity require a positive duration.

        Raises:
            ValueError: on every rank, if the state does not belong to this problem.

        Example:
            Steps of a quasi-static history::

                state = problem.snapshot()
                for force in (0.1, 0.2, 0.1):
                    load.value[0] = force
                    result = problem.step_from(state).solve()
                    state = problem.snapshot()
        """
        self._require_state(state)
        return self.with_memory([memory.later(step) for memory in state.memory])

    def with_memory(self, memory: Sequence[Memory | None]) -> ContactProblem:
        """Return the same problem with a different memory of the contact points. Collective.

        The copy is shallow: it shares Functions, data, forms, matrices and linear solvers.

        Args:
            memory: memory of the contact points at the beginning of the step, one entry per
                surface; None selects the static law.

        Raises:
            ValueError: on every rank, if the memory belongs to other surfaces.
        """
        return copy_with(self, equations=self.equations.with_memory(memory))

    # -- Functions and vectors -------------------------------------------------------------------

    @property
    def rigid_bodies(self) -> list[RigidBody]:
        """Rigid bodies that the surfaces may touch, in the order of the surfaces."""
        return list(self.equations.rigid.bodies)

    def create_vector(self) -> PETSc.Vec:
        """Create a vector of all unknowns: displacement, multipliers, motions of rigid bodies."""
        return self.equations.unknowns.create_vector()

    def read(
        self,
        x: PETSc.Vec,
        statuses: Statuses | None = None,
        memory: Sequence[Memory] | None = None,
    ) -> None:
        """Copy unknowns into the Functions and the rigid bodies. Collective.

        Args:
            x: vector of all unknowns.
            statuses: statuses of the contact points at ``x``, one array per surface, to be stored;
                default: statuses are computed from the unknowns when they are needed.
            memory: memory of each surface for a step beginning at ``x``, stored with the statuses;
                default: computed when it is needed.
        """
        for f, values in zip(self.fields, self.equations.unknowns.fields(x), strict=True):
            f.x.array[: len(values)] = values
            f.x.scatter_forward()
        self.equations.rigid.show(self.equations.unknowns.motions(x))
        if statuses is not None:
            self._note(statuses, self.equations.memory, memory)

    def write(self, x: PETSc.Vec) -> None:
        """Copy the values of the Functions and rigid bodies into a vector ``x`` of all unknowns."""
        eq = self.equations
        eq.unknowns.write([f.x.array for f in self.fields], eq.rigid.given, x)

    def _owned_values(self) -> Array:
        """Return the owned values of all unknowns in the user's units. Not collective."""
        sizes = self.equations.owned_sizes
        parts = [f.x.array[:n] for f, n in zip(self.fields, sizes, strict=False)]
        return np.concatenate([*parts, self.equations.rigid.given])

    def _note(
        self,
        statuses: Statuses,
        previous: Sequence[Memory | None],
        memory: Sequence[Memory] | None,
    ) -> None:
        """Record the current unknowns, and the statuses and memory that belong to them.

        Args:
            statuses: statuses of the contact points, one array per surface.
            previous: memory of each surface at the beginning of the step; None for the static law.
            memory: memory of each surface at the end of the step; None if it is not known.
        """
        self._written.unknowns = self._owned_values()
        self._written.statuses = [np.array(codes, dtype=np.int8) for codes in statuses]
        self._written.previous = previous
        self._written.memory = memory

    def _last_write(self) -> _LastWrite | None:
        """Return the last write to the Functions; None if they have changed since. Collective."""
        before = self._written.unknowns
        same = before is not None and np.array_equal(before, self._owned_values())
        return self._written if all_ranks(self.comm, same) else None

    @contextmanager
    def _unknowns(self) -> Iterator[PETSc.Vec]:
        """Context manager: vector of the unknowns in the Functions, freed on exit. Collective."""
        x = self.create_vector()
        self.write(x)
        try:
            yield x
        finally:
            x.destroy()

    @property
    def statuses(self) -> Statuses:
        """Statuses of the contact points for the state in the Functions. Collective."""
        return self.snapshot().statuses

    @property
    def written_statuses(self) -> Statuses | None:
        """Statuses last written to the Functions; None if these have changed since. Collective."""
        written = self._last_write()
        return None if written is None else written.statuses

    def snapshot(self) -> State:
        """Return an immutable copy of the state in the Functions and rigid bodies. Collective.

        If the Functions have not changed since the last solve, step or `restore`, the state has the
        statuses and the memory of that solution or state. A problem with another law, whose
        internal variables are not in this memory, has only its statuses. In all other cases,
        displacement and multipliers determine statuses and memory under the law of this problem;
        under the static law, slip is then counted from there, and bonds that the displacement does
        not break are intact.
        """
        self.equations.require_same_mesh()
        written = self._last_write()
        with self._unknowns() as x:
            if written is None:
                return self.state_at(x)
            memory = written.memory
            if not self.equations.fits(written.previous if memory is None else memory):
                return self.state_at(x, written.statuses)
            state = self.with_memory(written.previous).state_at(x, written.statuses)
        return state if memory is None else replace(state, memory=tuple(memory))

    def state_at(self, x: PETSc.Vec, statuses: Statuses | None = None) -> State:
        """Return the state with the given unknowns. Collective.

        Args:
            x: vector of all unknowns.
            statuses: statuses of the contact points, one array per surface; default: computed from
                the unknowns.
        """
        eq = self.equations
        eq.read_data()
        evaluation = eq.evaluate_contact(x, statuses)
        multipliers = []
        for s, owned in zip(self.surfaces, eq.unknowns.fields(x)[1:], strict=True):
            f = fem.Function(s.points.Q)
            f.x.array[: len(owned)] = owned
            f.x.scatter_forward()
            multipliers.append(f.x.array)
        return State(
            displacement=evaluation.u,
            multipliers=tuple(multipliers),
            statuses=tuple(evaluation.statuses),
            motions=tuple(eq.rigid.of_body(evaluation.q, b) for b in self.rigid_bodies),
            memory=eq.memory_after(evaluation),
            previous=eq.memory,
            signature=self.signature,
        )

    def restore(self, state: State) -> None:
        """Copy a state to the Functions and the rigid bodies, bitwise. Collective.

        The state may have been computed with other loads and laws: a frictionless solution, for
        example, can be the start of a frictional solve.

        Raises:
            ValueError: on every rank, if the mesh has moved, or the state belongs to another mesh,
                or to surfaces with other names, methods or contact points.
        """
        self._require_state(state)
        self.show(state)

    def show(self, state: State) -> None:
        """Copy a state to the Functions and the rigid bodies like `restore`, without validation."""
        for f, values in zip(self.fields, (state.displacement, *state.multipliers), strict=True):
            f.x.array[:] = values
        for body, motion in zip(self.rigid_bodies, state.motions, strict=True):
            body.values = motion.copy()
        self._note(state.statuses, state.previous, state.memory)

    def _require_state(self, state: State | None) -> None:
        """Raise ``ValueError`` if a state does not fit this problem or mesh. Collective.

        Mesh positions, contact points, methods and number of ranks must be equal.
        """
        self.equations.require_same_mesh()
        fits = isinstance(state, State) and (
            state.signature == self.signature
            and [len(v) for v in (state.displacement, *state.multipliers, *state.motions)]
            == [
                *(len(f.x.array) for f in self.fields),
                *(len(body.values) for body in self.rigid_bodies),
            ]
            and [len(v) for v in state.statuses] == [s.points.number for s in self.surfaces]
        )
        words = (
            "a State of this problem, of the same mesh, contact points, methods and number of "
            "ranks, as problem.snapshot() returns"
        )
        require(self.comm, fits, f"state must be {words}; got {type(state).__name__}")

    @contextmanager
    def restored(self, *, always: bool = False) -> Iterator[None]:
        """Context manager that restores Functions, rigid bodies and statuses after an error.

        Args:
            always: whether to restore them on every exit; default: only after an error.
        """
        before = [f.x.array.copy() for f in self.fields]
        motions = self.equations.rigid.given
        written = copy(self._written)
        done = False
        try:
            yield
            done = not always
        finally:
            if not done:
                for f, values in zip(self.fields, before, strict=True):
                    f.x.array[:] = values
                self.equations.rigid.show(motions)
                vars(self._written).update(vars(written))

    # -- H ---------------------------------------------------------------------------------------

    def residual(self, x: PETSc.Vec, b: PETSc.Vec, statuses: Statuses | None = None) -> Evaluation:
        """Assemble the residual H(x) into ``b``, and return the evaluation. Collective.

        Args:
            x: vector of all unknowns.
            b: vector that receives the residual.
            statuses: statuses for the contact laws, one array per surface; default: determined by
                ``x``.
        """
        self.equations.read_data()
        return self.equations.residual(x, b, statuses)

    def evaluate(self, state: State | None = None, statuses: Statuses | None = None) -> Evaluation:
        """Evaluate the residual H at a state. Collective.

        Args:
            state: state to evaluate; default: current values of the Functions.
            statuses: statuses for the contact laws, one array per surface; default: statuses of the
                state.
        """
        with self._shown(state) as problem, problem._unknowns() as x:
            problem.equations.read_data()
            statuses = problem.written_statuses if statuses is None else statuses
            return problem.equations.evaluate(x, statuses)

    @contextmanager
    def at(self, state: State | None) -> Iterator[ContactProblem]:
        """Context manager that writes a state to the Functions and restores them on exit.

        The yielded problem has the contact law of the step that ended in the state: friction
        opposes the slip increment of that step. Collective.

        Args:
            state: state to write; None for the current values of the Functions, with the law under
                which they were written.

        Yields:
            Problem whose equations have the memory of that step.

        Raises:
            ValueError: on every rank, if the mesh has moved or the state belongs to another
                problem.
        """
        with self._shown(state) as problem:
            # in an observer, and after a run, this is the law of the last step
            written = problem._last_write()
            if written is not None and problem.equations.is_static:
                problem = problem.with_memory(written.previous)
            yield problem

    @contextmanager
    def _evaluated(self, state: State | None) -> Iterator[tuple[ContactEquations, Evaluation]]:
        """Like `at`, with the equations of that step and the evaluation of H. Collective."""
        with self.at(state) as problem:
            yield problem.equations, problem.evaluate()

    @contextmanager
    def _shown(self, state: State | None) -> Iterator[ContactProblem]:
        """Context manager like `at`, but for None the law is that of this problem. Collective."""
        if not any_rank(self.comm, state is not None):
            self.equations.require_same_mesh()
            yield self
            return
        self._require_state(state)
        assert state is not None
        with self.restored(always=True):
            self.show(state)
            yield self.with_memory(state.previous)

    @property
    def linear_solver(self) -> LinearSolver:
        """Linear solver of Newton's method, recreated if its options have changed. Collective."""
        return self._linear()

    def table(
        self, surface: Contact | DiscreteSurface | str, *, state: State | None = None
    ) -> ContactTable:
        """Tabulate the contact points of a surface. Collective.

        Args:
            surface: surface of this problem, or its name.
            state: state to evaluate; default: current values of the Functions.
        """
        return self.tables(state=state)[self.discrete(surface).name]

    def tables(self, *, state: State | None = None) -> dict[str, ContactTable]:
        """Tabulate the contact points of all surfaces, by name of the surface. Collective.

        Args:
            state: state to evaluate; default: current values of the Functions.
        """
        with self._evaluated(state) as (eq, evaluation):
            return contact_tables(eq, evaluation, support_at_nodes(eq, evaluation))

    def contact_fields(
        self, surface: Contact | DiscreteSurface | str, *, state: State | None = None
    ) -> dict[str, fem.Function]:
        """Return pressure, shear, gap and other fields on a surface as Functions. Collective.

        The fields are new continuous piecewise linear Functions on the mesh of the surface,
        ``problem.discrete(surface).submesh.mesh``. They can be integrated by forms on that mesh and
        written with `io.write_fields`.

        Nodal pressures are nodal forces divided by nodal areas. The integral of the pressure
        therefore equals the sum of the normal forces, also on parallelograms, and also with
        ``method="integral"`` and linear multipliers. In bodies of revolution, where the integral
        has the weight 2 pi r, the difference vanishes under mesh refinement.

        Args:
            surface: surface of this problem, or its name.
            state: state to evaluate; default: current values of the Functions.

        Returns:
            Functions by name:

            - ``displacement``, a vector.
            - ``traction``, the contact traction on the body, a vector; its normal part
              ``pressure``, positive in compression; and its tangential part ``shear``, a vector.
              They are forces per area of the mesh. On facets that the other body covers only
              partly, they are smaller than the tractions in the contact table.
            - ``gap``, a length.
            - ``slip``, the tangential displacement, a vector.
            - ``status``, a status code listed in `io.STATUS_CODES`.
            - ``support``, the reaction of Dirichlet data on the body divided by the vertex area.
            - Internal variables of laws, such as ``beta``, the intensity of adhesion.

        Raises:
            ValueError: if the surface does not belong to the problem.

        Example:
            Mean pressure in the part x < 1/2::

                p = problem.contact_fields(contact)["pressure"]
                domain = p.function_space.mesh
                x = ufl.SpatialCoordinate(domain)
                inside = ufl.conditional(ufl.lt(x[0], 0.5), 1.0, 0.0)
                dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 8})
                sums = [fem.assemble_scalar(fem.form(f * dx)) for f in (p * inside, inside)]
                force, area = comm.allreduce(np.array(sums))
                mean = force / area
        """
        from dolfinx_contact.results.surface_fields import contact_fields

        number = self.surfaces.index(self.discrete(surface))
        with self._evaluated(state) as (eq, evaluation):
            return contact_fields(eq, number, evaluation)

    def support_forces(
        self, surface: Contact | DiscreteSurface | str, *, state: State | None = None
    ) -> Array:
        """Return the reaction forces of Dirichlet data at the vertices of a surface. Collective.

        Args:
            surface: surface of this problem, or its name.
            state: state to evaluate; default: current values of the Functions.

        Returns:
            Forces on the body at the local vertices, shape (vertices, dim); 0 in free components.
        """
        s = self.discrete(surface)
        with self._evaluated(state) as (eq, evaluation):
            reactions = support_at_nodes(eq, evaluation)
        return forces_at_vertices(self.V, s.submesh, s.points.vertex_nodes, reactions)

    def discrete(self, surface: Contact | DiscreteSurface | str) -> DiscreteSurface:
        """Return the discretisation of a contact surface of this problem.

        Args:
            surface: description of a contact surface, its discretisation, or its name.

        Returns:
            Discrete surface with the contact points of this rank and their multiplier, a Function
            on the mesh ``submesh.mesh`` of the facets.

        Raises:
            ValueError: if the surface does not belong to the problem.
        """
        for s in self.surfaces:
            if surface is s or surface is s.description or surface == s.name:
                return s
        names = [s.name for s in self.surfaces]
        raise ValueError(f"a surface of this problem is needed, one of {names}; got {surface!r}")

    # -- solve -----------------------------------------------------------------------------------

    @collective("solve", _check_solve, local=("expected",))
    def solve(
        self,
        *,
        algorithm: str | Algorithm = "newton",
        monitor: Callable[[Step], None] | None = None,
        increments: int = _INCREMENTS,
        progress: bool | None = None,
        expected: Sequence[Statuses] = (),
    ) -> Result:
        """Solve the contact problem, starting from the Functions; overwrite them. Collective.

        Args:
            algorithm: ``"newton"`` (default), a semismooth Newton method with fallback strategies;
                or the name of a classical algorithm: ``"tresca"``, ``"uzawa"``, ``"penalty"``,
                ``"sor"``, ``"gauss-seidel"``, ``"projected-gradient"``, ``"lemke"``,
                ``"interior-point"``; or an algorithm with options, such as
                ``algorithms.GaussSeidel(relaxation=1.3)``. Classical algorithms have no fallback.
            monitor: read-only function called with every iterate, on every rank; default: none.
            increments: initial number of load increments in the incremental strategy.
            progress: whether rank 0 shows the progress on the standard error stream; default: only
                if the solve takes longer than a few seconds.
            expected: guesses of the statuses, most likely first; each has one array per surface.
                Newton's method is tried with each guess in its first step, before it is tried with
                the statuses of the Functions. Default: no guesses.

        Returns:
            Result with contact tables, resultants, residual histories and the KKT violation.

        Raises:
            ValueError: on every rank, if arguments or data are not admissible (for example a load
                that is not finite, a negative friction field, a clamped node inside the obstacle).
            ConvergenceError: if no strategy converges; the Functions keep their values.
        """
        trial = Trial(tuple(expected))
        result, _ = self.solve_step(
            trial, algorithm=algorithm, monitor=monitor, increments=increments, progress=progress
        )
        self.log_warnings(result.warnings)
        return result

    def solve_step(
        self,
        trial: Trial | None = None,
        *,
        algorithm: str | Algorithm = "newton",
        monitor: Callable[[Step], None] | None = None,
        increments: int = _INCREMENTS,
        progress: bool | None,
        shown: Shown | None = None,
    ) -> tuple[Result, Evaluation]:
        """Solve like `solve`, but log no warnings; also return the final evaluation. Collective.

        Args:
            trial: starting points of the solve, and whether all strategies are tried; default: all
                strategies, from the Functions.
            algorithm: algorithm of the solver, see `solve`.
            monitor: read-only function of the iterates, see `solve`.
            increments: initial number of load increments, see `solve`.
            progress: whether rank 0 shows the progress, see `solve`.
            shown: function of the solution returning the equations and the evaluation used for
                tables and indicators; default: equations and evaluation of the solution.
        """
        trial = trial or Trial()
        same_everywhere(self.comm, expected_statuses=len(trial.expected))
        fits = all([self._have(statuses) for statuses in trial.expected])
        require(self.comm, fits, "the expected statuses are not those of these contact points")
        line = SolveProgress(self.comm, progress, monitor)
        eq, linear = self.equations, self._linear
        with self._unknowns() as x0:
            try:
                if isinstance(algorithm, str):
                    x, attempts = solve(
                        eq, linear, x0, increments=increments, progress=line, trial=trial
                    )
                    if "petsc_options" in eq.warnings or any(a.iterations for a in attempts):
                        eq.warn("petsc_options", eq.options.unread())
                else:
                    from dolfinx_contact.algorithms.classical import solve_by

                    validate(eq, x0)
                    x, attempts = solve_by(algorithm, eq, x0, progress=line)
                with self.restored():
                    evaluation = attempts[-1].evaluation or eq.evaluate(x)
                    result = self.collect(x, attempts, evaluation, shown)
                x.destroy()
                line.end(result.iterations)
            finally:
                line.end()
        return result, evaluation

    def _have(self, statuses: Statuses) -> bool:
        """Return whether statuses fit the contact points and laws of this rank. Not collective."""
        return len(statuses) == len(self.surfaces) and all(
            np.shape(codes) == (s.points.number,) and np.isin(codes, s.law_at_points.codes).all()
            for s, codes in zip(self.surfaces, statuses, strict=True)
        )

    @collective("uniqueness", check_seconds)
    def uniqueness(self, *, state: State | None = None, proof_seconds: float = 0.0) -> Uniqueness:
        """Decide whether a solution is the only one for the current data. Collective.

        The following certificates are tried:

        1. Linear bodies with nodal or mixed contact, in 2D or, with friction, in 3D up to 128
           points: the body is condensed onto the contact points, and the pointwise certificate is
           evaluated, which always holds without friction (up to round-off). If it does not hold and
           a second solution is found quickly, the result contains it, and a warning is logged.
        2. Otherwise, up to a few hundred points: the weaker criterion of Renard
           (`analysis.renard_criterion`).
        3. If no certificate applies and no law is Coulomb friction: the theorems of `theory`.

        The verdict is ``"not proved"`` if the assumption of small sliding is violated
        (`Result.warnings`), because the solved problem then differs from the contact problem of
        the displaced bodies.

        Args:
            state: solution; default: current values of the Functions.
            proof_seconds: time limit in seconds for a proof by branch and bound if the pointwise
                certificate does not hold; default: 0. With a positive limit, Renard's criterion is
                computed for any number of points.

        Raises:
            ValueError: on every rank, if the state does not solve the problem with the current
                data, ``proof_seconds`` is negative or differs between ranks, or the data are not
                admissible.
        """
        from dolfinx_contact.analysis.body_proofs import uniqueness

        # without a state, use the law of this problem and not the law of the last step
        with self._shown(state) as problem, problem._unknowns() as x:
            eq = problem.equations
            validate(eq, x)
            evaluation = problem.evaluate()
            moves = state is not None and state.velocity is not None
            require_solution(problem, _IN_MOTION if moves else _NOT_SOLVED)
            answer = uniqueness(eq, x, evaluation, proof_seconds, problem.state_at)
            proved = answer.verdict == "proved"
            violation = small_sliding_violated(eq, evaluation) if proved else ""
            return Uniqueness("not proved", violation) if violation else answer

    def theory(self) -> Theory:
        """Return the theorems on existence and uniqueness that apply to the problem. Collective.

        Raises:
            ValueError: on every rank, if the data are not admissible.
        """
        from dolfinx_contact.analysis.body_proofs import theory_of

        with self._unknowns() as x:
            validate(self.equations, x)
            return theory_of(self.equations)

    def reduced(self) -> PointProblem:
        """Return the problem condensed onto its contact points, on every rank. Collective.

        The classical algorithms apply to the condensed problem:
        ``algorithms.GaussSeidel().run(problem.reduced())``.

        Raises:
            ValueError: on every rank, if the problem cannot be condensed: the body is not linear or
                not fixed by Dirichlet data, a method is ``"integral"``, or a law is not supported.
        """
        from dolfinx_contact.reduced.reduction import reduced_contact

        with self._unknowns() as x:
            validate(self.equations, x)
            return reduced_contact(self.equations, x)

    def collect(
        self,
        x: PETSc.Vec,
        attempts: Sequence[Attempt],
        evaluation: Evaluation,
        shown: Shown | None = None,
    ) -> Result:
        """Copy a solution to the Functions and return its result. Collective.

        Args:
            x: unknowns of the solution.
            attempts: attempts of the strategies that were tried; the last one converged.
            evaluation: evaluation of the solution.
            shown: function returning equations and evaluation for tables (`solve_step`).
        """
        for attempt in attempts:
            attempt.evaluation = None
        self.read(x, evaluation.statuses, self.equations.memory_after(evaluation))
        return collect(self.equations, evaluation, attempts, shown)

    def log_warnings(
        self, warnings: Mapping[str, str], logged: set[str] | None = None, where: str = ""
    ) -> None:
        """Log warnings on rank 0. Not collective.

        Args:
            warnings: texts of the warnings by name. Warnings about the data are skipped, because
                `ContactEquations.warn` has already logged them.
            logged: names of warnings that were already logged, for example in the same run. They
                are skipped, and all names of ``warnings`` are added to this set. Default: none.
            where: text that precedes each warning; default: none.
        """
        logged = set() if logged is None else logged
        for name, text in warnings.items():
            if self.comm.rank == 0 and name not in logged | self.equations.warnings.keys():
                logger.warning("%s: %s%s", name, where, text)
        logged.update(warnings)

    def destroy(self) -> None:
        """Free matrices and solvers immediately. Collective.

        Without this call, in a serial run they are freed together with the problem. On several
        ranks they are freed when the next problem on the same mesh is created, because PETSc
        destroys parallel objects collectively. Call `destroy` if a parallel run creates many
        problems, each with its own mesh.
        """
        self._linear.release()
        self.equations.bulk.destroy()
