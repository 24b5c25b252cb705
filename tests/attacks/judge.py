"""What an attack on the package ends in: RIGHT, REFUSED, SAID or WRONG.

An attack is a script of this folder with a function ``attack(case)`` that puts data to the package
for which an assumption inside it may not hold, and compares what comes out with a closed form or
with numbers of its own. Many have a twin, ``honest(case)``: the same script with data that are
legal beyond doubt, which must not be refused.

- RIGHT: every comparison holds.
- REFUSED: the package raised an error of the kinds below; an error in the script's own code, such
  as a TypeError, is WRONG.
- SAID: a comparison fails, and the package said so: by a warning whose text the script expects
  (`Case.warned`), by an answer that promises nothing (`Case.unpromised`), or because the problem
  was not solved (ConvergenceError).
- WRONG: a comparison fails and nothing was said; or another exception, a hang, a crash; or
  another ending on another rank.
"""

from __future__ import annotations

import logging
import re
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI

import numpy as np

from dolfinx_contact import ConvergenceError

RIGHT = "RIGHT"
REFUSED = "REFUSED"
SAID = "SAID"
WRONG = "WRONG"
#: What a refusal is raised as: bad data, or an attribute that cannot be set.
REFUSALS = (ValueError, AttributeError)


@dataclass
class Case:
    """One run of a script: what it compares, and what the package has said meanwhile."""

    comm: MPI.Comm
    off: list[str] = field(default_factory=list)
    compared: int = 0
    warnings: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def equal(self, what: str, found: Any, expected: Any, tolerance: float = 1e-6) -> None:
        """Compare numbers: off by at most ``tolerance`` of the largest that is expected.

        Args:
            what: is compared, in words.
            found: by the package, of any shape.
            expected: of the same shape.
            tolerance: relative to the largest |expected|; absolute where all are zero.
        """
        self.compared += 1
        found = np.asarray(found, dtype=float)
        expected = np.asarray(expected, dtype=float)
        if found.shape != expected.shape:
            self.off.append(f"{what}: shape {found.shape} instead of {expected.shape}")
            return
        size = float(np.max(np.abs(expected), initial=0.0)) or 1.0
        error = float(np.max(np.abs(found - expected), initial=0.0)) / size
        if not error <= tolerance:
            self.off.append(f"{what}: {_short(found)} instead of {_short(expected)}")

    def true(self, what: str, holds: Any) -> None:
        """State what must hold."""
        self.compared += 1
        if not holds:
            self.off.append(f"{what} does not hold")

    def warned(self, pattern: str) -> bool:
        """Take note if the package has warned in words that match; whether it has. Collective."""
        mine = [w for w in self.warnings if re.search(pattern, w, re.IGNORECASE)]
        texts = [t for part in self.comm.allgather(mine) for t in part]
        if texts:
            self.doubts.append(f"warning: {texts[0]}")
        return bool(texts)

    def unpromised(self, what: str, holds: Any) -> None:
        """Take note of an answer that promises nothing, such as ``complete`` that is False."""
        if holds:
            self.doubts.append(what)


class _Listener(logging.Handler):
    def __init__(self, texts: list[str]):
        super().__init__(logging.WARNING)
        self._texts = texts

    def emit(self, record: logging.LogRecord) -> None:
        self._texts.append(record.getMessage())


def judged(do: Callable[[Case], None], comm: MPI.Comm) -> tuple[str, str, float]:
    """Run one attack: its verdict, why, and the seconds that it took. Collective."""
    case = Case(comm)
    listener = _Listener(case.warnings)
    log = logging.getLogger("dolfinx_contact")
    log.addHandler(listener)
    start = time.monotonic()
    try:
        do(case)
    except ConvergenceError as error:
        word = SAID
        why = f"not solved: {error}"
    except REFUSALS as error:
        word, why = (REFUSED, str(error)) if _of_the_package(error) else (WRONG, _trace(error))
    except Exception as error:
        word = WRONG
        why = _trace(error)
    else:
        word, why = _word(case)
    finally:
        log.removeHandler(listener)
    if word == REFUSED and case.off and not case.doubts:  # a wrong number came before the refusal
        word, why = _word(case)
    seconds = time.monotonic() - start
    words = comm.allgather(word)
    if len(set(words)) > 1:
        return WRONG, f"differs between ranks: {words}; {comm.allgather(why)}", seconds
    return word, why, seconds


def _word(case: Case) -> tuple[str, str]:
    if not case.compared:
        return WRONG, "the script compares nothing"
    if not case.off:
        return RIGHT, ""
    if case.doubts:
        return SAID, f"{case.doubts[0]} ({case.off[0]})"
    return WRONG, "; ".join(case.off)


def _of_the_package(error: BaseException) -> bool:
    """Whether the package itself raised an error, in words: no slip of its code or the script's."""
    if "has no attribute" in str(error):
        return False
    frames = traceback.extract_tb(error.__traceback__)
    return "dolfinx_contact" in frames[-1].filename.rsplit("tests", 1)[-1]


def _trace(error: BaseException) -> str:
    return "".join(traceback.format_exception(error)[-3:]).strip()


def _short(values: np.ndarray) -> str:
    return np.array2string(values.ravel()[:4], precision=8)
