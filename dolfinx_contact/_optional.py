# SPDX-License-Identifier: LGPL-3.0-or-later
"""Packages that only parts of the library need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["optional"]


def optional(package: str, extra: str) -> Any:
    """Import a package or one of its modules.

    Args:
        package: its name, with dots where a module is wanted.
        extra: of this distribution, that has it.

    Raises:
        ModuleNotFoundError: naming the package and the extra, if it is not installed.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        name = package.partition(".")[0]
        if error.name != name:  # it is there, and lacks something itself
            raise
        raise ModuleNotFoundError(
            f"{name} is not installed: python3 -m pip install 'signorini-coulomb[{extra}]', or "
            f"python3-{name} of Debian",
            name=name,
        ) from None
