"""Mutants of the core: a token is changed, and the tests of its room have to see it.

For every room (`ROOMS`) Cosmic Ray lists the mutants of its modules in a session, those by
`OPERATORS`. Which lines every test of the room runs is seen once (`lines_run`), and a mutant is
tried by those that run its line, the quickest first, in a fork of one process that has imported
all but the package: a mutant that is seen at once costs half a second. Mutants are taken in an
order that is the same every time; a session continues where it was left, until `--sample` of them
have been tried. Beside the sessions are `ROOM.txt`, with the score and what has survived as
differences, and `lines.json`, with the lines that tests run (to be deleted when tests have
changed). `make mutants` runs all of it; `tests/mutants.md` has what was found. `--again` tries
once more what has survived. Tests that `make test` leaves out are asked as well.

    docker/run python3 tests/mutants.py --output output/mutants --sample 40 laws
"""

import argparse
import ast
import bisect
import difflib
import importlib.abc
import importlib.util
import inspect
import json
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
#: Modules (of folders: all that no other room has) and files of tests of the rooms.
ROOMS = {
    "laws": (
        ["laws/[!c_]*.py", "laws/co[!m]*.py", "laws/compliant.py"],
        [
            *("law", "coulomb", "status", "table_of_laws", "anisotropic", "compliant"),
            *("compiled_law", "friction_limits", "more_friction", "own_law", "interfaces"),
            *(
                "adhesion_in_time",
                "adhesion_recovers",
                "nonlocal",
            ),
        ],
    ),
    "compiler": (["laws/compiled.py"], ["compiled_law", "law"]),
    "points": (
        ["points/[!_]*.py", "points/sliding/[!_]*.py", "obstacles.py"],
        [
            *("surface", "kinematics", "pair", "sliding_pair", "mortar", "rigid_surface"),
            "sliding_revolution",
            *("rigid_body", "true_surface", "two_faces", "small_sliding", "held_ends"),
            *("curved_friction", "given_normals", "doubled_nodes", "common_points", "overlap"),
            "planes_of_symmetry",
            "clipping",
        ],
    ),
    "equations": (
        ["equations/[!_]*.py"],
        [
            *("kinematics", "parametric", "checks", "law", "own_law", "more_friction"),
            *("curved_friction", "rigid_body", "pair", "nonlocal", "planes_of_symmetry"),
            *("messages", "scales"),
        ],
    ),
    "reduced": (
        ["reduced/[!_]*.py", "solvers/condensation.py", "solvers/surface_block.py"],
        [
            "point_problem",
            "lemke",
        ],
    ),
    "checker": (
        ["proofs/check_proof.py"],
        ["recorded_proofs", "check_proof", "certificates", "proofs_in_space"],
    ),
    "pivoting": (
        [
            *("continuation/pivoting.py", "continuation/rays.py", "continuation/ray_finder.py"),
            *("continuation/affine.py", "continuation/corrector.py"),
            *("continuation/factorised.py", "continuation/steps.py", "solvers/pivoting.py"),
        ],
        [
            *("affine", "rays", "linear_triangle", "proved_rays", "continuation", "kinked_data"),
            *(
                "kink_starts",
                "pivoting",
            ),
        ],
    ),
    "evolution": (
        ["evolution/[!_]*.py"],
        [
            *("evolution", "slip_memory", "increments", "sliding_steps", "at_rest", "motion"),
            *("motion_data", "motion_solver", "friction_from_zero", "arc_length", "jumps"),
            "motion_laws",
            "between_runs",
        ],
    ),
}
#: Of a room, files of tests that need one module alone, and of pytest no more than its cases.
ALONE = {
    "checker": (
        *("test_recorded_proofs", "test_bounds_in_closed_form"),
        *("test_differences_of_solutions", "test_bounds_of_errors"),
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
#: Looks at the classes of a folder, and runs none of its lines.
AT_IMPORT = "test_what_is_found_does_not_change"
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
    """Whether a test fails in a fork, or the mutant hangs; the number of the test alone; the test.

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
            status = (
                pytest.main(["-x", "-q", "--long", *tests], [FirstFailure(theirs)]) if tests else 0
            )
        finally:
            os._exit(status)
    os.close(theirs)
    with open(ours) as pipe:
        told, _, failed = pipe.read().partition("\n")
    asked = told.split()
    _, status = os.waitpid(child, 0)
    number = int(asked[-1]) if asked and asked[-1] != "none" else None
    return os.waitstatus_to_exitcode(status) != 0, number, failed


class FirstFailure:
    """Tells of pytest the first test that fails."""

    def __init__(self, pipe):
        self.pipe = pipe

    def pytest_runtest_logreport(self, report):
        if report.failed:
            os.write(self.pipe, f"\n{report.nodeid}".encode())


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


def modules(room):
    """Paths of the modules of a room, from the folder of the tree."""
    package = TREE / "dolfinx_contact"
    found = {path for pattern in ROOMS[room][0] for path in package.glob(pattern)}
    return sorted(path.relative_to(TREE) for path in found)


def lines_of_tests(room, folder):
    """Seconds and lines of tests by their names, those of a room among them."""
    path = folder / "lines.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    files = [
        str(file.relative_to(TREE))
        for name in ROOMS[room][1]
        for file in (TREE / "tests").rglob(f"test_{name}.py")
        if file.parent.name != "adversarial"
    ]
    missing = sorted(set(files) - {test.partition("::")[0] for test in known})
    if not missing:
        return known
    there = os.pathsep.join((str(TREE), str(TREE / "tests"), os.environ.get("PYTHONPATH", "")))
    pytest = [sys.executable, "-m", "pytest", "-q", "--long"]
    asked = [*pytest, "-p", "lines_run", "--lines-run", str(path)]
    done = subprocess.run([*asked, *missing], env={**os.environ, "PYTHONPATH": there})
    if done.returncode:
        path.write_text(json.dumps(known))
        raise RuntimeError(f"tests of {room} fail without any mutant")
    return json.loads(path.read_text())


def statement(tree, line):
    """Lines of the statement that has a line, without what is in it; of a function all of it."""
    around = [n for n in ast.walk(tree) if isinstance(n, (ast.stmt, ast.ExceptHandler))]
    around = [n for n in around if first_line(n) <= line <= n.end_lineno]
    inner = min(around, key=lambda n: n.end_lineno - first_line(n), default=None)
    if inner is None:
        return range(line, line + 1)
    within = getattr(inner, "body", None)
    if within and not isinstance(inner, (ast.FunctionDef, ast.ClassDef)):
        return range(inner.lineno, max(within[0].lineno, line + 1))
    return range(first_line(inner), inner.end_lineno + 1)


def at_import(tree, line):
    """Whether a line is run when the module is imported: in no body of a function."""
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]
    return not any(n.body[0].lineno <= line <= n.end_lineno for n in functions)


def first_line(node):
    """Where a statement begins with its decorators."""
    return min(n.lineno for n in (node, *getattr(node, "decorator_list", [])))


def that_run(module, line, known, tree, seconds):
    """Tests that run a line of a module, quick ones first and of each not all cases at once.

    Args:
        module: path from the package.
        line: number of the line.
        known: seconds and lines of every test.
        tree: of the module's source.
        seconds: that all tests together may take.
    """
    place = statement(tree, line)
    runs = {test: lines[module] for test, (_, lines) in known.items() if module in lines}
    among = [test for test, lines in runs.items() if set(place).intersection(lines)]
    # What is run at the first import has the tests of the module.
    if at_import(tree, line):
        mine = f"{AT_IMPORT}[{module.partition('/')[0]}]"
        among = [*runs, *(test for test in known if test.endswith(mine) and test not in runs)]
    among = among or list(runs)
    cases = {}
    for test in sorted(among, key=lambda t: known[t][0]):
        cases.setdefault(test.partition("[")[0], []).append(test)
    ranks = [(test, k) for same in cases.values() for k, test in enumerate(same)]
    weights = {test: (0.05 + known[test][0]) * (k + 1) for test, k in ranks}
    taken, total = [], 0.0
    for test in sorted(weights, key=weights.get):
        total += known[test][0]
        if total > seconds and taken:
            break
        taken.append(test)
    return taken


def start(room, session):
    """List the mutants of a room; those of other operators, and texts, are skipped."""
    from cosmic_ray.commands import init
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import WorkerOutcome, WorkResult

    paths = modules(room)
    with use_db(str(session), WorkDB.Mode.create) as db:
        init(paths, db, {})
        without = {path: without_effect((TREE / path).read_text()) for path in paths}
        lines = {path: (TREE / path).read_text().splitlines() for path in paths}

        def counts(item):
            one = item.mutations[0]
            at = one.start_pos
            if lines[Path(one.module_path)][at[0] - 1].startswith("*,", at[1]):  # of arguments
                return False
            inside = any(a <= at < b for a, b in without[Path(one.module_path)])
            return bool(OPERATORS.search(one.operator_name)) and not inside

        others = [item.job_id for item in db.work_items if not counts(item)]
        db.set_multiple_results(others, WorkResult(worker_outcome=WorkerOutcome.SKIPPED))


def drawn(items):
    """Mutants in the order in which they are tried."""

    def place(item):
        one = item.mutations[0]
        return str(one.module_path), one.start_pos, one.operator_name, one.occurrence

    items = sorted(items, key=place)
    random.Random(SEED).shuffle(items)
    return items


def hunt(room, folder, sample, seconds, again):
    """Try the mutants of a room that are left; the report's first line.

    Args:
        room: one of `ROOMS`.
        folder: of the session.
        sample: mutants that are tried, or None for all.
        seconds: of tests for one mutant.
        again: try those that have survived.
    """
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult

    known = lines_of_tests(room, folder)
    alone = all_alone([importlib.import_module(name) for name in ALONE.get(room, ())])
    order = Order(len(alone))
    session = folder / f"{room}.sqlite"
    if not session.exists():
        start(room, session)
    with use_db(str(session), WorkDB.Mode.open) as db:
        mutations = Mutations(db.work_items)
        results = dict(db.results)
        taken = {i for i, r in results.items() if r.worker_outcome != WorkerOutcome.SKIPPED}
        skipped = set(results) - taken
        counted = drawn(item for item in db.work_items if item.job_id not in skipped)[:sample]
        for item in counted:
            before = results.get(item.job_id)
            if before and not (again and before.test_outcome == TestOutcome.SURVIVED):
                continue
            one = item.mutations[0]
            line = one.start_pos[0]
            path = TREE / one.module_path
            source = mutations.source(one)
            within = path.relative_to(TREE / "dolfinx_contact").as_posix()
            tests = that_run(within, line, known, ast.parse(path.read_text()), seconds)
            killed, number, by = seen(Mutant(path, source), tests, alone, order.near(line))
            if killed and number is not None:
                order.lines[number].append(line)
            result = results[item.job_id] = WorkResult(
                worker_outcome=WorkerOutcome.NORMAL,
                test_outcome=TestOutcome.KILLED if killed else TestOutcome.SURVIVED,
                diff=difference(one.module_path, path.read_text(), source),
            )
            db.set_result(item.job_id, result)
            said = (by or "a hang, or no import") if killed else f"survives {len(tests)} tests"
            print(f"{within}:{line} {one.operator_name}: {said}", flush=True)
    tried = [results[item.job_id] for item in counted]
    survived = sorted(r.diff for r in tried if r.test_outcome == TestOutcome.SURVIVED)
    first = f"{len(tried) - len(survived)} of {len(tried)} mutants were seen"
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
    parser.add_argument("--seconds", type=float, default=60, help="of tests for one mutant")
    parser.add_argument("--again", action="store_true", help="try what has survived once more")
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
    for name in ("dolfinx_contact.analysis", "gmsh", "hypothesis"):
        importlib.import_module(name)

    for room in args.rooms or ROOMS:
        print(f"{room}: {hunt(room, folder, args.sample, args.seconds, args.again)}", flush=True)


if __name__ == "__main__":
    main()
