"""Tests run serial and under mpirun; only rank 0 reports, and any rank that fails fails the run."""

import os
import sys
from importlib.util import find_spec

from mpi4py import MPI
from petsc4py import PETSc

import pytest

# With more threads SCOTCH parts the same mesh otherwise every time; it looks at its first call.
os.environ.setdefault("SCOTCH_PTHREAD_NUMBER", "1")

COMM = MPI.COMM_WORLD
#: Tests of what ranks do to each other, on two of them in all cases.
EVERY_CASE = (
    "test_bad_input",
    "test_disk",
    "test_hostile",
    "test_kinematics",
    "test_messages",
    "test_results",
)
#: Tests of which every case runs on any number of ranks.
ON_ANY = ("test_golden",)
#: Tests on three ranks, of what depends on who owns what; the rest is seen on two.
ON_THREE = {
    "test_adhesion": ("as_on_one_rank",),
    "test_affine": ("a_bulk_that_jumps_is_refused", "a_kink_that_becomes_a_jump"),
    "test_all_solutions_3d": ("what_is_proved",),
    "test_arc_length": ("of_two_that_are_alike",),
    "test_bad_input": ("bad_numbers_on_one_rank_only", "a_rank_without_any_cell"),
    "test_blocks": ("oracle_forces", "ranks_and_ghost_modes", "patch"),
    "test_checkpoint_files": ("on_any_ranks", "resumed_on_one_rank_and_on_all"),
    "test_classical": ("in_space",),
    "test_common_points": ("patch", "patch_of_a_short_block"),
    "test_compliant": ("jacobian_by_taylor",),
    "test_continuation": ("path_with_two_nonsmooth_folds", "parity_is_that_of_mumps"),
    "test_critical_friction": ("of_a_solution",),
    "test_crossing_cracks": ("blocks_under_unequal_pressures", "planes_that_cross"),
    "test_curved_friction": ("ranks", "jacobian"),
    "test_doubled_nodes": ("tables_do_not_depend_on_ranks",),
    "test_evolution": ("energy", "a_load_that_fails_on_one_rank"),
    "test_evolution_output": ("a_series_with_stresses_and_its_start",),
    "test_held_ends": ("patch",),
    "test_interfaces": ("adhesion_of_a_block", "jacobian_by_taylor"),
    "test_kept_data": ("an_honest_resume_on_other_ranks",),
    "test_large_sliding": ("jacobian_by_taylor",),
    "test_law": ("jacobian_by_taylor",),
    "test_look": ("the_inside_is_gathered",),
    "test_mortar": ("patch", "patch_in_space", "a_slave_that_is_held"),
    "test_multigrid": ("same_as_direct", "filter_leaves_nothing_on_the_surface"),
    "test_nonlocal": ("ranks", "a_surface_on_one_rank_alone"),
    "test_output": ("pressure_as_a_function",),
    "test_pair": ("mirrored_bodies", "one_side_is_clamped"),
    "test_pair_multigrid": ("same_as_direct",),
    "test_parametric": ("derivative_by_gamma", "single_element"),
    "test_point_problem": ("what_is_saved_is_the_problem",),
    "test_properties": ("ranks",),
    "test_renard": ("of_a_solution",),
    "test_results": ("balance_of_all_forces",),
    "test_rigid_body": ("ranks", "the_jacobian"),
    "test_rigid_surface": ("jacobian", "flat_punch_and_ranks"),
    "test_scales": ("what_stays",),
    "test_self_contact_in_space": ("a_folded_plate", "jacobian"),
    "test_sliding_pair": (
        *("jacobian", "patch", "history", "wedge"),
        "a_motion_continues_from_its_record",
    ),
    "test_sliding_revolution": ("jacobian", "patch", "seal"),
    "test_sliding_steps": ("a_fall_of_the_smallest_det_is_refused",),
    "test_surface": ("points_lie_where_they_should", "facets_named_on_one_rank_only"),
    "test_uniqueness": ("the_only_solution",),
}
#: Tests that the wheel of DOLFINx (`docker/wheel`) cannot run, and why; `pytest -rs` lists them.
NOT_ON_WHEEL = {
    "test_ratio_of_contact_to_elasticity": "the PETSc of the wheel has no hypre",
    "test_bodies_that_are_tied": "the PETSc of the wheel has no hypre",
    "test_ranks_that_outlive_a_killed_mpirun": "MPICH has processes between mpiexec and its ranks",
}


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    if COMM.rank > 0:
        reporter = config.pluginmanager.getplugin("terminalreporter")
        if reporter is not None:
            reporter._tw._file = open(os.devnull, "w")  # noqa: SIM115


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="run the tests that take long as well")


def pytest_collection_modifyitems(config, items):
    """Leave out what takes long, and on several ranks most repetitions (all run with --long).

    There a test with several cases runs in one, the last on two ranks and the first on more, but
    for tests of what ranks do to each other and the golden record. What sends many messages runs
    serially alone, and on three ranks only what `ON_THREE` names.
    """
    if find_spec("dolfinx_solver"):
        for item in items:
            why = NOT_ON_WHEEL.get(item.originalname)
            if why:
                item.add_marker(pytest.mark.skip(reason=why))
    if config.getoption("--long"):
        return
    cases = {}
    for item in items:
        if item.path.stem in ON_ANY:
            continue
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.skip(reason="takes long: --long runs it"))
        elif COMM.size > 1 and item.get_closest_marker("chatty"):
            item.add_marker(pytest.mark.skip(reason="sends many messages"))
        elif COMM.size > 2 and not _on_three(item):
            item.add_marker(pytest.mark.skip(reason="runs on fewer ranks"))
        elif COMM.size > 1 and (COMM.size > 2 or item.path.stem not in EVERY_CASE):
            cases.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for repeated in cases.values():
        for item in repeated[:-1] if COMM.size == 2 else repeated[1:]:
            item.add_marker(pytest.mark.skip(reason="another case runs on so many ranks"))


def _on_three(item):
    return item.originalname.removeprefix("test_") in ON_THREE.get(item.path.stem, ())


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """A test that fails on one rank fails on rank 0 as well, with that rank's traceback."""
    outcome = yield
    if COMM.size == 1 or call.when != "call":
        return
    report = outcome.get_result()
    text = str(report.longrepr) if report.failed else None
    others = [t for t in COMM.allgather(text) if t is not None]
    if others and not report.failed:
        report.outcome = "failed"
        report.longrepr = "failed on another rank:\n" + others[0]


@pytest.fixture(autouse=True)
def clean_petsc_options():
    """No test sees the PETSc options of another."""
    yield
    options = PETSc.Options()
    for key in options.getAll():
        options.delValue(key)


@pytest.fixture(params=["direct", "multigrid", "multigrid by default"])
def accuracy(request):
    """Of contact forces over the largest, by a linear solver and its tolerance."""
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


sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "demos"))
