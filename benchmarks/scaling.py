# SPDX-License-Identifier: LGPL-3.0-or-later
"""How time and memory of a frictional solve grow with the mesh and shrink with the ranks.

Under mpirun every size is solved on one rank, the others asleep, and then on all of them, plain
elasticity beside it; warm medians of three, as `elasticity_ratio.py` takes them, with few settings
of the elastic solve but where ``--settings`` says more. Prints speed-ups and growth, and what the
measured counts predict for larger machines.

    mpirun -n 2 python3 benchmarks/scaling.py --sizes 16 24 32 --output scaling.json
"""

from __future__ import annotations

import time

from mpi4py import MPI

import elasticity_ratio
import numpy as np
from timing import Timer, in_turns, save

_PER_STEP = 2  # factorisations on the surface in a Newton step and its correction


def alone(comm, function):
    """``function(COMM_SELF)`` on rank 0 while the others sleep; its result on every rank."""
    result = function(MPI.COMM_SELF) if comm.rank == 0 else None
    request = comm.Ibarrier()
    while not request.Test():
        time.sleep(0.1)
    return comm.bcast(result)


def growth(records, value):
    """Exponent of the growth of ``value`` with the number of unknowns, by least squares."""
    sizes = np.log([r["dofs"] for r in records])
    return float(np.polyfit(sizes, np.log([value(r) for r in records]), 1)[0])


def model(record, dofs, ranks):
    """Predicted seconds of a solve, from the counts and rates of a measured one.

    What is distributed (assembly, cycles, products) shrinks with the unknowns per rank. A direct
    solver on the surface, with n_s unknowns, costs n_s^1.5 and keeps n_s log n_s numbers, and
    gains little from more ranks than a few tens (the top separator is one dense front).
    """
    c = record["contact"]
    per_rank = c["seconds"] / (record["dofs"] / record["ranks"])
    surface = 3 * (record["n"] + 1) ** 2
    larger = 3 * (dofs / 3) ** (2 / 3)
    factor = record["surface_seconds"] / c["newton_iterations"] / surface**1.5
    return {
        "dofs": dofs,
        "ranks": ranks,
        "distributed_seconds": per_rank * dofs / ranks,
        "surface_unknowns": larger,
        "surface_seconds": c["newton_iterations"] * factor * larger**1.5 / min(ranks, 32),
        "surface_gigabytes": 31 * larger * np.log2(larger) * 8 / 1e9,
    }


def surface_seconds(args, n, comm):
    """Seconds of one factorisation on the surface, its assembly included: a warm median."""
    body = elasticity_ratio.block(args, n, comm)
    problem = elasticity_ratio.contact_problem(args, Timer(comm), *body)
    problem.petsc_options["linear_solver"] = "amg"
    solver = problem.linear_solver
    solver.operator.update(problem.evaluate())

    def factorise():
        timer = Timer(comm)
        timer("surface", solver.filter.update)
        return timer.record

    found = in_turns(comm, {"surface": factorise}, args.repeats)
    return found["surface"]["seconds"]


def main(argv=None):
    sizes = {"type": int, "nargs": "+", "default": [16, 24, 32], "help": "cells along an edge"}
    args = elasticity_ratio.arguments(
        argv, {"settings": ["few"], "output": "scaling.json"}, sizes=sizes
    )
    comm = MPI.COMM_WORLD

    def measure(n, on):
        record = elasticity_ratio.run(args, n, on)
        steps = record["contact"]["newton_iterations"]
        record["surface_seconds"] = _PER_STEP * steps * surface_seconds(args, n, on)
        return record

    elasticity_ratio.compile_forms(args, comm)
    alone(comm, lambda on: elasticity_ratio.compile_forms(args, on))
    pairs = []
    for n in args.sizes:
        one = alone(comm, lambda on, n=n: measure(n, on))
        pairs.append((one, measure(n, comm) if comm.size > 1 else one))
    if comm.rank > 0:
        return None
    print("| dofs | ratio, 1 rank | ratio, all | Newton | Krylov a step | speed-up | of elasticity "
          "| quotient |")  # fmt: skip
    print("|---" * 8 + "|")
    lines = []
    for one, every in pairs:
        contact = one["contact_seconds"] / every["contact_seconds"]
        elastic = one["elasticity_seconds"] / every["elasticity_seconds"]
        c = every["contact"]
        line = {
            "dofs": one["dofs"],
            "one": one,
            "all": every,
            "contact_speedup": contact,
            "elasticity_speedup": elastic,
            "elasticity_settings": [one["elasticity_setting"], every["elasticity_setting"]],
            "speedup_ratio": contact / elastic,
        }
        lines.append(line)
        print(f"| {one['dofs']} | {one['elasticity_ratio']:.2f} | {every['elasticity_ratio']:.2f} "
              f"| {c['newton_iterations']} | {c['krylov_iterations'] / c['newton_iterations']:.1f} "
              f"| {contact:.2f} | {elastic:.2f} | {contact / elastic:.2f} |")  # fmt: skip
    ones = [one for one, _ in pairs]
    exponents = {
        "contact_time": growth(ones, lambda r: r["contact_seconds"]),
        "elasticity_time": growth(ones, lambda r: r["elasticity_seconds"]),
        "krylov_iterations": growth(ones, lambda r: r["contact"]["krylov_iterations"]),
        "surface_time": growth(ones, lambda r: r["surface_seconds"]),
    }
    print("growth with the unknowns:", {k: round(v, 2) for k, v in exponents.items()})
    predictions = [
        model(pairs[-1][1], dofs, ranks)
        for dofs, ranks in ((1e6, 2), (1e7, 64), (1e8, 1000), (1e9, 10_000))
    ]
    for p in predictions:
        print("model:", {k: float(f"{v:.3g}") for k, v in p.items()})
    record = {"sizes": lines, "growth": exponents, "model": predictions}
    save(args.output, record)
    return record


if __name__ == "__main__":
    main()
