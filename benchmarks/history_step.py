# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does a step of a quasi-static history cost over a warm solve?

The body of `continuation_step.py`, with a rounded sole, is lowered on a floor and dragged. A
history goes through equal steps of the load with all that it has by default: friction against the
slip in the step, a memory, the energy account, tables. After each of its steps the static problem,
where friction is against the whole slip, is solved under the same load by `ContactProblem.solve`,
warm from its own solution before, with the same linear solver and to the same tolerance. The two
answers differ, and so may what they take: counts stand beside the seconds. A third problem takes
the steps of the history in a plain loop, ``problem.step_from(problem.snapshot()).solve()``; its
answer is that of the history, and ``loop_ratio`` is at most 1.3. All goes in turns three times on
one mesh, each time from new; the first steps and solves warm them and do not count, of the others
the medians of three do.

    mpirun -n 2 python3 benchmarks/history_step.py --n 43
"""

from __future__ import annotations

import argparse
import logging
import time
from collections import Counter
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

from mpi4py import MPI

import numpy as np
from continuation_step import foot, lowered
from timing import REPEATS, clean, median, save

from dolfinx_contact import parse_arguments
from dolfinx_contact.equations.contact import ContactEquations
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.evolution import step as steps
from dolfinx_contact.evolution.through_times import ThroughTimes
from dolfinx_contact.problem import ContactProblem
from dolfinx_contact.solvers.newton import Newton

#: Of a step, in a solve and around it: parts by name, and whose seconds they are. A part within
#: another one counts for itself alone.
PARTS = {
    "newton": [(Newton, "run")],
    "solve": [(ContactProblem, "_solved")],
    "result": [(ContactProblem, "_collected")],
    "energies": [(steps, "forces_at")],
    "memory": [(ContactEquations, "advanced"), (ContactEquations, "with_memory")],
    "rate_problem": [(ThroughTimes, "_rays")],
    "moments": [
        (steps.Stepper, "put"),
        (steps.Stepper, "_set"),
    ],
    "state": [(ContactProblem, "evaluate")],
}


def arguments(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--dim", type=int, choices=(2, 3), default=3)
    parser.add_argument("--n", type=int, default=24, help="cells along an edge")
    parser.add_argument("--cell", choices=("simplex", "tensor"), default="tensor")
    parser.add_argument("--friction", type=float, default=0.4)
    parser.add_argument("--steps", type=int, default=9)
    parser.add_argument("--last", type=float, default=0.7, help="of the parameter gamma")
    parser.add_argument("--skip", type=int, default=3, help="first steps that do not count")
    parser.add_argument("--tolerance", type=float, default=1e-10, help="of both")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="turns of the two")
    parser.add_argument("--output", default="history_step.json")
    return parse_arguments(parser, argv)


class Clock:
    """Wall time, the slowest rank counts, and processor time of all ranks."""

    def __init__(self, comm):
        self.comm = comm

    def start(self):
        self.comm.barrier()
        self._wall = time.perf_counter()
        self._processor = time.process_time()

    def stopped(self):
        """Both since the start."""
        self.comm.barrier()
        wall = time.perf_counter() - self._wall
        processor = time.process_time() - self._processor
        return self.comm.allreduce(wall, op=max), self.comm.allreduce(processor)


class Parts:
    """Seconds of the parts of what runs, on this rank."""

    def __init__(self):
        self.seconds = Counter()
        self._open = []

    def take(self):
        """What came together since the last time."""
        taken = dict(self.seconds)
        self.seconds = Counter()
        return taken

    @contextmanager
    def watched(self):
        """Take the time of all `PARTS` while the context lasts."""
        with ExitStack() as stack:
            for name, places in PARTS.items():
                for owner, attribute in places:
                    call = self._timed(name, getattr(owner, attribute))
                    stack.enter_context(patch.object(owner, attribute, call))
            yield self

    def _timed(self, name, function):
        def call(*args, **kwargs):
            start = time.perf_counter()
            self._open.append(0.0)
            try:
                return function(*args, **kwargs)
            finally:
                whole = time.perf_counter() - start
                self.seconds[name] += whole - self._open.pop()
                if self._open:
                    self._open[-1] += whole

        return call


def counts(result, problem):
    """What a solve took."""
    solver = problem.linear_solver
    return {
        "newton_iterations": result.iterations,
        "krylov_iterations": sum(a.krylov_iterations for a in result.attempts),
        "evaluations": sum(a.evaluations for a in result.attempts),
        "strategy": result.reason,
        "hierarchies": solver.hierarchy.builds if solver.name == "amg" else 0,
    }


def turn(args, body, comm):
    """Steps, static solves and a plain loop of steps, one after the other; a record of each."""
    history, static, loop = (lowered(args, *body) for _ in range(3))
    steps = []
    solves = []
    loops = []
    clock = Clock(comm)
    with Parts().watched() as parts:

        def note(records, result, problem):
            seconds, processor = clock.stopped()
            letters = "".join(t.status for t in result.tables.values())
            before = records[-1]["status"] if records else letters
            records.append(
                {
                    "seconds": seconds,
                    "processor_seconds": processor,
                    **counts(result, problem),
                    "changes": sum(a != b for a, b in zip(before, letters, strict=True)),
                    "parts": parts.take(),
                    "status": letters,
                }
            )

        def accepted(step):
            note(steps, step.result, history.problem)
            static.set_parameter(step.time)
            clock.start()
            result = static.problem.solve()
            note(solves, result, static.problem)
            clock.start()
            state = loop.problem.snapshot()
            loop.set_parameter(step.time)
            result = loop.problem.step_from(state, step=step.time - step.start).solve()
            note(loops, result, loop.problem)
            clock.start()

        loads = np.linspace(0.0, args.last, args.steps + 1)
        evolution = QuasiStatic(history.problem, history.set_parameter)
        loop.set_parameter(0.0)
        clock.start()
        found = evolution.run(loads, observer=accepted)
    for each in (*steps, *solves, *loops):
        del each["status"]
    record = {
        "unknowns": history.create_vector().getSize(),
        "linear_solver": history.problem.linear_solver.name,
        "residue": found.energies.residue / found.energies.external,
        "dissipated": found.energies.dissipated / found.energies.external,
    }
    return steps, solves, loops, record


def mean(records, name):
    return float(np.mean([r[name] for r in records]))


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    logging.basicConfig(level=logging.WARNING)
    turn(args, foot(args, 3, comm), comm)  # compiles all forms
    body = foot(args, args.n, comm)
    rounds = []
    for _ in range(args.repeats):
        clean(comm)
        *sides, of_all = turn(args, body, comm)
        rounds.append(sides)
    steps, solves, loops = (
        [median(runs) for runs in zip(*side, strict=True)] for side in zip(*rounds, strict=True)
    )
    counted = steps[args.skip :], solves[args.skip :], loops[args.skip :]
    ratios = {
        f"{prefix}{name}": mean(counted[0], seconds) / mean(counted[of], seconds)
        for name, seconds in (("ratio", "seconds"), ("processor_ratio", "processor_seconds"))
        for prefix, of in (("", 1), ("loop_", 2))
    }
    names = sorted({name for r in counted[0] for name in r["parts"]})
    parts = {k: float(np.mean([r["parts"].get(k, 0.0) for r in counted[0]])) for k in names}
    inside = mean(counted[0], "seconds")
    newton = parts.get("newton", 0.0)
    record = {
        "dim": args.dim,
        "n": args.n,
        "cell": args.cell,
        "ranks": comm.size,
        "repeats": args.repeats,
        **of_all,
        **ratios,
        "step_seconds": inside,
        "static_seconds": mean(counted[1], "seconds"),
        "newton_seconds": newton,
        "rest_seconds": inside - newton,
        "parts": parts | {"other": inside - sum(parts.values())},
        **{f"step_{k}": mean(counted[0], k) for k in COUNTS},
        **{f"static_{k}": mean(counted[1], k) for k in COUNTS},
        "steps": steps,
        "static": solves,
    }
    if comm.rank == 0:
        told = {k: v for k, v in record.items() if k not in ("steps", "static")}
        for name, value in told.items():
            print(f"  {name}: {value:.4g}" if isinstance(value, float) else f"  {name}: {value}")
        save(args.output, record)
    return record


COUNTS = ("newton_iterations", "krylov_iterations", "evaluations", "changes", "hierarchies")

if __name__ == "__main__":
    main()
