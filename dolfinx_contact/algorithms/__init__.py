# SPDX-License-Identifier: LGPL-3.0-or-later
"""Algorithms on the reduced problem: numpy arrays, contact points only."""

from dolfinx_contact.algorithms.lemke import RayTermination, coulomb_by_lemke, lemke

__all__ = ["RayTermination", "coulomb_by_lemke", "lemke"]
