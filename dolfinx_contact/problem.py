# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem H(x) = 0: bulk equilibrium and contact rows, assembled in PETSc.

The unknowns are the displacement and, surface by surface, the multipliers. Every row is in units of
force: the bulk rows by nature, the contact rows unscaled, and the Dirichlet rows multiplied by a
typical stiffness. Every unknown of the PETSc vectors is a length: multipliers are divided by a
typical stiffness per area. So neither norms of H nor the matrix depend on the user's units.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, la

from dolfinx_contact import _rigid
from dolfinx_contact._agreement import (
    described,
    described_condition,
    described_number,
    refuse_other_condition,
    refuse_other_mesh,
)
from dolfinx_contact._compat import assemble_block_matrix, create_block_matrix, merge_entity_maps
from dolfinx_contact._errors import everywhere, require, same_everywhere
from dolfinx_contact._options import OptionUse, check_options, in_database
from dolfinx_contact._petsc import logged, require_real, staged
from dolfinx_contact.augmentation import automatic_augmentation
from dolfinx_contact.balance import support_at_vertices
from dolfinx_contact.bulk import Bulk
from dolfinx_contact.cells import check_cells
from dolfinx_contact.checks import warn_of_obstacles
from dolfinx_contact.constraints import Constraints, check_overlap
from dolfinx_contact.laws import Status
from dolfinx_contact.prescribed import PrescribedDisplacement
from dolfinx_contact.surface import ContactSurface

if TYPE_CHECKING:
    from dolfinx_contact.result import Result
    from dolfinx_contact.solvers.linear import LinearSolver

__all__ = ["ContactProblem"]


