# SPDX-License-Identifier: LGPL-3.0-or-later
# # Following one element through two folds
#
# This demo illustrates how to:
#
# - make a contact problem depend on a parameter gamma and follow its solutions as gamma varies;
# - pass points where the status changes and gamma turns back, located to round-off;
# - read off all solutions of the branch at one gamma.
#
# Hild's triangle (see `demo_hild_triangle.py`) under the traction (0, -1) + gamma (-4, 0): A sticks
# until the shear reaches the friction bound at gamma = F |F2| / 4. If F is larger than the critical
# coefficient (lambda + 3 mu)/(lambda + mu) the branch turns back there, slips to the left while the
# load *decreases*, and turns forward again where the pressure vanishes and A lifts off. Between the
# two folds there are three solutions.

import argparse

from mpi4py import MPI

import numpy as np
from demo_hild_triangle import element

import ufl
from dolfinx import fem

from dolfinx_contact import ContactProblem, ContactSurface, Coulomb, HalfSpace, parse_arguments
from dolfinx_contact.continuation import StepControl, follow
from dolfinx_contact.materials import LinearElastic
from dolfinx_contact.output import output_folder, write_summary
from dolfinx_contact.parametric import ParametricContact


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="Follow one element through two nonsmooth folds")
    parser.add_argument("--friction", type=float, default=2.5)
    parser.add_argument("--lame", type=float, nargs=2, default=(100.0, 82.0))
    parser.add_argument("--load-start", type=float, nargs=2, default=(0.0, -1.0))
    parser.add_argument("--load-direction", type=float, nargs=2, default=(-4.0, 0.0))
    parser.add_argument("--gamma-max", type=float, default=1.0)
    parser.add_argument("--length", type=float, default=1.0)
    parser.add_argument("--route", choices=("auto", "pivoting", "steps"), default="auto")
    parser.add_argument("--step-factor", type=float, default=1.0, help="of the default steps")
    parser.add_argument("--r", type=float, default=None, help="augmentation parameter")
    parser.add_argument("--seed", type=int, default=None, help="renumbers the mesh at random")
    parser.add_argument("--output", default="output/single_element")
    return parse_arguments(parser, argv)


def triangle(args):
    """The element, alone on every rank, with gamma in its load."""
    u, ds, bottom, clamped = element(args.length, args.seed)
    domain = u.function_space.mesh
    gamma = fem.Constant(domain, 0.0)
    start, direction = (fem.Constant(domain, v) for v in (args.load_start, args.load_direction))
    energy = LinearElastic(*args.lame).energy(u) * ufl.dx
    energy -= ufl.dot(start + gamma * direction, u) * ds
    surface = ContactSurface(
        u, bottom, obstacle=HalfSpace((0, 0), (0, 1)), law=Coulomb(args.friction)
    )
    return ParametricContact(ContactProblem(energy, u, [surface], bcs=[clamped], r=args.r), gamma)


def observe(system, y, size):
    """(ut, un, rt, rn) at A."""
    x = system.create_vector()
    x.array[:] = y.array_r[:size]
    system.problem.read(x)
    (surface,) = system.problem.surfaces
    state = surface.state()
    at = int(np.argmin(np.linalg.norm(state["x"], axis=1)))
    force = state["traction"][at] * state["area"][at]
    return [float(v) for v in (state["ut"][at, 0], state["un"][at], *force)]


# ## Solutions of the branch at one gamma
#
# Wherever the branch passes gamma. The pieces of a linear element are straight, so linear
# interpolation between two points of a piece is exact.


def solutions_at(gamma, branch, values, letters):
    found = []
    for k in range(1, len(branch.points)):
        a, b = branch.points[k - 1], branch.points[k]
        if (a.gamma - gamma) * (b.gamma - gamma) < 0:
            weight = (gamma - a.gamma) / (b.gamma - a.gamma)
            value = (1 - weight) * np.array(values[k - 1]) + weight * np.array(values[k])
            keys = ("ut_left", "un_left", "sum_rt", "sum_rn")
            found.append({"status": letters[k - 1], **dict(zip(keys, value.tolist(), strict=True))})
    return {"gamma": gamma, "solutions": found}


