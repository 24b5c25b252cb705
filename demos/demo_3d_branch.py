# SPDX-License-Identifier: LGPL-3.0-or-later
# # A rounded foot from first contact to full sliding
#
# This demo illustrates how to:
#
# - follow the equilibrium of a 3D body as its load grows, while hundreds of contact points close,
#   stick and slip one after another;
# - have these events passed in batches, and one that matters located to round-off;
# - read off how the contact area and the sliding part of it grow.
#
# The foot is a block of hexahedra with a rounded sole, just above a rigid floor. Its top is lowered
# by gamma and moved sideways by gamma^2: it touches first at its lowest point, sticks, then slips
# from the rim of the contact area inwards, until the last point that stuck gives way. The law is
# that of the static problem, without memory: a point sticks as long as it has not moved sideways.
#
# Above 5000 unknowns a Krylov method with multigrid takes the place of factorisations: `--n 32`,
# with 1.1 10^5 unknowns and a thousand events, is a matter of minutes on two ranks.

import argparse
from itertools import pairwise

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.continuation import Follower, StepControl
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.output import (
    Progress,
    output_folder,
    picture_of_body,
    picture_of_contact,
    write_summary,
)
from dolfinx_contact.parametric import ParametricContact

GAP = 0.005  # between floor and sole
CENTRE = (0.46, 0.53)  # below which the sole is lowest


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="Follow a 3D body from first contact to sliding")
    parser.add_argument("--n", type=int, default=16, help="cells along an edge")
    parser.add_argument("--friction", type=float, default=0.4)
    parser.add_argument("--lower", type=float, default=0.06, help="the top by this, at gamma = 1")
    parser.add_argument("--shift", type=float, default=0.12, help="and sideways by this")
    parser.add_argument("--young", type=float, default=1000.0)
    parser.add_argument("--poisson", type=float, default=0.3)
    parser.add_argument("--round", type=float, default=0.08, help="height of the sole's curve")
    parser.add_argument("--kinks", choices=("exact", "batched", "stepping"), default="batched")
    parser.add_argument("--max-steps", type=int, default=500)
    parser.add_argument("--output", default="output/3d_branch")
    args = parse_arguments(parser, argv)
    if args.n < 2:
        parser.error("--n must be at least 2")
    if not args.lower > GAP or not 0 <= args.round < 1:
        parser.error(f"needs --lower > {GAP}, else nothing touches, and 0 <= --round < 1")
    return args


# ## The body and its load
#
# gamma is a Constant that the Dirichlet data of the top contain.


def foot(args, comm):
    n = args.n
    domain = mesh.create_unit_cube(comm, n, n, n, mesh.CellType.hexahedron)
    sole = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 0.0))
    top = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[2], 1.0))
    x = domain.geometry.x
    away = (x[:, 0] - CENTRE[0]) ** 2 + (x[:, 1] - CENTRE[1]) ** 2
    x[:, 2] += args.round * (1 - x[:, 2]) * away

    V = fem.functionspace(domain, ("Lagrange", 1, (3,)))
    u, moved = fem.Function(V, name="displacement"), fem.Function(V)
    gamma = fem.Constant(domain, 0.0)
    sideways = args.shift * gamma**2
    move = ufl.as_vector([0.94 * sideways, 0.34 * sideways, -args.lower * gamma])
    held = fem.dirichletbc(moved, fem.locate_dofs_topological(V, 2, top))
    surface = ContactSurface(
        u, sole, obstacle=HalfSpace((0.0, 0.0, -GAP), (0.0, 0.0, 1.0)), law=Coulomb(args.friction)
    )
    material = LinearElastic.from_young(args.young, args.poisson)
    problem = ContactProblem(material.energy(u) * ufl.dx, u, [surface], bcs=[held])
    return ParametricContact(problem, gamma, driven=[(moved, move)]), material


def first_contact(system):
    """The predicate of the event at which the lowest point closes. Collective."""
    (surface,) = system.problem.surfaces
    heights = surface.positions[: surface.num_owned_points, 2]
    mine = int(np.argmin(heights)) if len(heights) else -1
    least = (float(heights.min(initial=np.inf)), system.comm.rank)
    lowest = mine if system.comm.allreduce(least, op=min) == least else -1
    return lambda change: change.point == lowest and change.before == 0


def show(system, follower, point):
    """Put a point of the branch into the problem. Collective."""
    x, gamma = follower.bordered.split(point.y)
    system.piece_at(x, gamma)


