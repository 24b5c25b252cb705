"""Mutation test of the package: one operator, number or statement is changed, and a test must fail.

    docker/run python3 tests/mutants.py --seed 7 --count 90 --output output/mutants

Mutants are drawn at random from all layers, at least four from each, and tried one by one in a copy
of the tree. The functions that each test runs are measured once and stored in the output folder
(`functions.json`; delete it after tests have changed). A mutant is tried by tests that run its
function, tests of its layer first, for `--seconds` of processor time and at most `--most` tests.
`report0.md` lists the verdict of every mutant; `tests/mutants.md` interprets the last sample.
"""

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

TREE = Path(__file__).resolve().parents[1]
PACKAGE = "dolfinx_contact"
#: What stands in place of an operator.
OTHER = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
#: Calls whose effect is a message, which tests of numbers need not see.
MESSAGES = ("logger", "log", "warn", "print", "progress")


def qualified(tree):
    """Every node below a function, with the name of the outermost function or method."""
    for top in tree.body:
        methods = top.body if isinstance(top, ast.ClassDef) else [top]
        for function in methods:
            if isinstance(function, ast.FunctionDef):
                prefix = f"{top.name}." if function is not top else ""
                yield prefix + function.name, function


def skipped(node):
    """Whether a node is a message or an annotation."""
    if isinstance(node, (ast.Raise, ast.JoinedStr, ast.arguments, ast.AnnAssign)):
        return True
    return isinstance(node, ast.Expr) and (
        isinstance(node.value, ast.Constant)
        or any(word in ast.unparse(node.value).split("(")[0] for word in MESSAGES)
    )


def nodes_of(function):
    """Nodes of the statements of a function that are not messages."""
    todo = list(function.body)
    while todo:
        node = todo.pop(0)
        if not skipped(node):
            yield node
            todo += ast.iter_child_nodes(node)


