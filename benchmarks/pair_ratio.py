# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does friction between two bodies cost over the same bodies glued?

A block of n cells an edge, pressed and drawn aside, on a wider base with a mesh of its own, coupled
by the mortar method. The reference is the linear elastic solve of both with the faces tied by the
same mortar operator: u = P x, where P replaces the slave's nodes by weighted means of the master's,
solved by conjugate gradients on P^T K P with the fastest setting of multigrid. The times of both
include the mortar operator. Everything else is as in `elasticity_ratio.py`, also the options; the
part ``pair`` of the contact solve is the construction of the `ContactPair`.

    mpirun -n 2 python3 benchmarks/pair_ratio.py --n 32 --settings few --output pair.json
"""

from __future__ import annotations

from petsc4py import PETSc

import elastic_solve
import elasticity_ratio
import numpy as np
from elasticity_ratio import CELLS

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb
from dolfinx_contact._petsc import Entries, matrix_of
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import join
from dolfinx_contact.problem import discretise

BOTTOM = 1
MASTER = 2
SLAVE = 3
TOP = 4
BASE = 1.5  # width of the base over that of the block


def bodies(args, n, comm):
    """Return the space and the facet tags of a block of unit size on a base."""
    m = max(round(BASE * n * args.coarser), 1)
    w = (BASE - 1) / 2
    parts = [
        mesh.create_box(
            comm,
            [[-w, -w, -1], [1 + w, 1 + w, 0]],
            [m, m, max(round(m / BASE), 1)],
            CELLS[args.cell],
        ),
        mesh.create_box(comm, [[0, 0, 0], [1, 1, 1]], [n, n, n], CELLS[args.cell]),
    ]
    tags = []
    for part, low, high in zip(parts, (BOTTOM, SLAVE), (MASTER, TOP), strict=True):
        heights = (-1.0, 0.0) if low == BOTTOM else (0.0, 1.0)
        found = [
            mesh.locate_entities_boundary(part, 2, lambda x, z=z: np.isclose(x[2], z))
            for z in heights
        ]
        values = np.repeat(np.array([low, high], dtype=np.int32), [len(f) for f in found])
        facets = np.concatenate(found)
        order = np.argsort(facets)
        tags.append(mesh.meshtags(part, 2, facets[order], values[order]))
    both = join(parts, facet_tags=tags)
    return fem.functionspace(both.mesh, ("Lagrange", 1, (3,))), both.facet_tags


def conditions(args, V, tags):
    ends = ((BOTTOM, np.zeros(3)), (TOP, np.array([args.shift, 0.0, -args.press])))
    return [
        fem.dirichletbc(value, fem.locate_dofs_topological(V, 2, tags.find(tag)), V)
        for tag, value in ends
    ]


def pair_of(args, u, tags):
    law = Coulomb(args.friction)
    return ContactPair(u, tags, slave=SLAVE, master=MASTER, law=law, sliding=args.sliding)


def tie(args, u, tags):
    """Return P = I - T B and the tied dofs; T puts values at contact points to the slave's dofs."""
    pair = ContactPair(u, tags, slave=SLAVE, master=MASTER, law=Coulomb(args.friction))
    points = discretise(pair).points
    comm = u.function_space.mesh.comm
    index_map = u.function_space.dofmap.index_map
    bs = 3
    nodes = index_map.local_to_global(points.trace_nodes[: points.number]).astype(np.int64)
    first = points.operator.B.getOwnershipRange()[0]
    n = bs * index_map.size_local
    along = np.arange(bs)
    rows = (bs * nodes[:, None] + along).reshape(-1)
    columns = (first + bs * np.arange(points.number)[:, None] + along).reshape(-1)
    entries = Entries(rows, columns)
    T = matrix_of(comm, (n, bs * points.number), entries)
    entries.add(np.ones(len(rows)), T)
    product = T.matMult(points.operator.B)
    # P.shift(1.0) would insert the missing diagonal without preallocation on several ranks.
    own = np.arange(n) + T.getOwnershipRange()[0]
    identity = Entries(own, own)
    P = matrix_of(comm, (n, n), identity)
    identity.add(np.ones(n), P)
    P.axpy(-1.0, product, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    marks = T.createVecLeft()
    ones = T.createVecRight()
    ones.set(1.0)
    T.mult(ones, marks)
    tied = np.flatnonzero(marks.array_r > 0).astype(np.int32)
    for thing in (T, product, marks, ones):
        thing.destroy()
    return P, tied


def elasticity(args, V, tags, settings):
    """Return linear elastic solves with the bodies glued, as functions by name of the setting."""
    make = (lambda: conditions(args, V, tags)), args.poisson, args.tolerance
    return {
        s.name: elastic_solve.run_of(s, V, *make, tie=lambda u: tie(args, u, tags))
        for s in settings
    }


def contact_problem(args, timer, V, tags):
    u = fem.Function(V)
    pair = timer("pair", lambda: pair_of(args, u, tags))
    energy = LinearElastic.from_young(1.0, args.poisson).energy(u) * ufl.dx
    options = {"snes_rtol": args.tolerance}
    return timer(
        "problem",
        lambda: ContactProblem(
            energy, u, [pair], bcs=conditions(args, V, tags), petsc_options=options
        ),
    )


PAIR = elasticity_ratio.Case(bodies, elasticity, contact_problem)


def arguments(argv=None):
    coarser = dict(type=float, default=0.75, help="cells a length of the base over the block's")
    sliding = dict(choices=["small", "large"], default="small", help="of the contact pair")
    defaults = {"n": 32, "output": "pair_ratio.json"}
    return elasticity_ratio.arguments(argv, defaults, coarser=coarser, sliding=sliding)


def main(argv=None):
    return elasticity_ratio.measure(arguments(argv), PAIR)


if __name__ == "__main__":
    main()
