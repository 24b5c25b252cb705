"""Mutants of the core: a token is changed, and the tests of its room have to see it.

For every room (`ROOMS`) Cosmic Ray lists the mutants of its modules in a session, those by
`OPERATORS`. Each is tried by the tests of that room, those that see most first, in a fork of one
process that has imported all but the package: a mutant that is seen at once costs half a second.
Tests and cases that `make test` leaves out are asked where no other sees a mutant. A
session continues where it was left, and `--sample` takes so many of each room, the same ones every
time. Beside the sessions are `ROOM.txt`, with the score and what has survived as differences.
`make mutants` runs all of it; `tests/mutants.md` has what was found.

    docker/run python3 tests/mutants.py --output output/mutants --sample 40 laws
"""

import argparse
import ast
import bisect
import difflib
import importlib.abc
import importlib.util
import inspect
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

TREE = Path(__file__).resolve().parents[1]
COSMIC_RAY = "cosmic-ray==8.7.0"
SEED = 20
SECONDS = 120  # of processor time, after which a mutant has hung
SECONDS_ALONE = 30  # the same where no more is asked than a module alone
SECONDS_LONG = 900  # of tests that take long, which are asked last
#: Modules and tests of the rooms, in the order in which they are asked.
ROOMS = {
    "laws": (
        ["laws/coulomb.py", "laws/friction.py", "laws/status.py"],
        ["test_coulomb.py", "test_law.py", "test_status.py", "test_table_of_laws.py"],
    ),
    "compiler": (["laws/compiled.py"], ["test_compiled_law.py", "test_law.py"]),
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
    "checker": (
        ["analysis/check_proof.py"],
        [
            *("test_recorded_proofs.py", "test_check_proof.py"),
            *("test_certificates.py", "test_proofs_in_space.py"),
        ],
    ),
    "pivoting": (
        ["continuation/pivoting.py", "continuation/rays.py", "continuation/affine.py"],
        ["test_affine.py", "test_rays.py", "test_linear_triangle.py"],
    ),
    "evolution": (
        ["evolution/energy.py", "evolution/accepted.py", "evolution/motion_energy.py"],
        ["test_evolution.py", "test_slip_memory.py", "test_motion.py"],
    ),
}
#: Of a room, files of tests that need one module alone, and of pytest no more than its cases.
ALONE = {
    "checker": (
        *("test_recorded_proofs", "test_bounds_in_closed_form"),
        *("test_differences_of_solutions", "test_checker_in_small", "test_bounds_of_errors"),
    )
}
#: Operators of Cosmic Ray that are tried. The others put something grosser in the same place (a
#: shift or a power for a sum, which numbers that are no integers refuse anyhow), or what is the
#: same in Python (`is` for `==` of words and small numbers).
OPERATORS = re.compile(
    r"Number|AddNot|True|False|ZeroIteration|RemoveDecorator|Exception|Delete_|Break|Continue"
    r"|ReplaceAnd|ReplaceOr|Comparison\w+_(Eq|NotEq|Lt|LtE|Gt|GtE)$|Is_IsNot|IsNot_Is"
    r"|Add_Sub|Sub_Add|Mul_Div|Div_Mul|Pow_Mul|Mod_Mul|FloorDiv_Mul|BitAnd_BitOr|BitOr_BitAnd"
    r"|BitXor_BitOr|LShift_RShift|RShift_LShift"
)
#: Calls whose arguments are not changed: texts for people alone.
MESSAGES = {"InvalidCertificate", "ValueError", "ArgumentParser", "add_argument", "TypeError"}


def interpreter(folder):
    """A Python with Cosmic Ray, beside what the environment has. Made once."""
    python = folder / "venv" / "bin" / "python3"
    if not python.exists():
        made = ["-m", "venv", "--without-pip", "--system-site-packages"]
        subprocess.run([sys.executable, *made, str(folder / "venv")], check=True)
        pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
        subprocess.run([*pip, COSMIC_RAY], check=True)
    return python


def without_effect(source):
    """Places of the source whose change no number can see, as pairs of (line, column).

    These are annotations, which `from __future__ import annotations` leaves unevaluated, and
    arguments of `MESSAGES`.
    """
    found = []

    def leave_out(node):
        found.append(((node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)))

    for node in ast.walk(ast.parse(source)):
        for name in ("annotation", "returns"):
            if getattr(node, name, None) is not None:
                leave_out(getattr(node, name))
        if isinstance(node, ast.Call):
            called = getattr(node.func, "id", getattr(node.func, "attr", ""))
            if called in MESSAGES:
                for argument in (*node.args, *(k.value for k in node.keywords)):
                    leave_out(argument)
    return found


