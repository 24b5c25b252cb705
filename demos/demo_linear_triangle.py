# SPDX-License-Identifier: LGPL-3.0-or-later
# # One solution, or three: a triangle with 64 contact nodes
#
# This demo illustrates how to:
#
# - find all branches of solutions that hang together, as a graph (`explore`);
# - pass a point where *every* contact node is at a kink at once, and leave it along every ray;
# - say whether the set of solutions is known to be complete.
#
# The triangle A = (0, 0), B = (1, 0), C = (0, 1), clamped on BC, may touch a rigid floor along AB.
# A traction -gamma (26, 7.5) acts on AC (Ligursky and Renard's example of a linear elastic body).
# Without load the body just grazes the floor, so that at gamma = 0 every node of AB is open, stuck
# and slipping at the same time: 4^n pieces of the nonsmooth problem meet there. For gamma < 0 there
# is one solution, for gamma > 0 and a large friction coefficient there are three.

import argparse
import time

from mpi4py import MPI

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.continuation import StepControl, explore
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.output import output_folder, picture_of_states, write_summary
from dolfinx_contact.parametric import ParametricContact


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="All branches of a triangle on a floor")
    parser.add_argument("--n", type=int, default=64, help="contact nodes; n * n cells")
    parser.add_argument("--friction", type=float, default=1.7)
    parser.add_argument("--load", type=float, nargs=2, default=(26.0, 7.5))
    parser.add_argument("--lame", type=float, nargs=2, default=(100.0, 82.0))
    parser.add_argument("--length", type=float, default=1.0)
    parser.add_argument("--route", choices=("auto", "pivoting", "steps"), default="auto")
    parser.add_argument("--step-factor", type=float, default=1.0, help="of the default steps")
    parser.add_argument("--r", type=float, default=None, help="augmentation parameter")
    parser.add_argument("--seed", type=int, default=None, help="renumbers the mesh at random")
    parser.add_argument("--output", default="output/linear_triangle")
    args = parse_arguments(parser, argv)
    if args.n < 1 or not args.length > 0 or not args.step_factor > 0:
        parser.error("n, length and step-factor must be positive")
    return args


# ## The body
#
# n * n congruent triangles with sides parallel to those of the body.


def triangle_mesh(comm, n, length, seed=None):
    place = {}
    for j in range(n + 1):
        for i in range(n + 1 - j):
            place[i, j] = len(place)
    points = length * np.array([(i / n, j / n) for i, j in place])
    cells = [
        cell
        for j in range(n)
        for i in range(n - j)
        for cell in (
            [(i, j), (i + 1, j), (i, j + 1)],
            [(i + 1, j), (i + 1, j + 1), (i, j + 1)],
        )[: 2 if i + j < n - 1 else 1]
    ]
    numbers = np.array([[place[k] for k in cell] for cell in cells], dtype=np.int64)
    if seed is not None:
        random = np.random.default_rng(seed)
        order = random.permutation(len(points))
        points, numbers = points[order], np.argsort(order)[numbers]
        numbers = numbers[random.permutation(len(numbers))]
    if comm.rank > 0:
        points, numbers = points[:0], numbers[:0]
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return mesh.create_mesh(comm, cells=numbers, x=points, e=ufl.Mesh(element))


def linear_triangle(
    n,
    friction,
    load=(26.0, 7.5),
    lame=(100.0, 82.0),
    length=1.0,
    r=None,
    seed=None,
    preload=(0.0, 0.0),
):
    """The body on the floor, with the traction preload - gamma load on AC."""
    domain = triangle_mesh(MPI.COMM_WORLD, n, length, seed)

    def edge(where):
        return mesh.locate_entities_boundary(domain, 1, where)

    V = fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, gamma = fem.Function(V, name="displacement"), fem.Constant(domain, -1.0)
    slope = edge(lambda x: np.isclose(x[0] + x[1], length))
    side = np.sort(edge(lambda x: np.isclose(x[0], 0.0, atol=1e-9 * length)))
    bottom = edge(lambda x: np.isclose(x[1], 0.0, atol=1e-9 * length))
    tags = mesh.meshtags(domain, 1, side, np.ones(len(side), dtype=np.int32))
    ds = ufl.Measure("ds", domain, subdomain_data=tags)(1)
    energy = LinearElastic(*lame).energy(u) * ufl.dx
    traction = fem.Constant(domain, preload) - gamma * fem.Constant(domain, load)
    energy -= ufl.dot(traction, u) * ds
    clamped = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, slope), V)
    floor = HalfSpace((0, 0), (0, 1))
    surface = ContactSurface(u, bottom, obstacle=floor, law=Coulomb(friction))
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=[clamped], r=r), gamma)


