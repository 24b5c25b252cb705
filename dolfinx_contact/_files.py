# SPDX-License-Identifier: LGPL-3.0-or-later
"""Atomic writing: a file is written under a temporary name and renamed when it is complete."""

from __future__ import annotations

import errno
import os
import re
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["os_error", "part_of", "sync"]


@contextmanager
def part_of(file: Path) -> Iterator[Path]:
    """Context manager that provides a temporary file, which replaces ``file`` on exit.

    The temporary file is hidden and in the same folder. Not collective.

    Args:
        file: path of the final file.

    Raises:
        OSError: with the path, if the file cannot be written; an existing file is then unchanged.
    """
    part = file.with_name(f".{file.stem}.{uuid.uuid4().hex}{file.suffix}")
    try:
        yield part
        sync(part)
        part.replace(file)
    except OSError as error:
        raise os_error(error, file) from error
    finally:
        part.unlink(missing_ok=True)


def os_error(error: Exception, path: Path) -> OSError:
    """Return an ``OSError`` for an error of a library that failed to write ``path``."""
    if isinstance(error, OSError) and error.errno is not None:
        return OSError(error.errno, error.strerror, str(path))
    found = re.search(r"errno = (\d+)", str(error))  # in messages of ADIOS2
    number = int(found[1]) if found else errno.EIO
    reason = os.strerror(number) if found else f"{os.strerror(number)} ({error})"
    return OSError(number, reason, str(path))


def sync(path: Path) -> None:
    """Flush a file, or the list of entries of a folder, to disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
