# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a driver is given and what it leaves, the same for all codes.

A driver is a program: ``driver.py problem.npz settings.json answer.npz``. Its answer has ``u``
(s, n, dim), displacements at the ends of the steps, ``forces`` (s, m, dim) on the body at its
contact nodes if the code gives such, and ``record``, JSON with

    version       of the code
    says          what it says of its success, in its words
    converged     whether that is a success
    iterations    of all steps together, as it counts them
    seconds       of a processor, from arrays in memory to displacements in memory, without imports
    mu            the coefficient of friction, if it is not the problem's: 0 by a code that has none
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys

import numpy as np
from problems import Problem


def run(solve, writes=True):
    """Be a driver's program: ``solve(problem, settings)`` returns u, forces or None, record.

    Of several ranks one ``writes``.
    """
    problem, settings, answer = sys.argv[1:]
    with open(settings) as file:
        given = json.load(file)
    u, forces, record = solve(Problem.load(problem), given)
    if not writes:
        return
    arrays = {"u": u, "record": np.array(json.dumps(record))}
    if forces is not None:
        arrays["forces"] = forces
    np.savez(answer, **arrays)


def processor_time():
    """Seconds of a processor, by this process and those that it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def debian_version(package):
    """Of an installed package of Debian."""
    command = ["dpkg-query", "--show", "--showformat=${Version}", package]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout
