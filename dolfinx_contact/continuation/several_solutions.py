# SPDX-License-Identifier: LGPL-3.0-or-later
"""Search for several solutions at one gamma, on the same or on different branches.

1. If the pieces (choices of statuses) are affine cones, a solution at gamma is a ray of the cones
   under the total load. `cone_rays.py` computes the rays by enumeration, which proves completeness,
   or by unfolding.
2. If there are too many pieces, or affine pieces that are not cones, the system may provide a proof
   (`System.prove`).
3. Otherwise computed solutions x_k are deflated (Farrell, Birkisson and Funke, SIAM J. Sci. Comput.
   37, 2015): Newton's method is applied to m(x) H(x) with

       m(x) = prod_k (1 / |x - x_k|^2 + 1),

   which does not vanish at the x_k. The Newton step dx of H is multiplied by 1 / (1 - grad log m .
   dx), so that only its length and sign change. The result depends on the distance at which a
   solution repels the iteration and on the first step. Therefore several distances are tried, and
   also first steps with the same status at all points. The statuses in H are recomputed from x in
   each iteration; this semismooth method may miss solutions.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._validate import count, listed, nonnegative, number, positive
from dolfinx_contact.continuation.affine import largest
from dolfinx_contact.continuation.arguments import (
    check_states,
    check_system,
)
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.cone_rays import (
    MOST_PIECES,
    outgoing,
)
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.system import (
    Condensed,
    Piece,
    Proof,
    ResidualScales,
    System,
)

__all__ = ["Continuum", "Solution", "Solutions", "find_solutions"]

logger = logging.getLogger(__name__)

_ROUND_OFF = 1e-14  # distance of equal solutions, relative to the largest guess or solution


@dataclass(frozen=True)
class Solution:
    """Solution at one gamma.

    Attributes:
        x: vector of unknowns.
        piece: statuses of all points.
        gamma: parameter.
    """

    x: PETSc.Vec = field(repr=False)
    piece: Piece
    gamma: float


@dataclass(frozen=True)
class Continuum:
    """Set of infinitely many solutions with the same statuses.

    Attributes:
        piece: statuses of all points.
        ends: solutions that span the set, two for a segment. An unbounded set has fewer ends.
    """

    piece: Piece
    ends: tuple[Solution, ...]


@dataclass(frozen=True)
class Solutions:
    """Solutions at one gamma.

    Attributes:
        gamma: parameter.
        found: solutions at gamma; those passed as ``known`` come first.
        complete: True if it is proved that there are no other solutions.
        method: description of the search.
        continua: sets of infinitely many solutions (by enumeration); `found` contains their ends.
        proof: proof provided by the system; None without a proof, as after an enumeration. In 3D
            the forces in its states are scaled; the tables of the solutions contain the unscaled
            forces.
    """

    gamma: float
    found: tuple[Solution, ...]
    complete: bool
    method: str
    continua: tuple[Continuum, ...] = ()
    proof: Proof | None = None

    def __str__(self) -> str:
        number = len(self.found)
        many = f"{number} solution{'' if number == 1 else 's'} at gamma = {self.gamma:.6g}"
        ends = len(self.continua)
        continua = f"{ends} continu{'um' if ends == 1 else 'a'}"
        more = f", among them the ends of {continua}" if ends else ""
        known = "proved to be all there are" if self.complete else "others are not excluded"
        return f"{many}{more}; {known}: {self.method}"

    def points(self, system: System, found: Sequence[Solution] | None = None) -> list[BranchPoint]:
        """Return the solutions as branch points without tangents, for plots and tables. Collective.

        Args:
            system: system of the solutions.
            found: selected solutions; default: all.
        """
        layout = Layout(system)
        return [
            BranchPoint(layout.joined(s.x, self.gamma), layout.last_unit(0.0), s.piece, self.gamma)
            for s in (self.found if found is None else found)
        ]


def _check(a: Arguments) -> None:
    check_system(a.system)
    a.gamma = number(a.gamma, "gamma")
    if any(isinstance(states, PETSc.Vec) for states in (a.guesses, a.known)):
        raise ValueError("guesses and known must be lists of states")
    for name in ("guesses", "known", "lengths"):
        setattr(a, name, listed(getattr(a, name), name))
    if not a.guesses:
        raise ValueError("at least one guess is needed")
    for length in a.lengths:
        positive(length, "lengths")
    positive(a.tolerance, "tolerance")
    count(a.max_iterations, "max_iterations")
    nonnegative(a.proof_seconds, "proof_seconds")


@collective("find_solutions", _check, local=("guesses", "known"))
def find_solutions(
    system: System,
    guesses: Sequence[PETSc.Vec],
    gamma: float,
    *,
    known: Sequence[PETSc.Vec] = (),
    lengths: Sequence[float] = (1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64),
    max_iterations: int = 60,
    tolerance: float = 1e-10,
    deflation: bool = False,
    proof_seconds: float = 60.0,
) -> Solutions:
    """Compute several solutions at ``gamma``, and all solutions where possible. Collective.

    The data of the system (Functions, statuses and gamma of a contact problem) are restored. If the
    system is not affine for fixed statuses, the first solution is computed from a guess by the
    solver of the system (`ContactProblem.solve` for a contact problem). No proof is given if the
    model is not valid for a solution, for example if small sliding is assumed between bodies or on
    curved obstacles and the sliding is not small.

    Args:
        system: piecewise smooth system H(x, gamma) = 0.
        guesses: initial states, at least one. Newton's method starts from these states and from
            states next to the solutions, until a round of starts yields no new solution.
        gamma: parameter.
        known: known solutions, which repel the deflated search; default: none.
        lengths: distances within which a known solution repels the iteration, relative to its
            distance from the guess. All values are tried.
        max_iterations: largest number of iterations of a run of Newton's method.
        tolerance: relative residual of a solution.
        deflation: True to use deflation even if the system is affine for fixed statuses.
        proof_seconds: time limit of the proof of completeness, in seconds; 0 for no proof. The
            proof is tried if there are too many combinations of statuses to enumerate, or if
            friction has a prescribed bound.

    Raises:
        ValueError: on every rank, if an argument is invalid or differs between ranks, or the loads
            or the stiffness are not finite.
    """
    check_states(system, guesses, "a guess")
    check_states(system, known, "a known solution")
    system.check_parameter([gamma])
    proved: Solutions | None = None
    if not deflation:
        search = _of_cones if system.is_piecewise_affine else _of_proof
        with system.restored(always=True):
            proved = search(system, guesses[0], gamma, proof_seconds)
    if proved is not None and (system.is_piecewise_affine or proved.complete):
        return _validated(system, proved)
    with (
        system.restored(always=True),
        _Deflated(system, gamma, max_iterations, tolerance) as deflated,
    ):
        states, tried = deflated.search(guesses, known, proved, lengths)
        found = tuple(Solution(x, system.piece_at(x, gamma), gamma) for x in states)
    method = tried if found else f"not found: {tried}"
    if proved is not None:
        method = f"{method}, {proved.method}"
    elif proof_seconds > 0 and not deflation:
        obstacle = system.why_not_provable()
        method = f"{method}; nothing is proved: {obstacle}" if obstacle else method
    proof = None if proved is None else proved.proof
    return _validated(system, Solutions(gamma, found, False, method, proof=proof))


def _validated(system: System, solutions: Solutions) -> Solutions:
    """Remove the proof if the model is not valid for one of the solutions. Collective."""
    if not solutions.complete and solutions.proof is None:
        return solutions
    with system.restored(always=True):
        warnings = (system.validity_warning(s.x, solutions.gamma, s.piece) for s in solutions.found)
        warning = next((w for w in warnings if w), "")
    if not warning:
        return solutions
    method = f"{solutions.method}; nothing is proved: {warning}"
    return replace(solutions, complete=False, method=method, proof=None)


def _of_proof(system: System, x: PETSc.Vec, gamma: float, seconds: float) -> Solutions | None:
    """Return the solutions that a proof of the system provides, or None. Collective."""
    condensed = system.condensed(x, gamma, conic=False) if seconds > 0 else None
    if condensed is None:
        return None
    condensed.require_finite()
    proof = system.prove(condensed, gamma, seconds)
    if proof is None:
        return None
    found = []
    for state in proof.solutions:
        y = x.copy()
        condensed.expand(state.state, gamma, y)
        own = condensed.piece(state.codes)
        piece = system.piece_at(y, gamma) if condensed.guided else own
        found.append(Solution(y, piece, gamma))
    return Solutions(gamma, tuple(found), proof.verdict == "complete", proof.method, proof=proof)


def _of_cones(system: System, x: PETSc.Vec, gamma: float, seconds: float) -> Solutions | None:
    """Compute the solutions as rays of the cones of the points under the total load. Collective.

    Return None if the system cannot be condensed onto its points.
    """
    condensed = system.condensed(x, gamma)
    if condensed is None:
        return None
    affine = condensed.system
    affine.require_finite()
    proved = None
    if math.prod(map(int, affine.allowed.sum(axis=1))) > MOST_PIECES:
        proved = _of_proof(system, x, gamma, seconds)
    if proved is not None and proved.complete:
        return proved
    # in units in which the load is 1
    whole = affine.load + gamma * affine.rate
    unit = largest(whole) or 1.0
    rays = outgoing(replace(affine, load=np.zeros_like(whole), rate=np.asarray(whole / unit)))
    at: dict[int, Solution] = {}
    for ray in rays.rays:
        if ray.rate == 1:
            y = x.copy()
            condensed.expand(unit * ray.direction, gamma, y)
            at[id(ray)] = Solution(y, condensed.piece(ray.codes), gamma)
    found = list(at.values())
    for s in () if proved is None else proved.found:
        if not any(_coincide(condensed, s, other) for other in at.values()):
            found.append(s)
    spans = [
        (codes, tuple(at[id(r)] for r in ends if id(r) in at)) for codes, ends in rays.continua
    ]
    continua = tuple(Continuum(condensed.piece(codes), ends) for codes, ends in spans if ends)
    complete = rays.complete
    if complete and not found and condensed.always_solvable:
        complete = False
        if x.comm.rank == 0:
            logger.error(
                "gamma = %.10g: a solution exists, since the stiffness at the contact points is "
                "positive definite, but none was found by %s, due to round-off or overflow",
                gamma,
                rays.method,
            )
    method = rays.method if proved is None else f"{rays.method}, {proved.method}"
    proof = None if proved is None else proved.proof
    return Solutions(gamma, tuple(found), complete, method, continua, proof)


def _coincide(condensed: Condensed, a: Solution, b: Solution) -> bool:
    """Return True if two solutions coincide at the condensed points. Collective."""
    v = condensed.contract(a.x)
    w = condensed.contract(b.x)
    return largest(v - w) <= 1e-7 * max(largest(v), 1e-300)


class _Deflated:
    """Newton's method repelled by known solutions (deflation), at fixed gamma. Collective."""

    def __init__(self, system: System, gamma: float, max_iterations: int, tolerance: float):
        self.system = system
        self.gamma = gamma
        self.max_iterations = max_iterations
        self.tolerance = tolerance
        self.bordered = Bordered(system, gamma_scale=1.0, prefix="deflation_")
        b = self.bordered
        self._y, self._dy, self._rhs = (b.vector() for _ in range(3))
        self._row = b.last_unit()
        self._h, self._w = (system.create_vector() for _ in range(2))
        self._scales: ResidualScales = ()  # scales of the residuals of all iterates
        self._size = 0.0  # largest norm of a guess

    def __enter__(self) -> _Deflated:
        return self

    def __exit__(self, *_: object) -> None:
        self.bordered.destroy()

    def search(
        self,
        guesses: Sequence[PETSc.Vec],
        known: Sequence[PETSc.Vec],
        proved: Solutions | None,
        lengths: Sequence[float],
    ) -> tuple[list[PETSc.Vec], str]:
        """Return all solutions, starting with the known ones, and a description of the search."""
        self._size = max(guess.norm() for guess in guesses)
        solutions = [x.copy() for x in known]
        for s in () if proved is None else proved.found:
            if not self._is_known(s.x, solutions):
                solutions.append(s.x)
        first, tried = self._first(guesses, solutions)
        solutions += [] if first is None else [first]
        runs = 0
        fruitful = True
        while fruitful:
            fruitful = False
            starts = [(guess, piece) for guess in guesses for piece in self._pieces(guess)]
            starts += [(guess, None) for guess in self._beside(solutions, guesses[0])]
            for (guess, piece), length in itertools.product(starts, lengths):
                runs += 1
                x = self._solve(guess, piece, solutions, length)
                if x is not None:
                    solutions.append(x)
                    fruitful = True
        return solutions, f"{tried}deflation, {runs} runs of Newton's method"

    def _first(
        self, guesses: Sequence[PETSc.Vec], known: Sequence[PETSc.Vec]
    ) -> tuple[PETSc.Vec | None, str]:
        """Return a new solution computed by the system's solver, or None, and a description."""
        tried = ""
        for guess in guesses:
            x, how = self.system.solution_from(guess, self.gamma)
            if x is None:
                tried = tried or (f"{how}; " if how else "")
                continue
            exact = self._solve(x, None, [], 1.0)
            if exact is not None:
                x = exact
            return (None if self._is_known(x, known) else x), f"{how}, "
        return None, tried

    def _beside(self, solutions: Sequence[PETSc.Vec], guess: PETSc.Vec) -> Iterator[PETSc.Vec]:
        """Yield two states next to each solution, on the line from ``guess`` to the solution."""
        for x in solutions:
            for part in (-0.1, 0.1):
                yield self.bordered.moved(x, part, x - guess)

    def _pieces(self, guess: PETSc.Vec) -> list[Piece | None]:
        """Return choices of statuses for the first step: None (from the state) and uniform ones."""
        own = self.system.piece_at(guess, self.gamma)
        free = [int(p) for p in np.unique(self.system.events(guess, self.gamma, own).point)]
        statuses = {p: {int(s) for s in self.system.statuses(p)} for p in free}
        everywhere = self.bordered.comm.allgather(set().union(*statuses.values()))
        uniform = []
        for status in sorted(set().union(*everywhere)):
            points = np.array([p for p in free if status in statuses[p]], dtype=np.int32)
            uniform.append(own.with_codes(points, [status] * len(points)))
        return [None, *uniform]

    def _solve(
        self, guess: PETSc.Vec, piece: Piece | None, known: Sequence[PETSc.Vec], length: float
    ) -> PETSc.Vec | None:
        """Run Newton's method; return a solution that is not among ``known``, or None.

        Args:
            guess: initial state.
            piece: fixed statuses in the first step, which is not deflated; None: from the state.
            known: known solutions, which are deflated.
            length: distance at which the deflated solutions repel the iteration, relative to their
                distance from the guess.
        """
        b = self.bordered
        x = guess.copy()
        squares = [length**2 * self._product(guess, other)[0] or 1.0 for other in known]
        for _ in range(self.max_iterations):
            error, self._scales = self.system.measure(x, self.gamma, self._h, piece, self._scales)
            if not np.isfinite(error):
                break
            near = error <= self.tolerance and piece is None
            if near and self._is_known(x, known):
                break
            b.join(x, self.gamma, self._y)
            b.solver.assemble(self._y, self._row, piece)
            b.join(self._h, 0.0, self._rhs)
            self._rhs.scale(-1.0)
            if not b.solver.solve(self._rhs, self._dy):
                break
            dx = b.split(self._dy)[0].copy()
            repelled = piece is None and not near
            x.axpy(self._factor(x, dx, known, squares) if repelled else 1.0, dx)
            # the residual is relative to the largest so far, hence the test of the step
            done = near and dx.norm() <= 1e-8 * x.norm()
            if done:
                return x
            piece = None
        return None

    def _factor(
        self, x: PETSc.Vec, dx: PETSc.Vec, known: Sequence[PETSc.Vec], squares: Sequence[float]
    ) -> float:
        """Return the factor 1 / (1 - grad log m . dx) by which the Newton step dx is multiplied.

        Its magnitude is limited to 1000. The deflation factor m(x) is defined in the module;
        ``squares`` are the squared distances within which the known solutions repel the iteration.
        """
        slope = 0.0
        for other, square in zip(known, squares, strict=True):
            # log(1/d + 1) with d = |x - x_k|^2 changes by -2 (x - x_k) . dx / (d (1 + d))
            distance, along = self._product(x, other, dx)
            slope -= 2 * along / (max(distance, 1e-300) * (1 + distance / square))
        factor = 1.0 / (1.0 - slope) if slope != 1 else 1.0
        return float(np.clip(factor, -1e3, 1e3))

    def _product(
        self, x: PETSc.Vec, other: PETSc.Vec, dx: PETSc.Vec | None = None
    ) -> tuple[float, float]:
        """Return |d|^2 and d . dx for the difference d of two states, in the metric of the system.

        Args:
            x: iterate.
            other: solution to be subtracted from it.
            dx: Newton step; default: none, with the product 0.
        """
        away = x - other
        self.system.metric(away, self._w)
        return float(self._w.dot(away)), 0.0 if dx is None else float(self._w.dot(dx))

    def _is_known(self, x: PETSc.Vec, known: Sequence[PETSc.Vec]) -> bool:
        """Return True if a state agrees with one of the known solutions."""
        sizes = [other.norm() for other in known]
        # The solution 0 has no size: its round-off is relative to the guesses.
        least = _ROUND_OFF * max([self._size, *sizes])
        return any(
            (x - other).norm() <= max(1e-6 * max(x.norm(), size), least)
            for other, size in zip(known, sizes, strict=True)
        )
