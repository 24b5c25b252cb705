# SPDX-License-Identifier: LGPL-3.0-or-later
# # The friction coefficient as the parameter
#
# This demo illustrates how to:
#
# - follow solutions as the *friction coefficient* varies, the load being fixed;
# - find the coefficient at which two of them meet and end.
#
# Hild's triangle (see `demo_hild_triangle.py`) under a load (F1, F2) that pulls to the left more
# than it presses: |F1|/|F2| beyond the critical coefficient kt/k, which is
# (lambda + 3 mu)/(lambda + mu). With strong friction A may stick. As the coefficient F falls, the
# shear reaches its bound at F = |F1|/|F2|; no solution in contact exists below, and the branch
# turns back: A now slips to the left while F *grows*, with ut = (pt + F |pn|)/(kt - F k) in closed
# form. Sticking and slipping are born together, and the open solution, which knows no friction,
# exists beside them.

import argparse

from mpi4py import MPI

import numpy as np
from demo_hild_triangle import triangle

from dolfinx_contact import parse_arguments
from dolfinx_contact.continuation import Follower, StepControl
from dolfinx_contact.output import output_folder, write_summary
from dolfinx_contact.parametric import ParametricContact


def arguments(argv=None):
    parser = argparse.ArgumentParser(description="Follow one element by its friction coefficient")
    parser.add_argument("--lame", type=float, nargs=2, default=(1.0, 1.0), metavar=("LAMBDA", "MU"))
    parser.add_argument("--load", type=float, nargs=2, default=(-2.4, -1.0), metavar=("F1", "F2"))
    parser.add_argument("--friction-max", type=float, default=5.0)
    parser.add_argument("--length", type=float, default=1.0)
    parser.add_argument("--step-factor", type=float, default=1.0, help="of the default steps")
    parser.add_argument("--r", type=float, default=None, help="augmentation parameter")
    parser.add_argument("--seed", type=int, default=None, help="renumbers the mesh at random")
    parser.add_argument("--output", default="output/friction_parameter")
    args = parse_arguments(parser, argv)
    critical = (args.lame[0] + 3 * args.lame[1]) / (args.lame[0] + args.lame[1])
    f1, f2 = args.load
    if not (f2 < 0 and critical < -f1 / -f2 < args.friction_max):
        parser.error(f"needs F2 < 0 and {critical:g} < F1/F2 < --friction-max")
    return args


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = output_folder(comm, args.output)
    problem, load = triangle(args.lame, args.friction_max, args.length, args.r, args.seed)
    load.value[:] = args.load
    (surface,) = problem.surfaces
    system = ParametricContact(problem, surface.law.friction)

    # The stuck state in closed form: A does not move and its traction balances the load.
    at_A = int(np.argmin(np.linalg.norm(surface.positions, axis=1)))
    surface.multiplier.x.array.reshape(-1, 2)[at_A] = -np.asarray(args.load)
    x = system.create_vector()
    problem.write(x)

    def observe(follower, point):
        x, _ = follower.bordered.split(point.y)
        problem.read(x)
        state = surface.state()
        force = state["traction"][at_A] * state["area"][at_A]
        letter = system.letters(point.piece)[0]
        return [letter, point.gamma, float(state["ut"][at_A, 0]), *force.tolist()]

    plain = StepControl()
    control = StepControl(
        initial=min(plain.initial * args.step_factor, 1.0),
        maximum=min(plain.maximum * args.step_factor, 1.0),
    )
    with Follower(system, control, gamma_scale=args.friction_max) as follower:
        start = follower.start(x, args.friction_max, increasing=False)
        branch = follower.run(start, (0.0, args.friction_max))
        seen = [observe(follower, p) for p in branch.points]

    # The closed form of the slipping half, S = [[kt, k], [k, kt]] and p = l/2 (F1, F2).
    kt, k = (args.lame[0] + 3 * args.lame[1]) / 2, (args.lame[0] + args.lame[1]) / 2
    pt, pn = args.length * np.asarray(args.load) / 2
    errors = [abs(ut - (pt - F * pn) / (kt - F * k)) for letter, F, ut, *_ in seen if letter == "-"]
    scalars = {
        "converged": branch.reason == "gamma reached the end of its range",
        "newton_iterations": sum(p.corrections for p in branch.points),
        "dofs": x.getSize(),
        "folds": [{"gamma": s.gamma, "smooth": s.smooth} for s in branch.folds],
        "fold_closed_form": pt / pn,
        "slip_error": max(errors) / args.length,
        "statuses": "".join(letter for letter, *_ in seen),
        "points": len(branch.points),
        "gammas": [p.gamma for p in branch.points],
        "augmentation": surface.mean_augmentation,
        "gamma_end": branch.points[-1].gamma,
    }
    if comm.rank == 0:
        draw(folder / "branch.png", seen)
        for s in branch.folds:
            print(f"stick and slip meet at F = {s.gamma:.12f} (closed form {pt / pn:.12f})")
        print(f"slip against the closed form: {scalars['slip_error']:.1e}; {branch.reason}")
    return write_summary(comm, folder, scalars)


def draw(path, seen):
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
    for letter, name, colour in (("k", "stick", "#2e6db4"), ("-", "slip left", "#e8892b")):
        points = [(F, ut) for kind, F, ut, *_ in seen if kind == letter]
        axes.plot(*zip(*points, strict=True), color=colour, lw=2.2, marker=".", label=name)
    axes.set(xlabel="friction coefficient F", ylabel="$u_t$ of A")
    axes.set_title("Two solutions in contact, born at F = |F1|/|F2|", loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    main()
