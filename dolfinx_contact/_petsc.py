# SPDX-License-Identifier: LGPL-3.0-or-later
"""PETSc options by prefix, with the command line winning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

__all__ = ["options_in_database", "require_real"]


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


def require_real() -> None:
    """Raise ``RuntimeError`` if PETSc was built with complex scalars."""
    if not issubclass(PETSc.ScalarType, float):
        raise RuntimeError(
            "dolfinx_contact needs PETSc with real scalars, and this one has complex scalars. "
            "On Debian install python3-dolfinx-real and set PETSC_DIR to the real build."
        )
