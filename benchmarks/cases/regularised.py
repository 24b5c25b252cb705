# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solutions lost by a regularised law.

Reference: branches of the true law. `demos/demo_regularised.py` explains the problem.
"""

from mpi4py import MPI

import numpy as np
from _case import ScriptParser, number
from _triangle import linear_triangle, true_solutions

from dolfinx import fem

from dolfinx_contact import Coulomb, ParametricContact, Regularised, io, plot, records
from dolfinx_contact.continuation import Branch, follow
from dolfinx_contact.records import leftmost, total

#: Outputs; A is the leftmost contact point.
FUNCTIONALS = dict(ut_A=leftmost("ut"), un_A=leftmost("un"), sum_rt=total("rt"), sum_rn=total("rn"))


def arguments(argv=None):
    parser = ScriptParser("Regularised friction", output="output/regularised", n=16, friction=2.0)
    parser.add_argument("--width", type=number(above=0), default=1e-4, help="eps, small")
    parser.add_argument("--shape", choices=["tanh", "sqrt", "polynomial"], default="tanh")
    return parser.parse(argv)


def creeping(args, true, stuck):
    true.result_at(stuck)
    given = []

    def law(domain):
        eps = fem.Constant(domain, args.width)
        given.append(eps)
        coulomb = Coulomb(fem.Constant(domain, args.friction))
        return Regularised(coulomb, eps, args.shape)

    loaded = linear_triangle(args.n, args.friction, law=law)
    loaded.set_parameter(1.0)
    problem = loaded.problem
    problem.u.x.array[:] = true.problem.u.x.array
    force = problem.surfaces[0].multiplier
    true_force = true.problem.surfaces[0].multiplier
    force.x.array[:] = true_force.x.array
    problem.solve()
    system = ParametricContact(problem, given[0])
    x = system.create_vector()
    problem.write(x)
    return system, x


def from_above(system, widths):
    for field in system.problem.fields:
        field.x.array[:] = 0.0
    rows = []
    for width in widths:
        system.set_parameter(width)
        result = system.problem.solve()
        table = result.tables["contact"]
        slips = table.along(table.ut)
        row = {
            "eps": width,
            "status": table.status,
            "ut_A": float(slips[0]),
            "un_A": float(table.un[0]),
        }
        rows.append(row)
    return rows


def main(argv=None):
    args = arguments(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    true, ends = true_solutions(args.n, args.friction)
    rows = records.journal_of(true, [Branch(ends)], FUNCTIONALS).rows()
    for row in rows:
        say(f"true: A {row['status'][0]}, slip {row['ut_A']:.7g}, gap {row['un_A']:.3g}")
    stuck = next(point for point in ends if true.letters(point.piece)[0] == "k")
    system, x = creeping(args, true, stuck)
    branch = follow(system, x, args.width, gamma_range=(0.1 * args.width, 1.0))
    journal = records.journal_of(system, [branch], FUNCTIONALS)
    (lost,) = [s.gamma for s in branch.folds]
    last = journal.rows()[-1]
    say(f"two of them are lost in a fold at eps = {lost:.7g}; beyond it the branch goes back")
    say(f"to eps = {last['gamma']:.1e} with a slip of {last['ut_A']:.7g}")
    widths = np.geomspace(3.0 * lost, 0.1 * args.width, 12)
    falling = from_above(system, widths.tolist())
    reached = falling[-1]
    say(f"a falling eps arrives at A {reached['status'][0]}, slip {reached['ut_A']:.7g}")
    if comm.rank == 0:
        points = journal.columns()
        passed = [row["eps"] for row in falling]
        slips = [row["ut_A"] for row in falling]
        curves = {
            "creep, then slip": (points["gamma"], points["ut_A"]),
            "from a large eps": (passed, slips),
        }
        letters = {"o": "opens", "k": "sticks", "-": "slips"}
        marks = {}
        for row in rows:
            what = letters[row["status"][0]]
            marks[f"true: A {what}"] = ([0.0], [row["ut_A"]])
        labels = (r"$\varepsilon$", "$u_t$ of A")
        plot.draw_curves(folder / "eps.png", curves, marks=marks, labels=labels)

    summary = {
        "true": rows,
        "lost_at": lost,
        "end_slip": last["ut_A"],
        "end_eps": last["gamma"],
        "reached": reached,
    }
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
