# SPDX-License-Identifier: LGPL-3.0-or-later
"""Speed over commits: a few ratios and counts, written to a file that grows.

Runs small cases of the other benchmarks, each in a process of its own, and appends what they found
to `kept.csv`: commit, case, name, value, and the noise, which is how far the timed runs were apart
over their median (0 of counts). Then each value is compared with the median of the last five rows
of its name: a count that has grown at all, or a ratio that has grown by more than a tenth and by
more than twice the noise, is named, and the exit status is 1.

Ratios are of processor time, which other work on the machine changes less than wall time.

    docker/run python3 benchmarks/kept.py             # some minutes
    docker/run python3 benchmarks/kept.py --only newton --dry
"""

from __future__ import annotations

import argparse
import csv
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
FILE = HERE / "kept.csv"
HEAD = ["commit", "case", "name", "kind", "value", "noise"]
LAST = 5  # rows of a name that a value is compared with
MORE = 0.1  # by which a ratio may have grown


@dataclass(frozen=True)
class Case:
    """A run of a benchmark.

    Attributes:
        command: script and arguments.
        values: places of values in its record, by name: ``ratio ...`` or ``count ...``.
        runs: place of the seconds of the timed runs, or None.
        ranks: number of processes.
        noise: of ratios where there are no such runs.
    """

    command: tuple[str, ...]
    values: dict[str, str]
    runs: str | None = None
    ranks: int = 1
    noise: float = 0.15


SOLVE = {
    "ratio": "processor_ratio",
    "count newton": "contact/newton_iterations",
    "count krylov": "contact/krylov_iterations",
}
CASES = {
    "solve": Case(("elasticity_ratio.py", "--n", "20", "--settings", "few"), SOLVE, "contact/runs"),
    "solve on two ranks": Case(
        ("elasticity_ratio.py", "--n", "20", "--settings", "few"), SOLVE, "contact/runs", 2
    ),
    "sphere": Case(
        ("elasticity_ratio.py", "--n", "20", "--settings", "few", "--obstacle", "sphere"),
        SOLVE,
        "contact/runs",
    ),
    "pair": Case(("pair_ratio.py", "--n", "12", "--settings", "few"), SOLVE, "contact/runs"),
    "pair in large sliding": Case(
        ("pair_ratio.py", "--n", "8", "--settings", "few", "--sliding", "large"),
        SOLVE,
        "contact/runs",
    ),
    "branch": Case(
        ("continuation_step.py", "--dim", "2", "--n", "24", "--steps", "10"),
        {
            "ratio": "batched/ratio",
            "count corrections": "batched/corrections",
            "count factorisations": "batched/factorisations",
            "count factorisations of an event": "located/factorisations",
        },
    ),
    "history": Case(
        ("history_step.py", "--dim", "2", "--n", "24"),
        {"ratio": "processor_ratio", "count newton": "step_newton_iterations"},
    ),
    "motion": Case(
        ("motion_step.py", "--n", "10", "--cases", "thrown"),
        {
            "ratio": "thrown/contact_over_amg_processor_ratio",
            "count newton": "thrown/contact_newton",
            "count krylov": "thrown/contact_krylov",
        },
    ),
}


def at(record: dict, place: str):
    """What a record has at a place."""
    for key in place.split("/"):
        record = record[key]
    return record


def rows_of(name: str, case: Case, commit: str) -> list[dict]:
    """What a case finds. Raises ``CalledProcessError`` where it fails."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "found.json"
        script, *given = case.command
        launch = ["mpirun", "-n", str(case.ranks)] if case.ranks > 1 else []
        command = [*launch, sys.executable, str(HERE / script), *given, "--output", str(output)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        record = json.loads(output.read_text())
    noise = case.noise
    if case.runs is not None:
        seconds = at(record, case.runs)
        noise = (max(seconds) - min(seconds)) / statistics.median(seconds)
    found = []
    for words, place in case.values.items():
        kind = words.partition(" ")[0]
        found.append(
            {
                "commit": commit,
                "case": name,
                "name": words,
                "kind": kind,
                "value": f"{float(at(record, place)):.4g}",
                "noise": f"{noise if kind == 'ratio' else 0.0:.2f}",
            }
        )
    return found


def grown(before: list[dict], row: dict) -> str:
    """In words, what has grown against the rows before; "" if nothing has."""
    same = [r for r in before if (r["case"], r["name"]) == (row["case"], row["name"])][-LAST:]
    if not same:
        return ""
    usual = statistics.median(float(r["value"]) for r in same)
    value = float(row["value"])
    allowed = 1e-9
    if row["kind"] == "ratio":
        allowed = max(MORE, 2 * max(float(r["noise"]) for r in [*same, row]))
    if value <= usual * (1 + allowed):
        return ""
    return f"{row['case']}, {row['name']}: {value:g}, {usual:g} before"


def read(path: Path) -> list[dict]:
    """Rows that are there."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def append(path: Path, rows: list[dict]) -> None:
    """Write rows at the end of the file."""
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, HEAD, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerows(rows)


def commit_here() -> str:
    """The commit of the tree, with + where files differ from it."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=HERE, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no")
    return git("rev-parse", "--short", "HEAD") + ("+" if changed else "")


def main(argv: list[str] | None = None, measure: Callable = rows_of) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", help="cases whose name contains this")
    parser.add_argument("--file", type=Path, default=FILE)
    parser.add_argument("--dry", action="store_true", help="write nothing")
    args = parser.parse_args(argv)
    before = read(args.file)
    commit = commit_here()
    worse = []
    for name, case in CASES.items():
        if args.only and args.only not in name:
            continue
        rows = measure(name, case, commit)
        for row in rows:
            print(f"{row['case']:24} {row['name']:36} {row['value']:>9}  noise {row['noise']}")
            worse.append(grown(before, row))
        if not args.dry:
            append(args.file, rows)
    worse = [words for words in worse if words]
    print(*(f"grown: {words}" for words in worse), sep="\n")
    return int(bool(worse))


if __name__ == "__main__":
    sys.exit(main())