class ContactProblem:
    """Static equilibrium of a body with unilateral contact and friction on some surfaces.

    Args:
        bulk: UFL energy (a functional of ``u``) or residual (linear in a test function of the space
            of ``u``) of the body, without contact terms.
        u: displacement.
        surfaces: contact surfaces of this body, each made with ``u``.
        bcs: Dirichlet conditions on the space of ``u`` or its components.
        r: augmentation parameter (stiffness per area), by default from the stiffness of the contact
            nodes. It changes the iterates, not the solution.
        petsc_options_prefix: of the SNES.
        petsc_options: options of the SNES under that prefix, named without it; the command line
            wins. Names that nothing reads are warned of after the first solve.

    Raises:
        ValueError: on every rank, if the arguments do not fit together, something is of another
            mesh, arguments differ between ranks, contact nodes are all clamped, a mesh coordinate
            is not finite, or a cell has no volume.
        RuntimeError: if PETSc has complex scalars.
    """

    @staged("ContactSetUp")
    def __init__(
        self,
        bulk: ufl.Form,
        u: fem.Function,
        surfaces: Sequence[ContactSurface],
        *,
        bcs: Sequence[fem.DirichletBC] = (),
        r: float | None = None,
        petsc_options_prefix: str = "contact_",
        petsc_options: Mapping[str, Any] | None = None,
    ):
        require_real()
        if not isinstance(u, fem.Function):
            raise ValueError(f"the displacement must be a Function, got {type(u).__name__}")
        self.u, self.V, self.comm = u, u.function_space, u.function_space.mesh.comm
        with everywhere(self.comm, "a contact problem"):
            self.surfaces, self.bcs = _lists(surfaces, bcs)
            _check(bulk, u, self.surfaces, self.bcs)
            if r is not None and not (_is_number(r) and np.isfinite(r) and r > 0):
                raise ValueError(f"the augmentation parameter r must be positive, got {r}")
            options = {} if petsc_options is None else petsc_options
            check_options(petsc_options_prefix, options)
        self.prefix, self.petsc_options = petsc_options_prefix, dict(options)
        #: Which options something has read.
        self.option_use = OptionUse(self.prefix)
        same_everywhere(
            self.comm,
            contact_surfaces=[s.name for s in self.surfaces],
            Dirichlet_data=[described_condition(bc) for bc in self.bcs],
            bulk=described(bulk, self.V.mesh),
            r=described_number(r),
            petsc_options_prefix=self.prefix,
            petsc_options=sorted((k, described_number(v)) for k, v in options.items()),
            PETSc_database=sorted(in_database(self.prefix).items()),
        )
        finite = bool(np.isfinite(self.V.mesh.geometry.x).all())
        require(self.comm, finite, "the mesh has a coordinate that is not finite")
        check_cells(self.V.mesh)

        check_overlap(self.surfaces)
        self.bulk = Bulk(bulk, u)
        self.energy = self.bulk.energy
        self.energy_form = None if self.energy is None else fem.form(self.energy)
        self._compile()
        self.constraints = Constraints(self.V, self.surfaces, self.bcs)
        self.prescribed = PrescribedDisplacement(self.V, self.constraints)
        self._all_bcs = [*self.prescribed.conditions, *self.constraints.multiplier_bcs]
        self._matrix: PETSc.Mat | None = None
        self._linear_solver: LinearSolver | None = None
        spaces = [f.function_space for f in self.fields]
        self._scratch = [la.vector(W.dofmap.index_map, W.dofmap.index_map_bs) for W in spaces]
        self.owned_sizes = [W.dofmap.index_map.size_local * W.dofmap.index_map_bs for W in spaces]
        test_spaces = fem.extract_function_spaces([row[0] for row in self._R])
        self._bcs_by_block = fem.bcs_by_block(test_spaces, self._all_bcs)
        if len(fem.bcs_by_block(test_spaces, self.bcs)[0]) != len(self.bcs):
            raise ValueError("a Dirichlet condition is not on the space of u or a component of it")
        #: Raw residual of the displacement rows at the last evaluation (local): reactions on
        #: Dirichlet dofs.
        self.reactions: npt.NDArray[np.float64] = np.zeros(self.owned_sizes[0])
        self.hold_status: bool = False
        x = self.V.mesh.geometry.x
        low = self.comm.allreduce(x.min(axis=0, initial=np.inf), op=np.minimum)
        high = self.comm.allreduce(x.max(axis=0, initial=-np.inf), op=np.maximum)
        #: Diagonal of the bounding box of the body.
        self.body_size: float = float(np.linalg.norm(high - low))
        self._mesh_mark = zlib.crc32(np.ascontiguousarray(x))
        self.forced_r: float | None = r
        self._scale(r)
        warn_of_obstacles(self)

    # -- forms -----------------------------------------------------------------------------------

    def _compile(self) -> None:
        """Forms of every block. Bulk and contact terms stay apart: each has measures of its own."""
        v, maps = ufl.TestFunction(self.V), merge_entity_maps([s.submesh for s in self.surfaces])
        domain = self.V.mesh
        self.fields: list[fem.Function] = [self.u]
        self.fields += [f for s in self.surfaces for f in s.unknowns]
        n = len(self.fields)
        #: The PETSc unknowns are the fields over these: all of them lengths.
        self._units = [fem.Constant(domain, 1.0) for _ in self.fields]
        rows: list[list[ufl.Form]] = [[self.bulk.residual]] + [[] for _ in range(n - 1)]
        self._J: list[list[fem.Form | None]] = [[None] * n for _ in range(n)]
        self._J[0][0] = self.bulk.jacobian_form
        start = 1
        for s in self.surfaces:
            indices = range(start, start + len(s.unknowns))
            start += len(s.unknowns)
            work = s.displacement_row(v)
            rows[0].append(work)
            self._J[0][indices[0]] = self._derivative(work, indices[0], maps)
            for i, terms in zip(indices, s.rows(), strict=True):
                for term, depends in terms:
                    rows[i].append(term)
                    for j in (j for j in (0, *indices) if _among(self.fields[j], depends)):
                        self._J[i][j] = self._derivative(term, j, maps)
        #: UFL residuals of every block, bulk and contact terms apart.
        self.rows, self.entity_maps = rows, maps
        #: Residuals of the contact terms alone, and of all terms.
        self._contact = [
            [fem.form(f, entity_maps=maps) for f in row] for row in (rows[0][1:], *rows[1:])
        ]
        self._R = [[self.bulk.residual_form, *self._contact[0]], *self._contact[1:]]
        #: Derivatives of the contact terms alone.
        self.contact_jacobian = [[None, *self._J[0][1:]], *self._J[1:]]

    def _derivative(self, row: Any, j: int, maps: Any) -> fem.Form:
        direction = self._units[j] * ufl.TrialFunction(self.fields[j].function_space)
        return fem.form(ufl.derivative(row, self.fields[j], direction), entity_maps=maps)

    def _scale(self, r: float | None) -> None:
        """Typical stiffness of Dirichlet rows, r of the surfaces, free rigid motions."""
        K = self.bulk.stiffness()
        self.stiffness_scale, self.automatic_r = automatic_augmentation(
            K, self.V, self.surfaces, self.body_size
        )
        for s, automatic in zip(self.surfaces, self.automatic_r, strict=True):
            s.set_augmentation(automatic if r is None else np.full_like(automatic, r))
            self._unit_constant(s.multiplier).value = self.stiffness_scale / s.mean_vertex_area
        self.free_motions = _rigid.free_motions(K, self.V, self.constraints.fixed)
        if not self.bulk.linear:
            self.bulk.destroy()

    # -- vectors ---------------------------------------------------------------------------------

    @property
    def matrix(self) -> PETSc.Mat:
        """The assembled Jacobian of H, made when it is first asked for. Collective."""
        if self._matrix is None:
            self._matrix = create_block_matrix(self._J)
        return self._matrix

    def create_vector(self) -> PETSc.Vec:
        """A vector of all unknowns, rank by rank displacement then multipliers."""
        return PETSc.Vec().createMPI((sum(self.owned_sizes), None), comm=self.comm)

    def read(self, x: PETSc.Vec) -> None:
        """Put the unknowns ``x`` into the Functions."""
        array, start = x.array_r, 0
        for f, unit, n in zip(self.fields, self._units, self.owned_sizes, strict=True):
            f.x.array[:n] = float(unit.value) * array[start : start + n]
            f.x.scatter_forward()
            start += n

    def write(self, x: PETSc.Vec) -> None:
        """Put the Functions into the unknowns ``x``."""
        parts = zip(self._scaled_fields(), self.owned_sizes, strict=True)
        x.array[:] = np.concatenate([values[:n] for values, n in parts])

    def _scaled_fields(self) -> list[npt.NDArray[np.float64]]:
        """Local values of the unknowns in the units of the PETSc vectors, ghosts included."""
        pairs = zip(self.fields, self._units, strict=True)
        return [f.x.array / float(unit.value) for f, unit in pairs]

    def unit_of(self, f: fem.Function) -> float:
        """What the PETSc unknowns of a field are multiplied by."""
        return float(self._unit_constant(f).value)

    def _unit_constant(self, f: fem.Function) -> fem.Constant:
        return next(unit for g, unit in zip(self.fields, self._units, strict=True) if g is f)

    def blocks(self, x: PETSc.Vec) -> list[npt.NDArray[np.float64]]:
        """Local parts of ``x``, one array per field."""
        return np.split(x.array_r.copy(), np.cumsum(self.owned_sizes)[:-1])

    # -- H and its derivative --------------------------------------------------------------------

    @property
    def statuses(self) -> list[Status]:
        """Status of every surface on this rank; a copy."""
        return [s.status for s in self.surfaces]

    @statuses.setter
    def statuses(self, statuses: Sequence[Status]) -> None:
        for s, status in zip(self.surfaces, statuses, strict=True):
            s.status = status

    @contextmanager
    def status_held(self, hold: bool = True) -> Iterator[None]:
        """Keep the status as it is while the context lasts: H is then one smooth piece."""
        held, self.hold_status = self.hold_status, hold
        try:
            yield
        finally:
            self.hold_status = held

    def update_status(self) -> None:
        """Recompute the status from the Functions, unless it is held."""
        if not self.hold_status:
            with logged("ContactStatus"):
                for s in self.surfaces:
                    s.status = s.evaluate_status()

    def reach(self, s: ContactSurface) -> float:
        """Gaps up to which points of ``s`` are expected to close, from an open state. Collective.

        Half the motion that Dirichlet data prescribe, where the contact of Hertz ends.
        """
        u = self.u.x.array.reshape(-1, s.dim)
        return 0.5 * self.constraints.approach(s, u)

    def residual(self, x: PETSc.Vec, b: PETSc.Vec) -> None:
        """H(x) into ``b``; the Functions and the status follow ``x``. Collective."""
        self.read(x)
        self.update_status()
        values, parts = self._scaled_fields(), []
        fixed = self.constraints.fixed.reshape(-1)
        lifted = np.where(fixed, self.prescribed.update().reshape(-1), values[0])
        # A linear body takes its Dirichlet data in the product, and needs no assembly.
        body = self.bulk.affine_residual(lifted)
        R, J = (self._R, self._J) if body is None else (self._contact, self.contact_jacobian)
        for i, (forms, c) in enumerate(zip(R, self._scratch, strict=True)):
            c.array[:] = 0.0
            for form in forms:
                fem.assemble_vector(c.array, form)
            add = body if i == 0 else None
            if i == 0:
                self.reactions = self._accumulated(c) + (0.0 if add is None else add)
            parts.append(self._constrained(i, c, values, J[i], add))
        b.array[:] = np.concatenate(parts)

    def _constrained(
        self,
        i: int,
        c: la.Vector,
        at: list[npt.NDArray[np.float64]],
        jacobian: Sequence[fem.Form | None],
        add: npt.NDArray[np.float64] | None = None,
    ) -> npt.NDArray[np.float64]:
        """Owned part of block ``i`` of ``c`` once Dirichlet data are lifted and their rows set."""
        fem.apply_lifting(c.array, jacobian, self._bcs_by_block, x0=at, alpha=-1.0)
        c.scatter_reverse(la.InsertMode.add)
        if add is not None:
            c.array[: self.owned_sizes[i]] += add
        for bc in self._bcs_by_block[i]:
            bc.set(c.array, at[i], -self.stiffness_scale)
        return np.asarray(c.array[: self.owned_sizes[i]])

    def assemble_rates(
        self,
        rates: Sequence[Sequence[fem.Form | None]],
        dirichlet_rates: npt.NDArray[np.float64],
        c: PETSc.Vec,
    ) -> None:
        """The derivative of H by a parameter into ``c``, at the Functions as they are. Collective.

        Args:
            rates: derivatives of `rows`, None where a row does not depend on the parameter.
            dirichlet_rates: derivatives of the Dirichlet values on the local displacement dofs. On
                the free rows they act through the stiffness, as the values do in `residual`.
            c: receives the derivative.
        """
        at = [values.copy() for values in self._scaled_fields()]
        fixed = self.constraints.fixed.reshape(-1)
        prescribed = self.prescribed.update().reshape(-1)
        at[0] = np.where(fixed, prescribed - dirichlet_rates, at[0])
        body = self.bulk.product(np.where(fixed, dirichlet_rates, 0.0))
        J = self._J if body is None else self.contact_jacobian
        parts = []
        for i, (forms, v) in enumerate(zip(rates, self._scratch, strict=True)):
            v.array[:] = 0.0
            for form in forms:
                if form is not None:
                    fem.assemble_vector(v.array, form)
            parts.append(self._constrained(i, v, at, J[i], body if i == 0 else None))
        c.array[:] = np.concatenate(parts)

    @staticmethod
    def _accumulated(c: la.Vector) -> npt.NDArray[np.float64]:
        """Owned entries of ``c`` with the contributions of other ranks; ``c`` stays as it is."""
        kept = c.array.copy()
        c.scatter_reverse(la.InsertMode.add)
        n = c.index_map.size_local * c.block_size
        summed = c.array[:n].copy()
        c.array[:] = kept
        return summed

    def jacobian(self, x: PETSc.Vec, A: PETSc.Mat, *, keep_status: bool = False) -> None:
        """Element of the generalised Jacobian of H at ``x`` into ``A``. Collective."""
        self.read(x)
        if not keep_status:
            self.update_status()
        self.assemble_jacobian(A)

    def assemble_jacobian(self, A: PETSc.Mat) -> None:
        """The Jacobian at the Functions and the status as they are into ``A``. Collective."""
        assemble_block_matrix(A, self._J, self._all_bcs, self.stiffness_scale)

    def require_same_mesh(self) -> None:
        """Raise ``ValueError`` if the mesh has moved since the problem was made. Collective."""
        same = zlib.crc32(np.ascontiguousarray(self.V.mesh.geometry.x)) == self._mesh_mark
        message = "the mesh has moved since the problem was made; make surfaces and problem anew"
        require(self.comm, same, message)

    def given_numbers(self) -> list[list[float]]:
        """Values of the Constants in the forms, which are to be the same on every rank."""
        forms = [form for row in self.rows for form in row]
        return [[float(v) for v in np.ravel(c.value)] for f in forms for c in f.constants()]

    @property
    def global_sizes(self) -> list[int]:
        """Numbers of unknowns on all ranks, field by field."""
        spaces = [f.function_space for f in self.fields]
        return [int(W.dofmap.index_map.size_global * W.dofmap.index_map_bs) for W in spaces]

    def support_forces(self, s: ContactSurface) -> npt.NDArray[np.float64]:
        """Reactions of Dirichlet data on the body at the local vertices of ``s``. Collective."""
        return support_at_vertices(self, s)

    @contextmanager
    def automatic_augmentation(self) -> Iterator[None]:
        """Use the automatic r while the context lasts."""
        forced = [s.r.x.array.copy() for s in self.surfaces]
        for s, r in zip(self.surfaces, self.automatic_r, strict=True):
            s.set_augmentation(r)
        try:
            yield
        finally:
            for s, r in zip(self.surfaces, forced, strict=True):
                s.set_augmentation(r)

    def round_off_force(self, displacement: float) -> float:
        """Nodal forces that count as round-off at a displacement of this size.

        Where a body moves without resistance all forces are the round-off of stiffness times
        motion, and nothing else tells how small a force has to be. Stresses of a body that is not
        linear are differences of moduli, also where it has no load: to 1e-15 of these.
        """
        strain = 0.0 if self.bulk.linear else 1e-5 * self.body_size
        return self.stiffness_scale * max(1e-4 * displacement, strain)

    def loose_motions(self) -> str:
        """Rigid motions held neither by Dirichlet data nor by the contact status; "" if none."""
        if len(self.free_motions) == 0:
            return ""
        gram = np.zeros((len(self.free_motions),) * 2)
        for s in self.surfaces:
            gram += s.held_gram(self.free_motions)
        loose = _rigid.combine(self.comm.allreduce(gram), self.free_motions)
        return _rigid.describe(loose, self.V) if len(loose) else ""

    # -- solve -----------------------------------------------------------------------------------

    def solve(self, **kwargs: Any) -> Result:
        """Solve from the present values of the Functions; see `solvers.ladder.solve`."""
        from dolfinx_contact.solvers.ladder import solve

        return solve(self, **kwargs)

    @property
    def linear_solver(self) -> LinearSolver:
        """What solves for Newton steps; it lasts as long as the problem. Collective."""
        if self._linear_solver is None:
            from dolfinx_contact.solvers.linear import create_linear_solver

            self._linear_solver = create_linear_solver(self)
        return self._linear_solver

    @linear_solver.setter
    def linear_solver(self, solver: LinearSolver) -> None:
        if self._linear_solver is not None:
            self._linear_solver.destroy()
        self._linear_solver = solver

    def destroy(self) -> None:
        """Free matrices and solvers."""
        self.bulk.destroy()
        for thing in (self._matrix, self._linear_solver):
            if thing is not None:
                thing.destroy()


