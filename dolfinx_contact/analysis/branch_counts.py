# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Numbers of solutions at values of gamma along branches, proved where possible.

A complete diagram contains every branch that is connected to the states from which it was explored.
Other solutions are found only by a search at one value of the load parameter gamma
(`find_solutions`), which may also prove completeness. The search runs at the ends of the range and
midway between neighbouring special points, where no status is at a border. The solutions found are
compared with the branches, interpolated between their points.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TypeAlias

from petsc4py import PETSc

import numpy as np

from dolfinx_contact._arrays import as_text
from dolfinx_contact._files import part_of
from dolfinx_contact._mpi import Arguments, collective
from dolfinx_contact._petsc import destroy
from dolfinx_contact._validate import count, instance, listed, nonnegative, number
from dolfinx_contact.continuation import Branch, Diagram, Solutions, System, find_solutions
from dolfinx_contact.continuation.layout import Layout
from dolfinx_contact.proofs.check_proof import Certificate

__all__ = ["BranchCounts", "ProvedCount", "prove_counts"]

# : Index of a branch, its interpolated state, and the distance up to which a solution matches.
_Crossing: TypeAlias = tuple[int, PETSc.Vec, float]

_SAME = 1e-6  # relative distance of a solution from the state of a branch
_NOTHING = 1e-12  # distance that counts as zero, relative to the largest state on branches
_CHORD = 0.5  # distance from the chord of a curved branch, relative to its step
_APART = 1e-6  # distance of special points that count as one, relative to the range


@dataclass(frozen=True, eq=False)
class ProvedCount:
    """Number of solutions at one gamma, and the branches to which they belong.

    Attributes:
        gamma: load parameter.
        solutions: result of `find_solutions`.
        statuses: one string for each solution, with a status letter for each contact point in the
            order of the tables; empty for a system without statuses.
        branches: for each solution, the index of the branch that contains it (the smallest index
            where branches meet); -1 for a solution on no branch.
        unfound: indices of the branches whose state at gamma matches no solution.
        certificate: proof of completeness; None without a proof.
        seconds: computing time.
    """

    gamma: float
    solutions: Solutions
    statuses: tuple[str, ...]
    branches: tuple[int, ...]
    unfound: tuple[int, ...]
    certificate: Certificate | None
    seconds: float

    @property
    def number(self) -> int:
        """Number of known solutions."""
        return len(self.solutions.found)

    @property
    def proved(self) -> bool:
        """Whether the solutions are provably complete."""
        return self.solutions.complete

    def __str__(self) -> str:
        return self.text(abs(self.gamma))

    def text(self, scale: float) -> str:
        """Return gamma, the number of solutions and the method as text.

        Args:
            scale: magnitude of the largest gamma; values of gamma within the round-off of this
                magnitude are printed as 0.
        """
        many = f"{self.number} solution{'' if self.number == 1 else 's'}"
        known = "proved" if self.proved else "others are not excluded"
        off = self.branches.count(-1)
        beside = f", {off} on no branch" if off else ""
        gamma = as_text(self.gamma, scale, 9)
        return f"gamma = {gamma}: {many}, {known}{beside} ({self.solutions.method})"