def observe(system, follower, point):
    """Numbers of points by status, and the resultant, on every rank."""
    show(system, follower, point)
    (surface,) = system.problem.surfaces
    state, n = surface.state(), surface.num_owned_points
    force = (state["traction"] * state["area"][:, None])[:n].sum(axis=0)
    force = np.array(system.comm.allreduce(force))
    letters = system.letters(point.piece)
    counts = {name: letters.count(c) for name, c in (("open", "o"), ("stick", "k"), ("slip", "s"))}
    return {
        "gamma": point.gamma,
        **counts,
        "sum_rn": float(force[2]),
        "sum_rt": float(np.hypot(*force[:2])),
    }


# ## Pictures


def draw(path, seen, special, friction):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    gammas = [s["gamma"] for s in seen]
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(8, 7.5), layout="constrained", sharex=True, height_ratios=(3, 2)
    )
    colours = {"stick": "#2e6db4", "slip": "#e8892b", "open": "#dfe3e8"}
    above.stackplot(
        gammas,
        [[s[name] for s in seen] for name in colours],
        labels=list(colours),
        colors=list(colours.values()),
    )
    rug = [s.gamma for s in special if not s.located]
    above.plot(rug, np.zeros(len(rug)), "|", color="0.2", ms=9, clip_on=False)
    for s in special:
        if s.located:
            above.axvline(s.gamma, color="#c0392b", lw=0.9, ls="--")
    above.set(ylabel="contact points", ylim=(0, None))
    above.set_title("Status along the branch (ticks: events; dashed: located)", loc="left")
    above.legend(loc="upper left", frameon=False)
    below.plot(gammas, [s["sum_rn"] for s in seen], color="#2e4a6b", label="normal force N")
    below.plot(gammas, [s["sum_rt"] for s in seen], color="#2e9e4f", label="tangential force T")
    limit = [friction * s["sum_rn"] for s in seen]
    below.plot(gammas, limit, color="#c0392b", lw=0.9, ls=":", label="F N")
    below.set(xlabel=r"$\gamma$", ylabel="force")
    below.legend(frameon=False)
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


# ## Follow it
#
# `kinks="batched"` lets a step pass many events; it is the default for so many contact points. The
# predicate `locate` asks for one of them, the first contact, to be located. It is asked on the rank
# that owns the point.


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    system, material = foot(args, comm)
    problem = system.problem
    x = system.create_vector()
    x.set(0.0)  # in its place, the body does not touch
    locate = first_contact(system) if args.kinks == "batched" else None
    control = StepControl(kinks=args.kinks)
    with Follower(system, control, gamma_scale=1.0, locate=locate) as follower:
        branch = follower.run(
            follower.start(x, 0.0), (0.0, 1.0), max_steps=args.max_steps, observer=Progress(comm)
        )
        seen = [observe(system, follower, p) for p in branch.points]
        shown = {"sliding": len(seen) - 1}
        stuck = [s["stick"] for s in seen]
        if any(stuck):
            shown["sticking"] = int(np.argmax(stuck))
            ratios = [s["slip"] * s["stick"] for s in seen]
            shown["partial_slip"] = int(np.argmax(ratios))
        for name, index in shown.items():
            show(system, follower, branch.points[index])
            title = f"gamma = {seen[index]['gamma']:.4f}"
            picture_of_contact(folder / f"contact_{name}.png", problem, title=title)
        show(system, follower, branch.points[-1])
        picture_of_body(
            folder / "body.png", problem, stress=material.full_stress(problem.u), title="gamma = 1"
        )
    events = [s for s in branch.special if s.changes]
    located = [s.gamma for s in events if s.located]
    full = [b["gamma"] for a, b in pairwise(seen) if a["stick"] and not b["stick"]]
    scalars = {
        "converged": branch.reason == "gamma reached the end of its range",
        "reason": branch.reason,
        "newton_iterations": sum(p.corrections for p in branch.points),
        "dofs": x.getSize(),
        "points": len(branch.points),
        "gammas": [p.gamma for p in branch.points],
        "events": sum(len(s.changes) for s in events),
        "located_events": located,
        "folds": [s.gamma for s in branch.folds],
        "bifurcations": [s.gamma for s in branch.bifurcations],
        "first_contact": min((s.gamma for s in events), default=None),
        "full_sliding_by": full[-1] if full else None,
        "factorisations": branch.factorisations,
        "solves": branch.solves,
        "along": seen,
        "end": seen[-1],
    }
    if comm.rank == 0:
        draw(folder / "branch.png", seen, branch.special, args.friction)
        print(f"{x.getSize()} unknowns, {len(seen)} points: {branch.reason}")
        print(
            f"{scalars['events']} events, {len(located)} of them located; "
            f"{branch.factorisations} factorisations"
        )
        if events:
            print(f"first contact at gamma = {scalars['first_contact']:.10f}")
        if full:
            print(f"full sliding by gamma = {full[-1]:.4f}")
        print("end:", ", ".join(f"{v:.6g} {k}" for k, v in seen[-1].items()))
    return write_summary(comm, folder, scalars)


if __name__ == "__main__":
    main()
