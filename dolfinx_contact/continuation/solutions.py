# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Many solutions at one gamma, connected with each other or not.

Where the pieces are affine, a solution at gamma is a ray of the cones under the whole load, so that
`rays.py` finds them, by enumeration (and then there are no others) or by unfolding. Where there are
too many pieces to be enumerated, or affine ones that are no cones, the system may have a proof of
its own (`System.prove`); if it comes to an end there are no others. Else solutions
that are known are deflated (Farrell, Birkisson and Funke, SIAM J. Sci. Comput. 37, 2015): Newton's
method is applied to m(x) H(x) with

    m(x) = prod_k (1 / |x - x_k|^2 + 1),

which does not vanish at the x_k any more. Its step is that for H times 1 / (1 - grad log m . dx):
nothing but the length and the sense of a step changes. How far a solution repels decides on where
the steps lead; several parts of its distance from the guess are tried, and first steps on pieces in
which all points have one status. H is taken with the status that x determines: the method is
semismooth, and may well find nothing where there is something.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._collective import Arguments, collective
from dolfinx_contact._validate import count, listed, nonnegative, positive
from dolfinx_contact.continuation.arguments import (
    check_states,
    check_system,
    check_vectors,
    checked_gamma,
)
from dolfinx_contact.continuation.bordered import Bordered
from dolfinx_contact.continuation.branch import BranchPoint
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.continuation.rays import (
    MOST_PIECES,
    AffineRay,
    outgoing,
)
from dolfinx_contact.continuation.system import (
    Condensed,
    Events,
    Piece,
    Proof,
    System,
)