def _lists(surfaces: Any, bcs: Any) -> tuple[list[ContactSurface], list[fem.DirichletBC]]:
    """Surfaces and conditions as lists of their kinds, or ``ValueError``."""
    if isinstance(surfaces, ContactSurface) or isinstance(bcs, fem.DirichletBC):
        raise ValueError("surfaces and bcs must be lists")
    try:
        surfaces, bcs = list(surfaces), list(bcs)
    except TypeError:
        raise ValueError("surfaces and bcs must be lists") from None
    if not all(isinstance(s, ContactSurface) for s in surfaces):
        raise ValueError("surfaces must be a list of ContactSurfaces")
    if not all(isinstance(bc, fem.DirichletBC) for bc in bcs):
        raise ValueError("bcs must be a list of Dirichlet conditions")
    return surfaces, bcs


def _check(
    bulk: Any, u: fem.Function, surfaces: list[ContactSurface], bcs: list[fem.DirichletBC]
) -> None:
    """Raise ``ValueError`` if the arguments of a problem do not fit together. Not collective."""
    domain = u.function_space.mesh
    if not surfaces:
        raise ValueError("a contact problem needs at least one contact surface")
    if any(s.u is not u for s in surfaces):
        raise ValueError("every contact surface must be made with the displacement u")
    names = [s.name for s in surfaces]
    if len(set(names)) < len(names):
        raise ValueError(f"contact surfaces need different names, got {names}")
    if not isinstance(bulk, ufl.Form):
        raise ValueError(f"the bulk must be a UFL form, got {type(bulk).__name__}")
    refuse_other_mesh(bulk, domain, "the bulk")
    for bc in bcs:
        refuse_other_condition(bc, domain)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _among(f: fem.Function, functions: Sequence[fem.Function]) -> bool:
    return any(f is g for g in functions)
