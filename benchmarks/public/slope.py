# SPDX-License-Identifier: LGPL-3.0-or-later
"""A block on a slope of tangent 0.5 with the friction coefficients 0.50 and 0.49.

A test of IPC (Li et al., Incremental Potential Contact, ACM Trans. Graph. 39, 2020, section 7):
the block must stay at rest with 0.50, and must slide with 0.49. With exact Coulomb friction it
does not creep at rest, and slides with the acceleration g (sin a - 0.49 cos a), a = arctan 0.5,
from the first step. The start is the static state of the elastic block, whose friction force
balances its weight.

    python3 benchmarks/public/slope.py
"""

from __future__ import annotations

import argparse

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import default_scalar_type, fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace
from dolfinx_contact.evolution import NSCD
from dolfinx_contact.materials import LinearElastic

COMM = MPI.COMM_WORLD
GRAVITY = 9.81
DENSITY = 1000.0
ANGLE = np.arctan(0.5)


def run(friction, *, n=8, duration=0.5, steps=100, young=1e8):
    """Displacement of the centre of the block along the slope, and that of a rigid block, in m."""
    block = mesh.create_rectangle(COMM, [(0, 0), (1, 0.5)], (2 * n, n))
    V = fem.functionspace(block, ("Lagrange", 1, (2,)))
    u = fem.Function(V, name="displacement")
    block.topology.create_connectivity(1, 2)
    bottom = mesh.locate_entities_boundary(block, 1, lambda x: np.isclose(x[1], 0))
    coefficient = fem.Constant(block, default_scalar_type(0.5 + 1e-9))
    slope = HalfSpace(point=(0, 0), normal=(0, 1))
    surface = ContactSurface(u, bottom, obstacle=slope, law=Coulomb(coefficient))
    weight = GRAVITY * DENSITY * ufl.as_vector((np.sin(ANGLE), -np.cos(ANGLE)))
    energy = (LinearElastic.from_young(young, 0.3).energy(u) - ufl.dot(weight, u)) * ufl.dx
    problem = ContactProblem(energy, u, [surface])
    problem.solve()
    centre = fem.form(u[0] * ufl.dx)
    area = 0.5
    start = COMM.allreduce(fem.assemble_scalar(centre)) / area
    coefficient.value = friction
    NSCD(problem, DENSITY, dt=duration / steps, theta=1.0).run([0.0, duration])
    moved = COMM.allreduce(fem.assemble_scalar(centre)) / area - start
    excess = max(np.sin(ANGLE) - friction * np.cos(ANGLE), 0.0)
    return moved, 0.5 * GRAVITY * excess * duration**2


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--friction", nargs="+", type=float, default=[0.5, 0.49])
    args = parser.parse_args(argv)
    records = {}
    for friction in args.friction:
        moved, rigid = run(friction)
        records[friction] = {"moved": moved, "rigid": rigid}
        if COMM.rank == 0:
            print(f"friction {friction}: moved {moved:.3e} m, rigid block {rigid:.3e} m")
    return records


if __name__ == "__main__":
    main()
