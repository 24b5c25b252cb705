# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc options by prefix, with the command line winning."""

from __future__ import annotations

import argparse
import ctypes
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

from petsc4py import PETSc

__all__ = [
    "as_raised",
    "forget_product",
    "half_of",
    "has_package",
    "logged",
    "options_in_database",
    "parse_arguments",
    "require_real",
    "staged",
]

#: PETSc's codes for what it does not support, does not know, or was built without, and for numbers
#: out of their range or that do not go together.
_NO_SUCH_THING = (56, 62, 63, 83, 86, 92)


def parse_arguments(
    parser: argparse.ArgumentParser, argv: Sequence[str] | None = None
) -> argparse.Namespace:
    """Parse a script's command line, leaving PETSc's options to PETSc.

    Words that the parser does not know and that begin with one dash, such as
    ``-contact_snes_monitor``, go to PETSc's database with their values; others are an error. With
    ``-log_view`` logging begins here, since PETSc has been initialised without these words.

    Args:
        parser: knows the options of the script.
        argv: words, by default those of the command line.
    """
    args, rest = parser.parse_known_args(argv)
    if rest and (rest[0][0] != "-" or any(word.startswith("--") for word in rest)):
        parser.error(f"unknown options: {' '.join(rest)}")
    database = PETSc.Options()
    for word, value in pairwise([*rest, "-"]):
        if word.startswith("-"):
            database.setValue(word[1:], "" if value.startswith("-") else value)
    if database.hasName("log_view") and not PETSc.Log.isActive():
        PETSc.Log.begin()
    return args


@contextmanager
def options_in_database(prefix: str, options: Mapping[str, Any]) -> Iterator[None]:
    """Keep ``options`` in PETSc's database under ``prefix`` while the context lasts.

    What is in the database already (the command line, PETSC_OPTIONS) wins.
    """
    database = PETSc.Options()
    mine = {prefix + k: v for k, v in options.items() if not database.hasName(prefix + k)}
    for key, value in mine.items():
        database.setValue(key, "" if value is None else value)
    try:
        yield
    finally:
        for key in mine:
            database.delValue(key)


@contextmanager
def as_raised() -> Iterator[None]:
    """Let exceptions that Python code raises inside PETSc come out as themselves.

    PETSc hands them on as an error of its own, "error code -1". The objects at work are not to be
    used again: their vectors may be locked.

    Raises:
        ValueError: for a kind of solver, or a use of one, that this PETSc does not know.
    """
    try:
        yield
    except PETSc.Error as error:
        cause: BaseException | None = error
        while isinstance(cause, PETSc.Error):
            cause = cause.__cause__
        if cause is not None:
            raise cause from cause.__cause__
        if error.ierr in _NO_SUCH_THING:
            raise ValueError(f"PETSc: {str(error).splitlines()[-1].partition('] ')[2]}") from error
        raise


def half_of(A: PETSc.Mat) -> PETSc.Mat:
    """The symmetric AIJ matrix ``A`` stored as blocks on and above its diagonal. Collective.

    Its products take 0.4 to 0.65 times as long; it is made in the time of 20 to 35 of them.
    """
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return A.convert("sbaij", PETSc.Mat())


def forget_product(A: PETSc.Mat) -> None:
    """Free what ``A``, a product of matrices, keeps to be made again: its factors. Collective."""
    library = ctypes.CDLL(PETSc.__file__)  # petsc4py has no name for it
    error = library.MatProductClear(ctypes.c_void_p(A.handle))
    if error:
        raise PETSc.Error(error)


def has_package(name: str) -> bool:
    """Whether PETSc was built with a package, as ``hypre``."""
    return bool(PETSc.Sys.hasExternalPackage(name))


def require_real() -> None:
    """Raise ``RuntimeError`` if PETSc was built with complex scalars."""
    if not issubclass(PETSc.ScalarType, float):
        raise RuntimeError(
            "dolfinx_contact needs PETSc with real scalars, and this one has complex scalars. "
            "On Debian install python3-dolfinx-real and set PETSC_DIR to the real build."
        )


@contextmanager
def logged(name: str) -> Iterator[None]:
    """Count the time and the flops of the context as an event of ``-log_view``."""
    event = PETSc.Log.Event(name)
    event.begin()
    try:
        yield
    finally:
        event.end()


@contextmanager
def staged(name: str) -> Iterator[None]:
    """Make the context a stage of ``-log_view``, or a part of one."""
    stage = PETSc.Log.Stage(name)
    stage.push()
    try:
        yield
    finally:
        stage.pop()
