# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I read results in another script?
#
# `read_journal` loads the record of a branch, a history or a path from its folder: on one process,
# without rerunning the script, and also during the run. `rows` has one row for the start and one
# for each step. `surface` is the outer surface of the body. Contact tables are CSV files, written
# by `io.write_contact_table`, with the columns of `ContactTable.to_pandas`.

import numpy as np
import pandas as pd
from common import Block

from dolfinx_contact import io
from dolfinx_contact.evolution import QuasiStatic
from dolfinx_contact.records import EvolutionRecord, read_journal

evolution = QuasiStatic(Block().problem(), lambda t: None)
with EvolutionRecord("output/steps", evolution, surface_displacement=True) as record:
    last = evolution.run([0.0, 1.0], record=record).steps[-1].result
folder = io.output_folder(evolution.problem.comm, "output/tables")
io.write_contact_table(evolution.problem.comm, folder, last.tables.values())
journal = read_journal("output/steps")  # from here on: another script
print(journal.rows()[-1]["dissipated"], journal.surface_at(1).u.shape)
table = pd.read_csv("output/tables/contact.csv")
print(table[["x", "un", "pressure", "status"]])
assert list(table) == list(last.tables["contact"].to_pandas())
assert np.isclose(table.rn.sum(), last.resultants["contact"][1])
