# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I turn a contact table into a pandas DataFrame?
#
# `to_pandas` of a contact table gives the results of a solve, one row for each point, the same on
# every rank; without pandas, `columns` gives numpy arrays. Journals of branches, histories and
# paths have `to_pandas` too.

from common import Block

frame = Block().problem().solve().tables["contact"].to_pandas()
print(frame[["x", "un", "pressure", "rn", "status"]].round(4))
print(frame.groupby("status").rn.sum())
assert (frame.rn >= 0).all()
assert len(frame) == 9
