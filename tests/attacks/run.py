"""Run the attacks of this folder, serially or under mpirun, and say what they end in.

    python3 tests/attacks/run.py             # all
    python3 tests/attacks/run.py a01 b02     # scripts whose names begin so
    python3 tests/attacks/run.py --sample    # of every group the first that does not take long
    mpirun -n 2 python3 tests/attacks/run.py

It fails where an attack is WRONG, or where an honest twin is REFUSED or WRONG.
"""

from __future__ import annotations

import argparse
import faulthandler
import importlib
import sys
from collections import Counter
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parents[1])]

from judge import REFUSED, RIGHT, SAID, WRONG, judged  # noqa: E402

_SECONDS = 180  # that one attack may take before the run is aborted with its traceback
_LONG = ("b02_fibre_pulled_out",)  # half a minute, as much as all others of a sample
_TOOLS = ("bodies", "flying", "judge", "recorded", "rings", "run")


def scripts(names: list[str], sample: bool) -> list[str]:
    """Names of the scripts to run, in order; a group is what stands before the first underscore."""
    found = sorted(p.stem for p in HERE.glob("*.py") if p.stem not in _TOOLS)
    if names:
        found = [f for f in found if f.startswith(tuple(names))]
    if sample:
        firsts: dict[str, str] = {}
        for name in (f for f in found if f not in _LONG):
            firsts.setdefault(name.partition("_")[0], name)
        found = list(firsts.values())
    return found


def main() -> int:
    """Run what is asked for; the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", help="beginnings of the names of scripts")
    parser.add_argument("--sample", action="store_true", help="one of every group alone")
    options, _ = parser.parse_known_args()
    comm = MPI.COMM_WORLD
    counts: dict[str, Counter[str]] = {"attack": Counter(), "honest": Counter()}
    bad = []
    for name in scripts(options.names, options.sample):
        module = importlib.import_module(name)
        for kind in counts:
            if not hasattr(module, kind):
                continue
            faulthandler.dump_traceback_later(_SECONDS, exit=True)
            word, why, seconds = judged(getattr(module, kind), comm)
            faulthandler.cancel_dump_traceback_later()
            _clear_options()
            counts[kind][word] += 1
            if word == WRONG or (kind == "honest" and word == REFUSED):
                bad.append(name)
            _tell(comm, f"{word:8}{name}{' (honest)' if kind == 'honest' else ''}", why, seconds)
    for kind, found in counts.items():
        words = ", ".join(f"{w} {found[w]}" for w in (RIGHT, REFUSED, SAID, WRONG))
        _tell(comm, f"{kind}: {sum(found.values())} scripts: {words}")
    _tell(
        comm,
        f"{sum(sum(c.values()) for c in counts.values()) - len(bad)} passed, {len(bad)} failed",
    )
    return int(bool(bad))


def _tell(comm: MPI.Comm, text: str, why: str = "", seconds: float | None = None) -> None:
    if comm.rank:
        return
    took = "" if seconds is None else f" {seconds:.1f} s"
    shown = why if text.startswith(WRONG) else " ".join(why.split())[:160]
    print(f"{text}{took}{f': {shown}' if shown else ''}", flush=True)


def _clear_options() -> None:
    options = PETSc.Options()
    for key in options.getAll():
        options.delValue(key)


if __name__ == "__main__":
    sys.exit(main())
