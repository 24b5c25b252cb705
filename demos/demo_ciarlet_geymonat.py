# SPDX-License-Identifier: LGPL-3.0-or-later
# # Six branches of a hyperelastic block
#
# This demo illustrates how to:
#
# - follow branches of a *large deformation* problem through changes of status and points where many
#   nodes change at once;
# - switch to every branch that leaves such a point;
# - draw diagrams with the statuses along each branch.
#
# A block of 40 x 80 mm of Ciarlet and Geymonat's material hangs from its top just above a rigid
# floor, with friction on all of its bottom, and a dead traction -gamma (2, 0.12 (20 - x)) MPa acts
# on both sides (the hyperelastic example of Ligursky and Renard). At gamma = 0 the undeformed block
# grazes the floor: all bottom nodes are at a kink. From there three branches lead to gamma = 1, and
# their mirror images to gamma = -1.

import argparse
import time

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.continuation import StepControl, explore
from dolfinx_contact.laws.status import COLOURS, NAMES
from dolfinx_contact.materials import CiarletGeymonat
from dolfinx_contact.output import Progress, output_folder, picture_of_states, write_summary
from dolfinx_contact.parametric import ParametricContact


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="All branches of a hyperelastic block")
    parser.add_argument("--nx", type=int, default=20)
    parser.add_argument("--ny", type=int, default=40)
    parser.add_argument("--friction", type=float, default=1.0)
    parser.add_argument("--r", type=float, default=None, help="augmentation parameter")
    parser.add_argument("--step-factor", type=float, default=1.0, help="of the default steps")
    parser.add_argument("--seed", type=int, default=None, help="renumbers the mesh at random")
    parser.add_argument("--length", type=float, default=1.0, help="unit of length, in mm")
    parser.add_argument("--stress", type=float, default=1.0, help="unit of stress, in MPa")
    parser.add_argument("--output", default="output/ciarlet_geymonat")
    args = parse_arguments(parser, argv)
    if args.nx < 1 or args.ny < 1 or not args.step_factor > 0:
        parser.error("nx, ny and step-factor must be positive")
    return args


def block_mesh(comm, nx, ny, mm, seed):
    """nx * ny rectangles."""
    if seed is None:
        corners = np.array([[0.0, 0.0], [40.0, 80.0]]) * mm
        return mesh.create_rectangle(comm, corners, (nx, ny), mesh.CellType.quadrilateral)
    x, y = np.meshgrid(np.linspace(0.0, 40.0, nx + 1), np.linspace(0.0, 80.0, ny + 1))
    points = mm * np.stack([x, y], axis=-1).reshape(-1, 2)
    first = (np.arange(nx) + (nx + 1) * np.arange(ny)[:, None]).reshape(-1, 1)
    cells = first + np.array([0, 1, nx + 1, nx + 2])
    random = np.random.default_rng(seed)
    order = random.permutation(len(points))
    points, cells = points[order], np.argsort(order)[cells]
    cells = cells[random.permutation(len(cells))]
    if comm.rank > 0:
        points, cells = points[:0], cells[:0]
    element = basix.ufl.element("Lagrange", "quadrilateral", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=cells, x=points, e=ufl.Mesh(element))


def block(nx, ny, friction, r=None, length=1.0, stress=1.0, seed=None):
    """The block with gamma in its traction, in the given units of length and stress."""
    comm, mm, MPa = MPI.COMM_WORLD, 1.0 / length, 1.0 / stress
    domain = block_mesh(comm, nx, ny, mm, seed)

    def edge(axis, value):
        return mesh.locate_entities_boundary(
            domain, 1, lambda x: np.isclose(x[axis], value * mm, atol=1e-9 * mm)
        )

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, gamma = fem.Function(V, name="displacement"), fem.Constant(domain, 1.0)
    sides = np.sort(np.concatenate([edge(0, 0.0), edge(0, 40.0)]))
    tags = mesh.meshtags(domain, 1, sides, np.ones(len(sides), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    x = ufl.SpatialCoordinate(domain)
    traction = ufl.as_vector([2.0 * MPa + 0 * x[0], 0.12 * MPa * (20.0 - x[0] / mm)])
    material = CiarletGeymonat(4000.0 * MPa, 120.0 * MPa, 30.0 * MPa)
    energy = material.energy(u) * ufl.dx(metadata={"quadrature_degree": 4})
    energy += gamma * ufl.dot(traction, u) * ds
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, edge(1, 80.0)), V)
    surface = ContactSurface(
        u, edge(1, 0.0), obstacle=HalfSpace((0, 0), (0, 1)), law=Coulomb(friction)
    )
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=[held], r=r), gamma)


def observe(system, point):
    table = system.result_at(point).tables["contact"]
    return {
        "gamma": point.gamma,
        "status": table.status,
        "ut_left": float(table.ut[0, 0]),
        "un_left": float(table.un[0]),
        "ut_right": float(table.ut[-1, 0]),
        "un_right": float(table.un[-1]),
        "sum_rt": float(table.rt[:, 0].sum()),
        "sum_rn": float(table.rn.sum()),
    }


