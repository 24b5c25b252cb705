# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc options by prefix, with the command line winning."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

from petsc4py import PETSc

__all__ = ["logged", "options_in_database", "parse_arguments", "require_real", "staged"]


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


def half_of(A: PETSc.Mat) -> PETSc.Mat:
    """The symmetric AIJ matrix ``A`` stored as blocks on and above its diagonal. Collective.

    Its products take 0.4 to 0.65 times as long; it is made in the time of 20 to 35 of them.
    """
    A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return A.convert("sbaij", PETSc.Mat())


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
