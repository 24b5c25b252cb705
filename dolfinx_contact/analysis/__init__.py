# SPDX-License-Identifier: LGPL-3.0-or-later
"""Analyses of contact problems with friction: uniqueness, charts, critical friction, stability.

Proofs that all solutions are known are in `dolfinx_contact.proofs`.
"""

from dolfinx_contact.analysis.branch_counts import BranchCounts, ProvedCount, prove_counts
from dolfinx_contact.analysis.charts import Chart, ChartCell, count_solutions, solution_regions
from dolfinx_contact.analysis.critical_friction import CriticalFriction, critical_friction
from dolfinx_contact.analysis.directions_of_slip import (
    FrictionByDirection,
    critical_friction_by_direction,
)
from dolfinx_contact.analysis.event_curves import EventCurve, EventCurves, Meeting, Segment
from dolfinx_contact.analysis.renard import Renard, renard_criterion
from dolfinx_contact.analysis.shakedown import LoadCycles, Shakedown, shakedown
from dolfinx_contact.analysis.stability import Stability, stability_at_rest
from dolfinx_contact.analysis.steady_sliding import Onset, SlidingModes, SteadySliding
from dolfinx_contact.analysis.two_parameters import contact_family, event_curves
from dolfinx_contact.analysis.wedging import Wedging, wedging_friction

__all__ = [
    "BranchCounts",
    "Chart",
    "ChartCell",
    "CriticalFriction",
    "EventCurve",
    "EventCurves",
    "FrictionByDirection",
    "LoadCycles",
    "Meeting",
    "Onset",
    "ProvedCount",
    "Renard",
    "Segment",
    "Shakedown",
    "SlidingModes",
    "Stability",
    "SteadySliding",
    "Wedging",
    "contact_family",
    "count_solutions",
    "critical_friction",
    "critical_friction_by_direction",
    "event_curves",
    "prove_counts",
    "renard_criterion",
    "shakedown",
    "solution_regions",
    "stability_at_rest",
    "wedging_friction",
]
