# SPDX-License-Identifier: LGPL-3.0-or-later
# # Following the solutions of any meshed body through every fold
#
# This demo illustrates how to:
#
# - follow the branch of solutions of a body meshed by gmsh as its load, or the displacement of its
#   support, grows;
# - read off where contact points open, stick and slip, and where the branch turns back;
# - list all solutions of the branch at one load.
#
# The mesh needs the physical groups `dirichlet` (held) and `contact`; the rigid floor touches the
# lowest point of `contact`. Without a mesh the demo makes a V-shaped body: one arm is vertical, the
# other inclined, both are clamped at their far ends, and the tip rests on the floor.
#
# gamma goes from 0 to 1. With `--body-force FX FY GX GY` the body force is
# (1 - gamma) (FX, FY) + gamma (GX, GY); with `--drive-top DX DY` the highest part of `dirichlet` is
# displaced by gamma (DX, DY), in small or, with a hyperelastic law, in large deformation.
#
# With `--record DIR` every point goes to the disk as it is found. If the run is killed, the same
# command with `--resume` goes on, on any number of ranks.

import argparse

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.continuation import Observers, StepControl, follower_for
from dolfinx_contact.materials import CiarletGeymonat, LinearElastic, NeoHookean
from dolfinx_contact.meshing import mesh_from_gmsh, read_mesh
from dolfinx_contact.output import (
    BranchRecord,
    Progress,
    draw_diagram,
    output_folder,
    write_series,
    write_summary,
)
from dolfinx_contact.parametric import ParametricContact


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="Follow the solutions of a meshed body")
    parser.add_argument("--mesh", help="a 2D .msh with physical groups dirichlet and contact")
    parser.add_argument("--size", type=float, default=0.06, help="cells of the default body")
    parser.add_argument("--friction", type=float, default=1.5)
    parser.add_argument("--lame", type=float, nargs=2, default=(100.0, 82.0), metavar=("L", "M"))
    laws = ("linear", "neo-hookean", "ciarlet-geymonat")
    parser.add_argument("--law", choices=laws, default="linear")
    drive = parser.add_mutually_exclusive_group()
    drive.add_argument("--body-force", type=float, nargs=4, metavar=("FX", "FY", "GX", "GY"))
    drive.add_argument("--drive-top", type=float, nargs=2, metavar=("DX", "DY"))
    parser.add_argument("--solutions-at", type=float, metavar="G")
    parser.add_argument("--route", choices=("auto", "pivoting", "steps"), default="auto")
    parser.add_argument("--step-factor", type=float, default=1.0, help="of the default steps")
    parser.add_argument("--r", type=float, default=None, help="augmentation parameter")
    parser.add_argument("--length", type=float, default=1.0, help="the unit of the mesh")
    parser.add_argument("--max-steps", type=int, default=2000)
    parser.add_argument("--record", metavar="DIR", help="keep journal and fields of the branch")
    parser.add_argument("--resume", action="store_true", help="go on with the record")
    parser.add_argument("--output", default="output/followed_mesh")
    args = parse_arguments(parser, argv)
    if args.body_force is None and args.drive_top is None:
        args.body_force = (0.0, -6.0, -14.0, -6.0)
    if args.solutions_at is not None and not 0 <= args.solutions_at <= 1:
        parser.error("--solutions-at must lie between 0 and 1")
    if args.resume and args.record is None:
        parser.error("--resume needs the record: --record DIR")
    return args


def draw_vee(size):
    """The default body, in gmsh."""
    import gmsh

    corners = [(0, 0), (0.35, 0), (1.1, 1), (0.85, 1), (0.25, 0.25), (0.25, 1), (0, 1)]
    points = [gmsh.model.geo.addPoint(x, y, 0, size) for x, y in corners]
    lines = [
        gmsh.model.geo.addLine(a, b) for a, b in zip(points, [*points[1:], points[0]], strict=True)
    ]
    face = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
    gmsh.model.geo.synchronize()
    gmsh.model.addPhysicalGroup(2, [face], name="body")
    gmsh.model.addPhysicalGroup(1, [lines[0]], name="contact")
    gmsh.model.addPhysicalGroup(1, [lines[2], lines[5]], name="dirichlet")
    gmsh.model.mesh.generate(2)


