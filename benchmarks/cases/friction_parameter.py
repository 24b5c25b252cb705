# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction as the parameter, one element.

Reference: closed form. `demos/demo_friction_parameter.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _triangle import element

from dolfinx_contact import ParametricContact, io, plot, records
from dolfinx_contact.continuation import find_solutions, follow


def arguments(argv=None):
    given = dict(lame=(1.0, 1.0), load=(-2.4, -1.0), length=1.0)
    parser = ScriptParser("Friction as parameter", output="output/friction_parameter", **given)
    parser.add_argument("--friction-max", type=number(above=0), default=5.0, help="where to begin")
    args = parser.parse(argv)
    lmbda, mu = args.lame
    critical = (lmbda + 3 * mu) / (lmbda + mu)
    f1, f2 = args.load
    if not (f2 < 0 and critical < -f1 / -f2 < args.friction_max):
        parser.error(f"needs F2 < 0 and {critical:g} < F1/F2 < --friction-max")
    return args


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    loaded = element(args.lame, args.friction_max, args.length, args.load)
    start = loaded.create_vector()
    every = find_solutions(loaded, [start], 1.0)
    (stuck,) = [s for s in every.found if loaded.letters(s.piece).startswith("k")]
    loaded.set_parameter(1.0)
    (surface,) = loaded.problem.surfaces
    system = ParametricContact(loaded.problem, surface.law.friction)
    span = (0.0, args.friction_max)
    branch = follow(system, stuck.x, args.friction_max, gamma_range=span, direction="decreasing")
    journal = records.journal_of(system, [branch], {"ut": records.leftmost("ut")})
    rows = journal.rows()

    # The closed form of the slipping half, S = [[kt, k], [k, kt]] and p = l/2 (F1, F2).
    lmbda, mu = args.lame
    kt = (lmbda + 3 * mu) / 2
    k = (lmbda + mu) / 2
    pt, pn = args.length * np.asarray(args.load) / 2
    fold = pt / pn
    errors = []
    for s in rows:
        if s["status"] == "-":
            friction = s["gamma"]
            slip = (pt - friction * pn) / (kt - friction * k)
            errors.append(abs(s["ut"] - slip))
    slip_error = max(errors) / args.length

    for s in branch.folds:
        say(f"stick and slip meet at F = {s.gamma:.12f} (closed form {fold:.12f})")
    say(f"slip against the closed form: {slip_error:.1e}; {branch.reason}")
    if comm.rank == 0:
        title = "Two solutions in contact, born at F = |F1|/|F2|"
        words = dict(title=title, parameter="friction coefficient F")
        plot.draw_diagram(folder / "branch.png", journal, {"ut": "$u_t$ of A"}, **words)

    summary = branch.summary()
    summary["dofs"] = stuck.x.getSize()
    summary["folds"] = [{"gamma": s.gamma, "smooth": s.smooth} for s in branch.folds]
    summary["fold_closed_form"] = fold
    summary["slip_error"] = slip_error
    summary["statuses"] = "".join(s["status"] for s in rows)
    summary["augmentation"] = loaded.problem.discrete(surface).points.mean_augmentation
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