class Mutant(importlib.abc.MetaPathFinder, importlib.abc.SourceLoader):
    """A module of the package with another source."""

    def __init__(self, path, source):
        self.path = str(path)
        name = path.relative_to(TREE).with_suffix("").as_posix().replace("/", ".")
        self.name = name.removesuffix(".__init__")
        self.source = source

    def find_spec(self, name, path=None, target=None):
        if name == self.name:
            return importlib.util.spec_from_file_location(name, self.path, loader=self)
        return None

    def alone(self):
        """The module without its package."""
        spec = importlib.util.spec_from_loader(self.name, self)
        module = sys.modules[self.name] = importlib.util.module_from_spec(spec)
        self.exec_module(module)
        return module

    def get_filename(self, fullname):
        return self.path

    def get_data(self, path):
        if path == self.path:
            return self.source.encode()
        raise OSError(path)

    def path_stats(self, path):
        raise OSError(path)


def forget_the_package():
    """So that it is imported anew, with the mutant."""
    for name in [n for n in sys.modules if n.split(".")[0] == "dolfinx_contact"]:
        del sys.modules[name]


def ask_alone(asked, before, module, order, tell):
    """Run tests that see a module by its name, or names that are in it.

    Args:
        asked: files, tests and their arguments.
        before: the module that was imported.
        module: the mutant.
        order: numbers of the tests.
        tell: is called with the number of a test before it is run.
    """
    known = {**vars(before), "cp": before}
    for file in {file for file, _, _ in asked}:
        for name, value in list(vars(file).items()):
            if name in known and value is known[name]:
                setattr(file, name, module if value is before else getattr(module, name))
    for number in order:
        file, name, case = asked[number]
        test = getattr(file, name)
        tell(number)
        with tempfile.TemporaryDirectory() as folder:
            wanted = {"tmp_path": Path(folder)} if "tmp_path" in name_of(test) else {}
            test(**case, **wanted)


def all_alone(files):
    """Files, tests and arguments of all tests in files."""
    return [
        (file, name, case)
        for file in files
        for name, test in list(vars(file).items())
        if name.startswith("test_")
        for case in cases(test)
    ]


def name_of(test):
    """Names of what a test is given."""
    return inspect.signature(test).parameters


def cases(test):
    """The arguments of a test by its `pytest.mark.parametrize`, without those that take long."""
    marks = [m for m in getattr(test, "pytestmark", ()) if m.name == "parametrize"]
    found = [{}]
    for mark in marks:
        names = mark.args[0].split(",") if isinstance(mark.args[0], str) else mark.args[0]
        names = [n.strip() for n in names]
        rows = [v if len(names) > 1 else (v,) for v in mark.args[1] if not hasattr(v, "marks")]
        found = [{**a, **dict(zip(names, row, strict=True))} for a in found for row in rows]
    return found


def seen(mutant, tests, alone=(), order=()):
    """Whether a test fails in a fork, or the mutant hangs, and the number of the test alone.

    Args:
        mutant: a module with another source.
        tests: arguments of pytest.
        alone: tests of the module by itself, asked before the package is imported anew.
        order: their numbers, in the order in which they are asked.
    """
    import pytest

    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        with open(os.devnull, "w") as nowhere:
            for stream in (1, 2):
                os.dup2(nowhere.fileno(), stream)
        signal.setitimer(signal.ITIMER_PROF, SECONDS if tests else SECONDS_ALONE)
        status = 1
        try:
            before = sys.modules.get(mutant.name)
            sys.meta_path.insert(0, mutant)
            if alone:
                tell = lambda number: os.write(theirs, f"{number} ".encode())  # noqa: E731
                ask_alone(alone, before, mutant.alone(), order, tell)
                tell("none")
            forget_the_package()
            status = int(pytest.main(["-x", "-q", *tests])) if tests else 0
            if tests and status == 0:
                signal.setitimer(signal.ITIMER_PROF, SECONDS_LONG)
                rest = ["--long", "-m", "long or each_value"]
                status = int(pytest.main(["-x", "-q", *rest, *tests]))
                status = 0 if status == pytest.ExitCode.NO_TESTS_COLLECTED else status
        finally:
            os._exit(status)
    os.close(theirs)
    with open(ours) as pipe:
        asked = pipe.read().split()
    _, status = os.waitpid(child, 0)
    number = int(asked[-1]) if asked and asked[-1] != "none" else None
    return os.waitstatus_to_exitcode(status) != 0, number


class Order:
    """Of tests: those first that have seen mutants in lines near by."""

    def __init__(self, number):
        self.lines = [[] for _ in range(number)]

    def near(self, line):
        """Numbers of the tests for a mutant in a line."""

        def distance(number):
            return min((abs(line - other) for other in self.lines[number]), default=10**6)

        return sorted(range(len(self.lines)), key=distance)


