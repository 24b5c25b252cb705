# SPDX-License-Identifier: LGPL-3.0-or-later
"""One problem, several codes, one judge: runs them and writes a table.

Every code is run in its own environment (`environments`) by its driver, once with settings that its
manual, its defaults or its examples give and once tuned; its answer is judged in the environment of
this package. This program needs only Python. Times are those of a processor, of one run each, on
one thread, and so are their limits.

    python3 benchmarks/codes/run.py --output output/codes
    python3 benchmarks/codes/run.py --output output/codes --codes ours kratos --problems greco
    python3 benchmarks/codes/run.py --output output/codes --judge
    python3 benchmarks/codes/run.py --table benchmarks/codes/results.json
"""

from __future__ import annotations

import argparse
import json
import resource
import signal
import subprocess
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
PROBLEMS = (
    "greco", "dragged16", "dragged64", "dragged256", "three", "cyclic", "wedge", "pair", "roller",
    "bar", "ironing",
)  # fmt: skip
STEPS = 84  # of the ironing
MOTION = ("held", "penetration", "path", "rest")
FIGURES = ("held", "equilibrium", "penetration", "cone", "complementarity", "slip")
#: Of a processor at most, of a run, but of the larger problems; by a clock three times that.
SECONDS = 300
LONGER = {"dragged64": 900, "dragged256": 900, "ironing": 900}
#: GiB of addresses at most.
MEMORY = 12


@dataclass(frozen=True)
class Code:
    """How a code is run.

    Attributes:
        title: of the code.
        driver: the program that runs it.
        environment: in which.
        licence: of the code.
        settings: by way: recommended, tuned, and those of `ONLY`.
        source: what recommends.
        more: settings of some problems, by (problem, way), that these need besides or instead.
    """

    title: str
    driver: str
    environment: str
    licence: str
    settings: dict[str, dict]
    source: str
    more: dict[tuple[str, str], dict] = field(default_factory=dict)

    def ways(self, problem):
        """Names of the settings that a problem is run with."""
        return [way for way in self.settings if problem in ONLY.get(way, PROBLEMS)]

    def given(self, problem, way):
        """The settings of a run."""
        return self.settings[way] | self.more.get((problem, way), {})


