# SPDX-License-Identifier: LGPL-3.0-or-later
"""Do all folds, rays and branches come out, however the problem is put?

Every demo of continuation is run as it is, and through tests/support/harness.py with steps 0.1 and
10 times as long, in other units (E and loads times 1e9, lengths times 1e3), with the augmentation
parameter
r times 0.1, 10 and 100, on a mesh that is renumbered at random, and on 2 and 3 ranks. What was
found must be the same each time; under units, renumbering and ranks the gammas of all points must
be the same as well, to 1e-8 of the range of gamma. Prints a Markdown table, and writes it beside
the JSON.

    python3 benchmarks/invariance.py --output invariance.json
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
CASES = {
    "reference": {},
    "steps / 10": {"step_factor": 0.1},
    "steps * 10": {"step_factor": 10.0},
    "units": {"stress": 1e9, "length": 1e3},
    "r / 10": {"r": 0.1},
    "r * 10": {"r": 10.0},
    "r * 100": {"r": 100.0},
    "renumbered": {"seed": 1},
    "2 ranks": {"ranks": 2},
    "3 ranks": {"ranks": 3},
}
#: Cases in which every point of every branch must come out again.
SAME_POINTS = ("units", "renumbered", "2 ranks", "3 ranks")
FOUND = 1e-6
POINTS = 1e-8
#: The V-shaped body: its material, its body force at either end, and where solutions are counted.
VEE = {"lame": (100.0, 82.0), "force": (0.0, -6.0, -14.0, -6.0), "at": 0.7}


@dataclass
class Problem:
    """A demo, the options of a case, and what it found: names, and numbers without units."""

    demo: str
    options: tuple

    def command(self, stress, length, seed, folder):
        """Options of the demo, and of the harness."""
        raise NotImplementedError

    def found(self, s, length):
        raise NotImplementedError

    def what(self, s):
        """In words."""
        kinds = [f["kind"] + " " if "kind" in f else "" for f in s["folds"]]
        named = ", ".join(f"{kinds.count(k)} {k}fold(s)" for k in sorted(set(kinds)))
        there = s.get("solutions_at", {}).get("solutions", [])
        return named + (f", {len(there)} solutions between" if there else "")


def numbers(*values):
    return [repr(float(v)) for v in values]


class SingleElement(Problem):
    def command(self, stress, length, seed, folder):
        loads = ["--load-start", *numbers(0.0, -stress), "--load-direction"]
        loads += numbers(-4.0 * stress, 0.0)
        lame = ["--lame", *numbers(100.0 * stress, 82.0 * stress)]
        return [*self.options, *lame, *loads, "--length", repr(length)], seeded(seed)

    def found(self, s, length):
        there = s.get("solutions_at", {}).get("solutions", [])
        names = [f["before"] + f["after"] + f["kind"] for f in s["folds"]]
        names += [t["status"] for t in there]
        values = [f["gamma"] for f in s["folds"]]
        return names, values + [t[key] / length for t in there for key in ("ut_left", "un_left")]


class FrictionParameter(Problem):
    def command(self, stress, length, seed, folder):
        load = ["--load", *numbers(-2.4 * stress, -stress), "--lame", *numbers(stress, stress)]
        return [*self.options, *load, "--length", repr(length)], seeded(seed)

    def found(self, s, length):
        runs = "".join(k for k, _ in itertools.groupby(s["statuses"]))
        return [runs, f"{len(s['folds'])} folds"], [f["gamma"] for f in s["folds"]]


class LinearTriangle(Problem):
    def command(self, stress, length, seed, folder):
        load = ["--load", *numbers(26.0 * stress, 7.5 * stress)]
        lame = ["--lame", *numbers(100.0 * stress, 82.0 * stress)]
        return [*self.options, *load, *lame, "--length", repr(length)], seeded(seed)

    def found(self, s, length):
        ends = [(k, t) for k in ("-1", "1") for t in s["solutions"][k]]
        names = [k + " " + t["status"] for k, t in ends]
        values = [t[key] / length for _, t in ends for key in ("ut_A", "un_A")]
        return names, values + s["bifurcation_gamma"]

    def what(self, s):
        left, right = (len(s["solutions"][k]) for k in ("-1", "1"))
        return f"{left} + {right} rays"


class Block(Problem):
    def command(self, stress, length, seed, folder):
        return list(self.options), ["--mm", repr(length), "--MPa", repr(stress), *seeded(seed)]

    def found(self, s, length):
        names = [f"{t['gamma']:+g} {t['status']}" for t in s["branches"]]
        keys = ("ut_left", "un_left", "ut_right", "un_right")
        values = [t[key] / length / 40.0 for t in s["branches"] for key in keys]
        return names, values + s["bifurcation_gamma"]

    def what(self, s):
        ends = [t["gamma"] for t in s["branches"]]
        return f"{ends.count(-1.0)} + {ends.count(1.0)} branches"


class Vee(Problem):
    def command(self, stress, length, seed, folder):
        lame = ["--lame", *numbers(*(v * stress for v in VEE["lame"]))]
        # A force per volume is a stress over a length.
        force = ["--body-force", *numbers(*(v * stress / length for v in VEE["force"]))]
        more = ["--solutions-at", repr(VEE["at"]), "--length", repr(length)]
        if seed is not None:
            mesh = folder / "renumbered.msh"
            run([sys.executable, __file__, "--vee", str(mesh)])
            more += ["--mesh", str(mesh)]
        return [*self.options, *lame, *force, *more], []

    def found(self, s, length):
        names = [f["kind"] + f["before"] + " " + f["after"] for f in s["folds"]]
        there = s["solutions_at"]["solutions"]
        names += [f"{s['events']} events", s["end"]["status"], *(t["status"] for t in there)]
        values = [f["gamma"] for f in s["folds"]]
        return names, values + [t[key] / length for t in there for key in ("ut_left", "un_left")]


def seeded(seed):
    return [] if seed is None else ["--seed", str(seed)]


def problems(full):
    size = ("--nx", "20", "--ny", "40") if full else ("--nx", "10", "--ny", "20")
    return {
        "single element, pivoting": SingleElement("single_element", ("--route", "pivoting")),
        "single element, steps": SingleElement("single_element", ("--route", "steps")),
        "friction parameter": FrictionParameter("friction_parameter", ()),
        "linear triangle, pivoting": LinearTriangle("linear_triangle", ("--route=pivoting",)),
        "linear triangle, steps": LinearTriangle("linear_triangle", ("--route=steps",)),
        "hyperelastic block": Block("ciarlet_geymonat", size),
        "V-shaped body, pivoting": Vee("followed_mesh", ("--route", "pivoting")),
        "V-shaped body, steps": Vee("followed_mesh", ("--route", "steps")),
    }


def run(command):
    """The end of what a program says if it fails, else nothing."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    return "" if done.returncode == 0 else (done.stdout + done.stderr)[-2000:]


