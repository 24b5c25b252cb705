# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane fractures in an infinite body, as in the validation examples of GEOS.

`single`: a fracture of half-length b = 1 m is inclined by 20 degrees to a uniaxial compression of
100 MPa. It slips. The normal traction is -100 sin^2(20 degrees) MPa = -11.6978 MPa, and the slip
is 3.80785 mm sqrt(1 - s^2) at the distance s b from its centre (Phan, Napier, Gray and Kaplan,
Int. J. Numer. Meth. Engng 57, 2003, equations reproduced by GEOS: "Single Fracture Under Shear
Compression").

`intersection`: a vertical fracture of 100 m under an internal pressure of 100 MPa ends at the
centre of a horizontal fracture of 50 m, which the remote vertical stress of -100 MPa closes. The
horizontal fracture slips to both sides and opens near the intersection. The references are normal
traction, slip and aperture of Phan et al. by symmetric-Galerkin boundary elements, at the points
that GEOS tabulates ("Fracture Intersection Problem", read off a figure with about 0.3 % of the
largest value).

The remote stress is prescribed as the displacement of a uniform strain at the edges of a square,
`--reach` fracture lengths away from its centre; this changes the results by about 1 / reach^2.

    python3 benchmarks/public/fractures.py --output fractures.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack, mesh_from_gmsh

COMM = MPI.COMM_WORLD
FRICTION = np.tan(np.radians(30.0))

#: Distance from one end (m) and normal pressure (MPa), slip (mm) along the horizontal fracture, and
#: aperture (mm) along the vertical fracture from the intersection, by Phan et al. (2003).
PRESSURE = [(4.6756, 118.779), (8.5401, 118.2), (11.6412, 116.898), (14.3607, 114.149)]
PRESSURE += [(16.6508, 110.388), (18.5115, 105.324), (19.9427, 98.669), (21.2309, 90.422)]
PRESSURE += [(22.3282, 79.572), (23.2347, 65.828)]
SLIP = [(4.694, 2.975), (8.5532, 8.208), (11.7925, 13.962), (14.3643, 20.41), (16.6025, 26.856)]
SLIP += [(18.4594, 33.301), (20.0305, 39.049), (21.2203, 44.795), (22.315, 49.846)]
SLIP += [(23.552, 56.985)]
APERTURE = [(2.402, 149.54), (7.585, 182.635), (15.929, 220.94), (26.043, 253.728)]
APERTURE += [(33.375, 269.969)]
APERTURE += [(42.099, 280.388), (50.442, 282.227), (59.292, 275.485), (68.268, 260.47)]
APERTURE += [(80.025, 224.311), (90.898, 163.023)]


def lines_in_square(lines, reach, h, growth):
    """Mesh of a square with inner lines that become fractures; call it for gmsh.

    Args:
        lines: name to end points, shape (2, 2), in m.
        reach: half the edge of the square, in m.
        h: edge of the cells at the ends of the lines, in m.
        growth: increase of the edge of the cells with the distance from these points.
    """
    occ = gmsh.model.occ
    field = gmsh.model.mesh.field
    square = occ.addRectangle(-reach, -reach, 0, 2 * reach, 2 * reach)
    curves = [occ.addLine(*(occ.addPoint(*p, 0) for p in ends)) for ends in lines.values()]
    _, pieces = occ.fragment([(2, square)], [(1, c) for c in curves])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [tag for _, tag in pieces[0]], name="body")
    points = set()
    for name, parts in zip(lines, pieces[1:], strict=True):
        gmsh.model.addPhysicalGroup(1, [tag for _, tag in parts], name=name)
        points |= {tag for _, tag in gmsh.model.getBoundary(parts, combined=False)}
    distance = field.add("Distance")
    field.setNumbers(distance, "PointsList", sorted(points))
    size = field.add("MathEval")
    field.setString(size, "F", f"{h} + {growth} * F{distance}")
    field.setAsBackgroundMesh(size)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    gmsh.model.mesh.generate(2)


def pair(u, body, name, law):
    """Contact pair of the sides of a fracture."""
    return ContactPair(u, body, slave=name, master=f"{name}_opposite", law=law, name=name)


