# SPDX-License-Identifier: LGPL-3.0-or-later
"""What was found: tables of contact points, the balance of forces, and what is to be doubted."""
