# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I turn a contact table into a pandas DataFrame?
#
# `to_pandas` of a contact table has the results of a solve, a row a point, the same on every rank;
# without pandas `columns` has the numpy arrays. Tables of branches are DataFrames already
# (`Journal.table`), those of histories are lists of rows that pandas takes as they are.

from common import Block

frame = Block().problem().solve().tables["contact"].to_pandas()
print(frame[["x", "un", "pressure", "rn", "status"]].round(4))
print(frame.groupby("status").rn.sum())
assert (frame.rn >= 0).all()
assert len(frame) == 9
