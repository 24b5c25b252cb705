# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is known of the solutions of a contact problem: whether they are unique, and stable."""

from dolfinx_contact.analysis.critical_friction import CriticalFriction, critical_friction
from dolfinx_contact.analysis.renard import Renard, renard_criterion
from dolfinx_contact.analysis.stability import Stability, stability_at_rest
from dolfinx_contact.analysis.steady_sliding import Onset, SlidingModes, SteadySliding

__all__ = [
    "CriticalFriction",
    "Onset",
    "Renard",
    "SlidingModes",
    "Stability",
    "SteadySliding",
    "critical_friction",
    "renard_criterion",
    "stability_at_rest",
]
