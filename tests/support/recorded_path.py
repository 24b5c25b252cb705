"""A path by arc length with a record: python3 recorded_path.py FOLDER [--resume] ..."""

import argparse
import sys
from pathlib import Path
from weakref import WeakKeyDictionary

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import (
    RCCM,
    ContactPair,
    ContactProblem,
    ContactSurface,
    Coulomb,
    HalfSpace,
    ParametricContact,
)
from dolfinx_contact.continuation import StepControl
from dolfinx_contact.evolution import ArcLength, QuasiStatic
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.records import PathRecord
from support.blocks import box, facets
from support.recorded_evolution import cracked_block

#: Longest steps.
LONGEST = 0.1
#: States at which paths begin that begin anew.
STARTS = WeakKeyDictionary()


def glued(comm, friction, _way, _anew):
    """A soft block on worn bonds, by a lid that tilts: here it slips, there they break."""
    domain = box(comm, 2, "quad")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    lid = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    law = RCCM(100.0, 100.0, 1.0, friction=2 * friction, beta=0.6)
    bond = ContactSurface(u, facets(domain, 1, 0.0), obstacle=HalfSpace((0, 0), (0, 1)), law=law)
    held = fem.locate_dofs_topological(V, 1, facets(domain, 1, 1.0))
    energy = LinearElastic.from_young(30.0, 0.3).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [bond], bcs=[fem.dirichletbc(lid, held)])
    x = ufl.SpatialCoordinate(domain)
    motion = ufl.as_vector((0.8 * gamma, gamma * (x[0] - 0.3)))
    return ArcLength(ParametricContact(problem, gamma, driven=[(lid, motion)]))


def pressed(problem, top, way, anew):
    """The path of a body that is pressed down, unless it goes on, and then moved aside."""

    def press(time):
        top.x.array[1::2] = -0.01 * time

    start = QuasiStatic(problem, press).run([0.0, 1.0]).steps[-1].state if anew else None
    gamma = fem.Constant(problem.V.mesh, 0.0)
    motion = ufl.as_vector((way * gamma, -0.01))
    path = ArcLength(ParametricContact(problem, gamma, driven=[(top, motion)]))
    STARTS[path] = start
    return path


def cracked(comm, friction, way, anew):
    """A block with a crack."""
    return pressed(*cracked_block(comm, friction), way, anew)


def pair(comm, friction, way, anew):
    """Two elastic blocks, one on the other, the lower of a finer mesh."""
    import cases.two_blocks

    args = cases.two_blocks.arguments(["--n", "3", "--ratio", "2"])
    body = cases.two_blocks.blocks(args, comm)
    domain = body.mesh
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u = fem.Function(V)
    top = fem.Function(V)
    ends = [fem.locate_dofs_topological(V, 1, facets(domain, 1, y)) for y in (1.0, -0.5)]
    bcs = [fem.dirichletbc(top, ends[0]), fem.dirichletbc(np.zeros(2), ends[1], V)]
    touch = ContactPair(u, body, slave="sole", master="seat", law=Coulomb(friction))
    energy = LinearElastic.from_young(1000.0, 0.3).energy(u) * ufl.dx
    return pressed(ContactProblem(energy, u, [touch], bcs=bcs), top, way, anew)


#: Makes a path, and the range of its load, there and back.
CASES = {
    "bonds": (glued, (0.0, 0.7), (0.02, 0.7)),
    "crack": (cracked, (-1.0, 1.0), (-1.0, 1.0)),
    "pair": (pair, (-1.0, 1.0), (-0.9, 1.5)),
}


def made(case, comm=MPI.COMM_WORLD, *, friction=0.25, way=0.012, anew=True):
    """The path of a case, in the state in which it begins if it does so anew."""
    return CASES[case][0](comm, friction, way, anew)


def enough(step):
    """Whether a bond is all but broken."""
    beta = step.result.tables["contact"].beta
    return "far enough" if beta is not None and beta.min() < 0.1 else ""


def on(case, path, kept, *, longest=LONGEST, observer=None):
    """There, and back again; or on from where the record ends."""
    control = StepControl(initial=longest / 2, maximum=longest)
    _, there, back = CASES[case]
    runs = kept.journal.runs
    told = {"observer": observer}
    if runs:
        kept.go_on(stop=None if len(runs) > 1 else enough, **told)
    else:
        more = {"start": STARTS.get(path), "stop": enough, **told}
        path.run(gamma_range=there, control=control, record=kept, **more)
    if len(kept.journal.runs) == 1:
        path.run(gamma_range=back, direction="back", control=control, record=kept, **told)
    return kept.journal


def record(case, folder, comm=MPI.COMM_WORLD, **more):
    """Both runs with a record in a new folder."""
    path = made(case, comm)
    with PathRecord(folder, path) as kept:
        return on(case, path, kept, **more)


def resume(case, folder, comm=MPI.COMM_WORLD, **more):
    """Return the remaining arguments."""
    path = made(case, comm, anew=False)
    with PathRecord(folder, path, resume=True) as kept:
        return on(case, path, kept, **more)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--case", choices=CASES, default="bonds")
    parser.add_argument("--friction", type=float, default=0.25)
    parser.add_argument("--longest", type=float, default=LONGEST)
    args = parser.parse_args()
    path = made(args.case, friction=args.friction, anew=not args.resume)
    try:
        with PathRecord(args.folder, path, resume=args.resume) as kept:
            run = on(args.case, path, kept, longest=args.longest).runs[-1]
            said = "" if run.complete else run.reason
    except (OSError, ValueError) as error:
        said = f"{type(error).__name__}: {error}"
    # A file for every rank: lines of several ranks may mix on one stream.
    (args.folder / f"said.{MPI.COMM_WORLD.rank}").write_text(said)
    sys.exit(3 if said else 0)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    main()
