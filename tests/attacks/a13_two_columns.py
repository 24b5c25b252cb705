"""Stresses of a block of two materials side by side, in the file for ParaView.

With nu = 0 both columns are shortened by 1 % and carry E times that, 10 and 30; the stress of one
material alone would be 10 or 30 everywhere.
"""

import base64
import shutil
import tempfile
import xml.etree.ElementTree as ET
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from bodies import block, moves, refused

import ufl
from dolfinx import mesh

from dolfinx_contact import ContactProblem, ContactSurface, Frictionless, HalfSpace, io, materials

STEEL = materials.LinearElastic.from_young(1000.0, 0.0)
GLASS = materials.LinearElastic.from_young(3000.0, 0.0)


@contextmanager
def folder(comm):
    """A folder for a while, the same on every rank."""
    path = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
    try:
        yield Path(path)
    finally:
        comm.barrier()
        if comm.rank == 0:
            shutil.rmtree(path, ignore_errors=True)


def columns(comm, cells=(4, 2), size=(1.0, 1.0), **options):
    """A block pressed by 1 %, and the tags of its cells: 1 in the left half, 2 in the right."""
    body = block(comm, cells, size, **options)
    moves(body, *[0.0] * (len(cells) - 1), -0.01 * size[-1])
    dim = len(cells)
    left = mesh.locate_entities(body.domain, dim, lambda x: x[0] < 0.5 * size[0] + 1e-9)
    cells_here = body.domain.topology.index_map(dim).size_local
    cells_here += body.domain.topology.index_map(dim).num_ghosts
    values = np.full(cells_here, 2, dtype=np.int32)
    values[left] = 1
    return body, mesh.meshtags(body.domain, dim, np.arange(cells_here, dtype=np.int32), values)


def on_floor(body, bulk, **options):
    """The problem of a block on a floor without friction, solved."""
    dim = body.domain.geometry.dim
    floor = HalfSpace(point=np.zeros(dim), normal=np.eye(dim)[-1])
    contact = ContactSurface(body.u, body.bottom, obstacle=floor, law=Frictionless(), **options)
    problem = ContactProblem(bulk, body.u, [contact], bcs=body.bcs)
    problem.solve()
    return problem


def written(comm, problem, stress):
    """What ``write_fields`` writes: the centres of cells, and their stresses at every point."""
    with folder(comm) as path:
        io.write_fields(path, problem, stress=stress, format="vtk")
        comm.barrier()
        piece = ET.parse(path / "body_stress.vtu").getroot()[0][0]
    x = _array(piece, "Points").reshape(-1, 3)
    cells = np.split(_array(piece, "connectivity"), _array(piece, "offsets")[:-1])
    stresses = _array(piece, "stress").reshape(-1, 3, 3)
    return np.array([x[c].mean(axis=0) for c in cells]), np.array([stresses[c] for c in cells])


def _array(piece, name):
    data = next(d for d in piece.iter("DataArray") if d.get("Name") == name)
    kind = {"Float64": np.float64, "Int64": np.int64}[data.get("type")]
    return np.frombuffer(base64.b64decode(data.text)[8:], dtype=kind)


def compared(case, problem, stress, left, right, axis=1, middle=0.5):
    """Compare the stress along ``axis``, left and right of the middle, with numbers."""
    centres, stresses = written(case.comm, problem, stress)
    for side, here, value in (
        ("left", centres[:, 0] < middle, left),
        ("right", centres[:, 0] > middle, right),
    ):
        found = stresses[here]
        expected = np.zeros_like(found)
        expected[:, :, axis, axis] = value
        case.true(f"cells {side}", len(found))
        case.equal(f"stress {side}", found, expected)


def one_is_refused(case, problem, stress):
    """State that the stress of one material is refused, in words that help."""
    words = refused(lambda: written(case.comm, problem, stress))
    case.true("the stress of one material is refused", "one of each tag" in words)


def _pressed(case):
    body, tags = columns(case.comm, cell="quadrilateral")
    dx = ufl.Measure("dx", body.domain, subdomain_data=tags)
    return body, on_floor(body, STEEL.energy(body.u) * dx(1) + GLASS.energy(body.u) * dx(2))


def attack(case):
    body, problem = _pressed(case)
    compared(case, problem, STEEL.full_stress(body.u), -10.0, -30.0)


def honest(case):
    body, problem = _pressed(case)
    both = {1: STEEL.full_stress(body.u), 2: GLASS.full_stress(body.u)}
    compared(case, problem, both, -10.0, -30.0)
