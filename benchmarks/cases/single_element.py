# SPDX-License-Identifier: LGPL-3.0-or-later
"""A branch with two folds.

Reference: closed form.

Hild's triangle (see `hild_triangle.py`) under the traction (0, -1) + gamma (-4, 0): A sticks
until the shear reaches the friction bound at gamma = F |F2| / 4. If F is larger than the critical
coefficient (lambda + 3 mu)/(lambda + mu) the branch turns back there, slips to the left while the
load *decreases*, and turns forward again where the pressure vanishes and A lifts off. Between the
two folds there are three solutions.
"""

from mpi4py import MPI

from _case import ScriptParser, number
from _triangle import element

from dolfinx_contact import io, plot, records
from dolfinx_contact.continuation import Branch, follower_for
from dolfinx_contact.records import leftmost

#: Outputs with labels; A is the leftmost contact point.
FUNCTIONALS = dict(
    ut_left=leftmost("ut"), un_left=leftmost("un"), sum_rt=leftmost("rt"), sum_rn=leftmost("rn")
)
LABELS = dict(ut_left="$u_t$ at A", un_left="gap at A", sum_rt="$r_t$ at A", sum_rn="$r_n$ at A")


def arguments(argv=None):
    given = dict(friction=2.5, lame=(100.0, 82.0), length=1.0, route="auto")
    parser = ScriptParser("One element, two folds", output="output/single_element", **given)
    for name, value in (("--load-start", (0.0, -1.0)), ("--load-direction", (-4.0, 0.0))):
        parser.add_argument(name, type=number(), nargs=2, default=value, help="of the traction")
    parser.add_argument("--gamma-max", type=number(above=0), default=1.0, help="end of the branch")
    return parser.parse(argv)


# Follow it.
#
# The branch begins at gamma = 0, with a solution of the problem there. Every point of a branch
# knows its statuses, every special point what changes at it. `follower.at` reads off the points at
# one gamma, wherever the branch passes it.


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    load = args.load_direction, args.load_start
    system = element(args.lame, args.friction, args.length, *load)
    system.set_parameter(0.0)
    system.problem.solve()
    x = system.create_vector()
    system.problem.write(x)
    low = -0.1 * args.gamma_max
    high = args.gamma_max
    with follower_for(system, x, 0.0, gamma_scale=high - low, route=args.route) as follower:
        branch = follower.run(follower.start(x, 0.0), gamma_range=(low, high))
        middle = sum(s.gamma for s in branch.folds) / (len(branch.folds) or 1)
        there = follower.at(branch, middle) if len(branch.folds) == 2 else []

    journal = records.journal_of(system, [branch], FUNCTIONALS)
    special = [s for p in journal.branches[0].points for s in p.special]
    folds = [
        {
            "gamma": s.gamma,
            "kind": "smooth" if s.smooth else "nonsmooth",
            "before": s.changes[0].before,
            "after": s.changes[0].after,
        }
        for s in special
        if s.kind == "fold"
    ]
    # The closed form, for a horizontal load that grows to the left: S = [[kt, k], [k, kt]].
    kt = (args.lame[0] + 3 * args.lame[1]) / 2
    k = (args.lame[0] + args.lame[1]) / 2
    pressure = -args.load_start[1]
    rate = -args.load_direction[0]
    closed = [args.friction * pressure / rate, kt / k * pressure / rate]
    summary = branch.summary() | {
        "dofs": x.getSize(),
        "folds": folds,
        "folds_closed_form": closed,
        "bifurcations": len(branch.bifurcations),
        "events": sum(not s.smooth for s in special),
        "augmentation": system.problem.surfaces[0].points.mean_augmentation,
    }
    for fold, exact in zip(folds, closed, strict=False):
        say(
            f"fold at gamma = {fold['gamma']:.12f} (closed form {exact:.12f}), "
            f"{fold['before']} -> {fold['after']}"
        )
    if there:
        rows = records.journal_of(system, [Branch(there)], FUNCTIONALS).rows()
        words = [{"status": system.letters(p.piece)} for p in there]
        found = [row | word for row, word in zip(rows, words, strict=True)]
        summary["solutions_at"] = {"gamma": middle, "solutions": found}
        say("\n".join(f"   {s}" for s in found))
    say(branch.reason)
    if comm.rank == 0:
        plot.draw_diagram(folder / "branch.png", journal, LABELS)
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
