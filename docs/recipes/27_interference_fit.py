# SPDX-License-Identifier: LGPL-3.0-or-later
# # How do I model an interference fit, or bodies that initially penetrate?
#
# If bodies penetrate initially, use a `ContactPair` with `interference=True`. The overlap is drawn
# or given by a negative `gap`. This models press fits and shrink fits. The solution presses the
# parts apart; the forces on both faces are opposite, and `result.pairs` contains them. Here two
# blocks overlap by 0.01 between fixed ends, with nu = 0: the pressure is E times 0.01 over their
# common height. `demo_press_fit.py` has a ring on a hub.

import numpy as np
from common import TwoBlocks

blocks = TwoBlocks(moved=(0.0, 0.0), poisson=0.0)
pair = blocks.pair(gap=-0.01, interference=True)
result = blocks.problem(pair).solve()
pressure = result.tables["contact"].pressure
balance = result.pairs["contact"]
print(f"pressure {pressure}")
print(f"on the upper block {balance.slave}, on the lower one {balance.master}")
print(f"off by {balance.imbalance:.1e} of all forces, moments by {balance.moment:.1e}")
assert balance.imbalance < 1e-10
assert np.allclose(pressure, 1000.0 * 0.01 / 2.0)
