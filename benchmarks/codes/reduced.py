# SPDX-License-Identifier: LGPL-3.0-or-later
"""The reduced problems of a problem, one a step, for codes that know contact points alone.

`Reduction` of this package condenses the body; a file has S (d m, d m), p (s, d m), friction (m,),
frames (m, d, d) and the numbers of the points among the contact nodes (`algorithms.PointProblem`).

    python3 benchmarks/codes/reduced.py problem.npz points.npz
"""

from __future__ import annotations

import sys

import numpy as np
from problems import Problem
from with_ours import made

from dolfinx_contact.reduced import Reduction


def reduced(p):
    """The arrays of the file."""
    problem, _, load = made(p, {})
    found = []
    for step in range(p.steps):
        load(step)
        with Reduction.of(problem.equations) as reduction:
            found.append(reduction.problem())
    points = found[0]
    away = np.linalg.norm(points.positions[:, None, : p.dim] - p.x[p.contact], axis=2)
    return {
        "S": points.S,
        "p": np.stack([points.p for points in found]),
        "friction": points.friction,
        "frames": points.frames,
        "nodes": away.argmin(axis=1),
    }


if __name__ == "__main__":
    np.savez(sys.argv[2], **reduced(Problem.load(sys.argv[1])))
