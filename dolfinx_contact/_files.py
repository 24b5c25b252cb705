# SPDX-License-Identifier: LGPL-3.0-or-later
"""A file that is whole or not there: written beside its place, and renamed when it is complete."""

from __future__ import annotations

import errno
import os
import re
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["hidden_beside", "os_error", "part_of", "sync"]


def hidden_beside(file: Path) -> Path:
    """A hidden name in the folder of ``file``, of the same suffix, that no other file has."""
    return file.with_name(f".{file.stem}.{uuid.uuid4().hex}{file.suffix}")


@contextmanager
def part_of(file: Path) -> Iterator[Path]:
    """A hidden file beside ``file`` that takes its place at the end.

    On this rank alone.

    Raises:
        OSError: with the path, if it cannot be written; ``file`` is then as it was.
    """
    part = hidden_beside(file)
    try:
        yield part
        sync(part)
        part.replace(file)
    except OSError as error:
        raise os_error(error, file) from error
    finally:
        part.unlink(missing_ok=True)


def os_error(error: Exception, path: Path) -> OSError:
    """The error of a library that could not write ``path``, as ``OSError`` with path and reason."""
    if isinstance(error, OSError) and error.errno is not None:
        return OSError(error.errno, error.strerror, str(path))
    found = re.search(r"errno = (\d+)", str(error))  # in messages of ADIOS2
    number = int(found[1]) if found else errno.EIO
    reason = os.strerror(number) if found else f"{os.strerror(number)} ({error})"
    return OSError(number, reason, str(path))


def sync(path: Path) -> None:
    """Put a file, or the entries of a folder, on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
