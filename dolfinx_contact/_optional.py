# SPDX-License-Identifier: LGPL-3.0-or-later
"""Packages that only parts of the library need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["optional", "slepc"]


def optional(package: str, extra: str, *, in_debian: bool = True) -> Any:
    """Import a package or one of its modules.

    Args:
        package: its name, with dots where a module is wanted.
        extra: of this distribution, that has it.
        in_debian: whether the package of Debian will do.

    Raises:
        ModuleNotFoundError: naming the package and the extra, if it is not installed.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        name = package.partition(".")[0]
        if error.name != name:  # it is there, and lacks something itself
            raise
        other = f", or python3-{name} of Debian" if in_debian else ""
        raise ModuleNotFoundError(
            f"{name} is not installed: python3 -m pip install 'signorini-coulomb[{extra}]'{other}",
            name=name,
        ) from None


def slepc() -> Any:
    """The module of slepc4py, which is built beside petsc4py.

    Raises:
        ModuleNotFoundError: if it is not installed.
    """
    try:
        from slepc4py import SLEPc
    except ModuleNotFoundError as error:
        message = "slepc4py is not installed beside petsc4py: python3-slepc4py of Debian, or conda"
        raise ModuleNotFoundError(message, name=error.name) from None
    return SLEPc
