# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closing of a C: contact multipliers against a third medium.

A third-medium method fills the space between faces with a very soft material that stiffens when it
is compressed (Bluhm, Sigmund and Poulios, Comput. Mech. 67, 2021). The published demo of FElupe
(`examples/ex20_third-medium-contact.py`) closes a C of length 1 and height 0.5, with walls of 0.1,
plane strain, mu = 5/14, bulk modulus 5/3: its left side is clamped, and the right upper corner
moves down by 0.5. The medium has 2e-6 of the stiffness.

Here the same solid on the same bilinear quadrilaterals has a frictionless `ContactPair` in large
sliding. The forces of the demo were computed with FElupe 11.3.0; only the number of cells was
changed.

    python3 benchmarks/public/third_medium.py --levels 1 2 4
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Frictionless
from dolfinx_contact.evolution import QuasiStatic

COMM = MPI.COMM_WORLD
LENGTH, HEIGHT, WALL = 1.0, 0.5, 0.1
SHEAR, BULK = 5 / 14, 5 / 3
SLAVE, MASTER = 1, 2


def closing(k):
    """Return the contact problem with k cells across a wall, the motion, the dof, the energy."""
    size = [round(k * LENGTH / WALL), round(k * HEIGHT / WALL)]
    kind = mesh.CellType.quadrilateral
    whole = mesh.create_rectangle(COMM, [(0, 0), (LENGTH, HEIGHT)], size, kind)
    near = 1e-9
    cells = np.arange(whole.topology.index_map(2).size_local, dtype=np.int32)
    x = mesh.compute_midpoints(whole, 2, cells)
    solid = cells[(x[:, 0] < WALL) | (np.abs(x[:, 1] - HEIGHT / 2) > HEIGHT / 2 - WALL)]
    domain = mesh.create_submesh(whole, 2, solid)[0]

    def face(place):
        return mesh.locate_entities_boundary(
            domain, 1, lambda x: (np.abs(x[1] - place) < near) & (x[0] > WALL - near)
        )

    slave, master = face(HEIGHT - WALL), face(WALL)
    facets = np.concatenate([slave, master])
    values = np.repeat(np.array([SLAVE, MASTER], dtype=np.int32), [len(slave), len(master)])
    order = np.argsort(facets)
    tags = mesh.meshtags(domain, 1, facets[order], values[order])
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    held = fem.locate_dofs_geometrical(V, lambda x: x[0] < near)
    W, _ = V.sub(1).collapse()
    corner = fem.locate_dofs_geometrical(
        (V.sub(1), W), lambda x: (x[0] > LENGTH - near) & (x[1] > HEIGHT - near)
    )
    motion = fem.Constant(domain, 0.0)
    moved = corner[0]
    bcs = [
        fem.dirichletbc(np.zeros(2), held, V),
        fem.dirichletbc(motion, moved, V.sub(1)),
    ]
    F = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(F)
    isochoric = SHEAR / 2 * (J ** (-2 / 3) * (ufl.inner(F, F) + 1) - 3)
    energy = (isochoric + BULK / 2 * (J - 1) ** 2) * ufl.dx
    law = Frictionless()
    pair = ContactPair(u, tags, slave=SLAVE, master=MASTER, law=law, sliding="large")
    return ContactProblem(energy, u, [pair], bcs=bcs), motion, moved, energy


def forces(k, times):
    """Return displacements, forces at the corner, smallest gaps, and Newton steps."""
    problem, motion, moved, energy = closing(k)
    residual = fem.form(
        ufl.derivative(energy, problem.u, ufl.TestFunction(problem.u.function_space))
    )
    rows = []

    def load(t):
        motion.value = -t

    def observe(step):
        force = fem.assemble_vector(residual).array[moved].sum()
        gap = np.fmin.reduce(step.result.tables["contact"].un, initial=np.inf)  # nan: no opposite
        rows.append((step.time, float(force), float(gap), step.result.iterations))

    QuasiStatic(problem, load).run(times, halve_steps=True, observer=observe)
    return rows


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--levels", nargs="+", type=int, default=[1, 2, 4], help="cells of a wall")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args(argv)
    times = np.concatenate([np.linspace(0, 0.3, 16), np.linspace(0.3, 0.5, 16)[1:]])
    records = {}
    for k in args.levels:
        records[k] = rows = forces(k, times)
        for time, force, gap, _ in rows:
            if round(time, 6) in (0.2, 0.3, 0.34, 0.42, 0.5):
                print(f"{k} cells, {time:.2f}: force {force:.4e}, smallest gap {gap:.1e}")
        steps = sum(row[3] for row in rows)
        print(f"{k} cells: {steps} Newton steps in {len(rows)} steps", flush=True)
    if args.output:
        args.output.write_text(json.dumps(records, indent=1))
    return records


if __name__ == "__main__":
    main()
