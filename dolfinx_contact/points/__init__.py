# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points: positions, data of obstacle and law, and the operators B and E."""
