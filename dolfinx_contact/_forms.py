# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled UFL, found again in a time that does not grow with what else was compiled before.

A look-up in FFCx's cache lists its folder, which on a machine in use holds thousands of files.
Here the cache has a folder for every first two letters of a signature.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem, jit
from ufl.domain import extract_unique_domain

from dolfinx_contact._errors import everywhere

__all__ = ["compiled_expression", "compiled_form"]


def compiled_form(form: ufl.Form, entity_maps: Any = None) -> fem.Form:
    """A form, compiled. Collective.

    Args:
        form: UFL.
        entity_maps: of submeshes that occur in it.
    """
    maps = {} if entity_maps is None else {"entity_maps": entity_maps}
    (domain,) = form.subdomain_data()
    with _compiler_named(domain.ufl_cargo().comm):
        return fem.form(form, jit_options=_folder(form.signature()[:2]), **maps)


def compiled_expression(
    e: Any, points: npt.NDArray[np.float64], comm: MPI.Comm | None = None
) -> fem.Expression:
    """An expression at points of the reference cell, compiled once for all ranks. Collective.

    Args:
        e: UFL.
        points: of the reference cell.
        comm: of the ranks, by default those of the mesh.
    """
    with _compiler_named(comm or extract_unique_domain(e).ufl_cargo().comm):
        return fem.Expression(e, points, comm=comm, jit_options=_folder("expressions"))


@contextmanager
def _compiler_named(comm: MPI.Comm) -> Iterator[None]:
    """Say on every rank what FFCx needs where its C is not compiled. Collective."""
    # Rank 0 compiles, and only there is known what has failed.
    with everywhere(comm, "compiling a form"):
        try:
            yield
        except Exception as error:
            kinds = ("CompileError", "LinkError", "PlatformError")  # in messages of cffi
            if not any(kind in str(error) for kind in kinds):
                raise
            raise RuntimeError(
                "FFCx could not compile a form. It needs a C compiler (gcc, or the one that CC "
                "names) and the headers of Python (Python.h): apt install gcc libc6-dev "
                f"python3-dev, or conda install c-compiler. The error was: {error}"
            ) from error


def _folder(name: str) -> dict[str, Any]:
    cache: Path = jit.get_options()["cache_dir"]
    return {"cache_dir": cache / "dolfinx_contact" / name}
