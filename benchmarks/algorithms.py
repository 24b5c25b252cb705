# SPDX-License-Identifier: LGPL-3.0-or-later
"""Classical algorithms and Newton's method: convergence, iterations and time.

The problems are the GRECO block, plane blocks and cubes, two bodies, four problems of Siconos on
their contact points (`tests/data/siconos`), and with ``--large`` a slab with 1 089 contact nodes.
The friction coefficient is 0.1 to 3, and every run starts from zero. The script prints every run
and a table of iterations in Markdown, writes the runs as JSON, and draws the residual histories of
one case and the iterations of one problem over friction.

    python3 benchmarks/algorithms.py --output algorithms.json
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
import cases.greco_block
import cases.two_blocks
import local_problem
from support.blocks import block

from dolfinx import mesh

from dolfinx_contact import ConvergenceError, plot
from dolfinx_contact.algorithms import ALGORITHMS as NAMED
from dolfinx_contact.algorithms import (
    GaussSeidel,
    Lemke,
    SemismoothNewton,
    TrescaFixedPoint,
    Uzawa,
)

FRICTION = [0.1, 0.3, 0.6, 1.0, 2.0, 3.0]
ALGORITHMS = {
    "tresca": TrescaFixedPoint(),
    "tresca, Aitken": TrescaFixedPoint(aitken=True),
    "uzawa": Uzawa(max_iterations=10000),
    "uzawa, augmented": Uzawa(augmented=True),
    "penalty": "penalty",
    "gauss-seidel": GaussSeidel(max_iterations=1500),
    "sor": "sor",
    "cg": "projected-gradient",
    "lemke": Lemke(),
    "interior-point": "interior-point",
}
LARGE = [
    "tresca, Aitken",
    "uzawa, augmented",
    "gauss-seidel",
    "interior-point",
]


def greco(comm):
    return cases.greco_block.problem(cases.greco_block.arguments([]), comm)


def two_bodies(comm):
    return cases.two_blocks.problem(cases.two_blocks.arguments(["--n=8"]), comm)[0]


def slab(comm):
    size = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    hexahedron = mesh.CellType.hexahedron
    return block(comm, domain=mesh.create_box(comm, size, [32, 32, 3], hexahedron))


PROBLEMS = {
    "greco 32": greco,
    "block 8": lambda comm: block(comm, n=8, cell="quad"),
    "block 16": lambda comm: block(comm, n=16, cell="quad"),
    "two bodies": two_bodies,
    "dragged 16": lambda comm: block(comm, n=16, cell="quad", top=(0.03, -0.01)),
    "cube 4": lambda comm: block(comm, n=4, cell="hex"),
    "cube 6": lambda comm: block(comm, n=6, cell="hex"),
}
SICONOS = Path(__file__).parents[1] / "tests" / "data" / "siconos"
#: Files of the problems of Siconos. They have no body, so Newton's method works on the points, too.
PUBLIC = {
    "Siconos 00031": "FrictionContactProblem00031.dat",
    "Siconos 00394": "FrictionContactProblem00394.dat",
    "Siconos Example1": "FC3D_Example1_SBM.dat",
    "Siconos Rover4396": "Rover4396.dat",
}


class Body:
    """A body, condensed onto its contact points by every algorithm except Newton's method."""

    def __init__(self, make, comm):
        self.problem = make(comm)
        self.dim = self.problem.V.mesh.geometry.dim

    def set(self, friction):
        for s in self.problem.surfaces:
            s.law.friction.value = friction

    def solve(self, algorithm):
        return solve(self.problem, algorithm)


class Points:
    """A problem that was published on its contact points."""

    def __init__(self, file):
        self.problem = local_problem.read(SICONOS / file).points()
        self.dim = self.problem.dim

    def set(self, friction):
        self.problem = replace(self.problem, friction=np.full(self.problem.number, friction))

    def solve(self, algorithm):
        if isinstance(algorithm, str):
            algorithm = SemismoothNewton() if algorithm == "newton" else NAMED[algorithm]
        begun = time.perf_counter()
        outcome = algorithm.run(self.problem)
        found = {
            "converged": outcome.converged,
            "reason": outcome.reason,
            "iterations": iterations(outcome),
            "seconds": time.perf_counter() - begun,
            "residuals": [float(residual) for residual in outcome.residuals],
        }
        return found, outcome.r if outcome.converged else None


def iterations(attempt):
    """Return the iterations of an attempt or outcome; for Lemke's method, the pivots."""
    return int(attempt.series["pivots"][-1]) if "pivots" in attempt.series else attempt.iterations


def solve(problem, algorithm):
    """Return the record of a solve from zero, and the forces; None if it does not converge."""
    zero = problem.create_vector()
    problem.read(zero)
    begun = time.perf_counter()
    try:
        result = problem.solve(algorithm=algorithm, progress=False)
        attempt = result.attempts[-1]
        found = {"converged": True, "reason": result.reason, "iterations": iterations(attempt)}
        tables = result.tables
    except ConvergenceError as error:
        attempt = error.attempts[-1]
        tables = {}
        found = {"converged": False, "reason": attempt.reason, "iterations": iterations(attempt)}
    found["seconds"] = time.perf_counter() - begun
    found["residuals"] = [float(step.measures.worst) for step in attempt.steps]
    forces = [t.force for t in tables.values()]
    return found, np.concatenate(forces) if forces else None


