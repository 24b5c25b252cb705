# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points: where they are, what is given there, and the operators leading to them."""
