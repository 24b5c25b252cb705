# SPDX-License-Identifier: LGPL-3.0-or-later
"""Array files of a record: NumPy ``npz`` files, one for each point that stores arrays.

A file is written under a hidden name and renamed after it has been flushed to disk. The journal
stores the fingerprint of every file, which is a checksum of the names, sizes and CRCs of its
arrays. A replaced file is therefore detected without reading its arrays; a corrupt array is
detected when it is read.
"""

from __future__ import annotations

import io
import os
import zipfile
import zlib
from pathlib import Path

import numpy as np

from dolfinx_contact._files import part_of, sync
from dolfinx_contact.results.outer_surface import Arrays

__all__ = ["DamagedFile", "check", "load", "save"]

# A damaged table of contents may name a negative position (OSError) or a password (RuntimeError).
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError, OSError)


class DamagedFile(ValueError):
    """Error raised if a file of a record is missing, corrupt or replaced."""


def save(file: Path, arrays: Arrays) -> str:
    """Write arrays to a file and return its fingerprint. Call it on one rank.

    Raises:
        OSError: with the path, if the file cannot be written; an existing file is left unchanged.
    """
    with part_of(file) as part:
        np.savez(part, **arrays)  # type: ignore[arg-type]
        checksum = fingerprint(part)
    sync(file.parent)
    return checksum


def load(file: Path, recorded: str) -> Arrays:
    """Read the arrays of a file. Call it on one rank.

    Args:
        file: path of the file.
        recorded: fingerprint that is stored in the journal.

    Raises:
        DamagedFile: if the file is missing or corrupt, or has a different fingerprint.
    """
    check(file, recorded)
    try:
        with zipfile.ZipFile(file) as content:
            # Reading a whole member verifies its CRC. np.load(file) reads as many bytes as the head
            # of the array requires, which are fewer if the head is damaged.
            members = {name: content.read(name) for name in content.namelist()}
            return {
                name.removesuffix(".npy"): np.load(io.BytesIO(data), allow_pickle=False)
                for name, data in members.items()
            }
    except _DAMAGE as error:
        raise DamagedFile(f"{file} is damaged: {error}") from None


def check(file: Path, recorded: str) -> None:
    """Raise `DamagedFile` if a file is missing or its fingerprint is not ``recorded``.

    Call it on one rank.
    """
    if not file.is_file():
        raise DamagedFile(f"{file} is missing")
    try:
        now = fingerprint(file)
    except _DAMAGE as error:
        raise DamagedFile(f"{file} is damaged: {error}") from None
    if now != recorded:
        raise DamagedFile(f"{file} is damaged or was replaced")


def fingerprint(file: Path | str | os.PathLike[str]) -> str:
    """Return a checksum of the names, sizes and CRCs of the arrays in a file."""
    with zipfile.ZipFile(file) as content:
        parts = [f"{i.filename} {i.file_size} {i.CRC:08x}" for i in content.infolist()]
    return f"{zlib.crc32('; '.join(parts).encode()):08x}"