def outcome(problem, case, automatic_r):
    """The summary of a demo in a case, or what went wrong."""
    given = CASES[case]
    stress = given.get("stress", 1.0)
    length = given.get("length", 1.0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options, harness = problem.command(stress, length, given.get("seed"), folder)
        if "r" in given:
            harness += ["--r", repr(given["r"] * automatic_r)]
        if "step_factor" in given:
            harness += ["--step-factor", repr(given["step_factor"])]
        ranks = str(given.get("ranks", 1))
        demo = [sys.executable, str(ROOT / "tests/support/harness.py"), problem.demo, *harness]
        options += ["--output", str(folder / "out")]
        failure = run(["mpirun", "-n", ranks, *demo, "--", *options])
        if failure:
            return {"failure": failure}
        return json.loads((folder / "out" / "summary.json").read_text())


def gammas_of(summary):
    """Gammas of all points, branch by branch; the order of branches is no matter."""
    gammas = summary["gammas"]
    branches = gammas if isinstance(gammas[0], list) else [gammas]
    return sorted(branches, key=lambda g: (len(g), g[-1]))


def compared(problem, case, summary, reference):
    """What a case has in common with the reference."""
    if "failure" in summary:
        return {"found": False, "failure": summary["failure"]}
    names, values = problem.found(summary, CASES[case].get("length", 1.0))
    names_0, values_0 = problem.found(reference, 1.0)
    record = {
        "what": problem.what(summary),
        "names": names,
        "ranks": summary["ranks"],
        "same_names": names == names_0,
        "points": summary["points"],
        "wall_seconds": summary["wall_seconds"],
    }
    if len(values) == len(values_0):
        record["largest_difference"] = float(np.abs(np.subtract(values, values_0)).max())
    close = record.get("largest_difference", np.inf) <= FOUND
    asked = summary["ranks"] == CASES[case].get("ranks", 1)
    record["found"] = bool(summary["converged"] and record["same_names"] and close and asked)
    if case in SAME_POINTS:
        a = gammas_of(summary)
        b = gammas_of(reference)
        same = [len(g) for g in a] == [len(g) for g in b]
        span = np.ptp(np.concatenate(b))
        record["same_count"] = same
        if same:
            away = [np.abs(np.subtract(g, h)).max() for g, h in zip(a, b, strict=True)]
            record["gamma_difference"] = float(max(away) / span)
        record["same_points"] = same and record["gamma_difference"] <= POINTS
    return record


def cell(record):
    """An entry of the table."""
    if not record["found"]:
        return "**failed**" if "failure" in record else "**differs**"
    if "same_points" not in record:
        points = record["points"]
        return f"yes ({sum(points) if isinstance(points, list) else points})"
    if record["same_points"]:
        return f"yes, {record['gamma_difference']:.0e}"
    if record["same_count"]:
        return f"yes, **{record['gamma_difference']:.0e}**"
    return "yes, **other points**"


def table(records):
    cases = [case for case in CASES if case != "reference"]
    lines = ["| | found | points | " + " | ".join(cases) + " |", "|---" * (len(cases) + 3) + "|"]
    for name, record in records.items():
        reference = record["reference"]
        points = reference.get("points", "**failed**")
        points = str(sum(points) if isinstance(points, list) else points)
        cells = [cell(record[case]) if case in record else "" for case in cases]
        lines.append(f"| {' | '.join([name, reference.get('what', ''), points, *cells])} |")
    return "\n".join(lines)


def write_vee(path):
    """The default body of cases.followed_mesh with its nodes and cells in another order."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import gmsh
    from cases.followed_mesh import SIDES, VEE, arguments

    from dolfinx_contact.meshing import draw_polygon

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("drawn")
    draw_polygon(VEE, arguments([]).size, SIDES)
    mesh = gmsh.model.mesh
    random = np.random.default_rng(1)
    tags, points, _ = mesh.getNodes()
    groups = []
    for dim, group in gmsh.model.getPhysicalGroups():
        entities = gmsh.model.getEntitiesForPhysicalGroup(dim, group)
        cells = [mesh.getElements(dim, e)[2][0].reshape(-1, dim + 1) for e in entities]
        groups.append((dim, gmsh.model.getPhysicalName(dim, group), np.concatenate(cells)))
    gmsh.model.add("renumbered")
    order = random.permutation(len(tags))
    new = dict(zip(tags[order].tolist(), range(1, len(tags) + 1), strict=True))
    body = gmsh.model.addDiscreteEntity(2)
    points = points.reshape(-1, 3)[order].reshape(-1)
    mesh.addNodes(2, body, list(range(1, len(tags) + 1)), points)
    for dim, name, cells in groups:
        entity = body if dim == 2 else gmsh.model.addDiscreteEntity(1)
        cells = cells[random.permutation(len(cells))].reshape(-1)
        mesh.addElementsByType(entity, 2 if dim == 2 else 1, [], [new[int(k)] for k in cells])
        gmsh.model.addPhysicalGroup(dim, [entity], name=name)
    gmsh.write(path)
    gmsh.finalize()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", default="invariance.json")
    parser.add_argument("--full", action="store_true", help="the block with 20 x 40 cells")
    parser.add_argument("--only", help="problems whose name contains this")
    parser.add_argument("--vee", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.vee:
        write_vee(args.vee)
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    records = {}
    output = Path(args.output)
    output.parent.mkdir(parents=True, exist_ok=True)
    for name, problem in problems(args.full).items():
        if args.only and args.only not in name:
            continue
        record = records[name] = {}
        for case in CASES:
            summary = outcome(problem, case, record.get("augmentation"))
            if case == "reference":
                reference = summary
                record["augmentation"] = summary.get("augmentation")
            record[case] = compared(problem, case, summary, reference)
            print(f"{name}: {case}: {cell(record[case])}", flush=True)
            if "failure" in record[case]:
                print(record[case]["failure"], flush=True)
            if "failure" in reference:
                break
        output.write_text(json.dumps(records, indent=1) + "\n")
        output.with_suffix(".md").write_text(table(records) + "\n")
    shown = table(records)
    print(shown)
    if "**" in shown:
        sys.exit("not all is invariant: see what is bold in the table")


if __name__ == "__main__":
    main()