@dataclass(frozen=True, eq=False)
class BranchCounts:
    """Numbers of solutions along the branches of a diagram.

    Attributes:
        counts: counts, ordered by gamma.
        followed: whether the diagram contained every branch connected to its initial states.
    """

    counts: tuple[ProvedCount, ...]
    followed: bool

    def __iter__(self) -> Iterator[ProvedCount]:
        return iter(self.counts)

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def proved(self) -> bool:
        """Whether all counts are proved."""
        return all(c.proved for c in self.counts)

    @property
    def missed(self) -> int:
        """Number of solutions on no branch of the diagram."""
        return sum(c.branches.count(-1) for c in self.counts)

    def __str__(self) -> str:
        """Return one line per count."""
        scale = max((abs(c.gamma) for c in self.counts), default=0.0)
        return "\n".join(c.text(scale) for c in self.counts)

    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the counts and their proofs into a folder. Call it on one rank.

        The files are ``counts.json`` and, for each proved gamma, ``proof_<number>.npz``. Verify the
        proofs using ``python3 -m dolfinx_contact check``. ``counts.json`` contains the file name
        and digest of each proof.

        Args:
            folder: folder, created if it does not exist.
            overwrite: whether existing files are replaced.

        Returns:
            Path of ``counts.json``.

        Raises:
            FileExistsError: if counts.json exists and ``overwrite`` is False.
            OSError: if a file cannot be written.
        """
        place = Path(folder)
        file = place / "counts.json"
        if file.exists() and not overwrite:
            raise FileExistsError(f"{file} exists: save with overwrite=True, or to another folder")
        place.mkdir(parents=True, exist_ok=True)
        rows: list[dict[str, Any]] = []
        for i, c in enumerate(self.counts):
            name = f"proof_{i}.npz"
            if c.certificate is not None:
                with part_of(place / name) as part:
                    c.certificate.save(part)
            rows.append(
                {
                    "gamma": c.gamma,
                    "count": c.number,
                    "proved": c.proved,
                    "method": c.solutions.method,
                    "statuses": list(c.statuses),
                    "branches": list(c.branches),
                    "unfound": list(c.unfound),
                    "seconds": c.seconds,
                    "certificate": None if c.certificate is None else name,
                    "digest": None if c.certificate is None else c.certificate.digest,
                }
            )
        with part_of(file) as part:
            part.write_text(json.dumps({"followed": self.followed, "counts": rows}, indent=1))
        return file


def _check(a: Arguments) -> None:
    instance(a.diagram, "diagram", Diagram, "a result of explore")
    if not any(branch.points for branch in a.diagram.branches):
        raise ValueError("the diagram has no branch")
    if a.gammas is not None:
        a.gammas = [number(g, "gammas", "finite numbers") for g in listed(a.gammas, "gammas")]
        if not a.gammas:
            raise ValueError("gammas must be finite numbers, one or more, got none")
    a.most = count(a.most, "most")
    if a.proof_seconds != np.inf:
        nonnegative(a.proof_seconds, "proof_seconds")


@collective("counts along branches", _check)
def prove_counts(
    system: System,
    diagram: Diagram,
    *,
    gammas: Iterable[float] | None = None,
    most: int = 20,
    proof_seconds: float = 60.0,
) -> BranchCounts:
    """Count the solutions along the branches of a diagram, with proofs. Collective.

    The Functions of the system are left unchanged. Each proof holds at one gamma; branches that
    are not connected to the diagram may exist between two of these values.

    Args:
        system: system of the branches.
        diagram: result of `explore`, complete or not.
        gammas: values of the load parameter gamma; by default the ends of the range of the branches
            and the midpoints between neighbouring special points.
        most: largest number of midpoints; the longest intervals are preferred. Default 20.
        proof_seconds: time limit of each proof in seconds. Default 60.

    Raises:
        ValueError: on every rank, if an argument is not valid.
    """
    branches = diagram.branches
    chosen = default_gammas(branches, most) if gammas is None else sorted(set(gammas))
    system.check_parameter(chosen)
    layout = Layout(system)
    guess = layout.split(next(b for b in branches if b.points).points[0].y)[0].copy()
    size = max(float(layout.split(p.y)[0].norm()) for b in branches for p in b.points)
    counts = tuple(
        _counted(system, layout, branches, gamma, guess, size, proof_seconds) for gamma in chosen
    )
    destroy(guess, layout.x)
    return BranchCounts(counts, diagram.complete)


def default_gammas(branches: Iterable[Branch], most: int) -> list[float]:
    """Return the ends of the range of gamma, and midpoints between special points.

    Args:
        branches: branches of the diagram.
        most: largest number of midpoints; those of the longest intervals are returned.
    """
    followed = [b for b in branches if b.points]
    every = [p.gamma for b in followed for p in (b.points[0], b.points[-1])]
    every += [s.gamma for b in followed for s in b.special]
    every.sort()
    width = every[-1] - every[0]
    special = every[:1]
    for gamma in every[1:]:
        if gamma - special[-1] > _APART * width:
            special.append(gamma)
    intervals = sorted(itertools.pairwise(special), key=lambda i: i[0] - i[1])[:most]
    return sorted({every[0], every[-1], *((a + b) / 2 for a, b in intervals)})


def _counted(
    system: System,
    layout: Layout,
    branches: list[Branch],
    gamma: float,
    guess: PETSc.Vec,
    size: float,
    seconds: float,
) -> ProvedCount:
    """Count the solutions at one gamma. Collective.

    Args:
        system: system of the branches.
        layout: layout of the unknowns of the system.
        branches: branches of the diagram.
        gamma: load parameter.
        guess: state on a branch, used as an initial guess.
        size: largest norm of a state on the branches.
        seconds: time limit of the proof in seconds.
    """
    begun = perf_counter()
    known = _crossings(system, layout, branches, gamma, size)
    found = find_solutions(system, [guess, *(x for _, x, _ in known)], gamma, proof_seconds=seconds)
    certificate = _certificate(system, guess, found, seconds)
    on, unfound = _placed(found, known)
    letters = getattr(system, "letters", None)
    words = () if letters is None else tuple(letters(s.piece) for s in found.found)
    for _, x, _ in known:
        x.destroy()
    return ProvedCount(gamma, found, words, on, unfound, certificate, perf_counter() - begun)


def _placed(found: Solutions, known: list[_Crossing]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Match the solutions at one gamma with the branches that pass it. Collective.

    Each branch is assigned to the nearest solution within its tolerance.

    Returns:
        For each solution, the index of its first branch, -1 if it has none; and the sorted indices
        of the branches without a solution.
    """
    on = [-1] * len(found.found)
    unfound: set[int] = set()
    for index, x, away in known:
        distances = [_distance(x, solution.x) for solution in found.found]
        if min(distances, default=np.inf) > away:
            unfound.add(index)
            continue
        nearest = int(np.argmin(distances))
        if on[nearest] < 0:
            on[nearest] = index
    return tuple(on), tuple(sorted(unfound))


