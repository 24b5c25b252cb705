# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spence's problem: a rigid sphere is pressed onto an elastic half-space with friction.

CONTACT's example `spence35` (open-source version, revision 2707): an elastic half-space with G =
0.5 and nu = 0, a rigid paraboloid of curvature 0.004116/mm (radius 121.48 mm), friction 0.2986,
and 35 steps in which the contact radius grows to 3.5 mm. Its last step, with square elements of
0.2 mm, has the normal force 0.4705, the approach 0.09874 mm, the largest pressure 0.02392, and
225 sticking elements of 921 in contact: the radius of the stick zone over that of the contact,
c/a, is 0.494.

This is a history: without the memory of slip the stick zone would be different. The body is a
quarter of a disc of radius `--size`, whose round edge is clamped; this shortens the approach by
about F (1 - nu^2) / (pi E size).

    python3 benchmarks/public/spence.py --output spence.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import default_scalar_type, fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.materials import Axisymmetric, LinearElastic
from dolfinx_contact.meshing import mesh_from_gmsh

COMM = MPI.COMM_WORLD
RADIUS = 0.5 / 0.004116
FRICTION = 0.2986
YOUNG = 1.0
APPROACH = 0.09874
STEPS = 35
#: Radius of the part of the surface that may touch the sphere, in mm.
FACE = 4.2
#: Results of CONTACT in the last step.
REFERENCE = {"force": 0.4705, "pressure": 0.02392, "ratio": (225 / 921) ** 0.5}


def half_space(h, size):
    """Quarter of a disc in the plane (r, z), with cells of size h at its contact face."""
    occ = gmsh.model.occ
    field = gmsh.model.mesh.field
    centre = occ.addPoint(0, 0, 0)
    rim = occ.addPoint(FACE, 0, 0)
    edge = occ.addPoint(size, 0, 0)
    bottom = occ.addPoint(0, -size, 0)
    face = occ.addLine(centre, rim)
    free = occ.addLine(rim, edge)
    arc = occ.addCircleArc(edge, centre, bottom)
    axis = occ.addLine(bottom, centre)
    body = occ.addPlaneSurface([occ.addCurveLoop([face, free, arc, axis])])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [body], name="body")
    for name, curve in (("face", face), ("far", arc), ("axis", axis)):
        gmsh.model.addPhysicalGroup(1, [curve], name=name)
    gmsh.model.mesh.setTransfiniteCurve(face, round(FACE / h) + 1)
    distance = field.add("Distance")
    field.setNumbers(distance, "CurvesList", [face])
    field.setNumber(distance, "Sampling", 400)
    growth = field.add("MathEval")
    field.setString(growth, "F", f"{h} + 0.1 * F{distance}")
    field.setAsBackgroundMesh(growth)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.model.mesh.generate(2)


def run(h, size, steps=STEPS):
    """Results of the last step, and their differences from CONTACT relative to its values."""
    body = mesh_from_gmsh(COMM, lambda: half_space(h, size))
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    approach = fem.Constant(body.mesh, default_scalar_type(0.0))
    r = ufl.SpatialCoordinate(body.mesh)[0]
    # As in CONTACT each point has a horizontal plane at the height of the paraboloid.
    height = r**2 / (2 * RADIUS) - approach
    paraboloid = HalfSpace(point=ufl.as_vector((0, height)), normal=(0, -1))
    surface = ContactSurface(
        u, body, tag="face", obstacle=paraboloid, law=Coulomb(FRICTION), axisymmetric=True
    )
    radial = V.sub(0)
    bcs = [
        fem.dirichletbc(np.zeros(2), body.dofs(V, "far"), V),
        fem.dirichletbc(0.0, body.dofs(radial, "axis"), radial),
    ]
    material = Axisymmetric(LinearElastic.from_young(YOUNG, 0.0))
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=bcs)

    def load(t):
        approach.value = APPROACH * t**2

    history = QuasiStatic(problem, load).run(np.linspace(0.0, 1.0, steps + 1)[1:])
    result = history.steps[-1].result
    (table,) = result.tables.values()
    r = table.x[:, 0]
    touching = table.pressure > 0
    sticking = table.letters == "k"
    force = float(abs(table.force[:, 1].sum()))
    contact = r[touching].max() + h / 2
    stick = r[sticking].max() + h / 2
    found = {
        "force": force,
        "pressure": float(table.pressure.max()),
        "ratio": float(stick / contact),
    }
    record = {"h": h, "size": size, "unknowns": result.dofs, "contact_radius": float(contact)}
    for name, value in found.items():
        record[name] = value
        record[f"{name}_error"] = value / REFERENCE[name] - 1
    record["approach_correction"] = force / (np.pi * YOUNG * size) / APPROACH
    return record


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--levels", nargs="+", type=float, default=[0.1, 0.05, 0.025])
    parser.add_argument("--size", type=float, default=400.0, help="radius of the body, in mm")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args(argv)
    records = []
    for h in args.levels:
        records.append(run(h, args.size))
        if COMM.rank == 0:
            print(", ".join(f"{key} {value:.5g}" for key, value in records[-1].items()), flush=True)
    if args.output and COMM.rank == 0:
        args.output.write_text(json.dumps(records, indent=1))
    return records


if __name__ == "__main__":
    main()
