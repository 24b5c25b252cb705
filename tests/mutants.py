"""Mutants of the core: a token is changed, and the tests of its room have to see it.

For every room (`ROOMS`) Cosmic Ray lists the mutants of its modules in a session; each is tried on
a copy of the tree by the tests of that room. It takes hours: a session continues where it was left,
and `--sample` takes so many of each room, the same ones every time. Beside the sessions are
`ROOM.txt`, with the score and what has survived as differences. `make mutants` runs all of it.

    docker/run python3 tests/mutants.py --output output/mutants --sample 40 laws
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

TREE = Path(__file__).resolve().parents[1]
COSMIC_RAY = "cosmic-ray==8.7.0"
SEED = 20
SLOWER = 8  # times the tests of the tree as it is, after which a mutant has hung
#: Modules and tests of the rooms.
ROOMS = {
    "laws": (
        ["laws/coulomb.py", "laws/friction.py", "laws/status.py", "laws/compiled.py"],
        ["test_coulomb.py", "test_law.py", "test_status.py", "test_table_of_laws.py"],
    ),
    "points": (
        ["points/operators.py", "points/kinematics.py", "points/memory.py", "points/arcs.py"],
        ["test_surface.py", "test_kinematics.py", "test_curved_friction.py"],
    ),
    "equations": (
        ["equations/contact.py", "equations/jacobian.py", "equations/constraints.py"],
        ["test_blocks.py", "test_kinematics.py", "test_pair.py", "test_rigid_body.py"],
    ),
    "reduced": (
        ["reduced/reduction.py", "reduced/gathered.py", "reduced/held_body.py"],
        ["test_point_problem.py", "test_lemke.py", "test_algorithms.py"],
    ),
    "checker": (["analysis/check_proof.py"], ["test_check_proof.py", "test_certificates.py"]),
    "pivoting": (
        ["continuation/pivoting.py", "continuation/rays.py", "continuation/affine.py"],
        ["test_affine.py", "test_rays.py", "test_linear_triangle.py"],
    ),
    "evolution": (
        ["evolution/energy.py", "evolution/accepted.py", "evolution/motion_energy.py"],
        ["test_evolution.py", "test_slip_memory.py", "test_motion.py"],
    ),
}
CONFIGURATION = """
[cosmic-ray]
module-path = {modules}
timeout = {timeout:.0f}
excluded-modules = []
test-command = "{command}"

[cosmic-ray.distributor]
name = "local"
"""
#: Run by the interpreter that has Cosmic Ray.
SKIP_OTHERS = """
import random, sys
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import WorkResult, WorkerOutcome
path, number = sys.argv[1], int(sys.argv[2])
with use_db(path, WorkDB.Mode.open) as db:
    def place(item):
        one = item.mutations[0]
        return str(one.module_path), one.start_pos, one.operator_name, one.occurrence
    items = sorted(db.work_items, key=place)
    kept = set(random.Random({seed}).sample(range(len(items)), min(number, len(items))))
    done = {{job for job, _ in db.results}}
    for i, item in enumerate(items):
        if i not in kept and item.job_id not in done:
            db.set_result(item.job_id, WorkResult(worker_outcome=WorkerOutcome.SKIPPED))
"""
REPORT = """
import sys
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome
tried, survived, left = 0, [], 0
with use_db(sys.argv[1], WorkDB.Mode.open) as db:
    results = dict(db.results)
    for item in db.work_items:
        found = results.get(item.job_id)
        if found is None:
            left += 1
        elif found.worker_outcome != WorkerOutcome.SKIPPED:
            tried += 1
            if found.test_outcome == TestOutcome.SURVIVED:
                survived.append(found.diff)
print(f"{tried - len(survived)} of {tried} mutants were seen, {left} not yet tried")
for diff in survived:
    print()
    print(diff)
"""


def interpreter(folder):
    """A Python with Cosmic Ray, beside what the environment has. Made once."""
    python = folder / "venv" / "bin" / "python3"
    if not python.exists():
        made = ["-m", "venv", "--without-pip", "--system-site-packages"]
        subprocess.run([sys.executable, *made, str(folder / "venv")], check=True)
        pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
        subprocess.run([*pip, COSMIC_RAY], check=True)
    return python


def copy_of_tree(folder):
    """A copy of what git knows, in which files are changed."""
    known = subprocess.run(["git", "ls-files", "-z"], cwd=TREE, capture_output=True, check=True)
    for name in filter(None, known.stdout.decode().split("\0")):
        to = folder / name
        to.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(TREE / name, to, follow_symlinks=False)


def environment(tree):
    """Of tests in a tree: its package, and no compiled files, which two mutants could share."""
    env = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    return env | {"OMP_NUM_THREADS": "1"}


def hunt(room, folder, sample, python):
    """Try the mutants of a room; the report."""
    modules, tests = ROOMS[room]
    tests = [f"tests/{t}" for t in tests if (TREE / "tests" / t).exists()]
    here = folder / room
    tree = here / "tree"
    session = here / "session.sqlite"
    run = [str(python), "-m", "cosmic_ray.cli"]
    command = [str(python), "-m", "pytest", "-x", "-q", *tests]
    if not session.exists():
        shutil.rmtree(here, ignore_errors=True)
        copy_of_tree(tree)
        start = time.monotonic()
        subprocess.run(command, cwd=tree, env=environment(tree), check=True)
        seconds = time.monotonic() - start
        paths = [f"dolfinx_contact/{m}" for m in modules]
        configuration = CONFIGURATION.format(
            modules=paths, timeout=SLOWER * seconds + 30, command=" ".join(command)
        )
        (here / "config.toml").write_text(configuration.replace("'", '"'))
        subprocess.run([*run, "init", "../config.toml", str(session)], cwd=tree, check=True)
        if sample:
            code = SKIP_OTHERS.format(seed=SEED)
            subprocess.run([str(python), "-c", code, str(session), str(sample)], check=True)
    subprocess.run(
        [*run, "exec", "../config.toml", str(session)],
        cwd=tree,
        env=environment(tree),
        check=True,
    )
    done = subprocess.run(
        [str(python), "-c", REPORT, str(session)], capture_output=True, text=True, check=True
    )
    (folder / f"{room}.txt").write_text(done.stdout)
    return done.stdout.splitlines()[0]


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=", ".join(ROOMS))
    parser.add_argument("--output", type=Path, default=Path("output/mutants"))
    parser.add_argument("--sample", type=int, help="mutants of each room; all by default")
    args = parser.parse_args(argv)
    unknown = set(args.rooms) - set(ROOMS)
    if unknown:
        parser.error(f"no room {', '.join(sorted(unknown))}: there are {', '.join(ROOMS)}")
    folder = args.output.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    python = interpreter(folder)
    for room in args.rooms or ROOMS:
        print(f"{room}: {hunt(room, folder, args.sample, python)}", flush=True)


if __name__ == "__main__":
    main()
