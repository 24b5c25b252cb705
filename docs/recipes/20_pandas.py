# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I turn a contact table into a pandas DataFrame?
#
# Take the columns that you need; each is a numpy array with an entry a point, the same on every
# rank. Tables of branches are DataFrames already (`Journal.table`), those of histories are lists of
# rows that pandas takes as they are.

import pandas as pd
from common import Block

table = Block().problem().solve().tables["contact"]
names = ("un", "rn", "pressure", "area", "bound")
frame = pd.DataFrame({"x": table.x[:, 0], **{name: getattr(table, name) for name in names}})
frame["status"] = table.letters
frame["rt"] = table.along(table.rt)
print(frame.round(4))
print(frame.groupby("status").rn.sum())
assert (frame.rn >= 0).all()
assert len(frame) == 9
