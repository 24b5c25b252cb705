# SPDX-License-Identifier: LGPL-3.0-or-later
"""Recorded branch as a series of deformed states for ParaView.

The series is written from checkpoints, after the branch has been followed, so that an interrupted
run does not leave an incomplete series.
"""

from __future__ import annotations

import os
from pathlib import Path

from dolfinx import fem

from dolfinx_contact._mpi import same_everywhere
from dolfinx_contact.io.fields import StateFields
from dolfinx_contact.io.writers import Format, Writer
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
      and gamma, which is equal at all nodes.
    - ``paraview.py``: a script that shows them, ``paraview --script=FOLDER/paraview.py``.

    With ``format="vtk"`` the files are ``branch_0000_body.pvd`` with one ``.vtu`` per point, and so
    on. The time of the series is the index of the point in the journal, because gamma may turn back
    along a branch.

    Args:
        folder: folder of the files, created if necessary. Older files are replaced when the series
            is complete.
        record: record of the branch; the Functions of its problem are overwritten by the points.
        branch: number of the branch in the record.
        format: "vtx" (``.bp``) or "vtk" (``.pvd``); by default as in `write_fields`.

    Returns:
        Paths of the files, on every rank.

    Raises:
        OSError: on every rank, with the path and the reason, if the folder cannot be written to or
            the disk is full. The folder is then unchanged.
        ValueError: on every rank, if the branch has no checkpoints, if a checkpoint is damaged, if
            the format cannot be written, or if arguments differ between ranks.
    """
    system = record.system
    same_everywhere(record.comm, branch=branch)
    known = record.journal.branches.get(branch)
    kept = known.kept if known else []
    if not kept:
        raise ValueError(f"branch {branch} has no checkpoints in {record.folder}")
    fields = StateFields(system.problem)
    with Writer(record.comm, folder, format, f"branch_{branch:04d}_") as writer:
        for index in kept:
            point, _ = record.state(branch, index)
            x = system.create_vector()
            x.array[:] = point.y.array_r[: x.getLocalSize()]
            system.put(x, point.gamma, point.piece)
            shown = fields.at(system.problem)
            for stem, functions in shown.items():
                if "contact" in stem:
                    W = next(f for f in functions if f.name == "pressure").function_space
                    gamma = fem.Function(W, name="gamma")
                    gamma.x.array[:] = point.gamma
                    functions.append(gamma)
            writer.write(float(index), shown)
            for v in (x, point.y, point.tangent):
                v.destroy()
    return writer.files
