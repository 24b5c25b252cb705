# SPDX-License-Identifier: LGPL-3.0-or-later
"""From which friction on the linear triangle has three solutions, by discretisation of contact.

The triangle of `cases.linear_triangle` under gamma = 1. Nodal and mixed contact are bisected with
all solutions at hand (`find_solutions`); integral contact, whose statuses are no cones, is followed
down from a friction coefficient of 4, where its three solutions are found from the nodal ones,
until one of them is lost. The thresholds meet as the mesh is refined.
"""

import argparse
import functools
import json
from pathlib import Path

import numpy as np
from cases import _triangle

from dolfinx_contact import ContactSurface, ConvergenceError, parse_arguments
from dolfinx_contact.continuation import find_solutions

STRONG = 4.0


def triangle(n, method, friction):
    _triangle.ContactSurface = functools.partial(ContactSurface, method=method)
    system = _triangle.linear_triangle(n, friction)
    system.set_parameter(1.0)
    return system


def solutions(n, method, friction):
    """All of them, as values of displacement and multiplier."""
    system = triangle(n, method, friction)
    found = []
    for s in find_solutions(system, [system.create_vector()], 1.0).found:
        system.problem.read(s.x)
        found.append([f.x.array.copy() for f in system.problem.fields])
    return found


def bisected(n, method, width):
    low = 0.5
    high = STRONG
    while high - low > width:
        middle = (low + high) / 2
        low, high = (low, middle) if len(solutions(n, method, middle)) > 2 else (middle, high)
    return high


def from_guesses(n, method, friction, guesses):
    """The different solutions that Newton's method finds from guesses."""
    problem = triangle(n, method, friction).problem
    found = []
    for guess in guesses:
        for f, values in zip(problem.fields, guess, strict=True):
            f.x.array[:] = values
        try:
            problem.solve()
        except ConvergenceError:
            continue
        u = problem.u.x.array
        if all(np.abs(u - v).max() > 1e-7 * np.abs(u).max() for v, _ in found):
            found.append([f.x.array.copy() for f in problem.fields])
    return found


def followed(n, method, width):
    friction = STRONG
    step = 0.1
    known = from_guesses(n, method, friction, solutions(n, "nodal", friction))
    if len(known) < 3:
        return float("nan")
    while step > width / 2:
        new = from_guesses(n, method, friction - step, known)
        if len(new) < 3:
            step /= 2
        else:
            friction = friction - step
            known = new
    return friction


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, nargs="+", default=[8, 16], help="cells along an edge")
    parser.add_argument("--width", type=float, default=0.005, help="of the bracket")
    parser.add_argument("--output", default="thresholds.json")
    args = parse_arguments(parser, argv)
    rows = []
    for n in args.n:
        row = {"n": n} | {m: bisected(n, m, args.width) for m in ("nodal", "mixed")}
        rows.append(row | {"integral": followed(n, "integral", args.width)})
        print(rows[-1], flush=True)
    Path(args.output).write_text(json.dumps({"thresholds": rows}, indent=1))


if __name__ == "__main__":
    main()
