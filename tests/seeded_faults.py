"""Do properties see a fault? Each is put into a copy of the package, and drawn for.

    docker/run python3 tests/seeded_faults.py

prints, fault by fault, the property that fails first, and how many examples all of them took until
then. They take turns, one example each.
"""

import argparse
import itertools
import logging
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Examples that all properties together may take.
MOST = 200


@dataclass(frozen=True)
class Fault:
    """A text in a file of the package and its faulty replacement."""

    file: str
    text: str
    instead: str


#: Signs, weights, and arrays that stay as they were.
FAULTS = {
    "sign of the shear of slips to the left": Fault(
        "laws/friction.py", "MINUS: StatusPiece(c * a.t,", "MINUS: StatusPiece(-c * a.t,"
    ),
    "sign of the normal of a level set": Fault(
        "obstacles.py", "phi / steepness, -slope / steepness", "phi / steepness, slope / steepness"
    ),
    "sign of the energy of friction": Fault(
        "results/result.py",
        'energies["friction"] = float(-sum(',
        'energies["friction"] = float(sum(',
    ),
    "weight of the loads of a step": Fault(
        "evolution/energy.py",
        "outer = np.dot(before.outer + after.outer, du) / 2",
        "outer = np.dot(after.outer, du)",
    ),
    "weight of a contact point": Fault(
        "points/evaluators.py", "self._integrals()[:, 0].copy()", "1.01 * self._integrals()[:, 0]"
    ),
    "stale load": Fault(
        "body/bulk.py",
        "self._f = None",
        "pass",
    ),
    "stale stiffness": Fault(
        "body/bulk.py",
        "self.stiffness_mark += any_rank(self.comm, self._checksums[1] != of_stiffness)",
        "pass",
    ),
}


def with_fault(fault, folder):
    """A copy of the package in a folder, with a fault."""
    package = Path(folder) / "dolfinx_contact"
    shutil.copytree(ROOT / "dolfinx_contact", package)
    file = package / fault.file
    text = file.read_text()
    assert text.count(fault.text) == 1, f"{fault.file} has {fault.text!r} not once"
    file.write_text(text.replace(fault.text, fault.instead))


def seen(name):
    """Return the output of `--draw` for a package with a fault: property and number of examples."""
    with tempfile.TemporaryDirectory() as folder:
        with_fault(FAULTS[name], folder)
        path = os.pathsep.join([folder, str(ROOT / "tests")])
        run = subprocess.run(
            [sys.executable, __file__, "--draw"],
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
    assert run.returncode == 0, run.stderr
    return run.stdout.split("\n")[-2]


class Kept:
    """Function storing its arguments in a list."""

    __name__ = "stays_under_places"

    def __init__(self, found):
        self._found = found

    def __call__(self, *data):
        self._found.append(data)


def draw():
    """Draw for every property in turn until one fails."""
    from support import properties

    rounds = MOST // len(properties.PROPERTIES)
    drawn = {}
    for check, (strategy, _) in properties.PROPERTIES.items():
        drawn[check] = []
        properties.holds(Kept(drawn[check]), strategy(False), examples=rounds)
    turns = itertools.chain(*itertools.zip_longest(*([(c, d) for d in drawn[c]] for c in drawn)))
    for number, (check, data) in enumerate(filter(None, turns), 1):
        try:
            check(*data)
        except Exception as error:
            print(f"{check.__name__} fails with example {number}: {type(error).__name__}")
            return
    print(f"no property fails in {number} examples")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draw", action="store_true", help="of the package as it is, for itself")
    parser.add_argument("names", nargs="*", default=list(FAULTS), help="of faults")
    options = parser.parse_args()
    if options.draw:
        logging.disable(logging.CRITICAL)
        draw()
        return
    for name in options.names:
        print(f"{name}: {seen(name)}", flush=True)


if __name__ == "__main__":
    main()
