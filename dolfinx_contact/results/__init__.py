# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of contact points, balance of forces, and indicators of model validity."""
