# SPDX-License-Identifier: LGPL-3.0-or-later
"""What does it cost to find out which facets may face each other?

The block on a base of `pair_ratio.py` in large sliding, without any solve: the pair, the search for
candidates where the block is pressed and drawn aside, the pattern of the contact terms of the
Jacobian, and who faces whom there. Times are those of the slowest rank, and in brackets processor
time of all.

    mpirun -n 2 python3 benchmarks/sliding_search.py --n 34
"""

from __future__ import annotations

import argparse
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pair_ratio
from timing import Timer, clean, peak_gigabytes

from dolfinx import fem

from dolfinx_contact import ContactPair, Frictionless
from dolfinx_contact.equations.sliding import SlidingTerms
from dolfinx_contact.problem import discretise

SHIFT = np.array([0.013, 0.007, -0.002])
"""Of the block, lengths of its edge."""


class Places:
    """All unknowns, rank by rank, the displacement first; none is fixed."""

    def __init__(self, comm, sizes):
        sizes = np.array(comm.allgather(sizes), dtype=np.int64)
        self._ends = np.cumsum(sizes, axis=0)
        starts = self._ends - sizes
        self._shift = starts.sum(axis=1)[:, None] - starts
        self._shift[:, 1] += sizes[:, 0]

    def places(self, field, nodes):
        dofs = 3 * nodes[..., None] + np.arange(3)
        owner = np.searchsorted(self._ends[:, field], dofs, side="right")
        return dofs + self._shift[owner, field]


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--n", type=int, default=16, help="cells along an edge of the block")
    parser.add_argument("--cell", choices=pair_ratio.CELLS, default="tet")
    parser.add_argument("--coarser", type=float, default=0.75, help="as of pair_ratio.py")
    args = parser.parse_args(argv)
    comm = MPI.COMM_WORLD
    V, tags = pair_ratio.bodies(args, args.n, comm)
    u = fem.Function(V)
    timers = {}

    def timed(name, function):
        timers[name] = Timer(comm)
        return timers[name](name, function)

    given = dict(slave=pair_ratio.SLAVE, master=pair_ratio.MASTER, law=Frictionless())
    pair = timed("pair", lambda: discretise(ContactPair(u, tags, sliding="large", **given)))
    faces = pair.points.faces
    x = V.tabulate_dof_coordinates()
    upper = x[:, 2] > -1e-9
    moved = np.where(upper[:, None], SHIFT, 0.0)
    moved = moved[: V.dofmap.index_map.size_local]
    faces.searches = 0
    clean(comm)
    timed("search", lambda: faces._search(faces._X + faces.nodes.from_owners(moved), None))
    sizes = [moved.size, 3 * pair.points.number]
    unknowns = SimpleNamespace(units=[1.0, 1.0])
    equations = SimpleNamespace(comm=comm, surfaces=[pair], unknowns=unknowns, owned_sizes=sizes)
    terms = SlidingTerms(equations, 0, Places(comm, sizes))
    timed("pattern", terms.set_up)
    timed("who faces whom", lambda: pair.points.at(moved, None))
    pairs = comm.allreduce(len(faces.found.pairs))
    memory = peak_gigabytes(comm)
    if comm.rank == 0:
        words = [f"{name} {t.total:.2f} s ({t.processor:.2f})" for name, t in timers.items()]
        print(f"{3 * V.dofmap.index_map.size_global} dofs, {comm.size} ranks:", ", ".join(words))
        print(f"  {pairs} pairs of facets, peak {memory:.1f} GB")
    return pairs


if __name__ == "__main__":
    main()
