"""Journals are read in a process that has NumPy, and neither MPI, PETSc nor DOLFINx."""

import json
import subprocess
import sys

from mpi4py import MPI

import numpy as np
import pytest
from support import recorded_evolution, recorded_path
from support.recorded_run import moved_block, record

from dolfinx_contact.continuation import StepControl
from dolfinx_contact.records import EvolutionRecord, PathRecord, read_journal

#: Beginning of a program in which only the standard library and NumPy can be imported.
WITHOUT_DOLFINX = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top not in {"numpy", "dolfinx_contact", *sys.stdlib_module_names}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
"""

READER = """
import json
from dolfinx_contact.records import EvolutionJournal, Journal, PathJournal, read_journal

journal = read_journal(sys.argv[1])
assert isinstance(journal, (Journal, EvolutionJournal, PathJournal))
state = journal.surface_at(1)
print(json.dumps({
    "kind": type(journal).__name__,
    "columns": {k: v.tolist() for k, v in journal.columns().items()},
    "rows": journal.rows(),
    "statuses": [entry.status for entry in journal.entries()],
    "vertices": journal.surface().x.tolist(),
    "displacement": state.u.tolist(),
    "tables": {k: sorted(v) for k, v in state.tables.items()},
}))
"""


def branch(folder):
    system, functionals = moved_block(MPI.COMM_WORLD)
    record(system, functionals, folder, max_steps=3, surface_displacement=True)


def history(folder):
    evolution = recorded_evolution.pair(MPI.COMM_WORLD, n=2)
    with EvolutionRecord(folder, evolution, surface_displacement=True) as kept:
        evolution.run([0.0, 0.5, 1.0], record=kept)


def path(folder):
    made = recorded_path.made("bonds")
    control = StepControl(maximum=recorded_path.LONGEST)
    with PathRecord(folder, made, surface_displacement=True) as kept:
        made.run(gamma_range=(0.0, 0.7), control=control, max_steps=2, record=kept)


def run(program, *arguments):
    return subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)], capture_output=True, text=True
    )


@pytest.mark.parametrize(
    ("make", "kind"),
    [(branch, "Journal"), (history, "EvolutionJournal"), (path, "PathJournal")],
)
def test_numpy_suffices_to_read_a_journal(make, kind, folder):
    make(folder)
    done = run(WITHOUT_DOLFINX + READER, folder)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    journal = read_journal(folder)
    state = journal.surface_at(1)
    assert found["kind"] == kind
    assert found["columns"] == {k: v.tolist() for k, v in journal.columns().items()}
    assert found["rows"] == journal.rows()
    assert found["statuses"] == [entry.status for entry in journal.entries()]
    np.testing.assert_array_equal(found["vertices"], journal.surface().x)
    np.testing.assert_array_equal(found["displacement"], state.u)
    assert found["tables"] == {k: sorted(v) for k, v in state.tables.items()}


@pytest.mark.parametrize("name", ["ContactProblem", "records.BranchRecord", "laws.Coulomb"])
def test_missing_dolfinx_is_named_with_advice(name):
    module, _, attribute = f"dolfinx_contact.{name}".rpartition(".")
    done = run(WITHOUT_DOLFINX + f"from {module} import {attribute}")
    assert done.returncode == 1
    said = done.stderr.splitlines()[-1]
    assert said.startswith("ModuleNotFoundError: DOLFINx with PETSc and MPI is needed, and there")
    assert "'signorini-coulomb[solver]'" in said