def replacement(node, rng):
    """A changed copy of a node, or None if there is none."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in OTHER:
        return ast.Compare(node.left, [OTHER[type(node.ops[0])]()], node.comparators)
    if isinstance(node, ast.BinOp) and type(node.op) in OTHER:
        return ast.BinOp(node.left, OTHER[type(node.op)](), node.right)
    if isinstance(node, ast.BoolOp):
        return ast.BoolOp(OTHER[type(node.op)](), node.values)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        return node.operand
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return ast.Constant(node.value + rng.choice((1, -1)) if node.value else 1)
    if isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return ast.Constant(not node.value)
    if isinstance(node, ast.IfExp):
        return ast.IfExp(node.test, node.orelse, node.body)
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        return ast.Pass()
    return None


class Mutant:
    """A change of one node of a function."""

    def __init__(self, file, name, node, instead):
        self.file = file
        self.name = name
        self.line = node.lineno
        self.before = ast.unparse(node)
        self.after = ast.unparse(ast.fix_missing_locations(instead))
        self.span = (node.lineno, node.col_offset, node.end_lineno, node.end_col_offset)

    @property
    def layer(self):
        return self.file.parts[0] if len(self.file.parts) > 1 else "(root)"

    def text(self, source):
        """The source with the change."""
        lines = source.encode().splitlines(keepends=True)
        a, left, b, right = self.span
        start = sum(map(len, lines[: a - 1])) + left
        end = sum(map(len, lines[: b - 1])) + right
        whole = source.encode()
        return (
            whole[:start] + f"({self.after})".replace("(pass)", "pass").encode() + whole[end:]
        ).decode()


def mutants_of(file, rng):
    for name, function in qualified(ast.parse((TREE / PACKAGE / file).read_text())):
        for node in nodes_of(function):
            if hasattr(node, "lineno") and (instead := replacement(node, rng)) is not None:
                yield Mutant(file, name, node, instead)


def sample(seed, count):
    """Mutants of all layers in random order: four of each, and others of large layers."""
    rng = random.Random(seed)
    layers = defaultdict(list)
    for path in sorted((TREE / PACKAGE).rglob("*.py")):
        for mutant in mutants_of(path.relative_to(TREE / PACKAGE), rng):
            layers[mutant.layer].append(mutant)
    drawn = []
    for mutants in layers.values():
        rng.shuffle(mutants)
        drawn += [mutants.pop() for _ in range(min(4, len(mutants)))]
    rest = [mutant for mutants in layers.values() for mutant in mutants]
    drawn += rng.sample(rest, max(count - len(drawn), 0))
    rng.shuffle(drawn)
    return drawn[:count]


# -- a plugin of pytest: functions that every test runs --------------------------------------------


class Functions:
    """Notes which functions of the package each test runs, and its processor time."""

    def __init__(self, file):
        self.file = Path(file)
        self.tests = {}
        self.names = set()
        self.watch = sys.monitoring
        self.watch.use_tool_id(self.watch.COVERAGE_ID, "functions")
        self.watch.register_callback(self.watch.COVERAGE_ID, self.watch.events.PY_START, self.begin)
        self.watch.set_events(self.watch.COVERAGE_ID, self.watch.events.PY_START)

    def begin(self, code, _):
        part = code.co_filename.partition(f"/{PACKAGE}/")[2]
        if part:
            self.names.add(f"{part}:{code.co_qualname.replace('.<locals>', '')}")
        return self.watch.DISABLE

    def pytest_runtest_logstart(self):
        self.names.clear()
        self.watch.restart_events()
        self.start = time.process_time()

    def pytest_runtest_logfinish(self, nodeid):
        self.tests[nodeid] = [round(time.process_time() - self.start, 2), sorted(self.names)]

    def pytest_sessionfinish(self):
        self.file.write_text(json.dumps(self.tests))


def pytest_configure(config):
    if "MUTANTS_FUNCTIONS" in os.environ:
        config.pluginmanager.register(Functions(os.environ["MUTANTS_FUNCTIONS"]))


# -- the hunt --------------------------------------------------------------------------------------


def copied(folder):
    """A copy of the tree in a folder."""
    shutil.rmtree(folder, ignore_errors=True)
    ignored = shutil.ignore_patterns(".git", "__pycache__", "output", "_build")
    shutil.copytree(TREE, folder, ignore=ignored)
    return folder


def run_tests(tree, *arguments, **options):
    path = os.pathsep.join([str(tree), str(tree / "tests")])
    command = [sys.executable, "-m", "pytest", "-q", "--color=no", *arguments]
    env = os.environ | {"PYTHONPATH": path} | options.pop("env", {})
    return subprocess.run(command, cwd=tree, env=env, capture_output=True, text=True, **options)


def functions_of_tests(tree, file):
    """Seconds and functions of all tests; measured if the file does not exist."""
    if not file.exists():
        done = run_tests(tree, "-p", "mutants", "tests", env={"MUTANTS_FUNCTIONS": str(file)})
        assert done.returncode < 2, done.stdout + done.stderr
    collected = run_tests(tree, "--collect-only", "tests").stdout.splitlines()
    known = json.loads(file.read_text())
    return {test: known[test] for test in collected if test in known}


def that_run(mutant, tests, seconds, most):
    """Return tests that run the function of a mutant, up to a total processor time.

    Tests of its layer come first, then cases of the regression record, then others. Quick tests
    precede slow ones.
    """
    key = f"{mutant.file}:{mutant.name}"
    folders = (f"tests/unit/{mutant.layer}/", "tests/test_golden.py", "tests/")
    found = sorted(
        (next(k for k, folder in enumerate(folders) if test.startswith(folder)), duration, test)
        for test, (duration, names) in tests.items()
        if any(name == key or name.startswith(f"{key}.") for name in names)
    )
    chosen = []
    spent = 0.0
    for group in range(len(folders)):
        for _, duration, test in (entry for entry in found if entry[0] == group):
            share = seconds * (group + 1) / len(folders)
            if spent + duration < share and len(chosen) < most * (group + 1) / len(folders):
                spent += duration
                chosen.append(test)
    return chosen or [test for _, _, test in found[:1]]


def verdict(mutant, tree, tests, limit):
    """The first failing test, "time" for a mutant that hangs, or "" for a survivor."""
    file = tree / PACKAGE / mutant.file
    source = file.read_text()
    file.write_text(mutant.text(source))
    try:
        done = run_tests(tree, "-x", *tests, timeout=limit)
    except subprocess.TimeoutExpired:
        return "time"
    finally:
        file.write_text(source)
    assert done.returncode < 4, done.stdout
    failed = re.search(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", done.stdout, re.MULTILINE)
    return failed[1] if failed else "" if done.returncode == 0 else "exit"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=90, help="number of mutants")
    parser.add_argument("--seconds", type=float, default=20.0, help="of tests for one mutant")
    parser.add_argument("--most", type=int, default=60, help="tests for one mutant")
    parser.add_argument("--part", type=int, nargs=2, default=(0, 1), help="part K of N")
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    part, parts = args.part
    args.output.mkdir(parents=True, exist_ok=True)
    tree = copied(args.output / f"tree{part}")
    tests = functions_of_tests(tree, args.output / "functions.json")
    report = args.output / f"report{part}.md"
    report.write_text("| layer | function | change | verdict |\n|---|---|---|---|\n")
    for mutant in sample(args.seed, args.count)[part::parts]:
        chosen = that_run(mutant, tests, args.seconds, args.most)
        seen = verdict(mutant, tree, chosen, 20 * args.seconds) if chosen else "no test"
        row = (
            mutant.layer,
            f"{mutant.file}:{mutant.line} {mutant.name}",
            f"`{mutant.before[:70]}` -> `{mutant.after[:70]}`",
            seen or f"survives {len(chosen)} tests",
        )
        with report.open("a") as out:
            print("|", " | ".join(row).replace("\n", " "), "|", file=out)


if __name__ == "__main__":
    main()