# ## The solutions at the ends
#
# Every branch that leaves gamma = 0 is a ray and ends at gamma = -1 or 1, so that the ends of the
# edges of the graph are all the solutions that were found there.


def observe(system, point):
    table = system.result_at(point).tables["contact"]
    free = table.letters != "d"  # B belongs to the support
    return {
        "status": "".join(table.letters[free]),
        "ut_A": float(table.ut[0, 0]),
        "un_A": float(table.un[0]),
        "sum_rt": float(table.rt[free, 0].sum()),
        "sum_rn": float(table.rn[free].sum()),
    }


def described(status):
    """12 o 3 k: runs of one status."""
    runs = []
    for letter in status:
        if runs and runs[-1][1] == letter:
            runs[-1][0] += 1
        else:
            runs.append([1, letter])
    names = {"o": "open", "k": "stick", "+": "slip right", "-": "slip left"}
    return ", ".join(f"{count} {names[letter]}" for count, letter in runs)


def draw_diagram(path, ends):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    colours = ["#2e4a6b", "#c0392b", "#2e9e4f", "#e8892b", "#7d5ba6", "#555555"]
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    labels = {"ut_A": "$u_t$ of A", "un_A": "gap of A", "sum_rn": "normal force"}
    for axis, (key, label) in zip(axes, labels.items(), strict=True):
        for k, (gamma, solution) in enumerate(ends):
            axis.plot(
                [0, gamma],
                [0, solution[key]],
                color=colours[k % len(colours)],
                lw=2,
                label=described(solution["status"]),
            )
        axis.plot(0, 0, "o", color="black", ms=5)
        axis.set(xlabel=r"$\gamma$", title=label)
        axis.spines[["top", "right"]].set_visible(False)
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    system = linear_triangle(
        args.n, args.friction, args.load, args.lame, args.length, args.r, args.seed
    )
    result = system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)

    plain, factor = StepControl(), args.step_factor
    control = StepControl(
        initial=min(factor * plain.initial, 1.0), maximum=min(factor * plain.maximum, 1.0)
    )
    begun = time.perf_counter()
    diagram = explore(
        system, [(x, -1.0)], gamma_range=(-1.0, 1.0), control=control, route=args.route
    )
    seconds = time.perf_counter() - begun

    ends = [diagram.branches[0].points[0]]
    ends += [b.points[-1] for b in diagram.branches if abs(b.points[-1].gamma) == 1.0]
    found = [(p.gamma, observe(system, p)) for p in ends]
    order = sorted(range(len(found)), key=lambda k: (found[k][0], found[k][1]["status"]))
    ends, found = [ends[k] for k in order], [found[k] for k in order]
    scalars = {
        "converged": diagram.reason == "every ray has been followed",
        "newton_iterations": result.iterations,
        "dofs": x.getSize(),
        "solutions": {
            key: [solution for gamma, solution in found if gamma == float(key)]
            for key in ("-1", "1")
        },
        "complete": diagram.complete,
        "methods": sorted({node.point.method for node in diagram.nodes}),
        "bifurcation_gamma": [node.point.gamma for node in diagram.nodes],
        "points": [len(b.points) for b in diagram.branches],
        "gammas": [[p.gamma for p in b.points] for b in diagram.branches],
        "augmentation": system.problem.surfaces[0].mean_augmentation,
        "explore_seconds": seconds,
    }
    size = max(float(np.abs(s["ut_A"])) for _, s in found) or 1.0
    titles = [f"$\\gamma$ = {gamma:g}: {described(s['status'])}" for gamma, s in found]
    picture_of_states(
        folder / "states.png", system, ends, titles=titles, scale=0.15 * args.length / size
    )
    if comm.rank == 0:
        draw_diagram(folder / "diagram.png", found)
        for gamma, s in found:
            print(
                f"gamma = {gamma:+g}: {described(s['status'])}; at A ut = {s['ut_A']:.7g}, "
                f"un = {s['un_A']:.7g}; forces {s['sum_rt']:.7g}, {s['sum_rn']:.7g}"
            )
        sure = "proved complete by" if diagram.complete else "not proved complete; tried:"
        print(f"the set of rays at gamma = 0 is {sure} {', '.join(scalars['methods'])}")
        print(f"{len(diagram.edges)} branches in {seconds:.2f} s; pictures in {folder}")
    return write_summary(comm, folder, scalars)


if __name__ == "__main__":
    main()
