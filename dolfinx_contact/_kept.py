# SPDX-License-Identifier: LGPL-3.0-or-later
"""Keep meshes alive until it is safe to free them.

DOLFINx frees the communicator of a mesh together with the mesh. mpi4py keeps a lock for every
communicator on which objects were sent, and acquires a global lock to discard it. If that happens
while an exception propagates, for example when `make_problem().solve(wrong)` drops the problem, the
global lock is never released: the next collective call of mpi4py on any communicator hangs. A kept
mesh is freed when a later one is kept, or after garbage collection, when no exception propagates.
"""

from __future__ import annotations

import atexit
import gc
import sys
from typing import Any

from petsc4py import PETSc

from dolfinx import mesh

__all__ = ["keep"]

#: C++ meshes, each with an index set that keeps the duplicate of its communicator in PETSc.
_kept: list[tuple[Any, PETSc.IS]] = []
_freeing = False
_ALONE = 2  # references to a mesh that nothing else uses: this list, and the call that counts


def keep(domain: mesh.Mesh) -> None:
    """Keep a mesh until nothing else uses it and it is safe to free it. Collective."""
    if _collected not in gc.callbacks:
        gc.callbacks.append(_collected)
    _free()
    held = domain._cpp_object
    if not any(other is held for other, _ in list(_kept)):
        _kept.append((held, PETSc.IS().createGeneral([], comm=domain.comm)))


def _free() -> None:
    """Free the meshes that nothing else uses.

    Python may collect garbage at any place of the loop, which calls this function again.
    """
    global _freeing
    if _freeing:
        return
    _freeing = True
    try:
        for k in reversed(range(len(_kept))):
            if sys.getrefcount(_kept[k][0]) <= _ALONE:
                held, of_petsc = _kept.pop(k)
                of_petsc.destroy()
                del held
    finally:
        _freeing = False


def _collected(phase: str, info: dict[str, int]) -> None:
    if phase == "stop":
        _free()


@atexit.register
def _end() -> None:
    _kept.clear()
    if _collected in gc.callbacks:
        gc.callbacks.remove(_collected)
