# SPDX-License-Identifier: LGPL-3.0-or-later
"""A proof as data: the problem, and a tree of steps that `checker` follows.

Steps are those of a walk through the tree, children after their parent, and act on the sets of
statuses that are left and on the bounds of the slots (`energy.py`). Numbers of vectors refer to
`Certificate.vectors`.

- ``exclude``: the vector ``y`` excludes ``what``, pairs of a point and a status.
- ``bound``: the vector ``y`` bounds a slot at a point by ``value``.
- ``empty``: the vector ``y`` proves that there is no solution; a leaf.
- ``only``: none but that of the piece ``codes``, by weights, theta and mu (`differences.py`); a
  leaf.
- ``pieces``: every piece that is left is solved; a leaf. Of those in ``singular`` a vector may
  prove that they hold nothing.
- ``branch``: of a point, into the sets ``parts``; the subtrees follow.
- ``rest``: there is no load, and so no solution but a = 0; a leaf.
- ``open``: nothing is proved; a leaf.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dolfinx_contact.analysis.reduced_problem import ReducedProblem

__all__ = ["Certificate"]

Array = npt.NDArray[np.float64]


@dataclass
class Certificate:
    """A proof of what the solutions of a reduced problem are.

    Attributes:
        problem: as it was given.
        steps: see the module.
        vectors: multipliers of the rows of S, in scaled units, (2 m,) each.
    """

    problem: ReducedProblem
    steps: list[dict[str, Any]] = field(default_factory=list)
    vectors: list[Array] = field(default_factory=list)

    def vector(self, y: Array) -> int:
        """Keep a vector; its number."""
        if not self.vectors or self.vectors[-1] is not y:
            self.vectors.append(y)
        return len(self.vectors) - 1

    def save(self, path: str | Path) -> None:
        """Write a ``.npz`` file, from one rank."""
        p = self.problem
        np.savez_compressed(
            path,
            S=p.S,
            p=p.p,
            friction=p.friction,
            bound=p.g,
            S_error=p.dS,
            p_error=p.dp,
            steps=np.array(json.dumps(self.steps)),
            vectors=np.array(self.vectors).reshape(len(self.vectors), len(p.p)),
        )

    @classmethod
    def load(cls, path: str | Path) -> Certificate:
        """Read what `save` wrote.

        Raises:
            ValueError: if the file is no certificate.
        """
        with np.load(path, allow_pickle=False) as found:
            names = ("S", "p", "friction", "bound", "S_error", "p_error")
            if not {*names, "steps", "vectors"} <= set(found.files):
                raise ValueError(f"{path} is no certificate")
            problem = ReducedProblem(**{name: found[name] for name in names})
            return cls(problem, json.loads(str(found["steps"])), list(found["vectors"]))
