# SPDX-License-Identifier: LGPL-3.0-or-later
"""The journal of a continuation.

Every branch has a line where it begins, a line for every point and a line where it ends.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from dolfinx_contact._optional import optional
from dolfinx_contact.continuation.ending import Ending, Ends
from dolfinx_contact.records.lines import FILE_NAME, Lines, ending_of, parse

__all__ = ["Journal", "JournalBranch", "read_journal"]

_SPECIAL = ("kind", "smooth", "gamma", "parity", "others", "complete", "bracket")


@dataclass
class JournalBranch(Ends):
    """What is known of one branch.

    Attributes:
        task: range and scale of gamma, step control, budget.
        points: one dictionary a point, in order: ``index``, ``gamma``, ``step``, ``corrections``,
            ``tau``, ``norm``, ``status``, ``counts``, ``functionals``, ``special``, ``next_step``,
            ``x_scale``, ``largest_distance`` and, where fields were kept, ``checkpoint``.
        ending: how it ended; None if it has not.
        reason: why, in words.
    """

    task: dict[str, Any]
    points: list[dict[str, Any]] = field(default_factory=list)
    ending: Ending | None = None
    reason: str = ""


@dataclass
class Journal(Lines):
    """What was recorded.

    Attributes:
        header: what identifies the problem, the names of the functionals, and (not in journals of
            old) the places of the contact points.
        branches: by number.
        sessions: one dictionary for every run that recorded: ranks, versions, time of its start.
        length: of the file in bytes, without a last line that was not finished.
        torn: whether there is such a line.
    """

    kind: ClassVar[str] = "branches"
    branches: dict[int, JournalBranch] = field(default_factory=dict)

    @property
    def functionals(self) -> list[str]:
        """Names of the functionals."""
        return list(self.header.get("functionals", []))

    def columns(self, branch: int | None = None) -> dict[str, npt.NDArray[Any]]:
        """All points as numpy arrays by name, of one branch or of all, in order.

        ``branch``, ``index``, ``gamma``, ``step``, ``corrections``, ``tau``, ``norm``, the
        functionals, the numbers of points ``open``, ``stick``, ``slip`` and ``clamped``,
        ``special`` (kinds of special points on the way to the point) and ``status``.
        """
        chosen = self._chosen(branch)
        rows = [(b, p) for b in chosen for p in self.branches[b].points]
        columns: dict[str, npt.NDArray[Any]] = {"branch": np.array([b for b, _ in rows], int)}
        for name in ("index", "corrections"):
            columns[name] = np.array([p[name] for _, p in rows], int)
        for name in ("gamma", "step", "tau", "norm"):
            columns[name] = np.array([p[name] for _, p in rows], float)
        for name in self.functionals:
            columns[name] = np.array([p["functionals"][name] for _, p in rows], float)
        for name in ("open", "stick", "slip", "clamped"):
            columns[name] = np.array([p["counts"][name] for _, p in rows], int)
        kinds = [" ".join(s["kind"] for s in p["special"]) for _, p in rows]
        columns["special"] = np.array(kinds, dtype=object)
        columns["status"] = np.array([p["status"] for _, p in rows], dtype=object)
        return columns

    def rows(
        self, branch: int | None = None, columns: Sequence[str] | None = None
    ) -> list[dict[str, Any]]:
        """All points as dictionaries, of one branch or of all, in order.

        Args:
            branch: its number.
            columns: names of `columns`; by default ``gamma``, the functionals, and the ``status``
                of the points that are not clamped.
        """
        known = self.columns(branch)
        names = ["gamma", "status", *self.functionals] if columns is None else list(columns)
        if set(names) - set(known):
            raise ValueError(f"these are not columns: {', '.join(sorted(set(names) - set(known)))}")
        values: list[list[Any]] = [list(known[name].tolist()) for name in names]
        if columns is None:
            values[1] = [word.replace("d", "") for word in values[1]]
        return [dict(zip(names, row, strict=True)) for row in zip(*values, strict=True)]

    def summary(self, branch: int = 0) -> dict[str, Any]:
        """Scalars and lists of a branch for `summary.json`.

        ``folds``, each with gamma, its kind (``"smooth"``, ``"nonsmooth"``) and the statuses of the
        free points before and after; the number of ``events``; gammas of ``bifurcations``; and the
        last of `rows` as ``end``.
        """
        rows = self.rows(branch)
        points = self.branches[branch].points
        special = [(s, p["index"]) for p in points for s in p["special"]]
        folds = [
            {
                "gamma": s["gamma"],
                "kind": "smooth" if s["smooth"] else "nonsmooth",
                "before": rows[i - 1]["status"],
                "after": rows[i]["status"],
            }
            for s, i in special
            if s["kind"] == "fold"
        ]
        return {
            "folds": folds,
            "events": sum(bool(s["changes"]) for s, _ in special),
            "bifurcations": [s["gamma"] for s, _ in special if s["kind"] == "bifurcation"],
            "end": rows[-1],
        }

    def table(self, branch: int | None = None) -> Any:
        """All points as a pandas DataFrame; see `columns`."""
        return optional("pandas", "output").DataFrame(self.columns(branch))

    def special(self, branch: int | None = None) -> Any:
        """Special points as a pandas DataFrame.

        ``branch``, ``index`` of the point that follows, ``kind``, ``smooth``, ``gamma``,
        ``parity``, ``others`` (number of further rays), ``complete``, ``bracket`` (the values
        of gamma between which it lies; None if it is located), and ``changes``, a list of
        dictionaries with the place ``x`` and the status ``before`` and ``after``.
        """
        names = ["branch", "index", *_SPECIAL, "changes"]
        rows = [
            {"branch": b, "index": p["index"], **{k: s.get(k) for k in names[2:]}}
            for b in self._chosen(branch)
            for p in self.branches[b].points
            for s in p["special"]
        ]
        return optional("pandas", "output").DataFrame(rows, columns=names)

    @property
    def is_empty(self) -> bool:
        return not self.branches

    def _take(self, kind: str, entry: dict[str, Any]) -> None:
        if kind == "branch":
            if entry["branch"] in self.branches:
                raise ValueError(f"branch {entry['branch']} begins twice")
            self.branches[entry["branch"]] = JournalBranch(entry["task"])
        elif kind == "point":
            branch = self.branches[entry.pop("branch")]
            if entry["index"] != len(branch.points):
                raise ValueError(
                    f"point {entry['index']} follows after {len(branch.points)} points"
                )
            for name in ("gamma", "next_step", "status", "special", "functionals", "counts"):
                if name == "status" and name not in entry:
                    entry[name] = branch.points[-1][name]  # written when it changes
                entry[name]
            branch.points.append(entry)
            branch.go_on()
        elif kind == "end":
            branch = self.branches[entry["branch"]]
            branch.end(ending_of(entry), entry["reason"])
            branch.points[-1].update({k: entry[k] for k in ("checkpoint", "sum") if k in entry})
        else:
            raise ValueError(f"lines of the kind {kind!r} are not known")

    def _chosen(self, branch: int | None) -> list[int]:
        if branch is not None and branch not in self.branches:
            raise ValueError(f"no branch {branch} was recorded, only {sorted(self.branches)}")
        return sorted(self.branches) if branch is None else [branch]


def read_journal(folder: str | os.PathLike[str]) -> Journal:
    """Read the journal of a folder, on this rank alone; it may be that of a run that goes on.

    Raises:
        OSError: if there is none.
        ValueError: if it is damaged, or no journal.
    """
    return parse((Path(folder) / FILE_NAME).read_bytes(), Journal)
