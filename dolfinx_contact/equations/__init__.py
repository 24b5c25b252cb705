# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem H(x) = 0: rows, derivatives, measures; data that vary are arguments."""
