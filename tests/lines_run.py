"""A plugin of pytest: which lines of the package every test runs, and how long the test takes.

`pytest -p lines_run --lines-run FILE` adds them to FILE (json): test, seconds of processor time,
and lines of every module. Tests that are not run keep what the file has of them. Where a fixture or
an import is shared, the first test has its lines; of laws, which are compiled once, every test.
"""

import json
import sys
import time
from collections import defaultdict
from pathlib import Path

import pytest

TREE = Path(__file__).resolve().parents[1]
PACKAGE = str(TREE / "dolfinx_contact") + "/"


def pytest_addoption(parser):
    parser.addoption("--lines-run", type=Path, help="write which lines every test runs")


class Compiled(dict):
    """The laws that are compiled; who takes one has run the lines of those that made it."""

    def __init__(self, lines):
        self.lines = lines
        self.made_by = {}

    def __setitem__(self, key, law):
        super().__setitem__(key, law)
        of_laws = {m: set(v) for m, v in self.lines.items() if m.startswith("laws/")}
        self.made_by[key] = of_laws

    def __getitem__(self, key):
        for module, numbers in self.made_by[key].items():
            self.lines[module] |= numbers
        return super().__getitem__(key)


class LinesRun:
    """Asks the interpreter for every line once a test."""

    def __init__(self, path):
        self.path = path
        self.tests = json.loads(path.read_text()) if path.exists() else {}
        self.lines = defaultdict(set)
        self.watch = sys.monitoring
        self.tool = self.watch.COVERAGE_ID
        self.watch.use_tool_id(self.tool, "lines_run")
        self.watch.register_callback(self.tool, self.watch.events.LINE, self.line)
        self.watch.set_events(self.tool, self.watch.events.LINE)

    def line(self, code, number):
        if code.co_filename.startswith(PACKAGE):
            self.lines[code.co_filename.removeprefix(PACKAGE)].add(number)
        return self.watch.DISABLE

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item):
        self.lines.clear()
        self.watch.restart_events()
        start = time.process_time()
        yield
        seconds = round(time.process_time() - start, 2)
        lines = {module: sorted(numbers) for module, numbers in self.lines.items()}
        self.tests[item.nodeid] = [seconds, lines]

    def pytest_sessionstart(self):
        from dolfinx_contact.laws import compiled

        compiled._known = Compiled(self.lines)

    def pytest_sessionfinish(self):
        self.watch.set_events(self.tool, 0)
        self.watch.register_callback(self.tool, self.watch.events.LINE, None)
        self.watch.free_tool_id(self.tool)
        self.path.write_text(json.dumps(self.tests))


def pytest_configure(config):
    if config.getoption("--lines-run"):
        config.pluginmanager.register(LinesRun(config.getoption("--lines-run")))
