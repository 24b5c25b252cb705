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

from mpi4py import MPI

import numpy as np
from demo_hild_triangle import element

from dolfinx_contact import output
from dolfinx_contact.command_line import ScriptParser, number
from dolfinx_contact.continuation import find_solutions, follow
from dolfinx_contact.parametric import ParametricContact


def arguments(argv=None):
    given = dict(lame=(1.0, 1.0), load=(-2.4, -1.0), length=1.0)
    parser = ScriptParser("Friction as parameter", output="output/friction_parameter", **given)
    parser.add_argument("--friction-max", type=number(above=0), default=5.0, help="where to begin")
    args = parser.parse(argv)
    critical = (args.lame[0] + 3 * args.lame[1]) / (args.lame[0] + args.lame[1])
    f1, f2 = args.load
    if not (f2 < 0 and critical < -f1 / -f2 < args.friction_max):
        parser.error(f"needs F2 < 0 and {critical:g} < F1/F2 < --friction-max")
    return args


# ## Where the branch begins
#
# `find_solutions` lists all solutions under the load; that in which A sticks is taken. It does not
# depend on F as long as F is large enough. The parameter is the Constant in the friction law.


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder, say = output.output_folder(comm, args.output), output.Report(comm)
    loaded = element(args.lame, args.friction_max, args.length, args.load)
    every = find_solutions(loaded, [loaded.create_vector()], 1.0)
    (stuck,) = (s for s in every.found if loaded.letters(s.piece).startswith("k"))
    loaded.set_parameter(1.0)
    (surface,) = loaded.problem.surfaces
    system = ParametricContact(loaded.problem, surface.law.friction)
    span = (0.0, args.friction_max)
    branch = follow(system, stuck.x, args.friction_max, gamma_range=span, increasing=False)
    journal = output.journal_of(system, [branch], {"ut": output.leftmost("ut")})

    # The closed form of the slipping half, S = [[kt, k], [k, kt]] and p = l/2 (F1, F2).
    kt, k = (args.lame[0] + 3 * args.lame[1]) / 2, (args.lame[0] + args.lame[1]) / 2
    pt, pn = args.length * np.asarray(args.load) / 2
    slips = [s for s in journal.rows() if s["status"] == "-"]
    errors = [abs(s["ut"] - (pt - s["gamma"] * pn) / (kt - s["gamma"] * k)) for s in slips]
    summary = branch.summary() | {
        "dofs": stuck.x.getSize(),
        "folds": [{"gamma": s.gamma, "smooth": s.smooth} for s in branch.folds],
        "fold_closed_form": pt / pn,
        "slip_error": max(errors) / args.length,
        "statuses": "".join(s["status"] for s in journal.rows()),
        "augmentation": surface.mean_augmentation,
    }
    for s in branch.folds:
        say(f"stick and slip meet at F = {s.gamma:.12f} (closed form {pt / pn:.12f})")
    say(f"slip against the closed form: {summary['slip_error']:.1e}; {branch.reason}")
    if comm.rank == 0:
        words = dict(label="$u_t$ of A", parameter="friction coefficient F")
        title = "Two solutions in contact, born at F = |F1|/|F2|"
        output.draw_diagram(folder / "branch.png", journal, "ut", title=title, **words)
    return output.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