#: Ways of some problems alone.
ONLY = {"two ranks": ("dragged64", "dragged256"), "law iso1": ("ironing",)}
_MUMPS = ["max_iter", 100, "lsolver", "mumps"]
_SEARCH = [
    "lsolver", "mumps", "lsearch", "simplest", "alpha max ratio", 1.5, "alpha min", 0.2,
    "alpha mult", 0.6,
]  # fmt: skip
_RING = {"residual": 1e-8, "relative": False, "release": 0.5, "solve": ["max_iter", 40, *_SEARCH]}
_EXAMPLE = {"tangent_factor": 0.025, "advance_ALM_parameters": {"stiffness_factor": 0.1}}
_STIFFER = {"tangent_factor": 1.0, "advance_ALM_parameters": {"stiffness_factor": 1.0}}
_BY_RADIUS = {"type_search": "in_radius", "search_factor": 30.0}
_TIGHTER = {
    "tolerance": 1e-9,
    "absolute": 1e-14,
    "solver": {
        f"{name}_relative_tolerance": 1e-9
        for name in (
            "contact_displacement", "contact_residual", "frictional_stick_contact_displacement",
            "frictional_stick_contact_residual", "frictional_slip_contact_displacement",
            "frictional_slip_contact_residual",
        )
    },
}  # fmt: skip
_IPC = {"stiffness": 0.0, "project": "NONE", "increments": 5}
_KRATOS = {
    "criterion": "contact_residual_criterion",
    "tolerance": 1e-4,
    "absolute": 1e-9,
    "iterations": 20,
    "type": "ALMContactFrictional",
    "solver": {},
}
CODES = {
    "ours": Code(
        "dolfinx_contact",
        "with_ours.py",
        "project",
        "LGPL-3.0-or-later",
        {
            "recommended": {},
            "tuned": {"petsc_options": {"linear_solver": "direct", "snes_rtol": 1e-10}},
            "two ranks": {"ranks": 2},
            "law iso1": {"law": "iso1"},
        },
        "its defaults",
        {(f"dragged{n}", "tuned"): {"petsc_options": {"snes_rtol": 1e-10}} for n in (64, 256)},
    ),
    "getfem": Code(
        "GetFEM",
        "with_getfem.py",
        "project",
        "LGPL-3.0-or-later",
        {
            "recommended": {
                "r": 1.0, "version": 1, "residual": 1e-9, "relative": False, "solve": _MUMPS,
                "newmark": [0.25, 0.5],
            },
            "tuned": {
                "r": 1.0, "version": 1, "residual": 1e-10, "relative": True, "solve": _MUMPS,
                "newmark": [0.3025, 0.6],
            },
        },
        "demo_static_contact.py; r of the order of Young's modulus, as its manual says; "
        "demo_elastic_ring_contact.py of bodies that slide far",
        {
            ("three", "tuned"): {"r": 100.0, "solve": ["max_iter", 100, *_SEARCH]},
            ("ironing", "recommended"): _RING,
            ("ironing", "tuned"): _RING | {"r": 10.0, "solve": ["max_iter", 100, *_SEARCH]},
        },
    ),
    "calculix": Code(
        "CalculiX",
        "with_calculix.py",
        "debian",
        "GPL-2.0-or-later",
        {
            "recommended": {
                "type": "SURFACE TO SURFACE", "stiffness": 50.0, "stick": 0.01, "increment": 0.25,
                "controls": [],
            },
            "tuned": {
                "type": "MORTAR", "stiffness": None, "stick": 1e4, "increment": 0.1, "controls": [],
            },
        },
        "its manual: face-to-face penalty, 50 times Young's modulus, a stick slope of a hundredth",
        {
            ("ironing", "tuned"): {
                "type": "SURFACE TO SURFACE", "stiffness": 1000.0, "stick": 0.1, "increment": 0.25,
            },
        },
    ),
    "siconos": Code(
        "Siconos (condensed by scipy)",
        "with_siconos.py",
        "debian",
        "Apache-2.0",
        {
            "recommended": {"solver": "NSGS", "tolerance": None, "iterations": None},
            "tuned": {"solver": "NSGS", "tolerance": 1e-12, "iterations": 100000},
        },
        "its defaults of nonsmooth Gauss-Seidel",
    ),
    "kratos": Code(
        "Kratos",
        "with_kratos.py",
        "kratos",
        "BSD-4-Clause",
        {
            "recommended": _KRATOS | {"contact": _EXAMPLE},
            "tuned": _KRATOS
            | {"iterations": 50, "contact": _STIFFER},
        },
        "shallow_ironing_3D of its examples",
        {
            ("ironing", "tuned"): {"increments": 4, "contact": _EXAMPLE},
            ("wedge", "tuned"): _TIGHTER | {"increments": 10},
            ("roller", "tuned"): _TIGHTER
            | {"contact": _STIFFER | {"search_parameters": _BY_RADIUS}},
        },
    ),
    "akantu": Code(
        "Akantu",
        "with_akantu.py",
        "akantu",
        "LGPL-3.0-or-later",
        {
            "recommended": {
                "normal": 100.0, "tangential": 1.0, "tolerance": 1e-8, "iterations": 100,
                "increments": 1,
            },
            "tuned": {
                "normal": 100.0, "tangential": 0.1, "tolerance": 1e-8, "iterations": 100,
                "increments": 20,
            },
        },
        "nothing: no manual came with the wheel; the ratios of CalculiX' manual",
    ),
    "sfepy": Code(
        "sfepy with ipctk",
        "with_sfepy.py",
        "sfepy",
        "BSD-3-Clause; MIT",
        {
            "recommended": _IPC
            | {
                "barrier": 1e-2, "start": 1e-4, "tolerance": 1e-8, "iterations": 30,
                "newmark": [0.25, 0.5],
            },
            "tuned": _IPC
            | {
                "barrier": 1e-5, "start": 1e-7, "tolerance": 1e-10, "iterations": 100,
                "newmark": [0.3025, 0.6],
            },
        },
        "two_bodies_contact.py of sfepy's examples, with contact='ipc'",
    ),
}  # fmt: skip


