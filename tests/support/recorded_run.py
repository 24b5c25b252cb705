"""A branch followed with a record: python3 recorded_run.py FOLDER [--resume] [--friction F]."""

import argparse
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, ParametricContact
from dolfinx_contact.continuation import StepControl, follow
from dolfinx_contact.materials import NeoHookean
from dolfinx_contact.records import BranchRecord
from support.blocks import box, facets
from support.checks import solved_start

CONTROL = StepControl(initial=0.01, maximum=0.01)


def moved_block(
    comm, *, cell="quad", n=4, friction=0.3, method=None, degree=1, tilt=0.1, **options
):
    """A hyperelastic block that is moved down and sideways by gamma until all of it slips."""
    domain = box(comm, n, cell)
    dim = domain.geometry.dim
    V = fem.functionspace(domain, ("Lagrange", degree, (dim,)))
    u = fem.Function(V)
    top = fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    x = ufl.SpatialCoordinate(domain)
    slope = 1.0 + tilt * x[0] + 0.037 * x[dim - 2]
    move = ufl.as_vector([0.02 * gamma**2, *[0.0] * (dim - 2), -0.02 * gamma * slope])
    held = fem.locate_dofs_topological(V, dim - 1, facets(domain, dim - 1, 1.0))
    surface = ContactSurface(
        u,
        facets(domain, dim - 1, 0.0),
        law=Coulomb(friction),
        method=method,
        **{"obstacle": HalfSpace((*[0.0] * (dim - 1), -0.002), np.eye(dim)[-1])} | options,
    )
    energy = NeoHookean(600.0, 400.0).energy(u) * ufl.dx
    problem = ContactProblem(energy, u, [surface], bcs=[fem.dirichletbc(top, held)])
    system = ParametricContact(problem, gamma, driven=[(top, move)])
    deformed = fem.form(ufl.det(ufl.Identity(dim) + ufl.grad(u)) * ufl.dx)
    volume = lambda _: comm.allreduce(fem.assemble_scalar(deformed))  # noqa: E731
    return system, {"volume": volume, "force": force}


def force(problem):
    """Normal force on all contact surfaces."""
    return sum(float(problem.table(s).rn.sum()) for s in problem.surfaces)


def start(system):
    """The unloaded state."""
    return solved_start(system, 0.0)


def record(system, functionals, folder, *, every=7, max_steps=1000, **options):
    """Follow the block with a record in a new folder."""
    with BranchRecord(folder, system, functionals, every=every, **options) as r:
        return record_in(r, max_steps=max_steps)


def record_in(kept, **options):
    """Follow the block with an open record."""
    return follow(
        kept.system,
        start(kept.system),
        0.0,
        gamma_range=(-0.1, 1.0),
        control=CONTROL,
        record=kept,
        **options,
    )


def resume(folder, system, functionals=None, *, branch=0, every=10, **options):
    """Continue a recorded branch."""
    with BranchRecord(folder, system, functionals, every=every, resume=True) as kept:
        return kept.go_on(branch, **options)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--friction", type=float, default=0.3)
    args = parser.parse_args()
    system, functionals = moved_block(MPI.COMM_WORLD, friction=args.friction)
    try:
        if args.resume:
            branch = resume(args.folder, system, functionals, every=7)
        else:
            branch = record(system, functionals, args.folder)
        said = branch.reason
    except (OSError, ValueError) as error:
        said = f"{type(error).__name__}: {error}"
    # A file for every rank: lines of several ranks may mix on one stream.
    (args.folder / f"said.{MPI.COMM_WORLD.rank}").write_text(said)
    sys.exit(0 if said == "gamma reached the end of its range" else 3)


if __name__ == "__main__":
    main()