def material(args):
    lmbda, mu = args.lame
    if args.law == "linear":
        return LinearElastic(lmbda, mu)
    if args.law == "neo-hookean":
        return NeoHookean(lmbda, mu)
    return CiarletGeymonat(lmbda, mu, mu / 4)


# ## The problem with its parameter
#
# gamma is a Constant of the energy (body force) or drives the Dirichlet data (displaced support).


def system(args, comm):
    if args.mesh:
        body = read_mesh(comm, args.mesh, dim=2, groups=("dirichlet", "contact"))
    else:
        body = mesh_from_gmsh(comm, lambda: draw_vee(args.size), groups=("dirichlet", "contact"))
    domain = body.mesh
    domain.geometry.x[:] *= args.length
    held, touching = body.facets("dirichlet"), body.facets("contact")
    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, moved = fem.Function(V, name="displacement"), fem.Function(V)
    gamma = fem.Constant(domain, 0.0)

    def heights(facets):
        if len(facets) == 0:  # DOLFINx divides by their number
            return np.zeros((0, 2))
        vertices = mesh.entities_to_geometry(domain, 1, facets).reshape(-1, 2)
        return domain.geometry.x[vertices, 1]

    floor = comm.allreduce(heights(touching).min(initial=np.inf), op=min)
    energy = material(args).energy(u) * ufl.dx
    driven, top = [], held
    if args.drive_top is not None:
        # The highest facets of the support move, the others stay where they are.
        highest = comm.allreduce(heights(held).max(initial=-np.inf), op=max)
        size = comm.allreduce(np.ptp(domain.geometry.x), op=max)
        top = held[heights(held).min(axis=1) > highest - 1e-6 * size]
        driven = [(moved, gamma * ufl.as_vector(args.drive_top))]
    else:
        force = np.reshape(args.body_force, (2, 2))
        first, last = (fem.Constant(domain, f) for f in force)
        energy -= ufl.dot((1 - gamma) * first + gamma * last, u) * ufl.dx
    bcs = [fem.dirichletbc(moved, fem.locate_dofs_topological(V, 1, top))]
    rest = np.setdiff1d(held, top).astype(np.int32)
    if comm.allreduce(len(rest)) > 0:
        fixed = fem.locate_dofs_topological(V, 1, rest)
        bcs.append(fem.dirichletbc(np.zeros(2), fixed, V))
    surface = ContactSurface(
        u, touching, obstacle=HalfSpace((0.0, floor), (0.0, 1.0)), law=Coulomb(args.friction)
    )
    problem = ContactProblem(energy, u, [surface], bcs=bcs, r=args.r)
    return ParametricContact(problem, gamma, driven=driven)


def observe(followed, point):
    """Displacement of the leftmost contact point and the resultant, all ranks."""
    table = followed.result_at(point).tables["contact"]
    free = table.letters != "d"
    return {
        "status": "".join(table.letters[free]),
        "ut_left": float(table.ut[0, 0]),
        "un_left": float(table.un[0]),
        "sum_rt": float(table.rt[free, 0].sum()),
        "sum_rn": float(table.rn[free].sum()),
    }


def ut_left(problem):
    """Tangential displacement of the leftmost contact point, for the record."""
    (surface,) = problem.surfaces
    state, n = surface.state(), surface.num_owned_points
    x, ut = (np.concatenate(problem.comm.allgather(state[key][:n])) for key in ("x", "ut"))
    return ut[np.argmin(x[:, 0]), 0]


def draw(path, gammas, seen, folds):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    figure, (above, below) = plt.subplots(2, 1, figsize=(9, 8), layout="constrained")
    above.plot(gammas, [s["ut_left"] for s in seen], color="#2e4a6b", lw=1.8, marker=".", ms=3)
    for fold in folds:
        above.axvline(fold["gamma"], color="#c0392b", lw=0.8, ls="--")
    above.set(xlabel=r"$\gamma$", ylabel="$u_t$ of the leftmost contact point")
    above.set_title("Branch of solutions (dashed: folds)", loc="left")
    colours = {"o": "#dfe3e8", "k": "#2e6db4", "+": "#2e9e4f", "-": "#e8892b"}
    names = {"o": "open", "k": "stick", "+": "slip right", "-": "slip left"}
    codes = np.array([["ok+-".index(c) for c in s["status"]] for s in seen]).T
    below.imshow(
        codes, aspect="auto", cmap=ListedColormap(list(colours.values())), vmin=-0.5, vmax=3.5,
        interpolation="nearest", origin="lower",
    )  # fmt: skip
    below.set(xlabel="point of the branch", ylabel="contact point, left to right")
    below.set_title("Status along the branch", loc="left")
    present = [k for k in names if any(k in s["status"] for s in seen)]
    below.legend(
        handles=[Patch(facecolor=colours[k], edgecolor="0.5", label=names[k]) for k in present],
        loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=len(present), frameon=False,
    )  # fmt: skip
    figure.savefig(path, dpi=130)
    plt.close(figure)


