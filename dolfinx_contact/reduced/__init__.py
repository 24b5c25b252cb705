# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contact problem reduced to its contact points."""