class Mutations:
    """The mutants of a session as sources, made statement by statement of a module.

    Cosmic Ray reads a whole module for each, which takes longer than most tests.
    """

    def __init__(self, items):
        self.first = {}  # of an operator in a statement, the number of its first occurrence
        self.starts = {}
        for one in (item.mutations[0] for item in items):
            path = TREE / one.module_path
            if path not in self.starts:
                body = ast.parse(path.read_text()).body
                heads = ((s, getattr(s, "decorator_list", [])) for s in body)
                self.starts[path] = [min(n.lineno for n in (s, *ds)) - 1 for s, ds in heads]
            key = self.key(one)
            self.first[key] = min(one.occurrence, self.first.get(key, one.occurrence))

    def key(self, one):
        path = TREE / one.module_path
        return path, one.operator_name, bisect.bisect_right(self.starts[path], one.start_pos[0] - 1)

    def source(self, one):
        import cosmic_ray.plugins
        from cosmic_ray.mutating import mutate_code

        path, name, number = key = self.key(one)
        lines = path.read_text().splitlines(keepends=True)
        a, b = ([0, *self.starts[path], len(lines)][k] for k in (number, number + 1))
        operator = cosmic_ray.plugins.get_operator(name)(**one.operator_args)
        changed = mutate_code("".join(lines[a:b]), operator, one.occurrence - self.first[key])
        return "".join([*lines[:a], changed, *lines[b:]])


def start(room, session, sample):
    """List the mutants of a room; those that are not taken are skipped."""
    from cosmic_ray.commands import init
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import WorkerOutcome, WorkResult

    paths = [Path("dolfinx_contact") / m for m in ROOMS[room][0]]
    with use_db(str(session), WorkDB.Mode.create) as db:
        init(paths, db, {})
        without = {path: without_effect((TREE / path).read_text()) for path in paths}

        def place(item):
            one = item.mutations[0]
            return str(one.module_path), one.start_pos, one.operator_name, one.occurrence

        def counts(item):
            one = item.mutations[0]
            at = one.start_pos
            inside = any(a <= at < b for a, b in without[Path(one.module_path)])
            return bool(OPERATORS.search(one.operator_name)) and not inside

        items = sorted(filter(counts, db.work_items), key=place)
        if sample and sample < len(items):
            items = random.Random(SEED).sample(items, sample)
        kept = {item.job_id for item in items}
        others = [item.job_id for item in db.work_items if item.job_id not in kept]
        db.set_multiple_results(others, WorkResult(worker_outcome=WorkerOutcome.SKIPPED))


def hunt(room, folder, sample, files):
    """Try the mutants of a room that are left; the report's first line."""
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult

    tests = [f"tests/{t}" for t in ROOMS[room][1][:files]]
    alone = all_alone([importlib.import_module(name) for name in ALONE.get(room, ())])
    order = Order(len(alone))
    session = folder / f"{room}.sqlite"
    if not session.exists():
        path = TREE / "dolfinx_contact" / ROOMS[room][0][0]
        if seen(Mutant(path, path.read_text()), tests, alone, order.near(0))[0]:
            raise RuntimeError(f"tests of {room} fail without any mutant")
        start(room, session, sample)
    with use_db(str(session), WorkDB.Mode.open) as db:
        mutations = Mutations(db.work_items)
        for item in sorted(db.pending_work_items, key=lambda i: i.job_id):
            one = item.mutations[0]
            line = one.start_pos[0]
            path = TREE / one.module_path
            source = mutations.source(one)
            killed, number = seen(Mutant(path, source), tests, alone, order.near(line))
            if killed and number is not None:
                order.lines[number].append(line)
            result = WorkResult(
                worker_outcome=WorkerOutcome.NORMAL,
                test_outcome=TestOutcome.KILLED if killed else TestOutcome.SURVIVED,
                diff=difference(one.module_path, path.read_text(), source),
            )
            db.set_result(item.job_id, result)
        results = [r for _, r in db.results if r.worker_outcome != WorkerOutcome.SKIPPED]
    survived = sorted(r.diff for r in results if r.test_outcome == TestOutcome.SURVIVED)
    first = f"{len(results) - len(survived)} of {len(results)} mutants were seen"
    (folder / f"{room}.txt").write_text("\n\n".join([first, *survived]) + "\n")
    return first


def difference(name, before, after):
    """The lines that a mutant changes."""
    lines = (text.splitlines() for text in (before, after))
    return "\n".join(difflib.unified_diff(*lines, str(name), lineterm="", n=1))


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=", ".join(ROOMS))
    parser.add_argument("--output", type=Path, default=Path("output/mutants"))
    parser.add_argument("--sample", type=int, help="mutants of each room; all by default")
    parser.add_argument("--files", type=int, help="of tests that are asked first; all by default")
    args = parser.parse_args(argv)
    unknown = set(args.rooms) - set(ROOMS)
    if unknown:
        parser.error(f"no room {', '.join(sorted(unknown))}: there are {', '.join(ROOMS)}")
    folder = args.output.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    python = interpreter(folder)
    if Path(sys.prefix) != python.parents[1]:
        os.execv(python, [str(python), __file__, *(sys.argv[1:] if argv is None else argv)])
    os.chdir(TREE)
    # What is imported here every fork has.
    import dolfinx_contact.analysis  # noqa: F401

    for room in args.rooms or ROOMS:
        print(f"{room}: {hunt(room, folder, args.sample, args.files)}", flush=True)


if __name__ == "__main__":
    main()