def limited(seconds):
    """Limit memory and processor time of what is run."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY * 2**30, MEMORY * 2**30))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 10))


def within(environment, problem, *command):
    """Run a command for a problem; its error is a line of text, or None, and its output."""
    limit = LONGER.get(problem, SECONDS)
    words = [str(HERE / "environments"), environment, "timeout", str(3 * limit)]
    ended = subprocess.run(
        words + [str(c) for c in command], capture_output=True, text=True, check=False,
        preexec_fn=partial(limited, limit),
    )  # fmt: skip
    if ended.returncode == 124:
        return f"ended after {3 * limit} s by the clock", ended.stdout
    number = ended.returncode - 128 if ended.returncode > 128 else -ended.returncode
    if number == signal.SIGXCPU:
        return f"ended after {limit} s of a processor", ended.stdout
    if number in set(signal.Signals):
        return f"ended by {signal.Signals(number).name}", ended.stdout
    if ended.returncode:
        lines = [line.strip() for line in ended.stderr.splitlines() if line.strip()]
        errors = [line for line in lines if "Error" in line and not line.startswith("File")]
        return (errors or lines or ["no answer"])[-1][:200], ended.stdout
    return None, ended.stdout


def measured(folder, problem, code, way):
    """A record of one run."""
    record = {"problem": problem, "code": code, "way": way, "begun": time.strftime("%F %T")}
    record["clock"] = "processor"
    name = f"{problem}-{code}-{way}"
    settings, answer = folder / f"{name}.json", folder / f"{name}.npz"
    words = CODES[code].given(problem, way)
    settings.write_text(json.dumps(words))
    command = ["mpirun", "-n", words["ranks"]] if "ranks" in words else []
    command += ["python3", HERE / CODES[code].driver]
    given = folder / f"{problem}.npz"
    answer.unlink(missing_ok=True)
    begun = time.perf_counter()
    error, _ = within(CODES[code].environment, problem, *command, given, settings, answer)
    record["process_seconds"] = time.perf_counter() - begun
    if error:
        return record | {"error": error}
    return judged(folder, record)


def is_there(folder, record):
    """Whether there is an answer of a run."""
    name = f"{record['problem']}-{record['code']}-{record['way']}"
    return "record" in record and (folder / f"{name}.npz").exists()


def judged(folder, record):
    """The record of a run with what the judge says of its answer."""
    name = f"{record['problem']}-{record['code']}-{record['way']}"
    given, answer = folder / f"{record['problem']}.npz", folder / f"{name}.npz"
    problem = record["problem"]
    record = {k: v for k, v in record.items() if k not in ("error", "figures")}
    error, text = within("project", problem, "python3", HERE / "judge.py", given, answer)
    if error:
        return record | {"error": f"the judge: {error}"}
    return record | json.loads(text)


def run(folder, problems, codes, ways):
    """All records, of which the program tells as they come."""
    folder.mkdir(parents=True, exist_ok=True)
    error, text = within("project", None, "python3", HERE / "problems.py", folder)
    if error:
        raise RuntimeError(error)
    print(text, end="")
    records = []
    for problem in problems:
        for code in codes:
            for way in (w for w in CODES[code].ways(problem) if w in ways):
                record = measured(folder, problem, code, way)
                records.append(record)
                print(row(record), flush=True)
    return records


def merged(before, records):
    """Records of runs, those anew in place of older ones, in the order of the table."""
    runs = {(r["problem"], r["code"], r["way"]): r for r in [*before, *records]}
    order = [(p, c, w) for p in PROBLEMS for c in CODES for w in CODES[c].ways(p)]
    return [runs[key] for key in order if key in runs]


def row(record):
    """A line of the table."""
    name = f"| {CODES[record['code']].title} | {record['way']} "
    if "figures" not in record:
        reason = record.get("error")
        said = record.get("record", {"converged": True})
        words = f"no answer: {reason if said['converged'] else said['says']}".replace("|", "/")
        empty = len(figures_of(record["problem"])) + (2 if record["problem"] == "bar" else 3)
        return name + f"| {words} |" + " |" * empty
    said, figures = record["record"], record["figures"]
    numbers = [f"{figures[f]:.0e}" for f in figures_of(record["problem"])]
    counts = figures.get("statuses")
    places = [f"{counts['open']}/{counts['stick']}/{counts['slip']}"] if counts else []
    says = said["says"] + (", without friction" if said.get("mu") == 0 else "")
    if "steps" in figures:
        says += f", {min(said['steps'], figures['steps'])} of {STEPS} steps"
    seconds = f"{said['seconds']:.2f}" + ("" if record.get("clock") == "processor" else " wall")
    words = [says, str(said["iterations"]), seconds, *numbers, *places]
    return f"{name}| {' | '.join(words)} |"


def figures_of(problem):
    """Names of the figures of a problem."""
    return MOTION if problem == "bar" else FIGURES


def beside(records, title, names, form):
    """A line of figures that only some problems have."""
    values = [
        f"{CODES[r['code']].title} ({r['way']}) "
        + ", ".join(format(r["figures"][name], form) for name in names)
        for r in records
        if names[0] in r.get("figures", {})
    ]
    return ["", f"{title}: {'; '.join(values)}."] if values else []


def forces(records):
    """A table of the forces on a die, and their excess over this package's of the same law."""
    there = [r for r in records if "pressed" in r.get("figures", {})]
    if not there:
        return []
    ours = {r["record"]["law"]: r["figures"] for r in reversed(there) if r["code"] == "ours"}
    titles = ["code", "settings", "law", "V, H pressed", "V, H slid", "pressed", "slid"]
    lines = ["", "| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    for record in there:
        figures, law = record["figures"], record["record"]["law"]
        absolute, excess = [], []
        for name in ("pressed", "slid"):
            values = figures.get(name)
            absolute.append(", ".join(f"{v:.1f}" for v in values) if values else "")
            reference = ours.get(law, {}).get(name)
            known = values and reference
            excess.append(
                ", ".join(f"{a / b - 1:+.1%}" for a, b in zip(values, reference, strict=True))
                if known
                else ""
            )
        words = [CODES[record["code"]].title, record["way"], law, *absolute, *excess]
        lines.append("| " + " | ".join(words) + " |")
    return lines


#: What cannot be run; docs/codes.md has the reasons.
NOT_POSSIBLE = {("dragged256", "siconos"), ("ironing", "siconos"), ("ironing", "sfepy")}


def outcome(record):
    """What came of a run, in a word."""
    if record is None:
        return "not run"
    if "figures" not in record:
        return "no answer"
    complete = record["figures"].get("steps", STEPS) == STEPS
    return "yes" if record["record"]["converged"] and complete else "no"


def overview(records):
    """Which code was run on which problem, and whether it says that it succeeded."""
    runs = {(r["problem"], r["code"], r["way"]): r for r in records}
    titles = ["problem", *(code.title.split(" (")[0] for code in CODES.values())]
    lines = ["| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    for problem in PROBLEMS:
        cells = [problem]
        for code in CODES:
            if (problem, code) in NOT_POSSIBLE:
                cells.append("not possible")
                continue
            both = [outcome(runs.get((problem, code, way))) for way in ("recommended", "tuned")]
            cells.append(both[0] if both[0] == both[1] else ", ".join(both))
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def table(records):
    """Markdown of all problems."""
    lines = [
        "### Which were run",
        "",
        "Whether a code says that it succeeded, recommended and tuned, or once if both are alike.",
        "",
        *overview(records),
        "",
    ]
    for problem in dict.fromkeys(r["problem"] for r in records):
        titles = ["code", "settings", "says", "iterations", "seconds", *figures_of(problem)]
        titles += ["open/stick/slip"] if problem != "bar" else []
        lines += [
            f"### {problem}",
            "",
            "| " + " | ".join(titles) + " |",
            "|---" * len(titles) + "|",
        ]
        lines += [row(r) for r in records if r["problem"] == problem]
        of_it = [r for r in records if r["problem"] == problem]
        lines += beside(of_it, "F/G over its closed form, less 1", ["closed"], ".0e")
        lines += beside(
            of_it, "Half width and peak over Hertz', less 1", ["half_width", "peak"], ".1%"
        )
        lines += forces(of_it)
        lines.append("")
    lines += [
        "### Versions, licences, settings",
        "",
        "| code | version | licence | recommended by |",
    ]
    lines.append("|---|---|---|---|")
    for name, code in CODES.items():
        versions = {r["record"]["version"] for r in records if r["code"] == name and "record" in r}
        if versions:
            version = ", ".join(sorted(versions))
            lines.append(f"| {code.title} | {version} | {code.licence} | {code.source} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--output", type=Path, default=Path("output/codes"))
    parser.add_argument("--problems", nargs="*", choices=PROBLEMS, default=PROBLEMS)
    parser.add_argument("--codes", nargs="*", choices=list(CODES), default=list(CODES))
    ways = ("recommended", "tuned", *ONLY)
    parser.add_argument("--ways", nargs="*", choices=ways, default=ways)
    parser.add_argument("--table", type=Path, help="results that are there, of which to make one")
    parser.add_argument("--judge", action="store_true", help="judge answers that are there again")
    args = parser.parse_args()
    if args.table:
        results = args.table
    else:
        results = args.output / "results.json"
        before = json.loads(results.read_text())["runs"] if results.exists() else []
        if args.judge:
            records = [judged(args.output, r) if is_there(args.output, r) else r for r in before]
        else:
            records = merged(before, run(args.output, args.problems, args.codes, args.ways))
        settings = {
            name: code.settings | {" ".join(k): v for k, v in code.more.items()}
            for name, code in CODES.items()
        }
        text = json.dumps({"settings": settings, "runs": records}, indent=1)
        results.write_text(text + "\n")
    records = json.loads(results.read_text())["runs"]
    results.with_suffix(".md").write_text(table(records))


if __name__ == "__main__":
    main()