def draw(path, branch, values, letters):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    colours = {"o": "#7f8c8d", "k": "#2e6db4", "+": "#2e9e4f", "-": "#e8892b"}
    names = {"o": "open", "k": "stick", "+": "slip right", "-": "slip left"}
    gammas = [p.gamma for p in branch.points]
    labels = ["$u_t$ at A", "gap at A", "$r_t$ at A", "$r_n$ at A"]
    figure, axes = plt.subplots(2, 2, figsize=(9, 6.5), sharex=True, layout="constrained")
    for i, (axis, label) in enumerate(zip(axes.flat, labels, strict=True)):
        for k in range(1, len(gammas)):
            axis.plot(
                gammas[k - 1 : k + 1],
                [values[k - 1][i], values[k][i]],
                color=colours[letters[k - 1][0]],
                lw=2.5,
                marker=".",
            )
        for s in branch.folds:
            axis.axvline(s.gamma, color="0.7", lw=0.8, ls="--")
        axis.set(ylabel=label)
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes[1]:
        axis.set(xlabel=r"load factor $\gamma$")
    present = [k for k in names if any(word.startswith(k) for word in letters)]
    handles = [plt.Line2D([], [], color=colours[k], lw=2.5, label=names[k]) for k in present]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(present), frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    system = triangle(args)
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    plain = StepControl()
    control = StepControl(
        initial=min(plain.initial * args.step_factor, 1.0),
        maximum=min(plain.maximum * args.step_factor, 1.0),
    )
    span = (-0.1 * args.gamma_max, args.gamma_max)
    branch = follow(system, x, 0.0, gamma_range=span, control=control, route=args.route)
    values = [observe(system, p.y, x.getLocalSize()) for p in branch.points]
    letters = [system.letters(p.piece) for p in branch.points]
    folds = [
        {
            "gamma": s.gamma,
            "kind": "smooth" if s.smooth else "nonsmooth",
            "before": "ok+-"[s.changes[0].before],
            "after": "ok+-"[s.changes[0].after],
        }
        for s in branch.folds
    ]
    # The closed form, for a horizontal load that grows to the left: S = [[kt, k], [k, kn]].
    kt, k = (args.lame[0] + 3 * args.lame[1]) / 2, (args.lame[0] + args.lame[1]) / 2
    pressure, rate = -args.load_start[1], -args.load_direction[0]
    closed = [args.friction * pressure / rate, kt / k * pressure / rate]
    scalars = {
        "converged": branch.reason == "gamma reached the end of its range",
        "newton_iterations": sum(p.corrections for p in branch.points),
        "dofs": x.getSize(),
        "folds": folds,
        "folds_closed_form": closed,
        "bifurcations": len(branch.bifurcations),
        "events": sum(not s.smooth for s in branch.special),
        "points": len(branch.points),
        "gammas": [p.gamma for p in branch.points],
        "augmentation": system.problem.surfaces[0].mean_augmentation,
        "factorisations": branch.factorisations,
        "gamma_end": branch.points[-1].gamma,
    }
    if len(folds) == 2:
        middle = (folds[0]["gamma"] + folds[1]["gamma"]) / 2
        scalars["solutions_at"] = solutions_at(middle, branch, values, letters)
    if comm.rank == 0:
        draw(folder / "branch.png", branch, values, letters)
        for fold, exact in zip(folds, closed, strict=False):
            print(
                f"fold at gamma = {fold['gamma']:.12f} (closed form {exact:.12f}), "
                f"{fold['before']} -> {fold['after']}"
            )
        for s in scalars.get("solutions_at", {}).get("solutions", []):
            print("  ", s)
        print(branch.reason, f"({branch.factorisations} factorisations)")
    return write_summary(comm, folder, scalars)


if __name__ == "__main__":
    main()
