# SPDX-License-Identifier: LGPL-3.0-or-later
"""A recorded branch for ParaView: its deformed states one after the other.

The series is written from the checkpoints once the branch has been followed, so that a run that is
killed leaves no half of a series behind.
"""

from __future__ import annotations

import os
from pathlib import Path

from dolfinx import fem

from dolfinx_contact._compat import FunctionSeries
from dolfinx_contact.output.fields import contact_fields, file_stems
from dolfinx_contact.output.folder import output_folder
from dolfinx_contact.output.record import BranchRecord

__all__ = ["write_series"]


def write_series(
    folder: str | os.PathLike[str], record: BranchRecord, branch: int = 0
) -> list[Path]:
    """Write the points of a branch whose fields were kept, for ParaView. Collective.

    ``branch_0000_body.bp`` holds the displacement, ``branch_0000_contact.bp`` (or
    ``branch_0000_contact_NAME.bp``) the fields of a contact surface, and gamma, which is the same
    at all its nodes; ``.pvd`` where DOLFINx was built without ADIOS2. gamma may go back along a
    branch, so that the time of the series is the index of the point in the journal.

    Args:
        folder: where to, made if need be.
        record: whose problem's Functions follow the points.
        branch: number of the branch.

    Returns:
        The names of the files, on every rank.

    Raises:
        OSError: on every rank, if the folder cannot be written to.
        ValueError: on every rank, if no fields of the branch were kept or they are damaged.
    """
    system, problem = record.system, record.system.problem
    known = record.journal.branches.get(branch)
    kept = [p["index"] for p in known.points if "checkpoint" in p] if known else []
    if not kept:
        raise ValueError(f"no fields of branch {branch} were kept in {record.folder}")
    path, stem = output_folder(record.comm, folder), f"branch_{branch:04d}_"
    series = [FunctionSeries(record.comm, path / f"{stem}body", [problem.u])]
    shown: list[dict[str, fem.Function]] = []
    try:
        for index in kept:
            point, _ = record.state(branch, index)
            x = system.create_vector()
            x.array[:] = point.y.array_r[: x.getLocalSize()]
            system.put(x, point.gamma, point.piece)
            for v in (x, point.y, point.tangent):
                v.destroy()
            for i, s in enumerate(problem.surfaces):
                fields = contact_fields(problem, s)
                gamma = fem.Function(s.vertices, name="gamma")
                gamma.x.array[:] = point.gamma
                fields["gamma"] = gamma
                if i == len(shown):  # the Functions of the first point are those of the series
                    shown.append(fields)
                    name = path / (stem + file_stems(problem)[i])
                    comm = s.submesh.mesh.comm
                    series.append(FunctionSeries(comm, name, list(fields.values())))
                for key, f in fields.items():
                    shown[i][key].x.array[:] = f.x.array
            for each in series:
                each.write(float(index))
    finally:
        for each in series:
            each.close()
    record.comm.barrier()
    return [each.file for each in series]
