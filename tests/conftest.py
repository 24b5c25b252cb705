"""Tests run serial and under mpirun; only rank 0 reports, and any rank that fails fails the run."""

import faulthandler
import gc
import os
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import pytest

# With more threads SCOTCH parts the same mesh otherwise every time; it looks at its first call.
os.environ.setdefault("SCOTCH_PTHREAD_NUMBER", "1")

COMM = MPI.COMM_WORLD
#: Standard error as it was before pytest captured it, for reports of hangs.
STDERR = os.fdopen(os.dup(2), "w")
#: Seconds after which a hanging test ends the run: four times the longest on a busy machine.
LIMIT = 400
#: Folder of the adversarial tests, of which a sample runs by default.
ADVERSARIAL = Path(__file__).parent / "adversarial"


@pytest.fixture(scope="module", autouse=True)
def free_communicators():
    """Free the communicators of unused meshes; MPICH has 2048, and reference cycles hold them."""
    yield
    if COMM.size == 1:
        gc.collect()


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    if COMM.rank > 0:
        reporter = config.pluginmanager.getplugin("terminalreporter")
        if reporter is not None:
            reporter._tw._file = open(os.devnull, "w")  # noqa: SIM115


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="run the tests that take long as well")
    parser.addoption(
        "--adversarial", action="store_true", help="run all adversarial tests, not only a sample"
    )


def pytest_ignore_collect(collection_path, config):
    """Skip files of which several ranks run nothing, without importing them."""
    if ADVERSARIAL in collection_path.parents:
        return None if COMM.size <= 2 else True
    if COMM.size == 1 or collection_path.suffix != ".py":
        return None
    if not collection_path.stem.startswith("test_"):
        return None
    return None if "mark.ranks(" in collection_path.read_text() else True


def pytest_collection_modifyitems(config, items):
    """Select the tests of the run.

    On several ranks only tests marked `ranks` run. ``--long`` runs all of their cases, also on the
    ranks that the mark lists as `long`. Without it, tests marked `long` are left out, `each_value`
    reduces products of cases to a few in which every value occurs, and several ranks leave out
    tests that send many messages. They run a test with several cases in one of them (the last on
    two ranks, the first on more), unless it is marked with `every_case`.
    """
    _select_sample(config, items)
    in_all_cases = config.getoption("--long")
    cases = {}
    left_out = set() if in_all_cases else _beside_each_value(items)
    for item in items:
        if ADVERSARIAL in item.path.parents:
            continue
        if not _on_ranks(item, in_all_cases):
            item.add_marker(pytest.mark.skip(reason="runs on fewer ranks"))
        elif in_all_cases:
            continue
        elif item in left_out:
            item.add_marker(
                pytest.mark.skip(reason="its values are in other cases: --long runs it")
            )
        elif item.get_closest_marker("long"):
            item.add_marker(pytest.mark.skip(reason="takes long: --long runs it"))
        elif COMM.size > 1 and item.get_closest_marker("chatty"):
            item.add_marker(pytest.mark.skip(reason="sends many messages"))
        elif COMM.size > 1 and not _every_case(item):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for repeated in cases.values():
        for item in repeated[:-1] if COMM.size == 2 else repeated[1:]:
            item.add_marker(pytest.mark.skip(reason="another case runs on so many ranks"))


def _select_sample(config, items):
    """Deselect adversarial tests that are not in the sample, unless all of them are asked for."""
    if config.getoption("--adversarial"):
        return
    left_out = [
        item
        for item in items
        if ADVERSARIAL in item.path.parents and not item.get_closest_marker("sample")
    ]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in set(left_out)]


def _beside_each_value(items):
    """Cases of tests marked `each_value` of which every value is in a case that is kept.

    Cases that take long are none of them. The next that is kept is one with the most new values.
    """
    tests = {}
    for item in items:
        if item.get_closest_marker("each_value") and not item.get_closest_marker("long"):
            tests.setdefault(item.nodeid.partition("[")[0], []).append(item)
    left_out = set()
    for left in tests.values():
        seen = set()
        while left:
            new = [len(set(item.callspec.indices.items()) - seen) for item in left]
            best = left[new.index(max(new))]
            if not max(new):
                break
            seen |= set(best.callspec.indices.items())
            left.remove(best)
        left_out |= set(left)
    return left_out


def _on_ranks(item, in_all_cases):
    """Return whether a test runs on this number of ranks; above three, tests for three run."""
    if COMM.size == 1:
        return True
    marks = list(item.iter_markers("ranks"))
    sizes = [size for mark in marks for size in mark.args]
    if in_all_cases:
        sizes += [size for mark in marks for size in mark.kwargs.get("long", ())]
    return min(COMM.size, 3) in sizes


def _every_case(item):
    return any(mark.kwargs.get("every_case") for mark in item.iter_markers("ranks"))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """A test failing on one rank fails on rank 0 as well, with that rank's traceback."""
    outcome = yield
    if COMM.size == 1 or call.when != "call":
        return
    report = outcome.get_result()
    text = str(report.longrepr) if report.failed else None
    others = [t for t in COMM.allgather(text) if t is not None]
    if others and not report.failed:
        report.outcome = "failed"
        report.longrepr = "failed on another rank:\n" + others[0]


@pytest.fixture
def nothing_hangs():
    """End the run with the tracebacks of all threads if a test hangs, also in a call of MPI.

    They go to the original standard error, because captured output is lost with the process.
    """
    faulthandler.dump_traceback_later(LIMIT, exit=True, file=STDERR)
    yield
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture(autouse=True)
def clean_petsc_options():
    """No test sees the PETSc options of another."""
    yield
    options = PETSc.Options()
    for key in options.getAll():
        options.delValue(key)


@pytest.fixture(params=["direct", "multigrid", "multigrid by default"])
def accuracy(request):
    """Return the relative accuracy of contact forces for a linear solver and its tolerance."""
    options = PETSc.Options()
    if request.param == "direct":
        return 1e-8
    options["contact_linear_solver"] = "amg"
    if request.param == "multigrid":
        options["contact_snes_rtol"] = 1e-11
        return 1e-8
    return 1e-6


@pytest.fixture
def folder(tmp_path_factory):
    """The same new folder on every rank."""
    return COMM.bcast(tmp_path_factory.mktemp("out") if COMM.rank == 0 else None)


@pytest.fixture
def no_pictures(monkeypatch):
    """Skip pictures of bodies and contact faces, which take long and have tests of their own."""
    for name in ("picture_of_body", "picture_of_contact"):
        monkeypatch.setattr(f"dolfinx_contact.plot.{name}", lambda *_, **__: None)
