# SPDX-License-Identifier: LGPL-3.0-or-later
"""All branches of the triangle.

Reference: GetFEM, proof. `demos/demo_linear_triangle.py` explains the problem.
"""

import itertools
import time

from mpi4py import MPI

from _case import ScriptParser
from _triangle import linear_triangle

from dolfinx_contact import io, plot, records
from dolfinx_contact.analysis import prove_counts
from dolfinx_contact.continuation import Branch, explore
from dolfinx_contact.records import leftmost, total

#: Outputs; A is the leftmost contact point.
FUNCTIONALS = dict(ut_A=leftmost("ut"), un_A=leftmost("un"), sum_rt=total("rt"), sum_rn=total("rn"))


def described(status):
    """12 open, 3 stick: runs of one status."""
    words = {"o": "open", "k": "stick", "+": "slip right", "-": "slip left"}
    runs = []
    for letter, run in itertools.groupby(status):
        count = len(list(run))
        runs.append(f"{count} {words[letter]}")
    return ", ".join(runs)


def ends_of(system, diagram):
    """The points of the branches at gamma = -1 and 1, in order."""
    ends = []
    for branch in diagram.branches:
        for point in (branch.points[0], branch.points[-1]):
            if abs(point.gamma) == 1:
                ends.append(point)
    ends.sort(key=lambda point: (point.gamma, system.letters(point.piece)))
    return ends


def draw(folder, comm, system, diagram, ends, found, titles, length, proofs):
    """The bodies at the ends, and the normal force, gap and slip along the branches."""
    largest = max(abs(s["ut_A"]) for s in found)
    scale = 0.15 * length / (largest or 1.0)
    plot.picture_of_states(folder / "states.png", system, ends, titles=titles, scale=scale)
    journal = records.journal_of(system, diagram.branches, FUNCTIONALS)
    if comm.rank > 0:
        return
    names = []
    for k in journal.branches:
        first = journal.rows(k)[0]
        names.append(described(first["status"]))
    seen = {"ut_A": "$u_t$ of A", "un_A": "gap of A", "sum_rn": "normal force"}
    plot.draw_diagram(folder / "diagram.png", journal, seen, names=names, strips=0, proved=proofs)


def main(argv=None):
    body = dict(n=64, friction=1.7, load=(26.0, 7.5), lame=(100.0, 82.0), length=1.0)
    parser = ScriptParser("A triangle", output="output/linear_triangle", route="auto", **body)
    args = parser.parse(argv)
    comm = MPI.COMM_WORLD
    folder = io.output_folder(comm, args.output)
    say = io.Report(comm)
    system = linear_triangle(args.n, args.friction, args.load, args.lame, args.length)
    problem = system.problem
    result = problem.solve()
    x = system.create_vector()
    problem.write(x)

    begun = time.perf_counter()
    diagram = explore(system, [(x, -1.0)], gamma_range=(-1.0, 1.0), route=args.route)
    explored = time.perf_counter()
    counts = prove_counts(system, diagram, gammas=(-1.0, 1.0))
    proofs = [count.solutions for count in counts]
    proved = time.perf_counter()
    seconds = explored - begun

    ends = ends_of(system, diagram)
    found = records.journal_of(system, [Branch(ends)], FUNCTIONALS).rows()
    titles = [f"gamma = {s['gamma']:g}: {described(s['status'])}" for s in found]
    draw(folder, comm, system, diagram, ends, found, titles, args.length, proofs)
    if comm.rank == 0:
        counts.save(folder / "counts", overwrite=True)
    for title, s in zip(titles, found, strict=True):
        values = [f"{name} = {s[name]:.7g}" for name in FUNCTIONALS]
        say(f"{title}; {', '.join(values)}")

    # Nothing is missing if the proofs found as many solutions as branches end there.
    proved_number = sum(len(p.found) for p in proofs)
    complete = all(p.complete for p in proofs) and proved_number == len(ends)
    methods = [p.method for p in proofs]
    verdict = "proved" if complete else "not proved"
    say(f"{verdict} to be all at gamma = -1 and 1: {', '.join(methods)}")
    say(f"{len(diagram.edges)} branches in {seconds:.2f} s; pictures in {folder}")

    summary = diagram.summary()
    summary["explore_seconds"] = seconds
    summary["proof_seconds"] = proved - explored
    summary["newton_iterations"] = result.iterations
    summary["dofs"] = result.dofs
    summary["complete"] = complete
    summary["proofs"] = methods
    summary["augmentation"] = problem.surfaces[0].points.mean_augmentation
    summary["solutions"] = {
        "-1": [s for s in found if s["gamma"] == -1.0],
        "1": [s for s in found if s["gamma"] == 1.0],
    }
    return io.write_summary(comm, folder, summary)


if __name__ == "__main__":
    main()