# ## Pictures
#
# Above, the branches in three projections; below, for each branch, the statuses of the bottom nodes
# (left to right, upwards) along the branch.


def draw(path, seen, events):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colours = ["#2e4a6b", "#c0392b", "#2e9e4f", "#e8892b", "#7d5ba6", "#11889a"]
    figure = plt.figure(figsize=(12, 8), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1.1, 1))
    labels = {"ut_left": "$u_t$ of the left corner", "un_left": "gap of the left corner"}
    labels["sum_rn"] = "normal force"
    for axis, (key, label) in zip(above.subplots(1, 3), labels.items(), strict=True):
        for k, branch in enumerate(seen):
            gammas = [s["gamma"] for s in branch]
            values = [s[key] for s in branch]
            axis.plot(gammas, values, color=colours[k % 6], lw=1.6, label=str(k + 1))
            at = events[k]
            axis.plot(
                [gammas[i] for i in at], [values[i] for i in at], "o", ms=2.5, color=colours[k % 6]
            )
        axis.plot(0, 0, "o", color="black", ms=5)
        axis.set(xlabel=r"$\gamma$", title=label)
        axis.spines[["top", "right"]].set_visible(False)
    above.axes[0].legend(title="branch", frameon=False, fontsize=8)
    letters = "ok+-"
    shown = ListedColormap([COLOURS[k] for k in letters])
    axes = below.subplots(1, len(seen), squeeze=False)[0]
    for k, (axis, branch) in enumerate(zip(axes, seen, strict=True)):
        codes = np.array([[letters.index(c) for c in s["status"]] for s in branch]).T
        axis.imshow(
            codes, aspect="auto", cmap=shown, vmin=-0.5, vmax=3.5, interpolation="nearest",
            origin="lower",
        )  # fmt: skip
        axis.set(title=f"branch {k + 1}", xlabel="point", yticks=[])
        axis.title.set_color(colours[k % 6])
    handles = [Patch(facecolor=COLOURS[k], label=NAMES[k]) for k in letters]
    below.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


# ## From gamma = 1 to the degenerate point, and out along every ray


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    system = block(args.nx, args.ny, args.friction, args.r, args.length, args.stress, args.seed)
    result = system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    plain, factor = StepControl(), args.step_factor
    control = StepControl(
        initial=min(factor * plain.initial, 1.0), maximum=min(factor * plain.maximum, 1.0)
    )
    begun = time.perf_counter()
    diagram = explore(
        system, [(x, 1.0)], gamma_range=(-1.0, 1.0), control=control, observer=Progress(comm)
    )
    seconds = time.perf_counter() - begun

    # Every branch from the degenerate point to its far end; the first was followed backwards.
    branches = [list(branch.points) for branch in diagram.branches]
    events = [[s.index for s in branch.special] for branch in diagram.branches]
    branches[0].reverse()
    events[0] = [len(branches[0]) - 1 - i for i in events[0]]
    seen = [[observe(system, p) for p in points] for points in branches]
    order = sorted(range(len(seen)), key=lambda k: (-seen[k][-1]["gamma"], seen[k][-1]["status"]))
    branches, seen, events = ([part[k] for k in order] for part in (branches, seen, events))
    scalars = {
        "converged": diagram.reason == "every ray has been followed",
        "reason": diagram.reason,
        "newton_iterations": result.iterations,
        "dofs": x.getSize(),
        "branches": [branch[-1] for branch in seen],
        "bifurcation_gamma": [node.point.gamma for node in diagram.nodes],
        "rays": [len(node.rays) for node in diagram.nodes],
        "complete": diagram.complete,
        "methods": sorted({node.point.method for node in diagram.nodes}),
        "points": [len(points) for points in branches],
        "gammas": [[p.gamma for p in points] for points in branches],
        "augmentation": system.problem.surfaces[0].mean_augmentation,
        "factorisations": sum(b.factorisations for b in diagram.branches),
        "explore_seconds": seconds,
    }
    ends = [points[-1] for points in branches]
    titles = [f"branch {k + 1}: $\\gamma$ = {p.gamma:g}" for k, p in enumerate(ends)]
    picture_of_states(folder / "states.png", system, ends, titles=titles)
    if comm.rank == 0:
        draw(folder / "diagram.png", seen, events)
        for k, end in enumerate(scalars["branches"]):
            print(
                f"branch {k + 1} to gamma = {end['gamma']:+g}: {end['status']}, "
                f"left corner {end['ut_left']:.6g}, {end['un_left']:.6g}"
            )
        steps = sum(scalars["points"])
        print(f"{steps} points in {seconds:.1f} s, {scalars['factorisations']} factorisations")
    return write_summary(comm, folder, scalars)


if __name__ == "__main__":
    main()