# ## Follow it
#
# `follower.run` tells observers of every point; a `BranchRecord` is one, and `go_on` takes up where
# it ends. Fields are kept at every point here, so that all of the branch can be read back.

FUNCTIONALS = {"ut_left": ut_left}


def follow_it(args, followed, follower, record):
    """The branch from its start, or on from the end of the record."""
    progress = Progress(followed.comm)
    if args.resume and record.journal.branches:
        return record.go_on(max_steps=args.max_steps, observer=progress)
    # The undeformed body that only grazes the floor has every contact point at a kink: when its
    # support is driven, the branch is entered a little beyond.
    first = 0.0 if args.drive_top is None else 1e-3
    followed.set_parameter(first)
    followed.problem.solve()
    x = followed.create_vector()
    followed.problem.write(x)
    start = follower.start(x, first)
    observer = progress if record is None else Observers(progress, record)
    return follower.run(start, (0.0, 1.0), max_steps=args.max_steps, observer=observer)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    followed = system(args, comm)
    default, factor = StepControl(), args.step_factor
    control = StepControl(
        initial=min(factor * default.initial, 1.0), maximum=min(factor * default.maximum, 1.0)
    )
    record = None
    if args.record is not None:
        record = BranchRecord(args.record, followed, FUNCTIONALS, every=1, resume=args.resume)
    x = followed.create_vector()
    followed.problem.write(x)
    with follower_for(followed, x, 0.0, control, gamma_scale=1.0, route=args.route) as follower:
        branch = follow_it(args, followed, follower, record)
        if record is None:
            special = [vars(s) for s in branch.special]
        else:
            # All of the branch, with what was followed before a kill.
            branch.points = record.points()
            special = record.journal.special().to_dict("records")
            follower.restore(record.state(0, len(branch.points) - 1)[1])
        points = branch.points
        seen = [observe(followed, p) for p in points]
        folds = [
            {
                "gamma": s["gamma"],
                "kind": "smooth" if s["smooth"] else "nonsmooth",
                "before": seen[s["index"] - 1]["status"],
                "after": seen[s["index"]]["status"],
            }
            for s in special
            if s["kind"] == "fold"
        ]
        scalars = {
            "converged": branch.reason == "gamma reached the end of its range",
            "reason": branch.reason,
            "newton_iterations": sum(p.corrections for p in points),
            "dofs": followed.matrix.getSize()[0],
            "folds": folds,
            "events": sum(bool(s["changes"]) for s in special),
            "bifurcations": [s["gamma"] for s in special if s["kind"] == "bifurcation"],
            "points": len(points),
            "gammas": [p.gamma for p in points],
            "augmentation": followed.problem.surfaces[0].mean_augmentation,
            "factorisations": branch.factorisations,
            "gamma_end": points[-1].gamma,
            "end": seen[-1],
        }
        if args.solutions_at is not None:
            there = follower.at(branch, args.solutions_at)
            scalars["solutions_at"] = {
                "gamma": args.solutions_at,
                "solutions": [observe(followed, p) for p in there],
            }
    if record is not None:
        write_series(folder, record)
        if comm.rank == 0:
            label = "$u_t$ of the leftmost contact point"
            draw_diagram(folder / "diagram.png", record.journal, "ut_left", label=label)
        record.close()
    if comm.rank == 0:
        draw(folder / "branch.png", [p.gamma for p in points], seen, folds)
        for s in special:
            print(f"{s['kind']:11s} gamma {s['gamma']:.12f}  {seen[s['index']]['status']}")
        for s in scalars.get("solutions_at", {}).get("solutions", []):
            print("  ", s)
        print(f"{branch.reason}; {len(folds)} folds, {scalars['events']} events")
    return write_summary(comm, folder, scalars)


if __name__ == "__main__":
    main()