__all__ = ["Continuum", "Solution", "Solutions", "find_solutions"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Solution:
    """One solution: x and its statuses."""

    x: PETSc.Vec
    piece: Piece


@dataclass(frozen=True)
class Continuum:
    """Infinitely many solutions with the same statuses.

    Attributes:
        piece: the statuses.
        ends: those that span the others, two where these are a segment; of a set that goes to
            infinity only the ends that there are.
    """

    piece: Piece
    ends: tuple[Solution, ...]


@dataclass(frozen=True)
class Solutions:
    """Solutions at one gamma.

    Attributes:
        gamma: parameter.
        found: known ones first.
        complete: whether it is proved that there are no others.
        method: how they were looked for, human-readable.
        proof: what the system proved, if that was required; in space the forces of its states have
            a unit of their own, those of the body are in the tables of the solutions.
        continua: that were found by enumeration; their ends are in `found` as well.
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
        more = (
            f", among them the ends of {ends} continu{'um' if ends == 1 else 'a'}" if ends else ""
        )
        known = "proved to be all there are" if self.complete else "others are not excluded"
        return f"{many}{more}; {known}: {self.method}"

    def points(self, system: System, found: Sequence[Solution] | None = None) -> list[BranchPoint]:
        """Solutions as points without a tangent, for pictures and tables. Collective.

        Args:
            system: that they solve.
            found: which, by default all.
        """
        layout = Layout(system)
        points = []
        for s in self.found if found is None else found:
            y = layout.vector()
            nothing = layout.vector()
            layout.join(s.x, self.gamma, y)
            nothing.set(0.0)
            points.append(BranchPoint(y, nothing, s.piece, self.gamma, 0.0, 0))
        layout.x.destroy()
        return points


def _check(a: Arguments) -> None:
    check_system(a.system)
    a.gamma = checked_gamma(a.gamma)
    if any(isinstance(states, PETSc.Vec) for states in (a.guesses, a.known)):
        raise ValueError("guesses and known must be lists of states")
    for name in ("guesses", "known", "lengths"):
        setattr(a, name, listed(getattr(a, name), name))
    if not a.guesses:
        raise ValueError("at least one guess is needed")
    check_vectors(a.guesses, "a guess")
    check_vectors(a.known, "a known solution")
    for length in a.lengths:
        positive(length, "lengths")
    positive(a.tolerance, "tolerance")
    count(a.max_iterations, "max_iterations")
    nonnegative(a.proof_seconds, "proof_seconds")


@collective("find_solutions", _check)
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
    """Solutions at ``gamma``, as many as can be found. Collective.

    What the system writes to (of a contact problem Functions, statuses, gamma) is left as it was.
    Where pieces are not affine the first solution is what the system's own solver finds from a
    guess (of a contact problem `ContactProblem.solve`). That nothing was found is no proof that
    there is nothing; `Solutions.method` names what was tried. Of solutions that the system doubts
    (between bodies, and on curved obstacles, where the sliding is not small) nothing is proved.

    Args:
        system: H with its pieces.
        guesses: states to start from, over and over until nothing new is found; at least one.
            Further guesses are taken beside the solutions that are found.
        gamma: parameter.
        known: solutions that need not be found again.
        lengths: parts of the distance between a guess and a solution within which the solution
            repels, tried in turn.
        max_iterations: of each run of Newton's method.
        tolerance: relative residual at which a state is a solution.
        deflation: use it even where the pieces are affine.
        proof_seconds: for a proof that there are no others, where there are too many affine pieces
            to be enumerated, or under a friction bound given in advance; 0 for none.

    Raises:
        ValueError: on every rank, if there is no guess, a state does not fit, gamma, the loads or
            the stiffness are not finite, a number is not positive, or ranks differ.
    """
    check_states(system, guesses, "a guess")
    check_states(system, known, "a known solution")
    system.check_parameter([gamma])
    arguments = guesses, gamma, known, lengths, max_iterations, tolerance, deflation, proof_seconds
    scales = system.scales
    try:
        found = _found(system, *arguments)
    finally:
        system.scales = scales  # which wild states have made large
    return _doubted(system, found)


def _doubted(system: System, solutions: Solutions) -> Solutions:
    """Without a proof if the system doubts one of the solutions. Collective."""
    if not solutions.complete and solutions.proof is None:
        return solutions
    with system.restored(always=True):
        doubts = (system.doubt(s.x, solutions.gamma, s.piece) for s in solutions.found)
        doubt = next((d for d in doubts if d), "")
    if not doubt:
        return solutions
    method = f"{solutions.method}; nothing is proved: {doubt}"
    return replace(solutions, complete=False, method=method, proof=None)


def _found(
    system: System,
    guesses: Sequence[PETSc.Vec],
    gamma: float,
    known: Sequence[PETSc.Vec],
    lengths: Sequence[float],
    max_iterations: int,
    tolerance: float,
    deflation: bool,
    proof_seconds: float,
) -> Solutions:
    """Solutions by enumeration, a proof or deflation; see `find_solutions`. Collective."""
    sure: Solutions | None = None
    if not deflation:
        with system.restored(always=True):
            affine = system.is_piecewise_affine
            by = _of_cones if affine else _of_proof
            sure = by(system, guesses[0], gamma, proof_seconds)
        if sure is not None and (affine or sure.complete):
            return sure
    with (
        system.restored(always=True),
        _Deflated(system, gamma, max_iterations, tolerance) as deflated,
    ):
        solutions = [x.copy() for x in known]
        if sure is not None:
            solutions += [s.x for s in sure.found if not deflated.is_known(s.x, solutions)]
        first, tried = deflated.first(guesses, solutions)
        if first is not None:
            solutions.append(first)
        runs = 0
        fruitless = False
        while not fruitless:
            fruitless = True
            starts = [(guess, piece) for guess in guesses for piece in deflated.pieces(guess)]
            starts += [(guess, None) for guess in deflated.beside(solutions, guesses[0])]
            for (guess, piece), part in itertools.product(starts, lengths):
                runs += 1
                x = deflated.solve(guess, piece, solutions, part)
                if x is not None:
                    solutions.append(x)
                    fruitless = False
        found_ones = tuple(Solution(x, system.piece_at(x, gamma)) for x in solutions)
    method = f"{tried}deflation, {runs} runs of Newton's method"
    if not found_ones:
        method = f"not found: {method}"
    if sure is None and proof_seconds > 0 and not deflation:
        obstacle = system.obstacle_to_proof()
        method = f"{method}; nothing is proved: {obstacle}" if obstacle else method
    if sure is None:
        return Solutions(gamma, found_ones, False, method)
    return Solutions(gamma, found_ones, False, f"{method}, {sure.method}", proof=sure.proof)


def _of_proof(system: System, x: PETSc.Vec, gamma: float, seconds: float) -> Solutions | None:
    """What is certain where pieces are no cones; None where no proof is possible."""
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
        found.append(Solution(y, system.piece_at(y, gamma) if condensed.guided else own))
    return Solutions(gamma, tuple(found), proof.verdict == "complete", proof.method, proof=proof)


def _of_cones(system: System, x: PETSc.Vec, gamma: float, seconds: float) -> Solutions | None:
    condensed = system.condensed(x, gamma)
    if condensed is None:
        return None
    affine = condensed.system
    affine.require_finite()
    sure = None
    if math.prod(map(int, affine.allowed.sum(axis=1))) > MOST_PIECES:
        sure = _of_proof(system, x, gamma, seconds)
    if sure is not None and sure.complete:
        return sure
    proved, proof = ((), None) if sure is None else (sure.found, sure.proof)
    whole = affine.load + gamma * affine.rate
    # The rays are looked for in units in which the load is 1.
    unit = float(np.abs(whole).max(initial=0.0)) or 1.0
    rays = outgoing(replace(affine, load=np.zeros_like(whole), rate=np.asarray(whole / unit)))

    def solution(ray: AffineRay) -> Solution:
        y = x.copy()
        condensed.expand(unit * ray.direction, gamma, y)
        return Solution(y, condensed.piece(ray.codes))

    at = {id(ray): solution(ray) for ray in rays.rays if ray.rate == 1}
    # What the proof found as well is one solution.
    new = [s for s in proved if not any(_same(condensed, s, other) for other in at.values())]
    found = (*at.values(), *new)
    spans = [(codes, [at[id(r)] for r in ends if id(r) in at]) for codes, ends in rays.continua]
    continua = tuple(
        Continuum(condensed.piece(codes), tuple(ends)) for codes, ends in spans if ends
    )
    complete = rays.complete
    if complete and not found and condensed.always_solvable:
        complete = False
        if x.comm.rank == 0:
            logger.error(
                "gamma = %.10g: a solution exists, since the stiffness at the contact points is "
                "positive definite, and none was found by %s: round-off or overflow",
                gamma,
                rays.method,
            )
    method = rays.method if proof is None else f"{rays.method}, {proof.method}"
    return Solutions(gamma, found, complete, method, continua, proof)


def _same(condensed: Condensed, a: Solution, b: Solution) -> bool:
    """Whether two solutions are one. Collective."""
    v = condensed.contract(a.x)
    w = condensed.contract(b.x)
    return bool(np.abs(v - w).max() <= 1e-7 * max(float(np.abs(v).max()), 1e-300))


class _Deflated:
    """Newton's method on m(x) H(x) at fixed gamma."""

    def __init__(self, system: System, gamma: float, max_iterations: int, tolerance: float):
        self.system = system
        self.gamma = gamma
        self.max_iterations = max_iterations
        self.tolerance = tolerance
        self.bordered = Bordered(system, gamma_scale=1.0, prefix="deflation_")
        b = self.bordered
        self._y, self._dy, self._rhs = (b.vector() for _ in range(3))
        self._row = b.last_unit()
        self._h, self._away, self._w = (system.create_vector() for _ in range(3))

    def __enter__(self) -> _Deflated:
        return self

    def __exit__(self, *_: object) -> None:
        self.bordered.destroy()
        for v in (self._y, self._dy, self._rhs, self._row, self._h, self._away, self._w):
            v.destroy()

    def beside(self, solutions: Sequence[PETSc.Vec], guess: PETSc.Vec) -> Iterator[PETSc.Vec]:
        """States on either side of the solutions, on the line from the guess."""
        for x in solutions:
            for part in (-0.1, 0.1):
                y = x.copy()
                y.axpy(part, x - guess)
                yield y

    def first(
        self, guesses: Sequence[PETSc.Vec], known: Sequence[PETSc.Vec]
    ) -> tuple[PETSc.Vec | None, str]:
        """A new solution by the system's own solver, and what was tried, for `Solutions.method`."""
        tried = ""
        for guess in guesses:
            x, how = self.system.solution_from(guess, self.gamma)
            if x is None:
                # The guesses after this one are tried too.
                tried = tried or (f"{how}; " if how else "")
                continue
            exact = self.solve(x, None, [], 1.0)
            if exact is not None:
                x.destroy()
                x = exact
            if self.is_known(x, known):
                x.destroy()
                return None, f"{how}, "
            return x, f"{how}, "
        return None, tried

    def pieces(self, guess: PETSc.Vec) -> list[Piece | None]:
        """None, and pieces in which all points have one status: of the first step from a guess."""
        free = np.unique(self._events(guess).point)
        here = self.system.piece_at(guess, self.gamma)
        statuses = {int(s) for point in free for s in self.system.statuses(int(point))}
        every = sorted(set().union(*self.bordered.comm.allgather(statuses)))
        uniform = []
        for status in every:
            mine = [p for p in free if status in self.system.statuses(int(p))]
            points = np.array(mine, dtype=np.int32)
            uniform.append(here.with_codes(points, [status] * len(points)))
        return [None, *uniform]

    def _events(self, x: PETSc.Vec) -> Events:
        return self.system.events(x, self.gamma, self.system.piece_at(x, self.gamma))

    def solve(
        self, guess: PETSc.Vec, piece: Piece | None, known: Sequence[PETSc.Vec], part: float
    ) -> PETSc.Vec | None:
        """A solution that is not among ``known``, from ``guess``; None if none is found.

        The first step is a whole one on ``piece``, if there is one.
        """
        b = self.bordered
        x = guess.copy()
        squares = [part**2 * self._product(guess, other)[0] or 1.0 for other in known]
        for _ in range(self.max_iterations):
            error = self.system.residual(x, self.gamma, self._h, piece)
            if not np.isfinite(error):
                break
            near = error <= self.tolerance and piece is None
            if near and self.is_known(x, known):
                break
            b.join(x, self.gamma, self._y)
            b.solver.assemble(self._y, self._row, piece)
            b.join(self._h, 0.0, self._rhs)
            self._rhs.scale(-1.0)
            if not b.solver.solve(self._rhs, self._dy):
                break
            dx, _ = b.split(self._dy)
            dx = dx.copy()
            repelled = piece is None and not near
            x.axpy(self._factor(x, dx, known, squares) if repelled else 1.0, dx)
            # The residual may be small beside those of wild steps before: the step decides.
            done = near and dx.norm() <= 1e-8 * x.norm()
            dx.destroy()
            if done:
                return x
            piece = None
        x.destroy()
        return None

    def _factor(
        self, x: PETSc.Vec, dx: PETSc.Vec, known: Sequence[PETSc.Vec], squares: Sequence[float]
    ) -> float:
        """1 / (1 - grad log m . dx)."""
        slope = 0.0
        for other, square in zip(known, squares, strict=True):
            distance, along = self._product(x, other, dx)
            # Of log(1/d + 1), d the square of the distance: -2 (x - x_k) . dx / (d (1 + d)).
            slope -= 2 * along / (max(distance, 1e-300) * (1 + distance / square))
        factor = 1.0 / (1.0 - slope) if slope != 1 else 1.0
        return float(np.clip(factor, -1e3, 1e3))

    def _product(
        self, x: PETSc.Vec, other: PETSc.Vec, dx: PETSc.Vec | None = None
    ) -> tuple[float, float]:
        """|x - x_k|^2 and (x - x_k) . dx in the metric of the system."""
        self._away.waxpy(-1.0, other, x)
        self.system.metric(self._away, self._w)
        along = 0.0 if dx is None else float(self._w.dot(dx))
        return float(self._w.dot(self._away)), along

    def is_known(self, x: PETSc.Vec, known: Sequence[PETSc.Vec]) -> bool:
        """Whether a state is one of ``known``."""
        size = x.norm()
        for other in known:
            self._away.waxpy(-1.0, other, x)
            if self._away.norm() <= 1e-6 * max(size, other.norm(), 1e-300):
                return True
        return False