def compressed(body, moduli, stress, slipping, pressurised=None, pressure=0.0):
    """Contact problem of a body with fractures under a remote stress.

    Args:
        body: mesh with fractures.
        moduli: bulk and shear modulus, in Pa.
        stress: remote stress in the plane, shape (2, 2), in Pa.
        slipping: names of the fractures with friction.
        pressurised: name of the fracture under pressure; None for none.
        pressure: fluid pressure in it, in Pa.
    """
    K, G = moduli
    young = 9 * K * G / (3 * K + G)
    nu = young / (2 * G) - 1
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    strain = ((1 + nu) * stress - nu * (1 + nu) * np.trace(stress) * np.eye(2)) / young
    far = fem.Function(V)
    far.interpolate(lambda x: strain @ x[:2])
    reach = np.abs(body.mesh.geometry.x).max(initial=0.0)
    reach = COMM.allreduce(reach, op=MPI.MAX)
    edges = fem.locate_dofs_geometrical(V, lambda x: np.isclose(np.abs(x).max(axis=0), reach))
    energy = LinearElastic.from_young(young, nu).energy(u) * ufl.dx
    if pressurised:
        tags = [body.names[pressurised][1], body.names[f"{pressurised}_opposite"][1]]
        ds = ufl.Measure("ds", body.mesh, subdomain_data=body.facet_tags)
        energy += pressure * ufl.inner(u, ufl.FacetNormal(body.mesh)) * ds(tuple(tags))
    pairs = [pair(u, body, name, Coulomb(FRICTION)) for name in slipping]
    if pressurised:
        pairs.append(pair(u, body, pressurised, Frictionless()))
    problem = ContactProblem(energy, u, pairs, bcs=[fem.dirichletbc(far, edges)])
    return problem, young, nu


def single(h, reach, growth):
    """Errors of pressure and slip of the inclined fracture, relative to their largest values."""
    angle = np.radians(20.0)
    end = np.array([np.cos(angle), np.sin(angle)])
    body = mesh_from_gmsh(
        COMM, lambda: lines_in_square({"fracture": (-end, end)}, 2 * reach, h, growth)
    )
    problem, young, nu = compressed(
        crack(body, ["fracture"]), (50e9 / 3, 10e9), np.diag([-100e6, 0.0]), ["fracture"]
    )
    result = problem.solve()
    (table,) = result.tables.values()
    s = table.x[:, :2] @ end
    excess = np.sin(angle) * (np.cos(angle) - np.sin(angle) * FRICTION)
    largest = 4 * (1 - nu**2) / young * 100e6 * excess
    slip = np.linalg.norm(table.ut, axis=1)
    inner = np.abs(s) < 0.9
    normal = 100e6 * np.sin(angle) ** 2
    return {
        "unknowns": result.dofs,
        "slip_mm": 1e3 * largest,
        "slip_error": slip.max() / largest - 1,
        "slip_error_rms": rms(slip - largest * np.sqrt(np.maximum(1 - s**2, 0.0))) / largest,
        "pressure_MPa": 1e-6 * normal,
        "pressure_error": np.average(table.pressure[inner], weights=table.area[inner]) / normal - 1,
    }


def intersection(h, reach, growth):
    """Differences from the tables, relative to the largest value of each."""
    lines = {
        "horizontal": ((-25.0, 50.0), (25.0, 50.0)),
        "vertical": ((0.0, -50.0), (0.0, 50.0)),
    }
    body = mesh_from_gmsh(COMM, lambda: lines_in_square(lines, 100 * reach, 50 * h, growth))
    problem, _, _ = compressed(
        crack(body, list(lines)),
        (38.89e9, 29.17e9),
        np.diag([0.0, -100e6]),
        ["horizontal"],
        "vertical",
        100e6,
    )
    result = problem.solve()
    horizontal = result.tables["horizontal"]
    x = horizontal.x[:, 0]
    pressure = 1e-6 * horizontal.pressure
    slip = 1e3 * np.abs(horizontal.ut[:, 0])
    order = np.argsort(x)
    differences = {}
    for name, reference, values in (("pressure", PRESSURE, pressure), ("slip", SLIP, slip)):
        place, expected = np.array(reference).T
        # Both halves of the fracture have the same values by symmetry.
        ours = [np.interp(side * (place - 25.0), x[order], values[order]) for side in (1, -1)]
        differences[name] = (np.mean(ours, axis=0) - expected) / np.max(expected)
    vertical = result.tables["vertical"]
    order = np.argsort(vertical.x[:, 1])
    place, expected = np.array(APERTURE).T
    ours = np.interp(50.0 - place, vertical.x[order, 1], 1e3 * vertical.un[order])
    differences["aperture"] = (ours - expected) / np.max(expected)
    record = {"unknowns": result.dofs}
    for name, values in differences.items():
        record[f"{name}_rms"] = rms(values)
        record[f"{name}_largest"] = float(np.abs(values).max())
    return record


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--levels", nargs="+", type=float, default=[0.02, 0.01, 0.005])
    parser.add_argument("--reach", type=float, default=30.0, help="fracture lengths to the edge")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args(argv)
    runs = {"single": single, "intersection": intersection}
    records = {name: [] for name in runs}
    for h in args.levels:
        for name, run in runs.items():
            record = {"h": h, **run(h, args.reach, 2.5 * h)}
            records[name].append(record)
            if COMM.rank == 0:
                values = ", ".join(f"{key} {value:.4g}" for key, value in record.items())
                print(f"{name}: {values}", flush=True)
    if args.output and COMM.rank == 0:
        args.output.write_text(json.dumps(records, indent=1, default=float))
    return records


if __name__ == "__main__":
    main()
