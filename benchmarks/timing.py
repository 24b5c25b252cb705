# SPDX-License-Identifier: LGPL-3.0-or-later
"""How the benchmarks take time: warm, in turns, medians of three.

What is compared runs in the same process in turns (A B A B ...), so that a machine that slows down
meanwhile slows all of it. Each has run once before, untimed: compilation, the first touch of memory
and what PETSc sets up once count nowhere. Of the timed runs the median stands, with the seconds of
all of them beside it. Memory that earlier runs left is collected between runs, untimed.
"""

from __future__ import annotations

import gc
import json
import resource
import time
from pathlib import Path

from petsc4py import PETSc

REPEATS = 3


class Timer:
    """Wall time of named parts, the slowest rank counts; and processor time of all ranks.

    On a machine that others use too the processor time is the fairer of the two.
    """

    def __init__(self, comm):
        self.comm = comm
        self.seconds = {}
        self.processor = 0.0

    def __call__(self, name, function):
        self.comm.barrier()
        start = time.perf_counter()
        cpu = time.process_time()
        result = function()
        self.processor += self.comm.allreduce(time.process_time() - cpu)
        self.comm.barrier()
        self.seconds[name] = self.comm.allreduce(time.perf_counter() - start, op=max)
        return result

    @property
    def total(self):
        return sum(self.seconds.values())

    @property
    def record(self):
        """What the benchmarks write of it."""
        return {
            "seconds": self.total,
            "processor_seconds": self.processor,
            "parts": dict(self.seconds),
        }


def in_turns(comm, runs, repeats=REPEATS):
    """Run all once, untimed, then all of them in turns. Collective.

    Args:
        comm: communicator of the runs.
        runs: functions by name, each returning a record with ``seconds``. One whose record has a
            false ``converged`` is not run again.
        repeats: number of rounds.

    Returns:
        Records by name, as `median` makes them, in the order of ``runs``.
    """

    def record_of(name):
        clean(comm)
        return runs[name]()

    first = {name: record_of(name) for name in runs}
    good = [name for name, record in first.items() if record.get("converged", True)]
    rounds = [{name: record_of(name) for name in good} for _ in range(repeats)]
    return {
        name: median([r[name] for r in rounds], warm_up=record) if name in good else record
        for name, record in first.items()
    }


def median(records, warm_up=None):
    """The record of the median of ``seconds``, with those of all runs in ``runs``.

    Other entries whose names end in ``_seconds`` get medians of their own. Of an even number of
    runs the slower one of the two in the middle counts. A run that did not converge is not passed
    over: its record stands instead.
    """
    failed = [r for r in records if not r.get("converged", True)]
    if failed:
        return failed[0]
    middle = len(records) // 2
    found = dict(sorted(records, key=lambda r: r["seconds"])[middle])
    found["runs"] = [r["seconds"] for r in records]
    for name in [n for n in found if n.endswith("_seconds")]:
        found[name] = sorted(r[name] for r in records)[middle]
    if warm_up is not None:
        found["warm_up_seconds"] = warm_up["seconds"]
    return found


def clean(comm):
    """Free what earlier runs left. Collective."""
    gc.collect()
    PETSc.garbage_cleanup(comm)


def peak_gigabytes(comm):
    """Peak of the resident memory of all ranks so far, 10^9 bytes."""
    return comm.allreduce(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1e9


def save(path, record):
    """Write a record as JSON. For one rank."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(json.dumps(record, indent=1) + "\n")
