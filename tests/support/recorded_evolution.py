"""An evolution with a record: python3 recorded_evolution.py FOLDER [--resume] ..."""

import argparse
import sys
from functools import partial
from pathlib import Path

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactPair, ContactProblem, Coulomb
from dolfinx_contact.evolution import NSCD, QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.meshing import crack
from dolfinx_contact.records import EvolutionRecord
from support.blocks import box, facets

#: Down in the first unit of time, then to the right, to the left, and up.
TIMES = np.array([0.0, 1.0, 3.0, 6.0, 7.0])
LONGEST = 0.5


def motion(time, way=0.012):
    """Return the displacement of the top at a time."""
    across = (0.0, 0.0, way, -way, -0.3 * way)
    up = (0.0, -0.01, -0.01, -0.01, -0.002)
    return np.array([np.interp(time, TIMES, values) for values in (across, up)])


def pair(comm, friction=0.25, way=0.012, n=4):
    """Two elastic blocks, one on the other."""
    import cases.two_blocks

    words = ["--n", str(n), "--friction", str(friction)]
    both, top = cases.two_blocks.problem(cases.two_blocks.arguments(words), comm)

    def load(time):
        top.value = motion(time, way)

    return QuasiStatic(both, load)


def cracked_block(comm, friction, n=4):
    """Return a block with a crack from its left side to its middle, and the Function of its top."""
    domain = box(comm, n, "tri")
    domain.topology.create_entities(1)
    inside = mesh.locate_entities(domain, 1, lambda x: np.isclose(x[1], 0.5) & (x[0] < 0.75 + 1e-9))
    every = [inside, facets(domain, 1, 0.0), facets(domain, 1, 1.0)]
    values = np.repeat(np.array([5, 1, 4], dtype=np.int32), [len(f) for f in every])
    order = np.argsort(np.concatenate(every))
    tags = mesh.meshtags(domain, 1, np.concatenate(every)[order], values[order])
    body = crack(domain, [5], facet_tags=tags)
    V = fem.functionspace(body.mesh, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Function(V)
    lower, upper = (fem.locate_dofs_topological(V, 1, body.facet_tags.find(tag)) for tag in (1, 4))
    bcs = [fem.dirichletbc(np.zeros(2), lower, V), fem.dirichletbc(top, upper)]
    sides = ContactPair(u, body, slave=5, master="5_opposite", law=Coulomb(friction))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return ContactProblem(energy, u, [sides], bcs=bcs), top


def cracked(comm, friction=0.25, way=0.012, n=4):
    """The block with a crack, whose top goes its way."""
    problem, top = cracked_block(comm, friction, n)

    def load(time):
        top.x.array[:] = np.tile(motion(time, way), len(top.x.array) // 2)

    return QuasiStatic(problem, load)


def moving(comm, friction=0.25, dt=0.25):
    """The two blocks with mass, in steps that are too long to follow their waves."""
    quasi_static = pair(comm, friction)
    return NSCD(quasi_static.problem, 1.0, dt=dt, load=quasi_static.load)


CASES = {"pair": pair, "crack": cracked, "motion": moving}
CASES["fine motion"] = partial(moving, dt=0.02)


def record(evolution, folder, observer=None, longest=LONGEST):
    """Run it with a record in a new folder."""
    steps = {"longest": longest} if isinstance(evolution, QuasiStatic) else {}
    with EvolutionRecord(folder, evolution) as kept:
        return evolution.run(TIMES, record=kept, observer=observer, **steps)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--case", choices=CASES, default="pair")
    parser.add_argument("--friction", type=float, default=0.25)
    parser.add_argument("--longest", type=float, default=LONGEST)
    args = parser.parse_args()
    evolution = CASES[args.case](MPI.COMM_WORLD, args.friction)
    try:
        if args.resume:
            with EvolutionRecord(args.folder, evolution, resume=True) as kept:
                said = kept.go_on().reason
        else:
            said = record(evolution, args.folder, longest=args.longest).reason
    except (OSError, ValueError) as error:
        said = f"{type(error).__name__}: {error}"
    # A file for every rank: lines of several ranks may mix on one stream.
    (args.folder / f"said.{MPI.COMM_WORLD.rank}").write_text(said)
    sys.exit(0 if said == "the last time is reached" else 3)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    main()