def _certificate(
    system: System, x: PETSc.Vec, found: Solutions, seconds: float
) -> Certificate | None:
    """Return a certificate that the solutions are complete, or None. Collective.

    If they were found by enumeration, which provides no proof, a proof is searched for.

    Args:
        system: system of the branches.
        x: state from which the problem is condensed.
        found: solutions at one gamma.
        seconds: time limit of this search.
    """
    if not found.complete:
        return None
    proof = found.proof
    if proof is None and seconds > 0:
        with system.restored(always=True):
            condensed = system.condensed(x, found.gamma)
            proof = None if condensed is None else system.prove(condensed, found.gamma, seconds)
    if proof is None or proof.verdict != "complete" or len(proof.solutions) != len(found.found):
        return None
    certificate = getattr(proof, "certificate", None)
    return certificate if isinstance(certificate, Certificate) else None


def _distance(y: PETSc.Vec, z: PETSc.Vec) -> float:
    d = y.copy()
    d.axpy(-1.0, z)
    size = float(d.norm())
    d.destroy()
    return size


def _crossings(
    system: System, layout: Layout, branches: list[Branch], gamma: float, size: float
) -> list[_Crossing]:
    """Return the states at which branches pass one gamma, by interpolation. Collective.

    Returns:
        For each passage the index of the branch, the interpolated state, and the distance up to
        which a solution counts as this state.
    """
    straight = system.is_piecewise_affine
    found: list[_Crossing] = []
    for index, branch in enumerate(branches):
        for a, b in itertools.pairwise(branch.points):
            if a.gamma == b.gamma or not min(a.gamma, b.gamma) <= gamma <= max(a.gamma, b.gamma):
                continue
            share = (gamma - a.gamma) / (b.gamma - a.gamma)
            x = layout.split(a.y)[0].copy()
            step = layout.split(b.y)[0].copy()
            step.axpy(-1.0, x)
            x.axpy(share, step)
            same = _SAME * float(x.norm()) + _NOTHING * size
            away = same + (0.0 if straight else _CHORD * float(step.norm()))
            step.destroy()
            if any(k == index and _distance(x, z) <= same for k, z, _ in found):
                x.destroy()  # duplicate: the end of a step is the start of the next
            else:
                found.append((index, x, away))
    return found