def run(name, case, algorithms, frictions, comm):
    """Return the records of one problem."""
    records = []
    for friction in frictions:
        case.set(friction)
        case.solve("newton")  # not timed: the first solve compiles forms
        newton, known = case.solve("newton")
        records.append({"problem": name, "friction": friction, "algorithm": "newton"} | newton)
        for title in algorithms:
            if case.dim == 3 and title.startswith("lemke"):
                continue
            found, forces = case.solve(ALGORITHMS[title])
            record = {"problem": name, "friction": friction, "algorithm": title} | found
            record["newton_seconds"] = newton["seconds"]
            record["time_ratio"] = found["seconds"] / newton["seconds"]
            if forces is not None and known is not None:
                record["off_newton"] = float(np.abs(forces - known).max() / np.abs(known).max())
            records.append(record)
            if comm.rank == 0:
                print(shown(record), flush=True)
    return records


def shown(r):
    ended = f"{r['off_newton']:.0e}" if "off_newton" in r else r["reason"]
    cells = (r["problem"], f"{r['friction']:g}", r["algorithm"], r["iterations"])
    return "| " + " | ".join(map(str, cells)) + f" | {r['time_ratio']:.1f} | {ended} |"


def table(records):
    """Return a table of iterations at every friction coefficient; a dash: no convergence."""
    cells = {}
    for r in records:
        cell = cells.setdefault(r["problem"], {}).setdefault(r["algorithm"], [])
        cell.append(str(r["iterations"]) if r["converged"] else "-")
    names = ["newton", *ALGORITHMS]
    lines = ["| problem | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for problem, row in cells.items():
        found = (", ".join(row.get(name, [])) for name in names)
        lines.append("| " + " | ".join([problem, *found]) + " |")
    return "\n".join(lines)


def main() -> None:
    """Run the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", default="algorithms.json")
    parser.add_argument("--quick", action="store_true", help="friction 0.3 and 1 alone")
    parser.add_argument("--large", action="store_true", help="the slab, with a few algorithms")
    parser.add_argument("--only", help="the problem with this name")
    parser.add_argument("--friction", nargs="+", type=float, help="coefficients")
    args = parser.parse_args()
    comm = MPI.COMM_WORLD
    logging.getLogger("dolfinx_contact").setLevel(logging.ERROR)
    frictions = args.friction or ([0.3, 1.0] if args.quick else FRICTION)
    if comm.rank == 0:
        print("| problem | F | algorithm | iterations | time over Newton's | off Newton's forces |")
        print("|---" * 6 + "|")
    records = []
    if not (args.large and args.only is None):
        for name, make in PROBLEMS.items():
            if args.only in (None, name):
                records += run(name, Body(make, comm), ALGORITHMS, frictions, comm)
        for name, file in PUBLIC.items():
            if args.only in (None, name):
                records += run(name, Points(file), ALGORITHMS, frictions, comm)
    if args.large:
        records += run("slab 33 x 33", Body(slab, comm), LARGE, frictions, comm)
    if comm.rank == 0:
        print("", table(records), sep="\n")
        file = Path(args.output)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(records, indent=1) + "\n")
        draw_histories(records, file.with_suffix(".png"))
        draw_iterations(records, file.with_name(file.stem + "_iterations.png"))


def draw_histories(records, file):
    """Residual histories of the first problem at its smallest friction."""
    case = (records[0]["problem"], sorted({r["friction"] for r in records})[0])
    curves = {}
    for r in records:
        if (r["problem"], r["friction"]) == case and len(r["residuals"]) > 1:
            residuals = np.maximum(r["residuals"], 1e-16)
            curves[r["algorithm"]] = (np.arange(1, len(residuals) + 1), residuals)
    look = dict(labels=("iteration + 1", "residual"), loglog=True)
    plot.draw_curves(file, curves, title=f"{case[0]}, F = {case[1]:g}", **look)


def draw_iterations(records, file):
    """Iterations of the first problem over friction, and those after which there was no end."""
    records = [r for r in records if r["problem"] == records[0]["problem"]]
    parts = {
        converged: {
            name: tuple(np.array([(r["friction"], r["iterations"] + 1) for r in found]).T)
            for name in dict.fromkeys(r["algorithm"] for r in records)
            if (
                found := [
                    r for r in records if (r["algorithm"], r["converged"]) == (name, converged)
                ]
            )
        }
        for converged in (True, False)
    }
    failed = {f"{name}, not converged": curve for name, curve in parts[False].items()}
    look = dict(labels=("$F$", "iterations + 1"), title=records[0]["problem"], loglog=True)
    plot.draw_curves(file, parts[True], marks=failed, **look)


if __name__ == "__main__":
    main()
