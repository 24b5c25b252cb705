# SPDX-License-Identifier: LGPL-3.0-or-later
"""The search for proofs in space; what they prove is decided by `analysis.check_proof`.

A search of its own beside that of the plane: slips have directions, so that regions are cells with
arcs of these, and pieces are not linear. `branching` walks the tree, `starts` and `pieces` find
solutions, `weights` those of quadratic inequalities, `hull` and `simplex` are the linear programs,
and `probing` asks them.
"""

from dolfinx_contact.analysis.space.branching import search_in_space

__all__ = ["search_in_space"]
