# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of deep curved beams of Neto et al., as far as the beams are elastic.

A half ring with radii of 8 and 10 mm is moved horizontally over a half ring with radii of 10 and
12 mm, in plane strain; they touch at the start, and the vertical distance of their centres is 17 mm
(D. Neto, M. Oliveira, L. Menezes and J. Alves, Comput. Methods Appl. Mech. Engng 299, 2016,
E = 689.56 MPa, nu = 0.32, yield stress 31 MPa). The original beams are plastic. Here they are
hyperelastic, so that forces are comparable until the equivalent stress reaches the yield stress.

The reference is the reaction at the ends of the lower beam, in N per mm, as digitised by the
authors of solids4foam with an uncertainty of about 1 % of its peak (17.3 and 39.0 N with friction
0.3): `tutorials/solids/elastoplasticity/curvedBeams/verification/reference` of that repository.

    python3 benchmarks/public/curved_beams.py --output curved_beams.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb, Frictionless
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.meshing import join

COMM = MPI.COMM_WORLD
YOUNG = 689.56
POISSON = 0.32
YIELD = 31.0
FIXED, SLAVE, MASTER, MOVED = 1, 2, 3, 4
INNER, MIDDLE, OUTER, HEIGHT = 8.0, 10.0, 12.0, 17.0

#: Displacement (mm) and horizontal reaction (N), then displacement and vertical reaction (N).
REFERENCE = {
    0.0: (
        [(0.69451, -1.97347), (1.32907, -3.67860), (1.96382, -4.97427), (2.59866, -6.06521)],
        [(0.68255, 2.35823), (1.30727, 4.74473), (1.94354, 7.05504), (2.56826, 9.18758)],
    ),
    0.3: (
        [(0.70585, -2.42841), (1.31710, -4.56579), (1.95164, -6.31642), (2.59785, -7.81681)],
        [(0.68255, 1.49480), (1.30727, 3.22103), (1.94354, 4.92185), (2.56826, 6.49571)],
    ),
}


def ring(radii, centre, angles, cells, ends, face):
    """Return a half ring and its facet tags.

    Args:
        radii: inner and outer radius.
        centre: centre, shape (2,).
        angles: angles of the ends, in radians.
        cells: numbers of cells across and along the ring.
        ends: tag of both ends.
        face: tag of the outer face.
    """
    unit = mesh.create_rectangle(COMM, [[0, 0], [1, 1]], cells, mesh.CellType.quadrilateral)
    at = [
        mesh.locate_entities_boundary(unit, 1, lambda x: np.isclose(x[1] * (1 - x[1]), 0)),
        mesh.locate_entities_boundary(unit, 1, lambda x: np.isclose(x[0], 1)),
    ]
    facets = np.concatenate(at)
    values = np.repeat(np.array([ends, face], dtype=np.int32), [len(f) for f in at])
    order = np.argsort(facets)
    tags = mesh.meshtags(unit, 1, facets[order], values[order])
    x = unit.geometry.x
    radius = radii[0] + (radii[1] - radii[0]) * x[:, 0]
    angle = angles[0] + (angles[1] - angles[0]) * x[:, 1]
    x[:, 0] = centre[0] + radius * np.cos(angle)
    x[:, 1] = centre[1] + radius * np.sin(angle)
    return unit, tags


def beams(friction, across):
    """Return the problem, the motion of the upper beam, and the equivalent stress."""
    cells = (across, 25 * across)
    left = OUTER - np.sqrt((MIDDLE + OUTER) ** 2 - HEIGHT**2)
    lower = ring((MIDDLE, OUTER), (OUTER, 0.0), (0.0, np.pi), cells, FIXED, SLAVE)
    upper = ring((INNER, MIDDLE), (left, HEIGHT), (np.pi, 2 * np.pi), cells, MOVED, MASTER)
    both = join([lower[0], upper[0]], facet_tags=[lower[1], upper[1]])
    V = fem.functionspace(both.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    motion = fem.Constant(both.mesh, np.zeros(2))
    bcs = []
    for tag, value in ((FIXED, np.zeros(2)), (MOVED, motion)):
        dofs = fem.locate_dofs_topological(V, 1, both.facet_tags.find(tag))
        bcs.append(fem.dirichletbc(value, dofs, V))
    mu = YOUNG / (2 * (1 + POISSON))
    bulk = YOUNG / (3 * (1 - 2 * POISSON))
    F = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(F)
    first = ufl.inner(F, F) + 1  # plane strain: the stretch across is 1
    energy = mu / 2 * (J ** (-2 / 3) * first - 3) + bulk / 2 * ((J**2 - 1) / 2 - ufl.ln(J))
    b = F * F.T
    square = ufl.inner(b, b) + 1 - first**2 / 3
    equivalent = mu * J ** (-5 / 3) * ufl.sqrt(1.5 * square)
    law = Coulomb(friction) if friction else Frictionless()
    pair = ContactPair(u, both, slave=SLAVE, master=MASTER, law=law, sliding="large")
    return ContactProblem(energy * ufl.dx, u, [pair], bcs=bcs), motion, equivalent


def forces(friction, across, step, until):
    """Return displacements, reactions of the lower beam, and largest equivalent stresses."""
    problem, motion, equivalent = beams(friction, across)
    W = fem.functionspace(problem.u.function_space.mesh, ("DG", 1))
    points = W.element.interpolation_points
    points = points() if callable(points) else points
    expression = fem.Expression(equivalent, points)
    stress = fem.Function(W)
    rows = []

    def load(t):
        motion.value[0] = t

    def observe(taken):
        stress.interpolate(expression)
        largest = COMM.allreduce(stress.x.array.max(initial=0.0), op=MPI.MAX)
        x, y = taken.result.resultants["contact"]
        rows.append((taken.time, -x, -y, largest))

    times = np.linspace(0.0, until, round(until / step) + 1)
    QuasiStatic(problem, load).run(times, halve_steps=True, observer=observe)
    return np.array(rows)


def compare(friction, across, step, until):
    """Return reactions here and in the reference, and the displacement at which beams yield."""
    rows = forces(friction, across, step, until)
    u, x, y, stress = np.vstack([np.zeros(4), rows]).T
    record = {"friction": friction, "cells": across}
    record["yield_mm"] = float(np.interp(YIELD, stress, u)) if stress.max() > YIELD else None
    for name, ours, table in zip("xy", (x, y), REFERENCE[friction], strict=True):
        place, reference = np.array(table).T
        record[name] = [
            {"u": p, "reference": r, "here": float(np.interp(p, u, ours))}
            for p, r in zip(place, reference, strict=True)
            if p <= until
        ]
    return record


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--levels", nargs="+", type=int, default=[4, 8, 16], help="cells across")
    parser.add_argument("--step", type=float, default=0.1, help="displacement of a step, mm")
    parser.add_argument("--until", type=float, default=2.6, help="largest displacement, mm")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args(argv)
    records = []
    for friction in REFERENCE:
        for across in args.levels:
            record = compare(friction, across, args.step, args.until)
            records.append(record)
            if COMM.rank == 0:
                print(f"F = {friction}, {across} cells, yield at {record['yield_mm']} mm")
                for name in "xy":
                    for r in record[name]:
                        print(
                            f"  {name} at {r['u']:.3f} mm: {r['here']:.3f}, "
                            f"reference {r['reference']:.3f}",
                            flush=True,
                        )
    if args.output and COMM.rank == 0:
        args.output.write_text(json.dumps(records, indent=1))
    return records


if __name__ == "__main__":
    main()
