# SPDX-License-Identifier: LGPL-3.0-or-later
"""A recorded branch for ParaView, as a series of its deformed states.

The series is written from the checkpoints after the branch was followed, so that a killed run does
not leave an incomplete series.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dolfinx import fem

from dolfinx_contact._mpi import same_everywhere
from dolfinx_contact.io.disk import aside
from dolfinx_contact.io.fields import Face, faces, state_fields
from dolfinx_contact.io.folder import output_folder
from dolfinx_contact.io.script import write_script
from dolfinx_contact.io.writers import FieldSeries, FieldsOfFile, Format, checked_format
from dolfinx_contact.records.branch_record import BranchRecord

__all__ = ["write_series"]


def write_series(
    folder: str | os.PathLike[str],
    record: BranchRecord,
    branch: int = 0,
    *,
    format: Format = None,
) -> list[Path]:
    """Write the points of a branch with checkpoints, for ParaView. Collective.

    - ``branch_0000_body.bp``: displacement of the bodies.
    - ``branch_0000_contact.bp`` or ``branch_0000_contact_NAME.bp``: fields of a contact surface,
      and gamma, which is equal at all nodes; ``..._opposite.bp``: fields of the master of a pair.
    - ``paraview.py``: a script that shows them, ``paraview --script=FOLDER/paraview.py``.

    With ``format="vtk"`` the files are ``branch_0000_body.pvd`` with a ``.vtu`` of each point,
    and so on. The time of the series is the index of the point in the journal, because gamma may
    turn back along a branch.

    Args:
        folder: folder of the files, created if necessary. Older files are replaced when the series
            is complete.
        record: record of the branch; the Functions of its problem change with the points.
        branch: number of the branch.
        format: "vtx" (``.bp``) or "vtk" (``.pvd``); by default as in `write_fields`.

    Returns:
        Names of the files, on every rank.

    Raises:
        OSError: on every rank, with the path and the reason, if the folder cannot be written to,
            or has no room. The folder is then unchanged.
        ValueError: on every rank, if the branch has no checkpoints, they are damaged, the format
            cannot be written, or arguments differ between ranks.
    """
    problem = record.system.problem
    comm = record.comm
    same_everywhere(comm, branch=branch)
    known = record.journal.branches.get(branch)
    kept = known.kept if known else []
    if not kept:
        raise ValueError(f"no fields of branch {branch} were kept in {record.folder}")
    kind = checked_format(comm, format)
    path = output_folder(comm, folder)
    on_faces = faces(problem)
    with aside(comm, path, "write_series") as part:
        written = FieldSeries(part, path, kind)
        try:
            for index in kept:
                written.write(float(index), _fields(record, on_faces, branch, index))
        finally:
            written.close()
        write_script(comm, part, path)
    return written.files


def _fields(
    record: BranchRecord, on_faces: Sequence[Face], branch: int, index: int
) -> list[FieldsOfFile]:
    """Return the fields of all files at a recorded point, on faces with gamma. Collective."""
    system = record.system
    point, _ = record.state(branch, index)
    x = system.create_vector()
    x.array[:] = point.y.array_r[: x.getLocalSize()]
    system.put(x, point.gamma, point.piece)
    for v in (x, point.y, point.tangent):
        v.destroy()
    body, *others = state_fields(system.problem, on_faces, prefix=f"branch_{branch:04d}_")
    found = [body]
    for fields in others:
        pressure = next(f for f in fields.functions if f.name == "pressure")
        gamma = fem.Function(pressure.function_space, name="gamma")
        gamma.x.array[:] = point.gamma
        found.append(replace(fields, functions=[*fields.functions, gamma]))
    return found
